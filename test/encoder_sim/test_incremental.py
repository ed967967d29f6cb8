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

from encoder_sim.incremental import MARK_TOLERANCE, CountLoss, Incremental, IncrementalEncoder
from encoder_sim.scenario_file import load_scenario
from msg_tools.units import ARCSEC, DEG

COUNT = 1296000.0 / 18_880_000  # arcsec
MARK = 180 * DEG
START = 1_768_482_000.0


def stamps(n, step=0.01, start=START):
    return np.rint((start + step * np.arange(n)) * 1e9).astype(np.int64)


def crossing(n=101, low=179.0, high=181.0):
    """Samples that pass the mark at 180 degrees: 2 deg/s."""
    return stamps(n), np.linspace(low, high, n) * DEG


def encoder(**params):
    power_on = params.pop('power_on', 1)
    return IncrementalEncoder(Incremental(**params), 1, 'azimuth', power_on, start=START)


def test_a_count_is_paper_000s():
    assert encoder().count_angle / ARCSEC == pytest.approx(0.0686, abs=5e-5)


def test_unknown_until_the_mark_then_whole_counts():
    device = encoder()
    when, angle = crossing()
    reading = device.feed(when, angle)
    before = angle < MARK - 1e-9
    assert np.isnan(reading[before]).all() and np.isfinite(reading[~before]).all()
    assert device.homed
    error = (reading - angle)[~before] / ARCSEC
    assert np.abs(error).max() <= COUNT * 1.01
    counts = (reading[~before] - MARK) / device.count_angle
    assert counts == pytest.approx(np.rint(counts), abs=1e-4)


def test_without_the_mark_no_reading():
    device = encoder()
    assert np.isnan(device.feed(stamps(100), np.linspace(10, 170, 100) * DEG)).all()
    assert not device.homed
    assert device.feed([], []).shape == (0,)


def test_batches_do_not_matter():
    when, angle = crossing(173)
    params = load_scenario('default').incremental.azimuth
    whole = IncrementalEncoder(params, 5, 'azimuth').feed(when, angle)
    device = IncrementalEncoder(params, 5, 'azimuth')
    cuts = [3, 90, 91]
    pieces = [device.feed(w, a) for w, a in zip(np.split(when, cuts), np.split(angle, cuts))]
    assert np.array_equal(np.concatenate(pieces), whole, equal_nan=True)
    device = IncrementalEncoder(params, 5, 'azimuth')
    single = [device.feed(w, a)[0] for w, a in zip(when, angle)]
    assert np.array_equal(single, whole, equal_nan=True)


def test_zero_drift_shifts_the_reading_until_the_next_power_on():
    device = encoder(zero_drifts=(0.0, 20 * ARCSEC, -7 * ARCSEC))
    when, angle = crossing()
    for drift in (0.0, 20.0, -7.0):
        error = (device.feed(when, angle) - angle)[-40:] / ARCSEC
        assert error.mean() == pytest.approx(drift, abs=COUNT)
        assert np.ptp(error) < 1.1 * COUNT
        # a second passage changes nothing
        again = device.feed(when + 10**10, angle) - angle
        assert np.nanmean(again) / ARCSEC == pytest.approx(drift, abs=COUNT)
        device.power_cycle()
        assert not device.homed
        assert np.isnan(device.feed(when[0] - 1, 3.0)).all()
    assert device.power_on == 4


def test_drawn_drift_differs_per_power_on_and_repeats_per_seed():
    params = load_scenario('default').incremental.azimuth
    first = [IncrementalEncoder(params, 1, 'azimuth', k).zero_drift for k in range(1, 9)]
    again = [IncrementalEncoder(params, 1, 'azimuth', k).zero_drift for k in range(1, 9)]
    assert first == again and len(set(first)) == 8
    when, angle = crossing()
    for k in (1, 5):
        device = IncrementalEncoder(params, 1, 'azimuth', k)
        error = np.nanmean(device.feed(when, angle) - angle)
        assert error == pytest.approx(device.zero_drift, abs=0.3 * ARCSEC)


