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

"""Least squares with priors, and noise that groups of rows share."""

import numpy as np
import pytest

from calibration.estimation.correlated_noise import AxisNoise, CorrelatedNoise, Sequence
from calibration.estimation.noise_by_group import group_roots, likely_noises
from calibration.estimation.prior_fit import MixedFit, PriorFit, gram_of


def test_without_a_prior_it_is_least_squares():
    rng = np.random.default_rng(1)
    columns, p = rng.normal(size=(3, 40)), np.array([1.0, -2.0, 0.5])
    b = p @ columns + 0.1 * rng.normal(size=40)
    fit = PriorFit(gram_of(columns, b), 40, np.zeros((3, 3)))
    plain, left, *_ = np.linalg.lstsq(columns.T, b, rcond=None)
    np.testing.assert_allclose(fit.coefficients, plain, atol=1e-10)
    assert fit.square == pytest.approx(left[0]) and fit.determined
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(columns @ columns.T), atol=1e-12)


def test_a_prior_is_a_row_more():
    rng = np.random.default_rng(2)
    columns, b = rng.normal(size=(2, 10)), rng.normal(size=10)
    known = PriorFit(gram_of(columns, b), 10, np.diag([0.0, 4.0]), np.array([0.0, 3.0]))
    row = np.array([[0.0], [2.0]])
    more = PriorFit(gram_of(np.hstack((columns, row)), np.append(b, 6.0)), 11, np.zeros((2, 2)))
    np.testing.assert_allclose(known.coefficients, more.coefficients)
    assert known.square == pytest.approx(more.square)


def test_what_nothing_is_known_of_is_not_determined():
    columns = np.vstack((np.ones(5), np.ones(5)))
    fit = PriorFit(gram_of(columns, np.ones(5)), 5, np.zeros((2, 2)))
    assert not fit.determined and fit.sigma[0] > 1e3 * fit.alone[0]


def test_a_mixture_is_as_wide_as_its_fits_differ():
    gram = gram_of(np.ones((1, 4)), np.zeros(4))
    other = gram_of(np.ones((1, 4)), np.full(4, 3.0))
    mixed = MixedFit([PriorFit(one, 4, np.zeros((1, 1))) for one in (gram, other)], (0.5, 0.5))
    assert mixed.coefficients[0] == pytest.approx(1.5)
    assert mixed.covariance[0, 0] == pytest.approx(0.25 + 1.5**2)


def test_groups_have_their_own_noise_and_share_how_it_remembers():
    rng = np.random.default_rng(3)
    n, step, memory = 400, 10.0, 150.0
    time = np.concatenate((np.arange(n) * step, np.arange(60) * 100.0))
    groups = np.repeat([0, 1], (n, 60))
    cos_el, run = np.ones(n + 60), groups.copy()
    white = np.where(groups == 0, 1.0, 3.0)
    values = white * rng.normal(size=(2, n + 60))
    sequence = Sequence(time[:n], run[:n], cos_el[:n])
    process = CorrelatedNoise(np.full(2 * n, 1e6), sequence, (AxisNoise(2.0, memory),) * 2)
    values[:, :n] += process.coloured(rng.normal(size=2 * n)).reshape(2, n)
    columns = np.kron(np.eye(2), np.ones(n + 60))
    b = values.ravel()
    root, weights = group_roots(columns, b, groups, time, run, cos_el, (True, False))
    assert (weights > 0.0).mean() > 0.95
    sigmas = 1.0 / root.reshape(2, -1)[0]
    assert np.median(sigmas[:n]) == pytest.approx(1.0, rel=0.25)
    assert np.median(sigmas[n:]) == pytest.approx(3.0, rel=0.3)
    rows = np.flatnonzero(groups == 0)
    noises = likely_noises(columns, b, np.zeros((2, 2)), root, rows,
                           Sequence(time[rows], run[rows], cos_el[rows]))
    assert sum(chance for _, chance in noises) == pytest.approx(1.0)
    best = noises[0][0].process
    assert best is not None and 40.0 < best.memory[0].memory < 600.0
    # no memory in rows that have none
    b[:] = (white * rng.normal(size=(2, n + 60))).ravel()
    noises = likely_noises(columns, b, np.zeros((2, 2)), root, rows,
                           Sequence(time[rows], run[rows], cos_el[rows]))
    assert noises[0][0].process is None
