"""Throws damaged and hostile logs at everything that reads one.

Each input has 2 s of processor time and 500 MB. It must end in a clear error of one line or in
messages; what goes beyond, any other exception, and a file outside of the target folder is a
failure, and the input is kept.

    python benchmarks/log_fuzz.py --seconds 600
    python benchmarks/log_fuzz.py --crafted --flips --inputs 500
"""

import argparse
import json
import random
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
import zlib
from pathlib import Path

import lz4.frame
import zstandard
from mcap.writer import CompressionType, IndexType, Writer

from msg_tools.bag import BagWriter
from msg_tools.bag.provenance import parameters_of
from msg_tools.bag.sqlite import open_bag

CPU_SECONDS = 2.0
MEMORY = 500 * 10**6
MAGIC = b'\x89MCAP0\r\n'
DEFINITION = b'''int32 id
string name
float64[] values
Inner[<=5] inner
================================================================================
MSG: odd_msgs/Inner
uint8[3] raw
'''
QOS = '- {history: keep_last, depth: 5, durability: transient_local}'


class TooLong(BaseException):
    """An input took more processor time than it may."""


# --- what an input must survive ------------------------------------------------------------------


def _light(path, scratch):
    """Steps, each with its own time."""
    def read(decode):
        for message in open_bag(path).messages(decode=decode):
            assert decode or isinstance(message.data, bytes)
    yield lambda: read(False)
    yield lambda: read(True)


def _full(path, scratch):
    from telescope_mount.commands.info import log_info
    from telescope_mount.commands.recover import recover_log
    yield from _light(path, scratch)

    def look():
        bag = open_bag(path)
        bag.last_before([topic.name for topic in bag.topics[:5]], 2**63)
        parameters_of(bag.metadata, '/x')
        for number, info in enumerate(bag.attachments):
            target = scratch / f'attachment_{number}'
            target.mkdir()
            try:
                bag.extract_attachment(info.name, target)
            except ValueError as error:
                _one_line(error)
    yield look
    yield lambda: log_info(path)
    if path.suffix != '.db3':
        yield lambda: recover_log(path, scratch / 'recovered')


def _one_line(error):
    if '\n' in str(error) or len(str(error)) > 1000:
        raise AssertionError(f'no single line: {error!r}') from error


