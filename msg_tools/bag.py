"""Logs in the layout of rosbag2: a folder with ``metadata.yaml`` and MCAP files.

Writing takes messages as the bytes that came from the wire, so a recorder never rebuilds them.
Reading needs no ROS and no index: what a crash left behind is read as far as it goes, and
`BagReader.problems` says how far that was.
"""

import bisect
import heapq
import importlib.util
import json
import os
import re
import struct
import sys
import time
import zlib
from collections import Counter
from contextlib import ExitStack
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from io import BytesIO
from pathlib import Path, PurePath
from typing import NamedTuple

import lz4.frame
import yaml
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

try:
    from yaml import CSafeDumper as _Dumper
    from yaml import CSafeLoader as _Loader
except ImportError:  # PyYAML built without libyaml
    from yaml import SafeDumper as _Dumper
    from yaml import SafeLoader as _Loader

METADATA_VERSION = 9
METADATA_FILE = 'metadata.yaml'
#: name of the MCAP metadata record that carries the user's own key-value pairs
OWN_RECORD = 'telescope_mount'
MAGIC = b'\x89MCAP0\r\n'
#: a chunk that claims more than this is not believed (the usual size is 1 MiB)
MAX_CHUNK = 256 * 2**20
#: metadata and attachment records above this are left alone
MAX_RECORD = 1024 * 2**20
NEVER = 2**63 - 1  # what rosbag2 writes as the starting time of an empty bag

_COMPRESSIONS = {
    'zstd': CompressionType.ZSTD, 'lz4': CompressionType.LZ4, 'none': CompressionType.NONE,
}
_SEPARATOR = '=' * 80
_PRIMITIVES = frozenset((
    'bool', 'byte', 'char', 'float32', 'float64', 'int8', 'uint8', 'int16', 'uint16', 'int32',
    'uint32', 'int64', 'uint64', 'string', 'wstring',
))
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}
# names by the numbers of rmw/types.h, which metadata before version 9 holds
_POLICIES = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown', 'best_available'),
    'liveliness': (
        'system_default', 'automatic', 'manual_by_node', 'manual_by_topic', 'unknown',
        'best_available',
    ),
}
_DURATIONS = ('deadline', 'lifespan', 'liveliness_lease_duration')
_QOS_ORDER = (
    'history', 'depth', 'reliability', 'durability', 'deadline', 'lifespan', 'liveliness',
    'liveliness_lease_duration', 'avoid_ros_namespace_conventions',
)
_QOS_DEFAULT = {
    'history': 'keep_last', 'depth': 10, 'reliability': 'reliable', 'durability': 'volatile',
    'deadline': _INFINITE, 'lifespan': _INFINITE, 'liveliness': 'automatic',
    'liveliness_lease_duration': _INFINITE, 'avoid_ros_namespace_conventions': False,
}
_PARSE_ERRORS = (
    struct.error, McapError, ValueError, KeyError, IndexError, EOFError, MemoryError,
    OverflowError,
)


# ---------------------------------------------------------------- types and quality of service

def _prefixes(package):
    """Folders that may hold ``share/<package>``: the ament index first, then the wheels."""
    found = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    found.append(sys.prefix)
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        spec = None
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        # <prefix>/lib/python3.x/site-packages/<package>
        parents = Path(folder).parents
        if len(parents) > 3:
            found.append(str(parents[3]))
    return tuple(dict.fromkeys(found))


def _split_type(type_name):
    match = re.fullmatch(r'([A-Za-z]\w*)/(?:msg/)?([A-Za-z]\w*)', type_name)
    if match is None:
        raise ValueError(
            f'message type {type_name!r} is not of the form package/msg/Type')
    return match.groups()


@cache
def _read_share(package, name, suffix, prefixes):
    for prefix in prefixes:
        file = Path(prefix, 'share', package, 'msg', name + suffix)
        if file.is_file():
            return file.read_text(encoding='utf-8')
    return None


def _message_text(type_name):
    package, name = _split_type(type_name)
    text = _read_share(package, name, '.msg', _prefixes(package))
    if text is None:
        raise ValueError(
            f'message type {type_name}: no share/{package}/msg/{name}.msg found; install or '
            f'source the package {package}')
    return text


def _dependencies(text, package):
    found = set()
    for line in text.splitlines():
        line = line.split('#', 1)[0].strip()
        if not line:
            continue
        kind = re.match(r'[\w/]+', line)
        kind = kind.group() if kind else ''
        if kind and kind not in _PRIMITIVES:
            found.add(kind if '/' in kind else f'{package}/{kind}')
    return sorted(found)


