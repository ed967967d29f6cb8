"""The steps of an observing plan, each a generator of conditions to wait for.

Nothing here knows ROS; what a step asks for is the outbox of the `Sequencer`.
"""

import json
from dataclasses import replace
from functools import partial

import numpy as np

from msg_tools.status import Progress, Taken
from msg_tools.steps import CallRefused, call
from msg_tools.units import DEG
from pointing_model.sky.star_catalogue import (
    POLARIS_HIP,
    StarTarget,
    load_catalogue,
    satellite_target,
)
from pointing_model.zero import MARK

from . import clocks
from .axis_demand import AxesAtRest
from .discrimination_step import DiscriminationStep
from .exposure import Exposer
from .instruments import MOUNT
from .night_table import CHECKS_FORMAT, CHECKS_VERSION, blind_summary
from .order import seconds_a_star, weight_of_slews
from .plan import POWER_CYCLES
from .star_choice import AxisLimits, choose_stars
from .tracking_step import Holding
from .zero_choice import ZeroChoice

#: the last stars, which `track` does not take again
LAST_ONES = 10
#: targets in a row that the guard refuses, after which the plan is given up
REFUSALS = 5
#: what to do where `home` is not there, or has been called and does not answer
AFTER_HOME = ("start the mount's driver, or leave home out of the plan",
              "it homes the mount; if the axes stand, look at the mount's driver")
#: services of drivers; those of a simulated mount know what is asked again
MOVING = ('home', *{service for services in POWER_CYCLES.values() for service in services})
BEST = 35.0, 65.0  # elevation of a star that both axes follow evenly, deg
_HOUR = 3_600_000_000_000  # ns


