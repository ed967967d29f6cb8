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

"""Discs of absolute encoders that are tilted or leave the focus, and a lamp that dies."""

import numpy as np
import pytest

from encoder_reading.disc import blurred_bar
from encoder_reading.frame_readings import REJECTED
from encoder_sim.absolute import Absolute, AbsoluteEncoder
from encoder_sim.ccd import Defocus, LinearCCD
from encoder_sim.scenario_file import load_scenario
from msg_tools.units import ARCSEC, DEG, wrap

START = 1_768_482_000
N = 720
ANGLES = 2.0 * np.pi * (np.arange(N) + 0.3) / N
STAMPS = START * 10**9 + 10**9 * np.arange(N)
SOME = ANGLES[::12]
UM = 1e-6


def encoder(seed=1, **params):
    return AbsoluteEncoder(Absolute(**{'noise': 2.0} | params), seed, 'azimuth', start=START)


def errors(device, stamps=STAMPS, **how):
    """arcsec; NaN where rejected."""
    return wrap(device.read(stamps, ANGLES, **how).angle - ANGLES) / ARCSEC


def waves(error):
    """Once and twice a turn, cosine and sine of each; and what is left."""
    good = np.isfinite(error)
    columns = np.stack([np.ones(N)] + [f(k * ANGLES) for k in (1, 2) for f in (np.cos, np.sin)], 1)
    found = np.linalg.lstsq(columns[good], error[good], rcond=None)[0]
    return found[1:], error - columns @ found


def test_a_disc_in_its_focus_is_seen_as_before():
    for params in ({}, {'defocus_slope': 5e4, 'lean': 0.1, 'image_growth': 10.0}):
        assert Defocus(Absolute(**params), 8).sharp
    plain, near = (LinearCCD(Absolute(**params), Absolute().design.disc) for params in (
        {}, {'runout': 1e-3 * UM}))
    assert not near._defocus.sharp  # the way of a disc out of focus, and no effect
    assert np.abs(plain.light(ANGLES) - near.light(ANGLES)).max() < 0.02


def test_the_blur_is_that_of_a_wider_gaussian():
    """A lone edge between the wide bars, as it would be drawn with that blur."""
    params = Absolute(focus_error=250 * UM)
    ccd = LinearCCD(params, params.design.disc)
    sigma = np.hypot(6.0, 0.02 * 250)
    wider = LinearCCD(Absolute(blur=sigma), params.design.disc)
    assert np.abs(ccd.light(SOME) - wider.light(SOME)).max() < 0.05
    assert np.abs(ccd.light(SOME) - LinearCCD(
        Absolute(), params.design.disc).light(SOME)).max() > 10.0
    # and between two of its tables, in the middle of a bar, too
    for um in (90, 133, 207):
        params = Absolute(focus_error=250 * UM - um * UM, runout=um * UM)
        seen = LinearCCD(params, params.design.disc).light(np.pi)  # there it is nearest
        wide = np.hypot(6.0, 0.02 * (250 - 2 * um))
        assert np.abs(seen - LinearCCD(
            Absolute(blur=wide), params.design.disc).light(np.pi)).max() < 0.05
    assert blurred_bar(np.zeros(1), 15.6, sigma)[0] < blurred_bar(np.zeros(1), 15.6, 6.0)[0]


def test_run_out_of_the_focus_makes_noise_once_a_turn_and_bars_illegible():
    device = encoder(runout=150 * UM, focus_error=150 * UM)
    readings = device.read(STAMPS, ANGLES)
    found, left = waves(wrap(readings.angle - ANGLES) / ARCSEC)
    assert np.abs(found).max() < 0.1
    far, near = (np.nanstd(left[side * np.cos(ANGLES) > 0.8]) for side in (1.0, -1.0))
    assert near == pytest.approx(0.34, abs=0.05) and far > 1.8 * near
    assert (readings.quality[np.cos(ANGLES) < 0.0] == 0).all()
    worse = encoder(runout=300 * UM, focus_error=150 * UM).read(STAMPS, ANGLES).quality
    assert (worse[np.cos(ANGLES) > 0.8] == REJECTED).mean() > 0.3
    assert (worse[np.abs(np.cos(ANGLES) + 0.5) < 0.3] == 0).all()


def test_under_light_askew_the_reading_follows_the_run_out():
    found, _ = waves(errors(encoder(runout=100 * UM, lean=1 * DEG)))
    wanted = 100e-6 * np.tan(1 * DEG) / 39.5e-3 / ARCSEC
    np.testing.assert_allclose(found, [wanted, 0.0, 0.0, 0.0], atol=0.1)
    assert wanted == pytest.approx(9.1, abs=0.05)
    both, _ = waves(errors(encoder(runout=100 * UM, lean=1 * DEG, heads=2)))
    assert np.abs(both).max() < 0.1  # the opposite side comes nearer as much
    grown = encoder(runout=100 * UM, image_growth=20.0)  # 0.2 %, about the middle of the row
    assert np.abs(waves(errors(grown))[0]).max() < 0.1
    edges = grown.heads[0].light(np.zeros(1)) - encoder().heads[0].light(np.zeros(1))
    assert np.abs(edges).max() > 5.0


