"""PointCloud2 of a table to its bytes: of one row after the other only numbers change."""

import struct
from dataclasses import dataclass

from .cdr import Header, stamped, text_after

#: type of the messages
POINT_CLOUD = 'sensor_msgs/msg/PointCloud2'


@dataclass(slots=True)
class Cloud:
    """As sensor_msgs/PointCloud2, dense and of one line, to publish by a node's `publisher`.

    Attributes
    ----------
    fields : tuple of (str, int, int)
        Name, offset and type of each; each of one number.
    width, point_step : int
        Points, and bytes of each.
    data : bytes
    """

    header: Header
    fields: tuple
    width: int
    point_step: int
    data: bytes


class CloudWriter:
    """Writes the messages of one topic."""

    def __init__(self):
        self._of, self._parts = None, ()

    def write(self, message):
        """The bytes of a `Cloud`, those that rclpy would send, gaps are 0; others as is."""
        if not isinstance(message, Cloud):
            return message
        of = message.header.frame_id, message.fields, message.point_step
        if of != self._of:
            self._of, self._parts = of, _laid_out(*of)
        before, after = self._parts
        size = len(message.data)
        return b''.join((stamped(message.header.stamp), before, struct.pack('<I', message.width),
                         after, struct.pack('<II', size, size), message.data, b'\1'))


def _laid_out(frame, fields, step):
    """What stays the same before and after the width."""
    before = text_after(b'', frame)
    before += bytes(-len(before) % 4) + struct.pack('<I', 1)  # the height
    after = struct.pack('<I', len(fields))
    for name, offset, datatype in fields:
        after = text_after(after, name)
        after += bytes(-len(after) % 4) + struct.pack('<IB3xI', offset, datatype, 1)
    return before, after + struct.pack('<B3xI', 0, step)
