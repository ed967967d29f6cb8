"""JointState from its bytes: of a thousand messages a second only times and numbers change.

rclpy makes a message of eight objects, and of every name a string; here the part that stays the
same (frame and names) is compared as bytes, and the rest is one `struct.unpack`. What is laid out
otherwise than the message before goes the usual way.
"""

import struct
from dataclasses import dataclass

#: type of the messages
JOINT_STATE = 'sensor_msgs/msg/JointState'
#: what a message in CDR of a little-endian machine begins with
_ENCAPSULATION = b'\x00\x01\x00\x00'
_BEGIN = 12  # of what stays the same: after encapsulation and stamp


@dataclass(slots=True)
class Stamp:
    """As builtin_interfaces/Time."""

    sec: int
    nanosec: int


@dataclass(slots=True)
class Header:
    """As std_msgs/Header."""

    stamp: Stamp
    frame_id: str


@dataclass(slots=True)
class Joints:
    """As sensor_msgs/JointState, to read."""

    header: Header
    name: tuple
    position: tuple
    velocity: tuple
    effort: tuple


class JointReader:
    """Reads the messages of one topic."""

    def __init__(self):
        self._size, self._layout, self._same, self._counts = -1, None, b'', ()
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
            encapsulation, sec, nanosec, same, *rest = self._layout.unpack(data)
            a, b, c = self._parts
            if (same == self._same and encapsulation == _ENCAPSULATION
                    and (rest[0], rest[a], rest[b]) == self._counts):
                return Joints(Header(Stamp(sec, nanosec), self._frame), self._names,
                              tuple(rest[1:a]), tuple(rest[a + 1:b]), tuple(rest[b + 1:c]))
        return self._anew(data)

    def _anew(self, data):
        from rclpy.serialization import deserialize_message
        from sensor_msgs.msg import JointState
        try:
            message = deserialize_message(data, JointState)
        except Exception as err:
            reason = [*str(err).splitlines(), type(err).__name__][0]
            raise ValueError(f'no JointState: {reason}') from None
        self._learn(data, message)
        return message

    def _learn(self, data, message):
        end = _BEGIN
        for text in (message.header.frame_id, None, *message.name):
            end = -(-end // 4) * 4 + 4 + (0 if text is None else len(text.encode()) + 1)
        layout, at = f'<4siI{end - _BEGIN}s', end
        for values in (message.position, message.velocity, message.effort):
            before = -at % 4
            layout, at = f'{layout}{before}xI', at + before + 4
            if values:
                before = -(at - len(_ENCAPSULATION)) % 8
                layout, at = f'{layout}{before}x{len(values)}d', at + before + 8 * len(values)
        if at != len(data):
            return
        self._size, self._layout, self._same = at, struct.Struct(layout), data[_BEGIN:end]
        self._counts = tuple(
            len(values) for values in (message.position, message.velocity, message.effort))
        first, second, third = self._counts
        self._parts = first + 1, first + second + 2, first + second + third + 3
        self._frame, self._names = message.header.frame_id, tuple(message.name)
