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

from msg_tools import convert

NS = 1_768_482_000_123_456_789


def test_stamps_are_exact_to_the_nanosecond():
    stamp = convert.to_stamp(NS)
    assert (stamp.sec, stamp.nanosec) == (1_768_482_000, 123_456_789)
    assert convert.from_stamp(stamp) == NS
    assert convert.from_stamp(convert.to_stamp(0)) == 0


def test_joints_by_name_whatever_their_order():
    message = convert.joint_state(NS, [1.0, 2.0], [3.0, 4.0], [5.0, 6.0])
    assert list(message.name) == ['azimuth', 'elevation']
    assert convert.read_joints(message) == (NS, (1.0, 2.0), (3.0, 4.0), (5.0, 6.0))
    message.name = ['focus', 'elevation', 'azimuth']
    message.position, message.velocity, message.effort = [0.0, 2.0, 1.0], [0.0, 4.0, 3.0], []
    stamp, position, velocity, effort = convert.read_joints(message)
    assert (position, velocity) == ((1.0, 2.0), (3.0, 4.0))
    assert np.isnan(effort).all()


def test_all_three_arrays_are_filled():
    message = convert.joint_state(NS, [1.0, 2.0])
    assert len(message.velocity) == len(message.effort) == 2
    assert np.isnan([*message.velocity, *message.effort]).all()


@pytest.mark.parametrize('names, positions, text', [
    (['az', 'el'], [1.0, 2.0], 'need azimuth and elevation'),
    ([], [], 'need azimuth and elevation'),
    (['azimuth', 'elevation'], [1.0], '1 positions for 2 joints'),
])
def test_bad_joints_are_refused(names, positions, text):
    message = convert.joint_state(NS, [1.0, 2.0])
    message.name, message.position = names, positions
    with pytest.raises(ValueError, match=text):
        convert.read_joints(message)


def test_trajectory_and_back():
    times = [0.0, 20.5, 41.123456789]
    positions, velocities = np.arange(6.0).reshape(3, 2), np.arange(6.0, 12.0).reshape(3, 2)
    message = convert.trajectory(NS, times, positions, velocities)
    stamp, *back = convert.read_trajectory(message)
    assert stamp == NS
    for value, wanted in zip(back, (times, positions, velocities)):
        np.testing.assert_allclose(value, wanted, rtol=0, atol=1e-9)
    message.joint_names = ['elevation', 'azimuth']
    np.testing.assert_array_equal(convert.read_trajectory(message)[2], positions[:, ::-1])
    for point in message.points:
        point.velocities = []
    assert not convert.read_trajectory(message)[3].any()


def _edit(**changes):
    def edit(message):
        for name, value in changes.items():
            setattr(message, name, value)
    return edit


def _points(**changes):
    def edit(message):
        for name, value in changes.items():
            setattr(message.points[1], name, value)
    return edit


@pytest.mark.parametrize('edit, text', [
    (_edit(points=[]), 'without points'),
    (_edit(joint_names=['a', 'b']), 'need azimuth and elevation'),
    (_edit(joint_names=['azimuth', 'elevation', 'focus']), 'needs 3 positions'),
    (_points(positions=[1.0]), 'needs 2 positions'),
    (_points(positions=[float('nan'), 1.0]), 'not finite'),
    (_points(positions=[float('inf'), 1.0]), 'not finite'),
    (_points(velocities=[1.0]), 'velocities'),
    (_points(velocities=[1.0, float('nan')]), 'not finite'),
    (lambda message: message.points.reverse(), 'must increase'),
])
def test_bad_trajectories_are_refused(edit, text):
    message = convert.trajectory(NS, [0.0, 1.0], np.zeros((2, 2)), np.zeros((2, 2)))
    edit(message)
    with pytest.raises(ValueError, match=text):
        convert.read_trajectory(message)


def test_status_rows():
    from diagnostic_msgs.msg import DiagnosticStatus
    status = convert.status(DiagnosticStatus.WARN, 'name', 'text', number=3)
    assert status.level == DiagnosticStatus.WARN
    assert [(row.key, row.value) for row in status.values] == [('number', '3')]


def test_temperature():
    message = convert.temperature(NS, -12.5)
    assert convert.read_temperature(message) == (NS, -12.5)
    for bad in (float('nan'), float('inf'), -300.0, 5000.0, 60.1, -90.1):
        with pytest.raises(ValueError, match='which no air has'):
            convert.read_temperature(convert.temperature(NS, bad))
