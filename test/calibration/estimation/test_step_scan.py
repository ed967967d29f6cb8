import numpy as np
import pytest

from calibration.estimation.step_scan import (
    clipped,
    evidence,
    log_normal,
    probabilities,
    robust_fit,
    scan,
)


def line(n=60):
    return np.column_stack([np.ones(n), np.linspace(-1.0, 1.0, n)])


def test_robust_fit_tells_its_own_errors():
    rng = np.random.default_rng(4)
    design, true = line(), np.array([3.0, -2.0])
    fits = [robust_fit(design, design @ true + rng.normal(size=60)) for _ in range(400)]
    pulls = np.array([(f.coefficients - true) / np.sqrt(np.diag(f.covariance)) for f in fits])
    assert np.abs(pulls.mean(axis=0)).max() < 0.2
    assert pulls.std(axis=0) == pytest.approx([1.0, 1.0], abs=0.1)
    assert np.mean([f.scatter for f in fits]) == pytest.approx(1.0, abs=0.05)


def test_outliers_do_not_pull():
    rng = np.random.default_rng(5)
    y = line() @ [3.0, -2.0] + rng.normal(size=60)
    y[::12] += 1000.0
    fit = robust_fit(line(), y)
    assert fit.coefficients == pytest.approx([3.0, -2.0], abs=1.0)
    assert np.abs(clipped(line(), y)).max() < 20.0
    assert clipped(line(), y)[1:12] == pytest.approx(y[1:12], abs=3.0)


def test_dependent_columns_share_and_too_few_rows_are_refused():
    twice = np.column_stack([np.ones(20), np.ones(20)])
    fit = robust_fit(twice, np.full(20, 4.0))
    assert fit.coefficients == pytest.approx([2.0, 2.0]) and (fit.freedom == 19).all()
    with pytest.raises(ValueError, match='observe more'):
        robust_fit(np.eye(2), np.ones(2))


def test_scan_finds_the_step_with_its_size():
    rng = np.random.default_rng(6)
    columns = np.tri(60)[:, 3:-3][::-1]  # steps down, at every place
    y = line() @ [3.0, -2.0] + rng.normal(size=60) + 5.0 * columns[:, 20]
    found = scan(line(), y, columns)
    best = int(np.argmin(found.probability))
    assert abs(best - 20) <= 1
    assert found.amount[20] == pytest.approx(5.0, abs=3.0 * found.sigma[20])
    assert found.probability[best] < 1e-8


def test_scan_by_chance_is_uniform_and_what_is_there_already_is_none():
    rng = np.random.default_rng(7)
    column = (np.arange(25) > 11).astype(float)[:, None]
    p = [scan(line(25), rng.normal(size=25), column).probability[0] for _ in range(2000)]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.015)
    assert scan(line(25), rng.normal(size=25), line(25)).probability == pytest.approx([1.0, 1.0])


def test_evidence_is_the_marginal_likelihood():
    rng = np.random.default_rng(8)
    design, prior, noise = rng.normal(size=(7, 2)), np.array([2.0, 0.5]), 0.3
    y = rng.normal(size=7)

    def direct(columns, widths):
        covariance = noise**2 * np.eye(7) + (columns * widths**2) @ columns.T
        return -0.5 * (y @ np.linalg.solve(covariance, y) + np.linalg.slogdet(covariance)[1])
    difference = evidence(design, y, noise, prior) - evidence(design[:, :1], y, noise, prior[:1])
    assert difference == pytest.approx(
        direct(design, prior) - direct(design[:, :1], prior[:1]))


def test_probabilities_are_of_the_logs():
    assert probabilities({'a': 1000.0, 'b': 1000.0 + np.log(3.0)}) == pytest.approx(
        {'a': 0.25, 'b': 0.75})
    assert log_normal(2.0, 4.0) == pytest.approx(-0.5 - 0.5 * np.log(8.0 * np.pi))