@cache
def message_definition(type_name):
    """Full text of a message definition: the type, then all that it needs.

    Parameters
    ----------
    type_name : str
        ``package/msg/Type``.

    Returns
    -------
    str
        The ``ros2msg`` schema as rosbag2 writes it: every dependency once, after a line of 80
        ``=`` and a line ``MSG: package/Type``.

    Raises
    ------
    ValueError
        The type, or one that it needs, is not installed.
    """
    seen = set()

    def full(name):
        text = _message_text(name)
        for dependency in _dependencies(text, _split_type(name)[0]):
            if dependency not in seen:
                seen.add(dependency)
                text += f'\n{_SEPARATOR}\nMSG: {dependency}\n{full(dependency)}'
        return text

    return full(type_name)


@cache
def type_hash(type_name):
    """RIHS01 hash of a message type, as its package was built with.

    Parameters
    ----------
    type_name : str
        ``package/msg/Type``.

    Returns
    -------
    str
        ``RIHS01_...``; empty where the package carries none (before ROS 2 Iron), as rosbag2
        does.
    """
    package, name = _split_type(type_name)
    text = _read_share(package, name, '.json', _prefixes(package))
    entries = json.loads(text)['type_hashes'] if text else ()
    full_name = f'{package}/msg/{name}'
    return next((e['hash_string'] for e in entries if e['type_name'] == full_name), '')


def qos_dict(profile):
    """A QoS profile as metadata version 9 holds it: names as strings, times in sec and nsec.

    Parameters
    ----------
    profile : dict or rclpy QoSProfile
        A dict may leave keys out; policies are strings, enum members or rmw numbers, durations
        ``{'sec', 'nsec'}``, nanoseconds or objects with ``nanoseconds``.

    Returns
    -------
    dict

    Raises
    ------
    ValueError
        An unknown policy.
    """
    out = {}
    for key in _QOS_ORDER:
        if isinstance(profile, dict):
            value = profile.get(key)
        else:
            value = getattr(profile, key, None)
        if value is None:
            value = _QOS_DEFAULT[key]
        if key in _POLICIES:
            names = _POLICIES[key]
            # enum members of rclpy are ints too: the name decides
            text = value if isinstance(value, str) else getattr(value, 'name', None)
            if text is None and isinstance(value, int) and 0 <= value < len(names):
                text = names[value]
            text = str(text if text is not None else value).lower()
            if text not in names:
                raise ValueError(
                    f'QoS {key} {value!r} is unknown; use one of {", ".join(names)}')
            out[key] = text
        elif key in _DURATIONS:
            if isinstance(value, dict):
                out[key] = {'sec': int(value['sec']), 'nsec': int(value['nsec'])}
            else:
                sec, nsec = divmod(int(getattr(value, 'nanoseconds', value)), 10**9)
                out[key] = {'sec': sec, 'nsec': nsec}
        else:
            out[key] = type(_QOS_DEFAULT[key])(value)
    return out


class _PlainDumper(_Dumper):
    """No anchors: yaml-cpp writes none, and two equal durations are no reference."""

    def ignore_aliases(self, data):
        return True


def _dump(document):
    return yaml.dump(
        document, Dumper=_PlainDumper, default_flow_style=False, sort_keys=False, width=10**6)


def _load_qos(text):
    profiles = yaml.load(text, Loader=_Loader) if isinstance(text, str) else text
    return [qos_dict(p) for p in profiles or ()]


def _library():
    try:
        own = version('telescope_mount')
    except PackageNotFoundError:
        own = 'source tree'
    return f'telescope_mount {own} (mcap {version("mcap")})'


# ------------------------------------------------------------------------------------- writing

class _Topic:
    __slots__ = ('channel', 'type', 'qos', 'hash', 'count')

    def __init__(self, channel, type_name, qos, hash_):
        self.channel = channel
        self.type = type_name
        self.qos = qos
        self.hash = hash_
        self.count = 0


