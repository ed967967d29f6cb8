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

"""The graph under load: encoders at up to 1 kHz with all nodes of a night, and a flooded logger.

    python benchmarks/load.py                        two rates, within 40 s on free cores
    python benchmarks/load.py --full                 10 to 1000 Hz, 30 s each: 5 minutes
    python benchmarks/load.py --rates 1000 --seconds 30
    python benchmarks/load.py --flood 30 --message-rate 20000

- rates: two encoder drivers, a process each, publish JointState in real time, and observer, guard,
  pointing corrector, calibration and logger run as on a real mount. A reading is stamped with its
  scheduled time, so delays of the driver count; it arrives when a callback of this process gets it.
  p99 is the median over windows of 1 s. Lost messages are gaps in the publishers' sequence numbers
  at any subscriber.
- start-up: the nine nodes of a simulated night, from the command until all endpoints match.
- flood: four topics of serialised JointState (publishers of depth 5000) into the logger.

The load average is printed too, and the fraction of time in which a ready thread had no core: other
load on the machine determines the largest delays.
"""

import argparse
import ctypes
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from earlier_commit import BESIDE, LEAST, earlier_tree, run_options
from race import Row

HERE = Path(__file__).parent.parent
RATES = (10, 100, 300, 1000)
DRIVERS = ('incremental_encoder', 'absolute_encoder')
#: s that the graph runs before it is measured
SETTLED = 2.0
#: s between two turns of a publisher of the flood
TURN = 0.001
#: s that a start or an end may take
PATIENCE = 60.0


# --- processes of their own ----------------------------------------------------------------------


def drive(name):
    """A driver: readings at the parameter `rate_hz`, each stamped with its scheduled time."""
    from msg_tools import convert, topics
    from msg_tools.node import MountNode, Param
    from msg_tools.node_process import run_node

    class Driver(MountNode):
        """Driver of one encoder."""

        def __init__(self):
            super().__init__(name, (Param('rate_hz', 1000.0, 'readings a second [Hz]', 1.0, 1e5),),
                             hardware_id='load')
            self._period = round(1e9 / self.value('rate_hz'))
            self._pub = self.publisher(
                topics.INCREMENTAL if name == DRIVERS[0] else topics.ABSOLUTE)
            if name == DRIVERS[0]:
                self.subscribe(topics.COMMAND, lambda message: None)
            self._due = time.time_ns() + self._period
            self.every(self._period * 1e-9, self._read)

        def _read(self):
            now = time.time_ns()
            while self._due <= now:
                self._pub.publish(convert.joint_state(
                    self._due, [0.3, 0.8], [0.0, 0.0], frame='mount'))
                self._due += self._period

    sys.exit(run_node(Driver))


def flood(first, count, rate, seconds):
    """Publish `count` of the four topics, `rate` messages a second in all; JSON to stdout."""
    import rclpy
    from rclpy.serialization import serialize_message

    from msg_tools import NAMESPACE, convert
    rclpy.init()
    node = rclpy.create_node(f'source_{first}', namespace=NAMESPACE)
    flooded = _flooded()[first:first + count]
    pubs = [node.create_publisher(topic.message, topic.name, topic.qos) for topic in flooded]
    joints = convert.joint_state(1, [0.1, 0.2], [0.0, 0.0], frame='mount')
    pose = convert.pose(1, [0.1, 0.2], [[1e-12, 0.0], [0.0, 1e-12]])
    data = [serialize_message(pose if topic.message is type(pose) else joints)
            for topic in flooded]
    while not all(pub.get_subscription_count() for pub in pubs):
        time.sleep(0.05)  # polls the match; nothing is measured yet
    print('matched', flush=True)
    sys.stdin.readline()
    begun, sent, total = time.monotonic(), 0, int(seconds * rate)
    used = time.process_time()
    while sent < total:
        due = min(total, int((time.monotonic() - begun) * rate))
        for number in range(sent, due):
            pubs[number % count].publish(data[number % count])
        sent = max(sent, due)
        time.sleep(TURN)  # this is the clock of the source
    print(json.dumps({'sent': sent, 'took': time.monotonic() - begun,
                      'used': time.process_time() - used}), flush=True)
    sys.stdin.readline()
    rclpy.shutdown()


