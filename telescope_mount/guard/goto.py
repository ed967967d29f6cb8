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

"""A supervisor of drivers that are sent a place and slew to it as they like.

What such a driver does on the way is its own. So it is sent the track alone, as far as it may be
followed, and told again while all is well; that its axes keep to what was checked, all that lies
between where they were and the track, is seen in their readings.
"""

import math

import numpy as np

from msg_tools.units import DEG

from ..observing.axis_demand import Track
from .axis_track import resting
from .sent_course import Course
from .supervisor import Supervisor
from .watchdog import off_way

#: longest leg of an axis, rad: where half a turn is near, a driver may take the other way round
LONGEST = 150.0 * DEG
#: points to pass keep so far from the pole of a polar mount, rad: there a place of the sky says
#: little of the first axis
POLE = 6.0 * DEG
#: a track that rests, and is over so soon, is a stop, s
STOP = 0.1


class GotoSupervisor(Supervisor):
    """As `Supervisor`, whose `settings.whole` is False; parameters are the same.

    A stop is a track at rest of `STOP` seconds. Legs that are longer than `LONGEST` are gone in
    parts. Where nothing is known of how fast and in which order the axes go, the limits' `timing`
    is to be 0.
    """

    def _to_via(self, now, name='around'):
        first, second = self._vias[0]
        # the last one of a way to the park position is that itself
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
            # where it comes by, that has been checked with the whole
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
