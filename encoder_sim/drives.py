# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""How far the axes stay behind their demand: `Drive` at work."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss

from . import keyed_noise
from .axis_motion import AXES
from .field_kinds import number

#: so many time constants of the loop are remembered, in pieces of one with 8 nodes each
_REMEMBERED = 30
_NODES, _WEIGHTS = leggauss(8)
#: rad from one call to the next: less is no slew (sidereal rate at 10 a second is 7e-6)
_SLEWS = 1e-4


@dataclass(frozen=True)
class Drive:
    """The servo and the friction of one axis.

    A position loop of finite gain lags behind a demand that moves: by rate / gain (velocity error
    of a type-1 servo; W. Gawronski, IPN Progress Report 42-159, 2004, for antennas and telescopes).
    Where static friction exceeds the sliding one, the axis sticks until the drive has wound up, and
    slips: the slip and the rate below which that happens as of B. Armstrong-Helouvry 1990, Proc.
    IEEE ICRA, 1377 (Stribeck friction); a telescope so measured: that of ARIES, 50/80 cm, LuGre.

    Attributes
    ----------
    gain : float
        Velocity constant of the position loop, rad/s a rad; 0: ideal. About 2 pi times the
        bandwidth, which is 1 to 3 Hz (L. Zago 1995, thesis EPFL 1394, for ESO's telescopes).
    feed_forward : float
        Part of the demanded rate that is fed forward, so that only the rest makes a lag.
    stick : float
        How far the axis slips at once, rad.
    stick_rate : float
        It slides smoothly at rates well above this (Stribeck), rad/s.
    """

    gain: float = number(0.0, 'per_s', 0.0, 1000.0)
    feed_forward: float = number(0.0, 'percent', 0.0, 100.0)
    stick: float = number(0.0, 'arcsec', 0.0, 600.0)
    stick_rate: float = number(20.0, 'arcsec_per_s', 1e-3, 36000.0)


@dataclass(frozen=True)
class Coupling:
    """The shaft coupling between an axis and its incremental encoder.

    Friction in the encoder's bearing and seal twists it against the motion. After a reversal the
    twist goes over to the other side along the way (P. R. Dahl 1968, Aerospace Corp. TOR-158).

    Attributes
    ----------
    wind_up : float
        Twist when the axis has moved far: friction torque over torsional rigidity, rad. 0.01 Nm
        over 500 Nm/rad is 4".
    distance : float
        Way over which all but 1/e of a change has been made, rad.
    slip, slip_from : float
        In a slew of more than `slip_from` (rad) it lets go, and the encoder stays behind by `slip`
        (rad) for good.
    """

    wind_up: float = number(0.0, 'arcsec', 0.0, 3600.0)
    distance: float = number(0.5, 'deg', 1e-3, 90.0)
    slip: float = number(0.0, 'arcsec', 0.0, 3600.0)
    slip_from: float = number(60.0, 'deg', 0.1, 360.0)


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
        self._slip, self._slip_from = (np.array([getattr(one, name) for one in both])
                                       for name in ('slip', 'slip_from'))
        self._slipped, self._slew = np.zeros(2), np.zeros(2)
        self._yields = bool(self._wind_up.any() or self._slip.any())

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
            self._let_go(way)
        if np.isfinite(angles).all():
            self._last = angles
        return angles - self._twist - self._slipped

    def _let_go(self, way):
        """Slip once in each slew that gets long enough; a stop or a return ends a slew."""
        goes_on = (np.abs(way) > _SLEWS) & (way * self._slew >= 0.0)
        slew = np.where(goes_on, self._slew + way, np.where(np.abs(way) > _SLEWS, way, 0.0))
        long = (np.abs(slew) > self._slip_from) & ~(
            goes_on & (np.abs(self._slew) > self._slip_from))
        self._slipped = self._slipped + self._slip * np.sign(way) * long
        self._slew = slew
