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

import numpy as np
import pytest

from calibration.estimation.group_columns import GroupColumns
from calibration.estimation.step_scan import (
    LocalColumns,
    clipped,
    detect,
    evidence,
    log_normal,
    probabilities,
    probabilities_by_chance,
    robust_fit,
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


def one_run(columns):
    """A zero, and columns beside it, of one power-on."""
    return GroupColumns.of(np.zeros(len(columns)), common=columns.T)


def local(columns):
    return LocalColumns(len(columns), [(np.arange(len(columns)), columns)],
                        list(range(columns.shape[1])))


def test_a_step_is_found_with_its_size():
    rng = np.random.default_rng(6)
    columns = np.tri(60)[:, 3:-3]  # at every place
    y = line() @ [3.0, -2.0] + rng.normal(size=60) + 5.0 * columns[:, 20]
    found = detect(one_run(line()[:, 1:]), y, local(columns), 1e-3, np.zeros(60), 0.0)
    assert abs(found.place - 20) <= 1 and found.probability < 1e-6
    assert found.amount == pytest.approx(5.0, abs=3.0 * found.sigma)


def test_chance_is_uniform_and_what_is_there_already_is_none():
    rng = np.random.default_rng(7)
    design, column = one_run(line(25)[:, 1:]), (np.arange(25) > 11).astype(float)[:, None]
    p = [probabilities_by_chance(design, rng.normal(size=25), local(column), 0.0)[0]
         for _ in range(2000)]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.015)
    assert probabilities_by_chance(design, rng.normal(size=25), local(line(25)),
                                   0.0) == pytest.approx([1.0, 1.0])


N = 80
BASE = one_run(np.cos(np.arange(N) * 2.4)[:, None])
STEPS = np.array([np.arange(N) >= k for k in range(3, N - 2)], float).T


def ar1(rng, rho, n=N):
    out = rng.normal(size=n)
    for k in range(1, n):
        out[k] = rho * out[k - 1] + np.sqrt(1.0 - rho**2) * out[k]
    return out


def test_chance_is_what_it_says_for_rows_that_resemble_their_neighbours():
    rng = np.random.default_rng(4)

    def found(y):
        return detect(BASE, y, local(STEPS), 0.001, np.zeros(N), 0.0)
    assert sum(found(ar1(rng, 0.6)) is not None for _ in range(200)) <= 2
    step = found(ar1(rng, 0.6) + 8.0 * STEPS[:, 40])
    assert abs(step.place - 40) <= 1 and step.amount == pytest.approx(8.0, abs=4 * step.sigma)
    assert found(rng.normal(size=N) + 2.5 * STEPS[:, 30])


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