class BagWriter:
    """Write a log folder that rosbag2, rosbags, the mcap tools and Foxglove open as their own.

    Parameters
    ----------
    folder : str or Path
        Made here; must not exist or be empty.
    name : str, optional
        Stem of the file ``<name>_0.mcap``; the folder's name by default.
    metadata : dict of str to str, optional
        Written as an MCAP metadata record `OWN_RECORD` at once, so that a crash keeps it, and
        as ``custom_data`` of the bag.
    chunk_size : int
        Bytes (before compression) after which a chunk is closed.
    compression : {'zstd', 'lz4', 'none'}

    Raises
    ------
    ValueError
        The folder is in use, or an argument is unknown.
    OSError
        The folder cannot be made or written.

    Notes
    -----
    What is in a chunk that is not closed yet is lost in a crash: call `refresh` as often as
    the loss may be long.
    """

    def __init__(self, folder, *, name=None, metadata=None, chunk_size=2**20,
                 compression='zstd'):
        self.folder = Path(folder)
        if compression not in _COMPRESSIONS:
            raise ValueError(
                f'compression {compression!r} is unknown; use one of {", ".join(_COMPRESSIONS)}')
        if self.folder.exists() and not self.folder.is_dir():
            raise ValueError(f'{self.folder} is a file; give a folder for the log')
        if self.folder.is_dir() and any(self.folder.iterdir()):
            raise ValueError(f'{self.folder} is not empty; give another folder or remove it')
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = name or self.folder.resolve().name
        if stem != PurePath(stem).name:
            raise ValueError(f'name {stem!r} of a log must be a plain file name')
        self.file = self.folder / f'{stem}_0.mcap'
        self.custom_data = {str(k): str(v) for k, v in (metadata or {}).items()}
        self._topics = {}
        self._schemas = {}
        self._first = NEVER
        self._last = 0
        self._failed = False
        self._stream = open(self.file, 'xb')  # noqa: SIM115 (lives as long as the writer)
        self._writer = Writer(
            self._stream, chunk_size=int(chunk_size), compression=_COMPRESSIONS[compression])
        self._writer.start(profile='ros2', library=_library())
        if self.custom_data:
            self._writer.add_metadata(OWN_RECORD, self.custom_data)
        self.refresh()

    @property
    def message_count(self):
        """Messages written so far."""
        return sum(topic.count for topic in self._topics.values())

    @property
    def topics(self):
        """Names of the topics added so far."""
        return list(self._topics)

    def _check_open(self):
        if self._failed:
            raise OSError(f'{self.file} failed before; nothing more can be written to it')
        if self._stream.closed:
            raise ValueError(f'{self.file} is closed')

    def add_topic(self, topic, type_name, qos_profile=()):
        """Declare a topic; a second call with the same type changes nothing.

        Parameters
        ----------
        topic : str
            Full name, as ``/mount/offset``.
        type_name : str
            ``package/msg/Type``.
        qos_profile : list or one of dict or QoSProfile
            What the publishers offer (`qos_dict`).

        Raises
        ------
        ValueError
            The type is not installed, or the topic is there with another type.
        """
        self._check_open()
        type_name = '{}/msg/{}'.format(*_split_type(type_name))
        if topic in self._topics:
            if self._topics[topic].type != type_name:
                raise ValueError(
                    f'topic {topic} is recorded as {self._topics[topic].type}, not as '
                    f'{type_name}')
            return
        if not isinstance(qos_profile, list | tuple):
            qos_profile = [qos_profile]
        qos = [qos_dict(profile) for profile in qos_profile]
        hash_ = type_hash(type_name)
        if type_name not in self._schemas:
            definition = message_definition(type_name).encode()
            self._schemas[type_name] = self._writer.register_schema(
                name=type_name, encoding='ros2msg', data=definition)
        channel = self._writer.register_channel(
            topic=topic, message_encoding='cdr', schema_id=self._schemas[type_name],
            metadata={'offered_qos_profiles': _dump(qos).rstrip('\n'), 'topic_type_hash': hash_})
        self._topics[topic] = _Topic(channel, type_name, qos, hash_)

    def write(self, topic, data, log_time_ns, publish_time_ns, sequence=0):
        """Append one message.

        Parameters
        ----------
        topic : str
            Added before.
        data : bytes
            The serialized message with its CDR header, stored as it is.
        log_time_ns, publish_time_ns : int
            Receive time and source time, ns since 1970.
        sequence : int
            Publication sequence number (its lower 32 bits are kept), 0 if unknown.

        Raises
        ------
        ValueError
            Unknown topic, a time below 0 or above 2**63 - 1, or the bag is closed.
        OSError
            The disk refused; what was written before stays readable.
        """
        entry = self._topics.get(topic)
        if entry is None:
            raise ValueError(f'topic {topic!r} was not added to {self.file}')
        if self._failed or self._stream.closed:
            self._check_open()
        if not (0 <= log_time_ns <= NEVER and 0 <= publish_time_ns <= NEVER):
            raise ValueError(
                f'{topic}: time {log_time_ns}, {publish_time_ns} ns is outside 0..2**63-1')
        if type(data) is not bytes:
            data = memoryview(data).tobytes()
        try:
            self._writer.add_message(
                entry.channel, log_time_ns, data, publish_time_ns, sequence & 0xFFFFFFFF)
        except OSError:
            self._failed = True
            raise
        entry.count += 1
        if log_time_ns < self._first:
            self._first = log_time_ns
        if log_time_ns > self._last:
            self._last = log_time_ns

    def add_metadata(self, name, data):
        """Append an MCAP metadata record of str to str."""
        self._check_open()
        self._guard(
            self._writer.add_metadata, name, {str(k): str(v) for k, v in data.items()})

    def add_attachment(self, name, media_type, data):
        """Append an attachment, as the model of the night or the scenario.

        Parameters
        ----------
        name : str
            A plain file name.
        media_type : str
            As ``application/json``.
        data : bytes
        """
        self._check_open()
        _plain_name(name)
        now = time.time_ns()
        self._guard(self._writer.add_attachment, now, now, name, media_type, bytes(data))

    def refresh(self):
        """Close the chunk, put all on the disk and bring metadata.yaml up to date."""
        self._check_open()
        self._guard(self._sync)

    def _sync(self):
        self._writer.flush()
        os.fsync(self._stream.fileno())
        self._write_metadata()

    def _guard(self, call, *args):
        try:
            return call(*args)
        except OSError:
            self._failed = True
            raise

    def _information(self):
        count = self.message_count
        start = {'nanoseconds_since_epoch': self._first}
        duration = {'nanoseconds': self._last - self._first if count else 0}
        return {
            'version': METADATA_VERSION,
            'storage_identifier': 'mcap',
            'duration': duration,
            'starting_time': start,
            'message_count': count,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic,
                        'type': entry.type,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': entry.qos,
                        'type_description_hash': entry.hash,
                    },
                    'message_count': entry.count,
                }
                for topic, entry in self._topics.items()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self.file.name],
            'files': [
                {
                    'path': self.file.name,
                    'starting_time': start,
                    'duration': duration,
                    'message_count': count,
                },
            ],
            'custom_data': self.custom_data or None,
            'ros_distro': os.environ.get('ROS_DISTRO', 'jazzy'),
        }

    def _write_metadata(self):
        text = _dump({'rosbag2_bagfile_information': self._information()})
        temporary = self.folder / f'.{METADATA_FILE}.tmp'
        with open(temporary, 'w', encoding='utf-8') as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, self.folder / METADATA_FILE)

    def close(self):
        """Write index, statistics and metadata.yaml. A second call does nothing.

        Raises
        ------
        OSError
            The disk refused; what was written before stays readable.
        """
        if self._stream.closed:
            return
        try:
            if not self._failed:
                self._guard(self._finish)
        finally:
            try:
                self._stream.close()
            except OSError:  # a full disk again; it was reported when it was first met
                if not self._failed:
                    raise

    def _finish(self):
        self._writer.add_metadata(
            'rosbag2', {'serialized_metadata': _dump(self._information()).rstrip('\n')})
        self._writer.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._write_metadata()

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.close()


