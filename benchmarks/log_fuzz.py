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

"""Fuzz test with damaged and hostile logs for everything that reads logs.

Each input has 2 s of CPU time and 500 MB. It must give messages or a clear error of one line.
Exceeding the limits, any other exception, or a file outside the target folder is a failure, and the
input is kept.

    python benchmarks/log_fuzz.py --seconds 600
    python benchmarks/log_fuzz.py --crafted --flips --inputs 500
"""

import argparse
import random
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
from pathlib import Path

from hostile_logs import (
    DEFINITION,
    QOS,
    crafted,
    metadata_files,
    odd_message,
)
from mcap.writer import CompressionType, IndexType, Writer

from msg_tools.bag import BagWriter
from msg_tools.bag.bag_pair import parameters_of
from msg_tools.bag.sqlite import open_bag

CPU_SECONDS = 2.0
MEMORY = 500 * 10**6


class TooLong(BaseException):
    """An input exceeded its CPU time."""


# --- what an input must survive ------------------------------------------------------------------


def _light(path, scratch):
    """Steps, each with its own time limit."""
    def read(decode):
        for message in open_bag(path).messages(decode=decode):
            assert decode or isinstance(message.data, bytes)
    yield lambda: read(False)
    yield lambda: read(True)


def _full(path, scratch):
    from msg_tools.bag.log_copy import recover_log
    from telescope_mount.commands.info import log_info
    yield from _light(path, scratch)

    def look():
        bag = open_bag(path)
        bag.last_before([topic.name for topic in bag.topics[:5]], 2**63)
        parameters_of(bag.metadata, '/x')
        for info in bag.attachments:
            try:
                bag.read_attachment(info.name)
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
    """The failure that `path` causes, or None."""
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
    """Limit this process to 500 MB more than it has, and stop long inputs."""
    pages = int(Path('/proc/self/statm').read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))

    def stop(*_):
        raise TooLong
    signal.signal(signal.SIGPROF, stop)


# --- small logs to damage ------------------------------------------------------------------------


def small_logs(folder):
    """Files that differ in chunks, compression, index and checksums."""
    out = []
    for compression in ('zstd', 'lz4', 'none'):
        with BagWriter(folder / compression, chunk_size=300, compression=compression) as bag:
            bag.add_foreign_topic('/a', 'odd_msgs/msg/Odd', [], DEFINITION, '')
            bag.add_attachment('a.txt', 'text/plain', b'data')
            for i in range(12):
                bag.write('/a', odd_message(i), i, i, i)
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
                writer.add_message(channel, i, odd_message(i), i)
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
    for name, content in metadata_files(scale):
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
