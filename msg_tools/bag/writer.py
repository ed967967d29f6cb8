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

"""Writes a log: a folder of MCAP files that is a valid rosbag2 bag.

The writer of `mcap` takes 2.4 times as long per message and compresses in the recording thread
(`benchmarks/log_speed.py`). This writer can be removed when that one passes finished chunks to
another thread.
"""

import os
import re
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from .. import version_of
from .chunks import CHUNK_SIZE, NEVER, McapFile
from .compression import COMPRESSORS, DEFAULT_COMPRESSION
from .metadata import information, sync_folder, write_metadata
from .ros_schema import dump_yaml, message_definition, qos_dict, split_type, type_hash

#: name of the MCAP metadata record with the user's own key-value pairs
OWN_RECORD = 'telescope_mount'
#: name of the record with the number of latched messages repeated at the start of a file
REPEATED_RECORD = 'telescope_mount_repeated'
#: name of the record with the reason why a log ended early
STOPPED_RECORD = 'telescope_mount_stopped'
#: seconds between updates of metadata.yaml during recording; readers do not need it
METADATA_PERIOD = 5.0


class _WriterTopic:
    __slots__ = ('channel', 'type', 'qos', 'hash', 'definition', 'encoding', 'before', 'kept')

    def __init__(self, type_name, qos, hash_, definition, encoding):
        self.channel = 0
        self.type = type_name
        self.qos = qos
        self.hash = hash_
        self.definition = definition
        self.encoding = encoding
        self.before = 0  # messages in the files closed before
        depths = [profile['depth'] for profile in qos
                  if profile['durability'] == 'transient_local']
        self.kept = deque(maxlen=max(1, *depths)) if depths else None


