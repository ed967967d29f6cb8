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

from encoder_reading.axis_reader import read_frames
from encoder_reading.frame_readings import CORRECTED, EXACT, REJECTED
from encoder_reading.paper_reader import PaperReader
from encoder_reading.template_reader import TemplateReader
from encoder_sim.absolute import Absolute, AbsoluteEncoder
from encoder_sim.keyed_noise import uniform
from encoder_sim.scenario_file import load_scenario
from msg_tools.units import ARCSEC, wrap

ANGLES = 2 * np.pi * uniform(11, 'test', 'angles', np.arange(300))
STAMPS = np.arange(300)
BAR = 1200.0 * ARCSEC


def encoder(axis='azimuth', seed=1, **params):
    return AbsoluteEncoder(dataclasses.replace(Absolute(), noise=2.0, **params), seed, axis)


def errors(device, angles=ANGLES, **how):
    """arcsec."""
    return wrap(device.read(np.arange(len(angles)), angles, **how).angle - angles) / ARCSEC


def rms(error):
    return np.sqrt(np.mean(error**2))


@pytest.mark.parametrize('params', [
    {}, {'code': 'equation2'}, {'bar_pitch': 60.0, 'blur': 8.0, 'base': 88.0},
    {'mounting': 'reversed'}, {'geometry': 'tangent'}, {'scale_error': 0.004},
    {'shading_tilt': 0.1, 'shading_falloff': 0.2}])
def test_reading(params):
    device = encoder(**params)
    readings = device.read(STAMPS, ANGLES)
    assert (readings.quality == EXACT).all()
    assert rms(wrap(readings.angle - ANGLES) / ARCSEC) < 0.45


def test_methods_to_choose_from():
    template, paper = encoder(), encoder(method='paper')
    assert isinstance(template.reader.reader, TemplateReader)
    assert isinstance(paper.reader.reader, PaperReader)
    readings = paper.read(STAMPS, ANGLES)
    good = readings.quality == EXACT
    error = wrap(readings.angle - ANGLES)[good] / ARCSEC
    assert good.mean() > 0.98
    assert 3.0 < np.median(np.abs(error)) / 0.67 < 6.0
    assert np.array_equal(paper.frames(STAMPS[:3], ANGLES[:3]),
                          template.frames(STAMPS[:3], ANGLES[:3]))


def test_range_of_the_axes():
    angles = np.linspace(-0.02, 0.02, 100)
    azimuth = encoder().read(STAMPS[:100], angles).angle
    assert azimuth.min() >= 0.0 and azimuth.max() < 2 * np.pi
    elevation = encoder('elevation').read(STAMPS[:100], angles).angle
    assert np.abs(elevation - angles).max() < 2 * ARCSEC


def test_dirt_is_corrected_or_rejected():
    device = encoder(ccd_dust=3)
    readings = device.read(STAMPS, ANGLES)
    assert np.mean(readings.quality == CORRECTED) > 0.9
    assert np.nanmax(np.abs(wrap(readings.angle - ANGLES))) < 3 * ARCSEC
    buried = encoder(ccd_dust=30).read(STAMPS, ANGLES)
    assert (buried.quality == REJECTED).all() and np.isnan(buried.angle).all()
    spotted = encoder(disc_dust=60).read(STAMPS, ANGLES)
    assert (spotted.quality == CORRECTED).any()
    assert np.nanmax(np.abs(wrap(spotted.angle - ANGLES))) < 3 * ARCSEC


@pytest.mark.parametrize('params, low, high', [
    ({'bar_position_error': 1e-6}, 0.7, 1.2), ({'pixel_nonuniformity': 0.01}, 0.36, 0.6),
    ({'shifted_bars': 0.1}, 0.36, 0.5), ({'missing_bars': 0.1}, 0.35, 0.45),
    ({'full_well': 20e3}, 0.36, 0.5)])
def test_what_flaws_cost(params, low, high):
    assert low < rms(errors(encoder(**params))) < high


