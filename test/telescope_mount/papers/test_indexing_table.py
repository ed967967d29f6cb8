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

from msg_tools.units import ARCSEC
from telescope_mount.papers.indexing_table import DAMAGED, SCALES, TABLE_ERROR, IndexingTable


def test_one_turn_is_23_equal_parts():
    bench = IndexingTable(SCALES[48], 3, ('template',))
    assert np.degrees(bench.standard[1]) == pytest.approx(15 + 39 / 60 + 7.826 / 3600, abs=1e-6)
    assert np.abs(bench.table_errors).max() <= TABLE_ERROR
    errors = bench.turns(3)['template']
    assert errors.shape == (3, 23)
    # the errors of the table are in every turn
    assert np.corrcoef(errors.mean(axis=0), bench.table_errors)[0, 1] > 0.3
    assert np.abs(errors).max() < 2.0 * ARCSEC


def test_the_same_seed_gives_the_same_test():
    first, again, other = (
        IndexingTable(SCALES[48], seed, ('centroid',)).turns(1)['centroid'] for seed in (5, 5, 6))
    assert np.array_equal(first, again) and not np.allclose(first, other)


def test_damage_hits_three_readings_only():
    bench = IndexingTable(SCALES[48], 1, ('centroid', 'template'))
    errors = bench.turns(2, damage=0.15)
    rows = np.array(DAMAGED) - 1
    others = np.setdiff1d(np.arange(23), rows)
    centroid = errors['centroid'] / ARCSEC
    # a displaced bar takes its centroid along: 0.15 of 1200", the disc seems to stay behind
    assert centroid[:, rows] == pytest.approx(-180.0, abs=40.0)
    assert np.abs(centroid[:, others]).max() < 40.0
    assert np.abs(errors['template']).max() < 3.0 * ARCSEC


def test_through_one_bar():
    bench = IndexingTable(SCALES[48], 1, ('paper_by_centres', 'template'))
    position, errors = bench.one_bar(60, noise=False)
    assert position[-1] == pytest.approx(59 / 60 * 1200 * ARCSEC)
    assert errors['paper_by_centres'].std() > 5 * errors['template'].std()


def test_goodness_of_the_sine_falls_with_the_noise():
    from dataclasses import replace
    r_square, period = IndexingTable(SCALES[48], 1, ()).fits(30)
    assert np.median(r_square) == pytest.approx(0.746, abs=0.01)
    assert period == pytest.approx(48.0, abs=0.05)
    loud, _ = IndexingTable(replace(SCALES[48], noise=10.0), 1, ()).fits(30)
    # the paper's 0.6 to 0.7
    assert np.nanmedian(loud) == pytest.approx(0.67, abs=0.015)
