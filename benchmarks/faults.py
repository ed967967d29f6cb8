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

"""Killed nodes and lying instruments during a night: is a wrong zero or model published?

    python benchmarks/faults.py                  # a small sample of both tables
    python benchmarks/faults.py --full           # 8 nodes x 20 moments, 10 faults x 10 moments
    python benchmarks/faults.py --nodes star_observer --moments 4 --faults none

Nights with all processes (scenario `default`): stars, Polaris, power off and on, Polaris, stars,
fit, blind stars. A node is killed with SIGKILL and restarted, or an instrument begins to send wrong
data and continues to the end. Zero and model published at the end are compared, over the sky, with
the true axis angles of the simulated mount, in units of their stated sigma. An error above four
sigma without a warning counts as a falsehood.

For a lying instrument, this program relays the topic of the simulated one and changes its messages.
A "second" instrument is an additional publisher on the topic.
"""

import argparse
import json
import signal
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import yaml
from zero_drift import axes_on

from encoder_sim.mount_geometry import MountGeometry
from encoder_sim.scenario_file import load_scenario
from msg_tools import NAMESPACE, convert, topics
from msg_tools.status_rows import Progress
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.active_calibration import ActiveCalibration
from pointing_model.calibration_messages import ZeroPairs
from telescope_mount.graph import NIGHT, night_graph
from telescope_mount.observing.plan import parse_plan
from telescope_mount.processes import domain
from telescope_mount.processes.node_processes import Processes
from telescope_mount.running_graph.watcher import Watcher

PLAN = ('home, stars 12, polaris 5, calibrate_zero, power_cycle, home, polaris 5, calibrate_zero, '
        'stars 12, fit, check 6')
TOTAL = sum(step.exposures for step in parse_plan(PLAN))
#: wall seconds without progress after which a night is given up; one that waits for an instrument
#: that lies to be mended has said so long before
STALL, STALL_OF_LIARS = 40.0, 12.0
LIMIT = 4.0  # sigma
NOISE = 1.0  # of a star in the scenario, arcsec an axis
HOUR = 3600 * 10**9


# --- what instruments do --------------------------------------------------------------------------


@dataclass
class Liar:
    """Relays the topic of a simulated instrument to the graph, and changes it.

    Parameters
    ----------
    topic : Topic
    change : callable
        ``change(message, memory)`` returns the message to pass on, or None, once lying has begun;
        `memory` is a dict that is kept between calls.
    second : bool
        Do not relay the instrument: publish the changed messages in addition.
    """

    topic: object
    change: object
    second: bool = False
    lies: bool = False
    memory: dict = field(default_factory=dict)

    @property
    def raw(self):
        """Name of the topic on which the simulated instrument publishes."""
        return self.topic.name if self.second else f'{self.topic.name}_raw'

    def attach(self, node):
        """Subscribe and publish with `node`."""
        self._node = node
        self._pub = None
        if not self.second:
            self._publish()
        node.create_subscription(self.topic.message, self.raw, self._take, self.topic.qos)

    def begin(self):
        """Begin to lie."""
        self.lies = True
        if self._pub is None:
            self._publish()

    def _publish(self):
        self._pub = self._node.create_publisher(self.topic.message, self.topic.name,
                                                self.topic.qos)

    def _take(self, message):
        if not self.lies:
            if self._pub is not None:
                self._pub.publish(message)
            self.memory['last'] = message
            return
        if self.second and self.memory.pop('own', None) == _key(message):
            return  # it hears itself
        out = self.change(message, self.memory)
        if out is not None:
            self.memory['own'] = _key(out)
            self._pub.publish(out)


def _key(message):
    values = message.vector if hasattr(message, 'vector') else tuple(message.position)
    return convert.from_stamp(message.header.stamp), str(values)


def _camera(miss):
    def change(message, memory):
        return convert.sky_vector(convert.from_stamp(message.header.stamp),
                                  *miss(convert.read_sky_vector(message)))
    return change


def _same(message, memory):
    """The last true values, with new stamps."""
    last = memory.setdefault('frozen', memory.get('last', message))
    if hasattr(message, 'vector'):
        return convert.sky_vector(convert.from_stamp(message.header.stamp),
                                  *convert.read_sky_vector(last))
    _, angles, rates, effort = convert.read_joints(last)
    return convert.joint_state(convert.from_stamp(message.header.stamp), angles, rates, effort,
                               message.header.frame_id)


