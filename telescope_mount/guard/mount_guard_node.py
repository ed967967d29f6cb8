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

"""The mount guard: forwards requests on `request` to the mount on `command`, if allowed."""

import time
from contextlib import suppress

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration

from msg_tools import convert, topics
from msg_tools.node_lifecycle import ACTIVATION, ManagedNode
from msg_tools.readiness import drives
from msg_tools.units import DEG
from pointing_model.sky.sky_params import SKY_PARAMS, mount_of, site_of
from pointing_model.sky.skyline import Horizon, parse_horizon

from ..observing.axis_demand import Track
from ..observing.instrument_health import AHEAD_LIVE, BEHIND_LIVE
from .allowed_sky import PLACE, rows_of
from .goto import GotoSupervisor
from .guard_params import PARAMS
from .limits import Axis, Limits, parse_pair, travel_of
from .reasons_to_stop import ERROR, LATE, WARN, GuardSettings
from .sky_limits import SKY_LIMITS
from .supervisor import STILL, Supervisor

#: steady seconds between checks of everything
LOOK = 0.05
#: s allowed for a node to discover the others
LOOK_AROUND = 1.0
#: s within which lateness of this machine is logged only once
LATE_ONCE = 10.0
#: states in which the mount is moved
LEADING = ('following', 'around', 'parking', 'waiting')
#: s after a start during which being inactive is not reported
STARTS = 5.0
#: part of the supervisor's sentence about axes that are not where they were sent
ASTRAY = 'look at its drive and encoder'
#: s allowed for drivers to receive the last command
DELIVERED = 0.3
LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


