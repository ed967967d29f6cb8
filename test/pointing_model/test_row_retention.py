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

"""Which rows are kept: those of the last power-ons."""

import numpy as np
import pytest

from pointing_model.runs.run import first_of_last, kept_words


@pytest.mark.parametrize(('runs', 'count', 'first'), [
    ([], 2, 0), ([1, 1, 1], 1, 0), ([1, 1, 2], 0, 0), ([1, 1, 2], 2, 0), ([1, 1, 2], 1, 2),
    ([-1, 0, 0, 1, 1], 2, 1), ([3, 3, 1, 2], 2, 2),  # numbers that go back: those that came last
    ([1, 2, 1, 3], 2, 2),  # a power-on that began too early is kept as far as it reaches
])
def test_the_first_row_that_is_kept(runs, count, first):
    assert first_of_last(runs, count) == first


@pytest.mark.parametrize('seed', range(5))
def test_row_by_row_the_same_are_kept_as_of_all_at_once(seed):
    rng = np.random.default_rng(seed)
    runs = np.repeat(np.arange(12), rng.integers(1, 9, 12))
    kept = []
    for run in runs:
        kept.append(run)
        kept = kept[first_of_last(kept, 4):]
    assert kept == runs[first_of_last(runs, 4):].tolist()
    assert sorted(set(kept)) == [8, 9, 10, 11]


def test_it_is_told_where_there_may_have_been_more():
    assert kept_words([1, 1, 2], 3) == kept_words([1, 2, 3], 0) == ''
    assert 'last 3 power-ons' in kept_words([1, 2, 2, 3], 3)
