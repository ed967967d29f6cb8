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

import numpy as np
import pytest

from encoder_sim.axis_motion import AxisDynamics, MountAxes, Trajectory, catch_up, plan_move
from msg_tools.units import ARCSEC, DEG

LIMITS = AxisDynamics(max_rate=4 * DEG, max_acceleration=2 * DEG, settling_time=1.0)
PAIR = (LIMITS, LIMITS)


def track(az, el, az_rate=15 * ARCSEC, el_rate=-10 * ARCSEC, start=0.0, n=5, step=30.0):
    t = start + step * np.arange(n)
    dt = t - start
    positions = np.stack([az + az_rate * dt, el + el_rate * dt], axis=1)
    return Trajectory(t, positions, np.tile([az_rate, el_rate], (n, 1)))


def test_long_move_is_a_trapezoid():
    move = plan_move(40 * DEG, 0.0, LIMITS)
    # 2 s up, 2 s down with 4 deg each, 8 s of cruise
    assert move.duration == pytest.approx(12.0)
    position, rate = move.at([0.0, 1.0, 2.0, 6.0, 11.0, 12.0, 20.0])
    assert position / DEG == pytest.approx([0, 1, 4, 20, 39, 40, 40])
    assert rate / DEG == pytest.approx([0, 2, 4, 4, 2, 0, 0])


def test_short_move_is_a_triangle_backwards_too():
    move = plan_move(-2 * DEG, 0.0, LIMITS)
    assert move.duration == pytest.approx(2.0)
    assert move.at(1.0)[1] == pytest.approx(-2 * DEG)


@pytest.mark.parametrize('distance', [-30, -1, -0.01, 0, 0.01, 1, 30])
@pytest.mark.parametrize('rate', [-4, -0.5, 0, 0.5, 4])
def test_any_move_keeps_the_limits_and_ends_at_rest(distance, rate):
    move = plan_move(distance * DEG, rate * DEG, LIMITS)
    t = np.linspace(0.0, move.duration + 0.1, 4001)
    position, speed = move.at(t)
    assert position[0] == 0.0 or move.duration == 0.0
    assert position[-1] == pytest.approx(distance * DEG) and speed[-1] == 0.0
    assert np.max(np.abs(speed)) <= LIMITS.max_rate * (1 + 1e-12)
    change = np.diff(speed) / np.diff(t)
    assert np.max(np.abs(change)) <= LIMITS.max_acceleration * (1 + 1e-6)
    assert np.allclose(np.diff(position), 0.5 * (speed[1:] + speed[:-1]) * np.diff(t), atol=1e-7)


def test_hermite_between_points_and_on_at_both_ends():
    t = np.array([10.0, 12.0, 15.0])
    curve = np.stack([0.01 * t**3, 0.02 * t**2], axis=1)
    slope = np.stack([0.03 * t**2, 0.04 * t], axis=1)
    trajectory = Trajectory(t, curve, slope)
    trajectory.positions[:] = curve  # the cubic is larger than a turn
    at = np.array([10.5, 11.9, 12.0, 14.2])
    position, rate = trajectory.at(at)
    assert position == pytest.approx(np.stack([0.01 * at**3, 0.02 * at**2], axis=1))
    assert rate == pytest.approx(np.stack([0.03 * at**2, 0.04 * at], axis=1))
    position, rate = trajectory.at([17.0, 9.0])
    assert position[0] == pytest.approx(curve[2] + 2.0 * slope[2])
    assert position[1] == pytest.approx(curve[0] - slope[0])
    assert rate[0] == pytest.approx(slope[2])


def test_catches_up_with_a_moving_target():
    mount = MountAxes(LIMITS, LIMITS, 0.0, [0.0, 0.5])
    trajectory = track(1.0, 0.9)
    settled = mount.follow(3.0, trajectory)
    assert settled == mount.leg.settled == pytest.approx(max(mount.leg.arrival) + 1.0)
    t = np.linspace(settled, settled + 100.0, 50)
    angles, rates = mount.state(t)
    target, target_rates = trajectory.at(t)
    assert angles == pytest.approx(target, abs=1e-12)
    assert rates == pytest.approx(target_rates, abs=1e-12)
    # before the command at rest, and no jump anywhere
    t = np.arange(0.0, settled + 5.0, 0.01)
    angles, rates = mount.state(t)
    assert np.all(angles[t < 3.0] == [0.0, 0.5])
    middle = 0.5 * (rates[1:] + rates[:-1]) * 0.01
    assert np.diff(angles, axis=0) == pytest.approx(middle, abs=1e-5)


