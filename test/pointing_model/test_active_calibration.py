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

from dataclasses import replace

import numpy as np
import pytest

from msg_tools.power_on import PowerOn
from msg_tools.units import ARCSEC
from pointing_model.active_calibration import ActiveCalibration, correlated_sigma
from pointing_model.calibration_messages import pair_to_text, text_to_pair
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.model_document import identity
from pointing_model.zero import NO_ZERO, PowerOnZero

AZ, EL = np.array([0.5, 3.0]), np.array([0.6, 1.1])


def test_nothing_is_in_force_at_first():
    now = ActiveCalibration()
    assert now.model is None and now.zero is NO_ZERO and now.models == now.zero_stamp == 0
    np.testing.assert_array_equal(now.encoder(AZ, EL), np.column_stack([AZ, EL]))


def test_model_and_zero_act_once_each():
    model = PointingModel({'IA': 120 * ARCSEC, 'CA': 50 * ARCSEC, 'TF': -30 * ARCSEC})
    zero = PowerOnZero(33.0 * ARCSEC, -21.0 * ARCSEC)
    now = ActiveCalibration(model)
    now.update_zero(7, zero)
    wanted = np.column_stack(model.sky_to_encoder(AZ, EL)) + zero.angles
    np.testing.assert_array_equal(now.encoder(AZ, EL), wanted)
    assert now.zero_stamp == 7


@pytest.mark.parametrize('stamp, known', [(12, 12), (None, 0), ('12', 0)])
def test_a_model_is_counted_and_dated(stamp, known):
    now = ActiveCalibration()
    now.update_model(PointingModel({'IA': 0.0}, provenance={'last_stamp_ns': stamp}).to_json())
    assert (now.models, now.model_stamp) == (1, known)


def test_a_text_that_is_no_model_changes_nothing():
    now = ActiveCalibration(PointingModel({'IE': 1.0}))
    with pytest.raises(ValueError):
        now.update_model('no JSON')
    assert now.model.terms == {'IE': 1.0} and now.models == 0


def test_a_model_and_the_zero_that_it_tells_of():
    def told(zeros):
        now = ActiveCalibration(PointingModel({}, provenance={'zeros_in_force': zeros}))
        now.update_zero(1, PowerOnZero(20.0 * ARCSEC, -9.0 * ARCSEC))
        return now.zero_is_of_model()
    first = {'run': 1, 'az_arcsec': 1.0, 'el_arcsec': 2.0}
    newest = {'run': 2, 'az_arcsec': 20.0, 'el_arcsec': -9.0}
    assert told([first, newest]) and not told([first])
    assert told([]) and told(None)
    assert not told([first, newest | {'el_arcsec': -9.001}])
    with pytest.raises(ValueError, match='not a zero'):
        told([{'run': 2}])


# --- what goes together ---------------------------------------------------------------------------

OLD, NEW = (PointingModel({'IA': ia * ARCSEC}) for ia in (-24.0, 320.0))
OLD_ZERO, NEW_ZERO = (PowerOnZero(az * ARCSEC, 0.0, run=run, started=run * 1e9, model=identity(
    model.to_json())) for az, run, model in ((356.0, 1, OLD), (10.5, 2, NEW)))


def demand(now):
    """Azimuth error that is pointed for, arcsec."""
    return round(float((now.encoder(AZ, EL) - np.column_stack([AZ, EL]))[0, 0]) / ARCSEC, 3)


@pytest.mark.parametrize('zero_first', [True, False])
def test_a_zero_and_its_model_come_into_force_together(zero_first):
    now = ActiveCalibration(OLD)
    now.update_zero(1, OLD_ZERO)
    assert demand(now) == 332.0 and not now.complaints()
    steps = [lambda: now.update_model(NEW.to_json()), lambda: now.update_zero(2, NEW_ZERO)]
    steps = steps[::-1] if zero_first else steps
    steps[0]()
    assert demand(now) == 332.0 and now.zero_stamp == 1  # never half of the new pair
    assert len(now.complaints()) == 1 and 'was not taken' in now.complaints()[0]
    steps[1]()
    assert demand(now) == 330.5 and now.zero_stamp == 2 and now.models == 1
    assert not now.complaints()


def test_a_zero_of_another_model_waits_for_it_and_harms_nothing():
    now = ActiveCalibration(OLD)
    now.update_zero(1, NEW_ZERO)
    assert demand(now) == -24.0 and now.zero_stamp == 0
    now.update_zero(2, OLD_ZERO)
    assert demand(now) == 332.0
    # of no model: a zero by Polaris alone holds the whole of IA
    now.update_zero(3, PowerOnZero(1.0, 0.0, run=1, model='none'))
    assert demand(now) == 332.0


def test_a_zero_of_another_power_on_is_refused():
    now = ActiveCalibration(OLD)
    now.update_power_on(PowerOn(1, 1e9))
    now.update_zero(1, OLD_ZERO)
    assert not now.complaints()
    now.update_power_on(PowerOn(1, 2e9))  # a driver started anew counts from 1 again
    assert 'another' not in now.complaints()[0] and 'set it anew' in now.complaints()[0]
    now.update_zero(2, OLD_ZERO)
    assert (now.refused, now.refused_stamp, now.zero_stamp) == (1, 2, 1) and now.zero_is_unknown
    # where the encoder does not tell, nothing can be refused
    now.update_power_on(None)
    now.update_zero(3, OLD_ZERO)
    assert now.zero_stamp == 3 and not now.complaints()
    fresh = ActiveCalibration(OLD)
    fresh.update_power_on(PowerOn(1, 2e9))
    fresh.update_zero(1, OLD_ZERO)
    assert fresh.zero is NO_ZERO and 'the last zero was not taken' in fresh.complaints()[0]