def test_mark_missed_when_passed_too_fast():
    # 3.6" in 1 ms: 1 deg/s
    when, angle = crossing()  # 2 deg/s
    fast = encoder(pulse_width=3.6 * ARCSEC, pulse_time=1e-3)
    assert np.isnan(fast.feed(when, angle)).all()
    assert np.isfinite(fast.feed(when[-1] + 10**9 + 3 * (when - when[0]), angle[::-1])[-1])
    assert np.isfinite(encoder(pulse_width=3.6 * ARCSEC).feed(when, angle)[-1])


def test_from_above_the_pulse_begins_at_its_other_edge():
    when, angle = crossing()
    up, down = (encoder(pulse_width=5 * ARCSEC) for _ in range(2))
    error_up = (up.feed(when, angle) - angle)[-1] / ARCSEC
    error_down = (down.feed(when, angle[::-1]) - angle[::-1])[-1] / ARCSEC
    assert error_up == pytest.approx(0.0, abs=COUNT)
    # the counter was cleared 5" too high
    assert error_down == pytest.approx(-5.0, abs=COUNT)


def test_started_within_the_pulse_no_edge_is_met():
    device = encoder(pulse_width=1 * DEG)
    assert np.isnan(device.feed(stamps(50), np.linspace(180.5, 200, 50) * DEG)).all()
    assert np.isnan(encoder(pulse_width=1 * DEG).feed(
        stamps(50), np.linspace(180.5, 170, 50) * DEG)).all()


def test_mark_comes_back_every_turn():
    for low, high in ((500.0, 560.0), (-200.0, -160.0), (-160.0, -200.0), (560.0, 500.0)):
        device = encoder()
        angle = np.linspace(low, high, 100) * DEG
        reading = device.feed(stamps(100), angle)
        error = (reading - angle)[-1] % (2 * np.pi)
        assert min(error, 2 * np.pi - error) < COUNT * ARCSEC


def test_eccentricity():
    device = encoder(eccentricity=1e-6, mark_angle=0.0)
    angle = np.linspace(-0.01, 6.0, 2000)
    error = (device.feed(stamps(2000), angle) - angle)[10:] / ARCSEC
    assert error == pytest.approx(-1.3751 * np.sin(angle[10:]), abs=COUNT)


def test_subdivision_repeats_with_each_line():
    amplitude = 2 * ARCSEC
    device = encoder(subdivision_1=amplitude)
    line = 2 * np.pi / 47200
    device.feed(*crossing())
    angle = 3.3 + np.linspace(0, 5 * line, 5001)
    error = device.feed(stamps(5001, start=1.8e9), angle) - angle
    columns = np.stack([np.cos(47200 * angle), np.sin(47200 * angle), np.ones(5001)], axis=1)
    cosine, sine, _ = np.linalg.lstsq(columns, error, rcond=None)[0] / amplitude
    assert (cosine, sine) == pytest.approx((1.0, 0.0), abs=0.01)


def test_counts_are_lost_at_speed_and_stay_lost():
    device = encoder(max_count_rate=18.88e6 / 360)  # a degree a second
    when, angle = crossing()  # twice that
    error = (device.feed(when, angle) - angle) / DEG
    passed = angle[-1] / DEG - 180.0
    assert error[-1] == pytest.approx(-0.5 * passed, abs=0.03)
    later = device.feed(when[-1] + 10**9, angle[-1])[0] - angle[-1]
    assert later / DEG == pytest.approx(error[-1], abs=1e-4)
    # lost the other way on the way back
    back = device.feed(when[-1] + 2 * 10**9 + when - when[0], angle[::-1]) - angle[::-1]
    assert back[-1] / DEG == pytest.approx(error[-1] + 1.0, abs=0.03)


