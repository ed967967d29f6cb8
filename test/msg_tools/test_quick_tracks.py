"""JointTrajectory and JointState as bytes: the same as rclpy reads and writes, whatever comes."""

import struct

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from msg_tools import convert, topics
from msg_tools.node import MountNode
from msg_tools.quick_joints import JointWriter
from msg_tools.quick_tracks import JointTrack, TrackReader, TrackWriter, joint_track

FRAMES = ['', 'a', 'ab', 'abc', 'abcd', '/mount/star_observer', 'möunt']


def track(rng, count):
    """Times, positions and velocities."""
    return (np.cumsum(rng.random(count)) * 7.0 - 1.0, rng.normal(size=(count, 2)),
            rng.normal(size=(count, 2)))


def same_bytes(ours, theirs):
    """Whether rclpy writes the same: but for gaps, which it leaves as they were, and its end."""
    return len(ours) <= len(theirs) and all(
        a == b or a == 0 for a, b in zip(ours, theirs))


@pytest.mark.parametrize('names', convert.JOINTS)
@pytest.mark.parametrize('frame', FRAMES)
def test_tracks_are_written_and_read_as_by_rclpy(frame, names):
    rng, reader, writer = np.random.default_rng(1), TrackReader(), TrackWriter()
    reader.read(writer.write(joint_track(1, *track(rng, 1), names, frame)))
    for count in range(1, 20):
        ns, what = int(rng.integers(1 << 60)), track(rng, count)
        theirs = convert.trajectory(ns, *what, names)
        theirs.header.frame_id = frame
        ours = writer.write(joint_track(ns, *what, names, frame))
        assert deserialize_message(ours, JointTrajectory) == theirs
        assert same_bytes(ours, serialize_message(theirs))
        for data in (ours, serialize_message(theirs)):
            back = reader.read(data)
            assert back.header.frame_id == frame and tuple(back.joint_names) == names
            for own, other in zip(convert.read_trajectory(back), convert.read_trajectory(theirs)):
                assert np.array_equal(own, other)
    assert isinstance([reader.read(ours), reader.read(ours)][1], JointTrack)


def test_a_track_without_points_is_written():
    message = joint_track(5, *track(np.random.default_rng(1), 3), convert.AXES, 'me')
    message.points = message.points[:0]
    data = TrackWriter().write(message)
    expected = convert.trajectory(5, [], [], [])
    expected.header.frame_id = 'me'
    assert deserialize_message(data, JointTrajectory) == expected
    with pytest.raises(ValueError, match='without points'):
        convert.read_trajectory(TrackReader().read(data))


def random_trajectory(rng):
    """Any, of few kinds, so that sizes repeat where contents differ."""
    message = JointTrajectory()
    message.header.stamp = convert.to_stamp(int(rng.integers(1 << 60)))
    message.header.frame_id = str(rng.choice(['', 'a', 'abcd', 'möunt']))
    message.joint_names = [str(rng.choice(['azimuth', 'elevation', 'a']))
                           for _ in range(rng.choice([2, 2, 2, 0, 3]))]
    for _ in range(rng.integers(0, 4)):
        point = JointTrajectoryPoint()
        point.time_from_start.sec = int(rng.integers(-3, 4))
        point.time_from_start.nanosec = int(rng.integers(10**9))
        for name in ('positions', 'velocities', 'accelerations', 'effort'):
            usual = 2 if name in ('positions', 'velocities') else 0
            setattr(point, name, rng.normal(
                size=usual if rng.random() < 0.9 else rng.integers(0, 4)).tolist())
        message.points.append(point)
    return message


def told(message):
    """All that it says, or why it cannot be used."""
    try:
        stamp, *arrays = convert.read_trajectory(message)
    except ValueError as err:
        return str(err), list(message.joint_names), message.header.frame_id
    return stamp, [array.tolist() for array in arrays], message.header.frame_id


