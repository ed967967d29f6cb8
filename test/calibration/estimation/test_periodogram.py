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

"""Waves of unknown period are found beyond the fitted columns, with the right period and shape."""

import numpy as np
import pytest

from calibration.estimation.candidate_scores import CandidateBank
from calibration.estimation.chance import Chance
from calibration.estimation.false_alarms import SHARES
from calibration.estimation.group_columns import GroupColumns
from calibration.estimation.periodogram import SHAPES, PeriodBank, WaveScan, rate_error
from calibration.estimation.select import search
from calibration.estimation.selection_problem import SelectionProblem


class _Effect:
    """What a wave stands for, as the search asks for it."""

    scan, scanned, size, share, axes, driver = 'period', 1, None, 'periods', 'az', 'angle'

    def __init__(self, rate, orders):
        self.rate, self.orders = rate, orders
        self.coefficient_names = ('c',) * (2 * len(orders))


def problem_of(values, angle, low=10.0, high=400.0):
    """Rows of two axes, of which the first may have a wave in the angle; noise of 1."""
    n = len(angle)
    one, zero = np.ones(n), np.zeros(n)
    base = np.array([np.append(one, zero), np.append(zero, one), np.append(angle, zero),
                     np.append(zero, angle)])
    none = CandidateBank.empty(n)
    scans = [WaveScan.over(angle, np.append(*pair), low, high, _Effect)
             for pair in ((one, zero), (zero, one))]
    return SelectionProblem(GroupColumns.alone(base), values.ravel(), None, none, none,
                            periods=PeriodBank(scans))


def rows(seed, n=60):
    rng = np.random.default_rng(seed)
    return rng, rng.uniform(0.0, 3.0, n), rng.normal(size=(2, n))


def found_in(problem, seed=0, flips=1999):
    chance = Chance(problem.n, flips, np.random.default_rng(seed))
    return search(problem, 0.01, chance).chosen


@pytest.mark.parametrize('seed, axis', [(1, 0), (2, 1), (3, 0)])
def test_a_worm_is_found_with_its_period(seed, axis):
    rng, angle, values = rows(seed)
    values[axis] += 2.2 * np.cos(180.0 * angle + rng.uniform(0.0, 6.0))
    problem = problem_of(values, angle)
    chosen, = found_in(problem)
    bank = problem.periods
    assert chosen.period and bank.line[chosen.group] == axis
    assert SHAPES[chosen.group // bank.count] == (1,)
    fit = problem.plain.fit([])
    error = rate_error(fit, bank.scans[axis], bank.rate[chosen.group], (1,))
    assert 0.02 < error < 0.2
    assert abs(bank.rate[chosen.group] - 180.0) < 4.0 * error


def test_a_further_search_has_only_waves_that_the_first_has_found():
    """What shows beside an alternative alone is as much noise that it has left."""
    rng, angle, values = rows(3)
    values[0] += 6.0 * np.cos(180.0 * angle)
    problem, chance = problem_of(values, angle), Chance(60, 1999, rng)
    assert not search(problem, 0.01, chance.for_alternatives()).chosen
    found = search(problem, 0.01, chance).chosen
    chance.simulate(problem, found)
    assert found and search(problem, 0.01, chance.for_alternatives()).chosen == found


def test_noise_has_no_period():
    found = 0
    for seed in range(20):
        _, angle, values = rows(seed + 100)
        found += len(found_in(problem_of(values, angle), flips=999))
    # a share of 0.0015 of runs
    assert found == 0 and sum(SHARES.values()) < 1.29


def test_harmonics_come_with_their_fundamental_which_may_be_the_smaller():
    rng, angle, values = rows(4, 90)
    values[0] += 1.2 * np.cos(100.0 * angle) + 4.0 * np.cos(200.0 * angle + 1.0)
    problem = problem_of(values, angle)
    chosen, = found_in(problem)
    assert SHAPES[chosen.group // problem.periods.count] == (1, 2)
    assert problem.periods.rate[chosen.group] == pytest.approx(100.0, abs=0.2)


@pytest.mark.parametrize('size, rate', [(4.0, 50.0), (12.0, 51.3)])
def test_even_steps_have_aliases(size, rate):
    """Of a strong wave as well, of which half the gain may be lost between two rates."""
    rng, _, values = rows(5)
    angle = np.arange(60) * np.radians(3.0)  # 120 steps a turn
    values[0] += size * np.cos(rate * angle)
    problem = problem_of(values, angle, high=110.0)
    chosen, = found_in(problem)
    one = problem.periods.rate[chosen.group]
    others = problem.periods.aliases(problem.plain.fit([]), chosen.group, 6.0)
    assert sorted([one, *others]) == pytest.approx([rate, 120.0 - rate], abs=0.5)
    rng, angle, _ = rows(5)
    values[0] = rng.normal(size=60) + 4.0 * np.cos(50.0 * angle)
    problem = problem_of(values, angle, high=110.0)
    chosen, = found_in(problem)
    assert not len(problem.periods.aliases(problem.plain.fit([]), chosen.group, 6.0))


def test_columns_are_made_as_they_are_asked_for():
    _, angle, values = rows(6)
    bank = problem_of(values, angle).periods
    columns = np.asarray(bank.columns)
    g = 2 * bank.count + 7  # three orders
    assert bank.of(g).shape == (6, 120)
    assert np.allclose(bank.of(g), columns[bank.starts[g]:bank.starts[g] + 6])
    rate = bank.rate[g]
    assert np.allclose(bank.of(g)[2, :60], np.cos(2.0 * rate * angle))
    assert np.allclose(bank.of(g)[5, :60], np.sin(3.0 * rate * angle))
    part = bank.rows(np.arange(10))
    part.tune(g, 99.0)
    assert part.of(g).shape == (6, 20) and bank.rate[g] == rate
    # a travel that has no full period shows none
    assert WaveScan.over(angle[:1], np.ones(2), 10.0, 100.0, _Effect) is None


def test_columns_of_a_tuned_wave_are_those_of_its_new_rate():
    _, angle, values = rows(7)
    bank = problem_of(values, angle).periods
    g = bank.count // 3
    before = bank.of(g)
    bank.tune(g, bank.rate[g] + 0.5)
    assert np.allclose(bank.of(g)[0, :60], np.cos(bank.rate[g] * angle))
    assert not np.allclose(bank.of(g), before)


def test_rows_at_even_steps_do_not_show_a_rate_that_is_as_none():
    rng = np.random.default_rng(1)
    rates, factor = np.array([624.0, 624.02, 635.0, 15.5, 633.4]), np.ones(192)
    even = np.repeat(np.arange(12) * np.pi / 6.0, 8)
    for angle, seen in ((even, [False, False, False, True, True]),
                        (rng.uniform(0.0, 2.0 * np.pi, 96), [True] * 5)):
        scan = WaveScan.over(angle, factor, 10.0, 1000.0, None)
        assert scan.seen(rates).tolist() == seen
        tried = PeriodBank([scan]).shares['periods']
        near = scan.rates[tried]
        assert (np.abs(near - 624.0).min() < 0.5) == seen[0] and np.abs(near - 630.0).min() < 0.5
    # eighty rows at even steps of a short driver: 2.4 waves within them, fewer than are searched
    short = WaveScan.over(np.linspace(0.0, 0.5, 80), factor[:160], 10.0, 1000.0, None)
    alias = 2.0 * np.pi * 79.0 / 0.5 - np.array([2.4, 5.0]) * 2.0 * np.pi / 0.5
    assert short.seen(alias).tolist() == [False, True]
