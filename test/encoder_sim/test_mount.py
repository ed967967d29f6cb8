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

import dataclasses

import numpy as np
import pytest

from encoder_sim.incremental import IncrementalEncoder
from encoder_sim.mount import HOME_ATTEMPTS, SERVO_TIME, SimulatedMount
from encoder_sim.scenario_file import load_scenario
from msg_tools.units import ARCSEC, DEG

MARKS = np.array([180.0, 45.0]) * DEG
STILL = [[0.0, 0.0]]


def mount():
    return SimulatedMount(load_scenario('ideal'))


def held(device, az, el, start=0.0):
    """Drive to a fixed place (deg), settled: the time."""
    return device.follow(start, [start], [[az * DEG, el * DEG]], STILL)


def test_it_stands_below_its_marks_until_commanded():
    device = mount()
    angles, rates = device.truth(np.array([0.0, 100.0]))
    np.testing.assert_allclose(angles, [MARKS - 2 * DEG] * 2, atol=1e-12)
    assert not rates.any()


def test_it_follows_a_command():
    device = mount()
    settled = held(device, 200.0, 60.0)
    angles, rates = device.truth(np.array([settled, settled + 50.0]))
    np.testing.assert_allclose(angles, [[200 * DEG, 60 * DEG]] * 2, atol=1e-9)
    np.testing.assert_allclose(rates, 0.0, atol=1e-12)
    np.testing.assert_array_equal(device.approach(np.array([settled])), [[1.0, 1.0]])


def test_a_slew_that_takes_microseconds_longer_ends_at_the_same_cycle():
    def ends(shift):
        device, at, out = mount(), 0.0, []
        for az, el in np.random.default_rng(2).uniform([10, 15], [350, 85], (30, 2)):
            shift = -shift  # of every other place, deg: a slew is longer, the next shorter
            at = held(device, az + shift, el + shift, at)
            out.append(round(at * 1e9))
        return out

    assert ends(1e-5) == ends(-1e-5) == ends(0.0)  # some 5 us of a slew
    assert all(end % 100_000_000 == 0 for end in ends(0.0))
    assert ends(0.2) != ends(0.0)


def test_a_track_is_followed_at_its_rate():
    device = mount()
    rate = np.array([0.004, -0.003]) * DEG
    times = np.array([0.0, 100.0, 200.0])
    places = MARKS + times[:, None] * rate
    settled = device.follow(0.0, times, places, [rate] * 3)
    angles, rates = device.truth(np.array([settled + 20.0]))
    np.testing.assert_allclose(angles[0], MARKS + (settled + 20.0) * rate, atol=1e-9)
    np.testing.assert_allclose(rates[0], rate, atol=1e-9)


def test_out_of_travel_is_refused_and_the_last_command_stays():
    device = mount()
    settled = held(device, 200.0, 60.0)
    with pytest.raises(ValueError, match='leaves the travel'):
        held(device, 200.0, 120.0, settled)
    np.testing.assert_allclose(
        device.truth(np.array([settled + 9.0]))[0], [[200 * DEG, 60 * DEG]], atol=1e-9)


def test_the_servo_turns_the_axes_back_by_what_the_encoder_reads_too_much():
    device = mount()
    settled = held(device, 200.0, 60.0)
    drift = np.array([30.0, -12.0]) * ARCSEC
    for _ in range(2):  # the second reading is of the axes turned back: nothing is left
        truth = device.truth(np.array([settled]))[0][0]
        device.feedback(round(settled * 1e9), truth + drift, smooth=False)
        np.testing.assert_allclose(device.servo, drift, atol=1e-12)
    truth = device.truth(np.array([settled]))[0][0]
    np.testing.assert_allclose(truth, np.array([200, 60]) * DEG - drift, atol=1e-10)


def test_a_whole_turn_is_no_error():
    device = mount()
    settled = held(device, 200.0, 60.0)
    truth = device.truth(np.array([settled]))[0][0]
    device.feedback(round(settled * 1e9), truth + [2 * np.pi, 0.0], smooth=False)
    np.testing.assert_allclose(device.servo, 0.0, atol=1e-12)


def test_an_encoder_that_is_not_homed_leaves_the_servo():
    device = mount()
    device.feedback(10**9, [np.nan, 0.7], smooth=False)
    assert not device.servo.any()