def _flooded():
    from msg_tools import topics
    return topics.INCREMENTAL, topics.ABSOLUTE, topics.ABSOLUTE_POSE, topics.TRUTH_JOINTS


# --- what processes use --------------------------------------------------------------------------


def processor_time(pid):
    """Seconds that a process has run: its main thread, all others (those of DDS, mostly); and that
    its main thread was ready and waited for a core.
    """
    out = [0.0, 0.0, 0.0]
    for task in Path(f'/proc/{pid}/task').iterdir():
        ran, waited, _ = map(int, (task / 'schedstat').read_text().split())
        main = int(task.name) == pid
        out[not main] += ran * 1e-9
        out[2] += main * waited * 1e-9
    return out


def _shares(before, after, seconds):
    """Percentage of the time, by name."""
    return {name: [100.0 * (b - a) / seconds for a, b in zip(before[name], after[name])]
            for name in before}


def _percentile(values, share):
    values = sorted(values)
    return values[min(len(values) - 1, int(len(values) * share))]


# --- a graph at a rate ---------------------------------------------------------------------------


def start_up():
    """Simulated night: seconds for this process' imports, for the nodes', and until all match."""
    begun = float(os.environ['LOAD_BEGUN'])
    from msg_tools import NAMESPACE
    from msg_tools.readiness import unmatched
    from telescope_mount.graph import night_graph
    from telescope_mount.processes import domain
    from telescope_mount.processes.node_processes import Processes
    from telescope_mount.running_graph.watcher import Watcher
    lock = domain.claim()
    with tempfile.TemporaryDirectory() as folder:
        nodes = Processes(Path(folder, 'nodes'), lock.number)  # its imports go on beside ours
        watcher = Watcher('load', lock.number, nodes.environment, nodes.check)
        own = time.time() - begun
        specs = night_graph(bag=f'{folder}/bag')
        nodes.start_all(specs)
        forked = time.time() - begun
        names = [f'{NAMESPACE}/{spec.name}' for spec in specs]
        if not watcher.spin_until(lambda: not unmatched(names, watcher.reports), PATIENCE):
            raise RuntimeError(f'not matched: {unmatched(names, watcher.reports)[:3]}')
        matched = time.time() - begun
        watcher.close()
        nodes.stop()
    lock.release()
    return {'own imports': own, 'imports': forked, 'matched': matched, 'nodes': len(specs)}


def die_with_parent():
    """Run first in a child, so that no driver outlives a graph that was killed."""
    prctl, parent = ctypes.CDLL(None).prctl, os.getpid()

    def prepare():
        prctl(1, signal.SIGTERM)
        if os.getppid() != parent:  # it died before that
            os._exit(1)
    return prepare


