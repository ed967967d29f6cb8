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

"""What is said of single rows, of their scatter and of nights held out."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.analysis.diagnosis.holdout import nights_held_out
from calibration.report.row_wording import bad_nights, worst_sentence
from msg_tools.units import ARCSEC


def test_a_row_that_noise_would_have_among_so_many_is_none_to_look_at():
    row = {'row': 80, 'before_arcsec': 6.0, 'after_arcsec': 8.9}
    rms = {'rms_arcsec': 3.91, 'rms_x_arcsec': 2.5, 'rms_y_arcsec': 3.0}
    told = {'worst_rows': {'before': {**row, 'before_arcsec': 12.0, 'row': 3}, 'after': row},
            'after': rms, 'observations': 98}
    assert worst_sentence(told) == ''
    told['worst_rows']['after'] = {**row, 'after_arcsec': 14.0}
    assert worst_sentence(told).startswith('Now the worst row is row 80: 6.00″ before, 14.0″ after')


def test_worst_rows():
    def rows(before, after):
        keys = 'row', 'before_arcsec', 'after_arcsec'
        return {'worst_rows': {'before': dict(zip(keys, before)), 'after': dict(zip(keys, after))}}
    assert worst_sentence(rows((3, 9.0, 2.0), (4, 5.0, 4.0))) == ''
    assert 'row 3, became worse: 9.00″ before, 9.50″' in worst_sentence(
        rows((3, 9.0, 9.5), (3, 9.0, 9.5)))
    told = {**rows((3, 9.0, 2.0), (4, 3.0, 5.0)), 'rows_are': 'line', 'mount': 'german'}
    told['worst_rows']['after'].update(az_deg=-20.2, el_deg=41.0)
    assert worst_sentence(told).startswith(
        'Now the worst row is line 4 (hour angle −20°, declination 41°): 3.00″ before, 5.00″')


@pytest.mark.parametrize('size, bad', [((1.0, 1.0), False), ((1.0, 6.0), True)])
def test_a_bad_night_is_told_by_axis(size, bad):
    rng = np.random.default_rng(2)
    left = rng.normal(size=(2, 90)) * ARCSEC
    left[:, 60:] *= np.array(size)[:, None]
    obs = SimpleNamespace(label=np.repeat([0, 1, 2], 30), runs=['a.dat:0', 'b.dat:0', 'c.dat:0'],
                          sources=np.repeat(['a.dat', 'b.dat', 'c.dat'], 30))
    own = SimpleNamespace(residual_after=rng.normal(size=(2, 60)) * ARCSEC, weights=np.ones(60))
    nights = nights_held_out(obs, [left, left], np.ones(90, bool), own)
    assert [bool(night['bad']) for night in nights] == [False, False, bad]
    said = bad_nights({'held_out': nights}, ('azimuth', 'elevation'))
    assert len(said) == bad
    if bad:
        assert 'c.dat is noisy, or its terms are others: azimuth' in said[0]
        assert 'as the others, elevation' in said[0]
