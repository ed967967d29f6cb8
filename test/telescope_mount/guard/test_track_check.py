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

"""What the guard lets pass: limits, the way to a track, the ways around."""

import numpy as np
import pytest

from msg_tools.units import DEG
from pointing_model.mounts import Mount
from pointing_model.sky.places import sun_place
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.skyline import Horizon, parse_horizon
from telescope_mount.guard.axis_track import Cubic
from telescope_mount.guard.detour import around, lead
from telescope_mount.guard.limits import Axis, Limits, safe_travel, travel_of
from telescope_mount.guard.motion import AxisState, Slew
from telescope_mount.guard.sky_limits import SUN, Circle, SkyCircles, SkyLimit
from telescope_mount.guard.track_check import Allowed, Refused, TrackCheck

KNOTS = np.arange(0.0, 121.0, 20.0)
POLE = np.array([0.0, np.cos(34.3 * DEG), np.sin(34.3 * DEG)])


def star(az, el, rate=(15.0 / 3600.0, 5.0 / 3600.0)):
    rates = np.tile(np.array(rate) * DEG, (len(KNOTS), 1))
    return KNOTS, np.array([az, el]) * DEG + KNOTS[:, None] * rates, rates


def at(first, second, *rates):
    return AxisState((first * DEG, second * DEG), tuple(r * DEG for r in rates) or (0.0, 0.0))


def toward(az, el):
    return Mount().direction(az * DEG, el * DEG)


def circles(az, el, distance=20.0, limit=SUN):
    """Of the Sun at a place of the sky, or of another limit."""
    return [Circle(toward(az, el), POLE if limit.turns else None, distance * DEG, limit)]


def refused(check, *args, **named):
    found = check.check(*args, **named)
    assert isinstance(found, Refused)
    return found.reason


@pytest.fixture(scope='module')
def check():
    return TrackCheck(Limits(horizon=Horizon(15.0 * DEG, [(100.0 * DEG, 15.0 * DEG),
                                                     (110.0 * DEG, 40.0 * DEG),
                                                     (120.0 * DEG, 15.0 * DEG)])))


def test_an_ordinary_star_passes_as_it_was_asked_for(check):
    times, angles, rates = star(30.0, 50.0)
    found = check.check(times, angles, rates, at(-60.0, 70.0), circles(250.0, -40.0))
    assert isinstance(found, Allowed)
    assert found.cubic.angles is angles


@pytest.mark.parametrize('track, state, words', [
    (star(30.0, 14.0), (0.0, 50.0), 'the track comes below the horizon of 15.0 deg'),
    (star(110.0, 35.0), (180.0, 50.0), 'the track comes below the horizon of 40.0 deg'),
    (star(140.0, 30.0), (80.0, 30.0), 'the way to the track comes below the horizon of'),
    (star(30.0, 94.99, (0.0, 1.0 / 60.0)), (0.0, 50.0), 'leaves its travel of -5 to 95 deg'),
    (star(30.0, 40.0, (4.5, 0.0)), (0.0, 50.0), 'azimuth at 4.5 deg/s on the track is faster'),
    (star(30.0 * 57.3 * 3600.0, 40.0), (0.0, 50.0), 'is too large for an axis: give radians'),
    (star(np.nan, 40.0), (0.0, 50.0), 'a value that is not finite'),
    (star(30.0, 40.0), (np.nan, 50.0), 'where the axes stand is not known'),
])
def test_a_refusal_says_what_and_where(check, track, state, words):
    reason = refused(check, *track, at(*state))
    assert words in reason and ': ' in reason and '\n' not in reason


def test_the_azimuth_takes_the_turn_that_the_cables_allow(check):
    times, angles, rates = star(280.0, 50.0)
    found = check.check(times, angles, rates, at(250.0, 50.0))
    assert found.cubic.angles[0, 0] == pytest.approx(-80.0 * DEG)


def test_an_unknown_turn_leaves_what_is_safe_on_any():
    low, high = safe_travel(100.0 * DEG, -270.0 * DEG, 270.0 * DEG)
    assert (low / DEG, high / DEG) == pytest.approx((90.0, 270.0))
    with pytest.raises(ValueError, match='lies on no turn'):
        safe_travel(200.0 * DEG, -90.0 * DEG, 90.0 * DEG)


def test_the_way_past_the_sun_is_refused_and_led_around(check):
    sun = circles(0.0, 45.0)
    track, state = star(60.0, 45.0), at(-60.0, 45.0)
    found = check.check(*track, state, sun)
    assert 'the way to the track comes within 20 deg of the Sun' in found.reason
    vias = around(check, found.cubic, state, sun)
    assert vias
    places = [state.angles, *vias]
    assert all(isinstance(check.way(a, b, sun), Allowed) for a, b in zip(places, vias))
    assert 'the track comes within' in refused(check, *star(10.0, 40.0), state, sun)