def test_a_moving_disc_out_of_focus_smears_too():
    rate = np.full(len(SOME), 8.0 / 48.0 * 1200 * ARCSEC / 1e-3)  # eight pixels
    smeared, sharp, still = (
        LinearCCD(Absolute(focus_error=focus, exposure=time), Absolute().design.disc).light(
            SOME, rate) for focus, time in ((1e-3 * UM, 1e-3), (0.0, 1e-3), (0.0, 0.0)))
    assert np.abs(smeared - sharp).max() < 0.3 < 1.0 < np.abs(smeared - still).max()


def test_a_tilted_disc_reads_twice_a_turn_with_any_heads_and_leaves_the_focus():
    found, _ = waves(errors(encoder(tilt=0.5 * DEG, tilt_phase=25 * DEG, defocus_slope=0.0)))
    size = 0.25 * (0.5 * DEG) ** 2 / ARCSEC
    np.testing.assert_allclose(found, [0.0, 0.0, -size * np.sin(50 * DEG),
                                       size * np.cos(50 * DEG)], atol=0.1)
    assert size == pytest.approx(3.93, abs=0.01)
    two, _ = waves(errors(encoder(tilt=0.5 * DEG, tilt_phase=25 * DEG, defocus_slope=0.0, heads=2)))
    np.testing.assert_allclose(two, found, atol=0.1)
    params = Absolute(tilt=0.5 * DEG, tilt_phase=25 * DEG)
    height = Defocus(params, 8).height(ANGLES)
    assert np.ptp(height) / 2 == pytest.approx(39.5e-3 * np.sin(0.5 * DEG), rel=1e-3)
    assert abs(Defocus(params, 8).height(25 * DEG)) < 1e-9


def test_a_dying_lamp_makes_noise_then_errors_then_no_reading():
    noise = {}
    for left in (1.0, 0.5, 0.2):
        error = errors(encoder(lamp_left=left))
        assert np.isfinite(error).all()
        noise[left] = error.std()
    assert noise[0.5] / noise[1.0] == pytest.approx(2.0, rel=0.15)
    assert noise[0.2] / noise[1.0] == pytest.approx(5.0, rel=0.15)
    device = encoder(lamp_halving=100.0)
    lamp = device.lamp(STAMPS)
    np.testing.assert_allclose(lamp[[0, 100, 300]], [1.0, 0.5, 0.125])
    readings = device.read(STAMPS, ANGLES)
    assert (readings.quality[lamp > 0.3] != REJECTED).all()
    assert (readings.quality[lamp < 0.04] == REJECTED).all()
    wrong = np.abs(wrap(readings.angle - ANGLES))
    assert np.nanmax(wrong) < 60 * ARCSEC  # no bar is taken for another
    assert encoder().lamp(STAMPS) is None


@pytest.mark.parametrize('flaw', [
    {'runout': 80 * UM, 'lean': 0.5 * DEG}, {'tilt': 0.3 * DEG}, {'lamp_halving': 600.0},
    {'runout': 80 * UM, 'exposure': 1e-3, 'stamp_jitter': 0.01}])
def test_same_stamp_same_frame_whatever_the_batch(flaw):
    device = encoder(**flaw)
    together = device.frames(STAMPS[:150], ANGLES[:150], 0.02)
    for i in (0, 70, 149):
        assert np.array_equal(
            device.frames(int(STAMPS[i]), ANGLES[i], 0.02)[0, 0], together[0, i])


def told_by(scenario):
    """Errors of its azimuth encoder once around, within 33 minutes, arcsec."""
    params = load_scenario(scenario).absolute.azimuth
    device = AbsoluteEncoder(params, 1, 'azimuth', start=START)
    return errors(device, START * 10**9 + 2_750_000_000 * np.arange(N))


@pytest.mark.parametrize('name, wave, size, lost', [
    ('mount_absolute_defocus', slice(0, 2), 6.8, (0.0, 0.02)),
    ('mount_absolute_tilted_disc', slice(2, 4), 3.9, (0.002, 0.05))])
def test_the_disc_of_the_scenario_shows_once_or_twice_a_turn(name, wave, size, lost):
    error = told_by(name)
    assert lost[0] <= np.isnan(error).mean() <= lost[1]
    found = waves(error)[0] - waves(told_by('default'))[0]
    assert np.hypot(*found[wave]) == pytest.approx(size, abs=0.1)


def test_the_lamp_of_the_scenario_dies_within_the_night():
    error = told_by('mount_absolute_lamp') - np.nanmedian(told_by('default'))
    begun, minute = error[:110], 2.75 / 60.0 * np.arange(N)
    assert 0.8 < begun.std() < 2.0 and not np.isnan(error[minute < 10.0]).any()
    assert np.nanstd(error[(minute > 10.0) & (minute < 16.0)]) > 2.0 * begun.std()
    assert np.isnan(error[minute > 20.0]).all()
