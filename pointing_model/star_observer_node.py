"""The star observer: points the mount at catalogue stars and publishes the pointing offsets."""

import sys
import time
from dataclasses import replace
from functools import partial

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock, ClockType
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msg_tools import convert, topics
from msg_tools.node import NO_SUBSCRIPTION_EVENTS, MountNode, Param, run_node
from msg_tools.readiness import parse, unmatched
from msg_tools.units import ARCSEC, DEG, wrap

from .catalogue import POLARIS_HIP, load_catalogue
from .drivers import Thermometer, demand_angles, pointing_context
from .earth import earth_orientation
from .model import PointingModel
from .observing import blind_check
from .observing.pairing import Exposures, centred
from .observing.plan import night_plan, parse_plan
from .observing.star_choice import choose_stars
from .run import PointingRun
from .run_messages import run_to_cloud
from .sky_params import SKY_PARAMS, sky_of
from .target import StarTarget, satellite_target

#: seconds between the knots of a commanded track; the cubic between them is good to 1e-3 arcsec
KNOT = 20.0
#: an axis slower than this stands still, rad/s
STILL = 0.01 * DEG
#: what a star takes, to know that it stays within the limits until its turn, s
SECONDS_A_STAR = 40.0

PARAMS = SKY_PARAMS + (
    Param('plan', night_plan(30, 16), 'steps of the night, separated by commas', check=parse_plan),
    Param('autostart', True, 'start the plan as soon as the graph is connected', fixed=True),
    Param('wait_for_nodes', [''], 'full names of nodes that must be connected before the plan '
          'starts', fixed=True),
    Param('star_seed', 1, 'seed of the choice of stars', 0, 2**31 - 1),
    Param('magnitude_limit', 6.0, 'faintest star, Hipparcos magnitude', -2.0, 15.0),
    Param('min_elevation_deg', 20.0, 'lowest star [deg]', 0.0, 89.0),
    Param('max_elevation_deg', 85.0, 'highest star [deg]', 1.0, 90.0),
    Param('recentre_arcsec', 60.0, 'a star farther from the boresight is centred and measured '
          'again [arcsec]', 0.1, 36000.0),
    Param('on_target_arcsec', 30.0, 'largest difference of the encoder from its demand in an '
          'exposure that counts [arcsec]', 0.1, 36000.0),
    Param('slew_rate_deg_s', 4.0, 'slew rate of the mount, to plan how long a track must be '
          '[deg/s]', 0.01, 90.0),
    Param('answer_timeout_s', 5.0, 'wall time after which a pointing without an answer is '
          'commanded again [s]', 0.5, 3600.0),
    Param('first_run', 1, 'run number of the first power-on', -1000000, 1000000),
    Param('polaris_exposures', 16, 'exposures of Polaris that the service zero_on_polaris makes',
          1, 10000),
    Param('satellite', '', 'what the step satellite tracks: a file of two-line elements, or '
          'gps-26690', check=satellite_target),
    Param('satellite_interval_s', 20.0, 'least time between two exposures of it [s]', 0.0, 3600.0),
    Param('model_file', '', 'pointing model in force at the start (JSON or YAML)', fixed=True),
)


#: exposures without a star after which it is given up: one that was under way when the mount was
#: commanded is smeared
BLANKS = 3


class PlanError(Exception):
    """A step of the plan cannot be done; the text says why."""


