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

"""From axes to places of date and back, and a driver that goes elsewhere brought to its axes."""

from dataclasses import replace

import numpy as np
import pytest
from two_axes import TwoAxes

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.geometry import sky_to_encoder
from pointing_model.mounts import ALTAZ, Mount, is_beyond, through_pole
from pointing_model.sky.places import sidereal_time
from pointing_model.sky.site import Site
from telescope_mount.bridges.axes_and_places import AxisFollower, axes_at, place_of_date

SITE = Site()
GERMAN = Mount.equatorial(SITE.latitude, 'german')
TIME = 1_768_482_000.0


@pytest.mark.parametrize('beyond', [False, True])
def test_axes_become_a_place_of_date_and_the_same_axes_again(beyond):
    axes = GERMAN.on_travel(*through_pole(np.array(-20.0 * DEG if beyond else 20.0 * DEG),
                                          np.array(40.0 * DEG), beyond))
    ra, dec = place_of_date(GERMAN, axes, TIME, SITE)
    assert dec == pytest.approx(40.0 * DEG)
    assert axes_at(GERMAN, ra, dec, TIME, SITE, beyond) == pytest.approx(axes)


def test_axes_of_an_altazimuth_mount_do_so_in_both_hemispheres():
    axes = np.array([[10.0, 95.0, 200.0, 350.0], [20.0, 45.0, 70.0, 88.0]]) * DEG
    for site in (SITE, replace(SITE, latitude=-31.0 * DEG)):
        for first, second in axes.T:
            ra, dec = place_of_date(ALTAZ, (first, second), TIME, site)
            assert axes_at(ALTAZ, ra, dec, TIME, site, False) == pytest.approx((first, second))
    # south, and as high as the equator there: on the meridian, declination 0
    ra, dec = place_of_date(ALTAZ, (np.pi, 0.5 * np.pi - SITE.latitude), TIME, SITE)
    assert dec == pytest.approx(0.0) and np.cos(
        ra - sidereal_time(TIME, SITE)) == pytest.approx(1.0)


def test_a_free_mount_is_refused_in_one_line():
    with pytest.raises(ValueError, match='cannot command the axes of a free mount'):
        place_of_date(Mount.free(0.0, 0.0), (1.0, 0.5), TIME, SITE)


@pytest.mark.parametrize('terms', [
    {'IA': 300.0, 'IE': -200.0}, {'CA': 250.0}, {'NPAE': -300.0}, {'AN': 200.0}, {'AW': 300.0},
    {'IH': 300.0, 'ID': -200.0}, {'CH': 250.0}, {'NP': -300.0}, {'ME': 200.0}, {'MA': 300.0}])
def test_a_simulated_telescope_has_the_errors_of_its_parts(terms):
    errors = {name: value * ARCSEC for name, value in terms.items()}
    kind = 'altaz' if set(errors) & {'IA', 'CA', 'NPAE', 'AN', 'AW'} else 'german'
    mount = ALTAZ if kind == 'altaz' else GERMAN
    now = [TIME]
    telescope = TwoAxes(mount, SITE, errors, clock=lambda: now[0])
    for hour_angle in (-40.0, 25.0):
        telescope.goto(sidereal_time(TIME, SITE) - hour_angle * DEG, 50.0 * DEG)
        for _ in range(2):
            now[0] += 60.0
            axes, believed, true = telescope.look()
        assert telescope.tracking and not telescope.slewing
        assert believed[0] == pytest.approx(np.mod(
            sidereal_time(TIME, SITE) - hour_angle * DEG, 2.0 * np.pi))
        beyond = bool(is_beyond(axes[1]))
        assert beyond == (kind == 'german' and hour_angle < 0.0)
        perfect = axes_at(mount, *true, now[0], SITE, beyond)
        want = np.array(sky_to_encoder(*perfect, errors, mount))
        off = wrap(np.array(axes) - want) * (np.cos(axes[1]), 1.0)
        assert np.abs(off).max() < 0.001 * ARCSEC and np.hypot(*wrap(
            np.array(axes) - perfect)) > 50.0 * ARCSEC
    telescope.abort()
    now[0] += 60.0
    assert np.all(telescope.look()[0] == axes) and not telescope.tracking


@pytest.mark.parametrize('beyond', [False, True])
def test_a_driver_with_a_model_of_its_own_is_brought_to_the_demanded_axes(beyond):
    terms = dict.fromkeys(('IH', 'ID', 'CH', 'NP', 'MA', 'ME'), 300.0 * ARCSEC)
    demand = np.array(GERMAN.on_travel(*through_pole(
        np.array(-35.0 * DEG if beyond else 35.0 * DEG), np.array(50.0 * DEG), beyond)))
    follower, steps = AxisFollower(GERMAN, SITE), 0
    while True:
        ra, dec = follower.target(demand, TIME)
        perfect = axes_at(GERMAN, ra, dec, TIME, SITE, beyond)
        reading = np.array(sky_to_encoder(*perfect, terms, GERMAN))
        steps += 1
        if not follower.learn(demand, reading):
            break
    assert follower.arrived(demand, reading) and 2 <= steps <= 4


def test_axes_on_the_other_side_of_the_pier_are_not_chased():
    follower = AxisFollower(GERMAN, SITE)
    demand = np.array([100.0, 30.0]) * DEG
    other = np.array([280.0, 150.0]) * DEG
    assert follower.other_side(demand, other) and not follower.learn(demand, other)
    assert is_beyond(other[1]) and np.all(follower.correction == 0.0)
    assert np.abs(wrap(follower.off(demand, demand))).max() == 0.0
