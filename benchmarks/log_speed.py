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

"""Speed of writing, recording, opening, replaying and recomputing a log.

    python benchmarks/log_speed.py --writer --open --recompute NIGHT/bag
    python benchmarks/log_speed.py --flood 30 --encoders 600 --timing 30

Without options it runs a small round of each part that needs no ROS. Recording runs logger and
publisher as separate processes, over DDS, on this machine.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from msg_tools.bag import BagReader, BagWriter

MESSAGE = 100  # bytes, about a JointState of one axis
TYPE = 'std_msgs/msg/String'
DEFINITION = b'string data\n'


def _payloads():
    """A thousand messages that compress like encoder readings: half of each is noise."""
    rng = np.random.default_rng(1)
    return [b'\0\1\0\0' + rng.bytes(MESSAGE // 2) + bytes(MESSAGE // 2 - 4) for _ in range(1000)]


def _bare(folder, data, count):
    from mcap.writer import Writer
    with open(folder / 'bare.mcap', 'wb') as stream:
        writer = Writer(stream)
        writer.start('ros2', 'x')
        channel = writer.register_channel('/t', 'cdr', writer.register_schema(
            TYPE, 'ros2msg', DEFINITION))
        begun = time.process_time()
        for i in range(count):
            writer.add_message(channel, i, data[i % 1000], i, i)
        writer.finish()
        return count / (time.process_time() - begun)


def _ours(folder, data, count):
    with BagWriter(folder / 'ours') as writer:
        writer.add_foreign_topic('/t', TYPE, [], DEFINITION, '')
        begun = time.process_time()
        for i in range(count):
            writer.write('/t', data[i % 1000], i, i, i)
    return count / (time.process_time() - begun)


def writer(count):
    """Our writer and the mcap library, in the same process."""
    data = _payloads()
    with tempfile.TemporaryDirectory() as name:
        rates = []
        for number in range(3):
            folder = Path(name, str(number))
            folder.mkdir()
            rates.append((_bare(folder, data, count), _ours(folder, data, count)))
        bare, ours = np.median(rates, axis=0)
    print(f'writer, {count} messages of {MESSAGE} bytes, zstd: {ours:.0f} msg/s of processor time,'
          f' mcap library {bare:.0f}: {ours / bare:.2f} times')


def open_large(megabytes, folder):
    """Open a large log, read its first message, seek; memory of a separate process."""
    with tempfile.TemporaryDirectory(dir=folder) as name:
        rng = np.random.default_rng(2)
        block = rng.bytes(4096)
        with BagWriter(Path(name) / 'large', compression='none') as out:
            out.add_foreign_topic('/t', TYPE, [], DEFINITION, '')
            count = megabytes * 10**6 // (4096 + 47)
            for i in range(count):
                out.write('/t', block, i * 1000, i * 1000, i)
        code = (
            'import resource, sys, time\n'
            'from msg_tools.bag import BagReader\n'
            't = time.perf_counter()\n'
            'bag = BagReader(sys.argv[1])\n'
            'next(bag.messages())\n'
            'first = time.perf_counter() - t\n'
            't = time.perf_counter()\n'
            'next(bag.messages(start=int(0.7 * bag.end_time)))\n'
            'seek = time.perf_counter() - t\n'
            't = time.perf_counter()\n'
            'n = sum(1 for _ in bag.messages())\n'
            'read = time.perf_counter() - t\n'
            'peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024\n'
            'print(f"open and first message {first:.3f} s, seek {seek:.3f} s, read through '
            '{n / read:.0f} msg/s, peak memory {peak:.0f} MB")\n')
        done = subprocess.run([sys.executable, '-c', code, str(Path(name) / 'large')],
                              capture_output=True, text=True, check=True)
    print(f'{megabytes} MB: {done.stdout.strip()}')


def recompute(bag):
    """A night from its log."""
    from telescope_mount.log_check.log_check import verify_log
    reader = BagReader(bag)
    span = (reader.end_time - reader.start_time) * 1e-9
    begun = time.process_time()
    report = verify_log(bag)
    took = time.process_time() - begun
    print(f'{bag}: {span:.0f} s and {reader.message_count} messages recomputed in {took:.2f} s of '
          f'processor time: {span / took:.0f} times real time, '
          f'{len(report["differences"])} differences of {sum(report["checked"].values())}')


# --- recording -----------------------------------------------------------------------------------


def publish(kind, seconds, rate):
    """The publishing process: a flood of messages, or two encoders and the night's other topics."""
    import rclpy
    from rclpy.serialization import serialize_message

    from msg_tools import convert, topics
    rclpy.init()
    node = rclpy.create_node('source', namespace='/mount')
    pubs = [node.create_publisher(t.message, t.name, t.qos)
            for t in (topics.INCREMENTAL, topics.ABSOLUTE, topics.OFFSET, topics.CLOCK)]
    used = pubs[:1] if kind == 'flood' else pubs
    while any(pub.get_subscription_count() == 0 for pub in used):
        time.sleep(0.05)  # polls the match; nothing is measured yet
    data = [serialize_message(m) for m in (
        convert.joint_state(1, [0.1, 0.2], [0.0, 0.0], frame='mount'),
        convert.joint_state(1, [0.1, 0.2], [0.0, 0.0], frame='mount'),
        convert.sky_vector(1, 0.0, 0.0), topics.CLOCK.message())]
    begun, sent = time.monotonic(), 0
    total = int(seconds * rate)
    while sent < total:
        due = min(total, int((time.monotonic() - begun) * rate))
        for _ in range(due - sent):
            if kind == 'flood':
                used[0].publish(data[0])
            else:
                for number, pub in enumerate(used[:2]):
                    pub.publish(data[number])
                if sent % 100 == 0:
                    for number in (2, 3):
                        used[number].publish(data[number])
            sent += 1
        time.sleep(0.0005)  # this is the clock of the source
    took = time.monotonic() - begun
    cpu = resource.getrusage(resource.RUSAGE_SELF)
    print(f'{sent} {took:.3f} {cpu.ru_utime + cpu.ru_stime:.3f}', flush=True)
    sys.stdin.readline()
    rclpy.shutdown()


