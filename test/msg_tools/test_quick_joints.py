"""JointState from its bytes: the same as rclpy reads, whatever comes."""

import math
import struct

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from msg_tools import convert
from msg_tools.quick_joints import JointReader, Joints, JointWriter


def alike(ours, theirs):
    """Whether both say the same; NaN is NaN."""
    def told(message):
        return (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id,
                list(message.name),
                *(repr([float(value) for value in values])
                  for values in (message.position, message.velocity, message.effort)))
    return told(ours) == told(theirs)


def of_encoder(ns, rng, write=serialize_message, **kwargs):
    """Bytes of a reading."""
    return write(convert.joint_state(ns, rng.uniform(-9, 9, 2), rng.normal(size=2), **kwargs))


@pytest.mark.parametrize('write', [serialize_message, JointWriter().write])
def test_readings_are_read_as_rclpy_reads_them_and_without_it(write):
    rng = np.random.default_rng(1)
    reader, quick = JointReader(), 0
    for number in range(200):
        data = of_encoder(1_700_000_000 * 10**9 + number, rng, write, frame='mount; power-on é 7')
        message = reader.read(data)
        quick += isinstance(message, Joints)
        assert alike(message, deserialize_message(data, JointState))
        assert convert.read_joints(message)[0] % 1000 == number % 1000
    assert quick == 199


def random_message(rng):
    """Any, of few kinds, so that sizes repeat where contents differ."""
    message = JointState()
    message.header.stamp.sec = int(rng.integers(-5, 5))
    message.header.stamp.nanosec = int(rng.integers(0, 10**9))
    message.header.frame_id = str(rng.choice(['', 'a', 'ab', 'abc', 'abcd', 'mount', 'möunt']))
    message.name = [str(rng.choice(['azimuth', 'elevation', 'a', '']))
                    for _ in range(rng.integers(0, 4))]
    for name in ('position', 'velocity', 'effort'):
        setattr(message, name, rng.choice([0.0, -0.0, math.nan, math.inf, 1e-300],
                                          rng.integers(0, 4)).tolist())
    return message


@pytest.mark.parametrize('seed', range(4))
def test_whatever_comes_after_whatever_is_read_alike(seed):
    rng = np.random.default_rng(seed)
    reader = JointReader()
    for _ in range(1500):
        data = serialize_message(random_message(rng))
        for _ in range(rng.integers(1, 3)):
            assert alike(reader.read(data), deserialize_message(data, JointState))


def test_what_has_the_size_of_the_one_before_and_says_otherwise_is_read_anew():
    rng = np.random.default_rng(2)
    reader = JointReader()
    first = of_encoder(5, rng, frame='mount 1')
    reader.read(first)
    data = of_encoder(6, rng, frame='mount 2')
    assert len(data) == len(first)
    assert reader.read(data).header.frame_id == 'mount 2'
    assert isinstance(reader.read(data), Joints)
    other = bytearray(data)
    other[data.index(b'elevation')] = ord('E')
    assert reader.read(bytes(other)).name[1] == 'Elevation'


def test_counts_that_lie_are_not_believed():
    rng = np.random.default_rng(3)
    reader = JointReader()
    data = of_encoder(5, rng, frame='mount')
    reader.read(data)
    at = data.index(struct.pack('<I', 2), data.index(b'elevation'))
    with pytest.raises(ValueError, match='no JointState'):
        reader.read(data[:at] + struct.pack('<I', 10**9) + data[at + 4:])
    assert isinstance(reader.read(data), Joints)  # and the next one is read as before


@pytest.mark.parametrize('data', [b'', b'\x00', b'\x00\x01\x00\x00', b'\xff' * 40])
def test_what_is_no_message_is_refused_in_a_line(data):
    with pytest.raises(ValueError, match='no JointState') as caught:
        JointReader().read(data)
    assert '\n' not in str(caught.value)


def test_a_message_of_a_big_endian_machine_is_read():
    message = convert.joint_state(7, [0.25, 0.5], [1.0, 2.0], frame='mount')
    names = b''.join(struct.pack('>I', len(text) + 1) + text.encode() + b'\0' + b'\0' * pad
                     for text, pad in (('azimuth', 0), ('elevation', 2)))
    body = struct.pack('>iI', 0, 7) + struct.pack('>I', 6) + b'mount\0\0\0' + struct.pack(
        '>I', 2) + names
    for values in (message.position, message.velocity, message.effort):
        body += struct.pack('>I', 2)
        body += b'\0' * (-len(body) % 8) + struct.pack('>2d', *values)
    data = b'\x00\x00\x00\x00' + body
    reader = JointReader()
    for _ in range(2):
        assert alike(reader.read(data), message)
