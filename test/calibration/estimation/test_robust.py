import numpy as np
import pytest

from calibration.analysis.fit import fit_terms
from calibration.estimation import gauss_newton, robust, robust_rounds, robust_weights
from calibration.estimation.robust import bisquare, hampel, huber, reweighted, sigma_of
from calibration.estimation.robust_rounds import Rounds
from calibration.estimation.rounds_of_many import RoundsOfMany
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun

U = np.linspace(0.0, 12.0, 120_001)
DENSITY = U * np.exp(-0.5 * U**2)  # of the radial distance at Gaussian noise


def efficiency(weights):
    """Of an M-estimate of a place in the plane, by numerical integration (Hampel et al. 1986)."""
    w = weights(U)
    slope = np.gradient(w, U)
    step = U[1] - U[0]
    a = np.sum((w + 0.5 * slope * U) * DENSITY) * step
    b = np.sum(0.5 * np.square(w * U) * DENSITY) * step
    return a * a / b


@pytest.mark.parametrize('weights, expected', [
    (huber, 0.950), (bisquare, 0.986), (hampel, 0.999)])
def test_efficiency_at_gaussian_noise_is_what_the_constants_promise(weights, expected):
    assert efficiency(weights) == pytest.approx(expected, abs=0.0006)


def test_the_constants_of_the_bisquare():
    w = bisquare(U)
    variance = np.sum(0.5 * w * U**2 * DENSITY) / np.sum(w * DENSITY)
    assert pytest.approx(variance, rel=1e-4) == robust.BISQUARE_VARIANCE
    mean_weight = np.sum(w * DENSITY) * (U[1] - U[0])
    assert pytest.approx(mean_weight / efficiency(bisquare), rel=1e-3) == robust.BISQUARE_INFLATION


def test_weights_at_their_bends():
    np.testing.assert_allclose(huber(np.array([0.0, 1.5, 3.0])), [1.0, 1.0, 0.5])
    np.testing.assert_allclose(hampel(np.array([3.0, 12.0, 18.5, 25.0, 90.0])),
                               [1.0, 0.25, 3 / 18.5 * 0.5, 0.0, 0.0])
    np.testing.assert_allclose(bisquare(np.array([0.0, 7.0 / 2**0.5, 7.0, 1e9])),
                               [1.0, 0.25, 0.0, 0.0])


def test_sigma_from_the_median():
    noise = np.random.default_rng(0).normal(size=(2, 20_000)) * [[2.0], [5.0]]
    np.testing.assert_allclose(sigma_of(noise, axis=1), [2.0, 5.0], rtol=0.02)
    assert sigma_of(noise[0], 1.5) == pytest.approx(1.5 * sigma_of(noise[0]))


def test_any_solver_can_be_iterated():
    """The mean with Huber's weights is where their sum balances."""
    y = np.concatenate((np.random.default_rng(1).normal(size=30), [40.0, 50.0]))
    mean, weights = reweighted(
        lambda w: float(w @ y / w.sum()), lambda mean: huber(np.abs(y - mean)), float(y.mean()),
        200, lambda new, old: abs(new - old) < 1e-12)
    assert np.clip(y - mean, -1.5, 1.5).sum() == pytest.approx(0.0, abs=1e-9)
    assert weights[-1] < 0.05 and abs(mean) < 0.3


def test_the_iteration_ends_when_told():
    solved = []
    fit, weights = reweighted(lambda w: solved.append(w) or w, lambda fit: fit + 1, 0, 3)
    assert (fit, weights, solved) == (3, 3, [1, 2, 3])
    # `None` for the weights: the fit is left as it is
    assert reweighted(None, lambda fit: None, 'start', 3) == ('start', None)
    assert reweighted(lambda w: w, lambda fit: fit + 1 if fit < 2 else None, 0, 9) == (2, 2)
    assert reweighted(lambda w: w, lambda fit: fit + 1, 0, 9, lambda new, old: new == 4)[0] == 4


def test_steps_with_the_matrix_of_another_place_do_not_run_away():
    """Where an iteration has gone far, the matrix of the place before leads nowhere."""
    rng = np.random.default_rng(3)
    rows, noise = rng.normal(size=(3, 80)), 1e-6
    b = np.array([1e-3, -2e-3, 5e-4]) @ rows + noise * rng.normal(size=80)
    far = 1e9 * np.linalg.inv(rows @ rows.T)
    rounds = Rounds(rows, b, None, 1e-12, far)
    scales = rounds.find_noise(3)
    assert scales == pytest.approx([noise, noise], rel=0.3)
    np.testing.assert_allclose(rounds.p, [1e-3, -2e-3, 5e-4], rtol=0, atol=1e-6)


