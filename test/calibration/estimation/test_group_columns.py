"""Zeros of groups in closed form, against the columns that they stand for."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.analysis.encoders import cross_check_noise as witness_noise
from calibration.analysis.encoders.cross_check_noise import (
    Colour,
    colour_of,
    restricted_coloured,
    strongest,
)
from calibration.estimation.group_columns import ByGroup, Moves
from calibration.estimation.step_scan import clipped, robust_fit, scan

RUNS, ROWS = 30, 8
RUN = np.repeat(np.arange(RUNS), ROWS)
N = len(RUN)


def simulated(seed=1):
    """A design with a column that depends on others, and rows with outliers and a step."""
    rng = np.random.default_rng(seed)
    rest = rng.normal(size=(N, 4))
    rest[:, 3] = 2.0 * rest[:, 0] + 3.0 * (RUN == 5)
    design = ByGroup.of(RUN, rng.uniform(0.5, 1.0, N), rest)
    y = design.dense() @ rng.normal(0.0, 5.0, design.width) + rng.normal(size=N)
    y[::31] += 100.0
    return design, y, 6.0 * (np.arange(N) >= 12 * ROWS + 4) * (RUN == 12)


def moves():
    steps = np.tri(ROWS)[:, 2:-2]
    blocks = [(np.flatnonzero(run == RUN), steps) for run in range(RUNS)]
    return Moves(N, blocks, [(run, n) for run in range(RUNS) for n in range(steps.shape[1])])


def test_robust_fits_are_those_of_all_columns():
    design, y, _ = simulated()
    own, whole = (robust_fit(one, y) for one in (design, design.dense()))
    assert own.residual == pytest.approx(whole.residual, abs=1e-8)
    assert own.noise == pytest.approx(whole.noise, rel=1e-9) and own.dof == whole.dof
    # what the others determine; of those that depend on each other the sum alone is known
    assert own.value[1:3] == pytest.approx(whole.value[-3:-1], rel=1e-8)
    assert own.covariance[1:3, 1:3] == pytest.approx(whole.covariance[-3:-1, -3:-1], rel=1e-8)
    assert clipped(design, y) == pytest.approx(clipped(design.dense(), y), abs=1e-8)


def test_candidates_by_group_are_those_of_all_rows():
    design, y, step = simulated(2)
    for one, other in zip(scan(design, y + step, moves()),
                          scan(design.dense(), y + step, moves().dense())):
        assert one == pytest.approx(other, rel=1e-7, abs=1e-12)


def test_what_moved_is_found_alike():
    design, y, step = simulated(3)
    y = clipped(design, y)
    found, whole = (strongest(base, y + 3.0 * step, steps, 0.01, RUN) for base, steps in (
        (design, moves()), (design.dense(), moves().dense())))
    assert moves().about[found.place][0] == 12 and found.place == whole.place
    assert found[1:] == pytest.approx(whole[1:], rel=1e-7)
    assert moves().column(found.place) == pytest.approx(moves().dense()[:, found.place])


def test_likelihoods_of_correlated_rows_are_those_of_all_columns():
    design, y, _ = simulated(4)
    rho = np.where(np.arange(N) % ROWS, 0.6, 0.0)
    own, whole = (restricted_coloured(one, y, rho) for one in (design, design.dense()))
    assert own == pytest.approx(whole, rel=1e-9)
    white = moves().white(Colour(rho)).dense()
    assert white == pytest.approx(Colour(rho).white(moves().dense()), abs=1e-12)


def test_many_correlations_at_once_are_those_one_by_one(monkeypatch):
    design, y, _ = simulated(6)
    y[1:] += 0.5 * y[:-1]
    rho = np.array([[0.0], [0.3], [0.6]]) * (np.arange(N) % ROWS > 0)
    for one in (design, design.dense()):
        assert restricted_coloured(one, y, rho) == pytest.approx(
            [restricted_coloured(one, y, each) for each in rho], rel=1e-12)
        assert restricted_coloured(one, y, rho[:1]).shape == (1,)
    found = colour_of(design, y, RUN)
    assert found.most > 0.2
    monkeypatch.setattr(witness_noise, '_AT_ONCE', 1)  # each by itself
    assert np.array_equal(colour_of(design, y, RUN).rho, found.rho)


def test_a_column_that_depends_on_others_changes_no_likelihood():
    """Rounding leaves a direction of it, which is none."""
    design, y, _ = simulated(5)
    rho = np.where(np.arange(N) % ROWS, 0.4, 0.0)
    twice = np.insert(design.rest, 1, design.rest[:, 0] * np.pi, axis=1)
    assert restricted_coloured(replace(design, rest=twice), y, rho) == pytest.approx(
        restricted_coloured(design, y, rho), abs=1e-6)


def test_candidates_that_are_wanted():
    some = moves().only(lambda about: about[1] == 1)
    assert len(some) == RUNS and some.column(7) == pytest.approx(
        moves().column(moves().about.index((7, 1))))
