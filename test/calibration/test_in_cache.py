"""A fit of many rows goes by parts: the same as all at once."""

import sys
from pathlib import Path

import numpy as np
import pytest

from calibration import in_cache, least_squares, robust_rounds
from calibration.fit import fit_terms
from calibration.in_cache import apart, change, largest, parts
from msg_tools.units import ARCSEC

sys.path.append(str(Path(__file__).parent))

from noisy_run import make_run

KINDS = ('clean', 'gross', 'one side', 'heavy tails', 'sigmas', 'sigmas and gross')


def run_of(kind, n=7000):
    rng = np.random.default_rng(3)
    columns = {}
    if 'sigmas' in kind:
        columns = {f'sigma_{axis}': rng.uniform(0.5, 2.0, n) * ARCSEC for axis in 'xy'}
    run = make_run(rng, n, **columns)
    if kind in ('gross', 'sigmas and gross'):
        run.columns['az_enc'][::9] += rng.normal(scale=600 * ARCSEC, size=len(run['az'][::9]))
    if kind == 'one side':
        run.columns['el_enc'][::6] += 20 * ARCSEC
    if kind == 'heavy tails':
        run.columns['el_enc'] += rng.standard_t(2, n) * ARCSEC
    return run


@pytest.mark.parametrize('kind', KINDS)
def test_a_fit_by_parts_is_that_of_all_at_once(monkeypatch, kind):
    run = run_of(kind)
    whole = fit_terms(run)
    for module in (in_cache, least_squares):
        monkeypatch.setattr(module, 'BLOCK', 900)  # the last part is smaller
    monkeypatch.setattr(robust_rounds, 'MANY', 0)
    passes = []
    together = robust_rounds.Rounds.step_and_weigh
    monkeypatch.setattr(robust_rounds.Rounds, 'step_and_weigh', lambda self, *args: (
        passes.append(self._by_parts), together(self, *args))[1])
    by_parts = fit_terms(run)
    assert passes and all(passes)
    sigma = np.sqrt(np.diag(whole.covariance))
    assert np.abs(by_parts.coefficients - whole.coefficients).max() < 1e-5 * sigma.min()
    np.testing.assert_allclose(by_parts.covariance, whole.covariance, rtol=1e-5,
                               atol=1e-6 * sigma.max()**2)
    for name in ('residual_x', 'residual_y'):
        np.testing.assert_allclose(getattr(by_parts, name), getattr(whole, name), rtol=0,
                                   atol=1e-5 * ARCSEC)
    np.testing.assert_allclose(by_parts.weights, whole.weights, rtol=0, atol=1e-5)


def test_two_fits_share_nothing(monkeypatch):
    monkeypatch.setattr(robust_rounds, 'MANY', 0)
    first = fit_terms(run_of('gross'))
    kept = [first.residual_x.copy(), first.weights.copy()]
    fit_terms(run_of('heavy tails'))
    np.testing.assert_array_equal(first.residual_x, kept[0])
    np.testing.assert_array_equal(first.weights, kept[1])


@pytest.mark.parametrize('n', [10, 19_999, 20_000, 50_001])
def test_largest_and_the_largest_difference(n):
    rng = np.random.default_rng(n)
    a, b = rng.normal(size=(2, n))
    assert largest(a) == np.abs(a).max()
    assert apart(a, b) == np.abs(a - b).max()
    b[n // 2] = np.nan
    assert np.isnan(apart(a, b))


def test_a_change_in_its_place():
    rng = np.random.default_rng(5)
    values, rows, step = rng.normal(size=20_001), rng.normal(size=(3, 20_001)), [0.1, -2.0, 3.0]
    expected = values - step @ rows
    far = change(values, np.array(step), rows, values)
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12)
    assert far == pytest.approx(np.abs(step @ rows).max())


def test_parts_are_all_rows():
    numbers = np.arange(20_001)
    np.testing.assert_array_equal(np.concatenate([numbers[part] for part in parts(20_001)]),
                                  numbers)
