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

"""The star observer: points the mount at catalogue stars and publishes the pointing offsets."""
# This module has parameters, topics and time; the work is done in `observing`, without ROS.

import json
import time
from functools import partial

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msg_tools import convert, topics
from msg_tools.node import MountNode
from msg_tools.power_on import PowerOns
from msg_tools.readiness import PUBLISHES, unmatched
from msg_tools.status_rows import Taken, handover
from msg_tools.units import DEG
from pointing_model.active_topics import active_calibration_of
from pointing_model.calibration_messages import StarRequest
from pointing_model.runs.run import KEPT_POWER_ONS
from pointing_model.runs.run_messages import cloud_to_run, run_to_cloud
from pointing_model.sky.sky_params import KIND_OF_MOUNT, mount_of, sky_of

from .guard_link import NO_GUARD, GuardLink
from .instrument_health import CLOCK_JUMP
from .instruments import ABSOLUTE, CAMERA, MOUNT, Instruments
from .night_file import NightFile
from .night_memory import NightMemory
from .plan_topics import PlanTopics, figures_of
from .sequencer import Sequencer
from .star_observer_params import PARAMS

#: services that the steps of a plan call
SERVICES = ('home', 'power_cycle', 'absolute/power_cycle', 'calibrate_zero', 'fit', 'diagnose',
            'judge')
#: topics of the instruments
INSTRUMENT_TOPICS = {MOUNT: topics.INCREMENTAL, ABSOLUTE: topics.ABSOLUTE,
                     CAMERA: topics.MISS_DISTANCE}
#: wall seconds after which a publisher counts even if its node name is unknown
NAMED_AFTER = 30.0
#: larger elevations are impossible encoder readings, rad
HIGHEST = 1.75
#: wall seconds in which an existing calibration reports what it knows: a latched message, which
#: arrives within a second of the match
ANSWERS_WITHIN = 10.0
LEVELS = {'failed': DiagnosticStatus.ERROR, 'waiting': DiagnosticStatus.WARN,
          'cancelled': DiagnosticStatus.WARN}
#: how to request steps of a plan, for readers of the status
ASK = ('rcl_interfaces/srv/SetParametersAtomically, 20 stars: {parameters: [{name: stars, value: '
       '{type: 2, integer_value: 20}}]}')
#: services that move the mount, or invalidate its zero
MOVING = ('home', 'power_cycle')


