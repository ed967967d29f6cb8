"""The star observer: points the mount at catalogue stars and publishes the pointing offsets.

Here are parameters, topics and time; what is done stands in `observing`, which knows no ROS.
"""

import sys
import time
from functools import partial

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock, ClockType
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msg_tools import convert, topics
from msg_tools.node import MountNode, Param, run_node
from msg_tools.readiness import PUBLISHES, unmatched
from msg_tools.status import handover, observations_taken
from msg_tools.units import DEG

from .in_force_topics import MODEL_FILE, in_force_of
from .observing.instruments import ABSOLUTE, CAMERA, MOUNT, Instruments
from .observing.plan import night_plan, parse_plan
from .observing.sequencer import Sequencer
from .observing.table import Table
from .run_messages import cloud_to_run, run_to_cloud
from .sky_params import KIND_OF_MOUNT, SKY_PARAMS, mount_of, sky_of
from .target import satellite_target

PARAMS = SKY_PARAMS + (
    KIND_OF_MOUNT,
    Param('plan', night_plan(30, 16), 'steps of the night, separated by commas', check=parse_plan),
    Param('autostart', True, 'start the plan as soon as the graph is connected', fixed=True),
    Param('wait_for_nodes', [''], 'full names of nodes that must be connected before the plan '
          'starts', fixed=True),
    Param('star_seed', 1, 'seed of the choice of stars', 0, 2**31 - 1),
    Param('magnitude_limit', 6.0, 'faintest star, Hipparcos magnitude', -2.0, 15.0),
    Param('min_elevation_deg', 20.0, 'lowest star [deg]', 0.0, 89.0),
    Param('max_elevation_deg', 85.0, 'highest star [deg]', 1.0, 90.0),
    Param('meridian_limit_deg', 5.0, 'how far past the meridian a German mount turns before it '
          'takes the other side [deg]', 0.0, 90.0),
    Param('hour_angle_limit_deg', 165.0, 'largest hour angle of a star for a mount that does not '
          'go through the pole [deg]', 1.0, 180.0),
    Param('recentre_arcsec', 60.0, 'a star farther from the boresight is centred and measured '
          'again [arcsec]', 0.1, 36000.0),
    Param('on_target_arcsec', 30.0, 'largest difference of the encoder from its demand in an '
          'exposure that counts [arcsec]', 0.1, 36000.0),
    Param('exposure_s', 0.0, "length of the camera's exposures: one counts when the encoder was "
          'on target all that time, and is paired with its mean; 0: with its reading in the middle '
          '[s]', 0.0, 3600.0),
    Param('smear_arcsec', 5.0, 'largest way of the axes beside their track in an exposure of '
          'exposure_s that counts [arcsec]', 0.01, 3600.0),
    Param('slew_rate_deg_s', 4.0, 'slew rate of the mount, to plan how long a track must be '
          '[deg/s]', 0.01, 90.0),
    Param('field_deg', 1.0, 'a star farther from the boresight is outside the field of the camera: '
          'its message has another unit [deg]', 1e-3, 180.0),
    Param('renew_request_s', 0.2, 'how often the guard is told that the request still holds; 0: '
          'once [s]', 0.0, 10.0, fixed=True),
    Param('answer_timeout_s', 5.0, 'wall time after which a pointing without an answer is '
          'commanded again [s]', 0.5, 3600.0),
    Param('absolute_encoder', True, 'whether the mount has an absolute encoder beside the one that '
          'it is pointed with', fixed=True),
    Param('give_up_s', 600.0, 'wall time without an observation after which a plan ends while '
          'something is wrong or waited for; 0: never [s]', 0.0, 86400.0),
    Param('first_run', 1, 'run number of the first power-on, where the calibration has no rows of '
          'the night yet', -1000000, 1000000),
    Param('polaris_exposures', 16, 'exposures that the services zero, zero_on_polaris and '
          'zero_on_stars make', 1, 10000),
    Param('satellite', '', 'what the step satellite tracks: a file of two-line elements, or '
          'gps-26690', check=satellite_target),
    Param('satellite_interval_s', 20.0, 'least time between two exposures of it [s]', 0.0, 3600.0),
    MODEL_FILE,
)
#: services that the steps of a plan call
SERVICES = ('home', 'power_cycle', 'absolute/power_cycle', 'calibrate_zero', 'fit', 'diagnose',
            'judge')
#: on which the instruments are heard
INSTRUMENT_TOPICS = {MOUNT: topics.INCREMENTAL, ABSOLUTE: topics.ABSOLUTE,
                     CAMERA: topics.MISS_DISTANCE}
