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

"""What is sent to a mount, moment by moment, and what is not. The mount obeys."""

import contextlib
import math

import numpy as np
import pytest
from obedient_mount import AXIS, START, Mount, off

from msg_tools.units import DEG
from pointing_model.mounts import Mount as Places
from pointing_model.sky.places import sun_place
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.skyline import Horizon
from telescope_mount.guard import supervisor as supervisor_of
from telescope_mount.guard.axis_track import Cubic, braked, ended
from telescope_mount.guard.limits import Axis, Limits, travel_of
from telescope_mount.guard.reasons_to_stop import LATE, WARN
from telescope_mount.guard.sky_limits import SUN, SkyCircles
from telescope_mount.guard.track_check import Refused
from telescope_mount.observing.axis_demand import Track

NOON = START + 15 * 3600 * 10**9


@pytest.fixture
def mount():
    return Mount().run(0.2)


def test_the_mount_comes_to_the_star_and_stays_on_it_within_its_limits(mount):
    mount.ask(80.0, 30.0).run(40.0)
    assert mount.state == 'following' and off(mount) < 0.01
    speed = np.abs(np.diff(mount.path, axis=0)).max(0) / 0.05
    assert np.all(speed <= AXIS[0])


def test_without_its_commander_it_stands_within_half_a_second_and_its_braking(mount):
    mount.ask(200.0, 30.0).run(5.0)
    assert np.abs(mount.speed).max() > 2.0 * DEG
    mount.asked = None
    mount.run(0.5 + 0.05)
    assert mount.state == 'stopped' and 'no longer renewed' in mount.supervisor.reason
    mount.run(AXIS[0] / AXIS[1])
    assert not mount.speed.any()


def test_without_the_guard_it_stops_by_itself(mount):
    mount.ask(200.0, 30.0).run(5.0)
    mount.supervisor.step = lambda *_: []
    mount.asked = None
    mount.run(1.5 + 0.5 + AXIS[0] / AXIS[1])
    assert not mount.speed.any()


def test_a_silent_encoder_stops_it_and_it_goes_on_when_that_speaks(mount):
    mount.ask(200.0, 30.0).run(5.0)
    mount.reads = False
    mount.run(0.6)
    assert mount.state == 'stopped' and mount.supervisor.level == 2
    assert 'no reading of the encoders for 0.5 s' in mount.supervisor.reason
    mount.reads = True
    assert mount.run(60.0).state == 'following' and off(mount) < 0.01


def test_it_goes_around_the_sun():
    sun = SkyCircles([(SUN, 0.1)], DEFAULT_SITE).at(NOON * 1e-9)[0].toward
    az, el = np.arctan2(sun[0], sun[1]) / DEG, np.arcsin(sun[2]) / DEG
    assert el > 10.0
    mount = Mount(NOON, (az - 40.0, el)).run(0.2)
    mount.ask(az + 40.0, el).run(1.0)
    assert mount.state == 'around'
    mount.run(120.0)
    assert mount.state == 'following' and off(mount) < 0.01
    first, second = np.array(mount.path).T
    toward = np.array([np.cos(second) * np.sin(first), np.cos(second) * np.cos(first),
                       np.sin(second)])
    assert np.arccos(sun @ toward).min() > 20.0 * DEG


def test_pause_holds_it_and_resume_goes_on(mount):
    mount.ask(80.0, 30.0).run(3.0)
    mount.supervisor.pause(mount.now)
    mount.run(4.0)
    assert mount.state == 'paused' and not mount.speed.any()
    mount.supervisor.resume(mount.now)
    assert mount.run(40.0).state == 'following' and off(mount) < 0.01


def test_resume_after_the_end_of_the_track_follows_the_next_request(mount):
    mount.ask(80.0, 30.0).run(3.0)
    mount.supervisor.pause(mount.now)
    mount.run(4.0).time += 700.0
    mount.run(0.2)
    assert mount.state == 'paused'
    assert mount.supervisor.resume(mount.now) == (
        'resumed: the old track has ended, and the next request is followed')
    stands = mount.here
    assert np.array_equal(mount.run(2.0).here, stands) and mount.state == 'idle'
    assert mount.supervisor.refused == (0, '')
    assert mount.ask(90.0, 40.0).run(40.0).state == 'following'


