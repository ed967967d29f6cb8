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

"""Maliciously crafted logs, for `log_fuzz.py`."""

import json
import struct
import zlib

import lz4.frame
import zstandard

MAGIC = b'\x89MCAP0\r\n'
DEFINITION = b"""int32 id
string name
float64[] values
Inner[<=5] inner
================================================================================
MSG: odd_msgs/Inner
uint8[3] raw
"""
QOS = '- {history: keep_last, depth: 5, durability: transient_local}'


def odd_message(i):
    """Bytes of the type above."""
    return (b'\0\1\0\0' + struct.pack('<iI', i, 3) + b'ab\0\0' + struct.pack('<I', 2)
            + struct.pack('<4x2dI', 0.5, 0.25, 1) + b'abc')


def record(opcode, body, length=None):
    """A record; `length` may be wrong."""
    return struct.pack('<BQ', opcode, len(body) if length is None else length) + body


def text(data):
    """A string with its length."""
    data = data if isinstance(data, bytes) else data.encode()
    return struct.pack('<I', len(data)) + data


def chunk(raw, compression, data, claimed=None, times=(0, 10)):
    """A chunk of `data` with a claimed uncompressed size of `claimed` bytes."""
    size = len(raw) if claimed is None else claimed
    return record(6, struct.pack('<QQQI', *times, size, 0) + text(compression)
                  + struct.pack('<Q', len(data)) + data)


def schema(number=1, definition=DEFINITION, name='odd_msgs/msg/Odd'):
    """A schema record."""
    return record(3, struct.pack('<H', number) + text(name) + text('ros2msg') + text(definition))


def channel(number=1, of=1, topic='/a', qos=''):
    """A channel record."""
    metadata = text('offered_qos_profiles') + text(qos)
    return record(4, struct.pack('<HH', number, of) + text(topic) + text('cdr') + text(metadata))


def a_message(data, number=1, when=5):
    """A message record."""
    return record(5, struct.pack('<HIQQ', number, 0, when, when) + data)


def whole(*records):
    """A file of these records."""
    return MAGIC + record(1, text('ros2') + text('x')) + b''.join(records)


def summed(body, summary):
    """A file with a summary whose checksum is right."""
    data = body + record(15, bytes(4))
    footer = struct.pack('<BQQQ', 2, 20, len(data), 0)
    return data + summary + footer + struct.pack(
        '<I', zlib.crc32(footer, zlib.crc32(summary))) + MAGIC


