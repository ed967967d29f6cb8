"""One MCAP file of a log, read with its index or, after a crash, without."""

import struct
import zlib
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from mcap import records
from mcap.opcode import Opcode

from .chunks import MAGIC, NEVER
from .mcap_records import (
    CHUNK_HEAD,
    MAX_CHUNK,
    PARSE_ERRORS,
    chunk_index,
    decompress,
    parse,
    read_at,
    short,
    unpack_chunk,
    walk,
)
from .writer import REPEATED_RECORD, STOPPED_RECORD

#: a file that expands to more than this and `EXPANSION` times its size is a bomb
MIN_EXPANDED, EXPANSION = 256 * 2**20, 300
#: so is one with more records than this and a byte of its size for each
MIN_RECORDS = 300_000
#: metadata records above this are left alone
MAX_METADATA = 16 * 2**20
#: bytes that are looked through at a time for the next chunk after a damaged record
WINDOW = 2**22


class AttachmentInfo(NamedTuple):
    """An attachment of a bag: its bytes are at `offset` of `file`."""

    name: str
    media_type: str
    size: int
    log_time: int
    file: Path
    offset: int


class Segment(NamedTuple):
    """A chunk, or a row of messages outside of chunks; sorted by its first log time."""

    start: int
    order: tuple
    end: int
    file: object
    offset: int
    length: int
    chunk: bool  # a chunk record, else plain records
    partial: bool
    channels: frozenset
    expanded: int  # bytes that the index tells, 0 where it is not known


