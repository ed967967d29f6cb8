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

"""The course sent to a mount, and the axis angles along it; checks nothing."""

from typing import NamedTuple

import numpy as np

from ..observing.axis_demand import Track
from .axis_track import Cubic, braked
from .limits import SLEW_SHARE
from .motion import AxisState, moment, plan_move

#: interval between knots of a piece, s
KNOT = 0.25


class Course(NamedTuple):
    """A slew onto a track, and the track.

    Attributes
    ----------
    start : int
        ns.
    cubic : Cubic
        The track; its times are seconds since `start`.
    moves : list of Move, optional
        Slew of each axis onto it; None if the mount gets the track alone.
    """

    start: int
    cubic: Cubic
    moves: list | None = None

    def seconds(self, stamp):
        """Seconds from its start to a stamp (ns)."""
        return (stamp - self.start) * 1e-9

    def moment(self, seconds, axis):
        """Angle and rate of an axis, rad and rad/s."""
        if self.moves is None:
            return self.cubic.at(seconds, axis)
        return moment(self.moves[axis], self.cubic, seconds, axis)

    def state(self, stamp):
        """State of both axes at a stamp, an `AxisState`."""
        return AxisState(*zip(*(self.moment(self.seconds(stamp), axis) for axis in (0, 1))))

    def is_on_track(self, stamp):
        """Whether both axes have reached the track."""
        return not self.moves or self.seconds(stamp) >= max(move.end for move in self.moves)

    def piece(self, now, ahead, axes):
        """The `Track` of the next `ahead` seconds, followed by rest."""
        times = KNOT * np.arange(max(1, round(ahead / KNOT)) + 1)
        points = np.array([[self.moment(at, axis) for axis in (0, 1)]
                           for at in (self.seconds(now) + times).tolist()])
        return Track(now, *braked(times, points[:, :, 0], points[:, :, 1], axes))

    @property
    def track(self):
        """The `Track` alone."""
        return Track(self.start, self.cubic.times, self.cubic.angles, self.cubic.rates)


def moves_onto(cubic, state, axes):
    """The `Move` of each axis onto a track, at `SLEW_SHARE` of its limits; None if impossible."""
    return [plan_move(state.angles[i], state.rates[i], cubic, i, SLEW_SHARE * axis.rate,
                      SLEW_SHARE * axis.acceleration, 1e-9) for i, axis in enumerate(axes)]


def stop_track(now, state, axes):
    """The `Track` of a stop from an `AxisState`."""
    return Track(now, *braked(np.zeros(1), np.array([state.angles]), np.array([state.rates]), axes))