def test_latency_time_and_temperature():
    device = encoder(latency=0.02, zero_rate=0.001, zero_slope=0.01, zero_offset=0.5)
    when, angle = crossing()
    device.feed(when, angle, 2 * DEG)
    reading = device.feed(when[0] + 20 * 10**9, 3.2, 2 * DEG, temperature=13.0)[0]
    assert reading == pytest.approx(3.2 - 0.04 * DEG + 0.02 + 0.03 + 0.5, abs=COUNT * ARCSEC)


def test_jitter_belongs_to_the_stamp():
    device, other = encoder(jitter=3.0), encoder(jitter=3.0)
    for d in (device, other):
        d.feed(*crossing())
    when = stamps(3000, start=1.8e9)
    noisy = device.feed(when, np.full(3000, 3.3)) / ARCSEC
    assert noisy.std() / COUNT == pytest.approx(np.hypot(3.0, 12**-0.5), rel=0.05)
    assert other.feed(when[7], 3.3)[0] / ARCSEC == noisy[7]


# --- the mark -----------------------------------------------------------------------------------


def passage(device, after=0.0, back=False, **feed):
    """Pass the mark at 2 deg/s, `after` seconds from the first crossing: the error, arcsec."""
    when, angle = crossing()
    angle = angle[::-1] if back else angle
    return (device.feed(when + round(after * 1e9), angle, **feed) - angle)[-1] / ARCSEC


def test_nothing_is_known_of_the_side_before_the_mark():
    device = encoder()
    unknown = pytest.approx(np.nan, nan_ok=True)
    assert device.homing == (False, '', 0, 0, unknown, device.count_angle,
                             device.params.pulse_width, 1, unknown, unknown, unknown)
    assert device.supply == 5.0 and not device.miscounted
    assert np.isnan(device.zero)
    passage(device)
    assert device.homing.homed and device.homing.side == 'below'
    device.power_cycle()
    passage(device, 10.0, back=True)
    assert device.homing.side == 'above' and device.homing.power_on == 2


def test_a_higher_threshold_makes_the_pulse_narrower_from_both_sides():
    # a triangle of 4" at half its peak is 2" wide at three quarters, 1" in on either side
    params = {'pulse_width': 4 * ARCSEC, 'threshold': 0.75}
    up, down = encoder(**params), encoder(**params)
    assert passage(up) == pytest.approx(-1.0, abs=COUNT)
    assert passage(down, back=True) == pytest.approx(-3.0, abs=COUNT)
    assert (up.zero / ARCSEC, down.zero / ARCSEC) == pytest.approx((-1.0, -3.0))


def test_a_mark_below_the_threshold_gives_no_pulse():
    params = {'pulse_width': 4 * ARCSEC, 'threshold': 0.8, 'signal_slope': -0.01}
    assert np.isfinite(passage(encoder(**params), temperature=20.0))
    device = encoder(**params)
    assert np.isnan(passage(device, temperature=35.0))  # a quarter of the signal is gone
    assert device.homing.missed_marks == 0
    weak = encoder(pulse_width=4 * ARCSEC, threshold=0.8, signal_supply=0.5, supply=4.5)
    assert np.isnan(passage(weak))
    assert np.isfinite(passage(encoder(pulse_width=4 * ARCSEC, threshold=0.8, signal_supply=0.5)))


def test_a_narrow_pulse_is_missed_at_a_rate_at_which_a_wide_one_is_not():
    # at 2 deg/s 4" last 0.56 ms
    wide = encoder(pulse_width=4 * ARCSEC, pulse_time=0.4e-3)
    narrow = encoder(pulse_width=4 * ARCSEC, pulse_time=0.4e-3, threshold=0.75)
    assert np.isfinite(passage(wide)) and np.isnan(passage(narrow))
    assert (wide.homing.missed_marks, narrow.homing.missed_marks) == (0, 1)


