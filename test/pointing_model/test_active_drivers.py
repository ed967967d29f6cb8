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
from pointing_model.active_calibration import (
    HORIZON,
    Gauge,
    pointing_context,
    time_driver,
    travelled,
)
from pointing_model.context import Context
from pointing_model.effects import PERIODS, effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.model_application import turned
from pointing_model.sky.site import DEFAULT_SITE
from telescope_mount.observing.night_memory import blind_summary

NOW = 1_768_482_000_000_000_000


def test_the_thermometer_is_read_before_the_command():
    thermometer = Gauge()
    assert thermometer.before(NOW, 7.5) == 7.5
    thermometer.update(NOW, 10.0)
    thermometer.update(NOW + 100, 11.0)
    assert thermometer.before(NOW, 7.5) == 7.5
    assert thermometer.before(NOW + 1, 7.5) == thermometer.before(NOW + 100, 7.5) == 10.0
    assert thermometer.before(NOW + 101, 7.5) == 11.0
    thermometer.update(NOW + 50, 9.0)  # the simulation started anew
    assert thermometer.before(NOW + 101, 7.5) == 9.0


def test_a_drift_in_time_holds_for_its_night():
    stamps = NOW + np.array([0, HORIZON, HORIZON + 1, -HORIZON - 1])
    model = PointingModel({'IA': 0.0}, provenance={'last_stamp_ns': NOW})
    got = time_driver(model, stamps)
    np.testing.assert_array_equal(np.isnan(got), [False, False, True, True])
    assert got[0] == pytest.approx(NOW * 1e-9)
    by_hand = PointingModel({'IA': 0.0}, provenance={'last_stamp_ns': None})
    assert np.isfinite(time_driver(by_hand, stamps)).all()


def test_travel_is_from_the_row_before():
    row = {'az_enc': 6.2, 'el_enc': 0.5, 'approach_az': -1.0, 'approach_el': 1.0}
    got = travelled([0.1, 0.8], row)
    assert got['travel_az'] == pytest.approx(0.1 + 2 * np.pi - 6.2)
    assert got['travel_el'] == pytest.approx(0.3)
    assert (got['before_az'], got['before_el']) == (-1.0, 1.0)
    assert travelled([0.1, 0.8], None) == {}


def test_a_graduation_is_met_at_the_angle_with_the_zero():
    amplitude, zero = 1.0 * ARCSEC, np.array([9.0, -7.0]) * ARCSEC
    subdivision = effect('subdivision', axis='el', graduation='grating', order=1)
    model = PointingModel({'IE': 40 * ARCSEC}, effects=[
        FittedEffect(subdivision, np.array([amplitude, 0.0]))])
    az, el = np.full(9, 1.0), np.linspace(0.6, 0.6001, 9)
    _, reading = turned(model, Context(az, el, {}), zero)
    out = reading - zero[1]
    wanted = amplitude * np.cos(2 * np.pi * np.mod(reading, PERIODS['grating'])
                                / PERIODS['grating'])
    np.testing.assert_allclose((out - el - 40 * ARCSEC) / ARCSEC, wanted / ARCSEC, atol=1e-4)


def test_without_a_reading_nothing_is_iterated():
    model = PointingModel({'IE': 40 * ARCSEC})
    _, el = turned(model, Context(np.array([1.0]), np.array([0.6])))
    assert el[0] - 0.6 == pytest.approx(40 * ARCSEC)


def test_rms_of_a_check():
    got = blind_summary(np.array([[3.0, -4.0], [-3.0, -4.0]]) * ARCSEC, lost=1)
    assert (got['stars'], got['lost']) == (2, 1)
    assert got['rms_arcsec'] == pytest.approx(5.0)
    assert got['rms_x_arcsec'] == pytest.approx(3.0)
    assert got['rms_y_arcsec'] == pytest.approx(4.0)
    assert got['mean_x_arcsec'] == pytest.approx(0.0)
    assert got['mean_y_arcsec'] == pytest.approx(-4.0)
    assert got['max_arcsec'] == pytest.approx(5.0)
    nothing = blind_summary([], lost=3)
    assert nothing['stars'] == 0 and nothing['lost'] == 3 and nothing['rms_arcsec'] is None


@pytest.mark.parametrize('here, sign', [((0.9, 0.7), (1.0, -1.0)), ((1.1, 0.5), (-1.0, 1.0)),
                                        ((1.0 + 2 * np.pi - 0.1, 0.5), (1.0, 1.0))])
def test_the_approach_is_that_of_the_coming_move(here, sign):
    model = PointingModel({'IA': 0.0}, effects=[FittedEffect(
        effect('hysteresis', axis='az', shape='cosE'), np.array([10.0]) * ARCSEC)])
    az, el = np.full(3, 1.0), np.full(3, 0.6)
    where = {'zero': np.zeros(2), 'here': here, 'row': None, 'site': DEFAULT_SITE}
    context = pointing_context(model, np.full(3, NOW), az, el, {'temperature': 4.0},
                               approach=None, **where)
    assert (context.get('approach_az')[0], context.get('approach_el')[0]) == sign
    assert context.get('temperature')[2] == 4.0 and context.latitude == DEFAULT_SITE.latitude
    out, _ = turned(model, context)
    assert (out[0] - 1.0) / ARCSEC == pytest.approx(10.0 * sign[0])
    # once it is there, small moves to the same star do not change the side
    context = pointing_context(model, np.full(3, NOW), az, el, {}, approach=(-1.0, -1.0), **where)
    assert context.get('approach_az')[0] == -1.0
