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

"""Does a moving mount stop when a process is killed (SIGKILL)? With the toy telescope.

    python benchmarks/guard_stops.py [--times N] [--quiet-seconds S] [--busy N]

The toy telescope, the sample drivers, the guard and a commander are separate processes. In the
middle of a slew one of them is killed. The motion of the axes is read from the telescope's port,
bypassing ROS. Then, with `--quiet-seconds`, all of them follow a track for this time beside
`--busy` busy loops: any alarm of the guard is false.
"""

import argparse
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from std_srvs.srv import Trigger

from msg_tools import convert, topics
from msg_tools.executor import NodeExecutor
from msg_tools.units import DEG

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / 'examples'
PORT, DOMAIN = 7725, 87
SLEW = 150.0  # deg
KILLED = ('commander', 'encoder_driver', 'mount_guard', 'mount_driver')
TARGETS = {'commander': 'stop 0.5 s', 'encoder_driver': 'ERROR 1 s',
           'mount_guard': 'rest at the last knot', 'mount_driver': 'the telescope stops itself'}


class Telescope:
    """Records the axes from the port: time, first angle and rate, deg, 100 times a second."""

    def __init__(self):
        self.rows, self._on = [], True
        while True:
            try:
                self.file = socket.create_connection(('localhost', PORT), 30).makefile('rw')
                break
            except ConnectionRefusedError:
                time.sleep(0.1)  # its port is not open yet
        self.ask('home')
        threading.Thread(target=self._look, daemon=True).start()

    def ask(self, line):
        """Send a line; return the answer."""
        print(line, file=self.file, flush=True)
        return self.file.readline()

    def _look(self):
        while self._on:
            at, first, _, rate, _ = map(float, self.ask('axes').split())
            self.rows.append((at, first, rate))
            time.sleep(0.01)  # the resolution of the times that are measured

    def close(self):
        """Stop recording."""
        self._on = False


class Listener:
    """Records the guard's states."""

    def __init__(self):
        self.told, self.commands, self._context = [], [], Context()
        rclpy.init(context=self._context, domain_id=DOMAIN)
        self.node = Node('looks_on', context=self._context, namespace='/mount')
        self.node.create_subscription(topics.GUARD_STATUS.message, topics.GUARD_STATUS.name,
                                      self._on_status, topics.GUARD_STATUS.qos)
        self.node.create_subscription(topics.COMMAND.message, topics.COMMAND.name,
                                      lambda m: self.commands.append((time.time(), m)),
                                      topics.COMMAND.qos)
        self.resume = self.node.create_client(Trigger, 'resume')
        self._executor = NodeExecutor(context=self._context)
        self._executor.add_node(self.node)
        threading.Thread(target=self._executor.spin, daemon=True).start()

    def _on_status(self, message):
        rows = {row.key: row.value for row in message.values}
        self.told.append((time.time(), rows['state'], message.level, message.message))

    @property
    def state(self):
        """The last state."""
        return self.told[-1][1] if self.told else ''


def command():
    """Request a distant place, then one near it, like an observer."""
    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = Node('commander', context=context, namespace='/mount')
    pub = node.create_publisher(topics.REQUEST.message, topics.REQUEST.name, topics.REQUEST.qos)
    place = float(sys.argv[2]) * DEG
    times = np.arange(0.0, 1801.0, 20.0)
    rates = np.full((len(times), 2), 0.004 * DEG)
    track = convert.trajectory(
        time.time_ns(), times, np.array([place, 45.0 * DEG]) + times[:, None] * rates, rates)
    owners = node.create_publisher(
        topics.REQUEST_OWNER.message, topics.REQUEST_OWNER.name, topics.REQUEST_OWNER.qos)
    owners.publish(convert.owner(track, node))
    while True:
        pub.publish(track)
        time.sleep(0.2)  # well within the guard's request_timeout_s of 0.45 s


