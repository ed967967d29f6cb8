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

"""Zeros of groups in closed form, against the columns that they stand for."""

import numpy as np
import pytest
from scipy.special import stdtr

from calibration.analysis.term_fit import fit_harmonics, fit_terms
from calibration.estimation import least_squares
from calibration.estimation.group_columns import GroupColumns
from calibration.estimation.least_squares import weighted_solve
from calibration.estimation.step_scan import (
    LocalColumns,
    clipped,
    detect,
    neighbour_noise,
    probabilities_by_chance,
    robust_fit,
)
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun

RUNS, ROWS = 30, 8
RUN = np.repeat(np.arange(RUNS), ROWS)
N = len(RUN)


def simulated(seed=1):
    """A design with a column that depends on others, and rows with outliers and a step."""
    rng = np.random.default_rng(seed)
    rest = rng.normal(size=(N, 4))
    rest[:, 3] = 2.0 * rest[:, 0] + 3.0 * (RUN == 5)
    design = GroupColumns.of(RUN, rng.uniform(0.5, 1.0, (1, N)), rest.T)
    y = whole(design) @ rng.normal(0.0, 5.0, len(design)) + rng.normal(size=N)
    y[::31] += 100.0
    return design, y, 6.0 * (np.arange(N) >= 12 * ROWS + 4) * (RUN == 12)


def whole(design):
    """The columns themselves, shape (n, k)."""
    return np.asarray(design).T


def moves():
    steps = np.tri(ROWS)[:, 2:-2]
    blocks = [(np.flatnonzero(run == RUN), steps) for run in range(RUNS)]
    return LocalColumns(N, blocks, [(run, n) for run in range(RUNS) for n in range(steps.shape[1])])


def test_robust_fits_are_those_of_all_columns():
    design, y, _ = simulated()
    own, full = (robust_fit(one, y) for one in (design, whole(design)))
    assert own.residual == pytest.approx(full.residual, abs=1e-5)
    assert own.scatter == pytest.approx(full.scatter, rel=1e-6) and own.rank == full.rank
    # what the others determine; of those that depend on each other the sum alone is known
    assert own.coefficients[1:3] == pytest.approx(full.coefficients[1:3], rel=1e-6)
    assert own.covariance[1:3, 1:3] == pytest.approx(full.covariance[1:3, 1:3], rel=1e-6)
    assert clipped(design, y) == pytest.approx(clipped(whole(design), y), abs=1e-8)


def alone(design):
    """The same columns, none of them of a group."""
    return GroupColumns.alone(np.asarray(design))


def test_what_moved_is_found_as_by_all_columns():
    design, y, step = simulated(3)
    y = y + 3.0 * step
    p = probabilities_by_chance(design, y, moves(), 0.0)
    columns = whole(design)
    for place in (10, 12 * 5 + 2, 100):
        full = np.column_stack([columns, moves().column(place)])
        rank = np.linalg.matrix_rank(full)
        rss, less = (np.sum(np.square(y - one @ np.linalg.lstsq(one, y, rcond=1e-7)[0]))
                     for one in (full, columns))
        t = np.sqrt((less - rss) / rss * (N - rank))
        assert p[place] == pytest.approx(2.0 * stdtr(N - rank, -t), rel=1e-6)
    found = detect(design, y, moves(), 0.01, RUN, 0.0)
    assert moves().labels[found.place][0] == 12
    assert found.amount == pytest.approx(18.0, abs=4.0 * found.sigma)
    assert moves().column(found.place) == pytest.approx(moves().dense()[:, found.place])


def test_noise_of_groups_is_that_of_all_columns():
    design, y, _ = simulated(4)
    y[::31] -= 100.0
    for k in range(1, N):
        y[k] += 0.5 * y[k - 1] * (RUN[k] == RUN[k - 1])
    own, full = (neighbour_noise(one, y, RUN) for one in (design, alone(design)))
    assert own.neighbour == pytest.approx(full.neighbour) and own.neighbour > 0.2
    assert own.memory[0].gain == pytest.approx(full.memory[0].gain, rel=1e-6)
    white = moves().whitened(own).dense()
    assert white == pytest.approx(own.whiten(moves().dense().T).T, abs=1e-9)


def test_a_column_that_depends_on_others_changes_no_likelihood():
    """Rounding leaves a direction of it, which is none."""
    design, y, _ = simulated(5)
    for k in range(1, N):
        y[k] += 0.5 * y[k - 1] * (RUN[k] == RUN[k - 1])
    twice = GroupColumns(design.group, design.own,
                         np.insert(design.common, 1, design.common[0] * np.pi, axis=0))
    assert neighbour_noise(twice, y, RUN).memory[0].gain == pytest.approx(
        neighbour_noise(design, y, RUN).memory[0].gain, abs=1e-6)