def _plain_name(name):
    """`name` if it is a file name without any path, else ValueError."""
    if not name or name in ('.', '..') or re.search(r'[/\\:\x00-\x1f]', name):
        raise ValueError(f'attachment name {name!r} is not a plain file name')
    return name


# ------------------------------------------------------------------------------------- reading

class Topic(NamedTuple):
    """A topic of a bag."""

    name: str
    type: str
    count: int
    qos: list
    type_hash: str


class BagMessage(NamedTuple):
    """One message; times in ns since 1970; `data` is bytes, or the decoded object."""

    topic: str
    type: str
    data: object
    log_time: int
    publish_time: int


class AttachmentInfo(NamedTuple):
    """An attachment of a bag: its bytes are at `offset` of `file`."""

    name: str
    media_type: str
    size: int
    log_time: int
    file: Path
    offset: int


class _Segment(NamedTuple):
    start: int
    order: tuple
    end: int
    file: object
    offset: int
    length: int
    chunk: bool  # a chunk record, else plain records
    partial: bool
    channels: frozenset


def _unpack_chunk(body):
    """Fields of a (perhaps cut) chunk record: uncompressed size, crc, compression, data."""
    size, crc, n = struct.unpack_from('<QII', body, 16)
    compression = bytes(body[32:32 + n]).decode()
    (length,) = struct.unpack_from('<Q', body, 32 + n)
    return size, crc, compression, body[40 + n:40 + n + length], length


