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

"""The run player: publishes a measured pointing run like an observer publishes a night."""

import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from msg_tools import convert, topics
from msg_tools.node import MountNode, Param
from msg_tools.readiness import unmatched
from msg_tools.status_rows import Progress, Taken
from msg_tools.steps import Steps, call

from .runs.run import COLUMNS, PointingRun, first_of_last
from .runs.run_messages import run_to_cloud
from .runs.run_reader import read_run

#: rows published between checks for other work
BATCH = 200
#: first number for stars with names, beyond the numbers of any catalogue
FIRST_NAMED = 1_000_001
#: stamp of the first row of a run without usable times, 2000-01-01, ns
NO_TIME = 946_684_800 * 10**9
LAST_STAMP = (2**31 - 1) * 10**9

PARAMS = (
    Param('file', '', 'the run: any file that read_run takes', fixed=True),
    Param('azimuth_origin', '', 'where azimuth 0 is in a TPOINT file', choices=('', 'N', 'S'),
          fixed=True),
    Param('check_every', 4, 'one row of so many in a row is kept out of fit and diagnosis, to '
          'judge by; 0: none', 0, 1000, fixed=True),
    Param('seed', 1, 'of the choice of these rows', 0, 2**31 - 1, fixed=True),
    Param('services', ['fit', 'diagnose'], 'what the calibration is asked for afterwards, in '
          'order', fixed=True),
    Param('wait_for_nodes', [''], 'full names of nodes that must be connected before the run '
          'starts', fixed=True),
)


def playable(run, check_every, seed):
    """Columns of a run that a topic can carry, plus those that the calibration needs.

    Parameters
    ----------
    run : PointingRun
    check_every : int
        One random row in each block of this many gets ``check`` 1; 0: none. An existing column
        is kept.
    seed : int

    Returns
    -------
    run : PointingRun
        ``run`` is 1 and ``block`` 0 if the run has none; named stars are numbered from
        `FIRST_NAMED` on.
    stamps : ndarray of int, shape (n,)
        ns, increasing; the time of each row if it is usable as a stamp.
    left_out : list of str
        Columns that are not numeric.
    """
    n = len(run)
    columns, left_out = {'run': np.ones(n), 'block': np.zeros(n), 'star': np.arange(n) + 1.0 +
                         FIRST_NAMED + n}, []
    for name, values in run.columns.items():
        if values.dtype.kind in 'fiub':
            columns[name] = values.astype(float)
        elif name == 'star':
            columns[name] = np.unique(values, return_inverse=True)[1] + float(FIRST_NAMED)
        else:
            left_out.append(name)
    if run.meta.get('raw_reading', True) is False:
        # the angles here are not raw encoder readings
        columns['az_raw'] = columns['el_raw'] = np.full(n, np.nan)
    if 'check' not in columns:
        columns['check'] = _check_rows(n, check_every, seed)
    order = [name for name in COLUMNS if name in columns]
    order += [name for name in columns if name not in COLUMNS]
    return (PointingRun({name: columns[name] for name in order}, run.meta),
            _stamps(columns.get('time'), n), left_out)


def _check_rows(n, every, seed):
    """1.0 for one random row of each `every` consecutive rows."""
    out = np.zeros(n)
    if every > 0:
        starts = np.arange(0, n, every)
        picked = starts + np.random.default_rng(seed).integers(0, every, len(starts))
        out[picked[picked < n]] = 1.0
    return out


def _stamps(time, n):
    """Increasing stamps: the rows' own times if these are usable."""
    if time is None or not np.isfinite(time).all() or time.min() <= 0.0 \
            or time.max() * 1e9 + n > LAST_STAMP:
        return NO_TIME + 10**9 * np.arange(n, dtype=np.int64)
    stamps = np.rint(time * 1e9).astype(np.int64)
    # equal or decreasing times: one nanosecond after the previous row
    step = np.arange(n)
    return np.maximum.accumulate(stamps - step) + step


