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

"""A model on directions, as a call of one line."""

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model.context import Context
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.model_application import apply, turned, zeros_of_rows

TERMS = {'IA': 412.0 * ARCSEC, 'CA': 25.0 * ARCSEC, 'AN': 30.0 * ARCSEC, 'TF': 15.0 * ARCSEC}
ZEROS = [{'run': 1, 'az_arcsec': 100.0, 'el_arcsec': -50.0},
         {'run': 2, 'az_arcsec': 110.0, 'el_arcsec': -40.0}]
AZ, EL = np.linspace(0.0, 350.0, 30), np.linspace(20.0, 80.0, 30)


def test_one_line_there_and_back(tmp_path):
    model = PointingModel(TERMS)
    model.save(tmp_path / 'model.json')
    az_enc, el_enc = apply(tmp_path / 'model.json', AZ, EL)
    expected = model.sky_to_encoder(AZ * DEG, EL * DEG)
    np.testing.assert_allclose([az_enc, el_enc], np.array(expected) / DEG, rtol=1e-15)
    az, el = apply(model, az_enc, el_enc, reverse=True)
    np.testing.assert_allclose([az, el], [AZ, EL], atol=1e-9 / 3600.0)
    assert apply(model, 10.0, 45.0)[0].shape == ()


@pytest.mark.parametrize('name', ['el_deg', 'temperature_c', 'run'])
def test_a_driver_of_another_length_is_named(name):
    with pytest.raises(ValueError, match=f'{name} has the shape .2,., the directions have .30,.'):
        apply(PointingModel(TERMS), **{'az_deg': AZ, 'el_deg': EL, name: [1.0, 2.0]})


def test_a_site_out_of_range_is_refused():
    with pytest.raises(ValueError, match='latitude 123 is outside -90 to 90 degrees'):
        apply(PointingModel(TERMS), AZ, EL, latitude_deg=123.0)
    with pytest.raises(ValueError, match='longitude 400 is outside -180 to 360 degrees'):
        apply(PointingModel(TERMS), AZ, EL, longitude_deg=400.0)


def test_the_zero_is_that_of_the_run():
    model = PointingModel(TERMS, provenance={'zeros_in_force': ZEROS})
    bare = np.array(apply(model, AZ, EL, zero='none'))
    for zero, row in (('newest', 1), (1, 0), (2.0, 1)):
        moved = (np.array(apply(model, AZ, EL, zero=zero)) - bare) * 3600.0
        np.testing.assert_allclose(moved[0], ZEROS[row]['az_arcsec'], rtol=1e-9)
        np.testing.assert_allclose(moved[1], ZEROS[row]['el_arcsec'], rtol=1e-9)
    run = np.where(AZ < 180.0, 1, 2)
    moved = (np.array(apply(model, AZ, EL, run=run)) - bare) * 3600.0
    np.testing.assert_allclose(moved[0], np.where(run == 1, 100.0, 110.0), rtol=1e-9)
    out = apply(model, AZ, EL, run=run)
    np.testing.assert_allclose(apply(model, *out, run=run, reverse=True), [AZ, EL], atol=1e-12)
    with pytest.raises(ValueError, match='no zero of run 3; it has: 1, 2'):
        apply(model, AZ, EL, zero=3)
    for other in ('last', None, [1, 2]):
        with pytest.raises(ValueError, match='names no zero: newest, none or the number of a run'):
            apply(model, AZ, EL, zero=other)
    with pytest.raises(ValueError, match='no zero of run 5'):
        zeros_of_rows(model, run=np.array([1, 5]))


def test_drivers_by_the_names_of_files_and_a_graduation_met_with_the_zero():
    drift = FittedEffect(effect('drift', of='IA', driver='temperature', origin=4.0, scale=1.0,
                                within=[0.0, 8.0]), [5.0 * ARCSEC])
    model = PointingModel(TERMS, effects=[drift])
    warm, cold = (apply(model, AZ, EL, temperature_c=t)[0] for t in (6.0, 4.0))
    np.testing.assert_allclose((warm - cold) * 3600.0, 10.0, atol=1e-6)
    np.testing.assert_array_equal(apply(model, AZ, EL), apply(model, AZ, EL, temperature_c=4.0))
    apply(model, AZ, EL, temperature_c=4.0, dome=3.0)  # of another model, perhaps
    with pytest.raises(ValueError, match='follows temperatur_c; not given is temperature_c'):
        apply(model, AZ, EL, temperatur_c=6.0)
    lines = FittedEffect(effect('subdivision', axis='az', graduation='grating', order=1),
                         np.array([3.0, 1.0]) * ARCSEC)
    model = PointingModel(TERMS, effects=[lines], provenance={'zeros_in_force': ZEROS})
    out = apply(model, AZ, EL)
    bare = apply(PointingModel(TERMS), AZ, EL)
    away = (out[0] - bare[0]) * 3600.0 - 110.0
    phase = 47200 * out[0] * DEG
    np.testing.assert_allclose(away, 3.0 * np.cos(phase) + np.sin(phase), atol=1e-4)
    np.testing.assert_allclose(apply(model, *out, reverse=True), [AZ, EL], atol=1e-6 / 3600.0)


def test_where_the_mount_cannot_look_is_nan():
    model = PointingModel({'CA': 3600.0 * ARCSEC})
    az, el = turned(model, Context([0.0, 1.0], np.radians([89.5, 45.0])))
    assert np.isnan(az[0]) and np.isfinite(el[1])
