"""The observing plan as work that waits: what is done step by step, and what each step awaits.

The sequencer knows no ROS. It reads `Instruments` and `InForce`, and asks whoever runs it, its
outbox, for all else; each new thing to know is followed by `Sequencer.advance`.
"""

import json
from dataclasses import replace
from functools import partial

import numpy as np

from msg_tools.status import Progress
from msg_tools.steps import Refused, Steps, call
from msg_tools.units import DEG

from ..earth import earth_orientation
from ..star_catalogue import POLARIS_HIP, load_catalogue
from ..target import StarTarget, satellite_target
from ..zero_exposures import MARK
from .blind_checks import CHECKS_FORMAT, CHECKS_VERSION, blind_summary
from .exposing import Exposer
from .fault_watch import FaultWatch
from .instruments import MOUNT
from .plan import POWER_CYCLES, parse_plan
from .pointing import Standing
from .star_choice import Limits, choose_stars
from .zero_choice import ZeroChoice

#: what a star takes, to know that it stays within the limits until its turn, s
SECONDS_A_STAR = 40.0
#: targets in a row that the guard refuses, after which the plan is given up
REFUSALS = 5
_HOUR = 3_600_000_000_000  # ns


class Sequencer:
    """Runs a plan.

    Parameters
    ----------
    outbox
        Whoever runs it, with these methods (times are int, ns):

        - ``value(name)``: a parameter of the star observer
        - ``sky()``: site and weather of now, sky.Site and sky.Weather
        - ``mount()``: the `Mount`
        - ``now()``: the (simulated) time; 0 before it is known
        - ``waiting_for()``: what the graph still lacks before a plan can begin, list of str
        - ``client(verb)``: client of a service, see `msg_tools.steps.call`
        - ``send_command(track)``: ask for a `Track`
        - ``refusal(stamp)``: why the guard refused the track that began then, '' if it did not
        - ``held()``: why the mount may not be moved now, '' if it may
        - ``send_row(run, stamp)``: publish an observation, a PointingRun of one row
        - ``send_table(run, stamp)``: publish all rows so far
        - ``send_checks(text)``: publish the document of the blind checks
        - ``send_status(progress, text)``: publish how far the plan is, a `Progress`
        - ``refuse_frame(reason)``: count an exposure that cannot be used
        - ``get_logger()``: a logger with ``info``, ``warning`` and ``error``
    instruments : Instruments
    in_force : InForce
    table : Table

    Attributes
    ----------
    text : str
        What it does or waits for.
    earth : str
        What is known of the Earth's orientation.
    begun : bool
        Whether a plan has ever got beyond waiting for the graph.
    """

    def __init__(self, outbox, instruments, in_force, table):
        self._out, self._instruments, self._in_force = outbox, instruments, in_force
        self._table = table
        self._exposer = Exposer(outbox, instruments, in_force, table, self._need_home,
                                self._set_waiting)
        self._steps = Steps(self._ended)
        self._progress = Progress()
        self.text = 'the start'
        self.earth = ''
        self._told = None
        self._lacks = ''  # what the graph lacks before a plan can begin, in words
        self._watch = FaultWatch(outbox, instruments, self._exposer)
        self._calibrated = 0
        self._refusals = 0  # in a row
        self._homes = False  # the plan homes the mount itself
        self.begun = False
        self._plan, self._left = '', None
        self._earlier = 0  # rows of this step that an observer before has taken
        self._evening = 0
        self._checks = []
        self._catalogue = self._polaris = None

    # --- from outside -------------------------------------------------------------------------

    @property
    def busy(self):
        """Whether a plan is under way."""
        return self._steps.busy

    @property
    def progress(self):
        """How far it is, `Progress`."""
        return replace(self._progress, observations=len(self._table), run=self._instruments.run,
                       plan=self._plan)

    def start(self, plan):
        """Take up a plan; it begins with the next `advance`."""
        self._plan = plan
        self._steps.start(self._follow(plan))

    def advance(self):
        """Go on with the plan as far as the conditions allow."""
        if not self._steps.busy:
            return
        self._steps.advance()
        self._tell()

    def _tell(self):
        words = self.text
        if self.busy:
            words = '; '.join([words if self.begun else self._lacks or words,
                               *self._watch.sentences])
        now = words, self.progress
        if now != self._told:
            self._told = now
            self._out.send_status(self.progress, words)

    @property
    def faults(self):
        """What is wrong now and what to do, sentences."""
        return self._watch.sentences

    def look(self, now):
        """Name what is wrong with the instruments, and give a plan up that cannot go on.

        Parameters
        ----------
        now : float
            Wall time that goes on, s.

        Returns
        -------
        bool
            Whether something else is wrong than at the last look.
        """
        if not self.busy:
            return self._watch.rest()
        waits = self.text if self._progress.state == 'waiting' else ''
        lacks = ', '.join(self._out.waiting_for()) if waits and not self.begun else ''
        self._lacks = f'{waits}: {lacks}' if lacks else ''
        waits = self._lacks or waits
        changed, reason = self._watch.look(now, self.begun, waits,
                                           self._progress.step.split(' ')[0], len(self._table))
        if reason:
            self._steps.end(Refused(reason))
            self._watch.rest()
        self._tell()
        return changed

    def cancel(self, reason):
        """End the plan here; whether there was one."""
        if not self._steps.busy:
            return False
        self._steps.cancel()
        self._set_state('cancelled', reason)
        self._told = self.text, self.progress
        self._out.send_status(self.progress, self.text)
        self._out.get_logger().warning(f'plan cancelled: {reason}')
        return True

    def pointing_changed(self):
        """A new model or zero is in force."""
        self._exposer.forget_aim()
        self.advance()

    def calibration_has(self, count):
        """So many observations have reached the calibration."""
        if count < self._calibrated:
            # it was started anew and knows nothing of the night so far
            self._send_table(again=True)
        self._calibrated = count
        self.advance()

    def rows_turned_up(self):
        """Somebody has rows of the night: a plan that has begun without any begins again.

        Who is discovered first is not told, and the calibration may be the last. A plan that has
        not yet given a row goes back to waiting for the graph, and so for the rows.
        """
        if not (self._steps.busy and self.begun) or len(self._table):
            return
        self._out.get_logger().info('the calibration has rows of the night so far: '
                                    'the plan begins again, with them')
        self.begun = False
        self._progress = Progress()
        self._steps = Steps(self._ended)
        self.start(self._plan)

    def take_up(self, run, stamp, left):
        """Take the rows of the night so far, and where its plan stood, before a plan begins.

        Parameters
        ----------
        run : PointingRun
        stamp : int
            Of the last row, ns.
        left : Progress or None
            The last that was heard of the plan.
        """
        self._table.restore(run, stamp)
        self._instruments.remember_runs(run['run'], run.get('encoder_start'))
        self._left = left
        self._out.get_logger().info(
            f'took up {len(run)} observations of the night so far; they are of power-ons '
            + ', '.join(f'{number:.0f}' for number in np.unique(run['run'])))
        self.advance()

    # --- the plan -----------------------------------------------------------------------------

    def _ended(self, error):
        if error is None:
            self._set_state('done', 'plan finished')
            self._out.get_logger().info(f'plan finished: {len(self._table)} observations, '
                                 f'{self._progress.lost} stars lost')
        else:
            self._set_state('failed', str(error))
            self._out.get_logger().error(str(error))

    def _follow(self, plan):
        """The night as a generator of conditions to wait for."""
        self._set_state('waiting', 'the graph')
        yield lambda: not self._out.waiting_for()
        yield lambda: self._out.now() > 0
        self._evening = self._out.now()
        orientation = earth_orientation(self._evening * 1e-9)
        self.earth = orientation.statement()
        self._out.get_logger().info(self.earth)
        self._exposer.exposed = self._table.newest or self._evening + 1
        self.begun = True
        steps = parse_plan(plan)
        if any(step.verb == 'satellite' for step in steps) and not self._out.value('satellite'):
            raise Refused('the plan has a step satellite: set the parameter satellite')
        if any(step.verb == 'polaris' for step in steps):
            self._check_polaris()  # now, not after a block of stars
        first, done = self._where_it_stood(plan, steps)
        for number, step in enumerate(steps):
            if number < first:
                continue
            self._progress = Progress(step=str(step), block=number, total=step.exposures,
                                      lost=self._progress.lost, done=done)
            self._set_state('observing', str(step))
            if not (done and done >= step.count):
                yield from getattr(self, f'_do_{step.verb}')(step.what or step.count - done)
            done = self._earlier = 0
            self._send_table()

    def _where_it_stood(self, plan, steps):
        """Number of the step to go on with, and its exposures that are done."""
        left, self._left, self._earlier = self._left, None, 0
        if left is None or not len(self._table):
            return 0, 0
        if left.plan != plan or left.state not in ('observing', 'waiting'):
            self._out.get_logger().info('the plan of these observations is another or is over: '
                                        'this one begins at its start')
            return 0, 0
        first, done = left.block, left.done
        self._earlier = self._table.trailing(first)
        self._homes = any(step.verb == 'home' for step in steps[:first])
        rows = self._table.rows
        waited = max((n for n, step in enumerate(steps[:first]) if step.verb == 'wait'),
                     default=-1)
        # when the night began nobody tells: about when its first star was observed
        self._evening = next((row['stamp'] for row in rows if row['block'] > waited),
                             rows[-1]['stamp'])
        self._progress = replace(self._progress, lost=left.lost)
        for number in {int(row['block']) for row in rows if row['check'] and row['block'] < first}:
            self._checks.append({'block': number, **blind_summary(
                [[row['miss_x'], row['miss_y']] for row in rows if row['block'] == number])})
        if steps[first].verb == 'power_cycle' and self._has_been_off(steps[first].what, rows):
            first += 1  # the power has been off since the last row
        self._out.get_logger().info(
            f'the plan goes on at step {first + 1} of {len(steps)}, {steps[first]}'
            + (f', of which {done} are done' if done else ''))
        return first, done

    def _has_been_off(self, what, rows):
        """Whether the encoders that a `power_cycle` switches tell a power-on without a row."""
        told = {'power_cycle': ('encoder_start', self._instruments.power_on),
                'absolute/power_cycle': ('absolute_start', self._instruments.absolute_power_on)}
        return all(power_on is not None and all(row.get(name) != power_on.started for row in rows)
                   for name, power_on in map(told.get, POWER_CYCLES[what or 'incremental']))

    def _do_stars(self, count):
        yield from self._need_home()  # the choice begins at where the mount stands
        for target in self._fresh_stars(count):
            yield from self._observe(target)

    def _do_check(self, count):
        """Point at fresh stars blind: the miss distance is the pointing error."""
        yield from self._need_home()
        first = len(self._table) - self._earlier
        lost = self._progress.lost
        for target in self._fresh_stars(count):
            yield from self._observe(target, blind=True)
        self._checks.append({'block': self._progress.block, **blind_summary(
            [[row['miss_x'], row['miss_y']] for row in self._table.rows[first:]],
            self._progress.lost - lost, self._in_force.model)})
        self._out.send_checks(json.dumps({
            'format': CHECKS_FORMAT, 'version': CHECKS_VERSION, 'checks': self._checks}))

    def _do_polaris(self, count):
        self._check_polaris()
        rows = len(self._table)
        for _ in range(count):
            yield from self._observe(self._polaris)
        if len(self._table) == rows:  # a zero now would be that of an earlier power-on
            raise Refused(f'none of {count} exposures shows Polaris: look at sky, site and time')

    def _do_zero_on_stars(self, count):
        yield from self._need_home()
        chosen = self._zero_choice().stars(count)
        self._out.get_logger().info(chosen.words)
        self._progress.step += f': {chosen.by}'
        rows = len(self._table)
        yield from chosen.expose(partial(self._observe, for_zero=True), self._table)
        if len(self._table) == rows:
            raise Refused(f'none of {count} exposures shows a star for the zero: look at sky, site '
                          'and time')

    def _do_zero(self, count):
        """By Polaris where it is well up, else by stars."""
        yield from self._need_home()
        way = self._zero_choice().way(count)
        self._out.get_logger().info(f'zero by {"Polaris" if way.polaris else "stars"}: {way.why}')
        if not way.polaris:
            yield from self._do_zero_on_stars(count)
            return
        self._progress.step += ': Polaris'
        yield from self._do_polaris(count)

    def _do_satellite(self, count):
        yield from self._need_home()
        satellite = satellite_target(self._out.value('satellite'))
        self._check_height(satellite, satellite.name, 'track it at another time')
        for _ in range(count):
            yield from self._observe(satellite)
            self._exposer.earliest = self._exposer.commanded + round(
                self._out.value('satellite_interval_s') * 1e9)

    def _do_wait(self, count):
        """Stand still until so many hours after the last evening: the next one."""
        yield from self._need_home()
        self._evening = self._exposer.earliest = self._evening + count * _HOUR
        yield from self._exposer.expose(Standing(self._instruments.here, self._out.mount()))

    def _do_home(self, count=0):
        self._homes = True
        before = self._instruments.stamp
        while not self._instruments.homed_since(before):
            yield from self._call('home')
            # an encoder that was connected late has missed the crossing: home again when it has
            # fallen silent
            self._instruments.hear(MOUNT)
            yield from self._until(
                lambda: self._instruments.homed_since(before) or MOUNT in self._instruments.silent(
                    self._out.value('answer_timeout_s')),
                'the encoder to be homed')

    def _do_power_cycle(self, what):
        for service in POWER_CYCLES[what or 'incremental']:
            if service == 'power_cycle':
                self._instruments.homed = False
            yield from self._call(service)

    def _do_calibrate_zero(self, count):
        yield from self._calibration_has_all()
        yield from self._call('calibrate_zero')
        newest = self._table.newest
        known = self._in_force
        yield from self._until(
            lambda: max(known.zero_stamp, known.refused_stamp) >= newest, 'the new zero')
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

    def _observe(self, target, blind=False, for_zero=False):
        row = yield from self._exposer.observe(target, self._progress.block, blind)
        if row is None:
            self._progress.lost += 1
            why = self._exposer.refusal
            self._out.get_logger().warning(
                f'{target.name}: {why or "nothing in the field"}; go on with the next')
            self._refusals = self._refusals + 1 if why else 0
            if self._refusals == REFUSALS:
                self._refusals = 0
                raise Refused(f'{REFUSALS} targets in a row were refused: {why}')
        else:
            self._refusals = 0
            self._out.send_row(self._table.add({**row, MARK: float(for_zero)}), row['stamp'])
        self._progress.done += 1

    def _fresh_stars(self, count):
        """Targets all over the sky that were not observed tonight, in observing order."""
        value = self._out.value
        rows = choose_stars(
            self._stars(), self._exposer.now() * 1e-9, *self._out.sky(), count,
            value('star_seed') + self._progress.block, value('min_elevation_deg') * DEG,
            value('max_elevation_deg') * DEG, value('magnitude_limit'),
            exclude=[*self._table.stars_since(self._evening), POLARIS_HIP],
            duration=count * SECONDS_A_STAR, start=self._instruments.here,
            mount=self._out.mount(), limits=self._limits())
        return [StarTarget(self._catalogue.select([row])) for row in rows]

    def _limits(self):
        return Limits(*(self._out.value(f'{name}_limit_deg') * DEG for name in Limits._fields))

    def _stars(self):
        if self._catalogue is None:
            # two magnitudes deeper, so that neighbours which would disturb are known
            self._catalogue = load_catalogue(mag_limit=self._out.value('magnitude_limit') + 2.0)
        return self._catalogue

    def _zero_choice(self):
        """What to expose for a zero, under the conditions of now."""
        return ZeroChoice(
            self._stars(), self._table, self._exposer.now() * 1e-9, *self._out.sky(),
            mount=self._out.mount(), axes=self._limits(), model=self._in_force.model,
            run=self._instruments.run, evening=self._evening, here=self._instruments.here,
            limits=[self._out.value(name) for name in (
                'min_elevation_deg', 'max_elevation_deg', 'magnitude_limit')],
            a_star=SECONDS_A_STAR)

    def _check_polaris(self):
        if self._polaris is None:
            self._polaris = StarTarget(load_catalogue(hip=[POLARIS_HIP]))
        self._check_height(self._polaris, 'Polaris', 'set the zero on stars (zero_on_stars)')
        time, mount = np.array([self._exposer.now() * 1e-9]), self._out.mount()
        place = self._polaris.place(time, *self._out.sky())
        highest = self._out.value('max_elevation_deg')
        if not Limits().reached(mount, *place, highest * DEG)[0]:
            angle = abs(mount.axes_of(*place)[1][0])
            raise Refused(f'Polaris stands at {angle / DEG:.1f} deg of {mount.names.axes[1]}, '
                          f'beyond max_elevation_deg = {highest}, and tells no zero of the '
                          f'{mount.names.axes[0]} there: set it on stars (zero_on_stars)')

    def _check_height(self, target, name, remedy):
        lowest = self._out.value('min_elevation_deg')
        time = np.array([self._exposer.now() * 1e-9])
        el = target.place(time, *self._out.sky())[1][0]
        if el < lowest * DEG:
            raise Refused(f'{name} stands at {el / DEG:.1f} deg, below min_elevation_deg = '
                          f'{lowest}: {remedy}')

    def _new_model(self, verb):
        yield from self._calibration_has_all()
        known, newest = self._in_force, self._table.newest
        before = known.models
        yield from self._call(verb)
        yield from self._until(
            lambda: known.models > before and known.model_stamp >= newest, 'the new model')
        yield from self._until(known.zero_is_of_model, 'the zero of the new model')

    def _calibration_has_all(self):
        yield from self._until(lambda: self._calibrated >= len(self._table),
                               'calibration to take the last observation')

    def _need_home(self):
        health = self._instruments.health
        if health.blocked:
            yield from self._until(lambda: not health.blocked, f'an end: {health.blocked}')
        if not self._instruments.homed and self._homes:
            self._out.get_logger().warning('the encoder has no zero any more: homing again')
            yield from self._do_home()
        if not self._instruments.homed:
            yield from self._until(lambda: self._instruments.homed,
                                   'the encoder to be homed (call home)')

    def _call(self, verb):
        answer = yield from call(verb, self._out.client(verb), self.advance, self._until)
        self._out.get_logger().info(answer)

    def _until(self, condition, what):
        self._set_waiting(what)
        yield condition
        self._set_waiting('')

    # --- what others see ----------------------------------------------------------------------

    def _set_waiting(self, what):
        """Waiting for `what`, or for nothing."""
        self._set_state('waiting' if what else 'observing', what or self._progress.step)

    def _set_state(self, state, text):
        self._progress.state, self.text = state, text

    def _send_table(self, again=False):
        run = self._table.all(again)
        if run is not None:
            self._out.send_table(run, self._table.newest)