def _stamped(stamp):
    def change(message, memory):
        now = convert.from_stamp(message.header.stamp)
        _, angles, rates, effort = convert.read_joints(message)
        return convert.joint_state(stamp(now, memory), angles, rates, effort,
                                   message.header.frame_id)
    return change


def _moved(az, el):
    def change(message, memory):
        stamp, angles, rates, effort = convert.read_joints(message)
        return convert.joint_state(stamp + 1000, np.add(angles, [az, el]), rates, effort)
    return change


FAULTS = {
    'second camera': lambda: Liar(topics.MISS_DISTANCE, _camera(
        lambda miss: (2000.0 * ARCSEC, -900.0 * ARCSEC)), second=True),
    'camera says zero': lambda: Liar(topics.MISS_DISTANCE, _camera(lambda miss: (0.0, 0.0))),
    'camera frozen': lambda: Liar(topics.MISS_DISTANCE, _same),
    'camera mirrored': lambda: Liar(topics.MISS_DISTANCE, _camera(
        lambda miss: (-miss[0], -miss[1]))),
    'second encoder': lambda: Liar(topics.INCREMENTAL, _moved(20.0 * ARCSEC, -15.0 * ARCSEC),
                                   second=True),
    'encoder frozen': lambda: Liar(topics.INCREMENTAL, _same),
    'encoder says NaN': lambda: Liar(topics.INCREMENTAL, _moved(np.nan, np.nan)),
    'encoder stamps stand': lambda: Liar(topics.INCREMENTAL, _stamped(
        lambda now, memory: memory.setdefault('stamp', now))),
    'encoder stamps jump': lambda: Liar(topics.INCREMENTAL, _stamped(
        lambda now, memory: now + HOUR)),
    'encoder stamps run back': lambda: Liar(topics.INCREMENTAL, _stamped(
        lambda now, memory: 2 * memory.setdefault('stamp', now) - now)),
}


# --- a night --------------------------------------------------------------------------------------


class Remapped(Processes):
    """Processes with remapped topics."""

    remaps = {}

    def start(self, spec):
        """See `Processes.start`."""
        params = self.folder / f'{spec.name}.params.yaml'
        params.write_text(yaml.safe_dump({'/**': {'ros__parameters': spec.parameters}}))
        arguments = ['--ros-args', '-r', f'__ns:={NAMESPACE}', '--params-file', str(params)]
        for old, new in self.remaps.get(spec.name, {}).items():
            arguments += ['-r', f'{old}:={new}']
        self.running[spec.name] = self._fork_server.start(
            name=spec.name, modules=[spec.module], arguments=arguments,
            environment=self.environment, log=str(self.folder / f'{spec.name}.log'))


@dataclass
class Result:
    """Result of a night."""

    completed: bool = False
    ended: str = ''
    off_sigma: float = np.nan  # of what is published, None published: NaN
    off_arcsec: float = np.nan
    words: list = field(default_factory=list)  # refusals and alarms
    expected: bool | None = None  # whether the expected error holds 100 fresh stars
    wall: float = 0.0

    @property
    def false(self):
        """Whether a wrong zero or model was published without a warning."""
        return bool(self.off_sigma > LIMIT) and not self.words


PUBLISHED_BY = {topics.MISS_DISTANCE.name: 'camera', topics.INCREMENTAL.name:
                'incremental_encoder', topics.ABSOLUTE.name: 'absolute_encoder'}


def night(folder, seed, moment=None, node='', liar=None, scenario='default'):
    """One night; at `moment` (exposures made) a node is killed, or a liar begins.

    Returns
    -------
    Result
    """
    began = time.monotonic()
    specs = {spec.name: spec for spec in night_graph(
        bag=str(folder / 'bag'), scenario=scenario, seed=seed, plan=PLAN)}
    lock = domain.claim(None)
    nodes = Remapped(folder / 'nodes', lock.number)
    if liar is not None and not liar.second:
        nodes.remaps = {PUBLISHED_BY[liar.topic.name]: {liar.topic.name: liar.raw}}
    out, watcher = Result(), None
    try:
        watcher = Watcher('faults', lock.number, nodes.environment, lambda: None)
        watcher.keep_results()
        heard = Heard(watcher)
        if liar is not None:
            liar.attach(watcher.node)
        for spec in specs.values():
            nodes.start(spec)
        _follow(watcher, nodes, specs, moment, node, liar, out)
        # the last words: diagnostics come once a second
        watcher.spin_until(lambda: False, 1.5)
        heard.judge(out, scenario, seed)
    finally:
        if watcher is not None:
            watcher.close()
        nodes.stop()
        lock.release()
    out.wall = time.monotonic() - began
    return out


