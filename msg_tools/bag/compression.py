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

"""Compression of the chunks of a log; decompression is safe for damaged or hostile files."""

import re
import struct
import zlib

import lz4.frame
import zstandard

#: by the parameter's value; 'none' is '' in the file
COMPRESSORS = {'zstd': zstandard.ZstdCompressor(level=1).compress, 'lz4': lz4.frame.compress,
               'none': bytes}
DEFAULT_COMPRESSION = 'zstd'
#: first bytes of zstd data, which no ROS message has, and ending of packed files: rosbag2 options
PACKED, PACKED_FILE = b'\x28\xb5\x2f\xfd', '.zstd'
#: largest plausible size of a chunk (the usual size is 1 MiB)
MAX_CHUNK = 128 * 2**20
#: a chunk record with a known compression, or with two equal sizes; the length is below 2**40
CHUNK_HEAD = re.compile(
    rb'\x06.{5}\0\0\0(?=.{16}(.{5}\0\0\0).{4}'
    rb'(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0\1))', re.DOTALL)


def decompress(data, compression, size):
    """At most `size` bytes of decompressed `data`; fewer if it was cut off."""
    if size > MAX_CHUNK:
        raise ValueError(f'a chunk claims {size} bytes, more than {MAX_CHUNK}')
    if compression == '':
        return bytes(data[:size])
    try:
        if compression == 'zstd':
            decompressor = zstandard.ZstdDecompressor(max_window_size=2**27)
            with decompressor.stream_reader(data) as stream:
                return stream.read(size)
        if compression == 'lz4':
            return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise ValueError(f'{compression} data damaged: {error}') from None
    raise ValueError(f'chunk compression {compression!r} is unknown')


def by_checksum(body, most):
    """Records in a chunk with a damaged head, if its checksum is correct; else None.

    Parameters
    ----------
    body : bytes
        Complete body of the chunk record.
    most : int
        Largest uncompressed size.

    Returns
    -------
    bytes or None
    """
    (crc,) = struct.unpack_from('<I', body, 24)
    for name in ('zstd', 'lz4', '') if crc else ():
        data = body[40 + len(name):]
        try:
            size = zstandard.frame_content_size(data) if name == 'zstd' else most
            buffer = decompress(data, name, min(size, most) if size > 0 else most)
        except (ValueError, MemoryError, zstandard.ZstdError):
            continue
        if zlib.crc32(buffer) == crc:
            return buffer
    return None