class StarObserver(MountNode):
    """Runs the observing plan and publishes one row for every star measured."""

    def __init__(self, **kwargs):
        super().__init__('star_observer', PARAMS, hardware_id='observer', **kwargs)
        self._model = None
        if self.value('model_file'):
            self._model = PointingModel.load(self.value('model_file'))
        self._zero = np.zeros(2)
        self._carried = np.zeros(2)
        self._zero_stamp = 0
        self._model_stamp = 0
        self._models = 0
        self._thermometer = Thermometer()
        self._checks = []
        self._catalogue = None
        self._polaris = None
        self._earliest = self._evening = 0
        self._site, self._weather = sky_of(self)
        self._exposures = Exposures()
        self._last_reading = None
        self._homed = self._homes = False
        self._run = self.value('first_run') - 1
        self._rows = []
        self._rows_sent = 0
        self._measured = {}
        self._reports = {}
        self._calibrated = 0
        self._commanded = self._exposed = 0
        self._state = ('waiting', 'the start')
        self._progress = {'step': '', 'block': 0, 'done': 0, 'total': 0}
        self._lost = 0
        self._heard = {}
        self._earth = ''
        self._status_sent = None

        self._command_pub = self.publisher(topics.COMMAND)
        self._observation_pub = self.publisher(topics.OBSERVATION)
        self._observations_pub = self.publisher(topics.OBSERVATIONS)
        self._offset_pub = self.publisher(topics.OFFSET)
        self._status_pub = self.publisher(topics.OBSERVER_STATUS)
        self._checks_pub = self.publisher(topics.CHECKS)
        # before the camera's: of what waits to be taken, the thermometer comes first, so that an
        # exposure is always corrected with the same reading
        self.subscribe(topics.AMBIENT, self._on_temperature)
        self.subscribe(topics.INCREMENTAL, self._on_incremental)
        self.subscribe(topics.ABSOLUTE, self._on_absolute)
        self.subscribe(topics.MISS_DISTANCE, self._on_miss)
        self.subscribe(topics.ZERO, self._on_zero)
        self.subscribe(topics.MODEL, self._on_model)
        self.subscribe(topics.CALIBRATION_STATUS, self._on_calibration)
        if self._wanted_nodes():
            self.create_subscription(topics.DIAGNOSTICS.message, topics.DIAGNOSTICS.name,
                                     self._on_diagnostics, topics.DIAGNOSTICS.qos,
                                     event_callbacks=NO_SUBSCRIPTION_EVENTS)
        self._asked = {verb: self.create_client(Trigger, verb)
                          for verb in ('home', 'power_cycle', 'calibrate_zero', 'fit',
                                       'diagnose')}
        self.create_service(Trigger, 'observe', self._on_observe)
        self.create_service(Trigger, 'zero_on_polaris', self._on_zero_on_polaris)
        self._work = None
        self._wait = None
        if self.value('autostart'):
            self._work = self._follow(self.value('plan'))
        # steady: the observer must see a time-out while simulated time stands still
        self.create_timer(0.05, self._advance, clock=Clock(clock_type=ClockType.STEADY_TIME))

    # --- parameters -------------------------------------------------------------------------

    def check_together(self, values):
        """The limits of elevation must leave some sky."""
        if values['min_elevation_deg'] >= values['max_elevation_deg']:
            raise ValueError(f'min_elevation_deg = {values["min_elevation_deg"]} must be below '
                             f'max_elevation_deg = {values["max_elevation_deg"]}')

    def parameters_changed(self, names):
        """Take a new site or weather from the next exposure on."""
        self._site, self._weather = sky_of(self)

    def _wanted_nodes(self):
        return [name for name in self.value('wait_for_nodes') if name]

    # --- what the instruments say -------------------------------------------------------------

    def _on_incremental(self, message):
        stamp, angle, rate = convert.read_joints(message)[:3]
        self._keep('enc', stamp, angle)
        self._last_reading = (stamp, angle, rate)
        homed = bool(np.isfinite(angle).all())
        if homed and not self._homed:
            self._run += 1
        self._homed = homed
        self._hears('mount and incremental encoder')

    def _on_absolute(self, message):
        stamp, angle = convert.read_joints(message)[:2]
        self._keep('abs', stamp, angle)
        self._hears('absolute encoder')

    def _keep(self, encoder, stamp, angle):
        if self._exposures.add_reading(encoder, stamp, angle):
            self.get_logger().warning('the clock went back: the simulation started anew')

    def _on_miss(self, message):
        self._exposures.add_frame(
            convert.from_stamp(message.header.stamp), message.vector.x, message.vector.y)
        self._hears('camera')

    def _on_temperature(self, message):
        self._thermometer.take(*convert.read_temperature(message))

    def _on_zero(self, message):
        stamp, zero = convert.read_joints(message)[:2]
        if not np.isfinite(zero).all():
            raise ValueError('zero is not a number')
        self._zero, self._zero_stamp = np.array(zero), stamp
        self._carried = np.zeros(2)
        self._advance()

    def _on_model(self, message):
        self._model = PointingModel.from_json(message.data)
        self._carried = np.zeros(2)
        stamp = self._model.provenance.get('last_stamp_ns')
        self._model_stamp = stamp if isinstance(stamp, int) else 0
        self._models += 1
        self._advance()

    def _on_calibration(self, message):
        values = {row.key: row.value for row in message.values}
        taken = int(values.get('observations', 0))
        if taken < self._calibrated:
            # it was started anew and knows nothing of the night so far
            self._send_table(again=True)
        self._calibrated = taken
        self._advance()

    def _hears(self, instrument):
        self._heard[instrument] = time.monotonic()
        self._advance()

    def _silent(self):
        """Instruments that have said nothing for the time of an answer."""
        limit = time.monotonic() - self.value('answer_timeout_s')
        return [name for name, heard in self._heard.items() if heard < limit]

    def _on_diagnostics(self, message):
        for status in message.status:
            self._reports[status.name] = parse(status)

    # --- the plan -----------------------------------------------------------------------------

    def _on_observe(self, request, response):
        if self._work is not None:
            response.message = 'a plan is under way'
            return response
        self._work = self._follow(self.value('plan'))
        self._wait = None
        response.success = True
        response.message = f'plan started: {self.value("plan")}'
        return response

    def _on_zero_on_polaris(self, request, response):
        if self._work is not None:
            response.message = 'a plan is under way'
            return response
        plan = f'polaris {self.value("polaris_exposures")}, calibrate_zero'
        self._work = self._follow(plan)
        self._wait = None
        response.success = True
        response.message = f'started: {plan}; progress on {topics.OBSERVER_STATUS.name}'
        return response

    def _advance(self):
        """Go on with the plan as far as the conditions allow."""
        if self._work is None:
            return
        try:
            while self._wait is None or self._wait():
                self._wait = next(self._work)
        except StopIteration:
            self._work = None
            self._set_state('done', 'plan finished')
            self.get_logger().info(
                f'plan finished: {len(self._rows)} observations, {self._lost} stars lost')
        except (PlanError, ValueError) as err:
            self._work = None
            self._set_state('failed', str(err))
            self.get_logger().error(str(err))
        self._report()

    def _follow(self, plan):
        """The night as a generator of conditions to wait for."""
        self._set_state('waiting', 'the graph')
        yield lambda: not self.waiting_for()
        yield lambda: self.get_clock().now().nanoseconds > 0
        orientation = earth_orientation(self.get_clock().now().nanoseconds * 1e-9)
        self._earth = orientation.statement()
        self.get_logger().info(self._earth)
        self._evening = self.get_clock().now().nanoseconds
        self._exposed = self._evening + 1
        steps = parse_plan(plan)
        if any(step.verb == 'satellite' for step in steps) and not self.value('satellite'):
            raise PlanError('the plan has a step satellite: set the parameter satellite')
        if any(step.verb == 'polaris' for step in steps):
            self._check_polaris()  # now, not after a block of stars
        for number, step in enumerate(steps):
            self._progress = {'step': str(step), 'block': number, 'done': 0,
                              'total': step.exposures}
            self._set_state('observing', str(step))
            yield from getattr(self, f'_do_{step.verb}')(number, step.count)
            self._send_table()

    def _do_stars(self, block, count):
        yield from self._need_home()  # the choice begins at where the mount stands
        for target in self._fresh_stars(block, count):
            yield from self._observe(target, block)
            self._progress['done'] += 1

    def _do_check(self, block, count):
        """Point at fresh stars blind: the miss distance is the pointing error."""
        yield from self._need_home()
        first, lost = len(self._rows), self._lost
        for target in self._fresh_stars(block, count):
            yield from self._observe(target, block, blind=True)
            self._progress['done'] += 1
        self._checks.append({'block': block, **blind_check.summary(
            [[row['miss_x'], row['miss_y']] for row in self._rows[first:]], self._lost - lost,
            self._model)})
        self._checks_pub.publish(String(data=blind_check.document(self._checks)))

    def _fresh_stars(self, block, count):
        """Targets all over the sky that were not observed tonight, in observing order."""
        if self._catalogue is None:
            # two magnitudes deeper, so that neighbours which would disturb are known
            self._catalogue = load_catalogue(mag_limit=self.value('magnitude_limit') + 2.0)
        observed = {int(row['star']) for row in self._rows if row['stamp'] >= self._evening}
        rows = choose_stars(
            self._catalogue, self._now() * 1e-9, self._site, self._weather, count,
            self.value('star_seed') + block, self.value('min_elevation_deg') * DEG,
            self.value('max_elevation_deg') * DEG, self.value('magnitude_limit'),
            exclude=[*observed, POLARIS_HIP], duration=count * SECONDS_A_STAR,
            start=self._last_reading[1])
        return [StarTarget(self._catalogue.select([row])) for row in rows]

    def _do_polaris(self, block, count):
        self._check_polaris()
        rows = len(self._rows)
        for _ in range(count):
            yield from self._observe(self._polaris, block)
            self._progress['done'] += 1
        if len(self._rows) == rows:  # a zero now would be that of an earlier power-on
            raise PlanError(f'none of {count} exposures shows Polaris: look at sky, site and time')

    def _check_polaris(self):
        if self._polaris is None:
            self._polaris = StarTarget(load_catalogue(hip=[POLARIS_HIP]))
        self._check_height(self._polaris, 'Polaris', 'set the zero another way')

    def _check_height(self, target, name, remedy):
        el = target.place(np.array([self._now() * 1e-9]), self._site, self._weather)[1][0]
        if el < self.value('min_elevation_deg') * DEG:
            raise PlanError(f'{name} stands at {el / DEG:.1f} deg, below min_elevation_deg = '
                            f'{self.value("min_elevation_deg")}: {remedy}')

    def _do_satellite(self, block, count):
        yield from self._need_home()
        satellite = satellite_target(self.value('satellite'))
        self._check_height(satellite, satellite.name, 'track it at another time')
        for _ in range(count):
            yield from self._observe(satellite, block)
            self._earliest = self._commanded + round(self.value('satellite_interval_s') * 1e9)
            self._progress['done'] += 1

    def _do_wait(self, block, count):
        """Stand still until so many hours after the last evening: the next one."""
        yield from self._need_home()
        self._evening = self._earliest = self._evening + count * 3_600_000_000_000
        here = np.array(self._last_reading[1])
        frame = None
        while frame is None:
            frame = yield from self._expose(lambda stamps: np.tile(here, (len(stamps), 1)))

    def _do_home(self, block, count):
        self._homes = True
        before = self._last_reading[0] if self._last_reading else 0

        def homed():
            # until the axes stand still: which reading comes in first must not decide what follows
            return (self._homed and self._last_reading[0] > before
                    and not np.any(np.abs(self._last_reading[2]) > STILL))

        while not homed():
            yield from self._call('home')
            # an encoder that was connected late has missed the crossing: home again when it has
            # fallen silent
            self._heard['mount and incremental encoder'] = time.monotonic()
            yield from self._until(
                lambda: homed() or 'mount and incremental encoder' in self._silent(),
                'the encoder to be homed')

    def _do_power_cycle(self, block, count):
        self._homed = False
        yield from self._call('power_cycle')

    def _do_calibrate_zero(self, block, count):
        yield from self._calibration_has_all()
        yield from self._call('calibrate_zero')
        newest = self._rows[-1]['stamp'] if self._rows else 0
        yield from self._until(lambda: self._zero_stamp >= newest, 'the new zero')

    def _do_fit(self, block, count):
        yield from self._new_model('fit')

    def _do_diagnose(self, block, count):
        yield from self._new_model('diagnose')

    def _new_model(self, verb):
        yield from self._calibration_has_all()
        before = self._models
        yield from self._call(verb)
        newest = self._rows[-1]['stamp'] if self._rows else 0
        yield from self._until(
            lambda: self._models > before and self._model_stamp >= newest, 'the new model')
        # they come on two topics, and one without the other points elsewhere
        yield from self._until(self._zero_of_model, 'the zero of the new model')

    def _zero_of_model(self):
        """Whether the zero in force is the one that the model tells of, if it tells."""
        told = self._model.provenance.get('zeros_in_force')
        if not isinstance(told, list) or not told:
            return True
        wanted = np.array([told[-1]['az_arcsec'], told[-1]['el_arcsec']]) * ARCSEC
        return bool(np.all(np.abs(self._zero - wanted) < 1e-6 * ARCSEC))

    def _need_home(self):
        if not self._homed and self._homes:
            self.get_logger().warning('the encoder has no zero any more: homing again')
            yield from self._do_home(0, 0)
        if not self._homed:
            yield from self._until(lambda: self._homed, 'the encoder to be homed (call home)')

    def _calibration_has_all(self):
        yield from self._until(lambda: self._calibrated >= len(self._rows),
                               'calibration to take the last observation')

    def _until(self, condition, what):
        self._set_state('waiting', what)
        yield condition
        self._set_state('observing', self._progress['step'])

    def _call(self, verb):
        client = self._asked[verb]
        yield from self._until(client.service_is_ready, f'a server of {client.srv_name}')
        future = client.call_async(Trigger.Request())
        # the answer itself must wake the plan: no other message may follow it
        future.add_done_callback(lambda _: self._advance())
        yield from self._until(future.done, f'{client.srv_name} to answer')
        answer = future.result()
        if not answer.success:
            raise PlanError(f'{verb}: {answer.message}')
        self.get_logger().info(f'{verb}: {answer.message}')

    # --- one star -----------------------------------------------------------------------------

    def _observe(self, target, block, blind=False):
        """Point at `target`, centre it where it is far off, and publish the row.

        `blind`: with model and zero alone, and the first exposure counts.
        """
        aim = np.zeros(2) if blind else self._carried
        self._approach = None
        seen = blank = 0
        while True:
            frame = None
            while frame is None:
                frame = yield from self._expose(partial(self._demand, target, aim=aim))
            stamp, miss = frame
            if not np.isfinite(miss).all():
                blank += 1
                if blank < BLANKS:
                    continue
                self._lost += 1
                self.get_logger().warning(
                    f'{target.name}: nothing in the field; go on with the next')
                return
            reading, rate = self._exposures.at('enc', stamp)
            enc = np.array(centred(*reading, *miss))
            if blind:
                break
            demand = self._demand(target, np.array([stamp]), aim)[0]
            aim = aim + np.array([wrap(enc[0] - demand[0]), enc[1] - demand[1]])
            # only for pointing: the next star lies nearer to where this one was found
            self._carried = aim
            seen += 1
            if np.hypot(*miss) <= self.value('recentre_arcsec') * ARCSEC or seen == 3:
                break
        try:
            second = np.array(centred(*self._exposures.at('abs', stamp)[0], *miss))
        except ValueError:
            second = np.full(2, np.nan)
        air = self._air()
        az, el = (float(v[0]) for v in
                  target.place(np.array([stamp * 1e-9]), self._site, air))
        row = {
            'stamp': stamp, 'time': stamp * 1e-9, 'run': self._run, 'block': block,
            'check': float(blind), 'star': target.number, 'az': az, 'el': el,
            'az_enc': enc[0], 'el_enc': enc[1], 'az_abs': second[0], 'el_abs': second[1],
            'miss_x': miss[0], 'miss_y': miss[1], 'az_rate': rate[0], 'el_rate': rate[1],
            'approach_az': self._approach[0], 'approach_el': self._approach[1],
            'temperature': air.temperature_c, 'pressure': air.pressure_hpa,
            'magnitude': target.magnitude,
        }
        self._rows.append(row)
        run = _table([row])
        self._observation_pub.publish(run_to_cloud(run, stamp))
        x, y = run.offsets()
        self._offset_pub.publish(convert.vector(stamp, x[0], y[0], convert.MOUNT_FRAME))

    def _expose(self, demand):
        """Command a track and wait for an exposure on it; None when nobody answered in time.

        `demand` gives the encoder angles (n, 2) for stamps (n,).
        """
        yield from self._need_home()
        start = max(self._now(), self._earliest)
        # long enough for half a turn, the settling and the exposure
        span = 60.0 + 200.0 / self.value('slew_rate_deg_s')
        times = np.arange(0.0, span + KNOT, KNOT)
        self._commanded = start
        track = demand(start + (times * 1e9).astype(np.int64))
        here = np.array(self._last_reading[1])
        move = np.array([wrap(track[0, 0] - here[0]), track[0, 1] - here[1]])
        if self._approach is None:  # later moves to the same star are small
            self._approach = np.sign(move)
        # the shorter way from here; the mount's own limits are the driver's affair
        track[:, 0] = here[0] + move[0] + (np.unwrap(track[:, 0]) - track[0, 0])
        rates = np.gradient(track, KNOT, axis=0, edge_order=2)
        self._exposures.begin(start, times, track)
        self._command_pub.publish(convert.trajectory(start, times, track, rates))
        now = time.monotonic()
        asked = dict.fromkeys(
            ('mount and incremental encoder', 'absolute encoder', 'camera'), now)
        self._heard = dict(asked)
        end = start + round(times[-1] * 1e9)
        tolerance = self.value('on_target_arcsec') * ARCSEC
        refuse = partial(self.reject, topics.MISS_DISTANCE.name)
        found = None

        def answered():
            nonlocal found
            found = self._exposures.take(tolerance, refuse)
            # a slew may take as long as the track
            return (found is not None or self._silent() or not self._homed
                    or self._last_reading[0] > end)

        yield answered
        if found is None:
            if not self._homed:
                return None
            mute = [name for name, heard in self._heard.items() if heard == asked[name]]
            silent = ', '.join(mute or self._silent())
            self._set_state('waiting', f'an answer of {silent}' if silent else
                            'the mount to come on target')
            return None
        self._set_state('observing', self._progress['step'])
        self._exposed = found[0]
        return found

    def _demand(self, target, stamps, aim):
        """Encoder demands for `target` at each stamp, shape (n, 2), rad."""
        az, el = target.place(stamps * 1e-9, self._site, self._air())
        if self._model is not None:
            known = self._drivers(target, stamps, az, el)
            az, el = demand_angles(self._model, az, el, known, self._zero)
        return np.column_stack([az, el]) + self._zero + aim

    def _air(self):
        """Weather with what the thermometer read before the last exposure."""
        celsius = self._thermometer.before(self._exposed, self.value('temperature_c'))
        return replace(self._weather, temperature_c=celsius)

    def _drivers(self, target, stamps, az, el):
        """What the effects of the model may ask for, None if it has none."""
        if not self._model.effects:
            return None
        air = self._air()
        row = self._rows[-1] if self._rows and self._rows[-1]['run'] == self._run else None
        known = {'temperature': air.temperature_c, 'pressure': air.pressure_hpa,
                 'magnitude': target.magnitude, 'star': np.array(target.number),
                 'run': self._run}
        return pointing_context(
            self._model, stamps, az, el, known, zero=self._zero, here=self._last_reading[1],
            approach=self._approach, row=row, site=self._site)

    def _now(self):
        """Time of the next command: never before the last reading, whatever /clock lags."""
        newest = self._last_reading[0] if self._last_reading else 0
        return max(newest, self.get_clock().now().nanoseconds)

    # --- what others see ------------------------------------------------------------------------

    def _send_table(self, again=False):
        if self._rows and (again or len(self._rows) != self._rows_sent):
            self._rows_sent = len(self._rows)
            self._observations_pub.publish(
                run_to_cloud(_table(self._rows), self._rows[-1]['stamp']))

    def _set_state(self, state, text):
        self._state = (state, text)

    def _report(self):
        state, text = self._state
        values = {'state': state, **self._progress, 'observations': len(self._rows),
                  'run': self._run, 'lost': self._lost}
        if (text, values) == self._status_sent:
            return
        self._status_sent = (text, values)
        level = {'failed': DiagnosticStatus.ERROR, 'waiting': DiagnosticStatus.WARN}.get(
            state, DiagnosticStatus.OK)
        self._status_pub.publish(
            convert.status(level, self.get_fully_qualified_name(), text, **values))

    def required(self):
        """The plan needs a mount and the instruments."""
        return {self.resolve_topic_name(topic.name) for topic in (
            topics.COMMAND, topics.INCREMENTAL, topics.ABSOLUTE, topics.MISS_DISTANCE)}

    def waiting_for(self):
        """Instruments that are not there yet, and nodes that are not fully connected."""
        missing = super().waiting_for()
        nodes = self._wanted_nodes()
        if nodes and not missing and self._rows == []:
            missing = unmatched(nodes, self._reports)
        return missing

    def problems(self):
        """What holds the plan up."""
        state, text = self._state
        if state == 'failed':
            return [(DiagnosticStatus.ERROR, text)]
        if state == 'waiting' and self._work is not None:
            return [(DiagnosticStatus.WARN, f'waiting for {text}')]
        return []

    def details(self):
        """Progress of the plan."""
        return [('plan state', self._state[0]), ('step', self._progress['step']),
                ('observations', str(len(self._rows))), ('stars lost', str(self._lost)),
                ('earth orientation', self._earth)]


def _table(rows):
    names = [name for name in rows[0] if name != 'stamp']
    return PointingRun({name: np.array([row[name] for row in rows], float) for name in names})


def main(args=None):
    """Entry point of ``ros2 run telescope_mount star_observer``."""
    sys.exit(run_node(StarObserver, args))


if __name__ == '__main__':
    main()