def test_resume_says_that_a_track_is_unsafe_now_and_that_the_next_is_followed(mount):
    mount.ask(80.0, 30.0).run(3.0)
    mount.supervisor.pause(mount.now)
    mount.run(4.0)
    mount.supervisor._check.check = lambda *_: Refused('the track meets the Sun')
    assert mount.supervisor.resume(mount.now) == (
        'resumed, but the old track is refused: the track meets the Sun. The next request '
        'is followed if allowed')
    assert mount.state == 'stopped' and mount.supervisor.refused[1] == 'the track meets the Sun'
    del mount.supervisor._check.check
    assert mount.ask(90.0, 40.0).run(40.0).state == 'following'


def test_after_an_abort_nothing_moves_until_resume(mount):
    mount.ask(80.0, 30.0).run(3.0)
    mount.supervisor.abort(mount.now)
    mount.asked = None
    mount.run(4.0)
    here = mount.here
    with pytest.raises(ValueError, match='aborted: call resume'):
        mount.ask(90.0, 40.0)
    mount.asked = None
    assert np.array_equal(mount.run(2.0).here, here)
    mount.supervisor.resume(mount.now)
    assert mount.ask(90.0, 40.0).run(40.0).state == 'following'


def test_it_parks(mount):
    mount.ask(80.0, 30.0).run(3.0)
    mount.asked = None
    mount.supervisor.park(mount.now, (-90.0 * DEG, 80.0 * DEG))
    mount.run(80.0)
    assert mount.state == 'parked' and np.allclose(mount.here / DEG, (-90.0, 80.0), atol=0.01)
    assert not mount.speed.any()


def test_it_has_one_commander(mount):
    mount.ask(80.0, 30.0).run(1.0)
    with pytest.raises(ValueError, match='player sends requests while observer commands'):
        mount.supervisor.take_request(mount.asked._replace(start=mount.now), mount.now, 'player')


def test_a_refusal_is_told_once_and_stops_what_was_under_way(mount):
    mount.ask(200.0, 30.0).run(3.0)
    with pytest.raises(ValueError, match='below the horizon'):
        mount.ask(120.0, 2.0)
    mount.run(4.0)
    assert mount.state == 'stopped' and not mount.speed.any()
    assert mount.supervisor.refused[0] == mount.asked.start


@pytest.mark.parametrize('angles, words', [
    ((200.0, 50.0), 'cannot be: give radians'), ((0.35, 45.0), 'cannot be: give radians'),
    ((2.0, 0.87), 'jumped by'), ((1000.0, 0.8), 'cannot be')])
def test_readings_that_cannot_be_are_refused(mount, angles, words):
    mount.time += 0.05
    with pytest.raises(ValueError, match=words):
        mount.supervisor.take_reading(mount.now, angles, (0.0, 0.0))


def test_an_axis_that_does_not_follow_is_stopped_for_good(mount):
    mount.ask(80.0, 30.0).run(2.0)
    mount.sent = []  # deaf
    mount.here = mount.here.copy()
    while mount.state == 'following' and mount.time < 60.0:
        mount.run(0.05)
        mount.sent = []
    assert mount.state == 'aborted' and 'from where it was sent' in mount.supervisor.reason


def test_a_whole_track_that_may_have_been_lost_is_sent_once_more():
    """A simulated mount that is killed and started again knows nothing of it, and nobody renews."""
    mount = Mount(whole=True).run(0.2)
    supervisor, times = mount.supervisor, np.arange(0.0, 601.0, 20.0)
    track = Track(mount.now, times, np.full((len(times), 2), [0.5, 0.9]), np.zeros((len(times), 2)))
    supervisor.take_request(track, mount.now)
    assert len(supervisor.step(mount.now)) == 1
    supervisor.take_request(track, mount.now)  # no reading since
    sent, = supervisor.step(mount.now)
    assert supervisor.is_request(sent) and sent.start == track.start
    supervisor.take_reading(mount.now + 10**8, mount.here, (0.0, 0.0))
    supervisor.take_request(track, mount.now)  # it is on its way
    assert supervisor.step(mount.now) == []


