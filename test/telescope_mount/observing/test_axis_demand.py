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

from msg_tools.units import ARCSEC, DEG
from pointing_model.active_calibration import ActiveCalibration
from pointing_model.model import PointingModel
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.zero import PowerOnZero
from telescope_mount.observing.axis_demand import KNOT, AxesAtRest, Conditions, Pointing, track_to

START = 1_768_482_000_000_000_000
SECOND = 10**9


class Fixed:
    """A target of the test that moves by `rate` (rad/s)."""

    number, magnitude = 1, 2.0

    def __init__(self, az, el, rate=(0.0, 0.0)):
        self.at, self.rate = (az, el), rate

    def place(self, time, site, weather):
        t = time - START * 1e-9
        return self.at[0] + self.rate[0] * t, self.at[1] + self.rate[1] * t


def conditions(az, el):
    return Conditions(DEFAULT_SITE, DEFAULT_WEATHER, np.array([az, el]), 1, None)


@pytest.mark.parametrize('here, target, track, approach', [
    (10, 350, -10, -1), (350, 10, 370, 1), (-170, 170, -190, -1), (400, 30, 390, -1)])
def test_the_azimuth_goes_the_shorter_way_from_where_it_stands(here, target, track, approach):
    pointing = Pointing(Fixed(target * DEG, 50 * DEG), ActiveCalibration(), np.zeros(2))
    got = track_to(pointing, START, conditions(here * DEG, 40 * DEG), 4.0)
    np.testing.assert_allclose(got.angles, np.tile(np.array([track, 50]) * DEG, (7, 1)), rtol=1e-12)
    np.testing.assert_array_equal(pointing.approach, [approach, 1])


def test_a_track_is_long_enough_and_goes_on_through_north():
    rate = np.array([0.1, -0.02]) * DEG
    pointing = Pointing(Fixed(355 * DEG, 50 * DEG, rate), ActiveCalibration(), np.zeros(2))
    track = track_to(pointing, START, conditions(350 * DEG, 50 * DEG), 1.0)
    np.testing.assert_array_equal(np.diff(track.times), KNOT)
    assert track.times[-1] >= 60.0 + 180.0 / 1.0 and track.end == START + 260 * SECOND
    np.testing.assert_allclose(np.diff(track.angles, axis=0) / KNOT, np.tile(rate, (13, 1)),
                               rtol=1e-6)
    # of stamps as floats a microsecond is left
    np.testing.assert_allclose(track.rates, np.tile(rate, (14, 1)), rtol=1e-6)


def test_how_the_axes_came_is_that_of_the_first_command():
    pointing = Pointing(Fixed(1.0, 0.8), ActiveCalibration(), np.zeros(2))
    track_to(pointing, START, conditions(0.5, 1.0), 4.0)
    track_to(pointing, START, conditions(1.001, 0.79), 4.0)
    np.testing.assert_array_equal(pointing.approach, [1, -1])


def test_model_zero_and_aim_are_in_the_demand_once():
    now = ActiveCalibration(PointingModel({'IA': 100 * ARCSEC, 'IE': -50 * ARCSEC}))
    now.update_zero(1, PowerOnZero(7 * ARCSEC, 3 * ARCSEC))
    pointing = Pointing(Fixed(1.0, 0.8), now, np.array([20.0, 10.0]) * ARCSEC)
    got = pointing.demand(np.array([START]), conditions(0.0, 0.5))[0]
    np.testing.assert_allclose((got - [1.0, 0.8]) / ARCSEC, [127.0, -37.0], rtol=0, atol=0.02)


def test_standing_is_a_track_too():
    standing = AxesAtRest(np.array([3.0, 0.8]))
    track = track_to(standing, START, conditions(3.0, 0.8), 4.0)
    np.testing.assert_array_equal(track.angles, np.tile([3.0, 0.8], (7, 1)))
    np.testing.assert_allclose(track.rates, 0.0, atol=1e-15)
