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

"""Rows that a person leaves out."""

import numpy as np
import pytest

from pointing_model.mounts import Mount, through_pole
from pointing_model.runs.row_exclusion import REASON, excluded_rows, without_excluded
from pointing_model.runs.run import PointingRun

N = 10


@pytest.fixture
def run():
    el = np.radians(np.linspace(10.0, 82.0, N))
    return PointingRun({'az': np.zeros(N), 'el': el, 'az_enc': np.zeros(N), 'el_enc': el,
                        'star': np.array([f'HIP {i}' for i in range(N)]),
                        'magnitude': np.arange(N, dtype=float),
                        'time': 1768500000.0 + 600.0 * np.arange(N),
                        'column_focus': np.arange(N) * 2.0}, {'lines': np.arange(2, N + 2)})


@pytest.mark.parametrize('text, rows', [
    ('3', [1]), ('3-5, 9', [1, 2, 3, 7]), ('el<20', [0, 1]), ('el_deg>=74', [8, 9]),
    ('star=HIP 4', [4]), ('magnitude>7,2', [0, 8, 9]), ('focus=6', [3]),
    ('star!=HIP 0', range(1, N)), ('time<2026-01-15T18:10', [0]), ('time<1768500600', [0]),
])
def test_rows_are_meant_by_number_range_and_condition(run, text, rows):
    assert np.flatnonzero(excluded_rows(run, text)).tolist() == list(rows)


@pytest.mark.parametrize('kind', ['german', 'equatorial'])
def test_angles_of_an_equatorial_mount_are_those_of_the_sky(kind):
    mount, rng = Mount.equatorial(np.radians(48.0), kind), np.random.default_rng(1)
    ha, dec = np.radians(rng.uniform(-90.0, 90.0, 80)), np.radians(rng.uniform(-20.0, 85.0, 80))
    axes = through_pole(ha, dec, (ha < 0.0) & mount.two_sided)
    run = PointingRun({'az': axes[0], 'el': axes[1], 'az_enc': axes[0], 'el_enc': axes[1]},
                      {'lines': np.arange(2, 82), 'mount': mount})
    az, el = mount.horizon_of(ha, dec)
    for text, rows in (('ha<0', ha < 0.0), ('dec_deg>60', dec > np.radians(60.0)),
                       ('el<20', el < np.radians(20.0)),
                       ('az_deg>180', np.mod(az, 2.0 * np.pi) > np.pi),
                       ('ha>180', ha < 0.0)):
        assert 0 < rows.sum() < 80 and np.array_equal(excluded_rows(run, text), rows), text


def test_the_rest_says_what_was_left_out(run):
    left = without_excluded(run, ['3-4', 'el>80'])
    assert len(left) == N - 3 and left.lines.tolist() == [2, 5, 6, 7, 8, 9, 10]
    assert left.meta['excluded'] == [{'row': row, 'reason': REASON} for row in (3, 4, 11)]
    none = without_excluded(run, ['magnitude>100, 3'])
    assert len(none) == N - 1 and none.meta['notes'] == ['--exclude magnitude>100 matches no row']


@pytest.mark.parametrize('text, said', [
    ('40', 'no such row; rows in use go from 2 to 11'), ('all', 'a condition such as el<20'),
    ('wind>3', 'no column wind; the run has'), ('el<low', 'low is no number'),
    ('el>0', 'leaves no row')])
def test_what_cannot_be_meant_is_one_line(run, text, said):
    with pytest.raises(ValueError, match='--exclude') as error:
        without_excluded(run, [text])
    assert said in str(error.value) and '\n' not in str(error.value)
