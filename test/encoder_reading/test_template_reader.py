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
import warnings

import numpy as np
import pytest

from encoder_reading.bar_decoding import REASONS
from encoder_reading.disc import BAR_ANGLE, BARS, Disc, windows_of
from encoder_reading.frame_readings import CORRECTED, EXACT, REJECTED
from encoder_reading.template_reader import TemplateReader
from encoder_sim.absolute import Absolute
from encoder_sim.ccd import LinearCCD, pixel_noise
from msg_tools.units import ARCSEC, wrap

SCALES = {48: {}, 60: {'bar_pitch': 60.0, 'blur': 8.0, 'base': 88.0}}
GROSS = 600.0  # arcsec: half a bar


def encoder(pitch=48, **changes):
    return dataclasses.replace(Absolute(), **{'noise': 2.0, **SCALES[pitch], **changes})


def angles(n, seed=1):
    return np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, n)


def frames(params, places, seed=1, disc=None, **how):
    camera = LinearCCD(params, disc or Disc(params.code), seed)
    noise = pixel_noise(seed, 'test', np.arange(len(places)), params.pixels)
    return camera.render(places, noise if params.noise else None, **how)


def errors(readings, places):
    """arcsec, NaN where rejected."""
    return wrap(readings.angle - places) / ARCSEC


def rms(error):
    return np.sqrt(np.nanmean(error**2))


def bound(params):
    """Cramer-Rao bound (arcsec) of the angle beside scale, contrast, level and their slopes."""
    camera = LinearCCD(params, Disc())
    step, x = 10.0 * ARCSEC, np.linspace(-1.0, 1.0, params.pixels)
    variances = []
    for place in angles(40, 3):
        low, light, high = camera.light(place + step * np.array([-1.0, 0.0, 1.0])).astype(float)
        slope = (high - low) / 20.0
        ones = np.ones_like(x)
        columns = np.stack([slope, x * slope, light, x * light, ones, x], axis=1)
        variances.append(np.linalg.inv(columns.T @ columns)[0, 0])
    return np.sqrt(np.mean(variances) * (params.noise**2 + 1.0 / 12.0))


# --- precision ----------------------------------------------------------------------------------


@pytest.mark.parametrize('pitch', SCALES)
def test_noise_reaches_the_bound(pitch):
    params = encoder(pitch)
    places = angles(1500)
    readings = TemplateReader(params.design).read(frames(params, places))
    error = errors(readings, places)
    assert (readings.quality == EXACT).all()
    assert rms(error) < 1.09 * bound(params)
    assert abs(error.mean()) < 0.04
    # what the reading itself says of its error
    assert rms(readings.sigma / ARCSEC) == pytest.approx(rms(error), rel=0.1)
    repeated = np.full(1500, 1.234)
    error = errors(TemplateReader(params.design).read(frames(params, repeated)), repeated)
    assert error.std() < 1.09 * bound(params) and abs(error.mean()) < 0.05


@pytest.mark.parametrize('changes', [
    {}, {'shading_tilt': 0.3, 'shading_falloff': 0.3}, {'scale_error': 0.005},
    {'scale_error': -0.005}, {'geometry': 'tangent'}, {'code': 'equation2'},
    {'bar_pitch': 53.3}, {'contrast': 50.0, 'base': 60.0}])
@pytest.mark.parametrize('pitch', SCALES)
def test_no_bias_without_noise(pitch, changes):
    params = encoder(pitch, **changes)
    places = angles(200, 2)
    light = LinearCCD(params, Disc(params.code)).light(places)
    nominal = dataclasses.replace(params, scale_error=0.0)
    error = errors(TemplateReader(nominal.design).read(light), places)
    assert np.abs(error).max() < 0.07


@pytest.mark.parametrize('blur, limit', [(0.9, 0.2), (1.1, 0.2)])
def test_little_depends_on_the_focus(blur, limit):
    params = encoder()
    places = angles(300, 2)
    light = LinearCCD(dataclasses.replace(params, blur=blur * params.blur), Disc()).light(places)
    assert rms(errors(TemplateReader(params.design).read(light), places)) < limit


@pytest.mark.parametrize('pitch, blur', [(40.0, 6.0), (48.0, 0.5), (65.0, 3.0), (65.0, 9.0)])
def test_other_optics(pitch, blur):
    params = encoder(bar_pitch=pitch, blur=blur)
    places = angles(200)
    readings = TemplateReader(params.design).read(frames(params, places))
    assert (readings.quality == EXACT).all()
    assert rms(errors(readings, places)) < 0.7


def test_every_place_of_a_bar_and_the_ends_of_the_circle():
    params = encoder()
    reader = TemplateReader(params.design)
    places = np.concatenate([500 * BAR_ANGLE + np.linspace(0.0, 2 * BAR_ANGLE, 400),
                             np.linspace(-0.005, 0.005, 200)])
    readings = reader.read(frames(params, places))
    assert np.abs(errors(readings, places)).max() < 1.6
    assert readings.angle.min() >= 0.0 and readings.angle.max() < 2.0 * np.pi