def test_the_mark_moves_with_temperature_and_supply_until_it_is_met():
    params = {'mark_slope': 0.5 * ARCSEC, 'mark_supply': 10 * ARCSEC, 'supply': 5.3}
    device = encoder(**params)
    error = passage(device, temperature=16.0)
    assert error == pytest.approx(6 * 0.5 + 0.3 * 10, abs=COUNT)
    assert device.zero / ARCSEC == pytest.approx(6.0)
    # what counts is when it was met
    assert passage(device, 10.0, temperature=30.0) == pytest.approx(error, abs=COUNT)


def test_the_reading_moves_with_the_supply_at_any_time():
    params = {'zero_supply': 10 * ARCSEC, 'supply': 5.2, 'supply_rate': 1.0 / 3600.0}
    device = encoder(**params)
    assert passage(device) == pytest.approx(2.0, abs=2 * COUNT)
    assert passage(device, 1800.0) == pytest.approx(7.0, abs=2 * COUNT)
    assert device.supply == pytest.approx(5.7, abs=1e-3)
    ripple = encoder(zero_supply=10 * ARCSEC, supply_ripple=0.2, ripple_frequency=0.1)
    passage(ripple)
    when = stamps(100, 0.1, start=1_768_482_010.0)
    error = (ripple.feed(when, np.full(100, 3.3)) - 3.3) / ARCSEC
    assert error == pytest.approx(2.0 * np.sin(2 * np.pi * 0.01 * np.arange(100)), abs=2 * COUNT)


def test_only_from_the_side_that_the_interface_takes():
    device = encoder(mark_from='below', pulse_width=5 * ARCSEC)
    assert np.isnan(passage(device, back=True))
    assert passage(device, 10.0) == pytest.approx(0.0, abs=COUNT)
    assert device.homing.side == 'below'
    device = encoder(mark_from='above', pulse_width=5 * ARCSEC)
    assert np.isnan(passage(device))
    assert passage(device, 10.0, back=True) == pytest.approx(-5.0, abs=COUNT)


def test_a_later_passage_checks_the_counter_from_both_sides():
    params = {'pulse_width': 5 * ARCSEC, 'losses': (CountLoss(15.0, 100),)}
    for first in (False, True):
        device = encoder(**params)
        passage(device, back=first)
        assert device.homing.passages == 0 and not device.miscounted
        passage(device, 5.0, back=not first)
        assert device.homing.passages == 1
        assert abs(device.homing.mark_error) <= 1.0  # its width is no error
        error = passage(device, 20.0, back=first)
        assert device.homing.mark_error == pytest.approx(-100, abs=1)
        assert device.miscounted and MARK_TOLERANCE < 100
        shift = -100 * COUNT - (5.0 if first else 0.0)
        assert error == pytest.approx(shift, abs=COUNT)


def test_the_check_knows_whole_turns():
    device = encoder()
    device.feed(stamps(721), np.linspace(170.0, 890.0, 721) * DEG)
    assert device.homing.passages == 1 and device.homing.mark_error == 0.0


def test_the_check_sees_a_mark_that_moved():
    device = encoder(mark_slope=1.0 * ARCSEC)
    passage(device, temperature=10.0)
    passage(device, 10.0, temperature=16.0)
    # the mark is met 6" earlier on the grating
    assert device.homing.mark_error == pytest.approx(-6.0 / COUNT, abs=1)


# --- faults -------------------------------------------------------------------------------------


def test_counts_are_lost_at_a_moment():
    device = encoder(losses=(CountLoss(10.0, 120), CountLoss(20.0, -30)))
    assert passage(device) == pytest.approx(0.0, abs=COUNT)
    errors = [(device.feed(stamps(1, start=1_768_482_000.0 + t), 3.3)[0] - 3.3) / ARCSEC / COUNT
              for t in (9.0, 10.0, 19.9, 20.5, 30.0)]
    assert errors == pytest.approx([0, -120, -120, -90, -90], abs=1)