def test_a_smooth_servo_takes_an_error_up_with_its_time_constant():
    device = mount()
    settled = held(device, 200.0, 60.0)
    drift = np.array([30.0, -12.0]) * ARCSEC

    def read(time):
        truth = device.truth(np.array([time]))[0][0]
        device.feedback(round(time * 1e9), truth + drift, smooth=True)
    read(settled)
    assert not device.servo.any()  # no time has passed
    read(settled + SERVO_TIME)
    np.testing.assert_allclose(device.servo, drift * (1 - np.exp(-1.0)), atol=1e-12)
    read(settled + 50.0)
    np.testing.assert_allclose(device.servo, drift, atol=1e-12)


@pytest.mark.parametrize('place', [(10.0, 20.0), (350.0, 80.0), (181.0, 46.0)])
def test_homing_crosses_both_marks_slowly_from_below(place):
    device = mount()
    settled = held(device, *place)
    truth = device.truth(np.array([settled]))[0][0]
    device.feedback(round(settled * 1e9), truth + 1.0 * DEG, smooth=False)
    first, last = device.home(settled)
    assert not device.servo.any()  # the reading of before means nothing
    times = np.linspace(first, last, 50)
    angles, rates = device.truth(times)
    assert (angles[0] < MARKS).all() and (angles[-1] > MARKS).all()
    assert (np.diff(angles, axis=0) > 0).all()
    np.testing.assert_allclose(rates, 0.25 * DEG, rtol=1e-6)
    after, still = device.truth(np.array([last + 2.0, last + 100.0]))
    np.testing.assert_allclose(after[0], after[1], atol=1e-12)
    assert not still.any() and (after > MARKS).all()


def homed(name, attempts=HOME_ATTEMPTS):
    """Home by a scenario, slower after a failure: encoders, reason, attempts made."""
    scenario = load_scenario(name)
    device = SimulatedMount(scenario)
    encoders = [IncrementalEncoder(getattr(scenario.incremental, axis), 1, axis)
                for axis in ('azimuth', 'elevation')]
    start = 0.0
    for attempt in range(attempts):
        first, last = device.home(start, attempt)
        times = np.append(np.linspace(first, last, 5), last + 2.0)
        stamps = np.rint(times * 1e9).astype(np.int64)
        reading = [encoder.feed(stamps, angle)[-1]
                   for encoder, angle in zip(encoders, device.truth(times)[0].T)]
        reason = device.home_failure(reading, attempt)
        if not reason:
            break
        start = last + 2.0
    return encoders, reason, attempt + 1


def test_homing_finds_the_marks_of_the_default_encoders():
    encoders, reason, attempts = homed('default')
    assert (reason, attempts) == ('', 1)
    assert [encoder.homing.side for encoder in encoders] == ['below', 'below']


def test_homing_from_above():
    encoders, reason, _ = homed('wrong_side')
    assert reason == ''
    assert [encoder.homing.side for encoder in encoders] == ['above', 'below']
    assert (encoders[0].zero - encoders[0].zero_drift) / ARCSEC == pytest.approx(-3.0)
    assert encoders[1].zero == pytest.approx(encoders[1].zero_drift)


def test_a_mark_missed_at_speed_is_found_more_slowly():
    encoders, reason, _ = homed('home_too_fast', attempts=1)
    assert reason == ('no reference mark met in a passage: azimuth (at 2 deg/s); check head and '
                      'mark')
    assert not encoders[0].homed and encoders[1].homed
    encoders, reason, attempts = homed('home_too_fast')
    assert (reason, attempts) == ('', 2) and encoders[0].homing.missed_marks > 0


def test_a_mark_without_a_pulse_is_never_found():
    encoders, reason, attempts = homed('mark_missed')
    assert attempts == HOME_ATTEMPTS and not encoders[0].homed
    assert reason.startswith('no reference mark met in 3 passages, each slower: azimuth (at 0.0156')


def test_homing_faster_than_the_axis_is_refused():
    scenario = load_scenario('default')
    axis = dataclasses.replace(scenario.incremental.elevation, home_rate=5.0 * DEG)
    pair = dataclasses.replace(scenario.incremental, elevation=axis)
    with pytest.raises(ValueError, match='faster than the axis'):
        SimulatedMount(dataclasses.replace(scenario, incremental=pair)).home(0.0)
