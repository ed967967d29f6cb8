"""What messages look like as bytes: CDR of a little-endian machine, version 1.

`quick_joints`, `quick_tracks` and `quick_clouds` stand on it.
"""

import struct
from dataclasses import dataclass

#: what each message begins with
ENCAPSULATION = b'\x00\x01\x00\x00'
#: encapsulation and stamp: what a header begins with
BEGIN = 12
_STAMPED = struct.Struct('<4siI')


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


def header(ns, frame):
    """That of a message of `ns` nanoseconds since 1970."""
    return Header(Stamp(int(ns // 1_000_000_000), int(ns % 1_000_000_000)), frame)


def decoded(data, kind):
    """The message of rclpy's class `kind` that bytes are; ValueError says why they are none."""
    from rclpy.serialization import deserialize_message
    try:
        return deserialize_message(data, kind)
    except Exception as err:
        reason = [*str(err).splitlines(), type(err).__name__][0]
        raise ValueError(f'no {kind.__name__}: {reason}') from None


def stamped(stamp):
    """The first `BEGIN` bytes of a message that begins with a header."""
    return _STAMPED.pack(ENCAPSULATION, stamp.sec, stamp.nanosec)


def aligned(at, size):
    """Where the next number of so many bytes (4 or 8) begins, from position `at` on."""
    return at + -(at - len(ENCAPSULATION)) % size


def text_after(data, text):
    """`data`, bytes from a multiple of 4 on, and a string after them."""
    return data + bytes(-len(data) % 4) + _text(text)


def _text(text):
    coded = text.encode()
    return struct.pack('<I', len(coded) + 1) + coded + b'\0'


def parts_of_frame_and_names(frame, names):
    """From `BEGIN` on: the ``frame_id`` of a header, and a sequence of strings.

    Each part begins at a multiple of 4. In the gaps between them rclpy leaves what it likes.
    """
    parts = [_text(frame), *map(_text, names)]
    parts[1:2] = [struct.pack('<I', len(names)) + part for part in parts[1:2] or [b'']]
    return parts


def frame_and_names(frame, names):
    """`parts_of_frame_and_names` in one, gaps are 0."""
    data = b''
    for part in parts_of_frame_and_names(frame, names):
        data += bytes(-len(data) % 4) + part
    return data