def test_satellite_is_caught_exactly():
    mount = MountAxes(LIMITS, LIMITS, 0.0, [0.0, 0.5])
    fast = track(0.6, 0.4, 1.0 * DEG, 0.5 * DEG)
    leg = mount._plan(0.0, fast)
    for i in (0, 1):
        just = leg.state([leg.arrival[i] - 1e-7, leg.arrival[i] + 1e-7])
        assert np.diff(just[0][:, i])[0] == pytest.approx(2e-7 * just[1][0, i], abs=1e-9)
        assert np.diff(just[1][:, i])[0] == pytest.approx(0.0, abs=1e-7)


def test_new_command_in_the_middle_of_a_slew():
    mount = MountAxes(LIMITS, LIMITS, 0.0, [0.0, 0.5])
    mount.follow(0.0, track(1.5, 0.9))
    mount.follow(4.0, track(0.2, 0.3))
    t = np.arange(0.0, 30.0, 0.01)
    angles, rates = mount.state(t)
    assert np.max(np.abs(np.diff(rates, axis=0))) <= 0.01 * LIMITS.max_acceleration * 1.01
    assert angles[-1] == pytest.approx(track(0.2, 0.3).at(t[-1:])[0][0])
    assert np.all(mount.approach([3.0]) == [1, 1]) and np.all(mount.approach([20.0]) == [-1, -1])
    with pytest.raises(ValueError, match='older'):
        mount.follow(3.0, track(0.2, 0.3))


def test_azimuth_takes_the_short_way():
    mount = MountAxes(LIMITS, LIMITS, 0.0, [350 * DEG, 0.5])
    settled = mount.follow(0.0, track(10 * DEG, 0.5, 0.0, 0.0))
    assert settled < 10.0
    assert mount.state([settled])[0][0, 0] == pytest.approx(370 * DEG)
    settled = mount.follow(50.0, track(300 * DEG, 0.5, 0.0, 0.0))
    assert mount.state([settled])[0][0, 0] == pytest.approx(300 * DEG)
    # a track across north, wrapped by whoever sent it
    wrapped = Trajectory([100.0, 110.0], [[359 * DEG, 0.5], [1 * DEG, 0.5]], np.zeros((2, 2)))
    assert wrapped.positions[1, 0] == pytest.approx(361 * DEG)


def test_travel_forces_the_long_way_and_refuses():
    azimuth = AxisDynamics(LIMITS.max_rate, LIMITS.max_acceleration, 1.0,
                         travel_min=-10 * DEG, travel_max=365 * DEG)
    elevation = AxisDynamics(LIMITS.max_rate, LIMITS.max_acceleration, 1.0,
                           travel_min=0.0, travel_max=90 * DEG)
    mount = MountAxes(azimuth, elevation, 0.0, [350 * DEG, 0.5])
    settled = mount.follow(0.0, track(10 * DEG, 0.5, 0.0, 0.0))
    assert mount.state([settled])[0][0, 0] == pytest.approx(10 * DEG)
    with pytest.raises(ValueError, match='elevation .* travel of 0 to 90'):
        mount.follow(100.0, track(0.0, 95 * DEG, 0.0, 0.0))
    # and it goes on with what it did
    assert mount.state([200.0])[0][0, 0] == pytest.approx(10 * DEG)


def test_too_fast_a_target_is_refused():
    with pytest.raises(ValueError, match='faster than the axis'):
        catch_up(0.0, [0.0, 0.5], [0.0, 0.0], track(0.1, 0.5, 5 * DEG, 0.0), PAIR)


