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

"""Our executor compared with rclpy's `SingleThreadedExecutor` and `EventsExecutor`.

    python benchmarks/executor.py                  all of it, about 10 minutes on two cores
    python benchmarks/executor.py --messages --rounds 3

- messages: latency from publishing in another process to the callback, two subscriptions, at 100 Hz
  and 1 kHz each; CPU time per message; time to empty a full queue;
- starts: a busy node is ended by SIGINT as soon as it spins: exit codes, hangs, crashes;
- behaviour: requirements of this project's nodes, one case after the other;
- nights: `telescope-mount night --seed 1` in a scratch copy of the packages with the executor
  replaced. `EventsExecutor` of rclpy 7.1.6 hangs in `spin`, passes (message, info) as one argument
  and cannot answer for an async service. `SingleThreadedExecutor` runs no other callback of a group
  while one of it awaits. The copies, and the starts, work around these faults to test the rest.

The executors take turns within each round. Printed are medians over the rounds, and ratios to ours.
CPU time is that of the receiving process, or of all processes of the night.
"""

import argparse
import os
import re
import resource
import select
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from executor_cases import CASES

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ('msg_tools', 'pointing_model', 'calibration', 'encoder_sim', 'encoder_reading',
            'telescope_mount')
OURS, OTHERS = 'ours', ('single', 'events')
EXECUTORS = (OURS, *OTHERS)
RATES = (100, 1000)
#: what takes the place of msg_tools/executor.py in the copy for a night
SHIMS = {
    'single': """import rclpy.node
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor as NodeExecutor
_serve = rclpy.node.Node.create_service

def create_service(self, *args, callback_group=None, **options):
    return _serve(self, *args, callback_group=callback_group or ReentrantCallbackGroup(), **options)

rclpy.node.Node.create_service = create_service
""",
    'events': """import inspect
import rclpy.node
import rclpy.service
from benchmarks_executor import Spinning as NodeExecutor
_subscribe = rclpy.node.Node.create_subscription
_respond = rclpy.service.Service.send_response

def create_subscription(self, kind, topic, callback, *args, **options):
    try:
        inspect.signature(callback).bind(None)
        bare = True
    except TypeError:
        bare = False
    if not bare:
        def whole(*args):
            callback(*(args[0] if len(args) == 1 else args))
        whole.__signature__ = inspect.signature(lambda message, info: None)
    else:
        whole = callback
    return _subscribe(self, kind, topic, whole, *args, **options)

def create_service(self, kind, name, callback, **options):
    served = _serve(self, kind, name, callback, **options)
    served.node = self
    return served

def send_response(self, response, header):
    if not inspect.iscoroutine(response):
        return _respond(self, response, header)
    async def later():
        _respond(self, await response, header)
    self.node.executor.create_task(later())

_serve = rclpy.node.Node.create_service
rclpy.node.Node.create_subscription = create_subscription
rclpy.node.Node.create_service = create_service
rclpy.service.Service.send_response = send_response
""",
}


def executor_class(name):
    """The class, or what makes one, by its name here."""
    if name == 'single':
        from rclpy.executors import SingleThreadedExecutor
        return SingleThreadedExecutor
    if name == 'events':
        from rclpy.experimental.events_executor import EventsExecutor
        return EventsExecutor
    from msg_tools.executor import NodeExecutor
    return NodeExecutor


class Spinning:
    """An EventsExecutor whose `spin` has a timeout: without one it runs nothing and never ends."""

    def __init__(self, *, context=None):
        import rclpy
        from rclpy.experimental.events_executor import EventsExecutor
        self._context = context or rclpy.get_default_context()
        self._inner = EventsExecutor(context=self._context)

    def __getattr__(self, name):
        return getattr(self._inner, name)

    def spin(self):
        """Until the context is shut down."""
        while self._context.ok():
            self._inner.spin_once(timeout_sec=1.0)


class Spun:
    """A node in a context of its own, and an executor that spins it."""

    def __init__(self, name, domain=None):
        import rclpy
        from rclpy.context import Context
        from rclpy.node import Node
        from rclpy.signals import SignalHandlerOptions
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain,
                   signal_handler_options=SignalHandlerOptions.NO)
        self.executor = executor_class(name)(context=self.context)
        self.node = Node(f'spun_{os.getpid()}', context=self.context,
                         start_parameter_services=False, enable_rosout=False)
        self.executor.add_node(self.node)

    def until(self, condition, patience=10.0):
        end = time.monotonic() + patience
        while not condition() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)
        return bool(condition())

    def matched(self, *pubs):
        return self.until(lambda: all(pub.get_subscription_count() for pub in pubs))


# --- messages -----------------------------------------------------------------------------------