def survives(path, exercise=_full):
    """None, or what `path` did that no input may do."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder, 'scratch')
        scratch.mkdir()
        for step in exercise(path, scratch):
            failure = _survives_step(step)
            if failure:
                return failure
        if [p.name for p in Path(folder).iterdir()] != ['scratch']:
            return 'a file outside of the target'
    return None


def _survives_step(step):
    signal.setitimer(signal.ITIMER_PROF, CPU_SECONDS)
    try:
        step()
    except (ValueError, OSError) as error:
        signal.setitimer(signal.ITIMER_PROF, 0)
        try:
            _one_line(error)
        except AssertionError as long:
            return str(long)
    except TooLong:
        return f'more than {CPU_SECONDS:g} s'
    except BaseException as error:
        return f'{type(error).__name__}: {error}'
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return None


def limit():
    """Give this process 500 MB more than it has, and let long inputs end."""
    pages = int(Path('/proc/self/statm').read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))

    def stop(*_):
        raise TooLong
    signal.signal(signal.SIGPROF, stop)


# --- small logs to damage ------------------------------------------------------------------------


def message(i):
    """Bytes of the type above."""
    return (b'\0\1\0\0' + struct.pack('<iI', i, 3) + b'ab\0\0' + struct.pack('<I', 2)
            + struct.pack('<4x2dI', 0.5, 0.25, 1) + b'abc')


def small_logs(folder):
    """Files that differ in chunks, compression, index and checksums."""
    out = []
    for compression in ('zstd', 'lz4', 'none'):
        with BagWriter(folder / compression, chunk_size=300, compression=compression) as bag:
            bag.add_foreign_topic('/a', 'odd_msgs/msg/Odd', [], DEFINITION, '')
            bag.add_attachment('a.txt', 'text/plain', b'data')
            for i in range(12):
                bag.write('/a', message(i), i, i, i)
        out.append(bag.file)
    options = (
        {'enable_crcs': False, 'compression': CompressionType.NONE, 'chunk_size': 300},
        {'use_chunking': False},
        {'enable_crcs': False, 'index_types': IndexType.NONE, 'use_statistics': False,
         'compression': CompressionType.NONE, 'chunk_size': 300})
    for number, option in enumerate(options):
        out.append(folder / f'{number}.mcap')
        with open(out[-1], 'wb') as stream:
            writer = Writer(stream, **option)
            writer.start('ros2', 'x')
            schema = writer.register_schema('odd_msgs/msg/Odd', 'ros2msg', DEFINITION)
            channel = writer.register_channel(
                '/a', 'cdr', schema, {'offered_qos_profiles': QOS})
            for i in range(12):
                writer.add_message(channel, i, message(i), i)
            writer.add_metadata('telescope_mount_repeated', {'/a': '1'})
            writer.add_attachment(0, 0, 'a.txt', 'text/plain', b'data')
            writer.finish()
    return out


SPECIAL = (0, 1, 0x7F, 0xFF, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1,
           2**63, 2**64 - 1)


def mutate(data, others, rng):
    """A damaged copy."""
    data = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        place = rng.randrange(len(data)) if data else 0
        kind = rng.randrange(8)
        if kind == 0:
            data[place:place + 1] = bytes([rng.randrange(256)])
        elif kind == 1 and data:
            data[place] ^= 1 << rng.randrange(8)
        elif kind == 2:
            del data[place:]
        elif kind == 3:
            value = rng.choice(SPECIAL)
            data[place:place + 8] = struct.pack('<Q', value)
        elif kind == 4:
            data[place:place + 4] = struct.pack('<I', rng.choice(SPECIAL) & 0xFFFFFFFF)
        elif kind == 5:
            length = rng.randrange(200)
            data[place:place] = data[place:place + length]
        elif kind == 6:
            other = rng.choice(others)
            start = rng.randrange(len(other))
            data[place:place + rng.randrange(100)] = other[start:start + rng.randrange(300)]
        else:
            del data[place:place + rng.randrange(60)]
    return bytes(data)


# --- inputs that somebody made with intent -------------------------------------------------------


def record(opcode, body, length=None):
    """A record; `length` may lie."""
    return struct.pack('<BQ', opcode, len(body) if length is None else length) + body


def text(data):
    """A string with its length."""
    data = data if isinstance(data, bytes) else data.encode()
    return struct.pack('<I', len(data)) + data


def chunk(raw, compression, data, claimed=None, times=(0, 10)):
    """A chunk of `data`, said to hold `claimed` bytes."""
    size = len(raw) if claimed is None else claimed
    return record(6, struct.pack('<QQQI', *times, size, 0) + text(compression)
                  + struct.pack('<Q', len(data)) + data)


def schema(number=1, definition=DEFINITION, name='odd_msgs/msg/Odd'):
    """A schema record."""
    return record(3, struct.pack('<H', number) + text(name) + text('ros2msg') + text(definition))


def channel(number=1, of=1, topic='/a', qos=''):
    """A channel record."""
    metadata = text('offered_qos_profiles') + text(qos)
    return record(4, struct.pack('<HH', number, of) + text(topic) + text('cdr') + text(metadata))


def a_message(data, number=1, when=5):
    """A message record."""
    return record(5, struct.pack('<HIQQ', number, 0, when, when) + data)


def whole(*records):
    """A file of these records."""
    return MAGIC + record(1, text('ros2') + text('x')) + b''.join(records)


def summed(body, summary):
    """A file with a summary whose checksum is right."""
    data = body + record(15, bytes(4))
    footer = struct.pack('<BQQQ', 2, 20, len(data), 0)
    return data + summary + footer + struct.pack(
        '<I', zlib.crc32(footer, zlib.crc32(summary))) + MAGIC


def crafted(scale=1):
    """Name and content of each; bombs and crowds are `scale` times smaller."""
    zeros = bytes(2**26 // scale)
    zstd, lz = zstandard.ZstdCompressor().compress(zeros), lz4.frame.compress(zeros)
    head = schema() + channel()
    yield from _bombs(zeros, zstd, lz, head, scale)
    yield from _counts(head, scale)
    yield from _lies(head)


def _bombs(zeros, zstd, lz, head, scale):
    for name, data in (('zstd', zstd), ('lz4', lz)):
        yield f'bomb {name}', whole(head, chunk(zeros, name, data))
        # as many as make 2 MB: the time that a file may take grows with its size
        yield f'bombs {name}', whole(head, chunk(zeros, name, data) * (
            min(200, 2_000_000 // len(data)) // scale))
        yield f'bomb {name} beyond belief', whole(head, chunk(b'', name, data, 2**40))
        yield f'bomb {name} that is smaller than said', whole(
            head, chunk(b'', name, data[:500], 2**27))
    small = a_message(b'') * (2_000_000 // scale)
    packed = zstandard.ZstdCompressor().compress(small)
    yield 'two million empty messages', whole(head, chunk(small, 'zstd', packed))
    records = record(99, b'') * (5_000_000 // scale)
    yield 'five million empty records', whole(head, chunk(
        records, 'zstd', zstandard.ZstdCompressor().compress(records)))
    # the header of a frame says how much memory it wants: 2 GB
    yield 'a large window', whole(head, chunk(
        b'x', 'zstd', b'\x28\xb5\x2f\xfd\x00\xa8\x09\0\0x', 2**27))
    one = chunk(b'', 'zstd', zstd, 2**26)
    offset = len(whole(head))
    index = record(8, struct.pack('<QQQQI', 0, 10, offset, len(one), 0) + struct.pack('<Q', 0)
                   + text('zstd') + struct.pack('<QQ', len(zstd), 2**26))
    statistics = record(11, struct.pack('<QHIIIIQQI', 1, 1, 1, 0, 0, 1, 0, 10, 0))
    yield 'an index that names a chunk often', summed(
        whole(head, one), schema() + channel() + statistics + index * (10_000 // scale))
    later = b''.join(
        record(8, struct.pack('<QQQQI', 0, 10, offset + i * len(one), len(one), 0) + struct.pack(
            '<Q', 0) + text('zstd') + struct.pack('<QQ', len(zstd), 2**26)) for i in range(40))
    yield 'many large chunks at one time', summed(
        whole(head, one * 40), schema() + channel() + statistics + later)


def _counts(head, scale):
    huge = struct.pack('<I', 2**32 - 1)
    for name, body in (
            ('schema', (3, b'\1\0' + huge)), ('channel', (4, b'\1\0\1\0' + huge)),
            ('metadata', (12, text('x') + huge)), ('statistics', (11, bytes(42) + huge)),
            ('chunk index', (8, bytes(32) + huge)), ('attachment', (9, bytes(16) + huge)),
            ('chunk', (6, bytes(28) + huge))):
        yield f'{name} with a huge length', whole(head, record(*body))
        yield f'{name} with a huge length in the summary', summed(whole(head), record(*body))
    for length in (2**63, 2**64 - 1, 2**40, 10**9):
        yield f'a record of {length} bytes', whole(head, record(5, bytes(30), length))
    many = b''.join(schema(i, b'int32 x\n') + channel(i, i) for i in range(1, 65536 // scale))
    yield 'all channels there can be', whole(many, chunk(
        a_message(message(1)), '', a_message(message(1))))
    yield 'a string without end', whole(schema(definition=b'int32 x' * 2**20), channel(), chunk(
        b'', '', b''), a_message(message(1)))
    yield 'a topic of a megabyte', whole(schema(), channel(topic='/' + 'x' * 2**20))
    yield 'chunks without content', whole(head, chunk(b'', '', b'') * (50_000 // scale))
    yield 'metadata without end', whole(head, record(12, text('x') + text(b'')) * (50_000 // scale))


def _lies(head):
    yield 'times at the end', whole(head, *(a_message(message(1), when=2**64 - 1 - i)
                                            for i in range(3)))
    yield 'a chunk in a chunk', whole(head, chunk(*[chunk(b'', '', b'x' * 50)] * 1 + [''], b'x'))
    yield 'deep YAML', whole(schema(), channel(qos='[' * 60_000))
    yield 'deep YAML in blocks', whole(schema(), channel(qos='- ' * 30_000))
    laughs = 'a: &a [x, x, x, x, x, x, x, x]\n' + ''.join(
        f'{c}: &{c} [{", ".join([f"*{b}"] * 8)}]\n' for b, c in zip('abcdefgh', 'bcdefghi'))
    yield 'a billion laughs', whole(schema(), channel(qos=laughs))
    for name, definition in (
            ('nothing four billion times', b'Empty[4000000000] x\n' + b'=' * 80
             + b'\nMSG: odd_msgs/Empty\n'),
            ('nothing as often as the message says', b'Empty[] x\n' + b'=' * 80
             + b'\nMSG: odd_msgs/Empty\n'),
            ('constants only', b'C[] x\n' + b'=' * 80 + b'\nMSG: odd_msgs/C\nint32 A=1\n'),
            ('itself', b'odd_msgs/Odd x\n'), ('many of itself', b'odd_msgs/Odd[] x\n'),
            ('four billion numbers', b'float64[4000000000] x\n'),
            ('no text', bytes(range(256))), ('endless words', b'a ' * 100_000),
            ('many lines', b'int32 x\n' * 30_000)):
        data = b'\0\1\0\0' + b'\xff' * 2000
        yield f'a type of {name}', whole(
            schema(definition=definition), channel(), a_message(data), a_message(b''))
    for name in ('../up', '/tmp/abs', 'a/../../b', '..', 'nul\0', 'C:\\x', ''):
        body = bytes(16) + text(name) + text('t') + struct.pack('<Q', 4) + b'evil' + bytes(4)
        yield f'attachment {name!r}', whole(head, record(9, body))
    yield 'an attachment larger than its record', whole(
        head, record(9, bytes(16) + text('a') + text('t') + struct.pack('<Q', 2**62)))
    for value in ('9' * 5000, '-1', 'x', ''):
        yield f'{value[:5]} repeated messages', whole(head, record(
            12, text('telescope_mount_repeated') + text(text('/a') + text(value))))
    deep = json.dumps({'a': 1})[:-1] + ', "b": ' + '[' * 100_000
    yield 'deep JSON of parameters', whole(
        head, record(12, text('parameters /x') + text(text('n') + text(deep))))


def metadata_files():
    """Hostile ``metadata.yaml`` beside a sound file."""
    prefix = 'rosbag2_bagfile_information:\n  relative_file_paths:\n'
    yield 'deep', '[' * 10**6
    yield 'deep blocks', '- ' * 10**6
    yield 'other folders', prefix + '    - ../../../etc/passwd\n    - /etc/passwd\n'
    yield 'many files', prefix + '    - x.mcap\n' * 150_000
    yield 'large', 'a: b\n' * 10**6
    yield 'no text', '\0\1\2'


# --- running it ----------------------------------------------------------------------------------


class Fuzz:
    """Counts inputs and keeps those that fail."""

    def __init__(self, keep):
        self.keep = keep
        self.inputs, self.failures, self.slowest = 0, [], (0.0, '')

    def feed(self, name, data, folder, exercise=_full, suffix='mcap'):
        """Read `data` as a file."""
        path = folder / f'input.{suffix}'
        path.write_bytes(data)
        self.judge(name, path, exercise, data)

    def judge(self, name, path, exercise, data):
        """Read `path`."""
        begun = time.process_time()
        failure = survives(path, exercise)
        self.inputs += 1
        self.slowest = max(self.slowest, (time.process_time() - begun, name))
        if failure:
            self.failures.append(f'{name}: {failure}')
            print(self.failures[-1], file=sys.stderr)
            if self.keep:
                self.keep.mkdir(parents=True, exist_ok=True)
                (self.keep / f'{len(self.failures)}.bin').write_bytes(data)


def _crafted(fuzz, folder, scale):
    for name, data in crafted(scale):
        fuzz.feed(name, data, folder)
    sound = small_logs(folder / 'sound')[0]
    for name, content in metadata_files():
        bag = folder / 'bag'
        shutil.rmtree(bag, ignore_errors=True)
        bag.mkdir()
        shutil.copy(sound, bag)
        (bag / 'metadata.yaml').write_text(content)
        fuzz.judge(f'metadata.yaml, {name}', bag, _full, content.encode())


def _flips(fuzz, folder, logs):
    """Every byte of the smallest log, inverted."""
    data = min(logs, key=len)
    for place in range(len(data)):
        fuzz.feed(f'byte {place}', data[:place] + bytes([data[place] ^ 0xFF]) + data[place + 1:],
                  folder, _light)


def main():
    """Run it; exit code 1 after a failure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=0.0, help='of random damage')
    parser.add_argument('--inputs', type=int, default=0, help='of random damage, at most')
    parser.add_argument('--crafted', action='store_true', help='files made with intent')
    parser.add_argument('--flips', action='store_true', help='every byte of a small log')
    parser.add_argument('--scale', type=int, default=1, help='bombs so many times smaller')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--keep', type=Path, help='folder for inputs that fail')
    args = parser.parse_args()
    import mcap_ros2.decoder  # noqa: F401 (its size must not count)
    fuzz, rng = Fuzz(args.keep), random.Random(args.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / 'sound').mkdir()
        logs = [file.read_bytes() for file in small_logs(folder)]
        shutil.rmtree(folder / 'sound')
        (folder / 'sound').mkdir()
        limit()
        if args.crafted:
            _crafted(fuzz, folder, args.scale)
        if args.flips:
            _flips(fuzz, folder, logs)
        most = args.inputs or (10**9 if args.seconds else 0)
        end = time.monotonic() + (args.seconds or 10**9)
        for number in range(most):
            if time.monotonic() > end:
                break
            exercise = _full if number % 10 == 0 else _light
            fuzz.feed(f'seed {args.seed} input {number}', mutate(rng.choice(logs), logs, rng),
                      folder, exercise)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f'{fuzz.inputs} inputs, {len(fuzz.failures)} failures; slowest {fuzz.slowest[0]:.2f} s '
          f'of processor time ({fuzz.slowest[1]}); peak memory {peak:.0f} MB')
    return 1 if fuzz.failures else 0


if __name__ == '__main__':
    sys.exit(main())