def test_products_and_solutions_are_those_of_the_columns():
    rng = np.random.default_rng(5)
    run, n = rng.permutation(np.repeat(np.arange(6), 5)), 30
    columns = GroupColumns.of_runs(rng.normal(size=(3, 2 * n)), run, rng.uniform(0.3, 1.2, n))
    dense, weights = np.asarray(columns), rng.uniform(0.1, 1.0, 2 * n)
    values, p = rng.normal(size=2 * n), rng.normal(size=len(columns))
    assert columns.shape == dense.shape == (13, 60)
    assert columns @ values == pytest.approx(dense @ values)
    assert p @ columns == pytest.approx(p @ dense)
    both = rng.normal(size=(2, len(columns)))
    assert both @ columns == pytest.approx(both @ dense)
    assert columns.normal(weights) == pytest.approx((dense * weights) @ dense.T)
    for one, other in zip(weighted_solve(columns, values, weights, 1e-7),
                          weighted_solve(dense, values, weights, 1e-7)):
        assert one == pytest.approx(other)


def test_a_run_without_any_weight_has_no_zero():
    columns = GroupColumns.of_runs(np.ones((1, 8)), np.array([0, 1, 2, 2]), np.ones(4))
    weights = np.array([1.0, 0.0, 1.0, 1.0] * 2)
    own = weighted_solve(columns, np.arange(8.0), weights, 1e-7)
    full = weighted_solve(np.asarray(columns), np.arange(8.0), weights, 1e-7)
    assert own.rank == full.rank == 3
    assert own.p == pytest.approx(full.p)


NIGHTS, STARS = 24, 9


def nights(seed=1, sigmas=False):
    rng = np.random.default_rng(seed)
    run = np.repeat(np.arange(1.0, NIGHTS + 1), STARS)
    az, el = rng.uniform(0.0, 360.0, len(run)) * DEG, rng.uniform(20.0, 75.0, len(run)) * DEG
    model = PointingModel({'CA': 80.0 * ARCSEC, 'AN': -30.0 * ARCSEC, 'TF': 20.0 * ARCSEC})
    az_enc, el_enc = model.sky_to_encoder(az, el)
    zeros = rng.normal(0.0, 20.0, (2, NIGHTS)) * ARCSEC
    night, noise = run.astype(int) - 1, rng.normal(0.0, 1.0, (2, len(run))) * ARCSEC
    noise[:, ::50] *= 40.0
    columns = {'az': az, 'el': el, 'run': run,
               'az_enc': az_enc + zeros[0, night] + noise[0] / np.cos(el),
               'el_enc': el_enc + zeros[1, night] + noise[1]}
    if sigmas:
        columns.update(sigma_x=rng.uniform(0.5, 2.0, len(run)) * ARCSEC,
                       sigma_y=rng.uniform(0.5, 2.0, len(run)) * ARCSEC)
    return PointingRun(columns)


@pytest.mark.parametrize('make', [
    lambda: fit_terms(nights(), run_zeros=True),
    lambda: fit_terms(nights(2, sigmas=True), run_zeros=True, robust=False),
    lambda: fit_terms(nights(3), run_zeros=True, geometry='first_order'),
    lambda: fit_harmonics(nights(4), run_zeros=True),  # a direction is not determined
])
def test_fits_are_those_with_all_columns(make, monkeypatch):
    own = make()
    monkeypatch.setattr(least_squares, '_solve_beside_groups', lambda design, *of: weighted_solve(
        np.asarray(design), *of))
    full = make()
    assert own.names == full.names and own.rank == full.rank
    assert own.coefficients == pytest.approx(full.coefficients, abs=1e-5 * ARCSEC)
    assert own.sigma == pytest.approx(full.sigma, rel=1e-6)
    assert own.correlations == pytest.approx(full.correlations, abs=1e-6)
    assert own.residual_x == pytest.approx(full.residual_x, abs=1e-5 * ARCSEC)
    assert own.weights == pytest.approx(full.weights, abs=1e-7)
    assert own.singular_values == pytest.approx(full.singular_values, rel=1e-6)
    assert own.freedom == pytest.approx(full.freedom, rel=1e-6)
    assert [zero.angles.tolist() for zero in own.zeros.values()] == [
        pytest.approx(zero.angles, abs=1e-5 * ARCSEC) for zero in full.zeros.values()]