def test_eccentricity_with_one_head_and_with_two():
    off = errors(encoder(eccentricity=2e-6, eccentricity_phase=0.3))
    columns = np.stack([np.sin(ANGLES - 0.3), np.cos(ANGLES - 0.3), np.ones(len(ANGLES))], axis=1)
    sine, cosine, _ = np.linalg.lstsq(columns, off, rcond=None)[0]
    # 5.2" a micrometre
    assert (sine, cosine) == pytest.approx((-10.44, 0.0), abs=0.1)
    two = encoder(eccentricity=2e-6, eccentricity_phase=0.3, heads=2)
    # and the noise of two is less
    assert rms(errors(two)) < 0.3
    assert two.frames(STAMPS[:4], ANGLES[:4]).shape == (2, 4, 1800)
    assert np.abs(errors(two, np.linspace(-0.01, 0.01, 50))).max() < 1.5


def test_one_blind_head_of_two_rejects():
    device = encoder(heads=2)
    frames = device.frames(STAMPS[:3], ANGLES[:3])
    frames[1, 2] = 0
    readings = device.reader.join(device.reader.reader.read(frames.reshape(6, 1800)))
    assert readings.quality.tolist() == [EXACT, EXACT, REJECTED]
    assert np.isnan(readings.angle).tolist() == [False, False, True]


def test_offset_and_drift_of_the_zero():
    shift = 30 * ARCSEC
    for drifts, moved in (((0.0, 2 * shift), 30.0), ((2 * shift, 0.0), 90.0)):
        device = encoder(zero_offset=shift, zero_drifts=drifts)
        assert np.median(errors(device)) == pytest.approx(moved, abs=0.1)
    device = encoder(zero_drift=shift)
    drift = device.zeros([0])[0] / ARCSEC
    assert 0.1 < abs(drift) < 150.0
    assert np.median(errors(device)) == pytest.approx(drift, abs=0.1)
    assert encoder(seed=2, zero_drift=shift).zeros([0])[0] / ARCSEC != drift


def test_a_power_on_has_a_zero_of_its_own():
    shift = 30 * ARCSEC
    device = encoder(zero_drifts=(0.0, shift, 3 * shift), power_cycles=(5.5, 8.0))
    when = np.arange(10) * 10**9
    assert device.power_ons(when).tolist() == [1] * 6 + [2] * 2 + [3] * 2
    angle = device.read(when, np.full(10, 1.0)).angle
    np.testing.assert_allclose(
        (angle - 1.0) / ARCSEC, [0.0] * 6 + [30.0] * 2 + [90.0] * 2, atol=2.0)
    device.power_cycle()
    assert device.power_ons(when).tolist() == [2] * 6 + [3] * 2 + [4] * 2
    np.testing.assert_allclose(
        (device.read(when, np.full(10, 1.0)).angle - angle) / ARCSEC,
        [30.0] * 6 + [60.0] * 2 + [0.0] * 2, atol=2.0)


def test_drift_with_time_temperature_and_latency():
    params = dataclasses.replace(Absolute(), zero_rate=0.001, zero_slope=0.01, latency=0.5)
    device = AbsoluteEncoder(params, 1, 'azimuth', start=100.0)
    angle = device.read(int(102e9), 1.0, rates=0.02, temperature=11.0).angle
    assert angle[0] == pytest.approx(1.0 - 0.01 + 0.002 + 0.01, abs=0.5 * ARCSEC)


def test_exposure_smears_at_speed():
    device = encoder(exposure=1e-3)
    rate = 8.0 / 48.0 * BAR / 1e-3  # eight pixels
    assert rms(errors(device, rates=rate)) < 0.5
    assert not np.array_equal(device.frames(0, 1.0, rate), device.frames(0, 1.0))
    fast = device.read(STAMPS, ANGLES, rates=8 * rate)
    assert (fast.quality == REJECTED).all()


@pytest.mark.parametrize('dirt', [
    {}, {'missing_bars': 0.02}, {'mounting': 'reversed'}, {'method': 'paper'}])
def test_same_stamp_same_reading_whatever_the_batch(dirt):
    device = encoder(**dirt)
    stamps = 1_768_482_000_000_000_000 + 10**6 * np.arange(300)
    together = device.read(stamps, ANGLES).angle
    frames = device.frames(stamps, ANGLES)
    assert frames.dtype == np.uint8 and frames.shape == (1, 300, 1800)
    for i in (299, 0, 130):
        # to the last bit: the same night whatever the load
        assert np.array_equal(
            device.read(int(stamps[i]), ANGLES[i]).angle, together[i : i + 1], equal_nan=True)
        assert np.array_equal(device.frames(int(stamps[i]), ANGLES[i])[0, 0], frames[0, i])
    other = encoder('elevation', **dirt)
    assert not np.array_equal(other.frames(stamps[:1], ANGLES[:1]), frames[:, :1])


