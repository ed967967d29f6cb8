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

"""Text of files as archives of orbits keep them: plain, gzip, or compress (.Z)."""

import gzip
import zlib
from pathlib import Path

_GZIP, _COMPRESS = b'\x1f\x8b', b'\x1f\x9d'
_BLOCK, _CLEAR, _MAGIC = 0x80, 256, 3
#: bytes: more is no orbit
_MOST = 400_000_000


def read_text(path):
    """Lines of a file, whatever it is compressed with, by its first bytes.

    Raises
    ------
    ValueError
        It is cut or damaged.
    OSError
        It cannot be read.
    """
    data = Path(path).read_bytes()
    try:
        if data.startswith(_GZIP):
            data = gzip.decompress(data)
        elif data.startswith(_COMPRESS):
            data = _uncompressed(data)
    except (EOFError, zlib.error, gzip.BadGzipFile, IndexError) as error:
        raise ValueError(f'{path}: the compressed file is cut or damaged ({error}); '
                         'fetch it again') from None
    return data.decode('ascii', 'replace').splitlines()


def _uncompressed(data):
    """Of LZW as ``compress`` writes it: codes of 9 bits and more, in groups of eight."""
    flags = data[2]
    most, block = flags & 0x1f, bool(flags & _BLOCK)
    table = [bytes([i]) for i in range(256)] + ([b''] if block else [])
    width, out, size, before, at, bits = 9, [], 0, None, 8 * _MAGIC, 8 * len(data)
    start = at
    while at + width <= bits:
        first = at >> 3
        code = int.from_bytes(data[first:first + 4], 'little') >> (at & 7) & (1 << width) - 1
        at += width
        if block and code == _CLEAR:
            # codes of one width fill whole groups of eight
            at, table, before = _group_end(start, at, width), table[:257], None
            width, start = 9, at
            continue
        if before is None:
            word = table[code]
        else:
            word = table[code] if code < len(table) else before + before[:1]
            if len(table) < 1 << most:
                table.append(before + word[:1])
                if len(table) == 1 << width and width < most:
                    at = _group_end(start, at, width)
                    width, start = width + 1, at
        out.append(word)
        size += len(word)
        if size > _MOST:
            raise EOFError('more than 400 MB')
        before = word
    return b''.join(out)


def _group_end(start, at, width):
    group = 8 * width
    return start + -(-(at - start) // group) * group