class BagWriter:
    """Writes a log folder that rosbag2, rosbags, the mcap tools and Foxglove can open.

    Parameters
    ----------
    folder : str or Path
        Created here; must not exist or must be empty.
    metadata : dict of str to str, optional
        Written immediately as an MCAP metadata record `OWN_RECORD`, so that a crash preserves it,
        and as ``custom_data`` of the bag.
    chunk_size : int
        Bytes (before compression) after which a chunk is closed.
    chunk_seconds : float
        Age at which a chunk is closed by the next message; without messages `refresh` closes it.
    compression : str
        One of `compression.COMPRESSORS`.
    max_bytes : int
        Most bytes of a file (without its index) before a new one is started; 0: no limit.
    max_seconds : float
        Longest log time of a file before a new one is started; 0: no limit.

    Attributes
    ----------
    message_count : int
        Messages written so far, without those repeated at the start of a file.

    Raises
    ------
    ValueError
        The folder is not empty, or an argument is unknown.
    OSError
        The folder cannot be created or written.

    Notes
    -----
    A crash loses the open chunk, a power failure also the data not synced yet: with `refresh` every
    `chunk_seconds`, at most that time plus the duration of a sync.

    Each file starts with the last messages of latched topics, counted in a record
    `REPEATED_RECORD`: so it can be used alone; `BagReader` skips them if it also has the previous
    file.
    """

    def __init__(self, folder, *, metadata=None, chunk_size=CHUNK_SIZE, chunk_seconds=0.5,
                 compression=DEFAULT_COMPRESSION, max_bytes=0, max_seconds=0.0):
        self.folder = Path(folder)
        if compression not in COMPRESSORS:
            raise ValueError(
                f'compression {compression!r} is unknown; use one of {", ".join(COMPRESSORS)}')
        if self.folder.exists() and not self.folder.is_dir():
            raise ValueError(f'{self.folder} is a file; give a folder for the log')
        if self.folder.is_dir() and any(self.folder.iterdir()):
            raise ValueError(f'{self.folder} is not empty; give another folder or remove it')
        self._stem = self.folder.resolve().name
        self.folder.mkdir(parents=True, exist_ok=True)
        self.custom_data = {str(k): str(v) for k, v in (metadata or {}).items()}
        self._records = {OWN_RECORD: self.custom_data} if self.custom_data else {}
        self._options = {'chunk_size': chunk_size, 'compression': compression}
        self._chunk_age = float(chunk_seconds)
        self._max_bytes = max_bytes or 2**63
        self._max_span = round(max_seconds * 1e9) or NEVER
        self._topics = {}
        self._done = []  # (name, first, last, count) of the files closed before
        self.message_count = 0
        self._error = None
        self._pool = self._syncing = None
        self._metadata_at = 0.0
        self._open()
        self.refresh()

    # --- files ------------------------------------------------------------------------------

    def _open(self):
        self.file = self.folder / f'{self._stem}_{len(self._done)}.mcap'
        library = f'telescope_mount {version_of() or "source tree"}'
        self._out = McapFile(self.file, library, **self._options)
        self._add = self._out.add
        self._begun = 0.0  # when the chunk got its first message
        self._first = NEVER
        self._in_file = 0
        self._schemas = {}
        for name, data in self._records.items():
            self._out.add_metadata(name, data)
        for topic, entry in self._topics.items():
            self._declare(topic, entry)
        sync_folder(self.folder)

    def _declare(self, topic, entry):
        if entry.type not in self._schemas:
            self._schemas[entry.type] = self._out.add_schema(
                entry.type, entry.definition, entry.encoding)
        entry.channel = self._out.add_channel(topic, self._schemas[entry.type], {
            'offered_qos_profiles': dump_yaml(entry.qos).rstrip('\n'),
            'topic_type_hash': entry.hash})

    def split(self, log_time_ns=None):
        """Continue in a new file, which starts with the last messages of latched topics.

        Parameters
        ----------
        log_time_ns : int, optional
            Log time of these messages; that of the newest message by default.
        """
        self._check_open()
        self._guard(self._split, log_time_ns)

    def _split(self, log_time_ns):
        self._wait_for_sync()
        self._out.close_chunk()
        when = log_time_ns if log_time_ns is not None else self._out.last
        self._close_file()
        self._open()
        kept = {topic: entry for topic, entry in self._topics.items() if entry.kept}
        if kept:
            self._out.add_metadata(
                REPEATED_RECORD, {topic: str(len(entry.kept)) for topic, entry in kept.items()})
            for entry in kept.values():
                for data, publish_time, sequence in entry.kept:
                    self._add(entry.channel, data, when, publish_time, sequence)
            self._out.close_chunk()
        self._write_metadata()

    def _close_file(self):
        out = self._out
        out.close_chunk()
        out.add_metadata('rosbag2', {'serialized_metadata': dump_yaml(
            self._information()).rstrip('\n')})
        out.finish()
        self._done.append((self.file.name, out.first, out.last, sum(out.counts.values())))
        for entry in self._topics.values():
            entry.before += out.counts[entry.channel]
            entry.channel = 0

    def _information(self):
        out = self._out
        counts = {} if out.closed else out.counts
        files = list(self._done)
        if not out.closed:
            files.append((self.file.name, out.first, out.last, sum(counts.values())))
        return information(
            [(topic, entry.type, entry.qos, entry.hash,
              entry.before + counts.get(entry.channel, 0))
             for topic, entry in self._topics.items()], files, self.custom_data)

    def _write_metadata(self):
        self._metadata_at = time.monotonic()
        write_metadata(self.folder, self._information())

    # --- content ----------------------------------------------------------------------------

    def _check_open(self):
        if self._error:
            raise OSError(f'{self.file} failed before; nothing more can be written to it')
        if self._out.closed:
            raise ValueError(f'{self.file} is closed')

    def add_topic(self, topic, type_name, offers=(), hash_=None):
        """Declare a topic; a second call with the same type changes nothing.

        Parameters
        ----------
        topic : str
            Full name, as ``/mount/offset``.
        type_name : str
            ``package/msg/Type``.
        offers : sequence of dict or QoSProfile
            QoS offered by the publishers (`qos_dict`).
        hash_ : str, optional
            Type hash from an endpoint; by default that of the installed type.

        Raises
        ------
        ValueError
            The type is not installed, or the topic already has another type.
        """
        type_name = '{}/msg/{}'.format(*split_type(type_name))
        self.add_foreign_topic(
            topic, type_name, [qos_dict(profile) for profile in offers], hash_=hash_)

    def add_foreign_topic(self, topic, type_name, qos, definition=None, hash_=None,
                          encoding='ros2msg'):
        """Like `add_topic`, for a type that need not be installed.

        Parameters
        ----------
        topic, type_name : str
        qos : list of dict
            See `qos_dict`.
        definition : bytes, optional
            Schema recorded with the data.
        hash_ : str, optional
            Type hash, empty if there is none; by default that of the installed type.
        encoding : str
            Encoding of the schema.
        """
        self._check_open()
        if topic in self._topics:
            if self._topics[topic].type != type_name:
                raise ValueError(
                    f'topic {topic} is recorded as {self._topics[topic].type}, not as '
                    f'{type_name}')
            return
        hash_ = type_hash(type_name) if hash_ is None else hash_
        if definition is None:
            definition = message_definition(type_name).encode()
        entry = _WriterTopic(type_name, qos, hash_, definition, encoding)
        self._guard(self._declare, topic, entry)
        self._topics[topic] = entry

    def write(self, topic, data, log_time_ns, publish_time_ns, sequence=0):
        """Append one message.

        Parameters
        ----------
        topic : str
            Must have been added.
        data : bytes
            Serialized message with its CDR header, stored unchanged.
        log_time_ns, publish_time_ns : int
            Receive time and source time, ns since 1970.
        sequence : int
            Publication sequence number (its lower 32 bits are kept), 0 if unknown.

        Raises
        ------
        ValueError
            Unknown topic, a time below 0 or above 2**63 - 1, or the bag is closed.
        OSError
            The disk failed; earlier messages remain readable.
        """
        entry = self._topics.get(topic)
        if entry is None:
            raise ValueError(f'topic {topic!r} was not added to {self.file}')
        out = self._out
        if self._error or out.closed:
            self._check_open()
        if not (0 <= log_time_ns <= NEVER and 0 <= publish_time_ns <= NEVER):
            raise ValueError(
                f'{topic}: time {log_time_ns}, {publish_time_ns} ns is outside 0..2**63-1')
        if type(data) is not bytes:
            data = memoryview(data).tobytes()
        sequence &= 0xFFFFFFFF
        try:
            if self._in_file:
                if (out.size + out.pending + len(data) > self._max_bytes
                        or log_time_ns - self._first >= self._max_span):
                    self._split(log_time_ns)
                elif out.pending and time.monotonic() - self._begun >= self._chunk_age:
                    out.close_chunk()
            if not self._in_file:
                self._first = log_time_ns
            if not self._out.pending:
                self._begun = time.monotonic()
            self._add(entry.channel, data, log_time_ns, publish_time_ns, sequence)
        except OSError as error:
            self._error = error
            raise
        self._in_file += 1
        self.message_count += 1
        if entry.kept is not None:
            entry.kept.append((data, publish_time_ns, sequence))

    def add_metadata(self, name, data):
        """Write an MCAP metadata record of str to str, into this file and all later ones."""
        self._check_open()
        self._records[name] = {str(k): str(v) for k, v in data.items()}
        self._guard(self._out.add_metadata, name, self._records[name])

    def add_attachment(self, name, media_type, data):
        """Append an attachment, for instance the model of the night.

        Parameters
        ----------
        name : str
            A plain file name.
        media_type : str
            For instance ``application/json``.
        data : bytes
        """
        self._check_open()
        plain_name(name)
        self._guard(self._out.add_attachment, name, media_type, bytes(data))

    # --- to the disk ------------------------------------------------------------------------

    def refresh(self, wait=True):
        """Close the chunk, sync everything to the disk and update metadata.yaml.

        Parameters
        ----------
        wait : bool
            False: write now, but sync in another thread, and update metadata.yaml only rarely.
        """
        self._check_open()
        self._guard(self._sync if wait else self._sync_soon)

    def _sync(self):
        self._wait_for_sync()
        self._out.close_chunk()
        self._out.sync()
        self._write_metadata()

    def _sync_soon(self):
        self._out.close_chunk()
        if self._syncing is not None:
            if not self._syncing.done():
                return  # the disk is slow; the next sync includes this chunk
            self._wait_for_sync()
        info = None
        if time.monotonic() - self._metadata_at >= METADATA_PERIOD:
            self._metadata_at = time.monotonic()
            info = self._information()
        if self._pool is None:
            self._pool = ThreadPoolExecutor(1, 'bag')
        self._syncing = self._pool.submit(_sync_file, self._out.duplicate(), self.folder, info)

    def _wait_for_sync(self):
        if self._syncing is not None:
            syncing, self._syncing = self._syncing, None
            syncing.result()

    def _guard(self, call, *args):
        try:
            return call(*args)
        except OSError as error:
            self._error = error
            raise

    def close(self):
        """Write index, statistics and metadata.yaml. A second call does nothing.

        Raises
        ------
        OSError
            The disk failed; earlier messages remain readable.
        """
        if self._out.closed:
            return
        try:
            if self._error is None:
                self._guard(self._finish)
            else:
                self._finish_failed()
        finally:
            self._out.close()
            if self._pool is not None:
                self._pool.shutdown()

    def _finish(self):
        self._wait_for_sync()
        self._close_file()
        self._write_metadata()

    def _finish_failed(self):
        """After an error: the space for the chunk that did not fit often suffices for the index."""
        try:
            self._out.add_metadata(STOPPED_RECORD, {'reason': str(self._error)})
            self._close_file()
            self._write_metadata()
        except OSError:
            pass  # already reported; the messages are readable without an index

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.close()


def _sync_file(number, folder, info):
    try:
        os.fsync(number)
    finally:
        os.close(number)
    if info is not None:
        write_metadata(folder, info)


def plain_name(name):
    """Return `name` if it is a file name without a path, else raise ValueError."""
    if not name or name in ('.', '..') or re.search(r'[/\\:\x00-\x1f]', name):
        raise ValueError(f'attachment name {name!r} is not a plain file name')
    return name
