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

"""Alternatives to a found effect are compared in models of their own."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from simulated import make_problem

from calibration.analysis.diagnosis.alternatives import (
    AlternativeModel,
    _take_in,
    compare_alternatives,
    repeated_choice,
)
from calibration.analysis.diagnosis.diagnosis_result import verdict_of
from calibration.analysis.diagnosis.effect_causes import diagnosed_effect
from calibration.estimation.candidate_scores import CandidateBank, CandidateGroup
from calibration.estimation.chance import Chance
from calibration.estimation.correlated_noise import WhiteNoise
from calibration.estimation.equal_causes import SET_WIDTH
from calibration.estimation.select import choose
from calibration.estimation.significance import Significance
from msg_tools.units import ARCSEC
from pointing_model.effects import Effect
from pointing_model.fitted_effects import FittedEffect

SEEDS = range(4)
NAMES = ('bent axis', 'scale', 'helper of the bent axis', 'helper of the scale')
N = 100


def problem_of(seed, spoilt=0.0, helped=True, size=40.0):
    """Rows that a bent axis and its helper explain, and as well a scale and a helper of its own.

    The scale resembles the bent axis (correlation 0.97), and the sum more than the bent axis does,
    so it is found first. `spoilt`: part of the scale's helper that is something else; `helped`:
    whether the helper of the bent axis is a candidate.
    """
    rng = np.random.default_rng(seed)
    problem = make_problem(seed, N)
    basis = problem.base.basis(WhiteNoise(np.ones(2 * N)))

    def unit(row, *others):
        row = basis.off(row)
        for other in others:
            row = row - (row @ other) * other
        return row / np.linalg.norm(row)

    bent = unit(rng.normal(size=2 * N))
    helper = unit(rng.normal(size=2 * N), bent)
    aside = unit(rng.normal(size=2 * N), bent, helper)
    scale = 0.97 * bent + np.sqrt(1.0 - 0.97**2) * (0.7 * helper + np.sqrt(0.51) * aside)
    signal = size * unit(bent + 0.3 * helper)
    others = [unit(row) for row in rng.normal(size=(12, 2 * N))]
    left = unit(signal - (signal @ scale) * scale)
    its_helper = np.sqrt(1.0 - spoilt) * left + np.sqrt(spoilt) * unit(
        others[0], left, scale, bent, helper)
    columns = np.array([bent, scale, helper if helped else unit(rng.normal(size=2 * N), helper),
                        its_helper, *others[1:]])
    effects = [Effect(name, name, '', 'azimuth', 'both', ('size',), None) for name in (
        *NAMES[:2], *(NAMES[k] for k in (2, 3)), *(f'something {k}' for k in range(1, 12)))]
    b = (rng.normal(size=2 * N) + signal) * ARCSEC
    return replace(problem, dictionary=CandidateBank(effects, columns), b=b, variants=None)


def names_of(problem, groups):
    return {problem.dictionary.effects[g].name for g in groups}


def found_of(problem, chosen):
    return {c.effect(problem).name for c in chosen.chosen}


def told(problem, chosen, i):
    e, stand = chosen.chosen[i].effect(problem), chosen.significances[i]
    return diagnosed_effect(FittedEffect(e, np.ones(1)), stand, None, problem.dictionary.effects,
                            chosen.chosen[i].group)


def model_of(problem, chance):
    return compare_alternatives(problem, choose(problem, 0.01, chance), 0.01, chance)


@pytest.mark.parametrize('seed', SEEDS)
def test_an_alternative_with_effects_of_its_own_is_an_equal(seed):
    problem, chance = problem_of(seed), Chance(N, 199, np.random.default_rng(seed))
    alone = choose(problem, 0.01, chance)
    assert found_of(problem, alone) == {NAMES[1], NAMES[3]}
    lead = [c.effect(problem).name for c in alone.chosen].index(NAMES[1])
    # with the companion that was chosen for the other it is far behind
    assert alone.significances[lead].every[0] < alone.significances[lead].delta_bic - SET_WIDTH
    assert NAMES[0] not in names_of(problem, alone.significances[lead].equals)
    both = model_of(problem, chance)
    assert found_of(problem, both) == {NAMES[1], NAMES[3]} and not both.replaced
    stand = both.significances[lead]
    assert NAMES[0] in names_of(problem, stand.equals)
    assert abs(stand.every[0] - stand.delta_bic) < SET_WIDTH
    assert [c.effect(problem).name for c in stand.others[0]] == [NAMES[2]]
    assert [verdict_of([told(problem, one, lead)]) for one in (alone, both)] == [
        'identified', 'ambiguous']


def test_a_better_model_is_taken():
    wrong = 0
    for seed in range(6):
        problem, chance = problem_of(seed, 0.4), Chance(N, 199, np.random.default_rng(seed))
        alone = found_of(problem, choose(problem, 0.01, chance))
        better = model_of(problem, chance)
        assert found_of(problem, better) == {NAMES[0], NAMES[2]}
        assert bool(better.replaced) == (NAMES[1] in alone)
        # so does each part of the rows that finds the other one: alternatives are searched once
        again = repeated_choice(better)(problem, 0.01, chance)
        assert found_of(problem, again) == found_of(problem, better)
        assert not any(stand.others for stand in better.significances)
        wrong += bool(better.replaced)
    assert wrong >= 2


@pytest.mark.parametrize('seed', SEEDS)
def test_an_alternative_that_nothing_helps_stays_behind(seed):
    problem = problem_of(seed, helped=False)
    one, other = (how(problem, Chance(N, 199, np.random.default_rng(seed)))
                  for how in (lambda p, c: choose(p, 0.01, c), model_of))
    assert found_of(problem, one) == found_of(problem, other) == {NAMES[1], NAMES[3]}
    assert not any(stand.others or stand.equals for stand in other.significances)


def test_a_better_model_with_more_effects_is_beside_the_found_one_and_no_more():
    def model(*groups):
        return SimpleNamespace(chosen=[CandidateGroup(g) for g in groups])
    stand = Significance(0.001, 87.0, [], [], np.array([87.0, 40.0, 30.0, 20.0]))
    chosen = SimpleNamespace(significances=[stand], chosen=model(0).chosen)
    _take_in(chosen, 0, [AlternativeModel(CandidateGroup(groups[0]), model(*groups), behind)
                         for groups, behind in (((1, 4, 5), -161.0), ((2,), 3.0), ((3, 4), 20.0))])
    assert stand.equals == [1, 2] and stand.every.tolist() == [87.0, 87.0, 84.0, 67.0]
    assert stand.larger == {1: (2, 161.0)}
    assert stand.others[1] == [CandidateGroup(4), CandidateGroup(5)]
