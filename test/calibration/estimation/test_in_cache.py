"""A fit of many rows goes by parts: the same as all at once."""


import numpy as np
import pytest
from noisy_run import make_run

from calibration.analysis import rotation_offsets as rotating
from calibration.analysis.fit import fit_terms
from calibration.estimation import in_cache, least_squares, robust_weights, rounds_of_many
from calibration.estimation.in_cache import apart, change, largest, parts
from calibration.estimation.robust import bisquare
from calibration.estimation.robust_weights import Room
from calibration.estimation.rounds_of_many import RoundsOfMany, Sight
from msg_tools.units import ARCSEC

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


def all_are_many(monkeypatch):
    for module in (robust_weights, rounds_of_many):
        monkeypatch.setattr(module, 'MANY', 0)


@pytest.mark.parametrize('kind', KINDS)
def test_a_fit_by_parts_is_that_of_all_at_once(monkeypatch, kind):
    run = run_of(kind)
    whole = fit_terms(run)
    for module in (in_cache, least_squares, rotating):
        monkeypatch.setattr(module, 'BLOCK', 900)  # the last part is smaller
    all_are_many(monkeypatch)
    called, of_rounds, of_sight = [], RoundsOfMany._pass, Sight.__call__
    monkeypatch.setattr(RoundsOfMany, '_pass', lambda *args: (
        called.append('pass'), of_rounds(*args))[1])
    monkeypatch.setattr(Sight, '__call__', lambda *args: (
        called.append('sight'), of_sight(*args))[1])
    by_parts = fit_terms(run)
    assert {'pass', 'sight'} == set(called)
    sigma = np.sqrt(np.diag(whole.covariance))
    assert np.abs(by_parts.coefficients - whole.coefficients).max() < 1e-5 * sigma.min()
    np.testing.assert_allclose(by_parts.covariance, whole.covariance, rtol=1e-5,
                               atol=1e-6 * sigma.max()**2)
    for name in ('residual_x', 'residual_y'):
        np.testing.assert_allclose(getattr(by_parts, name), getattr(whole, name), rtol=0,
                                   atol=1e-5 * ARCSEC)
    np.testing.assert_allclose(by_parts.weights, whole.weights, rtol=0, atol=1e-5)


def test_two_fits_share_nothing(monkeypatch):
    all_are_many(monkeypatch)
    first = fit_terms(run_of('gross'))
    kept = [first.residual_x.copy(), first.weights.copy()]
    fit_terms(run_of('heavy tails'))
    np.testing.assert_array_equal(first.residual_x, kept[0])
    np.testing.assert_array_equal(first.weights, kept[1])


@pytest.mark.parametrize('given', [False, True])
@pytest.mark.parametrize('with_step', [False, True])
def test_a_sight_has_what_the_rounds_would_find(monkeypatch, given, with_step):
    all_are_many(monkeypatch)
    rng = np.random.default_rng(6)
    n, scales, step = 5000, [1.0, 2.0], np.array([0.1, -0.2, 0.05])
    rows, residual = rng.normal(size=(3, 2 * n)), rng.standard_t(3, size=2 * n)
    base = rng.uniform(0.5, 2.0, 2 * n) if given else None
    room = Room()
    sight = Sight(rows, base, scales, room, step if with_step else None)
    for part in (slice(0, 900), slice(900, n)):
        sight(residual, part)
    square = np.square(residual) * (1.0 if base is None else base)
    weights = bisquare(np.sqrt(square[:n] / 1.0 + square[n:] / 4.0))
    np.testing.assert_allclose(sight.weights, weights, rtol=0, atol=1e-12)
    both = np.concatenate((weights, weights)) * (1.0 if base is None else base)
    np.testing.assert_allclose(sight.force, rows @ (both * residual), rtol=1e-10)
    if with_step:
        np.testing.assert_allclose(sight.residual, residual - step @ rows, rtol=0, atol=1e-12)
        return
    for normal, of in zip(sight.normals, (slice(0, n), slice(n, None))):
        np.testing.assert_allclose(normal, (rows[:, of] * both[of]) @ rows[:, of].T, rtol=1e-10)


def test_a_sight_that_rejects_the_rows_is_left(monkeypatch):
    all_are_many(monkeypatch)
    rng = np.random.default_rng(6)
    rows, residual = rng.normal(size=(3, 4000)), rng.normal(size=4000)
    sight = Sight(rows, None, [1e-3, 1e-3], Room())
    sight(residual, slice(0, 2000))
    rounds = RoundsOfMany(rows, residual, None, 1e-12, 1e-3 * np.eye(3))
    rounds.see(sight)
    assert rounds.solution is None and rounds.unweighted
    assert rounds.first_weights([1.0, 1.0])[0].mean() > 0.9


@pytest.mark.parametrize('given', [False, True])
def test_rounds_of_many_rows_settle_where_least_squares_do(monkeypatch, given):
    all_are_many(monkeypatch)
    rng = np.random.default_rng(7)
    rows, b = rng.normal(size=(3, 4000)), rng.normal(size=4000)
    base = rng.uniform(0.5, 2.0, 4000) if given else None
    rounds = RoundsOfMany(rows, b, base, 1e-12, 1e-3 * np.eye(3))
    rounds.go(np.array([0.3, -0.1, 0.2]))
    weights = rng.uniform(size=2000)
    weights[0] = 0.0
    both = np.concatenate((weights, weights)) * (1.0 if base is None else base)
    before = rounds.residual.copy()
    moved = rounds.settle(weights)
    root = np.sqrt(both)
    expected = np.linalg.lstsq((rows * root).T, root * b, rcond=None)[0]
    np.testing.assert_allclose(rounds.p, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rounds.residual, b - expected @ rows, rtol=0, atol=1e-12)
    assert moved == pytest.approx(np.abs(rounds.residual - before).max())
    np.testing.assert_array_equal(rounds.solution.residual, rounds.residual)
    np.testing.assert_array_equal(rounds.solution.p, rounds.p)
    assert rounds.moved >= np.abs(rounds.residual - b).max()
    rows[2, 1:] = 0.0  # the third has lost its row
    rounds = RoundsOfMany(rows, b, base, 1e-12, 1e-3 * np.eye(3))
    rounds.go(np.array([0.3, -0.1, 0.2]))
    rounds.settle(weights)
    assert rounds.solution.rank == 2 and abs(rounds.p[2]) < 1e-12


def test_what_a_sight_found_is_of_where_it_was(monkeypatch):
    all_are_many(monkeypatch)
    rng = np.random.default_rng(6)
    rows, residual, scales = rng.normal(size=(3, 4000)), rng.normal(size=4000), [1.0, 1.0]
    sight = Sight(rows, None, scales, Room())
    sight(residual, slice(0, 2000))
    rounds = RoundsOfMany(rows, residual, None, 1e-12, 1e-3 * np.eye(3))
    rounds.see(sight)
    weights, kept = (of.copy() for of in rounds.first_weights(scales))
    there = rounds.way(weights, kept)
    np.testing.assert_array_equal(rounds.first_step(scales), there)
    rounds.go(np.array([0.3, -0.1, 0.2]))
    moved = rounds.first_weights(scales)
    assert np.abs(moved[0] - weights).max() > 0.01
    square = np.square(rounds.residual)
    np.testing.assert_allclose(moved[0], bisquare(np.sqrt(square[:2000] + square[2000:])),
                               rtol=0, atol=1e-12)
    both = np.concatenate((moved[0], moved[0]))
    np.testing.assert_allclose(rounds.force(moved[0]), rows @ (both * rounds.residual), rtol=1e-10)


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
