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

"""Common parts of the readers of all kinds of logs, and decoding by the definitions in a log."""

import re
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import zstandard

from .compression import PACKED, PACKED_FILE, decompress
from .file import EXPANSION, MIN_EXPANDED
from .losses import counted, implausible, span
from .mcap_records import short
from .metadata import NOTHING, is_truth, listed_files
from .ros_schema import load_qos

#: longest plausible message definition, and longest line of one
MAX_DEFINITION, MAX_LINE = 256 * 1024, 1000


class LogTopic(NamedTuple):
    """A topic of a bag."""

    name: str
    type: str
    count: int
    qos: list
    type_hash: str

    @property
    def latched(self):
        """Whether a publisher offered its last messages to late subscribers."""
        return any(profile['durability'] == 'transient_local' for profile in self.qos)


class BagMessage(NamedTuple):
    """One message; times in ns since 1970; `data` is bytes or the decoded object."""

    topic: str
    type: str
    data: object
    log_time: int
    publish_time: int
    sequence: int = 0


def _natural(path):
    """Sort key: night_2 before night_10."""
    return [int(t) if t.isdecimal() and len(t) < 20 else 0 if t.isdecimal() else t
            for t in re.split(r'(\d+)', path.name)]


class Reader:
    """Base class of readers; each defines the SUFFIX of its files."""

    def __init__(self, path):
        self.path = Path(path)
        self._problems = []
        self._listed = {}
        self._schemas = {}  # cache of `schema_of`
        self._skipped = Counter()
        self._decoders = Decoders(self._skipped)
        self._qos = {'': []}  # by YAML text
        if not self.path.exists():
            raise ValueError(f'{self.path} does not exist; give the folder of a log, or of its '
                             'night')

    @property
    def message_count(self):
        """Number of messages, from the index or a scan."""
        return sum(topic.count for topic in self.topics)

    @property
    def has_truth(self):
        """Whether it has a topic of the simulator's truth; calibration must refuse such a bag."""
        return any(is_truth(topic.name) for topic in self.topics)

    @property
    def problems(self):
        """Problems of the log, list of str; may grow while messages are read."""
        return self._problems + [
            f'{what} ({count} times)' if count > 1 else what
            for what, count in self._skipped.items()]

    def schema_of(self, topic, type_name):
        """(`mcap` Schema, message encoding) of a topic's type; (None, '') if there is none."""
        key = topic, type_name
        if key not in self._schemas:
            self._schemas[key] = self._find_schema(*key)
        return self._schemas[key]

    def decode(self, message):
        """The decoded object of a raw `BagMessage` of this log; None if it does not fit the schema.

        Returns
        -------
        object or None
        """
        schema, encoding = self.schema_of(message.topic, message.type)
        return self._decoders.decode(message.topic, schema, encoding, message.data)

    def messages(self, topics=None, start=None, end=None, decode=False):
        """Messages in order of log time (equal times: in the order of the file).

        Parameters
        ----------
        topics : str or list of str, optional
            Only these.
        start, end : int, optional
            Only log times in [start, end), ns since 1970.
        decode : bool
            Return Python objects (by ``mcap_ros2``) instead of bytes. Messages that do not fit
            their schema are left out and counted in `problems`.

        Yields
        ------
        BagMessage
            topic, type, data, log_time, publish_time, sequence. SQLite files of rosbag2 hold only
            one time: ``publish_time`` is ``log_time``.
        """
        wanted = None if topics is None else {topics} if isinstance(topics, str) else set(topics)
        room = MIN_EXPANDED + EXPANSION * sum(file.stat().st_size for file in self.files)
        for (topic, type_name, schema), (log_time, publish_time, data, sequence) in self._stored(
                wanted, start or 0, 2**64 if end is None else end):
            if data[:4] == PACKED:
                data = self._unpacked(topic, data, room)
                room -= len(data or b'')
            if decode and data is not None:
                data = self._decoders.decode(
                    topic, *(schema or self.schema_of(topic, type_name)), data)
            if data is not None:
                yield BagMessage(topic, type_name, data, log_time, publish_time, sequence)

    def _stored(self, wanted, low, high):
        """Stored messages of the topics `wanted` (None: all) with log times in [low, high).

        Yields
        ------
        topic, type name, and schema and encoding (None: by `schema_of`)
        log time, publish time, data, sequence
        """
        raise NotImplementedError

    def _unpacked(self, topic, data, most):
        with suppress(ValueError, zstandard.ZstdError):
            size = zstandard.frame_content_size(data)
            if 0 <= size <= most:
                return decompress(data, 'zstd', size)
        self._skipped[f'{topic}: a message that cannot be unpacked left out'] += 1
        return None

    def _check_times(self):
        wrong = implausible(self.start_time, self.end_time)
        if wrong:
            self._problems.append(wrong)

    def _find(self):
        """The files in the order of metadata.yaml, then those that it does not list."""
        if not self.path.is_dir():
            if self.path.suffix == PACKED_FILE:
                raise ValueError(f'{self.path} is packed; unpack it first: zstd -d {self.path}')
            return [self.path]
        self._listed, problem = listed_files(self.path)
        if problem:
            self._problems.append(problem)
        files = []
        for name, row in self._listed.items():
            file = self.path / name
            if file.suffix == self.SUFFIX and file.is_file():
                files.append(file)
            else:
                self._problems.append(f'{name} is listed in metadata.yaml but missing' + (
                    f', with {counted(row.count, True)} {span(row.start, row.end)}'
                    if row.count else ''))
        found = sorted(self.path.glob(f'*{self.SUFFIX}'), key=_natural)
        files += [file for file in found if file not in files and file.is_file()]
        if not files:
            names = sorted(one.name for one in self.path.iterdir() if one.is_file())[:3]
            if any(name.endswith(PACKED_FILE) for name in names):
                raise ValueError(f'{self.path} holds packed files; unpack them first: '
                                 f'zstd -d {self.path}/*{PACKED_FILE}')
            raise ValueError(f'{self.path} holds no {self.SUFFIX} file'
                             + (f'; to read another, name it: {", ".join(names)}' if names else ''))
        return files

    def _compare_with_metadata(self, found):
        """Report differences between files, dict of str to `Listed`, and metadata.yaml."""
        for name, row in found.items() if self._listed else ():
            if name not in self._listed:
                self._problems.append(
                    f'{name} is not listed in metadata.yaml: {counted(row.count, True)} more'
                    + f', {span(row.start, row.end)}' * bool(row.count)
                    + '; if it is not of this log, move it away')
        both = [name for name in found if self._listed.get(name, NOTHING).count]
        # a message may be in another file than listed
        if sum(found[name].count - self._listed[name].count for name in both) == 0:
            return
        for name in both:
            count, listed = found[name].count, self._listed[name].count
            if count != listed:
                self._problems.append(
                    f'{name} has {counted(count, True)}, metadata.yaml lists {listed}: '
                    + (f'{listed - count} are missing'
                       if count < listed else f'{count - listed} more'))

    def _qos_of(self, topic, text):
        if text not in self._qos:
            try:
                self._qos[text] = load_qos(text)
            except ValueError as error:
                self._qos[text] = []
                if len(self._problems) < 200:
                    self._problems.append(f'{topic}: QoS text not understood ({short(error)})')
        return self._qos[text]


