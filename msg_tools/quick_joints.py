"""JointState from and to its bytes: of a thousand messages a second only times and numbers change.

rclpy makes a message of eight objects, and of every name a string; here the part that stays the
same (frame and names) is compared as bytes, and the rest is one `struct.unpack`, or `pack`. What is
laid out otherwise than the message before goes the usual way.
"""

import struct
from dataclasses import dataclass

from .cdr import (
    BEGIN,
    ENCAPSULATION,
    Header,
    Stamp,
    aligned,
    decoded,
    parts_of_frame_and_names,
)

#: type of the messages
JOINT_STATE = 'sensor_msgs/msg/JointState'


@dataclass(slots=True)
class Joints:
    """As sensor_msgs/JointState: to read, and to publish where a node's `publisher` does it."""

    header: Header
    name: tuple
    position: tuple
    velocity: tuple
    effort: tuple


class JointReader:
    """Reads the messages of one topic."""

    def __init__(self):
        self._size, self._layout, self._same, self._counts = -1, None, (), ()
        self._frame, self._names, self._parts = '', (), ()

    def read(self, data):
        """The message of `data`, bytes as they came.

        Returns
        -------
        Joints or sensor_msgs.msg.JointState

        Raises
        ------
        ValueError
            The bytes are no JointState.
        """
        if len(data) == self._size:
            all_of_it = self._layout.unpack(data)
            a, b, c, d = self._parts
            if (all_of_it[3:a] == self._same and all_of_it[0] == ENCAPSULATION
                    and (all_of_it[a], all_of_it[b], all_of_it[c]) == self._counts):
                return Joints(Header(Stamp(*all_of_it[1:3]), self._frame), self._names,
                              all_of_it[a + 1:b], all_of_it[b + 1:c], all_of_it[c + 1:d])
        return self._anew(data)

    def _anew(self, data):
        from sensor_msgs.msg import JointState
        message = decoded(data, JointState)
        self._learn(data, message)
        return message

    def _learn(self, data, message):
        counts = tuple(
            len(values) for values in (message.position, message.velocity, message.effort))
        frame, names = message.header.frame_id, tuple(message.name)
        layout, same = _laid_out(frame, names, counts)
        if layout.size != len(data):
            return
        self._size, self._layout, self._counts = layout.size, layout, counts
        self._same = tuple(same)
        parts = [3 + len(same)]
        for count in counts:
            parts.append(parts[-1] + count + 1)
        self._parts = tuple(parts)
        self._frame, self._names = frame, names


class JointWriter:
    """Writes the messages of one topic, of either kind."""

    def __init__(self):
        self._of, self._layout, self._same = None, None, []

    def write(self, message):
        """The bytes of a `Joints` or JointState: those that rclpy would send, gaps are 0."""
        header, counts = message.header, (
            len(message.position), len(message.velocity), len(message.effort))
        of = header.frame_id, message.name, counts
        if of != self._of:
            self._layout, self._same = _laid_out(*of)
            self._of = header.frame_id, message.name[:], counts
        return self._layout.pack(
            ENCAPSULATION, header.stamp.sec, header.stamp.nanosec, *self._same,
            counts[0], *message.position, counts[1], *message.velocity,
            counts[2], *message.effort)


def _laid_out(frame, names, counts):
    """Layout of messages with so many numbers of each kind, and what stays the same in them."""
    same = parts_of_frame_and_names(frame, names)
    layout, at = '<4siI', BEGIN
    for part in same:
        before, at = at, aligned(at, 4)
        layout, at = f'{layout}{at - before}x{len(part)}s', at + len(part)
    for count in counts:
        before, at = at, aligned(at, 4)
        layout, at = f'{layout}{at - before}xI', at + 4
        if count:
            before, at = at, aligned(at, 8)
            layout, at = f'{layout}{at - before}x{count}d', at + 8 * count
    return struct.Struct(layout), same
