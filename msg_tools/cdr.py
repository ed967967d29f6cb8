"""What messages look like as bytes: CDR of a little-endian machine, version 1."""

import struct

#: what each message begins with
ENCAPSULATION = b'\x00\x01\x00\x00'
#: encapsulation and stamp: what a header begins with
BEGIN = 12
_STAMPED = struct.Struct('<4siI')


def stamped(stamp):
    """The first `BEGIN` bytes of a message that begins with a header."""
    return _STAMPED.pack(ENCAPSULATION, stamp.sec, stamp.nanosec)


def aligned(at, size):
    """Where the next number of so many bytes (4 or 8) begins, from position `at` on."""
    return at + -(at - len(ENCAPSULATION)) % size


def text_after(data, text):
    """`data`, bytes from a multiple of 4 on, and a string after them."""
    coded = text.encode()
    return data + bytes(-len(data) % 4) + struct.pack('<I', len(coded) + 1) + coded + b'\0'


def frame_and_names(frame, names):
    """From `BEGIN` on: the ``frame_id`` of a header, and a sequence of strings."""
    data = text_after(b'', frame)
    data += bytes(-len(data) % 4) + struct.pack('<I', len(names))
    for name in names:
        data = text_after(data, name)
    return data