def start(name, *extra):
    """Start a process of the graph."""
    env = os.environ | {'ROS_DOMAIN_ID': str(DOMAIN), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                        'PYTHONPATH': str(ROOT)}
    space = ['--ros-args', '-r', '__ns:=/mount']
    if name == 'toy_telescope':
        words = [EXAMPLES / 'toy_telescope.py', '--port', str(PORT)]
    elif name == 'commander':
        words = [__file__, '--commander', *extra]
    elif name == 'mount_guard':
        words = ['-m', 'msg_tools.node_process', 'telescope_mount.guard.mount_guard_node', *space,
                 '--params-file', EXAMPLES / 'toy_telescope.yaml']
    else:
        words = [EXAMPLES / f'{name}.py', *space, '-p', f'port:={PORT}']
    return subprocess.Popen([sys.executable, *map(str, words)], env=env,
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def wait(until, seconds=60.0):
    """Wait until a condition holds; return whether it does."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if until():
            return True
        time.sleep(0.01)  # leaves the cores to what is measured
    return False


def kill_one(name, running, telescope, listener, number):
    """Kill a process during a slew: seconds until the guard's stop, and until the mount rests."""
    place = 100.0 + SLEW * (number % 2)
    running['commander'] = start('commander', str(place))
    if not wait(lambda: telescope.rows and abs(telescope.rows[-1][2]) > 8.0):
        raise SystemExit(f'the mount does not slew: {listener.told[-3:]}')
    began = time.time()
    running[name].send_signal(signal.SIGKILL)
    running[name].wait()
    wait(lambda: telescope.rows[-1][0] > began + 0.3 and abs(telescope.rows[-1][2]) < 0.01, 20.0)
    time.sleep(0.7)  # what the guard says may come after the mount is at rest
    at, _, rate = np.array([row for row in telescope.rows if row[0] > began]).T
    moving = np.abs(rate)
    rest = at[len(moving) - np.argmax(moving[::-1] > 0.01) - 1] - began
    said = next((t - began for t, state, *_ in listener.told
                 if t > began and state in ('stopped', 'aborted')), np.nan)
    if name != 'commander':
        running['commander'].kill()
        running['commander'].wait()
        running[name] = start(name)
        time.sleep(8.0)  # imports and discovery: nothing outside tells when all are matched
        if listener.state == 'aborted':
            listener.resume.call_async(Trigger.Request())
            wait(lambda: listener.state != 'aborted', 10.0)
    return said, rest


def quiet(seconds, busy, listener, running):
    """Messages of the guard beside busy loops while nothing is wrong."""
    loops = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(busy)]
    try:
        running['commander'] = start('commander', '170')
        wait(lambda: listener.state == 'following', 60.0)
        time.sleep(20.0)  # what starting itself makes late is not counted
        count, loads = len(listener.told), []
        for _ in range(int(seconds / 10.0)):
            time.sleep(10.0)  # a sample of the load each
            loads.append(os.getloadavg()[0])
        return listener.told[count:], np.mean(loads) if loads else np.nan
    finally:
        for loop in loops:
            loop.kill()


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--times', type=int, default=3)
    parser.add_argument('--killed', default=','.join(KILLED), help='which of them')
    parser.add_argument('--quiet-seconds', type=float, default=0.0)
    parser.add_argument('--busy', type=int, default=8)
    args = parser.parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    running = {'toy_telescope': start('toy_telescope')}
    try:
        telescope, listener = Telescope(), Listener()
        for name in ('mount_driver', 'encoder_driver', 'mount_guard'):
            running[name] = start(name)
        wait(lambda: listener.told, 60.0)
        time.sleep(3.0)  # the guard speaks before it has heard the drivers
        print(f'{"killed":16} {"times":>5} {"guard stops it":>16} '
              f'{"at rest after":>16}  s: median, worst')
        for name in args.killed.split(',') if args.times else ():
            found = np.array([kill_one(name, running, telescope, listener, k)
                              for k in range(args.times)])
            columns = [f'{np.nanmedian(c):.2f}, {np.nanmax(c):.2f}' if np.isfinite(c).any() else '-'
                       for c in found.T]
            print(f'{name:16} {args.times:5} {columns[0]:>16} {columns[1]:>16}  '
                  f'{TARGETS[name]}', flush=True)
        if args.quiet_seconds:
            said, load = quiet(args.quiet_seconds, args.busy, listener, running)
            print(f'{args.quiet_seconds:.0f} s beside {args.busy} busy loops, load {load:.1f} on '
                  f'{os.cpu_count()} cores: {len(said)} alarms {said[:5]}')
    finally:
        for process in running.values():
            process.kill()
    os._exit(0)


if __name__ == '__main__':
    if sys.argv[1:2] == ['--commander']:
        command()
    main()
