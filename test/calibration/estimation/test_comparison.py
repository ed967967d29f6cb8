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

from calibration.estimation.comparison import compare_residuals
from calibration.report.fit_wording import comparison_sentence
from msg_tools.units import ARCSEC

RNG = np.random.default_rng(7)


def pair(n, size, seed, corr=0.0):
    """What a right model leaves, and one that is wrong by `size` (RMS) in elevation."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(2, n))
    for i in range(1, n):
        noise[:, i] = corr * noise[:, i - 1] + np.sqrt(1.0 - corr**2) * noise[:, i]
    wrong = np.array([np.zeros(n), size * np.sqrt(2.0) * np.cos(rng.uniform(0, 2 * np.pi, n))])
    return noise * ARCSEC, (noise + wrong) * ARCSEC


def test_a_worse_model_is_seen_and_a_better_one_let_through():
    worse = [compare_residuals(*pair(30, 1.0, seed)) for seed in range(100)]
    assert sum(not found.holds for found in worse) >= 88
    better = [compare_residuals(*pair(30, 1.0, seed)[::-1]) for seed in range(100)]
    assert sum(not found.holds for found in better) <= 3
    assert all(set(found.worse) <= {'el', 'radial'} for found in worse)
    one = worse[0]
    assert one.rows == 30 and '30 new rows: ' in comparison_sentence(one)
    assert one.to_dict()['radial']['after_arcsec'] == one.radial.after


def test_a_harmless_change_is_mostly_let_through_and_none_at_all_always():
    right, wrong = pair(40, 0.5, 3)
    same = compare_residuals(right, right)
    assert same.holds and same.radial.chance == 0.5
    harmless = 0
    for seed in range(200):
        right, wrong = pair(30, 0.6, seed)
        half = 0.5 * (wrong - right)
        harmless += not compare_residuals(right - half, right + half).holds
    assert harmless / 200 < 0.35


def test_less_than_anybody_sees_is_not_worse():
    right, wrong = pair(4000, 0.1, 1)  # 0.25 % of the RMS, far beyond chance
    found = compare_residuals(right, wrong)
    assert found.holds and found.radial.after < 1.01 * found.radial.before


def test_one_wild_row_decides_nothing():
    right, wrong = pair(30, 1.5, 5)
    for places in ((3,), (3, 20)):
        for first, second, holds in ((right, wrong, False), (wrong, right, True)):
            first, second = first.copy(), second.copy()
            for place in places:
                # the wild star would speak for the wrong side
                first[1, place] += 40.0 * ARCSEC * (1 if not holds else -1)
                second[1, place] += 39.0 * ARCSEC * (1 if not holds else -1)
            assert compare_residuals(first, second).holds is holds


def test_the_figures_told_are_of_whole_residuals():
    # cut at 4 sigma of the better model the worse one would leave 4, not 10 arcsec
    right, wrong = pair(40, 10.0, 6)
    found = compare_residuals(wrong, right)
    for one, told in ((wrong, found.radial.before), (right, found.radial.after)):
        assert told == pytest.approx(np.sqrt(np.mean(np.sum(one**2, axis=0))) / ARCSEC)
    assert found.el.before == pytest.approx(np.sqrt(np.mean(wrong[1]**2)) / ARCSEC)
    figures = f'{found.radial.before:.2f} -> {found.radial.after:.2f} arcsec'
    assert figures in comparison_sentence(found)
    assert found.holds and not compare_residuals(right, wrong).holds


def test_rows_that_resemble_each_other_count_as_fewer():
    # a stretch of ten neighbours that fares worse is one voice, ten single rows are ten
    gain = np.zeros(40)
    gain[:10] = 1.0
    before = np.array([np.ones(40), np.ones(40)]) * ARCSEC
    chances = []
    for order in (np.arange(40), np.random.default_rng(2).permutation(40)):
        after = before.copy()
        after[0] = np.sqrt(1.0 + gain[order]) * ARCSEC
        chances.append(compare_residuals(before, after).radial.chance)
    assert chances[0] > 3.0 * chances[1]


def test_an_axis_on_which_nothing_was_done_is_not_judged():
    right, wrong = pair(40, 1.5, 3)
    assert 'el' in compare_residuals(right, wrong).worse
    assert compare_residuals(right, wrong, axes=('az',)).worse == ('radial',)


def test_rows_that_are_no_number_and_too_few_rows():
    right, wrong = pair(12, 1.0, 3)
    right[0, :3] = np.nan
    assert compare_residuals(right, wrong).rows == 9
    right[0, :6] = np.nan
    with pytest.raises(ValueError, match='6 rows to judge by; observe at least 8'):
        compare_residuals(right, wrong)
