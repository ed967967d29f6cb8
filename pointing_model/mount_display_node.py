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

"""The display for RViz and Foxglove: the mount, its line of sight and its target."""

import time

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import Marker, MarkerArray

from msg_tools import convert, topics
from msg_tools.node import MountNode, Param

from .mount_shape import PIER, ROOT, frames_of, parts_of, placed, urdf
from .sky.sky_params import KIND_OF_MOUNT, SKY_PARAMS, mount_of

PARAMS = (
    KIND_OF_MOUNT, SKY_PARAMS[0],
    Param('rate_hz', 10.0, 'pictures a second of wall time at most [Hz]', 0.1, 100.0, fixed=True),
    Param('description', True, 'publish robot_description; false beside robot_state_publisher, '
          'which does', fixed=True),
)
BORESIGHT, STAR = (0.2, 0.7, 1.0), (1.0, 0.85, 0.2)
#: s after which everything is drawn again for late subscribers
AGAIN = 1.0
#: ids of the markers that are not parts of the mount
LOOKS, SENT = 1000, 1001


class MountDisplay(MountNode):
    """Publishes `robot_description` once, and with each reading `joint_states` and `markers`."""

    def __init__(self, **kwargs):
        super().__init__('mount_display', PARAMS, hardware_id='picture of the mount', **kwargs)
        self._mount = mount_of(self)
        self._parts = parts_of(self._mount)
        self._reading = self._star = None
        self._new, self._drawn = True, 0.0
        if self.value('description'):
            self.publisher(topics.ROBOT_DESCRIPTION).publish(String(data=urdf(self._mount)))
        self._joints_pub = self.publisher(topics.JOINTS)
        self._markers_pub = self.publisher(topics.MARKERS)
        self.subscribe(topics.INCREMENTAL, self._on_reading)
        self.subscribe(topics.REQUEST, self._on_request)
        self.every(1.0 / self.value('rate_hz'), self._draw)

    def _on_reading(self, message):
        if convert.joints_of(message.name) != self._mount.names.keys:
            raise ValueError(f'joints {" and ".join(convert.joints_of(message.name))}, and the '
                             f'mount has {" and ".join(self._mount.names.keys)}')
        stamp, angles, rates, _ = convert.read_joints(message)
        if np.isfinite(angles).all():  # not finite before homing: position unknown
            self._reading, self._new = (stamp, angles, rates), True

    def _on_request(self, message):
        self._new = True
        if not len(message.points):
            self._star = None
            return
        _, _, angles, _ = convert.read_trajectory(message)
        self._star = self._mount.direction(*angles[0])

    def _draw(self):
        new, self._new = self._new, False
        if not new and time.monotonic() - self._drawn < AGAIN:
            return
        self._drawn = time.monotonic()
        stamp, frames = 0, frames_of(self._mount, (0.0, 0.0))
        if self._reading is not None:
            stamp, angles, rates = self._reading
            frames = frames_of(self._mount, angles)
            if new:
                self._joints_pub.publish(convert.joint_state(
                    stamp, angles, rates, names=self._mount.names.keys))
        self._markers_pub.publish(MarkerArray(markers=[
            *self._solid(stamp, frames), *self._lines(stamp)]))

    def _solid(self, stamp, frames):
        for number, part in enumerate(self._parts):
            if part.link != PIER and self._reading is None:
                continue
            place, turned = placed(part, frames)
            cylinder = len(part.size) == 2
            # a cylinder has both diameters
            size = (2.0 * part.size[0], 2.0 * part.size[0], part.size[1]) if cylinder else part.size
            marker = _marker(stamp, number, Marker.CYLINDER if cylinder else Marker.CUBE,
                             part.colour, size)
            marker.pose = Pose(position=_point(place),
                               orientation=Quaternion(**dict(zip('xyzw', turned.tolist()))))
            yield marker

    def _lines(self, stamp):
        for number, colour, end in (
                (LOOKS, BORESIGHT, self._reading and self._mount.direction(*self._reading[1])),
                (SENT, STAR, self._star)):
            if end is None:
                yield Marker(header=convert.header(stamp, ROOT), ns='mount', id=number,
                             action=Marker.DELETE)
            elif number == LOOKS:
                marker = _marker(stamp, number, Marker.ARROW, colour, (0.01, 0.025, 0.05))
                marker.points = [_point(np.zeros(3)), _point(end)]
                yield marker
            else:
                marker = _marker(stamp, number, Marker.SPHERE, colour, (0.05, 0.05, 0.05))
                marker.pose.position = _point(end)
                yield marker

    def required(self):
        """The encoder topic, without which there is no mount to draw."""
        return {self.resolve_topic_name(topics.INCREMENTAL.name)}


def _marker(stamp, number, kind, colour, size):
    red, green, blue = colour
    return Marker(header=convert.header(stamp, ROOT), ns='mount', id=number, type=kind,
                  action=Marker.ADD, scale=Vector3(**dict(zip('xyz', map(float, size)))),
                  color=ColorRGBA(r=red, g=green, b=blue, a=1.0))


def _point(values):
    return Point(**dict(zip('xyz', map(float, values))))