def _follow(watcher, nodes, specs, moment, node, liar, out):
    last, since = None, time.monotonic()
    while True:
        watcher.spin(0.1)
        status = watcher.latest.get(topics.OBSERVER_STATUS.name)
        at = Progress.read(status)
        now = at.observations, at.lost, at.step, at.state, len(watcher.reports)
        if now != last:
            last, since = now, time.monotonic()
        if moment is not None and at.observations + at.lost >= moment and at.state != 'done':
            moment = None
            if node:
                _kill(nodes, specs, node)
                watcher.latest.pop(topics.OBSERVER_STATUS.name if node == 'star_observer' else '',
                                   None)
            else:
                liar.begin()
            continue
        ended = [name for name, process in nodes.running.items() if process.poll() is not None]
        if ended:
            out.ended = f'{ended[0]} ended: {nodes.last_words(ended[0])}'
            return
        if at.state in ('done', 'failed'):
            out.completed = at.state == 'done'
            out.ended = status.message
            # what it has made may still be on its way
            watcher.spin_until(lambda: topics.MODEL.name in watcher.latest, 3.0)
            return
        if time.monotonic() - since > (STALL if liar is None else STALL_OF_LIARS):
            out.ended = 'nothing went on: ' + (status.message if status else 'no observer')
            return


def _kill(nodes, specs, name):
    process = nodes.running[name]
    process.send_signal(signal.SIGKILL)
    process.wait(10.0)
    spec = specs[name]
    if name == 'mcap_logger':
        spec = replace(spec, parameters=spec.parameters | {
            'folder': spec.parameters['folder'] + '_again'})
    nodes.start(spec)


class Heard:
    """Messages of the graph that are needed for the evaluation."""

    def __init__(self, watcher):
        self._watcher = watcher
        self._zero = None
        self._words, self._last = {}, {}  # ever said, said last
        self._refusals = []
        create = watcher.node.create_subscription
        create(topics.TRUTH_ZERO.message, topics.TRUTH_ZERO.name, self._on_truth,
               topics.TRUTH_ZERO.qos)
        create(topics.DIAGNOSTICS.message, topics.DIAGNOSTICS.name, self._on_diagnostics,
               topics.DIAGNOSTICS.qos)

    def _on_truth(self, message):
        stamp, zero, *_ = convert.read_joints(message)
        if self._zero is None or stamp >= self._zero[0]:
            self._zero = stamp, np.array(zero)

    def _on_diagnostics(self, message):
        for status in message.status:
            name = status.name.rsplit('/', 1)[-1]
            self._last[name] = status.message.split('; ')
            for part in status.message.split('; '):
                if any(words in part for words in SAID):
                    self._words[name, part] = None

    def judge(self, out, scenario, seed):
        """Evaluate the error of the published zero and model in their sigma, and the warnings."""
        latest = self._watcher.latest
        report = latest.get(topics.CALIBRATION_REPORT.name)
        out.words = [f'{name}: {part}' for name, part in self._words]
        out.words += [f'{name}: {part}' for name, parts in self._last.items() for part in parts
                      if any(words in part for words in SAID_AT_END)]
        if report is not None:
            out.words += json.loads(report.data)['witnesses']['alarms']
        if topics.MODEL.name not in latest or self._zero is None:
            return
        pair = ActiveCalibration()
        pair.update_model(latest[topics.MODEL.name].data)
        zeros = ZeroPairs()
        zeros.take(latest[topics.ZERO_IDENTITY.name])
        pair.update_zero(*zeros.take(latest[topics.ZERO.name]))
        if not pair.bound:
            out.words.append('zero and model do not go together')
            return
        az, el = (v.ravel() for v in np.meshgrid(
            np.arange(15.0, 360.0, 30.0) * DEG, np.array([25.0, 40.0, 55.0, 70.0]) * DEG))
        mount = load_scenario(scenario).mount
        true = np.column_stack(axes_on(MountGeometry(mount), az, el)) + self._zero[1]
        off = pair.encoder(az, el) - true
        off = np.column_stack([wrap(off[:, 0]) * np.cos(el), off[:, 1]])
        sigma = np.column_stack([np.broadcast_to(s, az.shape)
                                 for s in pair.model.sigma(az, el)])
        zero = np.nan_to_num(pair.zero.sigma)
        sigma = np.hypot(sigma, zero * np.column_stack([np.cos(el), np.ones_like(el)]))
        out.off_arcsec = float(np.sqrt(np.mean(np.sum(off**2, axis=1)))) / ARCSEC
        out.off_sigma = float(np.median(np.abs(off) / sigma, axis=0).max())
        told = pair.model.provenance.get('expected')
        if told:
            rng = np.random.default_rng(seed)
            fresh = off[rng.integers(0, len(off), 100)] / ARCSEC + NOISE * rng.normal(size=(100, 2))
            rms = np.sqrt(np.mean(np.sum(fresh**2, axis=1)))
            out.expected = bool(told['low_arcsec'] <= rms <= told['high_arcsec'])


