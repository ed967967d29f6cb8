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

"""Reads a log: a folder or one MCAP file, finished or not.

The reader of `mcap` takes 5 times as long, and that of rosbags 13 times as long to the raw
messages; the latter also refuses truncated files, as a night that ended badly leaves them
(`telescope-mount recover`). This reader can be removed when one of them reads those.
"""

import bisect
import heapq
import re
import struct
from array import array
from collections import Counter
from contextlib import ExitStack

from mcap.opcode import Opcode

from .chunks import NEVER
from .compression import MAX_CHUNK
from .file import MIN_RECORDS, attachment_data, logs_in
from .log import LogTopic, Reader
from .mcap_records import PARSE_ERRORS, short, walk
from .metadata import Listed

#: most bytes of chunks overlapping in time that are held at once
MAX_HELD = MAX_CHUNK + 64 * 2**20


class BagReader(Reader):
    """Reads a bag: a folder or one ``.mcap`` file, finished or not.

    Parameters
    ----------
    path : str or Path

    Attributes
    ----------
    files : list of Path
    topics : list of Topic
        name, type, count, qos (list of dict, see `qos_dict`), type_hash.
    metadata : dict of str to dict
        The MCAP metadata records; the last one of each name.
    attachments : list of AttachmentInfo
    start_time, end_time : int or None
        First and last log time, ns since 1970; None without messages.
    complete : bool
        Whether every file was closed properly.

    Raises
    ------
    ValueError
        The path holds nothing that can be read as a log.
    OSError
        The path is not readable.

    Notes
    -----
    In a folder, latched messages that a file repeats from the previous one are left out.
    """

    SUFFIX = '.mcap'

    def __init__(self, path):
        super().__init__(path)
        self._files = []
        found = self._find()
        for file in found:
            try:
                self._files += logs_in(file, len(self._files))
            except ValueError as error:
                if len(found) == 1:
                    raise
                self._problems.append(str(error))
        if not self._files:
            raise ValueError(f'{self.path}: none of its files can be read as a log')
        self._compare_with_metadata(self._found())
        for before, file in zip([None, *self._files], self._files):
            self._problems += file.problems
            if before is not None and _follows(file, before):
                _drop_repeated(file)
        self.files = list(dict.fromkeys(file.path for file in self._files))
        self.complete = all(file.complete for file in self._files)
        self.metadata = {
            record.name: record.metadata for file in self._files for record in file.metadata}
        self.attachments = [a for file in self._files for a in file.attachments]
        self.topics = self._merge_topics()
        segments = [s for file in self._files for s in file.segments]
        self.start_time = min((s.start for s in segments), default=None)
        self.end_time = max((s.end for s in segments), default=None)
        self._check_times()

    @property
    def problems(self):
        """Problems of the log, list of str; may grow while messages are read."""
        return super().problems + [
            f'{file.path.name}: the chunk at byte {file.begin + offset} has a damaged head '
            f'({why}); by its checksum nothing of it is lost'
            for file in self._files for offset, why in sorted(file.mended.items())] + [
            f'{path.name}: {part}' for path, part in self.lost if part.why]

    @property
    def lost(self):
        """Unreadable parts, (Path, `Lost`), messages by topic; grows like `problems`."""
        return [(file.path, part._replace(offset=file.begin + part.offset,
                                          counts=file.by_topic(part.counts)))
                for file in self._files for part in file.lost]

    @property
    def checksums(self):
        """Whether all messages read so far are covered by checksums."""
        return not any(file.unchecked for file in self._files)

    def _found(self):
        """For each complete file its `Listed`, as metadata.yaml should have it."""
        found = {}
        for path in dict.fromkeys(file.path for file in self._files):
            logs = [file for file in self._files if file.path == path]
            if all(file.indexed or (file.closed and not file.lost) for file in logs):
                spans = [span for file in logs for span in file.segments]
                found[path.name] = Listed(
                    sum(sum(file.counts.values()) for file in logs),
                    min((span.start for span in spans), default=NEVER),
                    max((span.end for span in spans), default=0))
        return found

    def recorded(self):
        """Number of messages that were recorded, as far as the log shows.

        Returns
        -------
        topics : Counter
            By topic, in existing files; '' for undescribed channels.
        others : int
            Number of messages with unknown topics.
        known : bool
            Whether these numbers are complete.
        """
        topics, known = Counter(), True
        missing = Counter({name: row.count for name, row in self._listed.items()})
        for file in self._files:
            counts = file.counts
            if not file.indexed:
                counts = sum((Counter(part.counts) for part in file.lost), counts)
            missing[file.path.name] -= sum(file.repeated.values()) + sum(counts.values())
            topics.update(file.by_topic(counts))
            known = known and file.closed and (
                file.indexed or missing[file.path.name] >= 0
                or all(part.known for part in file.lost))
        there = {file.path.name for file in self._files}
        known = known and all(row.count for name, row in self._listed.items() if name not in there)
        return topics, sum(max(0, count) for count in missing.values()), known

    def _find_schema(self, topic, type_name):
        return next(
            ((file.schemas[channel.schema_id], channel.message_encoding)
             for file in self._files for channel in file.channels.values()
             if channel.topic == topic and channel.schema_id in file.schemas
             and file.schemas[channel.schema_id].name == type_name), (None, ''))

    def _merge_topics(self):
        merged = {}
        for file in self._files:
            for id_, channel in file.channels.items():
                schema = file.schemas.get(channel.schema_id)
                type_name = schema.name if schema else ''
                qos = self._qos_of(
                    channel.topic, channel.metadata.get('offered_qos_profiles', ''))
                before = merged.get((channel.topic, type_name))
                count = file.counts[id_] + (before.count if before else 0)
                merged[channel.topic, type_name] = LogTopic(
                    channel.topic, type_name, count, before.qos if before else qos,
                    channel.metadata.get('topic_type_hash', ''))
            unknown = sum(n for id_, n in file.counts.items() if id_ not in file.channels)
            if unknown:
                self._problems.append(
                    f'{file.path.name}: {unknown} messages of channels that are not described')
        return list(merged.values())

    def _stored(self, wanted, low, high):
        """See `Reader._stored`."""
        chosen = {
            id(file): {
                number: (channel.topic, schema.name if schema else '',
                         (schema, channel.message_encoding))
                for number, channel in file.channels.items()
                if wanted is None or channel.topic in wanted
                for schema in [file.schemas.get(channel.schema_id)]}
            for file in self._files}
        segments = sorted(
            s for file in self._files for s in file.segments
            if s.end >= low and s.start < high
            and (not s.channels or not s.channels.isdisjoint(chosen[id(file)])))
        return self._ordered(segments, chosen, low, high)

    def last_before(self, topics, end):
        """The newest message of each of `topics` with a log time before `end`, in order.

        Reads only the chunks that may contain them, newest first.

        Parameters
        ----------
        topics : iterable of str
        end : int
            ns since 1970.

        Returns
        -------
        list of BagMessage
        """
        found = []
        for topic in topics:
            spans = sorted(((min(s.end, end - 1), s.start) for f in self._files
                            for s in f.segments if s.start < end and _may_hold(s, f, topic)),
                           reverse=True)
            newest = None
            for last, first in spans:
                if newest is not None and newest.log_time > last:
                    break
                for message in self.messages(topic, first, last + 1):
                    if newest is None or message.log_time >= newest.log_time:
                        newest = message
            if newest is not None:
                found.append(newest)
        return sorted(found, key=lambda message: message.log_time)

    def _ordered(self, segments, chosen, low, high):
        """Merge segments that overlap in time; only the current ones are in memory."""
        heap, following, held = [], 0, 0
        with ExitStack() as stack:
            streams = {id(f): stack.enter_context(f.open()) for f in self._files}
            while heap or following < len(segments):
                while following < len(segments) and (
                        not heap or segments[following].start <= heap[0][0]):
                    segment = segments[following]
                    following += 1
                    key = id(segment.file)
                    rows = self._rows(segment, streams[key], chosen[key], low, high, held)
                    if rows:
                        held += rows.size
                        heapq.heappush(heap, (rows.times[0], segment.order, 0, rows))
                if not heap:
                    continue
                _, order, number, rows = heap[0]
                # all rows before the start of any other segment at once
                stop = len(rows)
                limit = min(
                    segments[following].start if following < len(segments) else 2**64,
                    min((entry[0] for entry in heap[1:3]), default=2**64))
                if rows.times[-1] >= limit:
                    stop = max(bisect.bisect_left(rows.times, limit, number), number + 1)
                yield from rows.between(number, stop)
                if stop < len(rows):
                    heapq.heapreplace(heap, (rows.times[stop], order, stop, rows))
                else:
                    held -= rows.size
                    heapq.heappop(heap)

    def _rows(self, segment, stream, chosen, low, high, held):
        try:
            if held and held + segment.expanded > MAX_HELD:
                raise ValueError(f'chunks of more than {MAX_HELD} bytes overlap in time')
            buffer = segment.file.load(segment, stream)
            if held and held + len(buffer) > MAX_HELD:
                raise ValueError(f'chunks of more than {MAX_HELD} bytes overlap in time')
            return ChunkRows(buffer, chosen, low, high, MIN_RECORDS + segment.length)
        except PARSE_ERRORS as error:
            segment.file.lose_segment(segment, stream, short(error))
            return None

    def read_attachment(self, name):
        """Bytes of the last attachment named `name`.

        Raises
        ------
        ValueError
            There is none (the message lists the existing ones), or it is damaged.
        """
        for info in reversed(self.attachments):
            if info.name == name:
                return attachment_data(info)
        known = ', '.join(a.name for a in self.attachments) or 'none'
        raise ValueError(f'{self.path} has no attachment {name!r} (it has: {known})')


