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

"""Scans an MCAP file without an index, or with a damaged one."""

import re
import struct
from collections import Counter
from contextlib import suppress

from mcap.opcode import Opcode

from .chunks import MAGIC, NEVER
from .compression import CHUNK_HEAD, MAX_CHUNK
from .losses import Lost
from .mcap_records import (
    PARSE_ERRORS,
    index_record,
    read_at,
    short,
    walk,
)

#: size of the windows in which the next chunk after a damaged record is searched, bytes
WINDOW = 2**22
#: most concatenated logs that are read from a file
MOST_LOGS = 50
#: valid opcodes before the end of the data
_DATA_OPCODES = frozenset(map(int, (
    Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX,
    Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END)))
_DATA_END = re.compile(rb'\x0f\x04\0{7}.{4}[\x02-\x0e].{5}\0{3}', re.DOTALL)
_MAGIC, _LOG = re.compile(re.escape(MAGIC)), re.compile(re.escape(MAGIC) + b'\x01')
_INDEX = re.compile(rb'\x07.{4}\0{4}', re.DOTALL)


def indexes_at(stream, place):
    """Log times by channel from the message indexes at `place`, and the end of these."""
    times = {}
    while True:
        head = read_at(stream, place, 9)
        if len(head) < 9 or head[0] != Opcode.MESSAGE_INDEX:
            return times, place
        (length,) = struct.unpack_from('<Q', head, 1)
        try:
            channel, rows = index_record(read_at(stream, place + 9, min(length, MAX_CHUNK)))
        except PARSE_ERRORS:
            return times, place
        times[channel] = rows
        place += 9 + length