def crafted(scale=1):
    """Name and content of each; bombs and crowds are `scale` times smaller."""
    zeros = bytes(2**26 // scale)
    zstd, lz = zstandard.ZstdCompressor().compress(zeros), lz4.frame.compress(zeros)
    head = schema() + channel()
    yield from _bombs(zeros, zstd, lz, head, scale)
    yield from _counts(head, scale)
    yield from _lies(head)


def _bombs(zeros, zstd, lz, head, scale):
    for name, data in (('zstd', zstd), ('lz4', lz)):
        yield f'bomb {name}', whole(head, chunk(zeros, name, data))
        # as many as make 2 MB: the time that a file may take grows with its size
        yield f'bombs {name}', whole(head, chunk(zeros, name, data) * (
            min(200, 2_000_000 // len(data)) // scale))
        yield f'bomb {name} beyond belief', whole(head, chunk(b'', name, data, 2**40))
        yield f'bomb {name} that is smaller than said', whole(
            head, chunk(b'', name, data[:500], 2**27))
    small = a_message(b'') * (2_000_000 // scale)
    packed = zstandard.ZstdCompressor().compress(small)
    yield 'two million empty messages', whole(head, chunk(small, 'zstd', packed))
    records = record(99, b'') * (5_000_000 // scale)
    yield 'five million empty records', whole(head, chunk(
        records, 'zstd', zstandard.ZstdCompressor().compress(records)))
    # the header of a frame says how much memory it wants: 2 GB
    yield 'a large window', whole(head, chunk(
        b'x', 'zstd', b'\x28\xb5\x2f\xfd\x00\xa8\x09\0\0x', 2**27))
    one = chunk(b'', 'zstd', zstd, 2**26)
    offset = len(whole(head))
    index = record(8, struct.pack('<QQQQI', 0, 10, offset, len(one), 0) + struct.pack('<Q', 0)
                   + text('zstd') + struct.pack('<QQ', len(zstd), 2**26))
    statistics = record(11, struct.pack('<QHIIIIQQI', 1, 1, 1, 0, 0, 1, 0, 10, 0))
    yield 'an index that names a chunk often', summed(
        whole(head, one), schema() + channel() + statistics + index * (10_000 // scale))
    later = b''.join(
        record(8, struct.pack('<QQQQI', 0, 10, offset + i * len(one), len(one), 0) + struct.pack(
            '<Q', 0) + text('zstd') + struct.pack('<QQ', len(zstd), 2**26)) for i in range(40))
    yield 'many large chunks at one time', summed(
        whole(head, one * 40), schema() + channel() + statistics + later)


def _counts(head, scale):
    huge = struct.pack('<I', 2**32 - 1)
    for name, body in (
            ('schema', (3, b'\1\0' + huge)), ('channel', (4, b'\1\0\1\0' + huge)),
            ('metadata', (12, text('x') + huge)), ('statistics', (11, bytes(42) + huge)),
            ('chunk index', (8, bytes(32) + huge)), ('attachment', (9, bytes(16) + huge)),
            ('chunk', (6, bytes(28) + huge))):
        yield f'{name} with a huge length', whole(head, record(*body))
        yield f'{name} with a huge length in the summary', summed(whole(head), record(*body))
    for length in (2**63, 2**64 - 1, 2**40, 10**9):
        yield f'a record of {length} bytes', whole(head, record(5, bytes(30), length))
    many = b''.join(schema(i, b'int32 x\n') + channel(i, i) for i in range(1, 65536 // scale))
    yield 'all channels there can be', whole(many, chunk(
        a_message(odd_message(1)), '', a_message(odd_message(1))))
    yield 'a string without end', whole(schema(definition=b'int32 x' * 2**20), channel(), chunk(
        b'', '', b''), a_message(odd_message(1)))
    yield 'a topic of a megabyte', whole(schema(), channel(topic='/' + 'x' * 2**20))
    yield 'chunks without content', whole(head, chunk(b'', '', b'') * (50_000 // scale))
    yield 'metadata without end', whole(head, record(12, text('x') + text(b'')) * (50_000 // scale))


def _lies(head):
    yield 'times at the end', whole(head, *(a_message(odd_message(1), when=2**64 - 1 - i)
                                            for i in range(3)))
    yield 'a chunk in a chunk', whole(head, chunk(*[chunk(b'', '', b'x' * 50)] * 1 + [''], b'x'))
    yield 'deep YAML', whole(schema(), channel(qos='[' * 60_000))
    yield 'deep YAML in blocks', whole(schema(), channel(qos='- ' * 30_000))
    laughs = 'a: &a [x, x, x, x, x, x, x, x]\n' + ''.join(
        f'{c}: &{c} [{", ".join([f"*{b}"] * 8)}]\n' for b, c in zip('abcdefgh', 'bcdefghi'))
    yield 'a billion laughs', whole(schema(), channel(qos=laughs))
    for name, definition in (
            ('nothing four billion times', b'Empty[4000000000] x\n' + b'=' * 80
             + b'\nMSG: odd_msgs/Empty\n'),
            ('nothing as often as the message says', b'Empty[] x\n' + b'=' * 80
             + b'\nMSG: odd_msgs/Empty\n'),
            ('constants only', b'C[] x\n' + b'=' * 80 + b'\nMSG: odd_msgs/C\nint32 A=1\n'),
            ('itself', b'odd_msgs/Odd x\n'), ('many of itself', b'odd_msgs/Odd[] x\n'),
            ('four billion numbers', b'float64[4000000000] x\n'),
            ('no text', bytes(range(256))), ('endless words', b'a ' * 100_000),
            ('many lines', b'int32 x\n' * 30_000)):
        data = b'\0\1\0\0' + b'\xff' * 2000
        yield f'a type of {name}', whole(
            schema(definition=definition), channel(), a_message(data), a_message(b''))
    for name in ('../up', '/tmp/abs', 'a/../../b', '..', 'nul\0', 'C:\\x', ''):
        body = bytes(16) + text(name) + text('t') + struct.pack('<Q', 4) + b'evil' + bytes(4)
        yield f'attachment {name!r}', whole(head, record(9, body))
    yield 'an attachment larger than its record', whole(
        head, record(9, bytes(16) + text('a') + text('t') + struct.pack('<Q', 2**62)))
    for value in ('9' * 5000, '-1', 'x', ''):
        yield f'{value[:5]} repeated messages', whole(head, record(
            12, text('telescope_mount_repeated') + text(text('/a') + text(value))))
    deep = json.dumps({'a': 1})[:-1] + ', "b": ' + '[' * 100_000
    yield 'deep JSON of parameters', whole(
        head, record(12, text('parameters /x') + text(text('n') + text(deep))))


def metadata_files(scale=1):
    """Hostile ``metadata.yaml`` beside a sound file; crowds are `scale` times smaller."""
    prefix = 'rosbag2_bagfile_information:\n  relative_file_paths:\n'
    yield 'deep', '[' * 10**6
    yield 'deep blocks', '- ' * 10**6
    yield 'other folders', prefix + '    - ../../../etc/passwd\n    - /etc/passwd\n'
    yield 'many files', prefix + '    - x.mcap\n' * (150_000 // scale)
    yield 'large', 'a: b\n' * 10**6
    yield 'no text', '\0\1\2'
