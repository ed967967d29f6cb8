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

"""Readings of the axis encoders, with detection of impossible ones."""

import math

import numpy as np

from msg_tools.units import DEG, wrap

from .limits import BEYOND
from .motion import AxisState

#: a step faster than the axis' rate by this factor, and larger than this (rad), is a jump
FASTER, FARTHER = 1.5, 2.0 * DEG
#: number of readings at the new place after which a jump is accepted
BELIEVED = 5
_TURN = 2.0 * math.pi


class AxisReadings:
    """Position of the axes.

    Parameters
    ----------
    limits : limits.Limits
    wall : callable
        Seconds of a monotonic clock.

    Attributes
    ----------
    here, rate : ndarray, shape (2,), or None
        rad and rad/s, with the turns of the first axis counted; None if unknown.
    stamp : int
        ns.
    """

    def __init__(self, limits, wall):
        self._limits, self._wall = limits, wall
        self.here = self.rate = None
        self.stamp, self._jumped, self._odd = 0, None, 0
        self._first = self._raw = 0.0  # raw first axis: initial and last, rad
        self._moved = False  # since then, so turns are counted
        self._last_take = self._period = None

    def take(self, stamp, angles, rates):
        """Add a reading, rad and rad/s (NaN: unknown); ValueError for an impossible one.

        Returns
        -------
        bool
            Whether a jump to another place is now accepted.
        """
        now = self._wall()
        if self._last_take is not None and now > self._last_take:
            passed = now - self._last_take
            # bursts and single gaps do not define its period
            self._period = passed if self._period is None else (
                self._period + 0.1 * (min(passed, 2.0 * self._period) - self._period))
        self._last_take = now
        # two numbers a thousand times per second: floats take a third of the time of arrays
        angles = [float(angle) for angle in angles]
        if not all(map(math.isfinite, angles)):
            self.here = self.rate = self._jumped = None
            self.stamp = stamp
            return False
        self._check(angles)
        seconds = (stamp - self.stamp) * 1e-9
        if self.here is None or seconds <= -1.0:
            self.here, self.stamp, self.rate = np.array(angles), stamp, np.array(rates, float)
            self._first, self._raw, self._moved = angles[0], angles[0], False
            return False
        if seconds <= 0.0:
            return False  # out of order
        before = self.here.tolist()
        step = [angle - here for angle, here in zip(angles, before)]
        # other axes stay on their turn, however far they went
        if self._limits.mount.vertical and not self._other_turn(angles[0]):
            step[0] = wrap(step[0])
        beyond = [abs(one) - FARTHER - FASTER * seconds * axis.rate
                  for one, axis in zip(step, self._limits.axes)]
        if max(beyond) > 0.0 and not self._again(np.array(angles)):
            i = beyond.index(max(beyond))
            word = self._limits.mount.names.axes[i]
            raise ValueError(
                f'the reading of {word} jumped by {step[i] / DEG:.1f} deg in {seconds:.2f} s: '
                'look at the encoder, and that it gives radians')
        jumped, self._jumped, self._raw = max(beyond) > 0.0, None, angles[0]
        self._moved = not jumped and (self._moved or abs(angles[0] - self._first) > FARTHER)
        if jumped:
            self._first = angles[0]
        self.here = np.array([here + one for here, one in zip(before, step)])
        self.rate = np.array([(0.0 if jumped else one / seconds) if math.isnan(rate) else rate
                              for rate, one in zip(map(float, rates), step)])
        self.stamp = stamp
        return jumped

    @property
    def state(self):
        """`AxisState` from the readings; an unknown rate counts as rest."""
        return AxisState(tuple(map(float, self.here)), tuple(
            float(v) if math.isfinite(v) else 0.0 for v in self.rate))

    @property
    def doubtful(self):
        """Whether the last reading contradicts `here` and is not accepted yet."""
        return self._jumped is not None

    def at_rest(self, still):
        """Whether both axes are known to be slower than `still`, rad/s."""
        return self.here is not None and bool(np.all(np.abs(self.rate) < still))

    def rest_at(self, place, near, still):
        """Whether both axes are at rest and closer than `near`, rad, to a pair of angles."""
        return self.at_rest(still) and all(abs(a - b) < near for a, b in zip(self.here, place))

    def _again(self, angles):
        """Whether readings stay at the place of a jump."""
        near = self._jumped is not None and np.all(np.abs(angles - self._jumped) < FARTHER)
        self._odd = self._odd + 1 if near else 1
        self._jumped = angles
        return self._odd >= BELIEVED

    def _other_turn(self, angle):
        """Whether a first axis that has not moved yet is read whole turns away.

        Single-turn encoders wrap at 0 or at 180 degrees.
        """
        low, high = min(angle, self._raw), max(angle, self._raw)
        return not self._moved and high - low > math.pi and not (
            low >= -math.pi and high <= math.pi or low >= 0.0 and high <= _TURN)

    def _check(self, angles):
        for i, (axis, angle) in enumerate(zip(self._limits.axes, angles)):
            low, high = axis.low - BEYOND, axis.high + BEYOND
            if low <= angle <= high:
                continue
            # an azimuth may be read within one turn, on any turn
            turned = wrap(angle)
            if i or not self._limits.mount.vertical or abs(angle) > _TURN or not (
                    low <= turned <= high or low <= turned + _TURN <= high):
                raise ValueError(f'a reading of {self._limits.mount.names.axes[i]} of {angle:.6g} '
                                 f'rad ({angle / DEG:.1f} deg) cannot be: give radians, within '
                                 'the travel')

    @property
    def since(self):
        """Since when nothing was read, s; 0 where nothing ever was."""
        return 0.0 if self._last_take is None else self._wall() - self._last_take

    @property
    def period(self):
        """Mean interval between readings, s; 0 before the second."""
        return self._period or 0.0
