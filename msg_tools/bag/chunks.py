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

"""An MCAP file being written: each chunk is written to the disk at once, with its index."""

import os
import struct
import sys
import time
import zlib
from array import array

from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from .compression import COMPRESSORS, DEFAULT_COMPRESSION

MAGIC = b'\x89MCAP0\r\n'
CHUNK_SIZE = 2**20  # bytes before compression
NEVER = 2**63 - 1  # what rosbag2 writes as the starting time of an empty bag

_MESSAGE = struct.Struct('<BQHIQQ').pack
_OP_MESSAGE = int(Opcode.MESSAGE)


def _bytes(record):
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


class McapFile:
    """Writes schemas and channels outside chunks, so that a damaged chunk does not affect them.

    Parameters
    ----------
    path : Path
        Must not exist.
    library : str
        Writing library, for the header.
    chunk_size : int
        Bytes (before compression) after which a chunk is closed.
    compression : str
        One of `compression.COMPRESSORS`.

    Attributes
    ----------
    size : int
        Bytes of complete records written so far.
    pending : int
        Bytes of the chunk that has not been written yet.
    counts : dict of int to int
        Number of messages by channel.
    first, last : int
        Log times, ns; `NEVER` and 0 without messages.

    Notes
    -----
    After an OSError the file is truncated to the last complete record.
    """

    def __init__(self, path, library, *, chunk_size=CHUNK_SIZE, compression=DEFAULT_COMPRESSION):
        self._stream = open(path, 'xb', buffering=0)  # noqa: SIM115 (lives as long as the file)
        self._compress = COMPRESSORS[compression]
        self._compression = '' if compression == 'none' else compression
        self._chunk_size = int(chunk_size)
        self.size = self.pending = 0
        self.first, self.last = NEVER, 0
        self.counts = {}
        self._schemas, self._channels = [], []
        self._chunks, self._attachments, self._metadata = [], [], []
        self._parts, self._index = [], {}
        self._chunk_first, self._chunk_last = NEVER, 0
        self._write(MAGIC + _bytes(records.Header('ros2', library)))

    @property
    def closed(self):
        """Whether the file is closed, finished or not."""
        return self._stream.closed

    def _write(self, data):
        view = memoryview(data)
        try:
            while view:  # a full disk writes a part before it fails
                view = view[self._stream.write(view):]
        except OSError as error:
            self._stream.truncate(self.size)
            self._stream.seek(self.size)
            error.filename = str(self._stream.name)
            raise
        self.size += len(data)

    def add_schema(self, name, data, encoding='ros2msg'):
        """Write a schema; return its number."""
        number = len(self._schemas) + 1
        record = _bytes(records.Schema(id=number, name=name, encoding=encoding, data=data))
        self._write(record)
        self._schemas.append(record)
        return number

    def add_channel(self, topic, schema, metadata):
        """Write a channel; return its number."""
        number = len(self._channels) + 1
        record = _bytes(records.Channel(
            id=number, schema_id=schema, topic=topic, message_encoding='cdr', metadata=metadata))
        self._write(record)
        self._channels.append(record)
        self._index[number] = array('Q')
        self.counts[number] = 0
        return number

    def add(self, channel, data, log_time, publish_time, sequence):
        """Append a message to the chunk; times in ns since 1970."""
        size = len(data)
        self._index[channel].extend((log_time, self.pending))
        self._parts.append(
            _MESSAGE(_OP_MESSAGE, size + 22, channel, sequence, log_time, publish_time))
        self._parts.append(data)
        self.pending += size + 31
        if log_time < self._chunk_first:
            self._chunk_first = log_time
        if log_time > self._chunk_last:
            self._chunk_last = log_time
        if self.pending > self._chunk_size:
            self.close_chunk()

    def close_chunk(self):
        """Write the pending chunk with its index, if there is one."""
        if not self.pending:
            return
        raw = b''.join(self._parts)
        data = self._compress(raw)
        first, last = self._chunk_first, self._chunk_last
        chunk = _bytes(records.Chunk(
            message_start_time=first, message_end_time=last, uncompressed_size=len(raw),
            uncompressed_crc=zlib.crc32(raw), compression=self._compression, data=data))
        out, end, offsets = [chunk], self.size + len(chunk), {}
        for channel, rows in self._index.items():
            if rows:
                if sys.byteorder == 'big':
                    rows.byteswap()
                out.append(struct.pack('<BQHI', Opcode.MESSAGE_INDEX, 6 + 8 * len(rows), channel,
                                       8 * len(rows)) + rows.tobytes())
                offsets[channel] = end
                end += len(out[-1])
        index = _bytes(records.ChunkIndex(
            message_start_time=first, message_end_time=last, chunk_start_offset=self.size,
            chunk_length=len(chunk), message_index_offsets=offsets,
            message_index_length=end - self.size - len(chunk), compression=self._compression,
            compressed_size=len(data), uncompressed_size=len(raw)))
        counts = {channel: len(rows) // 2 for channel, rows in self._index.items() if rows}
        # drop this chunk even if the disk fails now
        self._parts, self.pending = [], 0
        self._chunk_first, self._chunk_last = NEVER, 0
        for channel in counts:
            self._index[channel] = array('Q')
        self._write(b''.join(out))
        self._chunks.append(index)
        self.first, self.last = min(self.first, first), max(self.last, last)
        for channel, count in counts.items():
            self.counts[channel] += count

    def add_metadata(self, name, data):
        """Write an MCAP metadata record of str to str."""
        record = _bytes(records.Metadata(name, data))
        index = records.MetadataIndex(offset=self.size, length=len(record), name=name)
        self._write(record)
        self._metadata.append(_bytes(index))

    def add_attachment(self, name, media_type, data):
        """Write an attachment, dated now."""
        about = dict.fromkeys(('log_time', 'create_time'), time.time_ns())
        about |= {'name': name, 'media_type': media_type}
        record = _bytes(records.Attachment(data=data, **about))
        index = records.AttachmentIndex(
            offset=self.size, length=len(record), data_size=len(data), **about)
        self._write(record)
        self._attachments.append(_bytes(index))

    def sync(self):
        """Wait until all written data are on the disk."""
        os.fsync(self._stream.fileno())

    def duplicate(self):
        """A duplicate file descriptor for syncing in another thread; the caller closes it."""
        return os.dup(self._stream.fileno())

    def finish(self):
        """Write the last chunk, the summary and the footer, and close the file."""
        self.close_chunk()
        end = _bytes(records.DataEnd(0))
        start = self.size + len(end)
        statistics = _bytes(records.Statistics(
            message_count=sum(self.counts.values()), schema_count=len(self._schemas),
            channel_count=len(self._channels), attachment_count=len(self._attachments),
            metadata_count=len(self._metadata), chunk_count=len(self._chunks),
            message_start_time=self.first if self.last or self._chunks else 0,
            message_end_time=self.last,
            channel_message_counts={id_: n for id_, n in self.counts.items() if n}))
        summary, offsets = b'', b''
        for opcode, group in (
                (Opcode.SCHEMA, self._schemas), (Opcode.CHANNEL, self._channels),
                (Opcode.STATISTICS, [statistics]), (Opcode.CHUNK_INDEX, self._chunks),
                (Opcode.ATTACHMENT_INDEX, self._attachments),
                (Opcode.METADATA_INDEX, self._metadata)):
            if group:
                joined = b''.join(group)
                offsets += _bytes(records.SummaryOffset(
                    opcode, start + len(summary), len(joined)))
                summary += joined
        footer = _bytes(records.Footer(start, start + len(summary), 0))[:-4]
        crc = zlib.crc32(footer, zlib.crc32(summary + offsets))
        self._write(b''.join((end, summary, offsets, footer, struct.pack('<I', crc), MAGIC)))
        self.sync()
        self.close()

    def close(self):
        """Close the file without finishing it."""
        self._stream.close()
