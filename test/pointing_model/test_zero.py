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

import json
import pickle

import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.zero import NO_ZERO, PowerOnZero, Zeros, active_zero, active_zeros

ZEROS = Zeros([PowerOnZero(1.0, 2.0, run=1), PowerOnZero(3.0, 4.0, run=2)])


def rows(*numbers):
    n = len(numbers)
    columns = {name: np.zeros(n) for name in ('az', 'el', 'az_enc', 'el_enc')}
    return PointingRun({**columns, 'run': np.array(numbers, float)} if n else {
        name: np.zeros(2) for name in columns})


def test_one_zero_is_that_of_every_row():
    zero = PowerOnZero(1.0, 2.0, np.diag([9.0, 16.0]), 3)
    assert zero.row_angles(rows(1.0, 2.0)) == (1.0, 2.0) == zero.row_angles(rows())
    assert (zero.sigma_az, zero.sigma_el) == (3.0, 4.0)
    assert np.isnan(PowerOnZero(1.0, 2.0).sigma).all()
    np.testing.assert_array_equal(zero.plus(0.5, -1.0).angles, [1.5, 1.0])
    assert zero.plus(0.5, -1.0).run == 3 and zero.plus(0.0, 0.0).covariance is None
    assert zero == PowerOnZero(1.0, 2.0, run=3) != PowerOnZero(1.0, 2.0, run=4)


def test_each_row_has_the_zero_of_its_run():
    az, el = ZEROS.row_angles(rows(2.0, 1.0, 2.0))
    np.testing.assert_array_equal(az, [3, 1, 3])
    np.testing.assert_array_equal(el, [4, 2, 4])
    assert ZEROS.newest == ZEROS[2.0] and ZEROS.newest.run == 2


@pytest.mark.parametrize('ask, words', [
    (lambda: ZEROS[3], 'no zero for run 3'), (lambda: ZEROS.row_angles(rows(1.0, 3.0)), 'run 3'),
    (lambda: ZEROS.row_angles(rows()), 'column run'), (lambda: Zeros().newest, 'measure one')])
def test_a_run_without_a_zero_is_refused(ask, words):
    with pytest.raises(ValueError, match=words) as caught:
        ask()
    assert '\n' not in str(caught.value)


def test_who_wants_something_else_for_a_missing_run_says_so():
    filled = ZEROS.filled([2, 3], NO_ZERO)
    assert list(filled) == [1, 2, 3] and filled[2] == ZEROS[2]
    assert filled[3] == PowerOnZero(0.0, 0.0, run=3)
    carried = ZEROS.carried([0, 1, 2, 3])
    assert [zero.az for zero in carried.values()] == [1.0, 1.0, 3.0, 3.0]
    assert [zero.run for zero in carried.values()] == [0, 1, 2, 3] == list(carried)
    assert ZEROS.carried([0], first=NO_ZERO)[0] == PowerOnZero(0.0, 0.0, run=0)
    assert Zeros().carried([5])[5] == PowerOnZero(0.0, 0.0, run=5)
    assert ZEROS.get(3) is None and 3 not in ZEROS and 1.0 in ZEROS


def test_the_documents_are_those_of_ever():
    zeros = Zeros([PowerOnZero(30 * ARCSEC, -2.0 * ARCSEC, run=1.0)])
    text = json.dumps(zeros.to_list())
    assert json.loads(text) == [{'run': 1.0, 'az_arcsec': 30 * ARCSEC / ARCSEC,
                                 'el_arcsec': -2 * ARCSEC / ARCSEC}]
    assert Zeros.from_list(json.loads(text)) == Zeros(
        [PowerOnZero(30 * ARCSEC / ARCSEC * ARCSEC, -2 * ARCSEC / ARCSEC * ARCSEC, run=1.0)])
    assert NO_ZERO.to_dict() == {'az_arcsec': 0.0, 'el_arcsec': 0.0}
    for damaged in ({'az_arcsec': 1.0}, {'az_arcsec': None, 'el_arcsec': 1.0}, [1.0, 2.0]):
        with pytest.raises(ValueError, match='not a zero'):
            PowerOnZero.from_dict(damaged)
    assert pickle.loads(pickle.dumps(ZEROS)) == ZEROS


def test_the_zero_that_a_model_went_with():
    model = PointingModel({}, provenance={'zeros_in_force': ZEROS.to_list()})
    assert list(active_zeros(model)) == [1, 2] and active_zero(model).run == 2
    np.testing.assert_allclose(active_zero(model).angles, [3.0, 4.0], rtol=1e-15)
    for unknown in (None, PointingModel({}), PointingModel({}, provenance={
            'zeros_in_force': 'none'})):
        assert active_zeros(unknown) == {} and active_zero(unknown) is NO_ZERO
