"""How far the axes stay behind their demand: `scenario.Drive` at work."""

import numpy as np
from numpy.polynomial.legendre import leggauss

from . import keyed_noise
from .axis_motion import AXES

#: so many time constants of the loop are remembered, in pieces of one with 8 nodes each
_REMEMBERED = 30
_NODES, _WEIGHTS = leggauss(8)


class Drives:
    """Servo and friction of both axes.

    Parameters
    ----------
    pair : scenario.Scenario.drives
    seed : int
    """

    def __init__(self, pair, seed):
        self._drives = [getattr(pair, axis) for axis in AXES]
        self._phase = keyed_noise.uniform(seed, 'drive', 'slip', [0, 1])
        past = np.arange(_REMEMBERED)[:, np.newaxis] + 0.5 * (1.0 + _NODES)
        self._past = past.ravel()
        self._weight = np.exp(-self._past) * np.tile(0.5 * _WEIGHTS, _REMEMBERED)

    @property
    def stick(self):
        """Whether an axis does."""
        return any(drive.stick > 0.0 for drive in self._drives)

    def lag(self, times, state):
        """By how much the axes are behind at `times`.

        The loop obeys y' = gain (r - y) + forward r', so r - y is (1 - forward) / gain times the
        mean of r' over the past with the weight gain exp(-gain age): rate / gain while the rate
        is steady, less acceleration / gain^2, and what is left of a slew.

        Parameters
        ----------
        times : ndarray, shape (n,)
            s.
        state : callable
            Demanded angles (m, 2) in rad and rates (m, 2) in rad/s at times (m,).

        Returns
        -------
        ndarray, shape (n, 2)
            rad: demand - axis.
        """
        out = np.zeros((len(times), 2))
        for i, drive in enumerate(self._drives):
            if drive.gain > 0.0 and drive.feed_forward < 1.0:
                ages = self._past / drive.gain
                rates = state(np.subtract.outer(times, ages).ravel())[1][:, i]
                out[:, i] = (1.0 - drive.feed_forward) / drive.gain * (
                    rates.reshape(len(times), -1) @ self._weight)
            if drive.stick > 0.0:
                out[:, i] += self._held(i, drive, *(v[:, i] for v in state(times)))
        return out

    def _held(self, i, drive, angles, rates):
        """How far the drive has gone ahead since the last slip."""
        sense = np.sign(rates)
        wound = np.mod(sense * angles / drive.stick + self._phase[i], 1.0)
        # fast enough, it slides
        return sense * drive.stick * wound * np.exp(-((rates / drive.stick_rate) ** 2))


class ShaftCouplings:
    """Couplings between the axes and the shafts of their encoders.

    Parameters
    ----------
    pair : scenario.Scenario.coupling
    """

    def __init__(self, pair):
        both = [getattr(pair, axis) for axis in AXES]
        self._wind_up = np.array([one.wind_up for one in both])
        self._distance = np.array([one.distance for one in both])
        self._twist, self._last = np.zeros(2), None
        self._yields = bool(self._wind_up.any())

    def turn(self, angles):
        """Angles of the encoders' shafts when the axes have come to `angles`.

        Between two calls the axes are taken to move one way.

        Parameters
        ----------
        angles : array_like, shape (2,)
            Of the axes, rad, not wrapped.

        Returns
        -------
        ndarray, shape (2,)
            rad: behind the axes by the twist.
        """
        angles = np.asarray(angles, dtype=float)
        if not self._yields:
            return angles
        if self._last is not None and np.isfinite(angles).all():
            way = angles - self._last
            end = np.sign(way) * self._wind_up
            self._twist = end + (self._twist - end) * np.exp(-np.abs(way) / self._distance)
        if np.isfinite(angles).all():
            self._last = angles
        return angles - self._twist