#: wall seconds after which a publisher is one, whether its node has a name or not
NAMED_AFTER = 30.0
#: elevation that no encoder reads, rad
HIGHEST = 1.75
#: wall seconds in which a calibration that is there says what it knows: a latched message, that
#: comes within a second of the match
SPEAKS_WITHIN = 10.0
LEVELS = {'failed': DiagnosticStatus.ERROR, 'waiting': DiagnosticStatus.WARN,
          'cancelled': DiagnosticStatus.WARN}
#: services that move the mount, or take its zero
MOVING = ('home', 'power_cycle')
#: states of the guard that end a plan
ENDING = ('aborted', 'parking', 'parked')


class StarObserver(MountNode):
    """Runs the observing plan and publishes one row for every star measured.

    It is the outbox of its `observing.sequencer.Sequencer`.
    """

    def __init__(self, **kwargs):
        super().__init__('star_observer', PARAMS, hardware_id='observer', **kwargs)
        self._sky = sky_of(self)
        self._request_pub, self._request = self.publisher(topics.REQUEST), None
        self._guard, self._refused = '', (0, '')
        self._observation_pub = self.publisher(topics.OBSERVATION)
        self._observations_pub = self.publisher(topics.OBSERVATIONS)
        self._offset_pub = self.publisher(topics.OFFSET)
        self._status_pub = self.publisher(topics.OBSERVER_STATUS)
        self._checks_pub = self.publisher(topics.CHECKS)
        self._instruments = Instruments(self.value('first_run'), now=self.now,
                                        absolute=self.value('absolute_encoder'),
                                        live=not self.value('use_sim_time'))
        self._instruments.look = self._look_at_publishers
        self._instruments.health.field = self.value('field_deg') * DEG
        self._mount = mount_of(self)
        self._table = Table(self._mount)
        # before the camera: an exposure is always corrected with the same reading of the
        # thermometer
        self._in_force = in_force_of(self, self._in_force_changed, self._mount)
        self._sequencer = Sequencer(self, self._instruments, self._in_force, self._table)
        self.subscribe(topics.INCREMENTAL, self._on_incremental)
        if ABSOLUTE in self._instruments.names:
            self.subscribe(topics.ABSOLUTE, self._on_absolute)
        self.subscribe(topics.MISS_DISTANCE, self._on_miss)
        self.subscribe(topics.GUARD_STATUS, self._on_guard)
        self._crowded = {}  # instrument with several publishers -> since when, wall s
        self._handover = self._given = None  # a night that an observer before has begun
        self._calibration_spoke = self._has_rows = False
        self._calibration_since = None  # there and silent, wall s
        self.subscribe(topics.CALIBRATION_STATUS, self._on_calibration)
        self.subscribe(topics.CALIBRATION_TABLE, self._on_given_back)
        self._wanted_nodes = [name for name in self.value('wait_for_nodes') if name]
        self._reports = self.graph_reports() if self._wanted_nodes else {}
        self._asked = {verb: self.create_client(Trigger, verb) for verb in SERVICES}
        self.create_service(Trigger, 'observe', self._on_observe)
        for service, verb in (('zero', 'zero'), ('zero_on_polaris', 'polaris'),
                              ('zero_on_stars', 'zero_on_stars')):
            self.create_service(Trigger, service, partial(self._on_zero, verb))
        if self.value('autostart'):
            self._sequencer.start(self.value('plan'))
        self.serve('~/cancel', self._on_cancel)
        if self.value('renew_request_s'):
            self.every(self.value('renew_request_s'), self._renew)
        self.every(0.5, self._look)
        # steady: the observer must see a time-out while simulated time stands still
        self.create_timer(0.05, self._sequencer.advance,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def check_together(self, values):
        """The limits of elevation must leave some sky."""
        if values['min_elevation_deg'] >= values['max_elevation_deg']:
            raise ValueError(f'min_elevation_deg = {values["min_elevation_deg"]} must be below '
                             f'max_elevation_deg = {values["max_elevation_deg"]}')

    def parameters_changed(self, names):
        """Take a new site or weather from the next exposure on; the mount stays on its pier."""
        self._sky = sky_of(self)
        self._instruments.health.field = self.value('field_deg') * DEG

    # --- messages in --------------------------------------------------------------------------

    def _on_incremental(self, message):
        stamp, angles, rates, _ = self._joints(message, MOUNT)
        self._note_clock(self._instruments.take_incremental(
            stamp, angles, rates, message.header.frame_id))

    def _on_absolute(self, message):
        self._note_clock(self._instruments.take_absolute(
            *self._joints(message, ABSOLUTE)[:2], message.header.frame_id))

    def _joints(self, message, instrument):
        """As `convert.read_joints`, of this mount alone, on the turn of its axes."""
        try:
            wanted, found = self._mount.names.keys, convert.joints_of(message.name)
            if found != wanted:
                raise ValueError(f'joints {" and ".join(found)}, and the parameter mount says '
                                 f'{self.value(KIND_OF_MOUNT.name)}: {" and ".join(wanted)}')
            stamp, angles, rates, effort = convert.read_joints(message)
            if self._mount.altaz and abs(angles[1]) > HIGHEST:
                raise ValueError(f'an elevation of {angles[1]:.4g} rad: degrees for radians, or '
                                 'exchanged axes?')
        except ValueError as err:
            self._instruments.spoke(instrument)
            self._instruments.health.unreadable(instrument, str(err))
            raise
        return stamp, self._mount.on_travel(*angles), rates, effort

    def _in_force_changed(self, topic):
        if topic is not topics.HOMING:
            self._sequencer.pointing_changed()

    def _note_clock(self, went_back):
        if went_back:
            self.get_logger().warning('the clock went back: the simulation started anew')
        self._sequencer.advance()

    def _on_miss(self, message):
        self._instruments.take_frame(
            convert.from_stamp(message.header.stamp), message.vector.x, message.vector.y)
        self._sequencer.advance()

    def _look(self):
        self._look_at_publishers()
        if self._sequencer.look(time.monotonic()):
            self.announce()

    def _on_guard(self, message):
        rows = {row.key: row.value for row in message.values}
        state = rows.get('state', '')
        self._refused = int(rows.get('refused', 0)), rows.get('reason', '')
        if state in ENDING:
            self._request = None
            self._sequencer.cancel(f'by the mount guard: {message.message}')
        self._guard = message.message if state in ('paused', 'inactive') else ''
        self._sequencer.advance()

    def _on_cancel(self):
        self._withdraw()
        if self._sequencer.cancel('by the service cancel'):
            return True, 'plan cancelled'
        return False, 'no plan is under way'

    def _renew(self):
        """The guard lets go of what is not asked for again."""
        if self._request is None:
            return
        if self._sequencer.busy and self._instruments.homed:
            self._request_pub.publish(self._request)
        else:
            self._withdraw()

    def _withdraw(self):
        """A track without points: the mount need not follow any."""
        if self._request is not None:
            self._request.points = []
            self._request_pub.publish(self._request)
        self._request = None

    def _look_at_publishers(self):
        for name, topic in INSTRUMENT_TOPICS.items():
            full = self.resolve_topic_name(topic.name)
            if self.count_publishers(full) < 2 and name not in self._crowded:
                continue
            infos = self.get_publishers_info_by_topic(full)
            # right after its discovery the name of a node is not known
            named = [f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos
                     if 'UNKNOWN' not in info.node_name]
            since = self._crowded.setdefault(name, time.monotonic())
            late = time.monotonic() - since > NAMED_AFTER
            unnamed = len(named) < len(infos)
            if unnamed and late:
                named.append('a node without a name')
            self._instruments.health.publishers(name, named, unnamed)
            if len(infos) < 2:
                del self._crowded[name]

    def _on_calibration(self, message):
        count = observations_taken(message)
        self._calibration_spoke, self._has_rows = True, count > 0
        self._handover = handover(message) or self._handover
        if self._has_rows:
            self._sequencer.rows_turned_up()
        self._take_up()
        self._sequencer.calibration_has(count)

    def _on_given_back(self, message):
        self._given = message
        self._take_up()

    def _take_up(self):
        """Go on with a night that was begun before this observer was started."""
        if self._handover is None or self._given is None or len(self._table):
            return
        count, left = self._handover
        if self._given.width == count and not self._sequencer.begun:
            self._sequencer.take_up(cloud_to_run(self._given),
                                    convert.from_stamp(self._given.header.stamp), left)

    def _on_observe(self, request, response):
        return self._begin(response, self.value('plan'), 'plan started: {}')

    def _on_zero(self, verb, request, response):
        return self._begin(
            response, f'{verb} {self.value("polaris_exposures")}, calibrate_zero',
            f'started: {{}}; progress on {topics.OBSERVER_STATUS.name}')

    def _begin(self, response, plan, answer):
        response.success = not self._sequencer.busy
        response.message = answer.format(plan) if response.success else 'a plan is under way'
        if response.success:
            self._sequencer.start(plan)
        return response

    # --- messages out: what the sequencer asks for --------------------------------------------

    def sky(self):
        """Site and weather."""
        return self._sky

    def mount(self):
        """The `Mount`."""
        return self._mount

    def now(self):
        """ns."""
        return self.get_clock().now().nanoseconds

    def client(self, verb):
        """Of a service."""
        if verb in MOVING and self.value('renew_request_s'):
            self._withdraw()  # it moves the mount itself
        return self._asked[verb]

    def refuse_frame(self, reason):
        """Count it."""
        self.reject(topics.MISS_DISTANCE.name, reason)

    def send_command(self, track):
        """On `request`."""
        self._request = convert.trajectory(*track, self._mount.names.keys)
        self._request.header.frame_id = self.get_fully_qualified_name()
        self._request_pub.publish(self._request)

    def refusal(self, stamp):
        """Why the guard refused the track that began at `stamp` (ns); '' if it did not."""
        refused, reason = self._refused
        return reason if refused == stamp else ''

    def held(self):
        """Why the mount may not be moved now."""
        return self._guard

    def send_row(self, run, stamp):
        """On `observation` and `offset`."""
        self._observation_pub.publish(run_to_cloud(run, stamp))
        x, y = run.offsets()
        self._offset_pub.publish(convert.vector(stamp, x[0], y[0], convert.MOUNT_FRAME))

    def send_table(self, run, stamp):
        """On `observations`."""
        self._observations_pub.publish(run_to_cloud(run, stamp))

    def send_checks(self, text):
        """On `observer/checks`."""
        self._checks_pub.publish(String(data=text))

    def send_status(self, progress, text):
        """On `observer/status`."""
        least = DiagnosticStatus.WARN if self._sequencer.faults else DiagnosticStatus.OK
        self._status_pub.publish(convert.status(
            LEVELS.get(progress.state, least), self.get_fully_qualified_name(),
            text, **progress.rows()))

    # --- diagnostics --------------------------------------------------------------------------

    def required(self):
        """The plan needs a mount and the instruments."""
        return {self.resolve_topic_name(topic.name) for topic in (
            topics.REQUEST, *map(INSTRUMENT_TOPICS.get, self._instruments.names))}

    def waiting_for(self):
        """Instruments that are not there yet, and nodes that are not fully connected."""
        missing = [text + ' (the mount has none: absolute_encoder: false)'
                   if text.endswith(topics.ABSOLUTE.name) else text
                   for text in super().waiting_for()]
        if missing or self._sequencer.begun:
            return missing
        if self._wanted_nodes:
            missing = unmatched(self._wanted_nodes, self._reports)
            status = self.resolve_topic_name(topics.CALIBRATION_STATUS.name)
            if not (missing or self._calibration_spoke) and any(
                    status in self._reports[name][PUBLISHES] for name in self._wanted_nodes):
                missing = ['the calibration to say what it knows']
        elif self._calibration_is_silent():
            missing = ['the calibration to say what it knows']
        if not missing and self._has_rows and not len(self._table):
            missing = ['the calibration to give back the rows of the night so far']
        return missing

    def _calibration_is_silent(self):
        """Whether one that could give a night back is there and has not spoken, for a time."""
        if self._calibration_spoke or not self.count_publishers(
                self.resolve_topic_name(topics.CALIBRATION_TABLE.name)):
            self._calibration_since = None
            return False
        now = time.monotonic()
        if self._calibration_since is None:
            self._calibration_since = now
        return now - self._calibration_since < SPEAKS_WITHIN

    def problems(self):
        """What holds the plan up."""
        state, text = self._sequencer.progress.state, self._sequencer.text
        if state == 'failed':
            return [(DiagnosticStatus.ERROR, text)]
        if state == 'cancelled':
            return [(DiagnosticStatus.WARN, f'plan cancelled {text}')]
        health = self._instruments.health
        found = [(DiagnosticStatus.ERROR if kind == 'silent' else DiagnosticStatus.WARN, text)
                 for (_, kind), text in health.told.items()]
        found.sort(key=lambda issue: issue[0], reverse=True)
        found += [(DiagnosticStatus.WARN, text) for text in self._in_force.complaints()]
        if state == 'waiting' and self._sequencer.busy:
            found.insert(0, (DiagnosticStatus.WARN, f'waiting for {text}'))
        return found

    def details(self):
        """Progress of the plan."""
        progress = self._sequencer.progress
        return [('plan state', progress.state), ('step', progress.step),
                ('observations', str(progress.observations)),
                ('stars lost', str(progress.lost)),
                ('zero follows', self._in_force.following() or 'nothing'),
                ('earth orientation', self._sequencer.earth)]


def main(args=None):
    """Entry point of ``ros2 run telescope_mount star_observer``."""
    sys.exit(run_node(StarObserver, args))


if __name__ == '__main__':
    main()
