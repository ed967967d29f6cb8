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

"""One MCAP file of a log, read with its index or, after a crash, without."""

import struct
import zlib
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from mcap import records
from mcap.opcode import Opcode

from .chunks import MAGIC
from .compression import MAX_CHUNK, by_checksum, decompress
from .losses import Lost
from .mcap_records import (
    PARSE_ERRORS,
    chunk_index,
    parse,
    read_at,
    short,
    unpack_chunk,
    walk,
)
from .scan import LogScan, indexes_at
from .writer import REPEATED_RECORD, STOPPED_RECORD

#: a file that expands to more than this plus `EXPANSION` times its size is refused as a zip bomb
MIN_EXPANDED, EXPANSION = 256 * 2**20, 300
#: the same for a file with more records than this plus one for each byte of its size
MIN_RECORDS = 300_000
#: largest metadata record that is read
MAX_METADATA = 16 * 2**20
#: largest uncompressed size of a chunk with a damaged head, if no index gives it
MAX_MENDED = 2**24


class AttachmentInfo(NamedTuple):
    """An attachment of a bag; its data begin at `offset` of `file`."""

    name: str
    media_type: str
    size: int
    log_time: int
    file: Path
    offset: int


class Segment(NamedTuple):
    """A chunk, or consecutive messages outside chunks; sorted by first log time."""

    start: int
    order: tuple
    end: int
    file: object
    offset: int
    length: int
    chunk: bool  # whether it is a chunk record; else plain records
    partial: bool
    channels: frozenset
    expanded: int  # uncompressed size by the index, 0 if unknown