def test_ringing_dies_within_the_settling_time():
    ringing = AxisDynamics(4 * DEG, 2 * DEG, 1.0, settling_amplitude=5 * ARCSEC)
    mount = MountAxes(ringing, ringing, 0.0, [0.0, 0.5])
    settled = mount.follow(0.0, track(1.0, 0.5 + 0.2 * DEG, 0.0, 0.0))
    t = np.linspace(0.0, settled + 1.0, 20001)
    angles, rates = mount.state(t)
    over = (angles - [1.0, 0.5 + 0.2 * DEG]) / ARCSEC
    assert 1.0 < over[:, 0].max() < 5.0
    assert over[:, 1].max() < 0.5  # a short slew excites little
    assert np.abs(over[t >= settled]).max() < 0.005
    middle = 0.5 * (rates[1:] + rates[:-1]) * np.diff(t)[:, np.newaxis]
    assert np.diff(angles, axis=0) == pytest.approx(middle, abs=1e-8)


def test_arrival_does_not_move_anything():
    mount = MountAxes(LIMITS, LIMITS, 0.0, [0.0, 0.5])
    when = mount.arrival(0.0, track(1.0, 0.9))
    assert np.all(mount.state([50.0])[0] == [0.0, 0.5])
    assert mount.follow(0.0, track(1.0, 0.9)) == when


def test_the_first_axis_of_a_german_mount_never_takes_its_counterweight_up():
    words = ('hour angle', 'declination')
    limits = [AxisDynamics(LIMITS.max_rate, LIMITS.max_acceleration, 0.0, travel_min=low * DEG,
                         travel_max=high * DEG) for low, high in ((-10, 190), (-90, 270))]
    mount = MountAxes(*limits, 0.0, [5 * DEG, 0.5], words)
    at = 0.0
    # from west of the meridian to the east, through the pole: the long way down, not by the top
    for asked, stands in ((185, 185), (-175, 185), (355, -5), (-8, -8), (188 - 360, 188)):
        settled = mount.follow(at, Trajectory([at], [[asked * DEG, 200 * DEG]], [[0.0, 0.0]]))
        t = np.linspace(at, settled, 50)
        first = mount.state(t)[0][:, 0] / DEG
        assert first[-1] == pytest.approx(stands) and first.min() > -9 and first.max() < 189
        at = settled
    for place, text in (((250, 30), 'hour angle from 250.000 to 250.000 deg does not fit into the '
                         'travel of -10 to 190 deg'),
                        ((90, -100), 'declination from -100.000 to -100.000 deg leaves the travel '
                         'of -90 to 270 deg')):
        with pytest.raises(ValueError, match=text):
            mount.follow(at, Trajectory([at], [np.array(place) * DEG], [[0.0, 0.0]]))
    # and a track that goes past the limit
    with pytest.raises(ValueError, match='hour angle from 189.000 to 191.000'):
        mount.follow(at, Trajectory([at, at + 500.0], np.array([[189, 200], [191, 200]]) * DEG,
                                    np.zeros((2, 2))))


def test_a_target_that_slews_and_comes_to_rest_is_met_however_late_it_is_heard_of():
    """As the pieces of a slew, that a mount hears of seconds late where its time is fast."""
    limits = AxisDynamics(max_rate=6.0 * DEG, max_acceleration=3.0 * DEG, settling_time=1.0)
    rng, hard = np.random.default_rng(11), 0
    for _ in range(300):
        begin, rate, time = rng.uniform(-60.0, 60.0), rng.uniform(-4.8, 4.8), rng.uniform(1.0, 15.0)
        brakes = abs(rate) / 2.4
        end = begin + rate * (time + 0.5 * brakes)
        track = Trajectory([0.0, time, time + brakes], np.array(
            [[begin, 0.0], [begin + rate * time, 0.0], [end, 0.0]]) * DEG, np.array(
            [[rate, 0.0], [rate, 0.0], [0.0, 0.0]]) * DEG)
        leg = catch_up(rng.uniform(0.0, 5.0), (rng.uniform(-90.0, 90.0) * DEG, 0.0),
                       (rng.uniform(-4.0, 4.0) * DEG, 0.0), track, (limits, limits))
        met = leg.arrival[0]
        hard += met > time
        here, want = leg.state(met - 1e-6)[0], track.at(np.array([met]))[0]
        assert abs(here[0, 0] - want[0, 0]) < 1e-3 * DEG
    assert hard > 50