def test_one_more_limit_in_the_sky_is_one_object():
    laser = SkyLimit("the neighbour's laser", 'laser_distance_deg', 5.0,
                     lambda time, site: (60.0 * DEG, 50.0 * DEG), turns=False)
    both = SkyCircles([(SUN, 20.0 * DEG), (laser, 5.0 * DEG)], DEFAULT_SITE)
    sun, beam = both.at(1_768_482_000.0)
    assert np.allclose(beam.toward, both.at(1_768_490_000.0)[1].toward)  # it stands
    check, state = TrackCheck(Limits()), at(30.0, 50.0)
    assert "comes within 5 deg of the neighbour's laser" in refused(
        check, *star(61.0, 52.0), state, [sun, beam])
    assert isinstance(check.check(*star(61.0, 60.0), state, [sun, beam]), Allowed)
    found = check.check(*star(110.0, 45.0), state, [beam, *circles(75.0, 62.0)])
    vias = around(check, found.cubic, state, [beam, *circles(75.0, 62.0)])
    path = [state.angles, *vias, (110.0 * DEG, 45.0 * DEG)]
    for near in (beam, *circles(75.0, 62.0)):
        assert all(isinstance(check.way(a, b, [near]), Allowed) for a, b in zip(path, path[1:]))


def test_a_slow_mount_on_its_way_around_keeps_away_from_where_the_sun_will_be():
    slow = tuple(Axis(*ends, 0.4 * DEG, 0.3 * DEG) for ends in (
        (-270.0 * DEG, 270.0 * DEG), (-5.0 * DEG, 95.0 * DEG)))
    check = TrackCheck(Limits(axes=slow, horizon=Horizon(15.0 * DEG), timing=0.4))
    sun = circles(-15.0, 40.0)
    track, state = star(-70.0, 35.0, (0.0, 0.0)), at(40.0, 35.0)
    vias = around(check, check.check(*track, state, sun).cubic, state, sun)
    seconds, here = 0.0, state.angles
    for there in (*vias, (-70.0 * DEG, 35.0 * DEG)):
        assert isinstance(check.way(here, there, [sun[0].later(seconds)]), Allowed)
        assert isinstance(check.way(here, there, [sun[0].later(0.4 * seconds)]), Allowed)
        way = np.abs(np.subtract(there, here))
        seconds += (way / (0.16 * DEG)).max() + 0.4 / (0.4 * 0.3)  # and up to speed
        here = there
    assert seconds > 600.0  # in which the Sun goes 2.5 deg


def test_whoever_stands_too_low_or_by_the_sun_may_come_out(check):
    sun = circles(0.0, 45.0)
    out = check.check(*star(60.0, 50.0), at(10.0, 45.0), sun)
    assert isinstance(out, Allowed)
    assert 'Sun' in refused(check, *star(-60.0, 45.0), at(10.0, 45.0), sun)
    assert isinstance(check.check(*star(30.0, 50.0), at(30.0, 5.0)), Allowed)
    assert 'horizon' in refused(check, *star(30.0, 50.0), at(30.0, 5.0, 0.0, -2.0))


def test_a_german_mount_changes_its_side_around_what_is_in_the_way():
    axis = (4.0 * DEG, 2.0 * DEG)
    german = Mount.equatorial(34.3 * DEG, 'german')
    check = TrackCheck(Limits(german, (Axis(-10.0 * DEG, 190.0 * DEG, *axis),
                                  Axis(-90.0 * DEG, 270.0 * DEG, *axis)), Horizon(10.0 * DEG)))
    west, east = at(20.0, 10.0), (150.0 * DEG, 170.0 * DEG)
    found = check.way(west.angles, east)
    cubic = Cubic(np.zeros(1), np.array([east]), np.zeros((1, 2)))
    vias = around(check, cubic, west)
    assert isinstance(found, Allowed) or vias
    late = np.array([[200.0, 20.0]]) * DEG
    assert 'hour angle of the track from 200.0' in refused(
        check, np.zeros(1), late, np.zeros((1, 2)), west)


def test_corners_of_a_horizon_are_read_from_text_and_file(tmp_path):
    file = tmp_path / 'skyline.txt'
    file.write_text('# trees\n0 12\n45 20.5  # the dome\n')
    assert parse_horizon(str(file)) == parse_horizon('0 12, 45 20.5')
    with pytest.raises(ValueError, match='give azimuth and elevation in degrees'):
        parse_horizon('0 12 5')


def test_the_sun_stands_where_another_library_has_it():
    coordinates = pytest.importorskip('astropy.coordinates')
    from astropy.time import Time
    from astropy.utils import iers
    iers.conf.auto_download = False
    time, sun = 1_768_482_000.0, SkyCircles([(SUN, 0.1)], DEFAULT_SITE)
    place = coordinates.EarthLocation.from_geodetic(109.0, 34.3, 500.0)
    there = coordinates.get_body('sun', Time(time + 300.0, format='unix'), place).transform_to(
        coordinates.AltAz(obstime=Time(time + 300.0, format='unix'), location=place))
    sun.at(time)
    wanted = toward(there.az.deg, there.alt.deg)
    assert np.linalg.norm(sun.at(time + 300.0)[0].toward - wanted) < 60.0 / 206265.0
    assert sun_place(time)[1] < 0.0


