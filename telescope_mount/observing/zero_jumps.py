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

"""Detects jumps of an encoder's zero during a power-on, from its readings."""

import math
from collections import deque

from msg_tools.units import ARCSEC, DEG, wrap

#: least jump, rad; smaller than the axis' acceleration, rad/s^2, explains within a sample: no jump
LEAST_JUMP, ACCELERATION = 60.0 * ARCSEC, 3.0 * DEG
#: fraction of the jump by which steps before and after may differ, and the axis miss its track
STEADY = 0.2


class ZeroJumps:
    """Consecutive readings of an encoder.

    Parameters
    ----------
    own_zero : bool
        Its zero differs from that of the demand.
    """

    def __init__(self, own_zero=False):
        self._last, self._own_zero = deque(maxlen=4), own_zero

    def take(self, stamp, angles, demand):
        """Add a reading.

        Parameters
        ----------
        stamp : int
            ns.
        angles : sequence of float, length 2
            rad; NaN for an axis without a reading.
        demand : callable
            Stamp -> intended axis angles, rad, shape (2,); None if unknown.

        Returns
        -------
        (int, float) or None
            The axis, and the jump of its zero at the previous reading, rad.
        """
        if not any(map(math.isfinite, angles)) or self._last and stamp <= self._last[-1][0]:
            self._last.clear()
            return None
        self._last.append((stamp, *map(float, angles)))
        if len(self._last) < 4:
            return None
        (t0, *p0), (t1, *p1), (t2, *p2), (t3, *p3) = self._last
        for axis in (0, 1):
            step = wrap(p2[axis] - p1[axis])
            if not abs(step) >= 0.5 * LEAST_JUMP:
                continue
            seconds = (t2 - t1) * 1e-9
            before = wrap(p1[axis] - p0[axis]) * (t2 - t1) / (t1 - t0)
            after = wrap(p3[axis] - p2[axis]) * (t2 - t1) / (t3 - t2)
            jump = step - 0.5 * (before + after)
            if abs(before - after) < STEADY * abs(jump) and abs(jump) > max(
                    LEAST_JUMP, ACCELERATION * seconds**2) and self._leaves(demand, axis, jump):
                return axis, jump
        return None

    def _leaves(self, demand, axis, jump):
        """Whether the axis was on its track before, and is off by the jump afterwards."""
        way = []
        for stamp, *place in (self._last[1], self._last[2]):
            there = demand(stamp)
            if there is None:
                return False
            way.append(wrap(place[axis] - there[axis]))
        before = way[0] if self._own_zero else 0.0
        return all(abs(wrap(off - beside)) <= STEADY * abs(jump)
                   for off, beside in zip(way, (before, before + jump)))
