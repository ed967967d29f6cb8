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

"""The guard between a commander and a mount that the test plays."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.node import MountNode
from msg_tools.params import BadInput
from msg_tools.units import DEG
from telescope_mount.guard import mount_guard_node
from telescope_mount.guard.mount_guard_node import MountGuard
from telescope_mount.guard.reasons_to_stop import ERROR, LATE, OK, WARN
from telescope_mount.guard.sky_limits import SUN

TIMES = np.array([0.0, 20.0, 40.0])
PLACE = {'latitude_deg': 34.3, 'longitude_deg': 109.0}


class Played:
    """A mount whose encoders read where it was told to be, and a commander."""

    def __init__(self, graph):
        self.graph, self.reads, self.request, self.rate = graph, True, None, 0.0
        self.here = np.array([20.0, 50.0]) * DEG
        self.commands = graph.listen(topics.COMMAND)
        self.status = graph.listen(topics.GUARD_STATUS)
        self.readings = graph.publisher(topics.INCREMENTAL)
        self.requests = graph.publisher(topics.REQUEST)
        self.owners = graph.publisher(topics.REQUEST_OWNER)
        graph.tester.create_timer(0.05, self._tick)

    def now(self):
        return self.graph.tester.get_clock().now().nanoseconds

    def _tick(self):
        now = self.now()
        if self.commands:
            stamp, times, angles, _ = convert.read_trajectory(self.commands[-1])
            self.here = np.array([np.interp((now - stamp) * 1e-9, times, a) for a in angles.T])
        if self.reads:
            self.readings.publish(convert.joint_state(now, self.here, [self.rate, 0.0]))
        if self.request is not None:
            self.requests.publish(self.request)

    def ask(self, az, el):
        rates = np.full((3, 2), 0.004 * DEG)
        self.request = convert.trajectory(
            self.now(), TIMES, np.array([az, el]) * DEG + TIMES[:, None] * rates, rates)

    def owned(self, node, request):
        stamp = str(convert.from_stamp(request.header.stamp))
        self.owners.publish(topics.REQUEST_OWNER.message(key=node, value=stamp))

    def until(self, state, text=''):
        def there():
            last = self.status[-1] if self.status else None
            rows = {row.key: row.value for row in last.values} if last else {}
            return rows.get('state') == state and text in last.message + rows['reason']
        self.graph.wait_for(there, lambda: f'{state} {text}; last: {self.status[-1:]}')
        return self.status[-1]


def test_the_guard_leads_the_mount_and_stops_it_when_the_encoder_is_silent(graph):
    guard = graph.add(MountGuard, **PLACE, renew_s=0.1)
    mount = Played(graph)
    graph.connect()
    mount.ask(24.0, 52.0)
    mount.owned('/mount/star_observer', mount.request)
    mount.until('following')
    other = convert.trajectory(mount.now(), TIMES, np.full((3, 2), 0.5), np.zeros((3, 2)))
    mount.owned('/mount/player', other)
    graph.wait_for(lambda: mount.requests.publish(other) or guard.rejected,
                   'the second commander refused')
    assert 'player sends requests while /mount/star_observer commands' in guard.rejected[
        topics.REQUEST.name][1]
    graph.wait_for(lambda: np.allclose(mount.here / DEG, (24.0, 52.0), atol=0.2), 'the star')
    assert all(not any(command.points[-1].velocities) for command in mount.commands)
    mount.reads = False
    told = mount.until('stopped', 'no reading of the encoders')
    assert told.level == DiagnosticStatus.ERROR
    graph.report('mount_guard', 'no reading of the encoders')
    mount.reads = True
    mount.until('following')
    mount.ask(24.0, 2.0)
    mount.owned('/mount/star_observer', mount.request)
    assert 'below the horizon of 10.0 deg' in mount.until('stopped', 'refused').message
    # a replay, or a hand at the terminal, moves the mount past the guard
    graph.publisher(topics.COMMAND)
    graph.report('mount_guard', ' publish /mount/command: end all but the guard')
    mount.ask(24.0, 52.0)
    mount.owned('/mount/star_observer', mount.request)
    mount.until('following')
    away = mount.here + np.array([[0.0, 0.0], [20.0, 0.0]]) * DEG
    mount.commands = [convert.trajectory(mount.now(), [0.0, 10.0], away, np.zeros((2, 2)))]
    told = mount.until('aborted', 'publish /mount/command: end all but the guard; then call resume')
    assert 'look at its drive' not in told.message
    mount.request = None


def test_services_of_the_guard_stop_the_mount_and_park_it(graph):
    guard = graph.add(MountGuard, **PLACE, renew_s=0.1, park_deg='22,51')
    mount = Played(graph)
    graph.connect()
    mount.ask(24.0, 52.0)
    mount.until('following')
    # a managed node: at rest while it is not active, whatever is asked for
    guard.trigger_deactivate()
    mount.until('inactive', 'mount_guard is inactive: activate it')
    sent = convert.from_stamp(mount.commands[-1].header.stamp)
    assert not graph.call('pause').success
    graph.wait_for(lambda: mount.now() > sent + 5 * 10**8)
    assert convert.from_stamp(mount.commands[-1].header.stamp) - sent < 10**8
    guard.trigger_activate()
    mount.until('following')
    assert graph.call('pause').success
    mount.until('paused')
    answer = graph.call('resume')
    assert answer.success and answer.message == 'resumed'
    mount.until('following')
    assert graph.call('pause').success
    mount.until('paused')
    guard._supervisor._goal = guard._supervisor._goal._replace(start=mount.now() - 10**12)
    answer = graph.call('resume')
    assert answer.success and answer.message.startswith('resumed: the old track has ended')
    mount.ask(24.0, 52.0)
    mount.until('following')
    guard.before_end()  # as its process ends
    mount.until('aborted')
    assert not any(mount.commands[-1].points[-1].velocities)
    assert graph.call('abort').success
    mount.request = None
    mount.until('aborted')
    mount.ask(25.0, 52.0)
    mount.until('aborted', 'call resume')
    mount.request = None
    assert graph.call('park').success
    mount.until('parked')
    assert np.allclose(mount.here / DEG, (22.0, 51.0), atol=0.05)
    assert not graph.call('pause').success
    # axes that do not move: is there a driver?
    guard._supervisor._set_state('aborted', 2, 'the azimuth is 3.0 deg from where it was sent: '
                             'stopped; look at its drive and encoder, and call resume')
    mount.until('aborted', 'look at its drive')
    graph.tester.destroy_subscription(graph.subscriptions.pop(2))
    assert 'no driver follows command: start it' in mount.until('aborted', 'no driver').message


def test_a_guard_that_is_not_active_says_so_when_it_is_asked_and_not_at_each_start(graph):
    guard = graph.add(MountGuard, **PLACE, renew_s=0.1, autostart=False)
    mount = Played(graph)
    graph.connect()
    assert guard.starting is False and mount.status == []
    assert 'activation' not in guard.waiting_for()
    mount.ask(24.0, 52.0)
    mount.until('inactive', 'mount_guard is unconfigured: configure and activate it')
    assert 'activation' in guard.waiting_for()


def test_who_aborts_hears_that_the_axes_move_by_themselves(graph):
    graph.add(MountGuard, **PLACE, renew_s=0.1)
    mount = Played(graph)
    graph.connect()
    mount.until('idle', 'no request')
    assert graph.call('abort').message == 'aborted'
    mount.rate = 3.0 * DEG  # homing

    def said():
        return graph.call('resume').success and 'not by this guard' in graph.call('abort').message
    graph.wait_for(said)


def test_nobody_leads_a_real_mount_past_a_sun_that_may_be_anywhere(graph):
    with pytest.raises(BadInput, match='no site, so the place of the Sun is unknown'):
        graph.add(MountGuard, renew_s=0.1)
    graph.add(MountGuard, renew_s=0.1, sun_distance_deg=0.0)


def test_a_limit_that_stands_in_the_sky_needs_no_site(graph, monkeypatch):
    beam = replace(SUN, name='a beam', place=lambda time, site: (1.0, 0.9), turns=False)
    monkeypatch.setattr(mount_guard_node, 'SKY_LIMITS', (beam,))
    graph.add(MountGuard, renew_s=0.1)


@pytest.mark.parametrize('mount, site, shown', [
    ('altaz', {}, []), ('altaz', PLACE, ['latitude_deg', 'longitude_deg']),
    # where the horizon is hangs on it
    ('german', {}, ['latitude_deg', 'longitude_deg', 'height_m'])])
def test_a_site_that_nobody_gave_is_published_where_limits_hang_on_it(graph, mount, site, shown):
    graph.add(MountGuard, **site, mount=mount, sun_distance_deg=0.0)
    status = graph.listen(topics.GUARD_STATUS)
    graph.wait_for(lambda: status, 'a status')
    assert [row.key for row in status[-1].values
            if row.key in ('latitude_deg', 'longitude_deg', 'height_m')] == shown


def test_the_site_of_a_guard_stays(graph):
    done, reason = graph.set_parameter(graph.add(MountGuard, **PLACE, renew_s=0.1),
                                       latitude_deg=10.0)
    assert not done and 'latitude_deg' in reason


def test_a_missing_driver_is_named_though_a_logger_hears_the_commands(graph):
    guard = graph.add(MountGuard, **PLACE)
    graph.publisher(topics.INCREMENTAL)

    def hears(name):
        class Hears(MountNode):

            def __init__(self, **kwargs):
                super().__init__(name, **kwargs)
                self.subscribe(topics.COMMAND, print)
        return graph.add(Hears)
    hears('mcap_logger')
    graph.report('mount_guard', 'waiting for a driver of the mount: no subscriber of '
                 '/mount/command is one')
    hears('mount_driver')
    graph.wait_for(lambda: not guard.waiting_for())


def test_a_late_machine_is_said_once_in_ten_seconds_and_not_each_time(graph, monkeypatch):
    guard, lines = graph.add(MountGuard, **PLACE), []
    log = SimpleNamespace(info=lines.append, warning=lines.append, error=lines.append)
    monkeypatch.setattr(guard, 'get_logger', lambda: log)
    guard.active = True
    seconds = [100.0]
    monkeypatch.setattr(mount_guard_node, 'time', SimpleNamespace(monotonic=lambda: seconds[0]))
    for _ in range(180):
        for told in (('stopping', WARN, LATE), ('following', OK, 'as requested')):
            guard._supervisor._set_state(*told)
            guard._publish_status()
            seconds[0] += 0.3
    assert sum(LATE in line for line in lines) == 11 and len(lines) == 22
    guard._supervisor._set_state('aborted', ERROR, 'the azimuth is elsewhere')
    guard._publish_status()
    assert lines[-1] == 'aborted: the azimuth is elsewhere'