@pytest.mark.parametrize('seed', range(4))
def test_whatever_comes_after_whatever_is_read_alike(seed):
    rng, reader, quick = np.random.default_rng(seed), TrackReader(), 0
    for _ in range(1500):
        data = serialize_message(random_trajectory(rng))
        for _ in range(rng.integers(1, 3)):
            message = reader.read(data)
            quick += isinstance(message, JointTrack)
            assert told(message) == told(deserialize_message(data, JointTrajectory))
    assert quick > 100


def test_a_count_that_lies_is_not_believed():
    writer, reader = TrackWriter(), TrackReader()
    data = writer.write(joint_track(5, *track(np.random.default_rng(1), 3), convert.AXES))
    assert isinstance([reader.read(data), reader.read(data)][1], JointTrack)
    at = data.index(struct.pack('<II', 3, 2))
    with pytest.raises(ValueError, match='no JointTrajectory'):
        reader.read(data[:at] + struct.pack('<I', 10**9) + data[at + 4:])
    assert isinstance(reader.read(data), JointTrack)  # and the next one is read as before


@pytest.mark.parametrize('data', [b'', b'\x00', b'\x00\x01\x00\x00', b'\xff' * 80])
def test_what_is_no_message_is_refused_in_a_line(data):
    reader = TrackReader()
    reader.read(TrackWriter().write(
        joint_track(5, *track(np.random.default_rng(1), 1), convert.AXES)))
    with pytest.raises(ValueError, match='no JointTrajectory') as caught:
        reader.read(data)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('frame', FRAMES)
def test_readings_are_written_as_by_rclpy(frame):
    rng, writer = np.random.default_rng(1), JointWriter()
    for counts in [(2, 2, 2), (2, 2, 2), (2, 0, 0), (0, 2, 0), (3, 0, 1), (0, 0, 0), (2, 2, 2)]:
        message = JointState(name=[f'{frame}{i}' for i in range(counts[0])])
        message.header.stamp, message.header.frame_id = convert.to_stamp(10**18 + 7), frame
        for name, count in zip(('position', 'velocity', 'effort'), counts):
            setattr(message, name, rng.normal(size=count).tolist())
        data = writer.write(message)
        assert deserialize_message(data, JointState) == message
        assert same_bytes(data, serialize_message(message))


def test_readings_of_either_kind_are_the_same_bytes():
    what = 10**18 + 7, np.array([1.0, np.nan]), (0.5, -0.0), [np.inf, 3.0], 'mount', ['a', 'bc']
    writer = JointWriter()
    assert writer.write(convert.joints(*what)) == writer.write(convert.joint_state(*what))


def test_names_that_are_changed_in_place_are_written():
    writer, message = JointWriter(), convert.joint_state(1, [1.0, 2.0])
    writer.write(message)
    message.name[0] = 'other'
    assert deserialize_message(writer.write(message), JointState).name == ['other', 'elevation']


def test_a_node_publishes_and_takes_both_kinds(graph):
    class Relay(MountNode):
        def __init__(self, **kwargs):
            super().__init__('relay', **kwargs)
            self.joints, self.tracks = map(self.publisher, (topics.INCREMENTAL, topics.COMMAND))
            self.taken = []
            self.subscribe(topics.REQUEST, self.taken.append)

    node = graph.add(Relay)
    request = graph.publisher(topics.REQUEST)
    joints, tracks = graph.listen(topics.INCREMENTAL), graph.listen(topics.COMMAND)
    graph.connect()
    sent = convert.trajectory(5, *track(np.random.default_rng(1), 3))
    sent.header.frame_id = 'abc'  # without a gap before the names, where rclpy leaves anything
    request.publish(sent)
    request.publish(sent)
    graph.wait_for(lambda: len(node.taken) == 2, 'both requests')
    assert [type(message) for message in node.taken] == [JointTrajectory, JointTrack]
    for message in node.taken:
        node.tracks.publish(message)
    node.joints.publish(convert.joint_state(1, [1.0, 2.0], [0.0, 0.0], [0.0, 0.0]))
    node.joints.publish(convert.joints(1, [1.0, 2.0], [0.0, 0.0], [0.0, 0.0]))
    graph.wait_for(lambda: len(joints) == len(tracks) == 2, 'all four')
    assert joints[0] == joints[1] and tracks[0] == tracks[1] == sent
