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

"""Candidates of a run: what a part of the rows has refined is used there, and nowhere else."""

import numpy as np
import pytest
from simulated import night

from calibration.analysis.diagnosis.base_terms import Base
from calibration.analysis.diagnosis.observations import observations
from calibration.analysis.diagnosis.run_problem import RunProblem
from calibration.estimation.candidate_scores import CandidateGroup
from calibration.estimation.correlated_noise import WhiteNoise
from calibration.estimation.folds import predicted
from msg_tools.units import ARCSEC
from pointing_model.effects import effect

N = 60
TEST = np.arange(0, N, 5)


@pytest.fixture
def problem():
    # a wave of some 100 periods a turn over an hour, and scans of every kind
    return RunProblem(observations(night(3, N)), Base.parse('physical'), 0.01).problem


def left_by(problem, part, one):
    """What a part's own choice leaves of the rows beside it, arcsec."""
    root = WhiteNoise(np.ones(2 * part.n))
    return float(np.abs(predicted(problem, part, [one], root, TEST)).max() / ARCSEC)


def test_a_fold_is_predicted_with_the_place_that_it_has_found(problem):
    bank = problem.dictionary
    g = next(k for k, e in enumerate(bank.effects) if e.name == 'track_bump')
    moved = effect('track_bump', **bank.effects[g].parameters | {
        'centre': bank.effects[g].parameters['centre'] + 0.03})
    problem.b = 50.0 * ARCSEC * problem.variants.columns(moved)[0]
    part = problem.part(np.setdiff1d(np.arange(N), TEST))
    assert left_by(problem, part, CandidateGroup(g)) > 1.0
    part.replace(g, moved, part.variants.columns(moved))
    assert left_by(problem, part, CandidateGroup(g)) < 1e-6


def test_a_fold_is_predicted_with_the_period_that_it_has_found(problem):
    g, scan = 40, problem.periods.scans[0]
    rate = float(problem.periods.rate[g]) + 0.3 * scan.step
    problem.b = 50.0 * ARCSEC * scan.waves(np.array([rate]), np.zeros(1))[0]
    part, one = problem.part(np.setdiff1d(np.arange(N), TEST)), CandidateGroup(g, period=True)
    assert left_by(problem, part, one) > 1.0
    part.tune(g, rate)
    assert left_by(problem, part, one) < 1e-6


def test_a_fold_begins_with_the_places_that_were_offered(problem):
    bank, rows = problem.dictionary, np.arange(N // 2)
    g = next(k for k, e in enumerate(bank.effects) if e.name == 'flop')
    offered, columns = bank.effects[g], bank.of(g).copy()
    near = problem.finer(g)
    problem.replace(g, near.effects[0], near.of(0))
    problem.tune(40, 77.0)
    part = problem.part(rows)
    assert part.dictionary.effects[g] is offered and part.periods.rate[40] != 77.0
    assert np.array_equal(part.dictionary.of(g), columns[:, np.r_[rows, rows + N]])
    # what rests on the choice of all rows keeps their places
    kept = problem.rows(rows)
    assert kept.dictionary.effects[g] is near.effects[0] and kept.periods.rate[40] == 77.0