@pytest.mark.parametrize('changes, blobs', [
    ({}, 0), ({'shifted_bars': 0.1}, 0), ({'mounting': 'reversed'}, 0),
    ({'geometry': 'tangent', 'shading_tilt': 0.1}, 0), ({'noise': 10.0}, 3)])
def test_the_same_to_the_last_bit_alone_and_among_others(changes, blobs):
    params = encoder(**changes)
    places = angles(65)
    dust = np.random.default_rng(5).uniform(0.0, params.pixels, (65, blobs)) if blobs else None
    images = frames(params, places, dust=dust)
    images[::3] = images[::3, ::-1]
    reader = TemplateReader(params.design)
    together = reader.read(images)
    for size in (1, 7, 63):
        for i in range(0, len(images), size):
            part = reader.read(images[i : i + size])
            for field in dataclasses.fields(part):
                whole = getattr(together, field.name)[i : i + size]
                assert np.array_equal(getattr(part, field.name), whole,
                                      equal_nan=whole.dtype.kind == 'f')
    # grey levels may be float
    assert reader.read(images.astype(float)).angle == pytest.approx(
        together.angle, abs=1e-9, nan_ok=True)


@pytest.mark.parametrize('pitch, blur, pixels', [
    (16.0, 2.0, 1800), (25.0, 3.0, 8192), (100.0, 12.0, 4096), (200.0, 25.0, 16384)])
def test_other_scales_than_the_papers(pitch, blur, pixels):
    params = encoder(bar_pitch=pitch, blur=blur, pixels=pixels, scale_error=0.004)
    places = angles(40)
    readings = TemplateReader(params.design).read(frames(params, places))
    assert (readings.quality == EXACT).all()
    assert rms(errors(readings, places)) < 0.45


def random_disc(seed, bars):
    return Disc(''.join(map(str, np.random.default_rng(seed).integers(0, 2, bars))))


def test_own_disc():
    disc = random_disc(2, 720)
    params = encoder(diameter=0.0526)
    places = angles(100)
    readings = TemplateReader(params.design, disc).read(frames(params, places, disc=disc))
    assert (readings.quality == EXACT).all()
    assert rms(errors(readings, places)) < 0.7


# --- dirt and wrong bars ------------------------------------------------------------------------


@pytest.mark.parametrize('pitch', SCALES)
@pytest.mark.parametrize('flaw', ['shifted', 'missing', 'blobs'])
def test_dirt(pitch, flaw):
    share = {'shifted': {'shifted_bars': 0.1}, 'missing': {'missing_bars': 0.1}, 'blobs': {}}[flaw]
    params = encoder(pitch, shading_tilt=0.05, shading_falloff=0.1, **share)
    places = angles(900, 4)
    blobs = None
    if flaw == 'blobs':
        blobs = np.random.default_rng(5).uniform(0.0, params.pixels, (len(places), 3))
    readings = TemplateReader(params.design).read(frames(params, places, dust=blobs))
    error = errors(readings, places)
    assert np.nanmax(np.abs(error)) < 4.0
    assert rms(error) < 0.5
    # 60 pixels a bar show 29 bars: some windows without six of them are like others
    assert np.mean(readings.quality == REJECTED) < (0.002 if pitch == 48 else 0.08)
    assert np.mean(readings.quality == CORRECTED) > 0.9


def test_a_wrong_bit_is_corrected():
    disc = Disc()
    wrong = Disc()
    wrong.bits = wrong.bits.copy()
    wrong.bits[300] ^= 1
    params = encoder()
    places = (300 + np.linspace(-15.0, 15.0, 61)) * BAR_ANGLE
    reader = TemplateReader(params.design, disc)
    readings = reader.read(frames(params, places, disc=wrong))
    assert (readings.quality == CORRECTED).all() and (readings.wrong == 1).all()
    assert np.abs(errors(readings, places)).max() < 2.0
    far = reader.read(frames(params, places + 1.0, disc=wrong))
    assert (far.quality == EXACT).all() and (far.wrong == 0).all()


def test_a_wrong_bit_that_makes_two_places_alike_is_rejected():
    """29 bars of the paper's disc in view: two places differ in two bits only."""
    disc = Disc()
    windows = windows_of(disc.bits, 29)
    unlike = (windows[:, np.newaxis] != windows[np.newaxis]).sum(axis=2)
    one, other = np.argwhere(unlike == 2)[0]
    changed = np.flatnonzero(windows[one] != windows[other])[0]
    spoilt = Disc()
    spoilt.bits = disc.bits.copy()
    spoilt.bits[(one + changed) % BARS] ^= 1
    params = encoder(60)
    readings = TemplateReader(params.design, disc).read(
        frames(params, np.full(5, (one + 14) * BAR_ANGLE), disc=spoilt))
    assert [REASONS[k] for k in readings.reason] == ['ambiguous'] * 5
    assert np.isnan(readings.angle).all()


def test_another_disc_is_not_read():
    params = encoder()
    places = angles(500)
    reader = TemplateReader(params.design, Disc('equation2'))
    readings = reader.read(frames(params, places))
    # both codes begin with the same 18 bits, no more
    assert (readings.quality == REJECTED).all()


# --- direction ----------------------------------------------------------------------------------