class StarObserver(MountNode):
    """Runs the observing plan and publishes one row for each measured star.

    It is the outbox of its `observing.sequencer.Sequencer`.
    """

    GATHER = 0.002  # handling a few 1 kHz readings together halves the cost

    def __init__(self, **kwargs):
        super().__init__('star_observer', PARAMS, hardware_id='observer', **kwargs)
        # discovery keeps this order: a node connected to the later topics can answer these services
        self._service_clients = {verb: self.create_client(Trigger, verb) for verb in SERVICES}
        self._sky, self._mount = sky_of(self), mount_of(self)
        self._live = not self.value('use_sim_time')
        self.guard = GuardLink(self, self._mount)
        self._observation_pub = self.publisher(topics.OBSERVATION)
        self._observations_pub = self.publisher(topics.OBSERVATIONS)
        self._offset_pub = self.publisher(topics.OFFSET)
        self._status_pub = self.publisher(topics.OBSERVER_STATUS)
        self._checks_pub = self.publisher(topics.CHECKS)
        self._plan_topics = PlanTopics(self, self._begin_goal)
        self._instruments = Instruments(self.value('first_run'), now=self.now,
                                        absolute=self.value('absolute_encoder'),
                                        live=self._live, axes=self._mount.names.axes)
        self._instruments.look = self._look_at_publishers
        self._instruments.health.field = self.value('field_deg') * DEG
        self._table = NightMemory(self._mount, self.value(KEPT_POWER_ONS.name))
        # before the camera: an exposure is always corrected with the same temperature reading
        self._active = active_calibration_of(self, self._active_changed, self._mount)
        self._memory = NightFile(self.value('state_file'), self.value(KIND_OF_MOUNT.name))
        self._sequencer = Sequencer(self, self._instruments, self._active, self._table,
                                    self._memory)
        over = self._sequencer.take_up_file(self.value('plan'))
        self._power_ons = {MOUNT: PowerOns(), ABSOLUTE: PowerOns()}
        self.subscribe(topics.INCREMENTAL_POWER_ON, self._power_ons[MOUNT].take)
        self.subscribe(topics.INCREMENTAL, self._on_incremental)
        if ABSOLUTE in self._instruments.names:
            self.subscribe(topics.ABSOLUTE_POWER_ON, self._power_ons[ABSOLUTE].take)
            self.subscribe(topics.ABSOLUTE, self._on_absolute)
        self.subscribe(topics.MISS_DISTANCE, self._on_miss)
        if self.value('inclinometer'):
            self.subscribe(topics.INCLINOMETER, self._on_lean)
        self.subscribe(topics.GUARD_STATUS, self._on_guard)
        self.subscribe(topics.COMMAND, self.guard.take_command)
        self._crowded = {}  # instrument with several publishers -> start of this state, wall s
        # the night of an earlier observer; begin of the wait for a calibration, wall s
        self._handover = self._given = self._calibration_since = None
        self._calibration_known, self._has_rows, self._forgotten = False, False, 0
        self.subscribe(topics.CALIBRATION_STATUS, self._on_calibration)
        self.subscribe(topics.CALIBRATION_TABLE, self._on_given_back)
        self.subscribe(topics.DISCRIMINATION, self._on_discrimination)
        self._wanted_nodes = [name for name in self.value('wait_for_nodes') if name]
        self._reports = self.graph_reports() if self._wanted_nodes else {}
        self.serve('observe', partial(self._observe, False), once=True)
        self.serve('~/anew', partial(self._observe, True), once=True)
        for service, verb in (('zero', 'zero'), ('zero_on_polaris', 'polaris'),
                              ('zero_on_stars', 'zero_on_stars')):
            self.serve(service, partial(self._zero, verb), once=True)
        if self.value('autostart') and not over:
            self._sequencer.start(self.value('plan'))
        self.serve('~/cancel', self._on_cancel)
        if self.value('renew_request_s'):
            self.every(self.value('renew_request_s'), self._renew)
            # live only; otherwise graph time waits for events, and readings are ahead of it
            self._jumps = self.get_clock().create_jump_callback(JumpThreshold(
                min_forward=None, min_backward=Duration(nanoseconds=-CLOCK_JUMP),
                on_clock_change=False), post_callback=self._clock_back)
        self.every(0.5, self._look)
        # steady clock: the observer must notice a time-out while simulated time stands still
        self.every(0.05, self._sequencer.advance)

    def check_together(self, values):
        """The elevation limits must leave some sky."""
        if values['min_elevation_deg'] >= values['max_elevation_deg']:
            raise ValueError(f'min_elevation_deg = {values["min_elevation_deg"]} must be below '
                             f'max_elevation_deg = {values["max_elevation_deg"]}')

    def parameters_changed(self, names):
        """Use new weather from the next exposure on."""
        self._sky = sky_of(self)
        self._instruments.health.field = self.value('field_deg') * DEG
        if 'camera_late_s' in names:
            self._sequencer.night.clocks = {}

    # --- messages in --------------------------------------------------------------------------

    def _on_incremental(self, message):
        stamp, angles, rates, _ = self._joints(message, MOUNT)
        self._note_clock(self._instruments.take_incremental(
            stamp, angles, rates, self._power_ons[MOUNT].of(message.header)))

    def _on_absolute(self, message):
        self._note_clock(self._instruments.take_absolute(
            *self._joints(message, ABSOLUTE)[:2], self._power_ons[ABSOLUTE].of(message.header)))

    def _joints(self, message, instrument):
        """See `convert.read_joints`; only for this mount, on the turn of its axes."""
        try:
            wanted, found = self._mount.names.keys, convert.joints_of(message.name)
            if found != wanted:
                raise ValueError(f'joints {" and ".join(found)}, and the parameter mount says '
                                 f'{self.value(KIND_OF_MOUNT.name)}: {" and ".join(wanted)}')
            stamp, angles, rates, effort = convert.read_joints(message)
            if self._mount.vertical and abs(angles[1]) > HIGHEST:
                raise ValueError(f'an elevation of {angles[1]:.3g} rad, beyond the zenith: degrees '
                                 'for radians, or exchanged axes?')
        except ValueError as err:
            self._instruments.count_message(instrument)
            self._instruments.health.unreadable(instrument, str(err))
            raise
        return stamp, self._mount.on_travel(*angles), rates, effort

    def _active_changed(self, topic):
        if topic is not topics.HOMING:
            self._sequencer.pointing_changed()

    def _clock_back(self, _):
        self._instruments.clock_back()
        self._note_clock(True)

    def _note_clock(self, went_back):
        if went_back:
            self.get_logger().warning('the clock went back: the simulation started anew')
        self._sequencer.advance()

    def _on_miss(self, message):
        self._instruments.take_frame(
            convert.from_stamp(message.header.stamp) - round(1e9 * self.value('camera_late_s')),
            *convert.read_sky_vector(message))
        self._sequencer.advance()

    def _on_lean(self, message):
        self._active.inclinometer.update(convert.from_stamp(message.header.stamp),
                                         (message.vector.x, message.vector.y))

    def _look(self):
        self._look_at_publishers()
        self.guard.look()
        if self._sequencer.look(time.monotonic()):
            self.announce()

    def _on_guard(self, message):
        self.guard.take_status(message, self._sky[0])
        if self.guard.ends:
            self._sequencer.cancel(f'by {self.guard.ends}')
        self._sequencer.advance()

    def _on_cancel(self):
        self.guard.withdraw()
        if self._sequencer.cancel('by the service cancel'):
            return True, 'plan cancelled'
        return False, 'no plan is under way'

    def _renew(self):
        self.guard.renew(self._sequencer.busy and self._instruments.homed)

    def _look_at_publishers(self):
        for name, topic in INSTRUMENT_TOPICS.items():
            if self.publisher_count(topic) < 2 and name not in self._crowded:
                continue
            names, unnamed = self.publisher_names(topic)
            since = self._crowded.setdefault(name, time.monotonic())
            if unnamed and time.monotonic() - since > NAMED_AFTER:
                names.append('a node without a name')
            self._instruments.health.publishers(name, names, unnamed > 0)
            if len(names) + unnamed < 2:
                del self._crowded[name]

    def _on_calibration(self, message):
        taken = Taken.read(message)
        self._calibration_known, self._has_rows = True, taken.kept > 0
        self._forgotten = taken.forgotten
        self._handover = handover(message) or self._handover
        if self._has_rows:
            self._sequencer.rows_turned_up()
        self._take_up()
        self._sequencer.calibration_has(taken)

    def _on_discrimination(self, message):
        self._sequencer.take_request(StarRequest.read(message.data))

    def _on_given_back(self, message):
        self._given = message
        self._take_up()

    def _take_up(self):
        """Resume a night that was begun before this observer was started."""
        if self._handover is None or self._given is None or len(self._table):
            return
        count, left = self._handover
        if self._given.width == count and not self._sequencer.begun:
            self._sequencer.take_up(cloud_to_run(self._given),
                                    convert.from_stamp(self._given.header.stamp), left,
                                    self._forgotten)

    def _observe(self, anew):
        plan = self.value('plan')
        where = '' if anew else self._sequencer.stopped_at(plan)
        return self._begin(plan, f'plan goes on at {where}: {{}}; to begin it anew call '
                           'star_observer/anew' if where else 'plan started: {}', anew)

    def _zero(self, verb):
        return self._begin(
            f'{verb} {self.value("polaris_exposures")}, calibrate_zero',
            f'started: {{}}; progress on {topics.OBSERVER_STATUS.name}')

    def _begin_goal(self, plan):
        return self._begin(plan, f'plan started: {{}}; progress on {topics.PLAN_FEEDBACK.name}')

    def _begin(self, plan, answer, anew=True):
        why = 'a plan is under way' if self._sequencer.busy else self.guard.ends
        if not why:
            self._sequencer.start(plan, anew)
            self._sequencer.publish()  # accepted, even if cancelled before it begins
        return not why, why or answer.format(plan)

    # --- messages out: the outbox of the sequencer --------------------------------------------

    def sky(self):
        """Site and weather."""
        return self._sky

    def mount(self):
        """The `Mount`."""
        return self._mount

    def now(self):
        """Present time, ns."""
        return time.time_ns() if self._live else self.get_clock().now().nanoseconds

    def client(self, verb):
        """Client of a service."""
        if verb in MOVING and self.value('renew_request_s'):
            self.guard.withdraw()  # the service moves the mount itself
        return self._service_clients[verb]

    def refuse_frame(self, reason):
        """Count an unusable frame."""
        self.reject(topics.MISS_DISTANCE.name, reason)

    def send_row(self, run, stamp):
        """Publish on `observation` and `offset`."""
        self._observation_pub.publish(run_to_cloud(run, stamp))
        x, y = run.offsets()
        self._offset_pub.publish(convert.sky_vector(stamp, x[0], y[0]))

    def send_table(self, run, stamp):
        """Publish on `observations`."""
        self._observations_pub.publish(run_to_cloud(run, stamp))

    def send_checks(self, document):
        """Publish on `observer/checks`; the numbers also go to the feedback of the plan."""
        self._checks_pub.publish(String(data=json.dumps(document)))
        self._plan_topics.results = figures_of(document)

    def send_status(self, progress, text):
        """Publish on `observer/status`."""
        least = DiagnosticStatus.WARN if self._sequencer.faults else DiagnosticStatus.OK
        self._status_pub.publish(convert.status(
            LEVELS.get(progress.state, least), self.get_fully_qualified_name(),
            text, **progress.rows(), refusal=self._sequencer.night.refusal,
            ask=f'{self.get_fully_qualified_name()}/plan: {ASK}'))
        self._plan_topics.publish(progress, self._sequencer.busy)

    # --- diagnostics --------------------------------------------------------------------------

    def required(self):
        """The plan needs the instruments and a guard; its requests have other subscribers, too."""
        instruments = map(INSTRUMENT_TOPICS.get, self._instruments.names)
        return {self.resolve_topic_name(topic.name) for topic in (
            topics.REQUEST, topics.GUARD_STATUS, *instruments)}

    def waiting_for(self):
        """Missing instruments, and nodes that are not fully connected."""
        remedies = {topics.ABSOLUTE.name: ' (the mount has none: absolute_encoder: false)',
                    topics.GUARD_STATUS.name: f' ({NO_GUARD})'}
        missing = [text + next((remedy for name, remedy in remedies.items()
                                if text.endswith(f'/{name}')), '')
                   for text in super().waiting_for()]
        if missing or self._sequencer.begun:
            return missing
        if self._wanted_nodes:
            missing = unmatched(self._wanted_nodes, self._reports)
            status = self.resolve_topic_name(topics.CALIBRATION_STATUS.name)
            if not (missing or self._calibration_known) and any(
                    status in self._reports[name][PUBLISHES] for name in self._wanted_nodes):
                missing = ['the state of the calibration']
        elif self._calibration_is_silent():
            missing = ['the state of the calibration']
        missing = missing or self.guard.lacking()
        if not missing and self._has_rows and not len(self._table):
            missing = ['the rows of the night so far from the calibration']
        return missing

    def _calibration_is_silent(self):
        """Whether a calibration that could return a night exists but has been silent for a time."""
        if self._calibration_known or not self.publisher_count(topics.CALIBRATION_TABLE):
            self._calibration_since = None
            return False
        self._calibration_since = self._calibration_since or time.monotonic()
        return time.monotonic() - self._calibration_since < ANSWERS_WITHIN

    def problems(self):
        """What delays the plan."""
        state, text = self._sequencer.progress.state, self._sequencer.text
        if state == 'failed':
            return [(DiagnosticStatus.ERROR, text)]
        if state == 'cancelled':
            return [(DiagnosticStatus.WARN, f'plan cancelled {text}')]
        health = self._instruments.health
        found = [(DiagnosticStatus.ERROR if kind == 'silent' else DiagnosticStatus.WARN, text)
                 for (_, kind), text in health.sentences.items()]
        found.sort(key=lambda issue: issue[0], reverse=True)
        found += [(DiagnosticStatus.WARN, text) for text in self._active.complaints()]
        night = self._sequencer.night
        wrong = (night.clocks_sentence if night.clocks_are_off else '', self.guard.elsewhere,
                 self._memory.error)
        found += [(DiagnosticStatus.WARN, text) for text in wrong if text]
        if state == 'waiting' and self._sequencer.busy:
            found.insert(0, (DiagnosticStatus.WARN, f'waiting for {text}'))
        return found

    def details(self):
        """Progress of the plan."""
        progress = self._sequencer.progress
        return [('plan state', progress.state), ('step', progress.step),
                ('observations', str(progress.observations)),
                ('stars lost', str(progress.lost)),
                ('zero follows', self._active.following() or 'nothing'),
                ('clocks', self._sequencer.night.clocks_sentence or 'not compared'),
                ('earth orientation', self._sequencer.earth)]
