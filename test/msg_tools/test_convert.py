import contextlib

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from msg_tools import convert
from pointing_model.run import PointingRun
from pointing_model.units import DEG

NS = 1_768_482_000_123_456_789


def run(n=3):
    rng = np.random.default_rng(1)
    names = ('az', 'el', 'az_enc', 'el_enc', 'star', 'time')
    columns = {name: rng.uniform(0.1, 1.5, n) for name in names}
    columns['time'] = NS * 1e-9 + rng.uniform(size=n)
    return PointingRun(columns)


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


def test_observations_keep_every_bit():
    rows = run()
    message = convert.run_to_cloud(rows, NS)
    assert (message.height, message.width, len(message.data)) == (1, 3, message.row_step)
    back = convert.cloud_to_run(message)
    assert list(back.columns) == list(rows.columns)
    for name in rows.columns:
        np.testing.assert_array_equal(back[name], rows[name])


def test_points_lie_on_the_sky_east_north_up():
    rows = PointingRun({'az': np.array([90.0, 0.0, 0.0]) * DEG, 'az_enc': np.zeros(3),
                        'el': np.array([0.0, 0.0, 90.0]) * DEG, 'el_enc': np.zeros(3)})
    message = convert.run_to_cloud(rows, NS)
    assert message.header.frame_id == 'mount_enu'
    assert [f.name for f in message.fields[:3]] == ['x', 'y', 'z']
    steps = np.frombuffer(bytes(message.data), np.uint8).reshape(3, message.point_step)
    xyz = np.stack([np.ascontiguousarray(steps[:, f.offset:f.offset + 4]).view('<f4')[:, 0]
                    for f in message.fields[:3]], axis=1)
    np.testing.assert_allclose(xyz, np.eye(3), atol=1e-7)


def test_big_endian_and_foreign_fields():
    rows = run()
    message = convert.run_to_cloud(rows, NS)
    doubles = np.frombuffer(bytes(message.data), np.uint8).reshape(3, message.point_step).copy()
    doubles[:, 16:] = doubles[:, 16:].reshape(3, -1, 8)[:, :, ::-1].reshape(3, -1)
    message.data, message.is_bigendian = doubles.tobytes(), True
    back = convert.cloud_to_run(message)
    np.testing.assert_array_equal(back['el_enc'], rows['el_enc'])
    assert 'x' not in back


def test_bad_observations_are_refused():
    message = convert.run_to_cloud(run(), NS)
    message.data = bytes(message.data)[:-1]
    with pytest.raises(ValueError, match='bytes for 3 rows'):
        convert.cloud_to_run(message)
    message = convert.run_to_cloud(run(), NS)
    message.fields = [f for f in message.fields if f.name != 'el_enc']
    with pytest.raises(ValueError, match='without float64 field el_enc'):
        convert.cloud_to_run(message)
    message = convert.run_to_cloud(run(), NS)
    message.fields[-1].offset = message.point_step
    with pytest.raises(ValueError, match='observation'):
        convert.cloud_to_run(message)
    message = convert.run_to_cloud(run(), NS)
    message.width, message.point_step = 2**31, 0
    with pytest.raises(ValueError, match='observation'):
        convert.cloud_to_run(message)


def test_an_observation_without_rows_is_refused_or_empty():
    message = convert.run_to_cloud(run(), NS)
    message.width, message.data = 0, b''
    with contextlib.suppress(ValueError):
        assert len(convert.cloud_to_run(message)) == 0


def test_status_rows():
    from diagnostic_msgs.msg import DiagnosticStatus
    status = convert.status(DiagnosticStatus.WARN, 'name', 'text', number=3)
    assert status.level == DiagnosticStatus.WARN
    assert [(row.key, row.value) for row in status.values] == [('number', '3')]


def test_temperature():
    message = convert.temperature(NS, -12.5)
    assert convert.read_temperature(message) == (NS, -12.5)
    for bad in (float('nan'), float('inf'), -300.0):
        with pytest.raises(ValueError, match='temperature'):
            convert.read_temperature(convert.temperature(NS, bad))
