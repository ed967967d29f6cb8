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

"""What every node that reads an absolute encoder publishes and reports, and its batches."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics

from .axis_reader import read_frames
from .frame_readings import QUALITIES, REJECTED
from .velocities import Velocities

_BOTH = np.arange(2)


class AngleOutput:
    """What a node that reads both axes publishes and says of itself.

    Of one graph only one node may have this: two would publish different angles on one topic. The
    node's `problems` and `details` are those of its readings.

    Parameters
    ----------
    node : msg_tools.node.MountNode
    axes : sequence of axis_reader.AxisReader
        Whose names are those of the joints.
    """

    def __init__(self, node, axes):
        self._node, self._axes = node, axes
        self._names = [axis.axis for axis in axes]
        node.problems, node.details = self.problems, self.details
        self._angles = node.publisher(topics.ABSOLUTE)
        self._poses = node.publisher(topics.ABSOLUTE_POSE)
        self._counts = np.zeros((2, 3), dtype=np.int64)  # of each axis and quality
        self._velocities, self._power_on = Velocities(), None

    def read(self, stamps, frames, power_ons):
        """Read frames and publish the angles, with their `Velocities`.

        Parameters
        ----------
        stamps : sequence of int
            n of them, ns.
        frames : sequence of ndarray, shape (heads, n, pixels)
            Of each axis.
        power_ons : sequence of PowerOn or None
            Of each reading; velocities begin anew with another one.
        """
        readings = read_frames(self._axes, frames)
        np.add.at(self._counts, (_BOTH, readings.quality), 1)
        for stamp, angle, quality, power_on in zip(
                stamps, readings.angle.tolist(), readings.quality.tolist(), power_ons):
            if power_on != self._power_on:
                self._velocities.forget()
                self._power_on = power_on
            self._angles.publish(convert.joint_state(
                stamp, angle, self._velocities(stamp, angle), quality, names=self._names))
        if self._poses.get_subscription_count() > 0:
            for stamp, angle, (first, second) in zip(
                    stamps, readings.angle.tolist(), np.square(readings.sigma).tolist()):
                self._poses.publish(convert.pose(stamp, angle, ((first, 0.0), (0.0, second))))

    def problems(self):
        """For the node's diagnostics: another reader in the graph, images that were not read."""
        name = self._angles.topic_name
        publishers = self._node.count_publishers(name)
        rejected = int(self._counts[:, REJECTED].sum())
        out = []
        if publishers > 1:
            out.append((DiagnosticStatus.ERROR, f'{publishers} nodes publish {name}: only one may; '
                        'end a frame_reader, or let the simulator publish frames'))
        if rejected:
            out.append((DiagnosticStatus.WARN, f'{rejected} images could not be read'))
        return out

    def details(self):
        """For the node's diagnostics: how many readings were of which quality."""
        return [(f'{axis.replace("_", " ")} {name}', str(count))
                for axis, counts in zip(self._names, self._counts)
                for name, count in zip(QUALITIES, counts)]


class Batch:
    """Collects what comes at once: one call for many costs less than many calls.

    Its `finish` is what a node's subscription calls `after` the messages that were ready, so that
    nothing waits for what is not there yet, and a node that fell behind catches up.

    Parameters
    ----------
    work : callable
        ``work(items)``.
    most : callable
        ``most()`` items at once.
    """

    def __init__(self, work, most):
        self._work, self._most, self._items = work, most, []

    def add(self, item):
        """Take another one."""
        self._items.append(item)

    def finish(self):
        """Work on what has come."""
        items, self._items = self._items, []
        most = self._most()
        for i in range(0, len(items), most):
            self._work(items[i : i + most])
