import numpy as np
import pytest

from pointing_model.trig import BLOCK, sincos


@pytest.mark.parametrize('n', [3, 2000, BLOCK, 3 * BLOCK + 5])
def test_as_numpy(n):
    angle = np.random.default_rng(1).uniform(-20.0, 20.0, n)
    sine, cosine = sincos(angle)
    np.testing.assert_allclose(sine, np.sin(angle), rtol=0, atol=3e-16)
    np.testing.assert_allclose(cosine, np.cos(angle), rtol=0, atol=3e-16)


def test_near_the_zeros_as_many_digits():
    near = 10.0 ** np.random.default_rng(2).uniform(-15.0, -2.0, 4001)
    angle = np.arange(-2000, 2001) * (np.pi / 2.0) % 40.0 + near
    for ours, theirs in zip(sincos(angle), (np.sin(angle), np.cos(angle))):
        np.testing.assert_allclose(ours, theirs, rtol=3e-15, atol=1e-24)
    right = np.full(2000, np.pi / 2.0)  # which is not quite half of pi
    assert sincos(right)[1][0] == pytest.approx(np.cos(np.pi / 2.0), rel=1e-9)


def test_what_is_not_usual():
    angle = np.full((2, 1000), 0.3)
    angle[1, 7] = np.nan
    sine, cosine = sincos(angle)
    assert sine.shape == (2, 1000) and np.isnan(sine[1, 7]) and np.isnan(cosine).sum() == 1
    np.testing.assert_array_equal(sincos(np.full(2000, 1e9))[0], np.sin(1e9))
    assert sincos(0.5) == (np.sin(0.5), np.cos(0.5))