@pytest.mark.parametrize('asleep', [False, True])
def test_a_guard_that_is_started_again_lets_a_mount_move_that_is_read_only_when_it_does(asleep):
    mount = Mount(whole=True, asleep=asleep)
    supervisor, times = mount.supervisor, np.arange(0.0, 601.0, 20.0)

    def ask(el, number):
        track = Track(mount.now + number, times, np.full((len(times), 2), [0.5, el]),
                      np.zeros((len(times), 2)))
        supervisor.take_request(track, mount.now)
        first = supervisor.step(mount.now)
        supervisor.take_request(track, mount.now)
        return first, supervisor.step(mount.now)
    assert ask(0.9, 1)[0] == [] and supervisor.state == ('following' if asleep else 'waiting')
    supervisor.withdraw(mount.now)
    assert len(ask(1.0, 2)[1]) == asleep
    supervisor.withdraw(mount.now)
    if asleep:  # and below the horizon not even then
        with pytest.raises(ValueError, match='horizon'):
            ask(0.1, 3)


def test_whole_tracks_are_passed_as_they_were_asked_for():
    mount = Mount(whole=True).run(0.2)
    mount.ask(80.0, 30.0)
    out, = mount.supervisor.step(mount.now)
    assert mount.supervisor.is_request(out) and out.start == mount.asked.start
    assert out.angles is mount.asked.angles


def test_axes_brake_each_in_its_own_time_and_tracks_end_at_rest():
    axes = Axis(-4.0, 4.0, 0.1, 0.1), Axis(-4.0, 4.0, 0.1, 0.4)
    times, angles, rates = braked(np.zeros(1), np.zeros((1, 2)), np.array([[0.1, -0.1]]), axes)
    assert times == pytest.approx([0.0, 0.25, 1.0])
    assert angles[-1] == pytest.approx([0.05, -0.0125]) and not rates[-1].any()
    cubic = Cubic(times, angles, rates)
    assert np.all(cubic.peak_acceleration <= np.array([0.1, 0.4]) * (1.0 + 1e-9))
    track = ended(Track(0, np.array([0.0, 10.0]), np.array([[0.0, 0.0], [0.5, 0.1]]),
                        np.full((2, 2), 0.05)), (0.1, 0.4))
    assert len(track.times) == 3 and not track.rates[-1].any()
    assert Cubic(*track[1:]).peak_acceleration[0] <= 0.1 * (1.0 + 1e-9)


def test_a_fast_track_is_ended_no_sharper_than_a_track_may_be(mount):
    times, rates = np.array([0.0, 60.0]), np.array([0.8, 0.3]) * DEG  # as of a low satellite
    mount.asked = Track(mount.now, times, np.array([20.0, 40.0]) * DEG + times[:, None] * rates,
                        np.tile(rates, (2, 1)))
    assert mount.supervisor.limits.timing == 0.5
    assert mount.run(30.0).state == 'following' and off(mount) < 0.01
    assert mount.run(40.0).state == 'idle' and not mount.speed.any()


def test_an_unknown_turn_leaves_what_is_safe_on_each():
    unknown = Mount(here=(100.0, 50.0), turn_known=False).run(0.2)
    assert unknown.ask(200.0, 50.0).run(40.0).state == 'following'
    with pytest.raises(ValueError, match='leaves its travel of 90 to 270 deg'):
        unknown.ask(60.0, 50.0)


def test_a_lag_of_a_driver_is_no_fault_and_a_blocked_axis_is(mount):
    take, seen = mount.supervisor.take_reading, []

    def late(stamp, here, speed):
        seen.append(here)
        take(stamp, seen[max(len(seen) - 9, 0)], speed)  # 0.4 s

    mount.supervisor.take_reading = late
    assert mount.ask(150.0, 50.0).run(60.0).state == 'following'
    here = np.array(mount.here)
    mount.supervisor.take_reading = lambda stamp, *_: take(stamp, here, (0.0, 0.0))
    mount.ask(20.0, 50.0)
    with pytest.raises(ValueError, match='aborted: call resume'):
        mount.run(6.0)
    assert 'the azimuth is' in mount.supervisor.reason


@pytest.mark.parametrize('latitude, east', [(34.3, (150.0, 170.0)), (-34.3, (150.0, 190.0))])
def test_a_german_mount_changes_its_side_above_the_horizon(latitude, east):
    german = Places.equatorial(latitude * DEG, 'german')
    limits = Limits(german, tuple(Axis(a * DEG, b * DEG, *AXIS) for a, b in travel_of(german)),
                    Horizon(10.0 * DEG), keep_out=())
    here = np.array(limits.on_travel(80.0 * DEG, math.copysign(35.0 * DEG, latitude))) / DEG
    mount = Mount(here=here, limits=limits).run(0.2)
    mount.ask(*east, 0.0).run(120.0)
    assert mount.state == 'following', mount.supervisor.reason
    want = np.array(limits.on_travel(*np.array(east) * DEG))
    assert np.allclose(mount.here, want, atol=1e-6)
    assert german.horizon_of(*np.array(mount.path).T)[1].min() > 10.0 * DEG
    back = mount.ask(*here, 0.0).run(120.0)
    assert back.state == 'following' and np.allclose(mount.here / DEG, here, atol=1e-4)