def _decompress(data, compression, size):
    """At most `size` bytes of `data`; fewer where it was cut."""
    if size > MAX_CHUNK:
        raise ValueError(f'a chunk claims {size} bytes, more than {MAX_CHUNK}')
    if compression == '':
        return bytes(data[:size])
    try:
        if compression == 'zstd':
            with zstandard.ZstdDecompressor().stream_reader(data) as stream:
                return stream.read(size)
        if compression == 'lz4':
            return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise ValueError(f'{compression} data damaged: {error}') from None
    raise ValueError(f'chunk compression {compression!r} is unknown')


def _walk(buffer):
    """(opcode, start of the body, end) of every whole record in `buffer`."""
    pos, size = 0, len(buffer)
    while pos + 9 <= size:
        (length,) = struct.unpack_from('<Q', buffer, pos + 1)
        end = pos + 9 + length
        if end > size:
            return
        yield buffer[pos], pos + 9, end
        pos = end


def _at(stream, offset, length):
    stream.seek(offset)
    return stream.read(length)


def _parse(record, body):
    return record.read(ReadDataStream(BytesIO(body)))


class _File:
    """One MCAP file: its channels, and where its messages are."""

    def __init__(self, path, number):
        self.path = path
        self.number = number
        self.schemas = {}
        self.channels = {}
        self.counts = Counter()
        self.segments = []
        self.metadata = []
        self.attachments = []
        self.problems = []
        self.complete = False
        self.ended = False
        self.size = path.stat().st_size
        if self.size == 0:
            raise ValueError(f'{path} is empty (0 bytes): nothing was recorded in it')
        with open(path, 'rb') as stream:
            self.stream = stream
            if self._at(0, 8) != MAGIC[:self.size]:
                raise ValueError(f'{path} is not an MCAP file')
            try:
                self.complete = self._read_summary()
            except _PARSE_ERRORS as error:
                self._say(f'the index is damaged ({_short(error)}); the file was read through')
            if not self.complete:
                self._scan()
            self.stream = None

    def _say(self, text):
        self.problems.append(f'{self.path.name}: {text}')

    def _at(self, offset, length):
        return _at(self.stream, offset, length)

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
        statistics, chunks, attachments, metadata = None, [], [], []
        for opcode, begin, end in _walk(summary):
            body = summary[begin:end]
            if opcode == Opcode.STATISTICS:
                statistics = _parse(records.Statistics, body)
            elif opcode == Opcode.CHUNK_INDEX:
                chunks.append(_parse(records.ChunkIndex, body))
            elif opcode == Opcode.ATTACHMENT_INDEX:
                attachments.append(_parse(records.AttachmentIndex, body))
            elif opcode == Opcode.METADATA_INDEX:
                metadata.append(_parse(records.MetadataIndex, body))
            else:
                self._take(opcode, body)
        if statistics is None or (statistics.message_count and not chunks):
            return False  # written without an index: that is no damage
        for index in chunks:
            offset, length = index.chunk_start_offset, index.chunk_length
            if length < 9 or offset + length > self.size:
                raise ValueError('a chunk is said to lie outside the file')
            self._segment(
                index.message_start_time, index.message_end_time, offset + 9, length - 9,
                chunk=True, channels=frozenset(index.message_index_offsets))
        for channel in statistics.channel_message_counts:
            if channel not in self.channels:
                raise ValueError(f'channel {channel} is not described')
        self.counts.update(statistics.channel_message_counts)
        for index in [*attachments, *metadata]:
            head = self._at(index.offset, 9)
            opcode, length = struct.unpack('<BQ', head)
            self._take_large(opcode, index.offset + 9, length)
        return True

    def _segment(self, start, end, offset, length, *, chunk, partial=False,
                 channels=frozenset()):
        self.segments.append(_Segment(
            start, (self.number, len(self.segments)), end, self, offset, length, chunk, partial,
            channels))

    def _take(self, opcode, body):
        """Keep a schema or channel."""
        if opcode == Opcode.SCHEMA:
            schema = _parse(records.Schema, body)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = _parse(records.Channel, body)
            self.channels[channel.id] = channel

    def _take_large(self, opcode, offset, length):
        """Keep a metadata record, or note an attachment."""
        if length > MAX_RECORD or offset + length > self.size:
            raise ValueError('a record is larger than it can be')
        if opcode == Opcode.METADATA:
            self.metadata.append(_parse(records.Metadata, self._at(offset, length)))
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

    def _scan(self):
        """Read the file from its start to where it stops making sense."""
        self.schemas.clear()
        self.channels.clear()
        self.counts.clear()
        self.segments.clear()
        self.metadata.clear()
        self.attachments.clear()
        plain = None  # start, first time, last time, channels of a row of unchunked messages
        pos, closed = 8, False

        def end_plain(end):
            if plain is not None:
                begin, first, last, channels = plain
                self._segment(first, last, begin, end - begin, chunk=False,
                              channels=frozenset(channels))

        while pos + 9 <= self.size:
            opcode, length = struct.unpack('<BQ', self._at(pos, 9))
            offset, end = pos + 9, pos + 9 + length
            if opcode == Opcode.MESSAGE and end <= self.size and length >= 22:
                channel, _, log_time, _ = struct.unpack('<HIQQ', self._at(offset, 22))
                if plain is None:
                    plain = [pos, log_time, log_time, set()]
                plain[1] = min(plain[1], log_time)
                plain[2] = max(plain[2], log_time)
                plain[3].add(channel)
                self.counts[channel] += 1
                pos = end
                if end - plain[0] > 2**20:
                    end_plain(end)
                    plain = None
                continue
            end_plain(pos)
            plain = None
            if opcode == Opcode.DATA_END:
                closed = end <= self.size
                break
            if opcode == Opcode.CHUNK:
                self._scan_chunk(offset, min(length, self.size - offset), end > self.size)
            if opcode == 0 or end > self.size:
                break
            try:
                if opcode in (Opcode.METADATA, Opcode.ATTACHMENT):
                    self._take_large(opcode, offset, length)
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._take(opcode, self._at(offset, length))
            except _PARSE_ERRORS as error:
                self._say(f'a record at byte {pos} is damaged ({_short(error)}) and left out')
            pos = end
        end_plain(pos)
        if closed and self.ended:
            self.complete = not self.problems
        elif closed:
            self._say('the index at its end is cut off; the messages before it are whole')
        else:
            self._say(
                f'not closed: {sum(self.counts.values())} messages read up to byte '
                f'{min(pos, self.size)} of {self.size}')

    def _scan_chunk(self, offset, length, cut):
        try:
            buffer = self._chunk(self.stream, offset, length, cut)
        except _PARSE_ERRORS as error:
            if not cut:
                self._say(f'the chunk at byte {offset - 9} is damaged ({_short(error)}) '
                          'and left out')
            return
        counts, first, last = Counter(), NEVER, 0
        for opcode, begin, end in _walk(buffer):
            if opcode == Opcode.MESSAGE and end - begin >= 22:
                channel, _, log_time = struct.unpack_from('<HIQ', buffer, begin)
                counts[channel] += 1
                first, last = min(first, log_time), max(last, log_time)
            else:
                try:
                    self._take(opcode, buffer[begin:end])
                except _PARSE_ERRORS as error:
                    self._say(f'a record in the chunk at byte {offset - 9} is damaged '
                              f'({_short(error)}) and left out')
        if counts:
            self.counts.update(counts)
            self._segment(first, last, offset, length, chunk=True, partial=cut,
                          channels=frozenset(counts))

    @staticmethod
    def _chunk(stream, offset, length, partial):
        if length > MAX_CHUNK:
            raise ValueError(f'a chunk claims {length} bytes, more than {MAX_CHUNK}')
        body = _at(stream, offset, length)
        size, crc, compression, data, stored = _unpack_chunk(body)
        if len(data) < stored and not partial:
            raise ValueError('its data are longer than its record')
        buffer = _decompress(data, compression, size)
        if not partial:
            if len(buffer) != size:
                raise ValueError(f'{len(buffer)} bytes where {size} were announced')
            if crc and zlib.crc32(buffer) != crc:
                raise ValueError('its checksum does not match')
        return buffer

    def load(self, segment, stream):
        """The records of a segment, as bytes, read from `stream` (this file, open)."""
        if segment.chunk:
            return self._chunk(stream, segment.offset, segment.length, segment.partial)
        return _at(stream, segment.offset, segment.length)


