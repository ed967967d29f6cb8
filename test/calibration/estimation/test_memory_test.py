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

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.estimation.candidate_scores import CandidateBank, CandidateGroup
from calibration.estimation.correlated_noise import Sequence
from calibration.estimation.group_columns import GroupColumns
from calibration.estimation.memory_likelihood import MemorySearch, noise_memory
from calibration.estimation.memory_test import (
    SIMULATIONS,
    TAIL,
    MemoryMask,
    MemoryTest,
    tail_share,
)
from calibration.estimation.selection_problem import SelectionProblem


def largest(rng, nights):
    """Largest of 20 likelihood ratios each."""
    return rng.chisquare(2, (nights, 20)).max(axis=1)


def test_the_tail_is_nearer_to_the_truth_than_the_largest_night():
    rng = np.random.default_rng(1)
    limit = np.quantile(largest(rng, 400_000), 0.995)
    # whether all runs of rows are like these (the tail of a chi square of 2 has an excess of 2.1),
    # or these are a tenth apart from them
    for typical in (2.1, 1.9, 2.3):
        shares = np.array([tail_share(largest(rng, SIMULATIONS), limit, typical)
                           for _ in range(300)])
        assert np.exp(np.log(shares).mean()) == pytest.approx(0.005, rel=0.4)
        assert np.log(shares).std() < 0.4
    counted = np.array([np.mean(largest(rng, SIMULATIONS) >= limit) for _ in range(300)])
    assert np.std(counted) > 3.0 * np.std(shares)


def test_a_share_is_counted_in_the_bulk_and_never_nothing():
    nights = np.arange(1.0, 201.0)
    assert tail_share(nights, 100.5, 20.0) == 0.5
    assert tail_share(nights, 0.0, 20.0) == 1.0
    far = [tail_share(nights, ratio, 20.0) for ratio in (170.0, 200.0, 300.0)]
    assert 0.1 < far[0] < TAIL and far[0] > far[1] > far[2] > 0.0


def test_a_test_made_again_with_known_ratios_has_them():
    """Parts of the rows would else lose what was simulated for all."""
    known, drawn = (MemoryTest(None, None, '', normal, None) for normal in (
        np.arange(3.0), np.zeros((3, 8))))
    assert known.has_simulated and np.array_equal(known.by_chance, np.arange(3.0))
    assert not drawn.has_simulated


def test_without_a_column_of_one_axis_its_noise_alone_is_sought_again():
    rng, n = np.random.default_rng(1), 60
    t = np.arange(float(n))
    sequence = Sequence(t, np.zeros(n, int), np.ones(n))
    line, none = t / n - 0.5, np.zeros(n)
    columns = GroupColumns.alone(np.array([
        np.append(np.ones(n), none), np.append(none, np.ones(n)), np.append(none, line)]))
    b = np.append(np.cumsum(rng.normal(size=n)), 9.0 * line + rng.normal(size=n))
    given = sequence, np.ones(2 * n), np.ones(2)
    every = MemorySearch(*given, columns, b)
    of_all, without = every.noise(), every.noise([2])
    assert without[0] is every.noise()[0] and without[1].gain > of_all[1].gain + 10.0
    anew = noise_memory(*given, GroupColumns.alone(columns.common[:2]), b)
    for one, other in zip(without, anew):
        assert one.gain == pytest.approx(other.gain) and one.memory == pytest.approx(other.memory)


def test_a_choice_that_goes_on_changing_changes_no_mask_of_before():
    """Backward elimination drops of its list before the memory without one of it is sought."""
    rng, n = np.random.default_rng(1), 60
    t, none = np.arange(float(n)), np.zeros(n)
    shapes = np.array([np.append(of, none) for of in (t / n - 0.5, np.sin(t))])
    bank = CandidateBank([SimpleNamespace(
        coefficient_names=('c',), line=name, scan=None, scanned=0, size=None, share='dictionary')
        for name in 'ab'], shapes)
    problem = SelectionProblem(
        GroupColumns.alone(np.eye(2).repeat(n, axis=1)), np.append(np.cumsum(
            rng.normal(size=n)), rng.normal(size=n)) + 90.0 * shapes[1],
        None, bank, CandidateBank.empty(n), Sequence(t, np.zeros(n, int), np.ones(n)))
    for without in (0, 1):
        chosen, found = [CandidateGroup(0), CandidateGroup(1)], []
        for dropped in (None, *chosen):
            problem = problem.trusting(None, ())  # nothing is known
            now = list(chosen)
            beside = problem.plain.fit(now)
            mask = MemoryMask.of(problem, now, bank, problem.plain.fit(
                now, beside.weights, without), without, beside)
            if dropped is not None:
                now.remove(dropped)
            found.append(mask.fit.memory)
        assert found[0][0].variance > 0.0 and found[1:] == found[:1] * 2