@pytest.mark.parametrize('beyond', [(530.0, 50.0), (20.0, 355.0), (-530.0, 50.0)])
def test_a_first_reading_beyond_the_travel_is_not_believed_and_nothing_is_sent_by_it(beyond):
    mount = Mount()
    with pytest.raises(ValueError, match=r'cannot be: give radians, within the travel'):
        mount.supervisor.take_reading(mount.now, np.array(beyond) * DEG, (0.0, 0.0))
    mount.ask(170.0, 50.0)
    mount.asked = None
    mount.supervisor.abort(mount.now)
    assert mount.supervisor.step(mount.now) == [] and mount.supervisor.readings.here is None
    mount.supervisor.resume(mount.now)
    mount.run(0.2)
    assert mount.ask(170.0, 50.0).run(60.0).state == 'following'
    assert np.abs(off(mount)).max() < 30.0


@pytest.mark.parametrize(('first', 'then'), [(275.0, -85.0), (340.0, -20.0), (-200.0, 160.0)])
def test_a_first_reading_a_turn_off_ends_with_those_that_contradict_it(first, then):
    mount = Mount(here=(first, 50.0)).run(0.05)
    mount.ask(first - np.sign(first) * 80.0, 50.0)
    mount.here, sent = np.array([then, 50.0]) * DEG, len(mount.sent)
    for _ in range(6):
        mount.time += 0.05
        with contextlib.suppress(ValueError):
            mount.supervisor.take_reading(mount.now, mount.here, (np.nan, np.nan))
    mount.sent += mount.supervisor.step(mount.now, False)
    assert mount.state == 'aborted' and 'jumped to another position' in mount.supervisor.reason
    stop = mount.sent[-1]
    assert len(mount.sent) > sent and stop.angles[:, 0] / DEG == pytest.approx(then)
    assert not stop.rates.any()
    mount.asked = None
    mount.supervisor.resume(mount.now)
    assert mount.ask(then, 60.0).run(20.0).state == 'following'
    assert abs(mount.here[0] / DEG - then) < 1.0


@pytest.mark.parametrize('readings', [(359.5, 0.5, 1.5), (179.5, -179.5, -178.5),
                                      (100.0, 103.0, -257.0, -256.0)])
def test_an_azimuth_that_is_read_within_one_turn_keeps_counting(readings):
    mount = Mount(here=(readings[0], 50.0))
    for angle in readings:
        mount.time += 1.0
        mount.supervisor.take_reading(mount.now, np.array([angle, 50.0]) * DEG, (0.0, 0.0))
    way = mount.supervisor.readings.here[0] / DEG - readings[0]
    assert way == pytest.approx((readings[-1] - readings[0]) % 360.0)


@pytest.mark.parametrize('az', [270.0, -270.0, 275.0])
def test_a_mount_at_the_end_of_its_travel_may_come_back(az):
    mount = Mount(here=(az, 50.0)).run(0.2)
    assert mount.ask(0.9 * az, 50.0).run(30.0).state == 'following'
    assert np.abs(np.array(mount.path)[:, 0]).max() <= abs(az) * DEG + 1e-9


def test_a_guard_that_was_held_up_says_that_its_machine_is_late_and_goes_on(mount):
    mount.ask(150.0, 50.0).run(3.0)
    mount.time += 2.0
    mount.here, mount.speed = mount.sent[-1].angles[-1], np.zeros(2)
    mount.supervisor.take_reading(mount.now, mount.here, mount.speed)
    assert mount.supervisor.step(mount.now) == []
    assert (mount.state, mount.supervisor.reason) == ('stopping', LATE)
    assert mount.run(60.0).state == 'following' and np.abs(off(mount)).max() < 30.0


