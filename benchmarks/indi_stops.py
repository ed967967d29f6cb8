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

"""Does the mount of INDI's simulator stop when a process is killed in the middle of a slew?

    python benchmarks/indi_stops.py [--times N] [--quiet-seconds S] [--busy N] [--full]

INDI's telescope simulator, `indi_mount`, the guard and a commander are separate processes. In the
middle of a slew one of them is killed with SIGKILL. The motion of the axes is observed through a
separate connection. They count as stopped from their last change if none follows within three
seconds; the simulator moves and reports them ten times a second. Then, with `--quiet-seconds`, all
of them follow a track for this time beside `--busy` busy loops: any alarm of the guard and any stop
sent is false. `--full` takes ten times each and 180 s.
"""

import argparse
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from guard_stops import DOMAIN, ROOT, Listener, wait
from rclpy.context import Context
from rclpy.node import Node

from msg_tools import convert, topics
from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.site import DEFAULT_SITE
from telescope_mount.bridges.indi.client import IndiClient
from telescope_mount.bridges.indi.indi_telescope import IndiTelescope
from telescope_mount.nights.server_night import SIMULATED, server_graph

sys.path.append(str(Path(__file__).resolve().parents[1] / 'examples' / 'simulated_servers'))
from indi_server import DEVICE, SimulatorServer, missing
from indi_simulator import set_model

KILLED = ('commander', 'mount_guard', 'indi_mount')
TARGETS = {'commander': 'at rest 0.5 s', 'mount_guard': 'the last piece is over: 1.6 s',
           'indi_mount': 'at rest 0.5 s'}
#: between which it slews, hour angle and declination, deg
PLACES = (30.0, 20.0), (80.0, 60.0)
#: s after a death in which it is looked whether the axes move again
AFTER = 3.0


def command():
    """Request a star, like an observer."""
    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = Node('commander', context=context, namespace='/mount')
    pub = node.create_publisher(topics.REQUEST.message, topics.REQUEST.name, topics.REQUEST.qos)
    first, second, every = map(float, sys.argv[2:5])
    times = np.arange(0.0, 1801.0, 20.0)
    rates = np.tile([15.041067 * ARCSEC, 0.0], (len(times), 1))
    track = convert.trajectory(
        time.time_ns(), times, np.array([first, second]) * DEG + times[:, None] * rates, rates,
        ('hour_angle', 'declination'))
    owners = node.create_publisher(
        topics.REQUEST_OWNER.message, topics.REQUEST_OWNER.name, topics.REQUEST_OWNER.qos)
    owners.publish(convert.owner(track, node))
    while True:
        pub.publish(track)
        time.sleep(every)  # the commander's own rate


class Axes:
    """Records the simulator through a separate client: time, property and value."""

    def __init__(self, port):
        self.rows, self.said, self.state = [], [], ''
        self.client = IndiClient('localhost', port, update=self._heard)
        self.client.start()

    def _heard(self, device, name, vector):
        if name == 'MOUNT_AXES':
            self.rows.append((vector.received * 1e-9, *vector.values.values()))
        elif name in ('TELESCOPE_ABORT_MOTION', 'TELESCOPE_TRACK_STATE', 'EQUATORIAL_EOD_COORD'):
            if name.startswith('EQUATORIAL'):
                if vector.state == self.state:
                    return
                self.state = vector.state
            self.said.append((vector.received * 1e-9, name, vector.state, vector.on))

    @property
    def slewing(self):
        """Whether the driver reports a slew."""
        return self.state == 'Busy'

    def rate(self):
        """Rate of the faster axis, deg/s, over the last two ticks."""
        if len(self.rows) < 2:
            return 0.0
        (t0, *a), (t1, *b) = self.rows[-2:]
        return float(np.abs(np.subtract(b, a)).max() / max(t1 - t0, 1e-3))