class MountGuard(ManagedNode):
    """The only publisher of `command`; it publishes nothing that the mount must not follow.

    Checking and sending is done in `guard.supervisor`, without ROS.
    """

    GATHER = 0.002  # for 1 kHz readings; a command waits no longer than this

    def __init__(self, **kwargs):
        super().__init__('mount_guard', PARAMS, hardware_id='mount guard', **kwargs)
        self._mount, value = mount_of(self), self.value
        self._names, self._whole = self._mount.names.keys, value('renew_s') == 0.0
        self._resting = False
        self._limits = limits = Limits(
            self._mount, tuple(self._axis(i, name) for i, name in enumerate(('first', 'second'))),
            Horizon(value('least_elevation_deg') * DEG, parse_horizon(value('horizon'))),
            tuple((limit, value(limit.parameter) * DEG) for limit in SKY_LIMITS
                  if value(limit.parameter)), value('slew_timing'))
        blocked = limits.blocked_pole
        if blocked:
            self.get_logger().warning(
                f'the mount cannot change its side: the pole is {blocked[0] / DEG:.1f} deg high, '
                f'the horizon there {blocked[1] / DEG:.1f} deg. Set least_elevation_deg and '
                'horizon lower there')
        self._park = parse_pair(value('park_deg'))
        supervisor = GotoSupervisor if value('goto') else Supervisor
        self._supervisor = supervisor(limits, site_of(self.value), GuardSettings(
            self._whole, max(value('ahead_s'), value('renew_s') + 2.0 * LOOK), value('silence_s'),
            value('request_timeout_s'), value('behind_deg') * DEG, value('turn_known'),
            self._whole and value('use_sim_time')),
            time.monotonic)
        # limits of an azimuth mount need no site; a default site does not count
        self._sky = rows_of(self._supervisor.limits) | {
            param.name: value(param.name) for param in SKY_PARAMS[:3]
            if param.name in self._parameter_overrides or not self._mount.vertical}
        self._published, self._renewed, self._crowd = None, 0.0, ''
        self._idle, self._was_wanted = time.monotonic(), False  # inactive since; and if requested
        self._ticked, self._late = 0.0, False
        self._late_logged, self._quiet = -LATE_ONCE, False  # s; and whether lateness is not logged
        self._request = None  # the original message
        self._owners = {}  # requesting nodes, by the stamp of the request
        self._command_pub = self.publisher(topics.COMMAND)
        self._status_pub = self.publisher(topics.GUARD_STATUS)
        self.subscribe(topics.INCREMENTAL, self._on_reading)
        self.subscribe(topics.REQUEST_OWNER, self._on_owner)
        self.subscribe(topics.REQUEST, self._on_request)
        self.serve('abort', self._on_abort)
        self.serve('pause', lambda: self._do('paused', self._supervisor.pause))
        self.serve('resume', lambda: self._do('', self._supervisor.resume), once=True)
        self.serve('park', self._on_park, once=True)
        self.every(LOOK, self._tick)
        self.every(0.5, self._look_at_commanders)

    def _axis(self, i, name):
        low, high = parse_pair(self.value(f'{name}_travel_deg')) or travel_of(self._mount)[i]
        return Axis(low * DEG, high * DEG, self.value(f'{name}_rate_deg_s') * DEG,
                    self.value(f'{name}_acceleration_deg_s2') * DEG)

    def check_together(self, values):
        """Travel and park position must be valid, and limits in the sky need a site."""
        for name in ('first_travel_deg', 'second_travel_deg'):
            low, high = parse_pair(values[name]) or (0.0, 1.0)
            if low >= high:
                raise ValueError(f'{name} = {values[name]}: give the smaller end first')
        kept = [limit for limit in SKY_LIMITS if limit.turns and values[limit.parameter]]
        if values['renew_s'] and kept and not all(
                name in self._parameter_overrides for name in PLACE):
            raise ValueError(f'no site, so the place of {kept[0].name} is unknown. Set '
                             'latitude_deg and longitude_deg (parameter file, under /**:, or '
                             f'--latitude and --longitude), or {kept[0].parameter}: 0.0')
        if values['goto'] and not values['renew_s']:
            raise ValueError('renew_s = 0 with goto: nothing would stop such a driver; set it to '
                             '0.5')

    # --- messages -----------------------------------------------------------------------------

    def _on_reading(self, message):
        if convert.joints_of(message.name) != self._names:
            return  # of another mount: reported by the observer
        stamp, angles, rates, _ = convert.read_joints(message)
        if not self.value('use_sim_time') and not (
                -BEHIND_LIVE <= stamp - time.time_ns() <= AHEAD_LIVE):
            raise ValueError("stamps of another clock than this machine's")  # treated as silence
        angles = self._limits.on_travel(*angles)
        self._supervisor.take_reading(stamp, angles, rates)
        if self._supervisor.state in ('waiting', 'around', 'stopping', 'parking'):
            self._look()

    def _on_owner(self, message):
        self._owners = {stamp: owner for stamp, owner in self._owners.items()
                        if owner != message.key} | {message.value: message.key}

    def _on_request(self, message):
        if not len(message.points):
            self._supervisor.withdraw(self._now())
            self._look()
            return
        if not self.active and not self._resting:
            self._was_wanted = True  # it will be repeated; the status has the reason
            return
        stamp, times, angles, rates = convert.read_trajectory(message)
        named = convert.joints_of(message.joint_names)
        if named != self._names:
            raise ValueError(f'request for {" and ".join(named)}: the parameter mount says '
                             f'{" and ".join(self._names)}')
        owner = self._owners.get(str(stamp), '')
        if self._crowd and not owner:
            raise ValueError(self._crowd)
        try:
            self._supervisor.take_request(Track(stamp, times, angles, rates), self._now(), owner)
            self._request = message
        finally:
            self._look()

    def _now(self):
        """Present time, ns; for a mount that replies ahead of time, that of its readings."""
        now = self.get_clock().now().nanoseconds
        return max(now, self._supervisor.readings.stamp) if self._whole else now

    def _tick(self):
        """Check everything; after a delay of this process, first process waiting messages."""
        before, self._ticked = self._ticked, time.monotonic()
        self._late = self._ticked - before > 3.0 * LOOK and not self._late
        if not self._late:
            self._look()

    def _look(self):
        """Send due commands."""
        if not self.active:
            if self._is_news:
                self._publish_status()
            return
        now = time.monotonic()
        due = now - self._renewed >= self.value('renew_s')
        tracks = self._supervisor.step(self._now(), due)
        for track in tracks:
            self._send(track)
        if tracks:
            self._renewed = now
        self._publish_status()

    def _send(self, track):
        message = self._request
        if not self._supervisor.is_request(track) or message is None:
            message = convert.trajectory(*track, self._names)
        self._command_pub.publish(message)

    def _publish_status(self):
        supervisor = self._supervisor
        state, level, reason = supervisor.state, supervisor.level, self._reason
        if not self.active:
            state, level, reason = 'inactive', WARN, self.inactive
        status = state, reason, supervisor.refused
        if status == self._published:
            return
        self._published = status
        self._status_pub.publish(convert.status(
            LEVELS[level], self.get_fully_qualified_name(), reason,
            state=state, refused=supervisor.refused[0], reason=supervisor.refused[1],
            goto=self.value('goto'), **self._sky))
        text = reason if reason.startswith(state) else f'{state}: {reason}'
        after, now = self._quiet, time.monotonic()
        self._quiet = reason == LATE and now - self._late_logged < LATE_ONCE
        if reason == LATE and not self._quiet:
            self._late_logged = now
        if self._quiet or after and not level:  # moving again
            return
        if level == ERROR:
            self.get_logger().error(text)
        elif level:
            self.get_logger().warning(text)
        else:
            self.get_logger().info(text)

    @property
    def _is_news(self):
        """Whether being inactive must be reported: not in the first moments after a start."""
        return not self.starting and (
            self._was_wanted or self._published is not None
            or time.monotonic() - self._idle > STARTS)

    @property
    def _reason(self):
        """The supervisor's reason; for axes that do not move, whether there is a driver at all."""
        reason = self._supervisor.reason
        cause = self._crowd or ('' if ASTRAY not in reason or self._is_driven() else
                                'no driver follows command: start it')
        return reason.replace(ASTRAY, cause or ASTRAY)

    def _is_driven(self):
        """Whether a driver follows `command`, and not only a listener."""
        return any(drives(info.node_name) for info in self.get_subscriptions_info_by_topic(
            self.resolve_topic_name(topics.COMMAND.name)))

    def _look_at_commanders(self):
        crowd = ''
        for topic, kept in ((topics.REQUEST, 'one'), (topics.COMMAND, 'the guard')):
            names = sorted(set(self.publisher_names(topic)[0]))
            if len(names) > 1:
                crowd = (f'{" and ".join(names)} publish {self.resolve_topic_name(topic.name)}: '
                         f'end all but {kept}')
        if crowd and crowd != self._crowd:
            self.get_logger().error(crowd)
        self._crowd = crowd

    # --- lifecycle ----------------------------------------------------------------------------

    def look_around(self):
        """A second guard must find the first one before it sends anything."""
        return LOOK_AROUND if self.value('renew_s') else 0.0

    def activated(self):
        """Continue with the request if it is still repeated."""
        if self._resting and self._supervisor.state == 'paused':
            self._do('', self._supervisor.resume)
        self._resting = False
        site = site_of(self.value)
        for limit, distance in self._limits.keep_out:
            if self._whole or not limit.turns or not self._now():
                continue
            az, el = limit.place(self._now() * 1e-9, site)  # reveals a wrong site or clock
            self.get_logger().info(
                f'at latitude {site.latitude / DEG:.4f}, longitude {site.longitude / DEG:.4f} deg '
                f'{limit.name} is at azimuth {az / DEG:.1f}, elevation {el / DEG:.1f} deg now: it '
                f'is kept {distance / DEG:g} deg away from')

    def deactivated(self):
        """Stop the mount, and follow no request."""
        now, before = self._now(), self._supervisor.state
        with suppress(ValueError):  # aborted or parked: at rest already
            self._supervisor.pause(now)
            self._resting = before != 'paused'
        for track in self._supervisor.step(now, False):
            self._send(track)

    def before_end(self):
        """Stop a mount that is being moved: this process ends, but the mount may not."""
        if self.active and not self._whole and self._supervisor.state in LEADING:
            self._do('', self._supervisor.abort)
            self._command_pub.wait_for_all_acked(Duration(seconds=DELIVERED))

    # --- services -----------------------------------------------------------------------------

    def _do(self, done, call, *args):
        if not self.active:
            return False, self.inactive
        try:
            done = call(self._now(), *args) or done
        except ValueError as err:
            return False, str(err)
        self._look()
        return True, done

    def _on_abort(self):
        """Stop what this guard sends; report if the axes move nevertheless."""
        resting = self._supervisor.state in ('idle', 'stopped', 'paused', 'parked')
        done, text = self._do('aborted', self._supervisor.abort)
        if done and resting and not (self._whole or self._supervisor.readings.at_rest(STILL)):
            text += (': the axes move, or report no angle, but not by this guard: only the driver '
                     'can stop its own motions (home)')
        return done, text

    def _on_park(self):
        if self._park is None:
            return False, 'no park position: set the parameter park_deg'
        return self._do('on the way to the park position', self._supervisor.park,
                        tuple(angle * DEG for angle in self._park))

    # --- diagnostics --------------------------------------------------------------------------

    def waiting_for(self):
        """See the base class; activation is not reported in the first moments after a start."""
        missing = [text for text in super().waiting_for() if text != ACTIVATION or self._is_news]
        command = self.resolve_topic_name(topics.COMMAND.name)
        if self.count_subscribers(command) and not self._is_driven():
            missing.append(f'a driver of the mount: no subscriber of {command} is one')
        return missing

    def required(self):
        """Readings, and a mount."""
        return {self.resolve_topic_name(topic.name) for topic in (
            topics.INCREMENTAL, topics.COMMAND)}

    def problems(self):
        """What holds the mount up."""
        supervisor = self._supervisor
        found = [(LEVELS[supervisor.level], self._reason)] if supervisor.level else []
        if self._crowd:
            found.insert(0, (DiagnosticStatus.ERROR, self._crowd))
        return found

    def details(self):
        """State of the mount."""
        return [*super().details(), ('mount', self._supervisor.state), ('why', self._reason)]