class LogScan:
    """Scans a file from its start; after damage it continues at the next intact part.

    Parameters
    ----------
    file : BagFile
        Receives the results.
    """

    def __init__(self, file):
        self._file, self._size = file, file.size
        self._plain = None  # start, first and last time, channels of consecutive plain messages
        self._any_plain = False
        self._in_chunk, self._span = Counter(), (0, 0)  # of the last chunk read
        self._behind = 0  # where the message indexes of the last chunk end

    def run(self):
        """Scan the file."""
        pos, closed = 8, False
        while pos + 9 <= self._size and not closed:
            head = self._file.at(pos, 64)
            opcode, length = struct.unpack_from('<BQ', head)
            end = pos + 9 + length
            if opcode == Opcode.MESSAGE and length >= 22 and end <= self._size and not (
                    CHUNK_HEAD.match(b'\x06' + head[1:])):
                self._take_plain(pos, end)
                pos = end
                continue
            self._end_plain(pos)
            following = None
            # recognize a chunk whatever its opcode
            if opcode == Opcode.CHUNK or CHUNK_HEAD.match(b'\x06' + head[1:]):
                following = self._take_chunk(pos, length)
            elif end <= self._size and opcode != Opcode.MESSAGE and (
                    opcode in _DATA_OPCODES or (opcode == Opcode.HEADER and pos == 8)):
                closed = opcode == Opcode.DATA_END
                self._take_record(opcode, pos, end)
                following = end
            if following is None:
                following = self._after_damage(pos, end, opcode == Opcode.CHUNK)
            if following is None:
                break
            pos = following
        self._end_plain(pos)
        self._conclude(pos, closed)

    def _conclude(self, pos, closed):
        file = self._file
        file.closed = closed
        if closed:
            self._look_behind(pos)
        if file.follows is not None:
            file.note(f'another MCAP log of {file.size - file.follows} bytes begins at byte '
                      f'{file.begin + file.follows}: its messages are read, too')
        if closed and file.ended:
            file.complete = not (file.problems or file.lost or file.mended)
        elif closed:
            file.note('the index at its end is cut off; the messages before it are whole')
        else:
            if pos < self._size:
                file.lost.append(Lost(pos, self._size - pos, '', {}, False))
            file.note(f'not closed: {sum(file.counts.values())} messages read up to byte '
                      f'{file.begin + min(pos, self._size)} of {file.begin + self._size}')

    def _look_behind(self, pos):
        """Check what follows a log whose data end at `pos`."""
        file = self._file
        end = self._find(_MAGIC, pos)
        if end is None:
            return
        file.ended = file.at(end, 9) != MAGIC + b'\x01'
        end += len(MAGIC) * file.ended
        file.follows = self._find(_LOG, end) if file.rank < MOST_LOGS else None
        rest = (self._size if file.follows is None else file.follows) - end
        if rest > 0:
            file.lost.append(Lost(end, rest, 'they follow the end of the log', {}, False))

    def _is_record(self, pos):
        """Whether there may be a data record at `pos`."""
        head = self._file.at(pos, 9) if pos < self._size else b''
        return len(head) == 9 and head[0] in _DATA_OPCODES and (
            pos + 9 + struct.unpack_from('<Q', head, 1)[0] <= self._size)

    def _take_record(self, opcode, pos, end):
        try:
            if opcode in (Opcode.METADATA, Opcode.ATTACHMENT):
                self._file.take_large(opcode, pos + 9, end - pos - 9)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._file.take(opcode, self._file.at(pos + 9, min(end - pos - 9, MAX_CHUNK)))
        except PARSE_ERRORS as error:
            self._file.lost.append(Lost(pos, end - pos, short(error), {}, True))

    # --- messages outside of chunks ---------------------------------------------------------

    def _take_plain(self, pos, end):
        channel, _, log_time = struct.unpack('<HIQ', self._file.at(pos + 9, 14))
        self._any_plain = True
        if self._plain is None:
            self._plain = [pos, log_time, log_time, set()]
        self._plain[1] = min(self._plain[1], log_time)
        self._plain[2] = max(self._plain[2], log_time)
        self._plain[3].add(channel)
        self._file.counts[channel] += 1
        if end - self._plain[0] > 2**20:
            self._end_plain(end)

    def _end_plain(self, end):
        if self._plain is not None:
            begin, first, last, channels = self._plain
            self._file.segment(first, last, begin, end - begin, chunk=False,
                               channels=frozenset(channels))
            self._plain = None

    # --- chunks -----------------------------------------------------------------------------

    def _take_chunk(self, pos, length):
        """Read the chunk at `pos`; return the position of the next record, None if unknown."""
        file, end = self._file, pos + 9 + length
        n, = struct.unpack('<I', file.at(pos + 37, 4).ljust(4, b'\0'))
        inner = pos + 49 + n + struct.unpack('<Q', file.at(pos + 41 + n, 8).ljust(8, b'\0'))[0]
        try:
            self._count_one_of(pos + 9, {min(end, self._size), min(inner, self._size)})
        except PARSE_ERRORS as error:
            behind = pos < self._behind and self._is_record(self._behind)  # a message index
            if behind or end > self._size or (end != inner and not self._is_record(end)) or (
                    self._find(_LOG, pos, end) is not None):
                return None
            times, behind = indexes_at(file.stream, end)
            file.lose(pos, end - pos, short(error), times, bool(times) and self._is_record(behind))
            self._behind = behind
            return behind
        following = end
        if not self._is_record(end):
            following = inner
            file.mended.setdefault(pos, f'a length of {length} bytes')
        self._behind = following + sum(15 + 16 * n for n in self._in_chunk.values())
        return following

    def _count_one_of(self, offset, ends):
        """Count messages of a chunk that ends at one of `ends`, since a length may be wrong."""
        *others, last = sorted(ends, reverse=True)
        for end in others:
            with suppress(*PARSE_ERRORS):
                return self._count(offset, end - offset, cut=False)
        return self._count(offset, last - offset, cut=False)

    def _count(self, offset, length, cut):
        """Count messages of a chunk; ValueError if it is damaged, not just truncated."""
        file = self._file
        try:
            buffer = file.chunk(file.stream, offset, length, cut)
        except PARSE_ERRORS:
            if cut:
                return
            raise
        counts, first, last = Counter(), NEVER, 0
        unpack = struct.Struct('<HIQ').unpack_from
        for opcode, begin, end in walk(buffer, file.most):
            file.most -= 1
            if opcode == Opcode.MESSAGE and end - begin >= 22:
                channel, _, log_time = unpack(buffer, begin)
                counts[channel] += 1
                first, last = min(first, log_time), max(last, log_time)
            else:
                try:
                    file.take(opcode, buffer[begin:end])
                except PARSE_ERRORS as error:
                    if len(file.problems) < 100:
                        file.note(f'a record in the chunk at byte {file.begin + offset - 9} is '
                                  f'damaged ({short(error)}) and left out')
        if counts:
            file.counts.update(counts)
            file.segment(first, last, offset, length, chunk=True, partial=cut,
                         channels=frozenset(counts))
        self._in_chunk, self._span = counts, (first, last)

    # --- damage -----------------------------------------------------------------------------

    def _after_damage(self, pos, end, is_chunk):
        """Where to continue after an invalid record at `pos`; None if nothing follows."""
        file = self._file
        if not is_chunk and self._is_record(end):  # only its opcode is wrong
            file.lost.append(Lost(pos, end - pos, 'no record', {}, not self._any_plain))
            return end
        if pos < self._behind and self._is_record(self._behind):
            file.lost.append(Lost(pos, self._behind - pos, 'message index', {}, True))
            return self._behind
        following = self._next_chunk(pos + 1) or self._find(_DATA_END, pos + 1)
        another = self._find(_LOG, pos, following) if file.rank < MOST_LOGS else None
        if another is not None:  # its channels have other numbers
            file.follows = self._size = another
            following = None
        if following is None:
            if is_chunk:
                self._count(pos + 9, self._size - pos - 9, cut=True)
            return None
        file.lose(pos, following - pos, 'no record',
                  self._indexes_between(max(pos, self._behind), following), False)
        return following

    def _next_chunk(self, pos):
        """Offset of the next complete and valid chunk record from `pos` on, or None."""
        file = self._file
        while pos + 49 <= self._size:
            window = file.at(pos, WINDOW + 64)
            for match in CHUNK_HEAD.finditer(window):
                offset = pos + match.start()
                (length,) = struct.unpack_from('<Q', window, match.start() + 1)
                if offset + 9 + length > self._size or match.start() >= WINDOW:
                    continue
                try:
                    file.chunk(file.stream, offset + 9, length, False)
                except PARSE_ERRORS:
                    if not file.spend(2**16):  # limits the time for attempts
                        return None
                    continue
                return offset
            pos += WINDOW
        return None

    def _find(self, pattern, pos, stop=None):
        """Offset of the first match from `pos` on, before `stop`, or None."""
        stop = self._size if stop is None else stop
        while pos < stop:
            match = pattern.search(self._file.at(pos, min(WINDOW + 64, stop - pos)))
            if match and match.start() < WINDOW:
                return pos + match.start()
            pos += WINDOW
        return None

    def _indexes_between(self, begin, end):
        """Log times by channel from message indexes in this range, except those of chunks read."""
        begin, times, place = max(begin, end - 2**24), {}, 0
        part = self._file.at(begin, max(0, end - begin))
        for match in _INDEX.finditer(part):
            if match.start() < place:
                continue
            (length,) = struct.unpack_from('<Q', part, match.start() + 1)
            body = part[match.start() + 9:match.start() + 9 + length]
            try:
                if len(body) < max(length, 22):
                    continue
                channel, rows = index_record(body)
            except PARSE_ERRORS:
                continue
            read = len(rows) == self._in_chunk[channel] and (
                self._span[0] <= min(rows) <= max(rows) <= self._span[1])
            if channel in self._file.channels and not read:
                times.setdefault(channel, []).extend(rows)
                place = match.start() + 9 + length
        return times