class ChunkRows:
    """Selected messages of a chunk, in log time order; data are sliced on request."""

    __slots__ = ('times', '_begins', '_ends', '_buffer', '_chosen', 'size')

    def __init__(self, buffer, chosen, low, high, most):
        self._buffer, self._chosen, self.size = buffer, chosen, len(buffer)
        times, begins, ends = array('Q'), array('Q'), array('Q')
        unpack = struct.Struct('<HIQ').unpack_from
        ordered, last = True, 0
        for opcode, begin, end in walk(buffer, most):
            if opcode != Opcode.MESSAGE or end - begin < 22:
                continue
            channel, _, log_time = unpack(buffer, begin)
            if channel in chosen and low <= log_time < high:
                times.append(log_time)
                begins.append(begin)
                ends.append(end)
                ordered = ordered and log_time >= last
                last = log_time
        if not ordered:
            order = sorted(range(len(times)), key=times.__getitem__)
            times = array('Q', [times[i] for i in order])
            begins = array('Q', [begins[i] for i in order])
            ends = array('Q', [ends[i] for i in order])
        self.times, self._begins, self._ends = times, begins, ends

    def __len__(self):
        return len(self.times)

    def __lt__(self, other):
        return False  # the file order decides ties in the heap

    def between(self, number, stop):
        """(entry of `chosen`, (log time, publish time, data, sequence)) of some rows."""
        buffer, chosen = self._buffer, self._chosen
        unpack = struct.Struct('<HIQQ').unpack_from
        for begin, end in zip(self._begins[number:stop], self._ends[number:stop]):
            channel, sequence, log_time, publish_time = unpack(buffer, begin)
            yield chosen[channel], (log_time, publish_time, buffer[begin + 22:end], sequence)