def _short(error):
    text = str(error) or type(error).__name__
    return text.splitlines()[0][:120]


def _natural(path):
    """Sort key: night_2 before night_10."""
    return [int(t) if t.isdigit() else t for t in re.split(r'(\d+)', path.name)]


class BagReader:
    """Read a bag: a folder or one ``.mcap`` file, finished or not.

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
        Every file was closed properly.
    has_truth : bool
        A topic of the simulator's truth is in it; calibration must refuse such a bag.

    Raises
    ------
    ValueError
        Nothing that can be read as a log is there.
    OSError
        The path may not be read.
    """

    def __init__(self, path):
        self.path = Path(path)
        self._problems = []
        self._skipped = Counter()
        self._decoders = {}
        self._files = []
        for file in self._find():
            try:
                self._files.append(_File(file, len(self._files)))
            except ValueError as error:
                if file == self.path or len(self._candidates) == 1:
                    raise
                self._problems.append(str(error))
        if not self._files:
            raise ValueError(f'{self.path}: none of its files can be read as a log')
        for file in self._files:
            self._problems += file.problems
        self.files = [file.path for file in self._files]
        self.complete = all(file.complete for file in self._files)
        self.metadata = {
            record.name: record.metadata for file in self._files for record in file.metadata}
        self.attachments = [a for file in self._files for a in file.attachments]
        self.topics = self._merge_topics()
        self.has_truth = any('/truth/' in '/' + topic.name for topic in self.topics)
        segments = [s for file in self._files for s in file.segments]
        self.start_time = min((s.start for s in segments), default=None)
        self.end_time = max((s.end for s in segments), default=None)

    @property
    def message_count(self):
        """Messages that the index, or reading through, found."""
        return sum(topic.count for topic in self.topics)

    @property
    def problems(self):
        """What is wrong with the log, one str each; grows while messages are read."""
        return self._problems + [
            f'{what} ({count} times)' if count > 1 else what
            for what, count in self._skipped.items()]

    def _find(self):
        if not self.path.exists():
            raise ValueError(f'{self.path} does not exist')
        if not self.path.is_dir():
            self._candidates = [self.path]
            return self._candidates
        found = sorted(self.path.glob('*.mcap'), key=_natural)
        listed = []
        try:
            text = (self.path / METADATA_FILE).read_text(encoding='utf-8')
            document = yaml.load(text, Loader=_Loader)
            names = document['rosbag2_bagfile_information']['relative_file_paths']
            # before version 4 the paths had the folder in front
            listed = [self.path / PurePath(str(name)).name for name in names]
        except FileNotFoundError:
            self._problems.append(f'{METADATA_FILE} is missing')
        except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError) as error:
            self._problems.append(f'{METADATA_FILE} is damaged ({_short(error)})')
        for file in listed:
            if not file.is_file():
                self._problems.append(f'{file.name} is listed in {METADATA_FILE} but missing')
        files = [f for f in dict.fromkeys(listed) if f.is_file() and f.suffix == '.mcap']
        files += [f for f in found if f not in files]
        if not files:
            raise ValueError(f'{self.path} holds no .mcap file')
        self._candidates = files
        return files

    def _merge_topics(self):
        merged = {}
        for file in self._files:
            for id_, channel in file.channels.items():
                schema = file.schemas.get(channel.schema_id)
                type_name = schema.name if schema else ''
                try:
                    qos = _load_qos(channel.metadata.get('offered_qos_profiles', ''))
                except (yaml.YAMLError, ValueError, KeyError, TypeError,
                        AttributeError) as error:
                    qos = []
                    self._problems.append(
                        f'{channel.topic}: QoS text not understood ({_short(error)})')
                before = merged.get((channel.topic, type_name))
                count = file.counts[id_] + (before.count if before else 0)
                merged[channel.topic, type_name] = Topic(
                    channel.topic, type_name, count, before.qos if before else qos,
                    channel.metadata.get('topic_type_hash', ''))
        return list(merged.values())

    def messages(self, topics=None, start=None, end=None, decode=False):
        """Messages in the order of their log time (equal times: in the order of the file).

        Parameters
        ----------
        topics : str or list of str, optional
            Only these.
        start, end : int, optional
            Only log times in [start, end), ns since 1970.
        decode : bool
            Give Python objects (by ``mcap_ros2``) in place of bytes. A message that does not
            fit its schema is left out and counted in `problems`.

        Yields
        ------
        BagMessage
            topic, type, data, log_time, publish_time.
        """
        wanted = {topics} if isinstance(topics, str) else topics if topics is None \
            else set(topics)
        low = 0 if start is None else start
        high = 2**64 if end is None else end
        chosen = {
            id(file): {
                number: (channel.topic, file.schemas.get(channel.schema_id), channel)
                for number, channel in file.channels.items()
                if wanted is None or channel.topic in wanted}
            for file in self._files}
        segments = sorted(
            s for s in (s for file in self._files for s in file.segments)
            if s.end >= low and s.start < high
            and (not s.channels or not s.channels.isdisjoint(chosen[id(s.file)])))
        heap, following = [], 0
        with ExitStack() as stack:
            streams = {id(f): stack.enter_context(open(f.path, 'rb')) for f in self._files}
            while heap or following < len(segments):
                while following < len(segments) and (
                        not heap or segments[following].start <= heap[0][0]):
                    segment = segments[following]
                    following += 1
                    key = id(segment.file)
                    rows = self._rows(segment, streams[key], chosen[key], low, high)
                    if rows:
                        heapq.heappush(heap, (rows[0][0], segment.order, 0, rows))
                if not heap:
                    continue
                log_time, order, number, rows = heap[0]
                # all that comes before anything else could, in one go
                stop = len(rows)
                limit = min(
                    segments[following].start if following < len(segments) else 2**64,
                    min((entry[0] for entry in heap[1:3]), default=2**64))
                if rows[-1][0] >= limit:
                    stop = max(bisect.bisect_left(rows, (limit,), number), number + 1)
                for log_time, _, publish_time, target, data in rows[number:stop]:
                    topic, schema, channel = target
                    if decode:
                        data = self._decode(topic, schema, channel, data)
                        if data is None:
                            continue
                    yield BagMessage(
                        topic, schema.name if schema else '', data, log_time, publish_time)
                if stop < len(rows):
                    heapq.heapreplace(heap, (rows[stop][0], order, stop, rows))
                else:
                    heapq.heappop(heap)

    def _rows(self, segment, stream, chosen, low, high):
        """(log time, index, publish time, target, data) of a segment, in log time order."""
        try:
            buffer = segment.file.load(segment, stream)
        except _PARSE_ERRORS as error:
            self._skipped[f'{segment.file.path.name}: the chunk at byte {segment.offset - 9} '
                          f'is damaged ({_short(error)}) and left out'] = 1
            return []
        rows = []
        for opcode, begin, end in _walk(buffer):
            if opcode != Opcode.MESSAGE or end - begin < 22:
                continue
            channel, _, log_time, publish_time = struct.unpack_from('<HIQQ', buffer, begin)
            target = chosen.get(channel)
            if target is not None and low <= log_time < high:
                rows.append((log_time, len(rows), publish_time, target, buffer[begin + 22:end]))
        rows.sort(key=_time_and_index)
        return rows

    def _decode(self, topic, schema, channel, data):
        key = (schema.name, schema.data) if schema else None
        if key not in self._decoders:
            from mcap_ros2.decoder import DecoderFactory
            try:
                self._decoders[key] = DecoderFactory().decoder_for(
                    channel.message_encoding, schema)
            except Exception as error:  # the schema is foreign text
                self._decoders[key] = None
                self._skipped[f'{topic}: schema not understood ({_short(error)})'] = 1
        decoder = self._decoders[key]
        if decoder is None:
            self._skipped[f'{topic}: messages that cannot be decoded left out'] += 1
            return None
        try:
            return decoder(data)
        except Exception:  # foreign bytes fail in any way
            self._skipped[f'{topic}: a message that does not fit its schema left out'] += 1
            return None

    def read_attachment(self, name):
        """Bytes of the last attachment called `name`.

        Raises
        ------
        ValueError
            There is none; the message lists those that are.
        """
        for info in reversed(self.attachments):
            if info.name == name:
                with open(info.file, 'rb') as stream:
                    stream.seek(info.offset)
                    return stream.read(info.size)
        known = ', '.join(a.name for a in self.attachments) or 'none'
        raise ValueError(f'{self.path} has no attachment {name!r} (it has: {known})')

    def extract_attachment(self, name, folder):
        """Write an attachment into `folder`; never over a file, never outside of it.

        Returns
        -------
        Path

        Raises
        ------
        ValueError
            `name` holds a path, or there is no such attachment.
        FileExistsError
            A file of that name is there.
        """
        target = Path(folder) / _plain_name(name)
        data = self.read_attachment(name)
        with open(target, 'xb') as stream:
            stream.write(data)
        return target


def _time_and_index(row):
    return row[:2]
