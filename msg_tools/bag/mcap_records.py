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

"""Finds, parses and unpacks MCAP records; safe for damaged or hostile files."""

import struct
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError

PARSE_ERRORS = (
    struct.error, McapError, ValueError, KeyError, IndexError, EOFError, MemoryError,
    OverflowError,
)


def short(error):
    """First line of an exception."""
    text = str(error) or type(error).__name__
    return text.splitlines()[0][:120]


def walk(buffer, most=2**62):
    """(opcode, start of the body, end) of every complete record in `buffer`.

    Raises
    ------
    ValueError
        There are more than `most`.
    """
    pos, size = 0, len(buffer)
    unpack = struct.Struct('<Q').unpack_from
    while pos + 9 <= size and buffer[pos]:  # opcode 0 is invalid
        end = pos + 9 + unpack(buffer, pos + 1)[0]
        if end > size:
            return
        if most <= 0:
            raise ValueError('more records than a file of this size can hold')
        most -= 1
        yield buffer[pos], pos + 9, end
        pos = end


def read_at(stream, offset, length):
    """`length` bytes at `offset`, or fewer at the end."""
    stream.seek(offset)
    return stream.read(length)


def parse(record, body):
    return record.read(ReadDataStream(BytesIO(body)))


def unpack_chunk(body):
    """Size, crc, compression, data and their length, of a (possibly truncated) chunk record."""
    size, crc, n = struct.unpack_from('<QII', body, 16)
    compression = bytes(body[32:32 + n]).decode()
    (length,) = struct.unpack_from('<Q', body, 32 + n)
    return size, crc, compression, body[40 + n:40 + n + length], length


def index_record(body):
    """Channel and log times of a message index record; ValueError if it is invalid."""
    channel, n = struct.unpack_from('<HI', body)
    if n != len(body) - 6 or n % 16:
        raise ValueError('message index with half an entry')
    return channel, [row[0] for row in struct.iter_unpack('<QQ', body[6:])]


def chunk_index(body):
    """Start, end, offset, length, channels and uncompressed size of a chunk index record."""
    start, end, offset, length, n = struct.unpack_from('<QQQQI', body)
    if n % 10:
        raise ValueError('chunk index with half an entry')
    channels = frozenset(row[0] for row in struct.iter_unpack('<HQ', body[36:36 + n]))
    (name,) = struct.unpack_from('<I', body, 44 + n)
    _, size = struct.unpack_from('<QQ', body, 48 + n + name)
    return start, end, offset, length, channels, size
