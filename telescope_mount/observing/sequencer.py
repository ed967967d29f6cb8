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

"""Carries out the observing plan step by step, with the conditions that each step awaits.

The sequencer does not use ROS. It reads `Instruments` and `ActiveCalibration`; everything else goes
through its outbox, the object that runs it. Each new piece of information is followed by
`Sequencer.advance`.
"""

import math
import time
from dataclasses import replace

import numpy as np

from msg_tools.status_rows import Progress, Taken
from msg_tools.steps import CallRefused, Steps
from pointing_model.sky.earth import earth_orientation

from .night_file import NightFile
from .night_memory import blind_summary
from .night_steps import NightSteps
from .plan import POWER_CYCLES, parse_plan
from .plan_watchdog import PlanWatchdog

#: text of a plan that an earlier observer has finished
OVER = 'plan finished before this start: observe, or star_observer/anew, begins it anew'
#: default of the parameter `looks`: `advance` may be called for a thousand readings a second
LOOKS = 0.02
#: steps without exposures that make active models and zeros
MADE = ('calibrate_zero', 'fit', 'diagnose', 'judge')


class Sequencer:
    """Runs a plan.

    Parameters
    ----------
    outbox
        The object that runs it, with these methods (times are int, ns):

        - ``value(name)``: a parameter of the star observer
        - ``sky()``: present site and weather, a site.Site and refraction.Weather
        - ``mount()``: the `Mount`
        - ``now()``: the (simulated) time; 0 before it is known
        - ``waiting_for()``: what the graph lacks before a plan can begin, list of str
        - ``client(verb)``: client of a service, see `msg_tools.steps.call`
        - ``guard``: a `GuardLink`
        - ``send_row(run, stamp)``: publish an observation, a PointingRun of one row
        - ``send_table(run, stamp)``: publish all rows so far
        - ``send_checks(document)``: publish the blind checks, a dict
        - ``send_status(progress, text)``: publish the progress of the plan, a `Progress`
        - ``refuse_frame(reason)``: count an unusable exposure
        - ``get_logger()``: a logger with ``info``, ``warning`` and ``error``
    instruments : Instruments
    active : ActiveCalibration
    table : NightMemory
    memory : NightFile, optional
        Stores the night beyond the end of the process.
    looks : float
        Wall s between two checks whether the graph is complete.

    Attributes
    ----------
    earth : str
        Statement on the Earth's orientation.
    night : NightSteps
        The steps of the plan, and their results.
    begun : bool
        Whether a plan has ever passed the wait for the graph.
    """

    def __init__(self, outbox, instruments, active, table, memory=None, looks=LOOKS):
        self._out, self._instruments, self._table = outbox, instruments, table
        self._memory = memory or NightFile()
        self.night = NightSteps(outbox, instruments, active, table, self.advance,
                                 self._memory.row)
        self._steps = Steps(self._ended)
        self.earth = ''
        self._published = None
        self._lacks = ''  # what the graph lacks before a plan can begin, in words
        self._watch = PlanWatchdog(outbox, instruments, self.night.exposer)
        self.begun = False
        self._looks, self._looked = looks, -math.inf
        self._plan, self._left = '', None
        self._before = None  # rows of the night before this plan, None if unknown
        self._calibration_is_new = False
        self._mended = 0  # newest row when the table was sent to a calibration that lacked rows

    @property
    def text(self):
        """What the plan does or waits for."""
        return self.night.text

    # --- from outside -------------------------------------------------------------------------

    @property
    def busy(self):
        """Whether a plan is under way."""
        return self._steps.busy

    @property
    def progress(self):
        """Progress of the plan, `Progress`."""
        return replace(self.night.progress, observations=len(self._table),
                       run=self._instruments.run, plan=self._plan, forgotten=self._table.forgotten)

    def start(self, plan, anew=False):
        """Accept a plan; it begins with the next `advance`.

        A plan that was interrupted is resumed where it stopped, unless `anew`.
        """
        if anew or self._left is None or plan != self._plan:
            self._left, self._before = None, len(self._table)
            self.night.progress = Progress()
        self._plan = plan
        self.night.set_state('waiting', 'the graph')
        self._steps.start(self._follow(plan))

    def advance(self):
        """Continue the plan as far as the conditions allow."""
        if not self._steps.busy:
            return
        self._steps.advance()
        self.publish()

    def stopped_at(self, plan):
        """Where `plan` was interrupted, in words; '' if it was not."""
        if self._left is None or self._left.plan != plan:
            return ''
        return f'step {self._left.block + 1}, {self._left.step}'

    def publish(self):
        """Send the progress of the plan to the outbox if it has changed."""
        words = self.night.text
        if self.busy:
            words = '; '.join([words if self.begun else self._lacks or words,
                               *self._watch.sentences])
        # checked for each reading: the inputs of `progress`, which is modified in place
        made_of = words, len(self._table), self._instruments.run, self._plan
        if (made_of, self.night.progress) != self._published:
            self._published = made_of, replace(self.night.progress)
            progress = self.progress
            if self.begun:
                self._memory.plan_state(progress, self.night.evening, self._before or 0)
            self._out.send_status(progress, words)

    @property
    def faults(self):
        """Present faults and what to do, sentences."""
        return self._watch.sentences

    def look(self, now):
        """Report faults of the instruments, and give up a plan that cannot continue.

        Parameters
        ----------
        now : float
            Monotonic wall time, s.

        Returns
        -------
        bool
            Whether the faults have changed since the last call.
        """
        if not self.busy:
            return self._watch.rest()
        waits = self.night.text if self.night.progress.state == 'waiting' else ''
        lacks = ', '.join(self._out.waiting_for()) if waits and not self.begun else ''
        self._lacks = f'{waits}: {lacks}' if lacks else ''
        waits = self._lacks or waits
        verb = self.night.progress.step.split(' ')[0]
        changed, reason = self._watch.look(now, self.begun, waits, verb, len(self._table))
        if reason:
            self._steps.end(CallRefused(reason))
            self._watch.rest()
        self.publish()
        return changed

    def cancel(self, reason):
        """End the plan; whether there was one."""
        if not self._steps.busy:
            return False
        self._steps.cancel()
        self.night.set_state('cancelled', reason)
        self._remember()
        self.publish()
        self._out.get_logger().warning(f'plan cancelled: {reason}{self._how_to_go_on()}')
        return True

    def pointing_changed(self):
        """A new model or zero is active."""
        self.night.exposer.forget_aim()
        self.advance()

    def calibration_has(self, taken):
        """Take what the calibration has received, `msg_tools.status_rows.Taken`."""
        before, table = self.night.calibrated, self._table
        anew = taken.newest < before.newest or not taken.kept and before.kept
        lacks = taken.newest == table.newest and taken.kept < table.newest_rows(taken.power_ons)
        if anew or lacks and self._mended != table.newest:
            # it does not know the night so far, or a row was lost
            self._mended = table.newest
            self._calibration_is_new = not taken.kept
            self.night.wanted = None
            self._send_table(again=True)
        self.night.calibrated = taken
        self.advance()

    def take_request(self, wanted):
        """Take the star that the calibration requests to distinguish causes, a `StarRequest`."""
        self.night.wanted = wanted
        self.advance()

    def rows_turned_up(self):
        """Rows of the night were found: a plan that has begun without any begins again.

        The order of discovery is arbitrary, and the calibration may be the last. A plan without any
        row yet goes back to waiting for the graph, and so for the rows.
        """
        if not (self._steps.busy and self.begun) or len(self._table):
            return
        self._out.get_logger().info('the calibration has rows of the night so far: '
                                    'the plan begins again, with them')
        self.begun = False
        self.night.progress = Progress()
        self._steps = Steps(self._ended)
        self.start(self._plan)

    def take_up(self, run, stamp, left, forgotten=0):
        """Take the rows of the night so far, and the state of its plan, before a plan begins.

        Parameters
        ----------
        run : PointingRun
        stamp : int
            Stamp of the last row, ns.
        left : Progress or None
            The last known progress of the plan.
        forgotten : int
            Number of rows before them, as far as the calibration knows.
        """
        # the progress may have been sent before its last row was made
        forgotten = max(forgotten, left.observations - len(run) if left else 0)
        self._table.restore(run, stamp, forgotten)
        self._before = None
        self._taken_up(run, left)

    def take_up_file(self, plan):
        """The same as `take_up`, from `memory` for `plan`; whether the plan was over.

        A plan that is over is not restarted automatically.
        """
        rows, left, evening, before = self._memory.kept
        if left is None or left.plan != plan or not rows:
            self._memory.forget()
            return False
        self._plan, self._table.rows = plan, list(rows)
        self.night.evening, self._before = evening, before
        # it is not known yet whether the calibration has them
        self.night.calibrated = Taken(self._table.newest_rows(0), newest=self._table.newest)
        self._taken_up(self._table.all(), left)
        if left.state == 'done':
            self._left, self.night.progress = None, left
            self.night.set_state('done', OVER)
            self.night.calibrated = Taken()
            self._send_table(again=True)
            self.publish()
        return left.state == 'done'

    def _taken_up(self, run, left):
        self._instruments.remember_runs(run['run'], run.get('encoder_start'))
        self._left = left
        self._out.get_logger().info(
            f'restored {len(run)} observations of this night; they are of power-ons '
            + ', '.join(f'{number:.0f}' for number in np.unique(run['run'])))
        self.advance()

    # --- the plan -----------------------------------------------------------------------------

    def _ended(self, error):
        if error is None:
            outcome = self.night.outcome
            self.night.set_state('done', 'plan finished' + (f': {outcome}' if outcome else ''))
            self._out.get_logger().info(f'plan finished: {len(self._table)} observations, '
                                 f'{self.night.progress.lost} stars lost')
        else:
            self.night.set_state('failed', str(error))
            self._remember()
            self._out.get_logger().error(f'{error}{self._how_to_go_on()}')

    def _how_to_go_on(self):
        where = self.stopped_at(self._plan)
        return where and (
            f'; stopped at {where}: observe goes on there, star_observer/anew begins anew')

    def _remember(self):
        """Store where the plan was interrupted; of that step only exposures with a row are done."""
        if self.begun:
            progress = self.progress
            self._left = replace(progress, done=self._rows_of(progress.block))

    def _rows_of(self, block):
        """Number of trailing rows that are of a step of this plan."""
        return min(self._table.trailing(block), len(self._table) - (self._before or 0))

    def _connected(self):
        """Whether the graph is complete, checked at intervals."""
        now = time.monotonic()
        if now - self._looked < self._looks:
            return False
        self._looked = now
        return not self._out.waiting_for()

    def _follow(self, plan):
        """The night, as a generator of conditions to wait for."""
        self._looked = -math.inf
        yield self._connected
        yield lambda: self._out.now() > 0
        if self._left is None or self._before is None:
            self.night.evening = self._out.now()
        self.earth = earth_orientation(self._out.now() * 1e-9).statement()
        self._out.get_logger().info(self.earth)
        self.night.exposer.exposed = self._table.newest or self.night.evening + 1
        self.begun = True
        steps = parse_plan(plan)
        if any(step.verb == 'satellite' for step in steps) and not self._out.value('satellite'):
            raise CallRefused('the plan has a step satellite: set the parameter satellite')
        if any(step.verb == 'polaris' for step in steps):
            self.night.targets.check_polaris()  # check now, not after a block of stars
        first, done = self._resume_point(plan, steps)
        if first and self._calibration_is_new:
            yield from self._make_again(steps, first, done)
        for number, step in enumerate(steps):
            if number < first:
                continue
            self.night.progress = Progress(step=str(step), block=number, total=step.exposures,
                                      lost=self.night.progress.lost, done=done,
                                      refused=self.night.progress.refused)
            self.night.set_state('observing', str(step))
            yield from self.night.do(step, done)
            done = self.night.earlier = 0
            self._send_table()

    def _resume_point(self, plan, steps):
        """Number of the step to resume, and its exposures already done."""
        left, self._left, self.night.earlier = self._left, None, 0
        if left is None or not len(self._table):
            return 0, 0
        if left.plan != plan or left.state == 'done':
            self._out.get_logger().info('the plan of these observations is another or is over: '
                                        'this one begins at its start')
            return 0, 0
        first, done = left.block, left.done
        self.night.earlier = rows_of_it = self._rows_of(first)
        if left.state in ('failed', 'cancelled'):
            done = rows_of_it  # lost stars are tried again
        elif rows_of_it > done:  # the last row was made after the last report
            done = rows_of_it if self._before is not None else done + 1
        if steps[first].exposures and done >= steps[first].exposures:
            first, done = first + 1, 0
        self.night.homes = any(step.verb == 'home' for step in steps[:first])
        rows = self._table.rows
        waited = max((n for n, step in enumerate(steps[:first]) if step.verb == 'wait'),
                     default=-1)
        # the begin of the night is unknown: about when its first star was observed
        if self._before is None:
            self.night.evening = next((row['stamp'] for row in rows if row['block'] > waited),
                                       rows[-1]['stamp'])
        self.night.progress = replace(self.night.progress, lost=left.lost)
        checked = () if self.night.checks else self._table.rows_from(self._before or 0)
        for number in sorted({int(row['block']) for row in checked
                              if row['check'] and row['block'] < first}):
            self.night.checks.append({'block': number, **blind_summary(
                [[row['miss_x'], row['miss_y']] for row in checked if row['block'] == number])})
        if self.night.checks:
            self.night.send_checks()
        if first == len(steps):
            return first, done
        if steps[first].verb == 'power_cycle' and self._has_been_off(steps[first].what, rows):
            first += 1  # the power was off since the last row
        self._out.get_logger().info(
            f'the plan goes on at step {first + 1} of {len(steps)}, {steps[first]}'
            + (f', of which {done} are done' if done else ''))
        return first, done

    def _make_again(self, steps, first, done):
        """Repeat zero and model for a calibration that was lost with the rest of the graph."""
        fits = [n for n, step in enumerate(steps[:first]) if step.verb == 'fit']
        zeros = [n for n, step in enumerate(steps[:first]) if step.verb == 'calibrate_zero']
        begin = fits[-1] if fits else zeros[-1] if zeros else first
        for step in steps[begin:first]:
            if step.verb in MADE:
                self.night.progress = replace(
                    self.night.progress, step=f'{step}, once more', block=first, done=done)
                self.night.set_state('observing', f'{step}, once more')
                yield from self.night.do(step)

    def _has_been_off(self, what, rows):
        """Whether the encoders of a `power_cycle` report a power-on without a row."""
        known = {'power_cycle': ('encoder_start', self._instruments.power_on),
                 'absolute/power_cycle': ('absolute_start', self._instruments.absolute_power_on)}
        return all(power_on is not None and all(row.get(name) != power_on.started for row in rows)
                   for name, power_on in map(known.get, POWER_CYCLES[what or 'incremental']))

    # --- what others see ----------------------------------------------------------------------

    def _send_table(self, again=False):
        run = self._table.all(again)
        if run is not None:
            self._out.send_table(run, self._table.newest)
