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

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from visualization_msgs.msg import Marker

from msg_tools import convert, topics
from pointing_model.mount_display_node import LOOKS, SENT, MountDisplay
from pointing_model.mount_shape import PIER, parts_of, urdf
from pointing_model.mounts import parse_mount

MOUNT = parse_mount('german', np.radians(34.3))
NAMES = MOUNT.names.keys


def test_the_mount_its_boresight_and_its_star_are_drawn(graph):
    graph.add(MountDisplay, mount='german', latitude_deg=34.3)
    readings, requests = graph.publisher(topics.INCREMENTAL), graph.publisher(topics.REQUEST)
    shapes, joints, drawn = (graph.listen(topic) for topic in (
        topics.ROBOT_DESCRIPTION, topics.JOINTS, topics.MARKERS))
    graph.connect()
    graph.wait_for(lambda: shapes)
    assert shapes[0].data == urdf(MOUNT)

    def last():
        return {marker.id: marker for marker in drawn[-1].markers} if drawn else {}
    # not homed: where the axes are nobody knows
    readings.publish(convert.joint_state(10**9, [np.nan] * 2, names=NAMES))
    requests.publish(convert.trajectory(10**9, [0.0], [[1.0, 0.5]], [[0.0, 0.0]], NAMES))
    graph.wait_for(lambda: SENT in last() and last()[SENT].action == Marker.ADD)
    standing = [part for part in parts_of(MOUNT) if part.link == PIER]
    assert not joints and len(last()) == len(standing) + 2
    assert last()[LOOKS].action == Marker.DELETE
    star = last()[SENT].pose.position
    np.testing.assert_allclose([star.x, star.y, star.z], MOUNT.direction(1.0, 0.5))
    readings.publish(convert.joint_state(2 * 10**9, [0.9, 2.5], names=NAMES))
    graph.wait_for(lambda: joints and last()[LOOKS].action == Marker.ADD)
    assert tuple(joints[0].name) == NAMES and list(joints[0].position) == [0.9, 2.5]
    assert len(last()) == len(parts_of(MOUNT)) + 2
    tip = last()[LOOKS].points[1]
    np.testing.assert_allclose([tip.x, tip.y, tip.z], MOUNT.direction(0.9, 2.5))
    assert {marker.header.frame_id for marker in last().values()} == {'mount_enu'}
    requests.publish(topics.REQUEST.message())  # withdrawn
    graph.wait_for(lambda: last()[SENT].action == Marker.DELETE)