def test_what_was_lost_before_homing_is_cleared_with_the_counter():
    device = encoder(losses=(CountLoss(0.2, 500),))
    assert passage(device) == pytest.approx(0.0, abs=COUNT)


def rates_at(device, rate, n=200, moments=None):
    """What is told of a motion at `rate` that begins behind the mark, 13 ms apart."""
    device.feed(*crossing())
    when = stamps(n, 0.013, START + 10.0)
    angle = 181 * DEG + rate * (when * 1e-9 - START - 10.0)
    out = []
    for one in zip(when, angle):
        device.feed(*one, rate)
        out.append(device.rate(*one, rate)[0])
    return np.array(out)


def test_a_rate_is_whole_counts_in_the_gate_time():
    device = encoder(rate_gate=0.1)
    told = rates_at(device, 15 * ARCSEC)
    counts = told * 0.1 / device.count_angle
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
    assert len(np.unique(np.rint(counts))) == 2  # 21.87 counts: 21 or 22
    assert told.mean() / ARCSEC == pytest.approx(15.0, abs=0.1)
    # two readings, each with its jitter
    jitter = rates_at(encoder(rate_gate=0.1, jitter=3.0), 15 * ARCSEC)
    assert jitter.std() / ARCSEC == pytest.approx(np.sqrt(2) * 3 * COUNT / 0.1, rel=0.2)
    longer = rates_at(encoder(rate_gate=0.4, jitter=3.0), 15 * ARCSEC)
    assert longer.std() / ARCSEC == pytest.approx(np.sqrt(2) * 3 * COUNT / 0.4, rel=0.2)


def test_rates_of_many_samples_are_those_of_each():
    one, many = (encoder(rate_gate=0.1, jitter=3.0, latency=0.01) for _ in range(2))
    single = rates_at(one, 15 * ARCSEC)
    rates_at(many, 15 * ARCSEC)
    when = stamps(200, 0.013, START + 10.0)
    angle = 181 * DEG + 15 * ARCSEC * (when * 1e-9 - START - 10.0)
    assert np.array_equal(many.rate(when, angle, np.full(200, 15 * ARCSEC)), single)


def test_nothing_but_counting_happens_far_from_mark_and_power_cut():
    device = encoder(power_cycles=(50.0,))
    later = stamps(3, 1.0, START + 20.0)
    assert not device.only_counts(later, np.array([250.0, 251.0, 252.0]) * DEG)  # not homed
    device.feed(*crossing())
    assert not device.only_counts(later, np.array([184.0, 183.0, 176.0]) * DEG)
    # on the way from the last sample, at 181 deg
    assert not device.only_counts(later, np.array([170.0, 169.0, 168.0]) * DEG)
    device.feed(later[:1], 240 * DEG)
    assert device.only_counts(later[1:], np.array([250.0, 251.0]) * DEG)
    assert not device.only_counts(stamps(3, 1.0, START + 48.5),
                                  np.array([250.0, 251.0, 252.0]) * DEG)


def test_a_rate_is_known_a_gate_time_after_the_mark_only():
    device = encoder(rate_gate=0.1)
    when, angle = crossing()
    rates = []
    for one in zip(when, angle):
        device.feed(*one, 2 * DEG)
        rates.append(device.rate(*one, 2 * DEG)[0])
    first = np.flatnonzero(angle >= MARK - 1e-9)[0]
    known = np.isfinite(rates)
    assert not known[:first + 10].any() and known[first + 10:].all()
    device.power_cycle()
    assert np.isnan(device.rate(when[-1], angle[-1], 2 * DEG))