#: what a sentence of the diagnostics has in it that refuses or warns: of an instrument, a message,
#: a model; and at the end of the night, of a zero of another power-on or of another model
SAID = ('instrument ', 'refused', 'not published')
SAID_AT_END = ('the zero in force is of', 'was not taken')


# --- the tables -----------------------------------------------------------------------------------


def _row(name, results):
    done = sum(r.completed for r in results)
    off = [r.off_arcsec for r in results if np.isfinite(r.off_arcsec)]
    worst = max((r.off_sigma for r in results if np.isfinite(r.off_sigma)), default=np.nan)
    said = sum(bool(r.words) for r in results)
    print(f'{name:26} {len(results):4} {done:6} {sum(r.false for r in results):6} {said:6} '
          f'{max(off, default=np.nan):9.2f} {worst:8.1f}   '
          f'{np.mean([r.wall for r in results]):5.1f} s', flush=True)


def main():
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--full', action='store_true', help='the sizes of the order')
    parser.add_argument('--nodes', default=','.join(NIGHT), help='killed; none')
    parser.add_argument('--moments', type=int, default=2)
    parser.add_argument('--faults', default=','.join(FAULTS), help='of instruments; none')
    parser.add_argument('--fault-moments', type=int, default=1)
    parser.add_argument('--undisturbed', type=int, default=2, help='nights')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--verbose', action='store_true')
    args = parser.parse_args()
    if args.full:
        args.moments, args.fault_moments, args.undisturbed = 20, 10, 300
    head = 'nights   done  false   said  off (") max sigma'

    def run(name, jobs):
        results = []
        for i, job in enumerate(jobs):
            with tempfile.TemporaryDirectory() as folder:
                results.append(night(Path(folder), args.seed + i, **job))
            if args.verbose:
                r = results[-1]
                print(f'   {job.get("moment")}: {"done" if r.completed else "NOT DONE"} '
                      f'{r.off_arcsec:.2f}" {r.off_sigma:.1f} sigma; {r.ended}; {r.words[:3]}',
                      flush=True)
        if results:
            _row(name, results)
        return results

    def moments(count):
        return [max(1, round((k + 0.5) / count * TOTAL)) for k in range(count)]

    print(f'{"undisturbed":26} {head}')
    quiet = run('', [{}] * args.undisturbed)
    print(f'{"killed and started again":26}')
    killed = [r for name in args.nodes.split(',') if name in NIGHT for r in run(
        name, [{'moment': m, 'node': name} for m in moments(args.moments)])]
    print(f'{"instruments that lie":26}')
    lied = [r for name in args.faults.split(',') if name in FAULTS for r in run(
        name, [{'moment': m, 'liar': FAULTS[name]()} for m in moments(args.fault_moments)])]
    print(f'\nfalsehoods (more than {LIMIT:g} of their own sigma off, nothing said; target 0): '
          f'{sum(r.false for r in killed + lied)} of {len(killed) + len(lied)}')
    told = [r.expected for r in quiet + killed + lied if r.expected is not None and not r.words]
    if told:
        print('expected error, 90 %, without an alarm: holds 100 fresh stars (83 ... 97 %): '
              f'{sum(told)} of {len(told)}')
    if killed:
        print(f'nights completed after a restart (target 90 %): '
              f'{sum(r.completed for r in killed)} of {len(killed)}')
    if quiet:
        print(f'undisturbed nights with an alarm (target 1 %): '
              f'{sum(bool(r.words) for r in quiet)} of {len(quiet)}')


if __name__ == '__main__':
    main()
