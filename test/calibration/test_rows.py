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

from calibration.rows import for_fitting, is_kept_out, usable, with_marks
from msg_tools.units import ARCSEC
from pointing_model.runs.run import PointingRun
from pointing_model.zero import PowerOnZero, Zeros


def run(n=5, **columns):
    place = {name: np.linspace(0.1, 1.0, n) for name in ('az', 'el', 'az_enc', 'el_enc')}
    return PointingRun({**place, **columns})


def test_all_that_is_finite_with_its_zero_taken_off():
    rows = run(run=np.array([1.0, 1.0, 2.0, 2.0, 2.0]))
    zeros = Zeros([PowerOnZero(0.01, 0.02, run=1), PowerOnZero(0.03, 0.04, run=2)])
    used = usable(rows, zero=zeros)
    np.testing.assert_array_equal(used.rows, np.arange(5))
    np.testing.assert_allclose(rows['az_enc'] - used.az_enc, [0.01, 0.01, 0.03, 0.03, 0.03])
    assert used.sigmas is None and used.excluded == []


def test_what_is_not_usable_is_named_in_order():
    sigma = np.full(5, ARCSEC)
    rows = run(sigma_x=sigma.copy(), sigma_y=2 * sigma)
    rows['el_enc'][3] = rows['az'][3] = np.nan
    rows['sigma_x'][1] = 0.0
    used = usable(rows)
    assert used.excluded == [{'row': 1, 'reason': 'sigma not finite and positive'},
                             {'row': 3, 'reason': 'az, el_enc not finite'}]
    np.testing.assert_array_equal(used.rows, [0, 2, 4])
    np.testing.assert_array_equal(used.sigmas, [ARCSEC] * 3 + [2 * ARCSEC] * 3)
    fewer = used.only(np.array([True, False, True]), 'why')
    np.testing.assert_array_equal(fewer.rows, [0, 4])
    assert [e['row'] for e in fewer.excluded] == [1, 2, 3] and len(fewer.sigmas) == 4
    assert used.only(np.ones(3, bool), 'why') is used


def test_sigmas_that_are_all_unknown_are_none():
    assert usable(run(sigma_x=np.full(5, np.nan), sigma_y=np.full(5, np.nan))).sigmas is None


@pytest.mark.parametrize('encoder, word', [('abs', 'az_abs'), ('third', 'third')])
def test_an_encoder_that_is_not_there(encoder, word):
    with pytest.raises(ValueError, match=word):
        usable(run(), encoder)


def test_rows_kept_out_and_satellites_are_not_for_fitting():
    rows = run(star=np.array([1.0, 2.0, -1.0, 4.0, 5.0]), check=np.array([0, 1.0, 0, 0, 1.0]))
    np.testing.assert_array_equal(for_fitting(rows)['star'], [1.0, 4.0])
    marked = with_marks(rows)
    assert with_marks(marked) is marked and not is_kept_out(with_marks(run())).any()
