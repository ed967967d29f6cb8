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

"""The satellite check: statistics and figure."""

import json

import numpy as np
import pytest

from calibration.analysis.external_check import gps_statistics, tracking_errors, tracking_statistics
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.sky.elements import GPS_26690, parse_elements
from pointing_model.sky.satellite_place import satellite_place
from pointing_model.zero import PowerOnZero

GPS = parse_elements(GPS_26690)


@pytest.fixture(scope='module')
def time():
    day = np.arange(GPS.epoch, GPS.epoch + 86400.0, 120.0)
    return day[satellite_place(GPS, day)[1] > 20.0 * DEG]


def _run(time, d_az, d_el):
    """A tracked satellite whose errors are d_az, d_el, arcsec."""
    az, el, _ = satellite_place(GPS, time)
    return PointingRun({'time': time, 'az': az, 'el': el,
                        'az_enc': az + d_az * ARCSEC + 2.0 * np.pi, 'el_enc': el + d_el * ARCSEC})


def test_statistics_are_of_the_coordinate(time):
    rng = np.random.default_rng(2)
    d_az, d_el = 5.0 + 2.0 * rng.standard_normal(time.size), -3.0 + rng.standard_normal(time.size)
    run = _run(time, d_az, d_el)
    out = tracking_statistics(tracking_errors(PointingModel({}), run))
    assert out['n'] == time.size
    assert out['az_mean_arcsec'] == pytest.approx(d_az.mean(), abs=1e-4)
    assert out['az_std_arcsec'] == pytest.approx(d_az.std(ddof=1), abs=1e-4)
    assert out['el_mean_arcsec'] == pytest.approx(d_el.mean(), abs=1e-4)
    assert out['el_std_arcsec'] == pytest.approx(d_el.std(ddof=1), abs=1e-4)
    sky = d_az * np.cos(run['el'])
    assert out['az_sky_mean_arcsec'] == pytest.approx(sky.mean(), abs=1e-4)
    assert out['az_sky_mean_arcsec'] < 0.8 * out['az_mean_arcsec']


def test_model_and_zero_are_taken_off(time):
    model = PointingModel({'IA': 3.0 * ARCSEC, 'IE': -2.0 * ARCSEC})
    run = _run(time, np.full(time.size, 10.0), np.full(time.size, 4.0))
    out = tracking_statistics(tracking_errors(model, run, PowerOnZero(1.0 * ARCSEC, 5.0 * ARCSEC)))
    assert out['az_mean_arcsec'] == pytest.approx(6.0, abs=1e-3)
    assert out['el_mean_arcsec'] == pytest.approx(1.0, abs=1e-3)


def test_statistics_leave_out_what_was_not_seen(time):
    run = _run(time, np.full(time.size, 4.0), np.zeros(time.size))
    run.columns['az_enc'][:10] = np.nan
    errors = tracking_errors(PointingModel({}), run)
    both = gps_statistics({'before': errors, 'after': errors})
    assert both['after']['n'] == time.size - 10
    assert both['before']['az_mean_arcsec'] == pytest.approx(4.0, abs=1e-4)
    assert both['paper']['after']['el_mean_arcsec'] == -3.49
    json.dumps(both, allow_nan=False)
    with pytest.raises(ValueError, match='1 exposures of the satellite'):
        tracking_statistics(tracking_errors(PointingModel({}), run.select(slice(9, 11))))