@pytest.mark.parametrize('many', [False, True])
def test_an_approach_with_a_matrix_of_another_place_does_not_run_away(monkeypatch, many):
    if many:
        monkeypatch.setattr(robust_weights, 'MANY', 0)
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(3, 2000))
    b = 1e-6 * (np.array([1.0, -2.0, 0.5]) @ rows + rng.normal(size=2000))
    far = 30.0 * np.linalg.inv(rows @ rows.T)
    rounds = (RoundsOfMany if many else Rounds)(rows, b, None, 1e-12, far)
    rounds.approach([1e-6, 1e-6])
    np.testing.assert_allclose(rounds.p, [1e-6, -2e-6, 5e-7], rtol=0, atol=3e-7)


@pytest.mark.parametrize('given', [False, True])
def test_newtons_rounds_end_where_the_plain_ones_do(monkeypatch, given):
    rng = np.random.default_rng(4)
    rows, noise = rng.normal(size=(3, 80)), 1e-6 * np.repeat([1.0, 2.0], 40)
    b = np.array([1e-3, -2e-3, 5e-4]) @ rows + noise * rng.normal(size=80)
    b[:4] += 30e-6
    base = 1.0 / np.square(noise) if given else None
    found, steps = [], []
    by_newton = Rounds.by_newton
    monkeypatch.setattr(Rounds, 'by_newton', lambda *args: steps.append(1) or by_newton(*args))
    for most in (0, 400):
        monkeypatch.setattr(robust_rounds, '_NEWTON', most)
        rounds = Rounds(rows, b, base, 1e-12)
        weights = rounds.bisquare(rounds.find_noise(3))
        found.append(np.concatenate((rounds.p * 1e6, weights)))
        assert bool(steps) == bool(most)
    assert (weights[:4] == 0.0).all() and (weights[4:] > 0.0).sum() >= 35
    assert len(steps) <= 5
    np.testing.assert_allclose(*found, rtol=0, atol=1e-7)


@pytest.mark.parametrize('n', [1, 2, 7, 199, 200, 201, 1000, 1001])
def test_the_median_is_numpys_to_the_bit(n):
    values = np.random.default_rng(6).standard_normal((2, n))
    expected = 1.4826 * np.median(np.abs(values), axis=1)
    np.testing.assert_array_equal(sigma_of(values, axis=1), expected)
    assert sigma_of(values[0]) == expected[0]
    values[1, n // 3] = np.nan
    with np.errstate(invalid='ignore'):
        assert np.isnan(sigma_of(values, axis=1)).tolist() == [False, True]


@pytest.mark.parametrize('kind', ['clean', 'outliers', 'heavy tails', 'sigmas'])
def test_many_rows_that_begin_at_a_part_end_where_all_of_them_would(monkeypatch, kind):
    rng = np.random.default_rng(5)
    n = 9000
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.3, 0.98, n))
    noise = rng.normal(size=(2, n)) * ARCSEC
    if kind == 'outliers':
        noise[:, rng.random(n) < 0.1] *= 60.0
    elif kind == 'heavy tails':
        noise = rng.standard_t(2, size=(2, n)) * ARCSEC
    truth = PointingModel({'IA': 0.02, 'IE': -0.01, 'CA': 4e-4, 'NPAE': 2e-4, 'AN': 3e-4,
                           'AW': -2e-4, 'TF': 1e-4})
    x, y = truth.offsets(az, el)
    columns = {'az': az, 'el': el, 'az_enc': az + (x + noise[0]) / np.cos(el),
               'el_enc': el + y + noise[1]}
    if kind == 'sigmas':
        columns['sigma_x'], columns['sigma_y'] = rng.uniform(0.5, 2.0, (2, n)) * ARCSEC
    run = PointingRun(columns)
    begun = fit_terms(run)
    monkeypatch.setattr(gauss_newton, '_MANY', 10**9)
    whole = fit_terms(run)
    sigma = np.sqrt(np.diag(whole.model.covariance))
    assert np.abs((begun.coefficients - whole.coefficients) / sigma).max() < 0.01
    assert np.sqrt(np.diag(begun.model.covariance)) == pytest.approx(sigma, rel=1e-3)