def test_a_rate_feels_the_disc_and_the_late_reading_but_not_the_zero():
    far = rates_at(encoder(eccentricity=5e-5, zero_offset=1.0, latency=0.3, max_count_rate=1e9),
                   1 * DEG)
    # 0.05 mm on a radius of 150 mm: 1/3000 of the rate, once a turn
    count = COUNT / 0.1 / 3600
    assert np.abs(far / DEG - 1.0).max() == pytest.approx(1 / 3000, abs=count)


def test_the_power_fails_at_a_moment_whatever_the_batches():
    params = {'power_cycles': (10.0, 40.0), 'zero_drifts': (0.0, 7 * ARCSEC, -9 * ARCSEC)}
    when = stamps(600, 0.1)
    angle = (180.0 + 8.0 * np.sin(0.03 * np.arange(600) - 1.0)) * DEG
    device = encoder(**params)
    whole = device.feed(when, angle)
    assert device.homing.power_on == 3
    error = (whole - angle) / ARCSEC
    assert np.isnan(error[[100, 101, 400]]).all()
    assert [np.nanmean(part) for part in (error[:100], error[101:400], error[401:])] == (
        pytest.approx([0.0, 7.0, -9.0], abs=COUNT))
    device = encoder(**params)
    pieces = [device.feed(w, a) for w, a in zip(np.array_split(when, 7), np.array_split(angle, 7))]
    assert np.array_equal(np.concatenate(pieces), whole, equal_nan=True)
    device = encoder(**params)
    single = [device.feed(w, a)[0] for w, a in zip(when, angle)]
    assert np.array_equal(single, whole, equal_nan=True)


def test_noise_miscounts_with_the_way_gone():
    wrong = []
    for seed in range(40):
        device = IncrementalEncoder(Incremental(miscounts=50.0), seed, 'azimuth')
        passage(device)
        angle = 180.0 * DEG + np.linspace(0.0, 100.0, 51) * DEG
        last = device.feed(stamps(51, start=1_768_482_100.0), angle)[-1]
        wrong.append((last - angle[-1]) / ARCSEC / COUNT)
    # 5.2 million counts, 50 of a million wrong: a random walk of 16
    assert np.std(wrong) == pytest.approx(np.sqrt(50e-6 * 1e2 / 360 * 18_880_000), rel=0.3)


def test_lost_counts_belong_to_the_direction():
    params = {'max_count_rate': 18.88e6 / 360, 'miscounts': 3.0}
    when, angle = crossing(173)
    whole = encoder(**params).feed(when, angle)
    device = encoder(**params)
    pieces = [device.feed(w, a) for w, a in zip(np.split(when, [99]), np.split(angle, [99]))]
    assert np.array_equal(np.concatenate(pieces), whole, equal_nan=True)


def test_a_sample_that_is_not_a_number_loses_nothing():
    device = encoder(max_count_rate=1e6)
    passage(device)
    later = stamps(3, start=1_768_482_010.0)
    reading = device.feed(later, [3.3, np.nan, 3.3])
    assert np.isnan(reading[1]) and reading[2] == pytest.approx(3.3, abs=COUNT * ARCSEC)


def test_supply_and_temperature_are_measured_where_the_mark_was_met():
    params = {'supply_scatter': 0.2, 'thermometer_noise': 0.1, 'voltmeter_noise': 0.005,
              'mark_supply': 50.0 * ARCSEC}
    device = encoder(**params)
    volts, zeros = [], []
    for night in range(12):
        passage(device, 100.0 * night, temperature=5.0)
        volts.append(device.homing.supply)
        zeros.append(device.zero)
        assert abs(device.homing.temperature - 5.0) < 0.5
        assert device.homing.temperature != 5.0
        device.power_cycle()
        assert np.isnan(device.homing.supply)
    assert 0.08 < np.std(volts) < 0.4
    # the mark follows what was measured, but for the voltmeter's noise and the counts
    left = np.array(zeros) / ARCSEC - 50.0 * (np.array(volts) - 5.0)
    assert 0.1 < np.std(left) < 0.6