class BagFile:
    """One MCAP file: its channels, and the positions of its messages.

    Parameters
    ----------
    path : Path
    number : int
        Index among the files of the bag.
    before : BagFile, optional
        The log in the same file that ends where this one begins.

    Attributes
    ----------
    begin : int
        Start of this log in the file, to which all its offsets are relative.
    rank : int
        Number of the log within the file, from 1.
    follows : int or None
        Start of another log in the same file.
    unchecked : bool
        Whether messages without any checksum were read.
    indexed, closed : bool
        Whether it was read by its index, and whether the end of its messages was found.
    repeated : dict of str to int
        Latched messages at its start that repeat those of the previous file, by topic.
    lost : list of Lost
        Unreadable parts; with an index, damaged chunks are added when they are read.
    mended : dict of int to str
        Offsets of chunks with a correct checksum and a damaged head, and the damage.

    Raises
    ------
    ValueError
        Not an MCAP file.
    OSError
        It is not readable.
    """

    def __init__(self, path, number=0, before=None):
        self.path = path
        self.begin = 0 if before is None else before.begin + before.follows
        self.rank = 1 if before is None else before.rank + 1
        self.follows = None
        self.number = number
        self.schemas = {}
        self.channels = {}
        self.counts = Counter()
        self.segments = []
        self.metadata = []
        self.attachments = []
        self.problems = []
        self.lost = []
        self.mended = {}
        self.complete = self.indexed = self.closed = False
        self.ended = self.unchecked = False
        size = path.stat().st_size
        self.size = size - self.begin
        # over all logs in the file
        self._spent = self._expanded = 0 if before is None else before._expanded
        self._limit = MIN_EXPANDED + EXPANSION * size
        self.most = MIN_RECORDS + size if before is None else before.most
        if self.size == 0:
            raise ValueError(f'{path} is empty (0 bytes): nothing was recorded in it')
        damage = ''
        with self.open() as stream:
            self.stream = stream
            if self.at(0, 8) != MAGIC[:self.size]:
                raise ValueError(f'{path} is not an MCAP file: a log is the folder of '
                                 'a bag, or a file of it')
            try:
                self.complete = self.indexed = self.closed = self._read_summary()
            except PARSE_ERRORS as error:
                damage = self.note(f'the index is damaged ({short(error)}); the file was read '
                                   'through')
            if not self.complete:
                self._forget()
                LogScan(self).run()
            self.stream = None
        if self.follows is not None and damage:
            self.problems.remove(damage)  # it was the index of another log
        own = {record.name: record.metadata for record in self.metadata}
        self.repeated = {topic: int(count) for topic, count in own.get(REPEATED_RECORD, {}).items()
                         if count.isdecimal() and len(count) < 10}
        if STOPPED_RECORD in own:
            self.note(f'recording stopped: {own[STOPPED_RECORD].get("reason", "")[:120]}')

    def open(self):
        """Open a stream of its bytes."""
        stream = open(self.path, 'rb')  # noqa: SIM115 (the caller closes it)
        return _From(stream, self.begin) if self.begin else stream

    def note(self, text):
        """Add a problem; return its text."""
        self.problems.append(f'{self.path.name}: {text}')
        return self.problems[-1]

    def at(self, offset, length):
        """Read bytes; only while the file is being opened."""
        return read_at(self.stream, offset, length)

    # --- with the index ---------------------------------------------------------------------

    def _read_summary(self):
        """Read the summary at the end; True if it replaces a scan."""
        tail = self.at(max(self.size - 37, 0), 37)
        if len(tail) < 37 or tail[-8:] != MAGIC or tail[0] != Opcode.FOOTER:
            return False
        self.ended = True
        start, _, crc = struct.unpack_from('<QQI', tail, 9)
        if start == 0:
            return False
        if not 8 <= start <= self.size - 37:
            raise ValueError('the summary is said to lie outside the file')
        summary = self.at(start, self.size - 37 - start)
        if crc and zlib.crc32(tail[:25], zlib.crc32(summary)) != crc:
            raise ValueError('checksum of the summary does not match')
        statistics, chunks, elsewhere = None, [], []
        for opcode, begin, end in walk(summary, self.most):
            body = summary[begin:end]
            if opcode == Opcode.STATISTICS:
                statistics = parse(records.Statistics, body)
            elif opcode == Opcode.CHUNK_INDEX:
                chunks.append(chunk_index(body))
            elif opcode == Opcode.FOOTER:
                raise ValueError('two ends of a log')
            elif opcode in (Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
                elsewhere.append(struct.unpack_from('<Q', body)[0])
            else:
                self.take(opcode, body)
        if statistics is None or (statistics.message_count and not chunks):
            return False  # written without an index: that is no damage
        self._take_index(chunks)
        for channel in statistics.channel_message_counts:
            if channel not in self.channels:
                raise ValueError(f'channel {channel} is not described')
        self.counts.update(statistics.channel_message_counts)
        for offset in sorted(set(elsewhere)):
            try:
                opcode, length = struct.unpack('<BQ', self.at(offset, 9))
                if opcode not in (Opcode.METADATA, Opcode.ATTACHMENT):
                    raise ValueError('no record')
                self.take_large(opcode, offset + 9, length)
            except PARSE_ERRORS as error:
                self.note(f'the metadata or attachment at byte {self.begin + offset} is damaged '
                         f'({short(error)}) and left out')
        return True

    def _forget(self):
        """Drop the contents of a damaged index."""
        for kept in (self.schemas, self.channels, self.counts, self.segments, self.metadata,
                     self.attachments):
            kept.clear()
        self._expanded = self._spent

    def _take_index(self, chunks):
        """Make segments of the chunks; ValueError if they overlap or are implausibly large."""
        place = 8
        for start, end, offset, length, channels, size in sorted(chunks, key=lambda c: c[2]):
            if length < 9 or offset < place or offset + length > self.size:
                raise ValueError('a chunk is said to lie outside the file or in another')
            place = offset + length
            self._expanded += size
            self.segment(start, end, offset + 9, length - 9, chunk=True, channels=channels,
                          expanded=size)
        if self._expanded > self._limit:
            raise ValueError(f'its chunks are said to hold {self._expanded} bytes')

    def segment(self, start, end, offset, length, *, chunk, partial=False,
                channels=frozenset(), expanded=0):
        """Add a segment with messages."""
        self.segments.append(Segment(
            start, (self.number, len(self.segments)), end, self, offset, length, chunk, partial,
            channels, expanded))

    def take(self, opcode, body):
        """Add a schema or channel."""
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return
        (number,) = struct.unpack_from('<H', body)
        if opcode == Opcode.SCHEMA and number not in self.schemas:
            self.schemas[number] = parse(records.Schema, body)
        elif opcode == Opcode.CHANNEL and number not in self.channels:
            self.channels[number] = parse(records.Channel, body)

    def take_large(self, opcode, offset, length):
        """Add a metadata record or an attachment."""
        if offset + length > self.size:
            raise ValueError('a record is larger than it can be')
        if opcode == Opcode.METADATA:
            if length > MAX_METADATA:
                raise ValueError(f'a metadata record of {length} bytes')
            self.metadata.append(parse(records.Metadata, self.at(offset, length)))
        elif opcode == Opcode.ATTACHMENT:
            head = self.at(offset, min(length, 2**16))
            log_time, _, n = struct.unpack_from('<QQI', head)
            name = head[20:20 + n].decode()
            (m,) = struct.unpack_from('<I', head, 20 + n)
            media_type = head[24 + n:24 + n + m].decode()
            (size,) = struct.unpack_from('<Q', head, 24 + n + m)
            if 32 + n + m + size > length:
                raise ValueError(f'attachment {name!r} is longer than its record')
            self.attachments.append(AttachmentInfo(
                name, media_type, size, log_time, self.path, self.begin + offset + 32 + n + m))

    # --- messages ---------------------------------------------------------------------------

    def spend(self, size):
        """Count unpacked bytes; False once they exceed the limit of the file."""
        self._expanded += size
        return self._expanded <= self._limit

    def chunk(self, stream, offset, length, partial, expanded=0):
        """Records in the chunk at `offset`, or ValueError; `expanded`: size by the index."""
        if length > MAX_CHUNK + 2**16:
            raise ValueError(f'a chunk claims {length} bytes, more than {MAX_CHUNK}')
        body = read_at(stream, offset, length)
        try:
            return self._as_described(body, partial, expanded)
        except PARSE_ERRORS as error:
            if partial or len(body) < max(length, 40) or not (
                    self.stream is None or self.spend(MAX_MENDED // 4)):
                raise
            buffer = by_checksum(body, expanded or MAX_MENDED)
            if buffer is None:
                raise
            self.mended[offset - 9] = short(error)
            return buffer

    def _as_described(self, body, partial, expanded):
        """Records in a chunk, decoded by its own head."""
        size, crc, compression, data, stored = unpack_chunk(body)
        if len(data) < stored and not partial:
            raise ValueError('its data are longer than its record')
        if expanded and size != expanded:
            raise ValueError(f'{size} bytes where the index says {expanded}')
        if self.stream is not None and not self.spend(min(size, MAX_CHUNK)):
            raise ValueError(f'the file expands to more than {self._limit} bytes')
        buffer = decompress(data, compression, size)
        if not partial:
            if len(buffer) != size:
                raise ValueError(f'{len(buffer)} bytes where {size} were announced')
            if crc and zlib.crc32(buffer) != crc:
                raise ValueError('its checksum does not match')
            self.unchecked = self.unchecked or not crc
        return buffer

    def by_topic(self, counts):
        """Numbers of messages by topic, from those by channel; '' for undescribed channels."""
        out = Counter()
        for number, count in counts.items():
            out[self.channels[number].topic if number in self.channels else ''] += count
        return out

    def lose(self, offset, length, why, times, known, span=(None, None)):
        """Add a damaged part, with the known log times of its messages by channel."""
        if any(part.offset == offset for part in self.lost):
            return
        every = [time for rows in times.values() if rows for time in (min(rows), max(rows))]
        start, end = span if span[0] is not None else (
            min(every, default=None), max(every, default=None))
        self.lost.append(Lost(offset, length, why, {n: len(rows) for n, rows in times.items()},
                              known, start, end))

    def lose_segment(self, segment, stream, why):
        """Mark a chunk known from an index or a scan as unreadable."""
        times, _ = indexes_at(stream, segment.offset + segment.length)
        self.lose(segment.offset - 9, segment.length + 9, why, times,
                  bool(times) and segment.channels <= set(times), (segment.start, segment.end))

    def load(self, segment, stream):
        """Records of a segment, as bytes, read from `stream` (this file, open)."""
        if segment.chunk:
            return self.chunk(
                stream, segment.offset, segment.length, segment.partial, segment.expanded)
        self.unchecked = True
        return read_at(stream, segment.offset, segment.length)


class _From:
    """A stream that begins at an offset of another."""

    def __init__(self, stream, begin):
        self._stream, self._begin = stream, begin
        self.read = stream.read

    def seek(self, offset):
        return self._stream.seek(self._begin + offset)

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self._stream.close()


def logs_in(path, number=0):
    """The log in a file and any logs appended to it, a list of `BagFile`."""
    logs = [BagFile(path, number)]
    while logs[-1].follows is not None:
        logs.append(BagFile(path, number + len(logs), logs[-1]))
    return logs


def attachment_data(info):
    """Bytes of an attachment, an `AttachmentInfo`; ValueError if its checksum is wrong."""
    head = 28 + len(info.name.encode()) + len(info.media_type.encode()) + 4
    with open(info.file, 'rb') as stream:
        record = read_at(stream, info.offset - head, head + info.size)
        crc = int.from_bytes(stream.read(4), 'little')
    if crc and zlib.crc32(record) != crc:
        raise ValueError(f'{info.file.name}: the attachment {info.name} is damaged (its checksum '
                         'does not match)')
    return record[head:]