class Graph:
    """The processes."""

    def __init__(self, port, every):
        self.port, self.every, self.running = port, every, {}
        self._specs = {spec.name: spec for spec in server_graph(
            bag='', server={'host': 'localhost', 'port': port, 'device': DEVICE}, mount='german',
            sky={}, slews=SIMULATED)}

    def start(self, name, *extra):
        """Start a process, replacing an earlier one."""
        env = os.environ | {'ROS_DOMAIN_ID': str(DOMAIN), 'PYTHONPATH': str(ROOT),
                            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        if name == 'commander':
            words = [__file__, '--commander', *map(str, extra), self.every]
        else:
            spec = self._specs[name]
            words = ['-m', 'msg_tools.node_process', spec.module, '--ros-args', '-r',
                     '__ns:=/mount']
            for key, value in spec.parameters.items():
                # the site is the default one, and the sky the same for all
                words += ['-p', f'{key}:={value!r}' if not isinstance(value, str)
                          else f"{key}:='{value}'"]
        self.running[name] = subprocess.Popen([sys.executable, *map(str, words)], env=env,
                                              stdout=subprocess.DEVNULL,
                                              stderr=subprocess.DEVNULL)

    def kill(self, name):
        """Kill a process."""
        self.running[name].send_signal(signal.SIGKILL)
        self.running[name].wait()

    def close(self):
        """End all processes."""
        for process in self.running.values():
            process.kill()


def kill_one(name, graph, axes, listener, number, verbose):
    """Kill a process during a slew: s to the guard's stop, to the abort, and to rest."""
    graph.start('commander', *PLACES[number % 2])
    if not wait(lambda: listener.state in ('following', 'around'), 20.0):
        graph.kill('commander')  # the others have not found it
        graph.start('commander', *PLACES[number % 2])
    if not wait(lambda: axes.slewing and axes.rate() > 4.0):
        raise SystemExit(f'the mount does not slew: {listener.told[-3:]}')
    time.sleep(0.5 + 0.037 * number)  # another phase of the slew and of all timers each time
    began = time.time()
    graph.kill(name)
    wait(lambda: False, AFTER)
    at, *angles = np.array([row for row in axes.rows if row[0] > began]).T
    final = np.array(angles)[:, -1:]
    moving = np.abs(np.array(angles) - final).max(0) > 0.5 / 3600.0
    rest = at[np.flatnonzero(moving)[-1] + 1] - began if moving.any() else 0.0
    aborted = next((t - began for t, what, *_ in axes.said
                    if t > began and what == 'TELESCOPE_ABORT_MOTION'), np.nan)
    said = next((t - began for t, state, *_ in listener.told
                 if t > began and state in ('stopped', 'aborted')), np.nan)
    if verbose:
        for t, *what in axes.said:
            if t > began:
                print(f'    {t - began:6.3f}', *what)
        for t, *place in axes.rows:
            if 0.0 < t - began < 1.5:
                print(f'    {t - began:6.3f} axes {place[0]:.5f} {place[1]:.5f}')
    if name != 'commander':
        graph.kill('commander')
        graph.start(name)
        time.sleep(8.0)  # it finds the others
    return said, aborted, rest


def quiet(seconds, busy, graph, axes, listener):
    """Messages of the guard beside busy loops while nothing is wrong."""
    loops = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(busy)]
    try:
        graph.start('commander', *PLACES[0])
        wait(lambda: listener.state == 'following' and axes.rate() < 0.1, 60.0)
        time.sleep(20.0)  # amid a track: the slew's end is not to be judged
        count, loads, began = len(listener.told), [], time.time()
        for _ in range(int(seconds / 10.0)):
            time.sleep(10.0)  # load is read so often
            loads.append(os.getloadavg()[0])
        stops = [t - began for t, what, *_ in axes.said
                 if t > began and what == 'TELESCOPE_ABORT_MOTION']
        return listener.told[count:], stops, np.mean(loads) if loads else np.nan
    finally:
        for loop in loops:
            loop.kill()
        graph.kill('commander')


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--times', type=int, default=2)
    parser.add_argument('--killed', default=','.join(KILLED), help='which of them')
    parser.add_argument('--quiet-seconds', type=float, default=0.0)
    parser.add_argument('--busy', type=int, default=8)
    parser.add_argument('--renew', type=float, default=0.1, help='of the request, s')
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--verbose', action='store_true')
    args = parser.parse_args()
    if args.full:
        args.times, args.quiet_seconds = 10, 180.0
    if missing():
        sys.exit(missing())
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    with SimulatorServer() as server:
        with IndiClient('localhost', server.port) as client:
            telescope = IndiTelescope(client, DEVICE)
            telescope.connect()
            set_model(telescope, {})
            telescope.prepare(DEFAULT_SITE)
        graph = Graph(server.port, args.renew)
        axes, listener = Axes(server.port), Listener()
        try:
            for name in ('indi_mount', 'mount_guard'):
                graph.start(name)
            wait(lambda: listener.told, 60.0)
            time.sleep(6.0)  # the slowest of the simulator's own starts
            print(f'{"killed":12} {"times":>5} {"guard stops it":>16} {"abort is heard":>16} '
                  f'{"axes stand":>16}  s: median, worst')
            for name in args.killed.split(',') if args.times else ():
                found = np.array([kill_one(name, graph, axes, listener, k, args.verbose)
                                  for k in range(args.times)])
                columns = [f'{np.nanmedian(c):.2f}, {np.nanmax(c):.2f}'
                           if np.isfinite(c).any() else '-' for c in found.T]
                print(f'{name:12} {args.times:5} {columns[0]:>16} {columns[1]:>16} '
                      f'{columns[2]:>16}  {TARGETS[name]}', flush=True)
            if args.quiet_seconds:
                said, stops, load = quiet(args.quiet_seconds, args.busy, graph, axes, listener)
                print(f'{args.quiet_seconds:.0f} s beside {args.busy} busy loops, load '
                      f'{load:.1f} on {os.cpu_count()} cores: {len(said)} alarms '
                      f'{said[:5]}, {len(stops)} stops sent')
        finally:
            graph.close()
            axes.client.close()
    os._exit(0)


if __name__ == '__main__':
    if sys.argv[1:2] == ['--commander']:
        command()
    main()
