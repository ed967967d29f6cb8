import dataclasses

import numpy as np
import pytest

from encoder_sim.absolute_reading import AbsoluteEncoder, PaperReader
from encoder_sim.ccd import LinearCCD
from encoder_sim.disc import BAR_ANGLE, Disc
from encoder_sim.keyed_noise import uniform
from encoder_sim.scenario import Absolute, load_scenario
from pointing_model.units import ARCSEC, wrap

ANGLES = 2 * np.pi * uniform(11, 'test', 'angles', np.arange(500))
WIDE_PITCH = {'bar_pitch': 60.0, 'blur': 8.0, 'base': 88.0}


def encoder(axis='azimuth', **params):
    return AbsoluteEncoder(dataclasses.replace(Absolute(), noise=2.0, **params), 1, axis)


def errors(device, stamps=None, angles=ANGLES):
    angle, valid = device.read(np.arange(len(angles)) if stamps is None else stamps, angles)
    assert valid.all()
    return wrap(angle - angles) / ARCSEC


@pytest.mark.parametrize('params', [{}, {'code': 'equation2'}, WIDE_PITCH])
def test_error_of_the_papers_reading(params):
    error = errors(encoder(**params))
    assert 3.5 < error.std() < 5.5  # the paper measured 4.57"
    assert abs(error.mean()) < 0.6
    assert np.abs(error).max() < 25.0  # no reading one bar (1200") off


def test_most_of_it_is_bias():
    device = encoder()
    repeated = errors(device, np.arange(300), np.full(300, 1.234))
    assert repeated.std() == pytest.approx(0.7, abs=0.15)


def test_the_fit_is_the_least_squares_sine():
    from scipy.optimize import curve_fit

    device = encoder()
    frame = device.frame(5, 2.1)
    _, centres, _ = device.reader._decode(250.0 - frame[None])
    omega, phase, _ = device.reader._fit(250.0 - frame[None], centres)
    x = np.arange(1800.0)

    def sine(x, a, w, p, n):
        return a * np.sin(w * x + p) + n

    best, _ = curve_fit(sine, x, 250.0 - frame, [40, omega[0] * 1.001, phase[0] + 0.05, 120])
    assert best[1] == pytest.approx(omega[0], rel=1e-7)
    assert wrap(best[2] - phase[0]) == pytest.approx(0.0, abs=1e-5)


def test_cycle_is_right_at_every_place_of_a_bar():
    """Through one bar in small steps, where eq. 12 takes some readings one bar off."""
    angles = 500 * BAR_ANGLE + np.linspace(0.0, 2 * BAR_ANGLE, 600)
    assert np.abs(errors(encoder(), angles=angles)).max() < 25.0


def test_ends_of_the_circle():
    angles = np.linspace(-0.02, 0.02, 100)
    angle, valid = encoder().read(np.arange(100), angles)
    assert valid.all() and angle.min() >= 0.0 and angle.max() < 2 * np.pi
    assert np.abs(wrap(angle - angles)).max() < 25 * ARCSEC
    angle, _ = encoder('elevation').read(np.arange(100), angles)
    assert np.abs(angle - angles).max() < 25 * ARCSEC


def test_frames_that_cannot_be_read():
    device = encoder()
    good = device.frame(1, 1.0)
    blank = np.full(1800, 159, np.uint8)
    black = np.zeros(1800, np.uint8)
    covered = good.copy()
    covered[400:] = 159
    noise = np.random.default_rng(1).integers(0, 255, 1800).astype(np.uint8)
    read = device.reader.read(np.stack([blank, good, black, covered, noise]))
    assert read.valid.tolist() == [False, True, False, False, False]
    assert np.isnan(read.angle[[0, 2, 3, 4]]).all()
    assert wrap(read.angle[1] - 1.0) == pytest.approx(0.0, abs=25 * ARCSEC)
    assert device.reader.read(np.empty((0, 1800), np.uint8)).angle.shape == (0,)


def test_a_wrong_bar_is_noticed():
    frame = encoder().frame(1, 1.0)
    light = LinearCCD(Absolute(), Disc())
    first = PaperReader(Disc()).read(light.render(1.0)).first_bar[0]
    disc = Disc()
    disc.bits = disc.bits.copy()
    disc.bits[first + 7] ^= 1
    changed = LinearCCD(Absolute(), disc).render(1.0)
    assert PaperReader(Disc()).read(frame).valid.all()
    assert PaperReader(Disc()).read(changed).first_bar[0] == -1


def test_same_stamp_same_frame_whatever_the_batch():
    device = encoder()
    stamps = 1_768_482_000_000_000_000 + 10**9 * np.arange(300)
    together, _ = device.read(stamps, ANGLES[:300])
    for i in (299, 0, 130):
        assert device.read(int(stamps[i]), ANGLES[i])[0][0] == pytest.approx(together[i], abs=1e-12)
        assert np.array_equal(
            device.frame(int(stamps[i]), ANGLES[i]), device.frames(stamps, ANGLES[:300])[i]
        )


def test_eccentricity_offset_and_drift():
    plain = encoder()
    stamps = np.zeros(500, dtype=int)
    shift = 30 * ARCSEC
    moved = encoder(zero_offset=shift, zero_drifts=(0.0, 2 * shift))
    assert np.median(errors(moved) - errors(plain)) == pytest.approx(30.0, abs=0.7)
    moved.power_cycle()
    assert np.median(errors(moved) - errors(plain)) == pytest.approx(90.0, abs=0.7)
    off = errors(encoder(eccentricity=2e-6, eccentricity_phase=0.3), stamps)
    columns = np.stack([np.sin(ANGLES - 0.3), np.cos(ANGLES - 0.3), np.ones(500)], axis=1)
    sine, cosine, _ = np.linalg.lstsq(columns, off, rcond=None)[0]
    # 5.2" a micrometre with one head
    assert (sine, cosine) == pytest.approx((-10.44, 0.0), abs=0.8)


def test_drift_with_time_temperature_and_latency():
    params = dataclasses.replace(Absolute(), zero_rate=0.001, zero_slope=0.01, latency=0.5)
    device = AbsoluteEncoder(params, 1, 'azimuth', start=100.0)
    angle, _ = device.read(int(102e9), 1.0, rates=0.02, temperature=11.0)
    assert angle[0] == pytest.approx(1.0 - 0.01 + 0.002 + 0.01, abs=25 * ARCSEC)


def test_default_scenario_is_close_to_the_truth():
    for axis in ('azimuth', 'elevation'):
        params = getattr(load_scenario('default').absolute, axis)
        error = errors(AbsoluteEncoder(params, 1, axis))
        assert np.median(error) == pytest.approx(params.zero_offset / ARCSEC, abs=1.5)