def test_direction():
    params = encoder()
    places = angles(100)
    images = frames(params, places)
    images[::2] = images[::2, ::-1]
    readings = TemplateReader(params.design).read(images)
    assert readings.backwards.tolist() == [True, False] * 50
    assert np.abs(errors(readings, places)).max() < 1.6
    forward = TemplateReader(dataclasses.replace(params.design, mounting='forward')).read(images)
    assert (forward.quality == REJECTED).tolist() == [True, False] * 50
    assert {REASONS[k] for k in forward.reason[::2]} == {'wrong direction'}
    backward = TemplateReader(dataclasses.replace(params.design, mounting='reversed')).read(images)
    assert (backward.quality == REJECTED).tolist() == [False, True] * 50
    assert backward.angle[::2] == pytest.approx(readings.angle[::2], abs=1e-8)


def test_a_reversed_mounting():
    params = encoder(mounting='reversed')
    places = angles(200)
    reader = TemplateReader(params.design)
    for _ in range(2):
        readings = reader.read(frames(params, places))
        assert readings.backwards.all()
        assert np.abs(errors(readings, places)).max() < 1.6


# --- what is no frame ---------------------------------------------------------------------------


def test_what_is_no_frame_is_rejected():
    params = encoder()
    good = frames(params, np.array([1.0]))[0].astype(float)
    rng = np.random.default_rng(1)
    covered, broken, burnt = good.copy(), good.copy(), good.copy()
    covered[500:] = 159.0
    broken[[0, 700]] = np.nan, np.inf
    burnt[200:400] = 255.0
    halves = np.concatenate([good[:900], frames(params, np.array([2.0]))[0, 900:]])
    wave = 115.0 + 40.0 * np.sin(2 * np.pi * np.arange(1800) / 48.0)
    rows = {
        'dark': np.zeros(1800), 'saturated': np.full(1800, 255.0), 'blank': np.full(1800, 159.0),
        'covered': covered, 'broken': broken, 'burnt': burnt, 'halves': halves, 'wave': wave,
        'noise': rng.uniform(0, 255, 1800), 'shuffled': rng.permutation(good)}
    images = np.stack([*rows.values(), good])
    before = images.copy()
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        readings = TemplateReader(params.design).read(images)
    assert np.array_equal(images, before, equal_nan=True)
    assert readings.quality.tolist() == [REJECTED] * len(rows) + [EXACT]
    assert np.isnan(readings.angle[:-1]).all()
    assert wrap(readings.angle[-1] - 1.0) == pytest.approx(0.0, abs=2 * ARCSEC)
    reason = dict(zip(rows, (REASONS[k] for k in readings.reason)))
    assert (reason['dark'], reason['blank']) == ('no contrast', 'no contrast')
    assert (reason['saturated'], reason['burnt']) == ('saturated', 'saturated')
    assert reason['broken'] == 'not finite'
    whole = TemplateReader(params.design).read(np.nan_to_num(images, nan=0, posinf=0).astype(
        np.uint8))
    assert whole.quality[[0, 1, 2, 3, 5, 6, 7, 8, 9]].tolist() == [REJECTED] * 9


def test_random_garbage_never_becomes_an_angle_or_a_warning():
    rng = np.random.default_rng(3)
    reader = TemplateReader(encoder().design)
    noise = rng.normal(120.0, 30.0, (600, 1800))
    for images in (rng.integers(0, 256, (600, 1800)).astype(np.uint8), noise.astype(np.uint8),
                   np.repeat(rng.integers(70, 160, (600, 75)), 24, axis=1).astype(np.uint8),
                   1e35 * noise, noise - 500.0, np.full((3, 1800), np.nan),
                   np.full((1, 1800), -np.inf), np.full((2, 1800), 1e300)):
        with warnings.catch_warnings():
            warnings.simplefilter('error')
            readings = reader.read(images)
        assert np.isnan(readings.angle).all() and (readings.quality == REJECTED).all()
        assert (readings.reason > 0).all()


def test_bars_of_random_bits_never_become_an_angle():
    params = encoder()
    disc = random_disc(8, BARS)
    places = angles(600)
    readings = TemplateReader(params.design).read(frames(params, places, disc=disc))
    assert (readings.quality == REJECTED).all()


def test_nothing_and_the_wrong_number_of_pixels():
    reader = TemplateReader(encoder().design)
    empty = reader.read(np.empty((0, 1800), np.uint8))
    assert empty.angle.shape == empty.quality.shape == empty.reason.shape == (0,)
    with pytest.raises(ValueError, match=r'1800 pixels'):
        reader.read(np.zeros((3, 1799), np.uint8))


def test_designs_that_cannot_be_read():
    for changes in ({'bar_narrow': 0.148e-3}, {'bar_pitch': 40.0, 'blur': 9.0}):
        with pytest.raises(ValueError, match='cannot be distinguished'):
            TemplateReader(encoder(**changes).design)
    with pytest.raises(ValueError, match='show 18 whole bars: 22 are needed'):
        TemplateReader(encoder(60, pixels=1200).design)
    assert TemplateReader(encoder(pixels=1200).design).pixels == 1200
