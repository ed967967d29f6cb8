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

import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.calibration_messages import pair_to_text, text_to_pair
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.model_document import identity
from pointing_model.zero import PowerOnZero

MODEL = PointingModel({'IA': 320.1 * ARCSEC, 'CA': -7.3 * ARCSEC}, effects=[FittedEffect(
    effect('hysteresis', axis='az', shape='cosE'), np.array([8.0]) * ARCSEC)])


def test_a_pair_goes_there_and_back_to_the_bit():
    text = MODEL.to_json()
    zero = PowerOnZero(1e-5 / 3, -2e-5 / 7, np.diag([1e-12, 3e-12]), 2, 1_768_482_000.5,
                       identity(text))
    model, stamp, back = text_to_pair(pair_to_text(text, 12, zero))
    assert identity(model) == zero.model and stamp == 12
    assert PointingModel.from_json(model).terms == PointingModel.from_json(text).terms
    assert back == zero and (back.started, back.model) == (zero.started, zero.model)
    np.testing.assert_allclose(back.sigma, zero.sigma, rtol=1e-15)


def test_the_way_of_a_zero_is_told_where_it_is_not_polaris():
    text = pair_to_text('', 1, PowerOnZero(1.0, 2.0, model='none', by='stars'))
    assert text_to_pair(text)[2].by == 'stars'
    by_polaris = pair_to_text('', 1, PowerOnZero(1.0, 2.0, model='none', by='Polaris'))
    assert by_polaris == pair_to_text('', 1, PowerOnZero(1.0, 2.0, model='none'))


def test_without_a_model_and_without_a_sigma():
    model, _, zero = text_to_pair(pair_to_text('', 1, PowerOnZero(1.0, 2.0, model='none')))
    assert model == '' and zero.covariance is None and zero.run is None


@pytest.mark.parametrize('change, words', [
    ({'zero': {}}, 'not an active pair'), ({'format': 'other'}, 'not telescope_mount/in_force'),
    ({'model': None}, 'beside model none'), ({'model': {'format': 'x'}}, 'not a pointing model')])
def test_what_is_no_pair_is_refused(change, words):
    text = MODEL.to_json()
    document = json.loads(pair_to_text(text, 1, PowerOnZero(0.0, 0.0, model=identity(text))))
    with pytest.raises(ValueError, match=words):
        text_to_pair(json.dumps(document | change))