def test_a_search_for_a_way_that_takes_long_does_not_make_what_it_finds_too_late(monkeypatch):
    az, el = np.array(sun_place(NOON * 1e-9)) / DEG
    mount, find, late = Mount(NOON, (az - 40.0, el)).run(0.2), supervisor_of.lead, []

    def search(*args):
        mount.time += 0.5  # of a machine that is busy
        return find(*args)
    monkeypatch.setattr(supervisor_of, 'lead', search)
    mount.ask(az + 40.0, el)
    for _ in range(600):
        mount.run(0.05)
        late += [mount.supervisor.reason] * (mount.supervisor.reason == LATE)
    assert not late and mount.run(90.0).state == 'following'


def test_a_guard_that_was_held_up_and_then_reads_no_number_waits_and_goes_on(mount, recwarn):
    supervisor = mount.ask(150.0, 50.0).supervisor
    mount.run(3.0)
    mount.time += 2.0  # held up: what was sent has ended at rest
    mount.here, mount.speed = mount.sent[-1].angles[-1], np.zeros(2)
    supervisor.take_reading(mount.now, (np.nan, np.nan), (np.nan, np.nan))
    assert supervisor.step(mount.now) == []
    assert (supervisor.state, supervisor.level) == ('stopped', WARN)
    assert 'no angle' in supervisor.reason
    mount.asked = None
    supervisor.take_reading(mount.now + 1, mount.here, (np.nan, np.nan))
    assert not supervisor.readings.at_rest(1.0)  # nothing is known of its rate yet
    assert mount.run(0.2).ask(150.0, 50.0).run(60.0).state == 'following'
    assert not recwarn.list


def test_a_first_message_without_a_number_is_waited_after(recwarn):
    mount = Mount()
    mount.supervisor.take_reading(mount.now, (np.nan, np.nan), (np.nan, np.nan))
    mount.ask(40.0, 50.0)
    assert mount.supervisor.step(mount.now) == [] and mount.state == 'waiting'
    assert mount.run(20.0).state == 'following'
    assert not recwarn.list


def test_a_request_from_the_future_is_refused_and_locks_nobody_out(mount):
    times, angles = np.array([0.0, 100.0]), np.tile([60.0 * DEG, 45.0 * DEG], (2, 1))
    late = Track(mount.now + 3600 * 10**9, times, angles, np.zeros((2, 2)))
    with pytest.raises(ValueError, match='a request for 3600 s from now: send one for now'):
        mount.supervisor.take_request(late, mount.now, 'somebody')
    assert mount.ask(40.0, 60.0).run(20.0).state == 'following'


def test_a_clock_that_is_set_back_ends_what_was_asked_for_and_no_more(mount):
    mount.ask(40.0, 60.0).run(5.0)
    mount.asked, there, late = None, mount.here, mount.asked
    early = late._replace(start=late.start - 3600 * 10**9)
    with pytest.raises(ValueError, match='older'):  # who asks has heard of it before the guard
        mount.supervisor.take_request(early, mount.now, 'observer')
    mount.sent, mount.start, mount.speed = [], mount.start - 3600 * 10**9, np.zeros(2)
    mount.run(0.2)
    with pytest.raises(ValueError, match='send one for now'):  # who asks has not heard of it yet
        mount.supervisor.take_request(late, mount.now, 'observer')
    assert mount.supervisor.refused == (0, '')
    assert (mount.state, mount.supervisor.reason) == (
        'stopped', 'the clock was set back: send the request again')
    assert mount.sent == [] and np.all(mount.here == there)
    assert mount.ask(40.0, 60.0).run(20.0).state == 'following'
    assert np.abs(off(mount)).max() < 30.0


def test_a_mount_that_goes_on_after_its_clock_was_set_back_is_stopped_from_its_own_reading(mount):
    mount.ask(140.0, 60.0).run(5.0)
    mount.asked, going = None, mount.sent[-1]
    mount.sent, mount.start = [], mount.start - 3600 * 10**9
    supervisor, speed = mount.supervisor, mount.speed[0]
    assert speed > 2.0 * DEG
    # no reading of the new time yet: nothing is known
    mount.time += 0.05
    assert supervisor.step(mount.now) == [] and supervisor.step(mount.now) == []
    here = mount.here + np.array([0.05 * speed, 0.0])
    supervisor.take_reading(mount.now, here, mount.speed)
    stop, = supervisor.step(mount.now)
    assert stop.start == mount.now < going.start and np.all(stop.angles[0] == here)
    assert stop.rates[0, 0] == speed and not stop.rates[-1].any()
    assert supervisor.step(mount.now) == [] and supervisor.state == 'stopped'
