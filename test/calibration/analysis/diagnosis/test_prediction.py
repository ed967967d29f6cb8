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
from places import ROOT

from calibration.analysis.diagnosis.base_terms import Base
from calibration.analysis.diagnosis.observations import observations
from calibration.analysis.diagnosis.prediction import better_prediction, predictive_model
from calibration.report.wording import wording
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import design
from pointing_model.runs.run import PointingRun


def run(rng, n=70, wave=0.0, east=2.0 * np.pi):
    az, el = rng.uniform(0.0, east, n), np.arcsin(rng.uniform(0.4, 0.98, n))
    terms = {'IA': 40 * ARCSEC, 'IE': -20 * ARCSEC, 'CA': 15 * ARCSEC, 'AN': 10 * ARCSEC}
    a, e = PointingModel(terms).sky_to_encoder(az, el)
    noise = rng.normal(size=(2, n)) * ARCSEC
    return PointingRun({'az': az, 'el': el, 'time': 60.0 * np.arange(n),
                        'az_enc': a + (wave * np.sin(2 * az) * ARCSEC + noise[0] / np.cos(el)),
                        'el_enc': e + noise[1]})


@pytest.fixture(scope='module')
def found():
    return predictive_model(run(np.random.default_rng(0), wave=10.0), folds=3)


def test_other_stars_are_predicted_better_and_what_it_is_made_of_is_said(found):
    assert found.blocks.radial < 0.5 * found.blocks_before.radial
    assert found.after[0].radial < 0.5 * found.before[0].radial
    fresh = run(np.random.default_rng(1), wave=10.0)
    assert np.std(found.model.residuals(fresh)) < 0.5 * np.std(found.base_model.residuals(fresh))
    assert found.parts[0]['name'] == 'azimuth_encoder_2'
    first, second = map(wording, found.findings())
    assert 'No cause is claimed' in first and 'cross-validated in blocks of time' in first
    assert 'least observed tenth of the sky' in second


def test_the_model_goes_through_a_file_to_the_last_bit(found):
    text = found.model.to_json()
    back = PointingModel.from_json(text)
    assert back.to_json() == text
    az, el = np.linspace(0.0, 6.0, 9), np.linspace(0.4, 1.3, 9)
    context = {'time': np.linspace(0.0, 4000.0, 9)}
    np.testing.assert_array_equal(back.sigma(az, el, context), found.model.sigma(az, el, context))
    np.testing.assert_array_equal(back.offsets(az, el, context),
                                  found.model.offsets(az, el, context))


@pytest.mark.parametrize('seed', range(3))
def test_no_direction_is_known_without_any_error(seed):
    model = predictive_model(run(np.random.default_rng(seed), n=20, wave=6.0), ways=0).model
    model = PointingModel.from_json(model.to_json())
    values = np.linalg.eigvalsh(model.joint)
    assert values[0] > -1e-14 * values[-1]
    k = len(model.terms)
    own, across, others = model.joint[:k, :k], model.joint[:k, k:], model.joint[k:, k:]
    terms = own - across @ np.linalg.pinv(others, 1e-12, hermitian=True) @ across.T
    i = np.arange(1000)
    az, el = np.mod(i * 2.4, 2.0 * np.pi), np.arcsin(0.2 + 0.79 * i / 1000)
    columns = np.array(design(tuple(model.terms), az, el))
    least = np.einsum('ank,kl,anl->an', columns, terms, columns)
    assert (least > 0.0).all()
    assert (np.square(model.sigma(az, el, {'time': np.full(1000, 600.0)})) > 0.99 * least).all()


def test_without_some_effects_the_joint_covariance_goes_along(found):
    fewer = found.model.with_effects(lambda fitted: fitted.effect.driver == 'azimuth')
    size = len(fewer.terms) + sum(len(e.coefficients) for e in fewer.effects)
    assert fewer.joint.shape == (size, size) and 0 < len(fewer.effects) < len(found.model.effects)


def test_the_error_grows_where_there_are_no_rows():
    half = predictive_model(run(np.random.default_rng(2), wave=10.0, east=3.0), ways=0).model
    time = {'time': np.full(2, 2000.0)}
    x, y = half.sigma(np.array([1.5, 4.5]), np.array([0.9, 0.9]), time)
    assert x[1] > 3.0 * x[0] and y[1] > 1.5 * y[0]
    later = {'time': np.array([2000.0, 1e6])}
    x, _ = half.sigma(np.array([1.5, 1.5]), np.array([0.9, 0.9]), later)
    assert x[1] >= x[0]


def test_a_clean_run_keeps_the_terms():
    clean = predictive_model(run(np.random.default_rng(3)), ways=0)
    assert not clean.found.beyond and not clean.model.effects
    assert 'the terms alone are kept' in wording(clean.findings()[0])


def test_a_diagnosis_is_told_what_a_prediction_would_gain():
    obs = observations(run(np.random.default_rng(0), wave=10.0))
    one, own = (SimpleNamespace(obs=obs, base=Base.parse('physical', own))
                for own in ((), ('IA', 'IE')))
    told = better_prediction(one, 10.0)
    assert told[0].after < 3.0 and 'names no cause' in wording(told[0])
    assert not better_prediction(one, 1.0) and not better_prediction(own, 10.0)


@pytest.mark.parametrize('name, blocks', [('spk5m/pmfit_equat.dat', 2.6), ('spk8m/pmfit_altaz.dat',
                                                                           1.7)])
def test_measured_runs(name, blocks):
    path = ROOT.parent / 'shared' / 'data' / name
    if not path.is_file():
        pytest.skip(f'no measured run {name} beside the project')
    from pointing_model.runs.run_reader import read_run
    assert predictive_model(read_run(path), folds=3).blocks.radial < blocks