class RunPlayer(MountNode):
    """Publishes `observation` row by row, then calls the calibration to fit and diagnose."""

    def __init__(self, **kwargs):
        super().__init__('run_player', PARAMS, hardware_id='measured run', **kwargs)
        if not self.value('file'):
            raise ValueError('run_player: parameter file is empty; give a pointing run with '
                             '-p file:=FILE')
        origin = self.value('azimuth_origin') or None
        run = read_run(self.value('file'), azimuth_origin=origin)
        self._run, self._stamps, left_out = playable(
            run, self.value('check_every'), self.value('seed'))
        for name in left_out:
            self.get_logger().warning(f'column {name} is not numeric and was left out')
        self._sent, self._calibrated = 0, Taken()
        self._state = ('waiting', 'the graph')
        self._step = ''
        self._last_report = None
        # discovery keeps this order: a node connected to the later topics can answer these services
        self._trigger_clients = {name: self.create_client(Trigger, name)
                       for name in self.value('services') if name}
        self._clock_pub = self.publisher(topics.CLOCK)
        self._observation_pub = self.publisher(topics.OBSERVATION)
        self._observations_pub = self.publisher(topics.OBSERVATIONS)
        self._status_pub = self.publisher(topics.OBSERVER_STATUS)
        self.subscribe(topics.CALIBRATION_STATUS, self._on_calibration)
        self._reports = self.graph_reports()
        self._steps = Steps(self._ended)
        self._steps.start(self._play())
        self._timer = self.every(0.02, self._advance)

    def _on_calibration(self, message):
        self._calibrated = Taken.read(message)

    def _advance(self):
        self._steps.advance()
        self._report()

    def _ended(self, error):
        self._timer.cancel()
        if error is None:
            self._state = ('done', f'{len(self._run)} observations published')
            self.get_logger().info(self._state[1])
        else:
            self._state = ('failed', str(error))
            self.get_logger().error(self._state[1])

    def _play(self):
        """The steps, as a generator of conditions to wait for."""
        yield lambda: not self.waiting_for()
        self._state, self._step = ('observing', 'rows'), f'rows {len(self._run)}'
        for first in range(0, len(self._run), BATCH):
            for row in range(first, min(first + BATCH, len(self._run))):
                self._publish(row)
            # no more rows in transit than a subscriber's queue holds
            yield self._all_received
        self._observations_pub.publish(run_to_cloud(self._run, int(self._stamps[-1])))
        for name, client in self._trigger_clients.items():
            self._step = name
            answer = yield from call(name, client, self._advance)
            self.get_logger().info(answer)

    def _all_received(self):
        """Whether the calibration has received all rows of the power-ons that it keeps."""
        sent = self._run['run'][:self._sent]
        return self._calibrated.has(
            len(sent) - first_of_last(sent, self._calibrated.power_ons),
            int(self._stamps[self._sent - 1]))

    def _publish(self, row):
        stamp = int(self._stamps[row])
        self._clock_pub.publish(Clock(clock=convert.to_stamp(stamp)))
        self._observation_pub.publish(run_to_cloud(self._run.select([row]), stamp))
        self._sent += 1

    def _report(self):
        state, text = self._state
        now = (state, text, self._step, self._sent, time.monotonic() // 1.0)
        if now == self._last_report:
            return
        self._last_report = now
        level = {'failed': DiagnosticStatus.ERROR, 'waiting': DiagnosticStatus.WARN}.get(
            state, DiagnosticStatus.OK)
        self._status_pub.publish(convert.status(
            level, self.get_fully_qualified_name(), text, **Progress(
                state, self._step, done=self._sent, total=len(self._run),
                observations=self._sent).rows()))

    def required(self):
        """A calibration must take the rows: its status shows it; a logger takes them, too."""
        return {self.resolve_topic_name(topic.name)
                for topic in (topics.OBSERVATION, topics.CALIBRATION_STATUS)}

    def waiting_for(self):
        """Missing subscribers, and nodes that are not fully connected."""
        missing = super().waiting_for()
        nodes = [name for name in self.value('wait_for_nodes') if name]
        if nodes and not missing and self._sent == 0:
            missing = unmatched(nodes, self._reports)
        return missing

    def problems(self):
        """A failure of the calibration."""
        state, text = self._state
        return [(DiagnosticStatus.ERROR, text)] if state == 'failed' else []

    def details(self):
        """Progress."""
        return [('file', self.value('file')), ('state', self._state[0]), ('step', self._step),
                ('rows published', str(self._sent)),
                ('kept out', str(int(np.sum(self._run['check'] != 0.0))))]
