"""JointTrajectory of two joints from and to its bytes: the points are the rows of one array.

rclpy makes six objects of each point. What is laid out otherwise goes the usual way.
"""

import struct
from dataclasses import dataclass

import numpy as np

from .cdr import (
    BEGIN,
    ENCAPSULATION,
    Header,
    Stamp,
    aligned,
    decoded,
    frame_and_names,
    header,
    stamped,
)

#: type of the messages
TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'
# of a point what comes after the count of its positions, and that count of the next one
_POINT = np.dtype([
    ('positions', '<f8', 2), ('velocity_count', '<u4'), ('', '<u4'), ('velocities', '<f8', 2),
    ('acceleration_count', '<u4'), ('effort_count', '<u4'), ('sec', '<i4'), ('nanosec', '<u4'),
    ('next_count', '<u4'), ('', '<u4')])
# the counts among its words, and what they are; the last point has no next one
_COUNTS, _WANTED, _END = [4, 10, 11, 14], np.array([2, 0, 0, 2], '<u4'), struct.pack('<II', 2, 0)
_NUMBERS, _STAMP = struct.Struct('<II'), struct.Struct('<iI')


@dataclass(slots=True)
class JointTrack:
    """As trajectory_msgs/JointTrajectory, of two joints, each point with both velocities.

    To read, and to publish where a node's `publisher` does it.

    Attributes
    ----------
    points : ndarray, shape (n,)
        With the fields ``positions``, ``velocities``, ``sec`` and ``nanosec``.
    """

    header: Header
    joint_names: tuple
    points: np.ndarray


def joint_track(ns, times, positions, velocities, names, frame=''):
    """As `convert.trajectory`, quicker to make and to send.

    Returns
    -------
    JointTrack
    """
    points = np.zeros(len(times), _POINT)
    nanoseconds = np.rint(np.asarray(times, float) * 1e9).astype(np.int64)
    points['sec'], points['nanosec'] = np.divmod(nanoseconds, 1_000_000_000)
    points['positions'], points['velocities'] = positions, velocities
    points['velocity_count'] = points['next_count'] = 2
    return JointTrack(header(ns, frame), tuple(names), points)


class TrackReader:
    """Reads the messages of one topic."""

    def __init__(self):
        self._same, self._at, self._begin, self._frame, self._names = b'', 0, 0, '', ()

    def read(self, data):
        """The message of `data`, bytes as they came.

        Returns
        -------
        JointTrack or trajectory_msgs.msg.JointTrajectory

        Raises
        ------
        ValueError
            The bytes are no JointTrajectory.
        """
        if (self._same and len(data) > self._begin and data[:4] == ENCAPSULATION
                and data[BEGIN:BEGIN + len(self._same)] == self._same):
            count, two = _NUMBERS.unpack_from(data, self._at)
            end = self._begin + count * _POINT.itemsize - len(_END)
            if count and two == 2 and end <= len(data):  # rclpy may leave some bytes at the end
                rest = data[self._begin:end] + _END
                if (np.frombuffer(rest, '<u4').reshape(count, -1)[:, _COUNTS] == _WANTED).all():
                    return JointTrack(
                        Header(Stamp(*_STAMP.unpack_from(data, 4)), self._frame), self._names,
                        np.frombuffer(rest, _POINT))
        return self._anew(data)

    def _anew(self, data):
        from trajectory_msgs.msg import JointTrajectory
        message = decoded(data, JointTrajectory)
        self._frame, self._names = message.header.frame_id, tuple(message.joint_names)
        same, self._at, self._begin = _laid_out(self._frame, self._names)
        # rclpy leaves what it likes between two names
        self._same = data[BEGIN:BEGIN + len(same)] if len(self._names) == 2 else b''
        return message


class TrackWriter:
    """Writes the messages of one topic."""

    def __init__(self):
        self._of, self._same, self._at, self._begin = None, b'', 0, 0

    def write(self, message):
        """The bytes of a `JointTrack`, those that rclpy would send, gaps are 0; others as is."""
        if not isinstance(message, JointTrack):
            return message
        of = message.header.frame_id, message.joint_names
        if of != self._of:
            self._of, (self._same, self._at, self._begin) = of, _laid_out(*of)
        count = len(message.points)
        head = stamped(message.header.stamp) + self._same
        head += bytes(self._at - len(head)) + _NUMBERS.pack(count, 2)
        if not count:
            return head[:-4]
        return head + bytes(self._begin - len(head)) + message.points.tobytes()[:-len(_END)]


def _laid_out(frame, names):
    """What stays the same, where the count of points is, and where the first angle begins."""
    same = frame_and_names(frame, names)
    at = aligned(BEGIN + len(same), 4)
    return same, at, aligned(at + 8, 8)