class Decoders:
    """Decoders by schema.

    Parameters
    ----------
    skipped : Counter
        Gets a line for anything that cannot be decoded, with its count.
    """

    def __init__(self, skipped):
        self._skipped = skipped
        self._decoders = {}

    def decode(self, topic, schema, encoding, data):
        """The message, or None if it does not fit its schema."""
        key = (schema.name, schema.data) if schema else None
        if key not in self._decoders:
            self._decoders[key] = self._make(topic, schema, encoding)
        decoder = self._decoders[key]
        if decoder is None:
            self._skipped[f'{topic}: messages that cannot be decoded left out'] += 1
            return None
        try:
            return decoder(_Bounded(data))
        except Exception:  # foreign bytes can raise anything
            self._skipped[f'{topic}: a message that does not fit its schema left out'] += 1
            return None

    def _make(self, topic, schema, encoding):
        from mcap_ros2.decoder import DecoderFactory
        try:
            text = schema.data.decode() if schema is not None else ''
            if len(text) > MAX_DEFINITION or max(map(len, text.splitlines()), default=0) > MAX_LINE:
                raise ValueError(f'a definition of {len(text)} characters')
            # the parser prints its complaints
            with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
                return DecoderFactory().decoder_for(encoding, schema)
        except Exception as error:  # the schema is foreign text
            self._skipped[f'{topic}: schema not understood ({short(error)})'] = 1
            return None


class _Bounded(bytes):
    """Bytes that raise an error on slices beyond their end.

    The decoder slices strings and arrays out of a message without checking its length, and so could
    loop forever over an array whose elements take no bytes.
    """

    def __getitem__(self, key):
        if type(key) is slice and key.stop is not None and key.stop > len(self):
            raise ValueError('the message ends before its content')
        return super().__getitem__(key)