class NightSteps:
    """What a plan can do.

    Parameters
    ----------
    outbox, instruments, in_force, table
        As of a `Sequencer`.
    wake : callable
        Goes on with the plan: no message need follow an answer.
    keep : callable
        Called with a row before it is published.

    Attributes
    ----------
    exposer : Exposer
    progress : Progress
        How far the plan is.
    text : str
        What it does or waits for.
    evening : int
        When the night began, or its last `wait` was over, ns.
    checks : list of dict
        Blind checks so far.
    clocks : dict
        What the last step `clocks` has measured.
    calibrated : msg_tools.status.Taken
        Observations that have reached the calibration.
    homes : bool
        Whether the plan homes the mount itself.
    earlier : int
        Rows of this step that an observer before has taken.
    refusal : str
        The last target that the guard has refused, and why.
    asked : Asked or None
        By the calibration.
    outcome : str
        What the last step that tells it has come to.
    """

    def __init__(self, outbox, instruments, in_force, table, wake, keep):
        self._out, self._instruments, self._in_force = outbox, instruments, in_force
        self._table, self._wake, self._keep = table, wake, keep
        self.exposer = Exposer(outbox, instruments, in_force, table, self._need_home,
                               self.set_waiting)
        self.progress, self.text = Progress(), 'the start'
        self.evening, self.checks, self.calibrated = 0, [], Taken()
        self.homes, self.earlier, self.clocks = False, 0, {}
        self._refusals, self._refused = 0, set()  # in a row; stars, by their numbers
        self.refusal, self.asked, self.outcome = '', None, ''
        self._catalogue = self._polaris = None

    def do(self, step, done=0):
        """Steps that do `step`, of which so many exposures are done."""
        left, self.outcome = replace(step, count=step.count - done), ''
        what = {'track': step, 'tell_apart': left}.get(step.verb, step.what or left.count)
        yield from getattr(self, f'_do_{step.verb}')(what)

    def set_waiting(self, what):
        """Waiting for `what`, or for nothing."""
        self.set_state('waiting' if what else 'observing', what or self.progress.step)

    def set_state(self, state, text):
        """Take the state of the plan, and what is said of it."""
        self.progress.state, self.text = state, text

    def send_checks(self):
        """Publish the blind checks."""
        clocks_too = {'clocks': self.clocks} if self.clocks else {}
        self._out.send_checks(json.dumps({
            'format': CHECKS_FORMAT, 'version': CHECKS_VERSION, 'checks': self.checks,
            **clocks_too}))

    @property
    def clocks_told(self):
        """What is known of the clocks of camera and encoder, '' where nothing is."""
        return self.clocks and clocks.sentence(
            self.clocks['found'], self.clocks['camera_late_s'], self.clocks['absolute']) or ''

    # --- the steps ----------------------------------------------------------------------------

    def _do_stars(self, count):
        yield from self._need_home()  # the choice begins at where the mount stands
        yield from self._observe_fresh(count)

    def _do_check(self, count):
        """Point at fresh stars blind: the miss distance is the pointing error."""
        yield from self._need_home()
        first = len(self._table) - self.earlier
        lost = self.progress.lost
        yield from self._observe_fresh(count, blind=True)
        self.checks.append({'block': self.progress.block, **blind_summary(
            [[row['miss_x'], row['miss_y']] for row in self._table.rows_from(first)],
            self.progress.lost - lost, self._in_force.model)})
        self.send_checks()

    def _do_clocks(self, count):
        """Drift past one star to and fro: what the readings differ by is the clocks' offset."""
        yield from self._need_home()
        exposer, value = self.exposer, self._out.value
        while True:
            (star,) = self._fresh_stars(1, BEST)
            row = yield from exposer.observe(star, self.progress.block)
            if row is not None or not exposer.refusal:
                break
            self._note_refusal(star)
        if row is None:
            self._out.get_logger().warning(f'{star.name}: nothing in the field; the offset of the '
                                           'clocks is not measured')
            return
        pointing, place = exposer.aimed_at(star), np.zeros(2)
        rows, seconds = [], []
        full = clocks.rate_for(value('exposure_s'), value('clock_rate_arcsec_s'))
        for rate in clocks.legs(count, full):
            out = np.abs(place) > clocks.FARTHEST  # an exposure that took long led too far
            rate = np.where(out, -np.sign(place) * np.abs(rate), rate)
            row, second, place = yield from exposer.drift(pointing, rate, place)
            rows += [row] if row else []
            seconds += [second] if second else []
            if exposer.refusal:
                break
        self.clocks = {
            'star': star.number, 'camera_late_s': value('camera_late_s'),
            'found': clocks.offset_of(rows), 'exposures': rows,
            'absolute': clocks.offset_of(seconds), 'absolute_exposures': seconds}
        found = self.clocks['found']
        log = self._out.get_logger()
        (log.warning if found is None or clocks.is_off(found) else log.info)(self.clocks_told)
        self.send_checks()

    def _do_track(self, step):
        """Keep the expected error of the model below a goal, with as few stars as do it."""
        yield from self._need_home()
        self.outcome = yield from Holding(
            self._out, self.exposer, self._in_force, self._table, self._instruments,
            partial(self._fresh_stars, again=True), partial(self._observe, fresh=True),
            partial(self._observe_fresh, 1), self._until, self._calibration_has_all,
            self._tell).steps(step)
        self._tell(self.outcome)

    def _do_tell_apart(self, step):
        """What the calibration asks for, to tell causes apart."""
        yield from self._need_home()
        self.outcome = yield from DiscriminationStep(
            self._out, self.exposer, self._table, self._instruments, self._observe, self._until,
            partial(self._new_model, 'diagnose'), self._calibration_has_all, lambda: self.asked,
            self._tell, self._stars, self._limits, self._refused).steps(step)
        self._tell(self.outcome)

    def _tell(self, words):
        self._out.get_logger().info(words)
        self.set_state('observing', words)

    def _do_polaris(self, count):
        self.check_polaris()
        rows = len(self._table)
        for _ in range(count):
            yield from self._observe(self._polaris)
        if len(self._table) == rows:  # a zero now would be that of an earlier power-on
            raise CallRefused(
                f'none of {count} exposures shows Polaris: look at sky, site and time')

    def _do_zero_on_stars(self, count):
        yield from self._need_home()
        chosen = self._zero_choice().stars(count)
        self._out.get_logger().info(chosen.words)
        self.progress.step += f': {chosen.by}'
        rows = len(self._table)
        yield from chosen.expose(partial(self._observe, for_zero=True), self._table)
        if len(self._table) == rows:
            raise CallRefused(f'none of {count} exposures shows a star for the zero: look at sky, '
                              'site '
                          'and time')

    def _do_zero(self, count):
        """By Polaris where it is well up, else by stars."""
        yield from self._need_home()
        way = self._zero_choice().way(count)
        self._out.get_logger().info(f'zero by {"Polaris" if way.polaris else "stars"}: {way.why}')
        if not way.polaris:
            yield from self._do_zero_on_stars(count)
            return
        self.progress.step += ': Polaris'
        yield from self._do_polaris(count)

    def _do_satellite(self, count):
        yield from self._need_home()
        satellite = satellite_target(self._out.value('satellite'))
        self._check_height(satellite, satellite.name, 'track it at another time')
        for _ in range(count):
            yield from self._observe(satellite)
            self.exposer.earliest = self.exposer.commanded + round(
                self._out.value('satellite_interval_s') * 1e9)

    def _do_wait(self, count):
        """Stand still until so many hours after the last evening: the next one."""
        yield from self._need_home()
        self.evening = self.exposer.earliest = self.evening + count * _HOUR
        self._refused.clear()  # the Sun is elsewhere then
        yield from self.exposer.expose(AxesAtRest(self._instruments.here, self._out.mount()))

    def _do_home(self, count=0):
        self.homes = True
        yield from self.exposer.until_free()  # homing moves the mount, whoever guards it
        before = self._instruments.stamp
        while not self._instruments.homed_since(before):
            yield from self._call('home', lambda: self._instruments.homed_since(before))
            # an encoder that was connected late has missed the crossing: home again when it says
            # nothing at all; one whose readings are refused would be homed for ever
            self._instruments.hear(MOUNT)
            yield from self._until(
                lambda: self._instruments.homed_since(before) or self._instruments.mute(
                    MOUNT, self._out.value('answer_timeout_s')), 'the encoder to be homed')

    def _do_power_cycle(self, what):
        for service in POWER_CYCLES[what or 'incremental']:
            if service == 'power_cycle':
                self._instruments.homed = False
            before = self._in_force.power_on
            # of the absolute encoder only a reading tells
            known = service == 'power_cycle' and before is not None
            yield from self._call(service, partial(self._off_since, before, known))

    def _off_since(self, before, known):
        return known and self._in_force.power_on != before

    def _do_calibrate_zero(self, count):
        yield from self._calibration_has_all()
        newest = self._table.newest
        known = self._in_force

        def there():
            return max(known.zero_stamp, known.refused_stamp) >= newest

        before = there()  # of a fit with the same rows
        yield from self._call('calibrate_zero', lambda: not before and there())
        yield from self._until(there, 'the new zero')
        if known.zero_stamp < newest:  # the fit makes a zero of each power-on
            self._out.get_logger().warning(
                'the new zero is of a power-on that is over: the one before stays in force')

    def _do_fit(self, count):
        yield from self._new_model('fit')

    def _do_diagnose(self, count):
        yield from self._new_model('diagnose')

    def _do_judge(self, count):
        # it is the amended model, or the one before: published once more either way
        yield from self._new_model('judge')

    # --- parts of steps -----------------------------------------------------------------------

    def _observe_fresh(self, count, blind=False):
        """Observe so many fresh stars; for one that the guard refuses another one is chosen."""
        targets = self._fresh_stars(count)
        while targets:
            refused = 0
            for target in targets:
                refused += not (yield from self._observe(target, blind, fresh=True))
            try:
                targets = self._fresh_stars(refused) if refused else []
            except ValueError as err:
                self._out.get_logger().warning(f'{refused} stars fewer: {err}')
                self.progress.lost += refused
                return

    def _observe(self, target, blind=False, for_zero=False, fresh=False):
        """Observe a target; whether it counts: a `fresh` one that the guard refuses does not."""
        row = yield from self.exposer.observe(target, self.progress.block, blind)
        refused = row is None and bool(self.exposer.refusal)
        if refused:
            self._note_refusal(target)
        else:
            self._refusals = 0
        if row is not None:
            row = {**row, MARK: float(for_zero)}
            self._keep(row)
            self._out.send_row(self._table.add(row), row['stamp'])
        elif not refused:
            self._out.get_logger().warning(f'{target.name}: nothing in the field; go on with the '
                                           'next')
        if refused and fresh:
            return False
        self.progress.lost += row is None
        self.progress.done += 1
        return True

    def _note_refusal(self, target):
        """The guard refuses a target; `CallRefused` where it does so again and again."""
        why = self.exposer.refusal
        self.refusal = f'{target.name}: {why}'
        self.progress.refused += 1
        self._refused.add(target.number)
        self._out.get_logger().warning(f'{self.refusal}; go on with another')
        self._refusals += 1
        if self._refusals == REFUSALS:
            self._refusals = 0
            raise CallRefused(f'{REFUSALS} targets in a row were refused: {why}')

    def _fresh_stars(self, count, between=(0.0, 90.0), again=False):
        """Targets all over the sky that were not observed tonight, in observing order.

        No lower and no higher than `between`, deg, as far as the limits leave it. With `again`
        those that were observed too, but for the last ones.
        """
        value = self._out.value
        lowest, highest = value('min_elevation_deg'), value('max_elevation_deg')
        if max(lowest, between[0]) < min(highest, between[1]):
            lowest, highest = max(lowest, between[0]), min(highest, between[1])
        rows = choose_stars(
            self._stars(), self.exposer.now() * 1e-9, *self._out.sky(), count,
            value('star_seed') + self.progress.block, lowest * DEG, highest * DEG,
            value('magnitude_limit'),
            exclude=[*(self._table.last_stars(LAST_ONES) if again
                       else self._table.stars_since(self.evening)), *self._refused, POLARIS_HIP],
            duration=0.0 if again else count * seconds_a_star(value('slew_rate_deg_s')),
            start=self._instruments.here, mount=self._out.mount(), limits=self._limits(),
            slews=weight_of_slews(value('slew_rate_deg_s')))
        return [StarTarget(self._catalogue.select([row])) for row in rows]

    def _limits(self):
        return AxisLimits(*(self._out.value(f'{name}_limit_deg') * DEG
                        for name in ('meridian', 'hour_angle')), self._out.allowed())

    def _stars(self):
        if self._catalogue is None:
            # two magnitudes deeper, so that neighbours which would disturb are known
            self._catalogue = load_catalogue(mag_limit=self._out.value('magnitude_limit') + 2.0)
        return self._catalogue

    def _zero_choice(self):
        """What to expose for a zero, under the conditions of now."""
        return ZeroChoice(
            self._stars(), self._table, self.exposer.now() * 1e-9, *self._out.sky(),
            mount=self._out.mount(), axes=self._limits(), model=self._in_force.model,
            run=self._instruments.run, evening=self.evening, here=self._instruments.here,
            limits=[self._out.value(name) for name in (
                'min_elevation_deg', 'max_elevation_deg', 'magnitude_limit')],
            a_star=seconds_a_star(self._out.value('slew_rate_deg_s')))

    def check_polaris(self):
        """Refuse a plan with Polaris where it does not tell a zero."""
        if self._polaris is None:
            self._polaris = StarTarget(load_catalogue(hip=[POLARIS_HIP]))
        self._check_height(self._polaris, 'Polaris', 'set the zero on stars (zero_on_stars)')
        time, mount = np.array([self.exposer.now() * 1e-9]), self._out.mount()
        place = self._polaris.place(time, *self._out.sky())
        highest = self._out.value('max_elevation_deg')
        if not AxisLimits().reached(mount, *place, highest * DEG, time[0], [POLARIS_HIP])[0]:
            angle = abs(mount.axes_of(*place)[1][0])
            raise CallRefused(f'Polaris stands at {angle / DEG:.1f} deg of {mount.names.axes[1]}, '
                          f'beyond max_elevation_deg = {highest}, and tells no zero of the '
                          f'{mount.names.axes[0]} there: set it on stars (zero_on_stars)')

    def _check_height(self, target, name, remedy):
        lowest = self._out.value('min_elevation_deg')
        time = np.array([self.exposer.now() * 1e-9])
        el = target.place(time, *self._out.sky())[1][0]
        if el < lowest * DEG:
            raise CallRefused(f'{name} stands at {el / DEG:.1f} deg, below min_elevation_deg = '
                          f'{lowest}: {remedy}')

    def _new_model(self, verb):
        yield from self._calibration_has_all()
        known, newest = self._in_force, self._table.newest
        before = known.models

        def there():
            return known.models > before and known.model_stamp >= newest

        yield from self._call(verb, there)
        yield from self._until(there, 'the new model')
        yield from self._until(known.zero_is_of_model, 'the zero of the new model')

    def _calibration_has_all(self):
        yield from self._until(
            lambda: self.calibrated.has(self._table.of_last(self.calibrated.power_ons),
                                        self._table.newest),
            'calibration to take the last observation')

    def _need_home(self):
        health = self._instruments.health
        if health.blocked:
            yield from self._until(lambda: not health.blocked, f'an end: {health.blocked}')
        # taken up again, nothing was read yet; where the time of the graph waits for events,
        # nothing would be before something moves
        if self.homes and self._instruments.here is None and self._instruments.live:
            yield from self._until(lambda: self._instruments.here is not None,
                                   'the encoder to say where it stands')
        if not self._instruments.homed and self.homes:
            self._out.get_logger().warning('the encoder has no zero any more: homing again')
            yield from self._do_home()
        if not self._instruments.homed:
            yield from self._until(lambda: self._instruments.homed,
                                   'the encoder to be homed (call home)')

    def _call(self, verb, effect):
        """Call a service, until it has answered or `effect` shows that it was done."""
        def wait(condition, what):
            if verb == 'home':
                what = f'{what}: {AFTER_HOME[what.endswith("to answer")]}'
            return self._until(condition, what)

        # a driver that is at it need not know that it is asked again
        patient = verb in MOVING and not self._out.value('use_sim_time')
        answer = yield from call(verb, self._out.client(verb), self._wake, wait, effect, patient,
                                 0.0 if verb in MOVING else self._out.value('give_up_s'))
        self._out.get_logger().info(answer)

    def _until(self, condition, what):
        self.set_waiting(what)
        yield condition
        self.set_waiting('')
