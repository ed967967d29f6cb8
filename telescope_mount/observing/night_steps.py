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

"""The steps of an observing plan, each a generator of conditions to wait for.

This module does not use ROS; requests go through the outbox of the `Sequencer`.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from msg_tools.status_rows import Progress, Taken
from msg_tools.steps import CallRefused, call
from pointing_model.sky.star_catalogue import POLARIS_HIP, satellite_target
from pointing_model.zero import MARK

from . import camera_delay
from .axis_demand import AxesAtRest
from .discrimination_step import distinguish_causes
from .exposure import Exposer
from .instruments import MOUNT
from .night_memory import CHECKS_FORMAT, CHECKS_VERSION, blind_summary
from .pass_step import observe_pass
from .plan import POWER_CYCLES
from .step_targets import StepTargets
from .tracking_step import hold_error

#: number of last stars that `track` does not observe again
LAST_ONES = 10
#: consecutive targets refused by the guard after which the plan is given up
REFUSALS = 5
#: what to do if `home` is missing, or was called and does not answer
AFTER_HOME = ("start the mount's driver, or leave home out of the plan",
              "it is homing; if the axes do not move, look at the mount's driver")
#: services of drivers that move; those of a simulated mount recognise repeated calls
MOVING = ('home', *{service for services in POWER_CYCLES.values() for service in services})
BEST = 35.0, 65.0  # elevation at which both axes move evenly, deg
_HOUR = 3_600_000_000_000  # ns


class NightSteps:
    """Carries out the steps of a plan.

    Parameters
    ----------
    outbox, instruments, active, table
        See `Sequencer`.
    wake : callable
        Continues the plan: an answer need not be followed by a message.
    keep : callable
        Called with a row before it is published.

    Attributes
    ----------
    exposer : Exposer
    progress : Progress
        Progress of the plan.
    text : str
        What the plan does or waits for.
    evening : int
        Begin of the night, or end of its last `wait`, ns.
    checks : list of dict
        Blind checks so far.
    clocks : dict
        Result of the last step `clocks`.
    calibrated : msg_tools.status_rows.Taken
        Observations that have reached the calibration.
    homes : bool
        Whether the plan homes the mount itself.
    earlier : int
        Rows of this step taken by an earlier observer.
    refusal : str
        The last target refused by the guard, and why.
    wanted : StarRequest or None
        The star that the calibration requests.
    outcome : str
        Outcome of the last step that has one.
    refused : set of int
        Numbers of the stars refused by the guard.
    targets : StepTargets
    """

    def __init__(self, outbox, instruments, active, table, wake, keep):
        self.out, self.instruments, self.active, self.table = outbox, instruments, active, table
        self._wake, self._keep = wake, keep
        self.exposer = Exposer(outbox, instruments, active, table, self._need_home,
                               self.set_waiting)
        self.targets = StepTargets(outbox, instruments, active, table, self.exposer)
        self.progress, self.text = Progress(), 'the start'
        self.evening, self.checks, self.calibrated = 0, [], Taken()
        self.homes, self.earlier, self.clocks = False, 0, {}
        self._refusals, self.refused = 0, set()  # consecutive refusals
        self.refusal, self.wanted, self.outcome = '', None, ''

    def do(self, step, done=0):
        """Steps that carry out `step`, of which `done` exposures exist already."""
        self.outcome = ''
        if step.count:
            yield from self._need_home()
        left = replace(step, count=step.count - done) if step.exposures else step
        yield from getattr(self, f'_do_{step.verb}')(left)

    def set_waiting(self, what):
        """Set the state to waiting for `what`; '' ends the wait."""
        self.set_state('waiting' if what else 'observing', what or self.progress.step)

    def set_state(self, state, text):
        """Set the state of the plan, and its text."""
        self.progress.state, self.text = state, text

    def send_checks(self):
        """Publish the blind checks."""
        clocks_too = {'clocks': self.clocks} if self.clocks else {}
        self.out.send_checks({'format': CHECKS_FORMAT, 'version': CHECKS_VERSION,
                              'checks': self.checks, **clocks_too})

    @property
    def clocks_are_off(self):
        """Whether the clocks differ."""
        return camera_delay.is_off(self.clocks.get('found'))

    @property
    def clocks_sentence(self):
        """Sentence on the clocks of camera and encoder, '' if not measured."""
        return self.clocks and camera_delay.sentence(
            self.clocks['found'], self.clocks['camera_late_s'], self.clocks['absolute']) or ''

    # --- the steps ----------------------------------------------------------------------------

    def _do_stars(self, step):
        yield from self.observe_fresh(step.count)

    def _do_check(self, step):
        """Point at new stars blind: the miss distance is the pointing error."""
        first = len(self.table) - self.earlier
        lost = self.progress.lost
        yield from self.observe_fresh(step.count, blind=True)
        self.checks.append({'block': self.progress.block, **blind_summary(
            [[row['miss_x'], row['miss_y']] for row in self.table.rows_from(first)],
            self.progress.lost - lost, self.active.model)})
        self.send_checks()

    def _do_clocks(self, step):
        """Drift back and forth past one star: differences of the readings give the clock offset."""
        exposer, value = self.exposer, self.out.value
        while True:
            (star,) = self.fresh_stars(1, between=BEST)
            row = yield from exposer.observe(star, self.progress.block)
            if row is not None or not exposer.refusal:
                break
            self._note_refusal(star)
        if row is None:
            self.out.get_logger().warning(f'{star.name}: no star in the field; the offset of the '
                                           'clocks is not measured')
            return
        pointing, place = exposer.aimed_at(star), np.zeros(2)
        rows, seconds = [], []
        full = camera_delay.rate_for(value('exposure_s'), value('clock_rate_arcsec_s'))
        for rate in camera_delay.legs(step.count, full):
            out = np.abs(place) > camera_delay.FARTHEST  # a long exposure went too far
            rate = np.where(out, -np.sign(place) * np.abs(rate), rate)
            row, second, place = yield from exposer.drift(pointing, rate, place)
            rows += [row] if row else []
            seconds += [second] if second else []
            if exposer.refusal:
                break
        self.clocks = {
            'star': star.number, 'camera_late_s': value('camera_late_s'),
            'found': camera_delay.offset_of(rows), 'exposures': rows,
            'absolute': camera_delay.offset_of(seconds), 'absolute_exposures': seconds}
        if self.clocks['found'] is None or self.clocks_are_off:
            self.out.get_logger().warning(self.clocks_sentence)
        else:  # rclpy loggers allow one severity per line of code
            self.out.get_logger().info(self.clocks_sentence)
        self.send_checks()

    def _do_track(self, step):
        """Keep the expected error of the model below a goal, with as few stars as possible."""
        self.outcome = yield from hold_error(self, step)
        self.announce(self.outcome)

    def _do_tell_apart(self, step):
        """Observe what the calibration requests, to separate causes."""
        self.outcome = yield from distinguish_causes(self, step)
        self.announce(self.outcome)

    def announce(self, words):
        """Log what is done, and set it as the text of the plan."""
        self.out.get_logger().info(words)
        self.set_state('observing', words)

    def _do_polaris(self, step):
        self.targets.check_polaris()
        rows = len(self.table)
        for _ in range(step.count):
            yield from self.observe(self.targets.polaris)
        if len(self.table) == rows:  # otherwise the zero would be of an earlier power-on
            raise CallRefused(
                f'none of {step.count} exposures shows Polaris: look at sky, site and time')

    def _do_zero_on_stars(self, step):
        chosen = self.targets.for_zero(self.evening).stars(step.count)
        self.out.get_logger().info(chosen.words)
        self.progress.step += f': {chosen.by}'
        rows = len(self.table)
        yield from chosen.expose(partial(self.observe, for_zero=True), self.table)
        if len(self.table) == rows:
            raise CallRefused(f'none of {step.count} exposures shows a star for the zero: look at '
                              'sky, site and time')

    def _do_zero(self, step):
        """By Polaris if it is high enough, else by stars."""
        way = self.targets.for_zero(self.evening).way(step.count)
        self.out.get_logger().info(f'zero by {"Polaris" if way.polaris else "stars"}: {way.why}')
        if not way.polaris:
            yield from self._do_zero_on_stars(step)
            return
        self.progress.step += ': Polaris'
        yield from self._do_polaris(step)

    def _do_satellite(self, step):
        satellite = satellite_target(self.out.value('satellite'))
        self.targets.check_height(satellite, satellite.name, 'track it at another time')
        for _ in range(step.count):
            yield from self.observe(satellite)
            self.exposer.earliest = self.exposer.commanded + round(
                self.out.value('satellite_interval_s') * 1e9)

    def _do_pass(self, step):
        """Observe a satellite through its next pass."""
        yield from self._need_home()
        self.outcome = yield from observe_pass(self, step)
        self.announce(self.outcome)

    def _do_wait(self, step):
        """Stand still until this many hours after the last evening, the next evening."""
        self.evening = self.exposer.earliest = self.evening + step.count * _HOUR
        self.refused.clear()  # the Sun has moved
        yield from self.exposer.expose(AxesAtRest(self.instruments.here, self.out.mount()))

    def _do_home(self, _=None):
        self.homes = True
        yield from self.exposer.until_free()  # homing moves the mount, so ask the guard
        before = self.instruments.stamp
        while not self.instruments.homed_since(before):
            yield from self._call('home', lambda: self.instruments.homed_since(before))
            # an encoder that was connected late has missed the crossing: home again if it sends
            # nothing at all; if its readings are refused, homing would be repeated forever
            self.instruments.restart_silence(MOUNT)
            yield from self.until(
                lambda: self.instruments.homed_since(before) or self.instruments.mute(
                    MOUNT, self.out.value('answer_timeout_s')), 'the encoder to be homed')

    def _do_power_cycle(self, step):
        for service in POWER_CYCLES[step.what or 'incremental']:
            if service == 'power_cycle':
                self.instruments.homed = False
            before = self.active.power_on
            # the absolute encoder reports it only with a reading
            known = service == 'power_cycle' and before is not None
            yield from self._call(service, lambda before=before, known=known: (
                known and self.active.power_on != before))

    def _do_calibrate_zero(self, step):
        yield from self.calibration_has_all()
        newest = self.table.newest
        known = self.active

        def there():
            return max(known.zero_stamp, known.refused_stamp) >= newest

        before = there()  # from a fit with the same rows
        yield from self._call('calibrate_zero', lambda: not before and there())
        yield from self.until(there, 'the new zero')
        if known.zero_stamp < newest:  # the fit makes a zero for each power-on
            self.out.get_logger().warning(
                'the new zero is of an earlier power-on: the old zero stays active')
        self.instruments.health.clock()  # the zero includes the present clock error

    def _do_new_model(self, step):
        yield from self.new_model(step.verb)

    # after `judge` it is the amended model, or the previous one: published again in either case
    _do_fit = _do_diagnose = _do_judge = _do_new_model

    # --- parts of steps -----------------------------------------------------------------------

    def observe_fresh(self, count, blind=False):
        """Observe `count` new stars; one that the guard refuses is replaced by another."""
        targets = self.fresh_stars(count)
        while targets:
            refused = 0
            for target in targets:
                refused += not (yield from self.observe(target, blind, fresh=True))
            try:
                targets = self.fresh_stars(refused) if refused else []
            except ValueError as err:
                self.out.get_logger().warning(f'{refused} stars fewer: {err}')
                self.progress.lost += refused
                return

    def observe(self, target, blind=False, for_zero=False, fresh=False, pointing=None):
        """Observe a target; whether it counts: a `fresh` one refused by the guard does not."""
        row = yield from self.exposer.observe(target, self.progress.block, blind, pointing)
        refused = row is None and bool(self.exposer.refusal)
        if refused:
            self._note_refusal(target)
        else:
            self._refusals = 0
        if row is not None:
            row = {**row, MARK: float(for_zero)}
            self._keep(row)
            self.out.send_row(self.table.add(row), row['stamp'])
        elif not refused:
            self.out.get_logger().warning(f'{target.name}: no star in the field; going on with the '
                                           'next')
        if refused and fresh:
            return False
        self.progress.lost += row is None
        self.progress.done += 1
        return True

    def _note_refusal(self, target):
        """Note that the guard refused a target; `CallRefused` after too many in a row."""
        why = self.exposer.refusal
        self.refusal = f'{target.name}: {why}'
        self.progress.refused += 1
        self.refused.add(target.number)
        self.out.get_logger().warning(f'{self.refusal}; go on with another')
        self._refusals += 1
        if self._refusals == REFUSALS:
            self._refusals = 0
            raise CallRefused(f'{REFUSALS} targets in a row were refused: {why}')

    def fresh_stars(self, count, again=False, **limits):
        """Targets not observed tonight; with `again` also observed ones, except the last."""
        known = self.table.last_stars(LAST_ONES) if again else self.table.stars_since(self.evening)
        return self.targets.all_over_the_sky(
            count, self.progress.block, [*known, *self.refused, POLARIS_HIP],
            stay_up=not again, **limits)

    def new_model(self, verb):
        """Have the calibration make a model from all rows, and wait for it."""
        yield from self.calibration_has_all()
        known, newest = self.active, self.table.newest
        before = known.models

        def there():
            return known.models > before and known.model_stamp >= newest

        yield from self._call(verb, there)
        yield from self.until(there, 'the new model')
        yield from self.until(known.zero_is_of_model, 'the zero of the new model')

    def calibration_has_all(self):
        """Wait until the calibration has received all rows."""
        yield from self.until(
            lambda: self.calibrated.has(self.table.newest_rows(self.calibrated.power_ons),
                                        self.table.newest),
            'calibration to take the last observation')

    def _need_home(self):
        health = self.instruments.health
        if health.blocked:
            yield from self.until(lambda: not health.blocked, f'an end: {health.blocked}')
        # a resumed plan has no reading yet; if graph time waits for events, there will be none
        # before something moves
        if self.homes and self.instruments.here is None and self.instruments.live:
            yield from self.until(lambda: self.instruments.here is not None,
                                   'the first reading of the encoder')
        if not self.instruments.homed and self.homes:
            self.out.get_logger().warning('the encoder has lost its zero: homing again')
            yield from self._do_home()
        if not self.instruments.homed:
            yield from self.until(lambda: self.instruments.homed,
                                   'the encoder to be homed (call home)')

    def _call(self, verb, effect):
        """Call a service until it answers, or `effect` shows that it was carried out."""
        def wait(condition, what):
            if verb == 'home':
                what = f'{what}: {AFTER_HOME[what.endswith("to answer")]}'
            return self.until(condition, what)

        # a real driver may not recognise a repeated call
        patient = verb in MOVING and not self.out.value('use_sim_time')
        answer = yield from call(verb, self.out.client(verb), self._wake, wait, effect, patient,
                                 0.0 if verb in MOVING else self.out.value('give_up_s'))
        self.out.get_logger().info(answer)

    def until(self, condition, what):
        """Wait for a condition, described by `what`."""
        self.set_waiting(what)
        yield condition
        self.set_waiting('')
