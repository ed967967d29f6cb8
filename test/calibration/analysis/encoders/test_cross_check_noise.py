import numpy as np
import pytest

from calibration.analysis.encoders.cross_check_noise import Colour, colour_of, inflation, strongest
from calibration.estimation.correlated_noise import restricted

N = 80
SERIES = np.zeros(N, int)
BASE = np.column_stack([np.ones(N), np.cos(np.arange(N) * 2.4)])
STEPS = np.array([np.arange(N) >= k for k in range(3, N - 2)], float).T


def ar1(rng, rho, n=N):
    out = rng.normal(size=n)
    for k in range(1, n):
        out[k] = rho * out[k - 1] + np.sqrt(1.0 - rho**2) * out[k]
    return out


def test_whitened_rows_are_white_and_as_noisy_as_before():
    rng = np.random.default_rng(1)
    rows = np.array([ar1(rng, 0.6) for _ in range(2000)]).T
    white = Colour(np.where(np.arange(N) > 0, 0.6, 0.0)).white(rows)
    np.testing.assert_allclose(white.std(axis=1), 1.0, atol=0.08)
    assert abs(np.mean(white[1:] * white[:-1])) < 0.01


def test_restricted_likelihood_is_that_of_the_contrasts():
    # -2 ln L of what is orthogonal to the design, but for ln |X'X|
    rng = np.random.default_rng(2)
    y, rho = rng.normal(size=N), 0.4
    covariance = rho ** np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    free = np.linalg.svd(BASE.T)[2][2:]
    inner = free @ covariance @ free.T
    square = free @ y @ np.linalg.solve(inner, free @ y)
    expected = ((N - 2) * np.log(square / (N - 2)) + np.linalg.slogdet(inner)[1]
                + np.linalg.slogdet(BASE.T @ BASE)[1])
    half = np.linalg.cholesky(covariance)
    value, variance = restricted(np.linalg.solve(half, np.column_stack([BASE, y])),
                                 np.linalg.slogdet(covariance)[1])
    assert value == pytest.approx(expected) and variance == pytest.approx(square / (N - 2))


@pytest.mark.parametrize('rho, limit', [(0.0, 0.15), (0.6, 1.0)])
def test_correlation_is_claimed_where_there_is_one(rho, limit):
    rng = np.random.default_rng(3)
    found = np.array([colour_of(BASE, ar1(rng, rho), SERIES).most for _ in range(60)])
    claimed = np.mean(found > 0.0)
    assert claimed <= limit and (claimed > 0.9 if rho else True)
    if rho:
        # the largest that is likely, so rather too much
        assert 0.6 < np.median(found) < 0.85


def test_chance_is_what_it_says_for_rows_that_resemble_their_neighbours():
    rng = np.random.default_rng(4)
    alarms = sum(strongest(BASE, ar1(rng, 0.6), STEPS, 0.001, SERIES) is not None
                 for _ in range(200))
    assert alarms <= 2
    y = ar1(rng, 0.6) + 8.0 * STEPS[:, 40]
    found = strongest(BASE, y, STEPS, 0.001, SERIES)
    assert abs(found.place - 40) <= 1 and found.amount == pytest.approx(8.0, abs=4 * found.sigma)
    assert strongest(BASE, rng.normal(size=N) + 2.5 * STEPS[:, 30], STEPS, 0.001, SERIES)


def test_the_mean_of_correlated_exposures_is_worse_than_their_scatter_says():
    rng = np.random.default_rng(5)
    rows = np.array([ar1(rng, 0.6, 16) for _ in range(20000)])
    told = np.mean(rows.var(axis=1, ddof=1)) / 16
    assert inflation(0.6, 16) == pytest.approx(np.var(rows.mean(axis=1)) / told, rel=0.05)
    assert inflation(0.0, 16) == inflation(0.6, 1) == 1.0
