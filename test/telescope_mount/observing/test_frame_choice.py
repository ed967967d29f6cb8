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

from msg_tools.units import ARCSEC, DEG
from pointing_model.encoder_difference import interpolate
from pointing_model.mounts import centred
from telescope_mount.observing.axis_demand import Track
from telescope_mount.observing.frame_choice import Exposures, Readings

NS = 1_768_482_000_000_000_000
SECOND = 10**9


def test_between_two_readings():
    stamps = [NS, NS + 2 * SECOND, NS + 4 * SECOND]
    angles = [[0.0, 1.0], [0.2, 0.8], [0.8, 0.4]]
    value, rate = interpolate(stamps, angles, NS + 3 * SECOND // 2)
    np.testing.assert_allclose(value, [0.15, 0.85], rtol=0, atol=1e-15)
    np.testing.assert_allclose(rate, [0.1, -0.1], rtol=0, atol=1e-15)
    for i, stamp in enumerate(stamps):
        np.testing.assert_allclose(
            interpolate(stamps, angles, stamp)[0], angles[i], rtol=0, atol=1e-15)


def test_a_nanosecond_counts():
    value = interpolate([NS, NS + 1000], [[0.0, 0.0], [1.0, 1.0]], NS + 1)[0]
    np.testing.assert_allclose(value, 0.001, rtol=1e-12)


def test_across_north_is_no_turn():
    value, rate = interpolate([NS, NS + SECOND], [[359 * DEG, 0.5], [1 * DEG, 0.5]],
                              NS + SECOND // 2)
    np.testing.assert_allclose(np.cos(value[0]), 1.0)
    assert rate[0] == pytest.approx(2 * DEG)


@pytest.mark.parametrize('stamp', [NS - 1, NS + SECOND + 1])
def test_outside_the_readings_is_refused(stamp):
    with pytest.raises(ValueError, match='both sides'):
        interpolate([NS, NS + SECOND], np.zeros((2, 2)), stamp)


def test_a_slip_beside_the_exposure_is_no_rate_of_the_axis():
    stamps = NS + np.arange(41) * SECOND // 10
    angles = np.stack([15.0 * ARCSEC * np.arange(41) / 10, np.zeros(41)], axis=1)
    angles[21:, 0] += 3.0 * ARCSEC  # it sticks, and jumps
    value, rate = interpolate(stamps, angles, NS + 205 * SECOND // 100, SECOND)
    assert value[0] / ARCSEC == pytest.approx(15.0 * 2.05 + 1.5)
    assert rate[0] / ARCSEC == pytest.approx(15.0 + 3.0, rel=0.05)
    for before in (0, SECOND):
        _, rate = interpolate(stamps, angles, NS + SECOND, before)
        assert rate[0] / ARCSEC == pytest.approx(15.0)


def test_too_few_or_unknown_readings_are_refused():
    with pytest.raises(ValueError, match='both sides'):
        interpolate([], [], NS)
    with pytest.raises(ValueError, match='both sides'):
        interpolate([NS], [[0.0, 0.0]], NS)
    lost = exposures([1.5], angle=(1.0, np.nan))
    with pytest.raises(ValueError, match='home the encoder'):
        lost.at('enc', NS + SECOND // 2)
    np.testing.assert_array_equal(lost.at('abs', NS + SECOND // 2)[0], [1.0, np.nan])


@pytest.mark.parametrize('el', [0.0, 45.0, 80.0, -30.0])
def test_a_small_miss_adds_on_the_sky(el):
    el *= DEG
    az, new = centred(1.0, el, 3 * ARCSEC, 4 * ARCSEC)
    assert (az - 1.0) * np.cos(el) / ARCSEC == pytest.approx(3.0, abs=1e-3)
    assert (new - el) / ARCSEC == pytest.approx(4.0, abs=1e-3)


def test_a_large_miss_near_the_zenith_is_taken_to_the_sphere():
    rng = np.random.default_rng(0)
    az, el = rng.uniform(0, 6, 50), rng.uniform(-80, 89.9, 50) * DEG
    mx, my = rng.uniform(-1, 1, (2, 50)) * DEG
    new_az, new_el = centred(az, el, mx, my)

    def unit(a, e):
        return np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)])
    right = np.stack([np.cos(az), -np.sin(az), np.zeros(50)])
    up = np.stack([-np.sin(el) * np.sin(az), -np.sin(el) * np.cos(az), np.cos(el)])
    star = unit(az, el) + mx * right + my * up
    np.testing.assert_allclose(unit(new_az, new_el), star / np.linalg.norm(star, axis=0),
                               atol=1e-14)


# --- exposures -----------------------------------------------------------------------------------

TRACK = np.array([[1.0, 0.5], [1.0, 0.5]])


def exposures(frames, enc=(0, 1, 2, 3), abs_=(0, 1, 2, 3), angle=(1.0, 0.5)):
    """A track from `NS` on; frames and readings by their seconds."""
    out = Exposures()
    out.begin(Track(NS, np.array([0.0, 100.0]), TRACK, None))
    for encoder, seconds in (('enc', enc), ('abs', abs_)):
        for second in seconds:
            out.add_reading(encoder, NS + second * SECOND, np.array(angle))
    for second in frames:
        out.add_frame(NS + round(second * SECOND), 2e-5, -3e-5)
    return out


def take(exposures, refused=None, tolerance=1e-4):
    return exposures.take(tolerance, (refused if refused is not None else []).append)


def test_a_frame_between_readings_is_taken_once():
    waiting = exposures([1.5])
    stamp, miss = take(waiting)
    assert stamp == NS + 3 * SECOND // 2
    np.testing.assert_array_equal(miss, [2e-5, -3e-5])
    assert take(waiting) is None


@pytest.mark.parametrize('late', ['enc', 'abs'])
def test_a_frame_waits_for_both_encoders(late):
    readings = {'enc': (0, 1, 2), 'abs_': (0, 1, 2), ('enc' if late == 'enc' else 'abs_'): (0, 1)}
    waiting = exposures([1.5], **readings)
    assert take(waiting) is None
    waiting.add_reading(late, NS + 2 * SECOND, np.array([1.0, 0.5]))
    assert take(waiting) is not None


def test_a_frame_of_before_the_command_is_passed_over():
    stamp, _ = take(exposures([-0.5, 1.5]))
    assert stamp == NS + 3 * SECOND // 2


def test_a_frame_off_the_track_does_not_count():
    assert take(exposures([1.5], angle=(1.0, 0.5 + 2e-4))) is None
    assert take(exposures([1.5], angle=(1.0 + 1.1e-4, 0.5))) is not None  # times cos(el)


def test_a_frame_without_a_finite_reading_is_refused_with_its_reason():
    refused = []
    assert take(exposures([1.5], angle=(np.nan, 0.5)), refused) is None
    assert len(refused) == 1 and 'home the encoder' in refused[0]


def test_readings_out_of_order_and_a_clock_that_went_back():
    waiting = exposures([], enc=(0, 5))
    with pytest.raises(ValueError, match='two encoders on one topic'):
        waiting.add_reading('enc', NS + 5 * SECOND - 1, np.zeros(2))
    assert not waiting.add_reading('enc', NS + 6 * SECOND, np.zeros(2))
    assert waiting.add_reading('enc', NS, np.zeros(2))


def test_the_newest_readings_back_to_a_moment():
    readings = Readings(most=10)
    assert len(readings) == 0 and len(readings.since(5)[0]) == 0
    for stamp in range(0, 600, 20):
        readings.append(stamp, (stamp * 0.1, -stamp * 0.1))
    assert 10 <= len(readings) <= 20 and readings.stamps[-1] == 580
    for moment, first in ((550, 540), (540, 520), (0, readings.stamps[0]), (900, 580)):
        stamps, angles = readings.since(moment)
        assert stamps[0] == first and stamps[-1] == 580
        assert angles == pytest.approx(np.outer(stamps, [0.1, -0.1]))
    readings.clear()
    assert not readings