class BagFile:
    """One MCAP file: its channels, and where its messages are.

    Parameters
    ----------
    path : Path
    number : int
        Its place among the files of the bag.

    Attributes
    ----------
    repeated : dict of str to int
        Latched messages at its start that the file before has already, by topic.
    lost : list of (int, int)
        Offset and length of what could not be read.

    Raises
    ------
    ValueError
        Not an MCAP file.
    OSError
        It may not be read.
    """

    def __init__(self, path, number=0):
        self.path = path
        self.number = number
        self.schemas = {}
        self.channels = {}
        self.counts = Counter()
        self.segments = []
        self.metadata = []
        self.attachments = []
        self.problems = []
        self.lost = []
        self.complete = False
        self.ended = False
        self.size = path.stat().st_size
        self._expanded = 0
        self._limit = MIN_EXPANDED + EXPANSION * self.size
        self._most = MIN_RECORDS + self.size
        if self.size == 0:
            raise ValueError(f'{path} is empty (0 bytes): nothing was recorded in it')
        with open(path, 'rb') as stream:
            self.stream = stream
            if self._at(0, 8) != MAGIC[:self.size]:
                raise ValueError(f'{path} is not an MCAP file: a log is the folder of '
                                 'a bag, or a file of it')
            try:
                self.complete = self._read_summary()
            except PARSE_ERRORS as error:
                self._say(f'the index is damaged ({short(error)}); the file was read through')
            if not self.complete:
                self._scan()
            self.stream = None
        own = {record.name: record.metadata for record in self.metadata}
        self.repeated = {topic: int(count) for topic, count in own.get(REPEATED_RECORD, {}).items()
                         if count.isdecimal() and len(count) < 10}
        if STOPPED_RECORD in own:
            self._say(f'recording stopped: {own[STOPPED_RECORD].get("reason", "")[:120]}')

    def _say(self, text):
        self.problems.append(f'{self.path.name}: {text}')

    def _at(self, offset, length):
        return read_at(self.stream, offset, length)

    # --- with the index ---------------------------------------------------------------------

    def _read_summary(self):
        """True if the summary at the end tells all that `_scan` would."""
        tail = self._at(max(self.size - 37, 0), 37)
        if len(tail) < 37 or tail[-8:] != MAGIC or tail[0] != Opcode.FOOTER:
            return False
        self.ended = True
        start, _, crc = struct.unpack_from('<QQI', tail, 9)
        if start == 0:
            return False
        if not 8 <= start <= self.size - 37:
            raise ValueError('the summary is said to lie outside the file')
        summary = self._at(start, self.size - 37 - start)
        if crc and zlib.crc32(tail[:25], zlib.crc32(summary)) != crc:
            raise ValueError('checksum of the summary does not match')
        statistics, chunks, elsewhere = None, [], []
        for opcode, begin, end in walk(summary, self._most):
            body = summary[begin:end]
            if opcode == Opcode.STATISTICS:
                statistics = parse(records.Statistics, body)
            elif opcode == Opcode.CHUNK_INDEX:
                chunks.append(chunk_index(body))
            elif opcode in (Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
                elsewhere.append(struct.unpack_from('<Q', body)[0])
            else:
                self._take(opcode, body)
        if statistics is None or (statistics.message_count and not chunks):
            return False  # written without an index: that is no damage
        self._take_index(chunks)
        for channel in statistics.channel_message_counts:
            if channel not in self.channels:
                raise ValueError(f'channel {channel} is not described')
        self.counts.update(statistics.channel_message_counts)
        for offset in sorted(set(elsewhere)):
            opcode, length = struct.unpack('<BQ', self._at(offset, 9))
            self._take_large(opcode, offset + 9, length)
        return True

    def _take_index(self, chunks):
        """Segments of the chunks; ValueError where they overlap or expand beyond belief."""
        place = 8
        for start, end, offset, length, channels, size in sorted(chunks, key=lambda c: c[2]):
            if length < 9 or offset < place or offset + length > self.size:
                raise ValueError('a chunk is said to lie outside the file or in another')
            place = offset + length
            self._expanded += size
            self._segment(start, end, offset + 9, length - 9, chunk=True, channels=channels,
                          expanded=size)
        if self._expanded > self._limit:
            raise ValueError(f'its chunks are said to hold {self._expanded} bytes')

    def _segment(self, start, end, offset, length, *, chunk, partial=False,
                 channels=frozenset(), expanded=0):
        self.segments.append(Segment(
            start, (self.number, len(self.segments)), end, self, offset, length, chunk, partial,
            channels, expanded))

    def _take(self, opcode, body):
        """Keep a schema or channel."""
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return
        (number,) = struct.unpack_from('<H', body)
        if opcode == Opcode.SCHEMA and number not in self.schemas:
            self.schemas[number] = parse(records.Schema, body)
        elif opcode == Opcode.CHANNEL and number not in self.channels:
            self.channels[number] = parse(records.Channel, body)

    def _take_large(self, opcode, offset, length):
        """Keep a metadata record, or note an attachment."""
        if offset + length > self.size:
            raise ValueError('a record is larger than it can be')
        if opcode == Opcode.METADATA:
            if length > MAX_METADATA:
                raise ValueError(f'a metadata record of {length} bytes')
            self.metadata.append(parse(records.Metadata, self._at(offset, length)))
        elif opcode == Opcode.ATTACHMENT:
            head = self._at(offset, min(length, 2**16))
            log_time, _, n = struct.unpack_from('<QQI', head)
            name = head[20:20 + n].decode()
            (m,) = struct.unpack_from('<I', head, 20 + n)
            media_type = head[24 + n:24 + n + m].decode()
            (size,) = struct.unpack_from('<Q', head, 24 + n + m)
            if 32 + n + m + size > length:
                raise ValueError(f'attachment {name!r} is longer than its record')
            self.attachments.append(AttachmentInfo(
                name, media_type, size, log_time, self.path, offset + 32 + n + m))

    # --- without the index ------------------------------------------------------------------

    def _scan(self):
        """Read the file through; after damage go on at the next thing that is a chunk."""
        for kept in (self.schemas, self.channels, self.counts, self.segments, self.metadata,
                     self.attachments):
            kept.clear()
        self._expanded = 0
        self._plain = None  # start, first time, last time, channels of a row of plain messages
        pos, closed = 8, False
        while pos + 9 <= self.size and not closed:
            opcode, length = struct.unpack('<BQ', self._at(pos, 9))
            end = pos + 9 + length
            # the opcodes of MCAP are 1 to 15, and private ones from 128 on
            damaged = opcode == 0 or 16 <= opcode < 128 or end > self.size
            if not damaged:
                closed = self._scan_record(opcode, pos, length)
                pos = end
                continue
            following = self._next_chunk(pos + 1)
            if following is None:
                if opcode == Opcode.CHUNK:
                    self._scan_chunk(pos + 9, self.size - pos - 9, True)
                break
            self._lose(pos, following - pos, 'no record')
            pos = following
        self._end_plain(pos)
        self._conclude(pos, closed)

    def _conclude(self, pos, closed):
        if closed and self.ended:
            self.complete = not self.problems
        elif closed:
            self._say('the index at its end is cut off; the messages before it are whole')
        else:
            if pos < self.size:
                self.lost.append((pos, self.size - pos))
            self._say(
                f'not closed: {sum(self.counts.values())} messages read up to byte '
                f'{min(pos, self.size)} of {self.size}')

    def _lose(self, offset, length, why):
        self.lost.append((offset, length))
        self._say(f'{length} bytes at byte {offset} are damaged ({why}) and left out')

    def _scan_record(self, opcode, pos, length):
        """Take the whole record at `pos`; True if the messages end with it."""
        offset, end = pos + 9, pos + 9 + length
        if opcode == Opcode.MESSAGE and length >= 22:
            self._scan_plain(pos, end)
            return False
        self._end_plain(pos)
        try:
            if opcode == Opcode.CHUNK:
                self._scan_chunk(offset, length, False)
            elif opcode in (Opcode.METADATA, Opcode.ATTACHMENT):
                self._take_large(opcode, offset, length)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take(opcode, self._at(offset, min(length, MAX_CHUNK)))
        except PARSE_ERRORS as error:
            self._lose(pos, end - pos, short(error))
        return opcode == Opcode.DATA_END

    def _scan_plain(self, pos, end):
        channel, _, log_time = struct.unpack('<HIQ', self._at(pos + 9, 14))
        if self._plain is None:
            self._plain = [pos, log_time, log_time, set()]
        self._plain[1] = min(self._plain[1], log_time)
        self._plain[2] = max(self._plain[2], log_time)
        self._plain[3].add(channel)
        self.counts[channel] += 1
        if end - self._plain[0] > 2**20:
            self._end_plain(end)

    def _end_plain(self, end):
        if self._plain is not None:
            begin, first, last, channels = self._plain
            self._segment(first, last, begin, end - begin, chunk=False,
                          channels=frozenset(channels))
            self._plain = None

    def _scan_chunk(self, offset, length, cut):
        """Count what is in a chunk; ValueError if it is damaged and not merely cut."""
        try:
            buffer = self._chunk(self.stream, offset, length, cut)
        except PARSE_ERRORS:
            if cut:
                return
            raise
        counts, first, last = Counter(), NEVER, 0
        unpack = struct.Struct('<HIQ').unpack_from
        for opcode, begin, end in walk(buffer, self._most):
            self._most -= 1
            if opcode == Opcode.MESSAGE and end - begin >= 22:
                channel, _, log_time = unpack(buffer, begin)
                counts[channel] += 1
                first, last = min(first, log_time), max(last, log_time)
            else:
                try:
                    self._take(opcode, buffer[begin:end])
                except PARSE_ERRORS as error:
                    if len(self.problems) < 100:
                        self._say(f'a record in the chunk at byte {offset - 9} is damaged '
                                  f'({short(error)}) and left out')
        if counts:
            self.counts.update(counts)
            self._segment(first, last, offset, length, chunk=True, partial=cut,
                          channels=frozenset(counts))

    def _next_chunk(self, pos):
        """Offset of the next whole and sound chunk record from `pos` on, or None."""
        while pos + 49 <= self.size:
            window = self._at(pos, WINDOW + 64)
            for match in CHUNK_HEAD.finditer(window):
                offset = pos + match.start()
                (length,) = struct.unpack_from('<Q', window, match.start() + 1)
                if offset + 9 + length > self.size or match.start() >= WINDOW:
                    continue
                try:
                    self._chunk(self.stream, offset + 9, length, False)
                except PARSE_ERRORS:
                    self._expanded += 2**16  # trying costs time
                    if self._expanded > self._limit:
                        return None
                    continue
                return offset
            pos += WINDOW
        return None

    # --- messages ---------------------------------------------------------------------------

    def _chunk(self, stream, offset, length, partial, expanded=0):
        if length > MAX_CHUNK + 2**16:
            raise ValueError(f'a chunk claims {length} bytes, more than {MAX_CHUNK}')
        body = read_at(stream, offset, length)
        size, crc, compression, data, stored = unpack_chunk(body)
        if len(data) < stored and not partial:
            raise ValueError('its data are longer than its record')
        if expanded and size != expanded:
            raise ValueError(f'{size} bytes where the index says {expanded}')
        if self.stream is not None:  # not yet opened
            self._expanded += min(size, MAX_CHUNK)
            if self._expanded > self._limit:
                raise ValueError(f'the file expands to more than {self._limit} bytes')
        buffer = decompress(data, compression, size)
        if not partial:
            if len(buffer) != size:
                raise ValueError(f'{len(buffer)} bytes where {size} were announced')
            if crc and zlib.crc32(buffer) != crc:
                raise ValueError('its checksum does not match')
        return buffer

    def load(self, segment, stream):
        """The records of a segment, as bytes, read from `stream` (this file, open)."""
        if segment.chunk:
            return self._chunk(
                stream, segment.offset, segment.length, segment.partial, segment.expanded)
        return read_at(stream, segment.offset, segment.length)
