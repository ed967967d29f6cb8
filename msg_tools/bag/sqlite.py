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

"""Reads bags that rosbag2 wrote into SQLite files, like `BagReader` for MCAP."""

import heapq
import sqlite3
from collections import Counter, deque
from contextlib import closing
from pathlib import Path

from mcap.records import Schema

from .log import LogTopic, Reader
from .mcap_records import short
from .metadata import NOTHING, Listed
from .reader import BagReader
from .ros_schema import message_definition


def open_bag(path):
    """A reader for a bag of either format.

    Parameters
    ----------
    path : str or Path
        A folder, ``.mcap`` or ``.db3``.

    Returns
    -------
    BagReader or SqliteReader

    Raises
    ------
    ValueError, OSError
        It is not a bag, or not readable.
    """
    path = Path(path)
    if path.suffix == '.db3' or (path.is_dir() and not any(path.glob('*.mcap'))
                                 and any(path.glob('*.db3'))):
        return SqliteReader(path)
    return BagReader(path)


class SqliteReader(Reader):
    """Reads a bag in SQLite; attributes and `messages` as in `BagReader`.

    Parameters
    ----------
    path : str or Path
        A folder or one ``.db3`` file.

    Raises
    ------
    ValueError
        It is not a bag.
    OSError
        It is not readable.
    """

    SUFFIX = '.db3'
    metadata, attachments, lost = {}, (), ()
    checksums = False  # SQLite has none

    def __init__(self, path):
        super().__init__(path)
        self._definitions, self._described = {}, {}
        self.files = self._find()
        self._rows = {}  # file -> {topic id: (name, type, format, qos text, hash)}
        counts, self._in_files = Counter(), {}
        for file in self.files:
            times = []
            if _has_wal(file):
                self._problems.append(f'{_wal(file).name} is read with it: the recorder was not '
                                      'ended, or still runs')
            try:
                with closing(_connect(file)) as base:
                    self._rows[file] = self._read_topics(base)
                    for number, count, first, last in base.execute(
                            'SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) '
                            'FROM messages GROUP BY topic_id'):
                        if number in self._rows[file]:
                            counts[self._rows[file][number][:2]] += count
                            times.append((first, last, count))
                if times:
                    first, last, count = zip(*times)
                    self._in_files[file.name] = Listed(sum(count), min(first), max(last))
            except (sqlite3.Error, TypeError, OverflowError) as error:
                raise ValueError(f'{file} is no bag of rosbag2 ({short(error)})') from None
        merged = {}
        for rows in self._rows.values():
            for name, type_name, _, qos_text, hash_ in rows.values():
                merged.setdefault((name, type_name), LogTopic(
                    name, type_name, counts[name, type_name], self._qos_of(name, qos_text), hash_))
        self.topics = list(merged.values())
        spans = self._in_files.values()
        self.start_time = min((span.start for span in spans), default=None)
        self.end_time = max((span.end for span in spans), default=None)
        self._compare_with_metadata(
            {file.name: self._in_files.get(file.name, NOTHING) for file in self.files})
        for file in self.files:
            if self._listed.get(file.name, NOTHING).count > self._in_files.get(
                    file.name, NOTHING).count and not _has_wal(file):
                self._problems.append(f'{_wal(file).name}, where the newest may be, is not there')
        self._check_times()
        self.complete = True

    def recorded(self):
        """Number of messages that were recorded; see `BagReader.recorded`."""
        topics = Counter()
        for topic in self.topics:
            topics[topic.name] += topic.count
        missing = {name: row.count - self._in_files.get(name, NOTHING).count
                   for name, row in self._listed.items()}
        there = {file.name for file in self.files}
        known = all(row.count for name, row in self._listed.items() if name not in there)
        return topics, sum(max(0, count) for count in missing.values()), known

    def _read_topics(self, base):
        kinds = dict(base.execute('SELECT name, type FROM sqlite_master'))
        if kinds.get('topics') != 'table' or kinds.get('messages') != 'table':
            raise ValueError(f'{self.path} has no tables of a bag of rosbag2')
        there = {row[1] for row in base.execute('PRAGMA table_info(topics)')}
        columns = [name if name in there else "''" for name in (
            'id', 'name', 'type', 'serialization_format', 'offered_qos_profiles',
            'type_description_hash')]
        rows = {int(row[0]): tuple(map(str, row[1:])) for row in base.execute(
            f'SELECT {", ".join(columns)} FROM topics')}
        if kinds.get('message_definitions') == 'table':
            for name, encoding, text in base.execute(
                    'SELECT topic_type, encoding, encoded_message_definition '
                    'FROM message_definitions'):
                if encoding == 'ros2msg':
                    self._definitions[str(name)] = str(text)
        return rows

    def _find_schema(self, topic, type_name):
        encoding = next((row[2] for rows in self._rows.values() for row in rows.values()
                         if row[:2] == (topic, type_name)), '')
        schema = encoding and self._schema(type_name)
        return (schema, encoding) if schema else (None, '')

    def _schema(self, type_name):
        """The `mcap` Schema of a type; None if it has no definition, which is a problem."""
        if type_name not in self._described:
            self._described[type_name] = None
            try:
                text = self._definitions.get(type_name)
                if text is None:
                    text = message_definition(type_name)
                self._described[type_name] = Schema(
                    id=1, name=type_name, encoding='ros2msg', data=text.encode())
            except ValueError as error:
                self._problems.append(str(error))
        return self._described[type_name]

    def _stored(self, wanted, low, high):
        """See `Reader._stored`."""
        for when, _, _, row, data in heapq.merge(
                *(self._rows_of(n, file, wanted, low, min(high, 2**63 - 1))
                  for n, file in enumerate(self.files)), key=lambda row: row[:3]):
            yield (*row[:2], None), (when, when, data, 0)

    def last_before(self, topics, end):
        """The newest message of each of `topics` with a time before `end`, in order."""
        found = []
        for topic in topics:
            newest = -1
            for file, rows in self._rows.items():
                ids = [str(id_) for id_, row in rows.items() if row[0] == topic]
                with closing(_connect(file)) as base:
                    (time,), = base.execute(
                        f'SELECT MAX(timestamp) FROM messages WHERE topic_id IN ({",".join(ids)}) '
                        'AND timestamp < ?', (min(end, 2**63 - 1),))
                newest = max(newest, -1 if time is None else time)
            found += deque(self.messages(topic, newest, newest + 1), 1)
        return sorted(found, key=lambda message: message.log_time)

    def _rows_of(self, number, file, wanted, low, high):
        """(time, file number, id, topic row, data) of messages in a file, in order."""
        rows = {id_: row for id_, row in self._rows[file].items()
                if wanted is None or row[0] in wanted}
        if not rows:
            return
        with closing(_connect(file)) as base:
            try:
                for id_, when, topic, data in base.execute(
                        'SELECT id, timestamp, topic_id, data FROM messages '
                        f'WHERE topic_id IN ({",".join(map(str, rows))}) '
                        'AND timestamp >= ? AND timestamp < ? ORDER BY timestamp, id',
                        (low, high)):
                    if isinstance(data, bytes) and isinstance(when, int):
                        yield when, number, id_, rows[topic], data
                    else:
                        self._skipped[f'{file.name}: rows that are no message left out'] += 1
            except sqlite3.Error as error:
                self._problems.append(f'{file.name}: {short(error)}; what follows is lost')


def _wal(file):
    """File with data that SQLite has not merged yet (write-ahead log)."""
    return file.with_name(f'{file.name}-wal')


def _has_wal(file):
    return _wal(file).exists() and _wal(file).stat().st_size > 0


def _connect(file):
    # write no files next to a bag that may not be ours: no locks, no shared memory
    how = 'vfs=unix-none' if _has_wal(file) else 'immutable=1'
    base = sqlite3.connect(f'{file.resolve().as_uri()}?mode=ro&{how}', uri=True)
    base.execute('PRAGMA locking_mode = EXCLUSIVE')
    base.execute('PRAGMA trusted_schema = OFF')
    return base