def record(kind, seconds, rate):
    """Logger and publisher as processes; CPU time of the logger, and the recorded messages."""
    from telescope_mount.dds import dds_environment
    from telescope_mount.processes import domain
    lock = domain.claim()
    with tempfile.TemporaryDirectory() as name:
        environment = {**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                       'ROS_DOMAIN_ID': str(lock.number), 'ROS_LOG_DIR': name,
                       **dds_environment(lock.number)}
        logger = subprocess.Popen(
            [sys.executable, '-m', 'msg_tools.node_process', 'msg_tools.mcap_logger_node',
             '--ros-args', '-r', '__ns:=/mount', '-p', f'folder:={name}/log'], env=environment)
        source = subprocess.Popen(
            [sys.executable, __file__, '--source', kind, str(seconds), str(rate)],
            env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        ticks = os.sysconf('SC_CLK_TCK')
        sent, took, cpu = map(float, source.stdout.readline().split())
        time.sleep(3.0)  # what is on its way to the file is the logger's work too
        fields = Path(f'/proc/{logger.pid}/stat').read_text().rsplit(')', 1)[1].split()
        used = (int(fields[11]) + int(fields[12])) / ticks
        source.communicate('\n', timeout=30)
        logger.send_signal(2)
        logger.wait(60)
        from telescope_mount.commands.info import log_info
        info = log_info(Path(name) / 'log')
    lock.release()
    rows = {row['name'].removeprefix('/mount/'): row for row in info['topics']}
    names = ['incremental/joint_states'] + ['absolute/joint_states'] * (kind != 'flood')
    have = sum(rows[n]['count'] for n in names)
    lost = sum(rows[n]['lost'] or 0 for n in names)
    print(f'{kind}: {have} of {int(sent) * len(names)} messages, {lost} gaps, {have / took:.0f} '
          f'msg/s for {took:.0f} s; logger {100 * used / took:.0f} % of a core (start-up '
          f'included), publisher {100 * cpu / took:.0f} %')


def timing(seconds):
    """Timing error of each message in a replay at rate 1."""
    import rclpy
    from rclpy.context import Context

    from msg_tools import topics
    from msg_tools.executor import NodeExecutor
    from msg_tools.mcap_replay_node import McapReplay
    rng = np.random.default_rng(3)
    with tempfile.TemporaryDirectory() as name:
        from rclpy.serialization import serialize_message
        data = serialize_message(topics.OFFSET.message())
        times = np.cumsum(rng.exponential(1e7, int(seconds * 100))).astype(int)
        with BagWriter(Path(name) / 'log') as out:
            out.add_topic('/mount/offset', topics.OFFSET.type, [topics.OFFSET.qos])
            for when in times:
                out.write('/mount/offset', data, int(when), int(when))
        context = Context()
        rclpy.init(context=context)
        node = McapReplay(context=context, overrides={'bag': f'{name}/log'})
        sent, publish_now = [], node._publish

        def note(message):
            sent.append(time.monotonic())
            publish_now(message)
        node._publish = note
        executor = NodeExecutor(context=context)
        executor.add_node(node)
        begun = time.process_time()
        try:
            while context.ok():
                executor.spin_once()
        except rclpy.executors.ExternalShutdownException:
            pass
        used = time.process_time() - begun
    late = np.array(sent) - times * 1e-9
    late = (late - np.median(late)) * 1e3
    print(f'replay at rate 1, {len(sent)} messages at random times: 1 and 99 % '
          f'{np.percentile(late, 1):+.2f} and {np.percentile(late, 99):+.2f} ms, largest '
          f'{np.abs(late).max():.2f} ms; {100 * used / seconds:.0f} % of a core')


def main():
    """Run the requested parts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--writer', type=int, nargs='?', const=300_000, metavar='MESSAGES')
    parser.add_argument('--open', type=int, nargs='?', const=2000, metavar='MB')
    parser.add_argument('--folder', type=Path, help='for the large log (default: temporary)')
    parser.add_argument('--recompute', type=Path, metavar='BAG')
    parser.add_argument('--flood', type=float, metavar='SECONDS')
    parser.add_argument('--rate', type=float, default=10_000, help='of the flood [msg/s]')
    parser.add_argument('--encoders', type=float, metavar='SECONDS')
    parser.add_argument('--timing', type=float, metavar='SECONDS')
    parser.add_argument('--source', nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.source:
        publish(args.source[0], float(args.source[1]), float(args.source[2]))
        return
    small = not any((args.writer, args.open, args.recompute, args.flood, args.encoders,
                     args.timing))
    if args.writer or small:
        writer(args.writer or 50_000)
    if args.open or small:
        open_large(args.open or 100, args.folder)
    if args.recompute:
        recompute(args.recompute)
    if args.flood:
        record('flood', args.flood, args.rate)
    if args.encoders:
        record('encoders', args.encoders, 1000)
    if args.timing:
        timing(args.timing)


if __name__ == '__main__':
    main()