def test_the_axes_of_a_polar_mount_in_the_south_go_through_the_other_pole():
    south = Mount.equatorial(-30.0 * DEG, 'german')
    ends = travel_of(south)
    limits = Limits(south, tuple(Axis(a * DEG, b * DEG, 4.0 * DEG, 2.0 * DEG) for a, b in ends),
                    Horizon(10.0 * DEG))
    assert ends[1] == (-270.0, 90.0) and limits.blocked_pole is None
    # as the observer writes them: -90 to 270 deg
    west, east = limits.on_travel(20.0 * DEG, -50.0 * DEG), (150.0 * DEG, 230.0 * DEG)
    check = TrackCheck(limits)
    found = check.check(np.zeros(1), np.array([east]), np.zeros((1, 2)), AxisState(west))
    assert found.cubic.angles[0, 1] == pytest.approx(-130.0 * DEG)
    assert isinstance(found, Allowed) or lead(check, found.cubic, AxisState(west))
    low = Limits(Mount.equatorial(5.0 * DEG, 'german'), limits.axes, Horizon(10.0 * DEG))
    assert np.array(low.blocked_pole) / DEG == pytest.approx((-5.0, 10.0))


def test_a_way_is_found_on_another_turn():
    skyline = [(40.0, 10.0), (41.0, 80.0), (43.0, 80.0), (44.0, 10.0)]
    check = TrackCheck(Limits(axes=(Axis(-330.0 * DEG, 330.0 * DEG, 4.0 * DEG, 2.0 * DEG),
                               Axis(-5.0 * DEG, 79.0 * DEG, 4.0 * DEG, 2.0 * DEG)),
                         horizon=Horizon(10.0 * DEG, [(a * DEG, e * DEG) for a, e in skyline])))
    track, state = star(60.0, 40.0), at(20.0, 40.0)
    found = check.check(*track, state)
    vias, cubic = lead(check, found.cubic, state)
    assert cubic.angles[0, 0] == pytest.approx(-300.0 * DEG)
    assert around(check, found.cubic, state) is None


def test_a_track_that_ends_in_motion_has_room_to_stop(check):
    fast = (np.array([0.0, 50.0]), np.array([[30.0, 40.0], [30.0, 90.0]]) * DEG,
            np.array([[0.0, 1.0], [0.0, 1.0]]) * DEG)
    assert isinstance(check.check(*fast, at(30.0, 40.0)), Allowed)
    high = fast[0], fast[1] + np.array([0.0, 4.8]) * DEG, fast[2]
    assert 'elevation of the track from' in refused(check, *high, at(30.0, 44.5))


def test_boxes_reach_to_where_a_fast_axis_stops_that_brakes_slowly():
    axes = (Axis(-4.0, 4.0, 5.0 * DEG, 4.0 * DEG), Axis(-2.0, 2.0, 5.0 * DEG, 4.0 * DEG))
    there = Cubic(np.zeros(1), np.array([[90.0, 0.0]]) * DEG, np.zeros((1, 2)))
    for timing in (0.3, 0.5, 0.9):
        for finer in (1, 6):
            boxes = Slew(at(-60.0, 30.0), there, axes, timing).boxes(finer)
            t = np.linspace(2.0, 20.0, 200)  # with full speed
            here = -60.0 + 5.0 * (t - 5.0 / 4.0 / 2.0)
            reached = boxes.high[0][(t / (2.0 * boxes.time[0])).astype(int)] / DEG
            assert np.all(reached > here + 5.0**2 / (2.0 * 4.0 * timing))


def test_an_axis_in_full_speed_goes_beyond_a_target_that_stops_before_it():
    axes = tuple(Axis(*ends, 6.8 * DEG, 3.4 * DEG) for ends in (
        (-270.0 * DEG, 270.0 * DEG), (-5.0 * DEG, 95.0 * DEG)))
    down = (np.array([0.0, 13.0]), np.array([[171.0, 27.6], [186.0, 5.3]]) * DEG,
            np.tile([15.0, -22.3], (2, 1)) / 13.0 * DEG)
    check = TrackCheck(Limits(axes=axes, horizon=Horizon(4.2 * DEG), timing=0.9))
    assert 'below the horizon' in refused(check, *down, at(111.0, 82.0))
    assert isinstance(check.check(*down, at(171.0, 30.0)), Allowed)  # it is there in time


@pytest.mark.parametrize('times, rates', [([0.0, 20.0], 1e300), ([0.0, 1e-300], 0.1),
                                          ([0.0, 20.0], 1e200)])
def test_numbers_beyond_all_reason_are_refused(check, times, rates):
    refused(check, np.array(times), np.array([[30.0, 40.0], [31.0, 41.0]]) * DEG,
            np.full((2, 2), rates), at(30.0, 40.0))


def test_axes_of_unknown_timing_may_pass_all_that_lies_between():
    limits = Limits(horizon=Horizon(10.0 * DEG), timing=0.0)
    sun, state = circles(45.0, 60.0), at(0.0, 30.0)
    assert isinstance(TrackCheck(limits).check(*star(60.0, 30.0), state, sun), Allowed)
    there = star(60.0, 70.0)
    assert 'comes within' in refused(TrackCheck(limits), *there, state, sun)