def _may_hold(segment, file, topic):
    return not segment.channels or any(
        file.channels[n].topic == topic for n in segment.channels if n in file.channels)


def _follows(file, before):
    """Whether `before` is the file whose latched messages `file` repeats."""
    names = [re.fullmatch(r'(.*_)(\d{1,9})', part.path.stem) for part in (before, file)]
    return None not in names and names[0][1] == names[1][1] and (
        int(names[0][2]) + 1 == int(names[1][2]))


def _drop_repeated(file):
    """Remove the chunk of repeated latched messages from `file`."""
    by_topic = {channel.topic: number for number, channel in file.channels.items()}
    if not file.repeated or not file.segments:
        return
    first = min(file.segments, key=lambda segment: segment.offset)
    if not set(file.repeated) >= set(file.by_topic(dict.fromkeys(first.channels, 1))) - {''}:
        # that chunk is damaged and not in the list: none of its messages is lost
        file.lost = [part._replace(counts={}, known=True)
                     if part.known and file.by_topic(part.counts) == Counter(file.repeated)
                     and part.offset < first.offset else part for part in file.lost]
        return
    file.segments.remove(first)
    for topic, count in file.repeated.items():
        if topic in by_topic:
            file.counts[by_topic[topic]] = max(0, file.counts[by_topic[topic]] - count)