def publish(rate):
    """Until stdin closes, two topics at `rate` Hz each, with the time of publishing [ns]."""
    from std_msgs.msg import Int64
    source = Spun('single')
    pubs = [source.node.create_publisher(Int64, name, 1000) for name in ('left', 'right')]
    due = time.monotonic()
    while not select.select([sys.stdin], [], [], max(0.0, due - time.monotonic()))[0]:
        for pub in pubs:
            pub.publish(Int64(data=time.monotonic_ns()))
        due = max(due + 1.0 / rate, time.monotonic() - 0.1)


def listen(name, seconds):
    """Delays of what another process publishes, and processor time a message; JSON to stdout."""
    import json

    from std_msgs.msg import Int64
    spun, delays = Spun(name), []
    for topic in ('left', 'right'):
        spun.node.create_subscription(
            Int64, topic, lambda m: delays.append(time.monotonic_ns() - m.data), 1000)
    spun.until(lambda: len(delays) > 50)
    delays.clear()
    begun, end = time.process_time(), time.monotonic() + seconds
    while time.monotonic() < end:
        spun.executor.spin_once(timeout_sec=0.1)
    used = time.process_time() - begun
    delays.sort()
    print(json.dumps({
        'p50 [us]': delays[len(delays) // 2] / 1e3,
        'p99 [us]': delays[len(delays) * 99 // 100] / 1e3,
        'CPU a message [us]': used / len(delays) * 1e6}))


def drain(name):
    """Messages a second of processor time out of a queue of 4000; JSON to stdout."""
    import json

    from std_msgs.msg import Int64
    spun, got = Spun(name), []
    spun.node.create_subscription(Int64, 'deep', lambda m: got.append(m.data), 5000)
    pub = spun.node.create_publisher(Int64, 'deep', 5000)
    spun.matched(pub)
    rates = []
    for _ in range(5):
        got.clear()
        for number in range(4000):
            pub.publish(Int64(data=number))
        begun = time.process_time()
        spun.until(lambda: len(got) == 4000, 30.0)
        rates.append(4000 / (time.process_time() - begun))
        assert got == list(range(4000)), f'{name} lost or swapped messages'
    print(json.dumps({'drained [msg/s]': statistics.median(rates)}))


def _child(*args, **options):
    return subprocess.run([sys.executable, __file__, '--child', *map(str, args)], text=True,
                          stdout=subprocess.PIPE, **options)


def _measure(*args):
    import json
    return json.loads(_child(*args, check=True, timeout=120).stdout.splitlines()[-1])


def messages(rounds, seconds):
    """{(rate, what): {executor: [values]}} and its table."""
    out = {}
    for turn in range(rounds):
        order = EXECUTORS[turn % 3:] + EXECUTORS[:turn % 3]
        for rate in RATES:
            source = subprocess.Popen([sys.executable, __file__, '--child', 'publish', str(rate)],
                                      stdin=subprocess.PIPE)
            for name in order:
                for what, value in _measure('listen', name, seconds).items():
                    out.setdefault(f'{rate} Hz, {what}', {}).setdefault(name, []).append(value)
            source.stdin.close()
            source.wait()
        for name in order:
            for what, value in _measure('drain', name).items():
                out.setdefault(what, {}).setdefault(name, []).append(value)
    _table('messages, two subscriptions', out)


def _table(title, rows):
    print(f'\n{title}: median, and ratio to ours')
    print(f'{"":34}{OURS:>10}' + ''.join(f'{name:>18}' for name in OTHERS))
    for what, values in rows.items():
        middle = {name: statistics.median(row) for name, row in values.items()}
        print(f'{what:34}{middle[OURS]:10.1f}' + ''.join(
            f'{middle[name]:10.1f} ({middle[name] / middle[OURS]:4.2f})' if name in middle
            else f'{"failed":>17}' for name in OTHERS))


# --- starts and stops ---------------------------------------------------------------------------

def starts(count):
    """Exit codes of `count` nodes an executor that SIGINT ends; 'hang' after 15 s."""
    print(f'\n{count} starts and stops by SIGINT: exit code x times')
    for name in EXECUTORS:
        done = _child('starts', name, count, timeout=20 * count + 60)
        print(f'{name:10}{done.stdout.strip() or f"failed with {done.returncode}"}')


def _start_and_stop(name, count):
    """Fork nodes from a process that has imported everything, as the fork server does."""
    from collections import Counter

    import msg_tools.node_process as module
    from msg_tools import topics
    from msg_tools.node import MountNode

    class Busy(MountNode):
        """Hears itself a thousand times a second."""

        def __init__(self, ready):
            super().__init__('busy')
            self._ready = ready
            self._pub = self.publisher(topics.OFFSET)
            self.create_subscription(topics.OFFSET.message, topics.OFFSET.name, self._on, 100)
            self.create_timer(0.001, lambda: self._pub.publish(topics.OFFSET.message()))

        def _on(self, message):
            if self._ready:
                os.write(self._ready, b'1')
                self._ready = None

    module.NodeExecutor = Spinning if name == 'events' else executor_class(name)
    ends = Counter()
    for _ in range(count):
        here, there = os.pipe()
        pid = os.fork()
        if pid == 0:
            os.close(here)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            sys.exit(module.run_node(lambda: Busy(there)))  # noqa: B023 (of this turn)
        os.close(there)
        if not select.select([here], [], [], 15.0)[0]:
            ends['never ready'] += 1
        os.close(here)
        os.kill(pid, signal.SIGINT)
        end = time.monotonic() + 15.0
        while os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
            if time.monotonic() > end:
                os.kill(pid, signal.SIGKILL)
                break
            time.sleep(0.005)  # polls the end of a process; nothing is measured here
        code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        ends['hang' if code == -signal.SIGKILL else code] += 1
    print(', '.join(f'{code} x {number}' for code, number in ends.items()))


# --- behaviour ----------------------------------------------------------------------------------

def behaviour():
    """A table of `CASES`, each in a process of its own."""
    print(f'\n{"behaviour":38}' + ''.join(f'{name:>16}' for name in EXECUTORS))
    for case in CASES:
        words = []
        for name in EXECUTORS:
            done = _child('case', name, case.__name__, stderr=subprocess.PIPE, timeout=60)
            errors = re.findall(r'^[\w.]*?(\w+(?:Error|Exception))\b', done.stderr, re.MULTILINE)
            words.append({0: 'ok', 3: 'no'}.get(
                done.returncode, (errors or [f'ended {done.returncode}'])[-1][:15]))
        print(f'{case.__name__.replace("_", " "):38}' + ''.join(f'{w:>16}' for w in words)
              + f'  {case.__doc__}')


# --- nights -------------------------------------------------------------------------------------

def nights(rounds):
    """Wall and processor time of a whole night of processes."""
    out = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in EXECUTORS:
            copy = Path(folder, name)
            for package in PACKAGES:
                if (ROOT / package).is_dir():
                    shutil.copytree(ROOT / package, copy / package)
            if name in SHIMS:
                (copy / 'msg_tools' / 'executor.py').write_text(SHIMS[name])
                shutil.copy(__file__, copy / 'benchmarks_executor.py')
                shutil.copy(ROOT / 'benchmarks' / 'executor_cases.py', copy)
        for turn in range(rounds):
            for name in EXECUTORS[turn % 3:] + EXECUTORS[:turn % 3]:
                _night(Path(folder, name), turn, name, out)
    _table('night --seed 1', out)


def _night(copy, turn, name, out):
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(
        [sys.executable, '-m', 'telescope_mount.cli', 'night', '--seed', '1', '--out',
         copy / f'night_{turn}'], cwd=copy, env={**os.environ, 'PYTHONPATH': str(copy)},
        capture_output=True, text=True, timeout=300)
    if done.returncode:
        print(f'night, {name}: {done.stderr.strip().splitlines()[-1:]}')
        return
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    for what, value in (('wall [s]', time.monotonic() - begun), ('CPU [s]', used)):
        out.setdefault(what, {}).setdefault(name, []).append(value)


def main():
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for part in ('messages', 'starts', 'behaviour', 'nights'):
        parser.add_argument(f'--{part}', action='store_true')
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--seconds', type=float, default=3.0, help='of listening at one rate')
    parser.add_argument('--count', type=int, default=200, help='of starts and stops')
    parser.add_argument('--child', nargs='+', help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        _be_child(*args.child)
        return
    from telescope_mount.dds import dds_environment
    from telescope_mount.processes import domain
    lock = domain.claim()
    os.environ.update(dds_environment(lock.number))
    everything = not (args.messages or args.starts or args.behaviour or args.nights)
    if args.behaviour or everything:
        behaviour()
    if args.messages or everything:
        messages(args.rounds, args.seconds)
    if args.nights or everything:
        nights(args.rounds)
    if args.starts or everything:
        starts(args.count)


def _be_child(what, *args):
    if what == 'publish':
        publish(float(args[0]))
    elif what == 'listen':
        listen(args[0], float(args[1]))
    elif what == 'drain':
        drain(args[0])
    elif what == 'starts':
        _start_and_stop(args[0], int(args[1]))
    else:
        case = next(c for c in CASES if c.__name__ == args[1])
        sys.exit(0 if case(Spun(args[0])) else 3)


if __name__ == '__main__':
    main()
