import numpy as np
import pytest

from pointing_model.pairing import centred, interpolate
from pointing_model.units import ARCSEC, DEG

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


def test_too_few_or_unknown_readings_are_refused():
    with pytest.raises(ValueError, match='both sides'):
        interpolate([], [], NS)
    with pytest.raises(ValueError, match='both sides'):
        interpolate([NS], [[0.0, 0.0]], NS)
    with pytest.raises(ValueError, match='home the encoder'):
        interpolate([NS, NS + 2], [[0.0, 0.0], [np.nan, 0.0]], NS + 1)


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
