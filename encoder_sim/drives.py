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

"""Lag of the axes behind their demand, from servo and friction."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss

from . import keyed_noise
from .axis_motion import AXES
from .field_kinds import number

#: length of the loop's memory in time constants, integrated in steps of one with 8 nodes each
_REMEMBERED = 30
_NODES, _WEIGHTS = leggauss(8)
#: rad between calls; smaller motions are no slew (sidereal rate at 10 calls a second is 7e-6)
_SLEWS = 1e-4


@dataclass(frozen=True)
class Drive:
    """Servo and friction of one axis.

    A position loop of finite gain lags behind a moving demand by rate / gain (velocity error
    of a type-1 servo; W. Gawronski, IPN Progress Report 42-159, 2004, for antennas and telescopes).
    If static friction exceeds sliding friction, the axis sticks until the drive has wound up, then
    slips: slip and rate limit follow B. Armstrong-Helouvry 1990, Proc. IEEE ICRA, 1377 (Stribeck
    friction); measured at the ARIES telescope, 50/80 cm, LuGre.

    Attributes
    ----------
    gain : float
        Velocity constant of the position loop, rad/s per rad; 0: ideal. About 2 pi times the
        bandwidth, which is 1 to 3 Hz (L. Zago 1995, thesis EPFL 1394, for ESO's telescopes).
    feed_forward : float
        Fraction of the demanded rate that is fed forward; the rest causes a lag.
    stick : float
        Size of a slip, rad.
    stick_rate : float
        Stribeck rate: the axis slides smoothly at rates well above it, rad/s.
    """

    gain: float = number(0.0, 'per_s', 0.0, 1000.0)
    feed_forward: float = number(0.0, 'percent', 0.0, 100.0)
    stick: float = number(0.0, 'arcsec', 0.0, 600.0)
    stick_rate: float = number(20.0, 'arcsec_per_s', 1e-3, 36000.0)


@dataclass(frozen=True)
class Coupling:
    """The shaft coupling between an axis and its incremental encoder.

    Friction in the encoder's bearing and seal twists it against the motion. After a reversal the
    twist changes sign gradually with the distance (P. R. Dahl 1968, Aerospace Corp. TOR-158).

    Attributes
    ----------
    wind_up : float
        Twist after a long motion: friction torque over torsional rigidity, rad. 0.01 Nm over
        500 Nm/rad gives 4".
    distance : float
        Distance after which 1/e of a change remains, rad.
    slip, slip_from : float
        In a slew of more than `slip_from` (rad) the coupling slips, and the encoder permanently
        loses `slip` (rad).
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
        """Whether any axis sticks."""
        return any(drive.stick > 0.0 for drive in self._drives)

    def lag(self, times, state):
        """Lag of the axes at `times`.

        The loop obeys y' = gain (r - y) + forward r', so r - y is (1 - forward) / gain times the
        mean of the past r' with the weight gain exp(-gain age): rate / gain at steady rates, minus
        acceleration / gain^2, plus a remainder of previous slews.

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
        """How far the drive has advanced since the last slip."""
        sense = np.sign(rates)
        wound = np.mod(sense * angles / drive.stick + self._phase[i], 1.0)
        # at high rates it slides
        return sense * drive.stick * wound * np.exp(-((rates / drive.stick_rate) ** 2))


class ShaftCouplings:
    """Couplings between the axes and their encoders.

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
        """Angles of the encoders' shafts after the axes have moved to `angles`.

        Assumes motion in one direction between two calls.

        Parameters
        ----------
        angles : array_like, shape (2,)
            Angles of the axes, rad, not wrapped.

        Returns
        -------
        ndarray, shape (2,)
            rad: lags behind the axes by the twist.
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
        """Slip once in each slew that is long enough; a stop or reversal ends a slew."""
        goes_on = (np.abs(way) > _SLEWS) & (way * self._slew >= 0.0)
        slew = np.where(goes_on, self._slew + way, np.where(np.abs(way) > _SLEWS, way, 0.0))
        long = (np.abs(slew) > self._slip_from) & ~(
            goes_on & (np.abs(self._slew) > self._slip_from))
        self._slipped = self._slipped + self._slip * np.sign(way) * long
        self._slew = slew