def at_rate(rate, seconds):
    """Delays [s], losses and processor time of a graph whose two encoders have `rate` Hz."""
    from msg_tools import NAMESPACE, convert, topics
    from msg_tools.node import Counter
    from msg_tools.readiness import unmatched
    from telescope_mount.graph import real_graph
    from telescope_mount.processes import domain
    from telescope_mount.processes.node_processes import Processes
    from telescope_mount.running_graph.watcher import Watcher
    lock, encoders = domain.claim(), (topics.INCREMENTAL, topics.ABSOLUTE)
    readings, counters, lost, drivers = [], [], {}, {}
    with tempfile.TemporaryDirectory() as folder:
        nodes = Processes(Path(folder, 'nodes'), lock.number)
        watcher = Watcher('load', lock.number, nodes.environment, nodes.check)

        def hear(topic):
            counter = Counter()

            def arrived(message, info):
                now = time.time_ns()
                counter.received(info)
                readings.append((now, convert.from_stamp(message.header.stamp),
                                 info['source_timestamp']))
            watcher.node.create_subscription(topic.message, topic.name, arrived, topic.qos)
            counters.append(counter)

        def note(message):
            for status in message.status:
                lost[status.name] = sum(int(row.value) for row in status.values
                                        if row.key in of_encoders)
        of_encoders = {f'gaps {NAMESPACE}/{topic.name}' for topic in encoders}
        for topic in encoders:
            hear(topic)

        def missed():
            return {**{name.rsplit('/', 1)[1]: count for name, count in lost.items()},
                    'this reader': sum(counter.gaps for counter in counters)}
        watcher.node.create_subscription(
            topics.ENDPOINTS.message, topics.ENDPOINTS.name, note, topics.ENDPOINTS.qos)
        specs = real_graph(bag=f'{folder}/bag', absolute_encoder=True,
                           sky={'latitude_deg': 34.3, 'longitude_deg': 109.0})
        try:
            for spec in specs:
                nodes.start(spec)
            for name in DRIVERS:
                drivers[name] = subprocess.Popen(
                    [sys.executable, __file__, '--child', 'drive', name, '--ros-args', '-r',
                     f'__ns:={NAMESPACE}', '-p', f'rate_hz:={float(rate)}'],
                    env=nodes.environment, preexec_fn=die_with_parent())
            names = [f'{NAMESPACE}/{name}' for name in (*DRIVERS, *nodes.running)]
            if not watcher.spin_until(lambda: not unmatched(names, watcher.reports), PATIENCE):
                raise RuntimeError(f'not matched: {unmatched(names, watcher.reports)[:3]}')
            watcher.spin_until(lambda: False, SETTLED)
            pids = {name: node.pid for name, node in (*drivers.items(), *nodes.running.items())}
            pids['this reader'] = os.getpid()
            before, begun = {n: processor_time(p) for n, p in pids.items()}, time.monotonic()
            readings.clear()
            already = missed()
            end = begun + seconds
            while time.monotonic() < end:
                watcher.spin(0.1)
            took, got = time.monotonic() - begun, readings[:]
            shares = _shares(before, {n: processor_time(p) for n, p in pids.items()}, took)
            watcher.spin_until(lambda: False, 1.2)  # until each node has told what it misses
            misses = {name: count - already.get(name, 0) for name, count in missed().items()}
        finally:
            for driver in drivers.values():
                driver.send_signal(signal.SIGINT)
            for driver in drivers.values():
                driver.wait(PATIENCE)
            watcher.close()
            nodes.stop()
            lock.release()
    if not got:
        raise RuntimeError(f'no reading at {rate} Hz')
    windows = {}
    for now, stamp, _ in got:
        windows.setdefault(now // 10**9, []).append((now - stamp) * 1e-9)
    delays = [(now - stamp) * 1e-9 for now, stamp, _ in got]
    whole = [_percentile(w, 0.99) for w in list(windows.values())[1:-1] or windows.values()]
    return {
        'rate': rate, 'read': len(got) / took / 2, 'p50': _percentile(delays, 0.5),
        'p99': statistics.median(whole), 'best': min(whole), 'all': _percentile(delays, 0.99),
        'max': max(delays),
        'on the way': _percentile([(now - sent) * 1e-9 for now, _, sent in got], 0.99),
        'lost': sum(misses.values()), 'misses': misses,
        'shares': shares, 'load': os.getloadavg()[0]}


# --- a flood to the log --------------------------------------------------------------------------


def recorded(seconds, rate, sources):
    """Messages of a flood that the logger has, and resources of the logger and its sources."""
    from telescope_mount.commands.info import log_info
    from telescope_mount.graph import NODES, NodeSpec
    from telescope_mount.processes import domain
    from telescope_mount.processes.node_processes import Processes
    lock, count = domain.claim(), 4 // sources
    with tempfile.TemporaryDirectory() as folder:
        nodes = Processes(Path(folder, 'nodes'), lock.number)
        nodes.start(NodeSpec('mcap_logger', NODES['mcap_logger'], {'folder': f'{folder}/bag'}))
        pid = nodes.running['mcap_logger'].pid
        floods = [subprocess.Popen(
            [sys.executable, __file__, '--child', 'flood', str(number * count), str(count),
             str(rate / sources), str(seconds)], env=nodes.environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, preexec_fn=die_with_parent())
            for number in range(sources)]
        for source in floods:
            source.stdout.readline()
        before = processor_time(pid)
        for source in floods:
            print(file=source.stdin, flush=True)
        told = [json.loads(source.stdout.readline()) for source in floods]
        took = max(row['took'] for row in told)
        used = [b - a for a, b in zip(before, processor_time(pid))]
        late = time.monotonic() + 20.0
        # what is on its way comes to the file: until the logger rests
        while time.monotonic() < late:
            time.sleep(0.5)  # a window in which a logger at work takes at least 0.05 s of a core
            now = [b - a for a, b in zip(before, processor_time(pid))]
            # neither running nor waiting for a core
            resting, used = now[0] + now[2] - used[0] - used[2] < 0.05, now
            if resting:
                break
        for source in floods:
            source.communicate('\n', timeout=PATIENCE)
        nodes.stop()
        have = lost = 0
        for bag in (f'{folder}/bag', f'{folder}/bag_truth'):
            for row in log_info(Path(bag))['topics']:
                if row['name'].endswith(tuple(topic.name for topic in _flooded())):
                    have, lost = have + row['count'], lost + (row['lost'] or 0)
    lock.release()
    sent = sum(row['sent'] for row in told)
    return {'wanted': rate, 'rate': have / took, 'sent': sent, 'have': have, 'lost': lost,
            'logger': [100 * t / took for t in used],
            'sources': [100 * row['used'] / row['took'] for row in told],
            'took': took, 'load': os.getloadavg()[0]}


# --- all -----------------------------------------------------------------------------------------


def _child(*args, tree=HERE):
    """A measurement in a separate process, as a user would start it; a dict."""
    options = run_options(tree)
    options['env']['LOAD_BEGUN'] = repr(time.time())
    done = subprocess.run(
        [sys.executable, tree / 'benchmarks/load.py', '--child', *map(str, args)],
        stdout=subprocess.PIPE, text=True, check=True, timeout=600, **options)
    return json.loads(done.stdout.splitlines()[-1])


def measure(rates=(100, 1000), seconds=3.0, starts=1, flooded=5.0, message_rate=26_000, sources=2,
            tree=HERE):
    """Everything, as dicts: of the rates, of the starts, of the flood (None without one)."""
    return ([_child('rate', rate, seconds, tree=tree) for rate in rates],
            [_child('start', tree=tree) for _ in range(starts)],
            _child('record', flooded, message_rate, sources, tree=tree) if flooded else None)


def rows_of(at_rates, starts, flooded, earlier, flooded_earlier):
    """Lines of the common table, beside the rates and the flood of an earlier commit."""
    out = [Row('load', 'readings, p99 from stamp to arrival', f'2 x {r["rate"]} Hz', r['p99'],
               BESIDE, before['p99'], LEAST if r['rate'] == 1000 else None,
               f'{r["lost"]} lost, load {r["load"]:.1f}') for r, before in zip(at_rates, earlier)]
    if starts:
        best = min(starts, key=lambda s: s['matched'])
        out.append(Row('load', 'start-up', f'{best["nodes"]} nodes', best['matched'],
                       'limit: imports alone', best['imports']))
    if flooded:
        # what was lost was not recorded
        out.append(Row('load', 'recording, a message', f'{flooded["wanted"]:g} a second',
                       1.0 / max(flooded['rate'], 1.0), BESIDE, 1.0 / flooded_earlier['rate'],
                       LEAST, f'{flooded["sent"] - flooded["have"]} lost, '
                       f'load {flooded["load"]:.1f}'))
    return out


def rows(full=False):
    """Rows of the common table."""
    options = FULL if full else {}
    with earlier_tree() as tree:
        earlier, _, flooded = measure(**{**options, 'starts': 0}, tree=tree)
        return rows_of(*measure(**options), earlier, flooded)


FULL = {'rates': RATES, 'seconds': 30.0, 'starts': 5, 'flooded': 30.0}


def tell(at_rates, starts, flooded):
    """Print the results."""
    if at_rates:
        print('two encoders, five nodes and this reader; delays in ms; p99: median and best\n'
              'window of 1 s, and of all; DDS: from publishing to the callback')
        print(f'{"Hz":>6}{"read":>8}{"p50":>8}{"p99":>8}{"best":>8}{"all p99":>9}{"max":>9}'
              f'{"DDS p99":>9}{"lost":>6}{"load":>6}')
    for r in at_rates:
        print(f'{r["rate"]:6}{r["read"]:8.1f}' + ''.join(
            f'{1e3 * r[key]:{width}.2f}' for key, width in (
                ('p50', 8), ('p99', 8), ('best', 8), ('all', 9), ('max', 9), ('on the way', 9)))
            + f'{r["lost"]:6}{r["load"]:6.1f}')
    if at_rates:
        for r in at_rates:
            if r['lost']:
                print(f'lost at {r["rate"]} Hz: ' + ', '.join(
                    f'{name} {count}' for name, count in r['misses'].items() if count))
        print('\n% of a core, main thread + others (main thread ready and without a core)\n'
              + ' ' * 20 + ''.join(f'{r["rate"]:>17} Hz' for r in at_rates))
        for name in at_rates[0]['shares']:
            print(f'{name:20}' + ''.join(
                '{:>20}'.format('{:.1f} + {:.1f} ({:.0f})'.format(*r['shares'][name]))
                for r in at_rates))
    for s in starts:
        print(f'start-up of {s["nodes"]} nodes: {s["matched"]:.2f} s; imports of the command '
              f'{s["own imports"]:.2f} s, beside them those of the nodes {s["imports"]:.2f} s')
    if flooded:
        f = flooded
        print(f'recording 4 topics: {f["have"]} of {f["sent"]} messages, {f["lost"]} gaps, '
              f'{f["rate"]:.0f} msg/s for {f["took"]:.1f} s; logger {f["logger"][0]:.0f} + '
              f'{f["logger"][1]:.0f} % of a core (main thread + DDS; {f["logger"][2]:.0f} % '
              f'without one), sources '
              f'{" + ".join(f"{share:.0f}" for share in f["sources"])} %; load {f["load"]:.1f}')


def main():
    """Run the requested parts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--rates', type=int, nargs='*', metavar='HZ')
    parser.add_argument('--seconds', type=float, help='at each rate')
    parser.add_argument('--starts', type=int)
    parser.add_argument('--flood', type=float, metavar='SECONDS')
    parser.add_argument('--message-rate', type=float, default=26_000)
    parser.add_argument('--sources', type=int, default=2, choices=(1, 2, 4),
                        help='processes that publish the flood')
    args = parser.parse_args()
    asked = {'rates': args.rates, 'starts': args.starts, 'flooded': args.flood}
    if any(value is not None for value in asked.values()):  # that, and nothing else
        asked = {'rates': (), 'starts': 0, 'flooded': 0.0} | {
            name: value for name, value in asked.items() if value is not None}
    else:
        asked = FULL if args.full else {}
    if args.seconds is not None:
        asked = asked | {'seconds': args.seconds}
    tell(*measure(**asked, message_rate=args.message_rate, sources=args.sources))


def be_child(what, *args):
    """Run as the child given by `--child`."""
    if what == 'drive':
        del sys.argv[1:4]  # a node takes ROS arguments only
        drive(args[0])
    elif what == 'flood':
        flood(int(args[0]), int(args[1]), float(args[2]), float(args[3]))
    elif what == 'start':
        print(json.dumps(start_up()))
    elif what == 'record':
        print(json.dumps(recorded(float(args[0]), float(args[1]), int(args[2]))))
    else:
        print(json.dumps(at_rate(int(args[0]), float(args[1]))))


if __name__ == '__main__':
    if sys.argv[1:2] == ['--child']:
        be_child(*sys.argv[2:])
    else:
        main()
