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

"""Passes that an axis is too slow for: the shortest way across, and what it costs."""

import numpy as np
import pytest
from kepler_orbit import START, terrestrial

from msg_tools.units import DEG
from pointing_model.mounts import ALTAZ, parse_mount
from pointing_model.sky.orbits.ephemeris import Arc, Orbit
from pointing_model.sky.site import Site
from telescope_mount.guard.limits import Axis
from telescope_mount.observing.keyhole import STEP, across, keyholes
from telescope_mount.observing.pass_forecast import pass_forecasts

TIME = np.arange(-150.0, 150.0, STEP)
#: azimuth of what passes 2 degrees beside the zenith at 0.98 deg/s
AZIMUTH = np.arctan(0.98 * TIME / 2.0)


@pytest.mark.parametrize('acceleration', [1.5, 3.0, 1000.0])
def test_the_way_across_keeps_the_limits_and_is_on_the_track_again(acceleration):
    axis = Axis(-9.0, 9.0, 6.0 * DEG, acceleration * DEG)
    angles = np.stack((AZIMUTH, 0.0 * TIME), axis=1)
    (hole,) = keyholes(TIME, angles, (axis, axis))
    assert hole.axis == 0 and hole.wanted / DEG == pytest.approx(28.0, abs=0.2)
    assert 24.0 < hole.lost < 34.0
    bridged, rates = across(TIME, AZIMUTH, np.gradient(AZIMUTH, TIME), hole, axis)
    outside = (hole.begin > TIME) | (hole.end < TIME)
    assert np.array_equal(bridged[outside], AZIMUTH[outside])
    assert np.abs(np.diff(bridged)).max() / STEP <= 6.05 * DEG
    inside = (hole.begin + STEP < TIME) & (hole.end - STEP > TIME)
    assert np.abs(rates[inside]).max() <= 6.0 * DEG
    if acceleration < 100.0:
        assert np.abs(np.gradient(rates[inside], STEP)).max() <= 1.2 * acceleration * DEG


def test_no_shorter_way_keeps_the_rate():
    axis = Axis(-9.0, 9.0, 6.0 * DEG, 1000.0 * DEG)
    (hole,) = keyholes(TIME, np.stack((AZIMUTH, 0.0 * TIME), axis=1), (axis, axis))
    n = round(hole.lost / STEP) - 2
    needed = (AZIMUTH[n:] - AZIMUTH[:-n]) / (n * STEP)
    over = (TIME[:-n] < -4.0) & (TIME[n:] > 4.0)  # that are off while it is too fast
    fast = np.abs(np.gradient(AZIMUTH, TIME)) > 6.0 * DEG
    whole = over & (TIME[:-n] < TIME[fast][0]) & (TIME[n:] > TIME[fast][-1])
    assert needed[whole].size == 0 or needed[whole].min() > 0.97 * 6.0 * DEG


@pytest.mark.parametrize(('kind', 'keyhole'), [('altaz', True), ('xy', False)])
def test_a_low_satellite_overhead_has_a_keyhole_where_the_mount_has_its_pole(kind, keyhole):
    seconds = 10.0 * np.arange(700)
    low = {'axis': 6.85e6, 'eccentricity': 0.001, 'tilt': 0.92}
    place, _ = terrestrial(seconds, **low)
    orbit = Orbit('LOW', (Arc(START + 37.0, seconds, place, None, np.full(len(place), 50.0), ''),))
    # a site 0.2 degrees beside the track, when it is half way
    beside = place[350] / np.linalg.norm(place[350])
    site = Site(np.arcsin(beside[2]) + 0.1 * DEG, np.arctan2(beside[1], beside[0]), 0.0)
    axes = [Axis(-9.0, 9.0, 6.0 * DEG, 3.0 * DEG)] * 2
    mount = ALTAZ if kind == 'altaz' else parse_mount(kind)
    (one,) = pass_forecasts(orbit, START, 2.0, site, mount=mount, axes=axes, dark=False)
    assert one.top_el > 85.0 * DEG and one.fastest > 0.5 * DEG
    assert bool(one.keyholes) == keyhole and (one.lost > 10.0) == keyhole
    assert one.document()['lost_s'] == one.lost and 0.0 <= one.phase <= np.pi