def test_messages_of_older_logs_are_taken_as_ever():
    now = ActiveCalibration(OLD)
    now.update_zero(1, PowerOnZero(5.0 * ARCSEC, 0.0))
    now.update_model(NEW.to_json())
    assert demand(now) == 325.0 and not now.complaints()


def test_the_name_of_a_model_is_that_of_what_it_does():
    text = NEW.to_json()
    assert identity(text) == identity(PointingModel.from_json(text).to_json())
    assert identity(text) == identity(
        PointingModel(NEW.terms, provenance={'source': 'elsewhere'}).to_json())
    assert identity(text) != identity(OLD.to_json())
    assert identity('') == identity(PointingModel({}).to_json()) == 'none'


def test_a_zero_that_wanders_is_trusted_less_and_less():
    wander = {'axes': {'az': {'sigma_arcsec': 2.0, 'memory': 0.5, 'unit': 'hours', 'angle': True,
                              'span': 0.0}}}
    model = PointingModel({'IA': 0.0}, provenance={'wander': wander, 'last_stamp_ns': 10**18})
    sigmas = [correlated_sigma(model, 10**18 + int(h * 3600e9), np.pi / 3)[0] / ARCSEC
              for h in (0.0, 0.1, 1.0, 100.0)]
    assert sigmas[0] == 0.0 and np.all(np.diff(sigmas) > 0.0)
    assert sigmas[-1] == pytest.approx(2.0 * np.sqrt(2.0) * 0.5)
    assert np.all(correlated_sigma(model, 0, 0.5) == 0.0)
    # the rows themselves were spread over it
    wander['axes']['az']['span'] = 5.0
    assert 0.9 < correlated_sigma(model, 10**18, np.pi / 3)[0] / ARCSEC < 1.01
    assert np.all(correlated_sigma(PointingModel({}), 5, 0.5) == 0.0)
    assert np.all(correlated_sigma(None, 5, 0.5) == 0.0)


@pytest.mark.parametrize('zero, words', [
    (PowerOnZero(1e300, 0.0, run=1), 'zero of 1e\\+300 rad on the first axis'),
    (PowerOnZero(0.0, -6.3, run=1), 'zero of -6.3 rad on the second axis'),
    (PowerOnZero(0.0, 0.0, np.diag([1e-12, np.inf]), run=1),
     'sigma of inf arcsec of the second axis'),
    (PowerOnZero(0.1, 0.0), 'without its power-on and model')])
def test_a_zero_of_no_encoder_is_refused_and_the_last_one_stays(zero, words):
    now = ActiveCalibration(OLD)
    now.update_zero(1, replace(OLD_ZERO, started=1e9))
    with pytest.raises(ValueError, match=words):
        now.update_zero(2, zero)
    assert now.zero is not zero and now.zero_stamp == 1 and demand(now) == 332.0


def test_a_zero_that_was_never_measured_may_be_half_a_turn():
    now = ActiveCalibration()
    now.update_zero(1, PowerOnZero(np.pi, -np.pi, np.diag([1e-2, 1e-2]), run=1))
    assert now.zero_stamp == 1


@pytest.mark.parametrize('model, words', [
    (PointingModel({'IA': 1e308 * ARCSEC}), 'IA = 1e\\+308 arcsec, which no mount has'),
    (PointingModel({'AN': 1.6}), r'AN = 3.3e\+05 arcsec, which no mount has \(at most 90 deg\)'),
    (PointingModel({'IA': 0.0, 'IE': 0.0}, np.diag([0.0, 1e250])), 'sigma of .* arcsec of IE'),
    (PointingModel({'IA': 0.0, 'IE': 0.0}, np.array([[1.0, 2.0], [2.0, 1.0]]) * ARCSEC**2),
     'a covariance that is none'),
    (PointingModel({'IA': 0.0}, np.array([[-1.0]]) * ARCSEC**2), 'a covariance that is none'),
    (PointingModel({}, effects=[FittedEffect(effect('hysteresis', axis='az', shape='cosE'),
                                             np.array([1e250]))]), 'hysteresis.* no mount has')])
def test_a_model_of_no_mount_is_refused_and_the_last_one_stays(model, words):
    now = ActiveCalibration(OLD)
    with pytest.raises(ValueError, match=words):
        now.update_model(model.to_json())
    assert now.model is OLD
    with pytest.raises(ValueError, match=words):
        text_to_pair(pair_to_text(model.to_json(), 1, PowerOnZero(
            0.0, 0.0, model=identity(model.to_json()))))


def test_an_index_term_may_be_any_angle():
    now = ActiveCalibration()
    now.update_model(PointingModel({'IA': 6.0, 'AN': 1.5}).to_json())
    assert now.models == 1
