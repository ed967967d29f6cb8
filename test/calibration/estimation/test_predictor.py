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

from calibration.estimation.folds import contiguous_folds
from calibration.estimation.predictor import (
    DIRECT,
    SLOW,
    STEP,
    PredictionProblem,
    predictor,
    rows_left_out,
)
from calibration.estimation.shrinkage import Beyond, chosen, shrunk

_ROWS = 80


def problem(rng, effect=0.0, step=0.0, walk=0.0, n=_ROWS):
    """Two zeros; waves of a direction on both axes; steps and slow changes of both zeros."""
    at, time = rng.uniform(0.0, 2.0 * np.pi, n), np.linspace(0.0, 1.0, n)
    nothing, one = np.zeros(n), np.ones(n)

    def both(column):
        return [np.concatenate((column, nothing)), np.concatenate((nothing, column))]

    waves = [c for k in range(1, 9) for f in (np.sin, np.cos) for c in both(np.sqrt(2) * f(k * at))]
    jumps = [c for t in np.linspace(0.1, 0.9, 16) for c in both(1.0 * (time > t))]
    knots = np.linspace(0.0, 1.0, 20)
    lower = np.linalg.cholesky(np.exp(-20.0 * np.abs(knots[:, None] - knots)))
    slow = np.linalg.solve(lower, np.exp(-20.0 * np.abs(time - knots[:, None])))
    slow = [both(row)[axis] for axis in (0, 1) for row in slow]
    kind = np.repeat([DIRECT, STEP, SLOW], [len(waves), len(jumps), len(slow)])
    axis = np.repeat([0, 1], 20)
    b = rng.normal(size=2 * n) + effect * (waves[4] + waves[7]) + step * both(time > 0.5)[0]
    b += walk * np.tile(np.cumsum(rng.normal(size=n)) / np.sqrt(n), 2)
    return PredictionProblem(np.array(both(one)), np.array(waves + jumps + slow), kind,
                             np.concatenate((np.zeros(len(waves + jumps), int), axis)), b, None,
                             time, np.arange(n))


def rms(residual):
    return float(np.sqrt(np.mean(np.square(residual))))


def test_rows_without_a_fold_give_what_they_give_alone():
    rng = np.random.default_rng(0)
    columns, weights, rows = rng.normal(size=(9, 40)), rng.uniform(0.5, 2.0, 40), np.ones(20)
    folds = [np.arange(5), np.arange(9, 14)]
    together = Beyond.of(columns, 2, weights, rows, folds)
    for i, fold in enumerate(folds, 1):
        keep = np.setdiff1d(np.arange(20), fold)
        both = np.concatenate((keep, keep + 20))
        alone = Beyond.of(columns[:, both], 2, weights[both], rows[keep])
        np.testing.assert_allclose(together.normal[i], alone.normal[0], atol=1e-10)
        np.testing.assert_allclose(together.right[i], alone.right[0], atol=1e-10)
        assert together.rows[i] == alone.rows[0] == 15
        np.testing.assert_allclose(chosen(together, np.ones(6, bool), 1.0)[i],
                                   chosen(alone, np.ones(6, bool), 1.0)[0], atol=1e-10)
        np.testing.assert_allclose(shrunk(together, np.zeros(6, int), 5).coefficients[i],
                                   shrunk(alone, np.zeros(6, int), 5).coefficients[0], atol=1e-9)


def test_all_columns_without_a_prior_are_least_squares():
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(6, 60))
    beyond = Beyond.of(columns, 2, np.ones(60), np.ones(30))
    free = np.linalg.lstsq(columns[:-1].T, columns[-1], rcond=None)[0]
    own = np.linalg.solve(beyond.normal[0], beyond.right[0])
    np.testing.assert_allclose(beyond.whole(own[None])[0], free, atol=1e-10)


def test_noise_alone_keeps_the_terms():
    kept = [not predictor(problem(np.random.default_rng(seed))).beyond for seed in range(20)]
    assert sum(kept) >= 17


@pytest.mark.parametrize('what, ratio', [({'effect': 4.0}, 0.4), ({'step': 8.0}, 0.7),
                                         ({'walk': 8.0}, 0.8)])
def test_what_is_beyond_the_terms_is_predicted_in_blocks_not_seen(what, ratio):
    whole = problem(np.random.default_rng(2), **what)
    left, sigma = rows_left_out(whole, contiguous_folds(whole.order, 8))
    assert rms(left[1]) < ratio * rms(left[0])
    within = np.mean(np.abs(left[1]) < sigma)
    assert 0.5 < within < 0.9


def test_an_outlier_moves_nothing():
    whole = problem(np.random.default_rng(3), effect=4.0)
    before = predictor(whole)
    whole = problem(np.random.default_rng(3), effect=4.0)
    whole.b[10] += 1e4
    whole.__post_init__()
    after = predictor(whole)
    assert after.weights[10] == 0.0 < before.weights[10]
    assert rms((after.coefficients - before.coefficients) @ whole.columns[:-1]) < 0.3


def test_shares_are_parts_of_one_and_errors_are_known():
    found = predictor(problem(np.random.default_rng(4), effect=4.0))
    assert found.beyond and sum(found.shares.values()) == pytest.approx(1.0)
    assert found.gain > 2.0 * found.gain_sigma
    assert np.linalg.eigvalsh(found.covariance).min() > -1e-9
    assert 0.8 < found.noise[0] < 1.4
