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

"""Output and diagnostics of nodes that read an absolute encoder, and batches of samples."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.units import wrap

from .axis_reader import read_frames
from .frame_readings import QUALITIES, REJECTED

_BOTH = np.arange(2)
#: s between readings from which on they give no velocity: the axis may have been elsewhere
LONGEST_GAP = 1.0


class Velocities:
    """Velocities from a reader's own readings: difference of the last two over the time between.

    An image alone gives no velocity. For readings with a standard error sigma, `dt` apart, that of
    the velocity is sqrt(2) sigma / dt.
    """

    def __init__(self):
        self._last = None

    def forget(self):
        """Forget the last reading, since the next one is not related to it."""
        self._last = None

    def __call__(self, stamp, angle):
        """Velocities at the reading of `stamp`.

        Parameters
        ----------
        stamp : int
            ns.
        angle : array_like, shape (n,)
            Angle of each axis, rad; NaN if rejected.

        Returns
        -------
        ndarray, shape (n,)
            rad/s; NaN without two consecutive good readings.
        """
        before, self._last = self._last, (stamp, np.asarray(angle, dtype=float))
        passed = np.nan if before is None else (stamp - before[0]) * 1e-9
        if not 0.0 < passed <= LONGEST_GAP:
            return np.full(len(self._last[1]), np.nan)
        return wrap(self._last[1] - before[1]) / passed


class AngleOutput:
    """Topics and diagnostics of a node that reads both axes.

    Only one node of a graph may have this: two would publish different angles on one topic. It
    replaces the node's `problems` and `details` by its own.

    Parameters
    ----------
    node : msg_tools.node.MountNode
    axes : sequence of axis_reader.AxisReader
        Their names are those of the joints.
    """

    def __init__(self, node, axes):
        self._node, self._axes = node, axes
        self._names = [axis.axis for axis in axes]
        node.problems, node.details = self.problems, self.details
        self._angles = node.publisher(topics.ABSOLUTE)
        self._poses = node.publisher(topics.ABSOLUTE_POSE)
        self._counts = np.zeros((2, 3), dtype=np.int64)  # by axis and quality
        self._velocities, self._power_on = Velocities(), None

    def read(self, stamps, frames, power_ons):
        """Read frames and publish the angles with their `Velocities`.

        Parameters
        ----------
        stamps : sequence of int
            n of them, ns.
        frames : sequence of ndarray, shape (heads, n, pixels)
            Frames of each axis.
        power_ons : sequence of PowerOn or None
            Power-on of each reading; velocities start again when it changes.
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
        """For the node's diagnostics: another reader in the graph, or rejected images."""
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
        """For the node's diagnostics: numbers of readings by quality."""
        return [(f'{axis.replace("_", " ")} {name}', str(count))
                for axis, counts in zip(self._names, self._counts)
                for name, count in zip(QUALITIES, counts)]


class Batch:
    """Collects items that arrive together: one call for many costs less than many calls.

    A node's subscription calls `finish` `after` the messages that were ready, so nothing waits for
    later messages, and a node that has fallen behind catches up.

    Parameters
    ----------
    work : callable
        ``work(items)``.
    most : callable
        ``most()``: largest number of items per call.
    """

    def __init__(self, work, most):
        self._work, self._most, self._items = work, most, []

    def add(self, item):
        """Add an item."""
        self._items.append(item)

    def finish(self):
        """Process the collected items."""
        items, self._items = self._items, []
        most = self._most()
        for i in range(0, len(items), most):
            self._work(items[i : i + most])