def test_nothing_to_read():
    device = encoder()
    assert device.frames([], []).shape == (1, 0, 1800)
    assert device.read([], []).angle.shape == device.read([], []).quality.shape == (0,)


def test_encoders_read_together():
    devices = [encoder(), encoder('elevation', heads=2), encoder(bar_pitch=60.0, blur=8.0)]
    assert len({id(device.reader.reader) for device in devices}) == 2
    angles = np.stack([ANGLES[:40], 0.2 * ANGLES[:40], ANGLES[40:80]], axis=1)
    readings = read_frames([device.reader for device in devices], [
        device.frames(STAMPS[:40], angles[:, k]) for k, device in enumerate(devices)])
    assert readings.angle.shape == readings.quality.shape == (40, 3)
    assert np.abs(wrap(readings.angle - angles)).max() < 2 * ARCSEC
    for k, device in enumerate(devices):
        alone = device.read(STAMPS[:40], angles[:, k])
        assert np.array_equal(readings.angle[:, k], alone.angle)


def test_a_design_that_cannot_be_read():
    with pytest.raises(ValueError, match='cannot be distinguished'):
        encoder(bar_narrow=0.149e-3)


def test_default_scenario_is_close_to_the_truth():
    for axis in ('azimuth', 'elevation'):
        params = getattr(load_scenario('default').absolute, axis)
        error = errors(AbsoluteEncoder(params, 1, axis))
        assert np.median(error) == pytest.approx(params.zero_offset / ARCSEC, abs=1.0)


def test_every_flaw_has_a_key_in_the_scenario(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text("""
absolute:
  azimuth: {bar_position_error_um: 0.5, missing_bars_percent: 2, shifted_bars_percent: 3,
    bar_shift: 0.2, heads: 2, mounting: reversed, geometry: tangent, bar_pitch_px: 60,
    scale_error_percent: 0.1, blur_px: 8, exposure_us: 200, shading_tilt_percent: 5,
    shading_falloff_percent: 10, pixel_nonuniformity_percent: 1, disc_dust: 5, ccd_dust: 1,
    dust_size_px: 40, noise: 1.5, full_well_ke: 60, method: paper, tilt_deg: 0.1,
    tilt_phase_deg: 10, runout_um: 20, runout_phase_deg: 30, focus_error_um: -5,
    defocus_px_per_um: 0.03, lean_deg: 0.5, image_percent_per_mm: 2, lamp_left_percent: 80,
    lamp_halving_h: 5, stamp_jitter_ms: 2, late_stamps_percent: 1, late_by_ms: 40}
""")
    params = load_scenario(path).absolute.azimuth
    changed = {'bar_position_error': 0.5e-6, 'missing_bars': 0.02, 'shifted_bars': 0.03,
               'bar_shift': 0.2, 'scale_error': 0.001, 'exposure': 2e-4, 'shading_tilt': 0.05,
               'shading_falloff': 0.1, 'pixel_nonuniformity': 0.01, 'dust_size': 40.0,
               'full_well': 60e3, 'bar_pitch': 60.0, 'blur': 8.0, 'tilt': np.deg2rad(0.1),
               'tilt_phase': np.deg2rad(10.0), 'runout': 20e-6, 'runout_phase': np.deg2rad(30.0),
               'focus_error': -5e-6, 'defocus_slope': 3e4, 'lean': np.deg2rad(0.5),
               'image_growth': 20.0, 'lamp_left': 0.8, 'lamp_halving': 18000.0,
               'stamp_jitter': 2e-3, 'late_stamps': 0.01, 'late_by': 0.04}
    assert {name: getattr(params, name) for name in changed} == pytest.approx(changed)
    assert (params.heads, params.mounting, params.geometry, params.method) == (
        2, 'reversed', 'tangent', 'paper')
    default = Absolute()
    same = [f.name for f in dataclasses.fields(params)
            if getattr(params, f.name) == getattr(default, f.name)]
    assert set(same) == {
        'diameter', 'eccentricity', 'eccentricity_phase', 'eccentricity_rate', 'zero_offset',
        'zero_drift', 'zero_drifts', 'zero_rate', 'zero_slope', 'reference_temperature', 'latency',
        'power_cycles', 'code', 'bar_wide', 'bar_narrow', 'pixels', 'base', 'contrast'}
