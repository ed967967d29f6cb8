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

"""A supervisor for drivers that are sent to a place and slew to it in their own way.

The way of such a driver is unknown. So it is sent only the track, as far as it may be followed, and
again while all is well. Its readings show whether the axes stay in the checked range, which is
everything between their former place and the track.
"""

import math

import numpy as np

from msg_tools.units import DEG

from ..observing.axis_demand import Track
from .axis_track import resting
from .reasons_to_stop import off_way
from .sent_course import Course
from .supervisor import Supervisor

#: longest leg of an axis, rad: near half a turn a driver may go the other way round
LONGEST = 150.0 * DEG
#: distance of via points from the pole of a polar mount, rad: at the pole a place of the sky does
#: not determine the first axis
POLE = 6.0 * DEG
#: a track at rest that ends this soon is a stop, s
STOP = 0.1


class GotoSupervisor(Supervisor):
    """A `Supervisor` with the same parameters, whose `settings.whole` is False.

    A stop is a track at rest of `STOP` seconds. Legs longer than `LONGEST` are split. If speed and
    order of the axes are unknown, the limits' `timing` must be 0.
    """

    def _to_via(self, now, name='around'):
        first, second = self._vias[0]
        # the last point of a way to the park position is the park position itself
        if self._near_pole(second) and (self._goal is not None or len(self._vias) > 1):
            side = 1.0 if float(self.readings.here[1]) > 0.5 * math.pi else -1.0
            self._vias[0] = first, 0.5 * math.pi + side * POLE
        super()._to_via(now, name)

    def _near_pole(self, second):
        return abs(second - 0.5 * math.pi) < POLE and not self.limits.mount.vertical

    def _set_out(self, cubic, state, now, name):
        here, move = np.array(state.angles), cubic.angles[0] - state.angles
        longest = float(np.abs(move).max())
        legs = math.ceil(longest / LONGEST)
        if legs > 1:
            # places on the way have been checked with the whole way
            for more in (0.0, POLE, -POLE, 2.0 * POLE, -2.0 * POLE):
                part = longest / legs + more
                there = here + np.clip(move, -part, part)
                if not self._near_pole(there[1]):
                    break
            self._vias = [tuple(there.tolist()), *self._vias]
            cubic = resting(there)
            name = 'parking' if name == 'parking' else 'around'
        self._course = Course(now, cubic)
        ends = np.vstack([cubic.angles, here])
        self._low, self._high = ends.min(0), ends.max(0)
        self._send_piece(now)
        self._announce(name)
        return True

    def _brake(self, now):
        self._course = None
        if self.readings.here is not None:
            self._out.append(Track(now, np.array([0.0, STOP]), np.tile(self.readings.here, (2, 1)),
                                   np.zeros((2, 2))))

    def _astray(self):
        if self.readings.stamp <= self._course.start:
            return ''
        return off_way(self.readings.here, (self._low, self._high), self._settings.behind,
                       self.limits.axes, self.limits.mount.names.axes)
