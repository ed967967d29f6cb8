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

"""What would be seen of the catalogue where a tube looks."""

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import Mount, centred, through_pole
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import load_catalogue
from telescope_mount.bridges.axes_and_places import place_of_date
from telescope_mount.bridges.star_field import StarField

MOUNT = Mount.equatorial(DEFAULT_SITE.latitude, 'german')
STAMP = 1_768_482_000 * 10**9


@pytest.fixture(scope='module')
def field():
    return StarField(MOUNT, DEFAULT_SITE, DEFAULT_WEATHER, 0.4 * DEG, noise=0.0)


@pytest.fixture(scope='module')
def star_axes():
    """Of a bright star well up and far from the pole, not through the pole."""
    stars = load_catalogue(mag_limit=2.5)
    az, el = observed_place(stars, STAMP * 1e-9, DEFAULT_SITE, DEFAULT_WEATHER)
    first, second = MOUNT.axes_of(az, el)
    row = np.flatnonzero((el > 40.0 * DEG) & (np.abs(second) < 60.0 * DEG))[0]
    return first[row], second[row]


@pytest.mark.parametrize('beyond', [False, True])
def test_the_miss_distance_centres_the_star_on_either_side(field, star_axes, beyond):
    star = np.array(MOUNT.on_travel(*through_pole(*star_axes, beyond)))
    axes = star + np.array([400.0, -250.0]) * ARCSEC
    place = place_of_date(MOUNT, axes, STAMP * 1e-9, DEFAULT_SITE)
    miss = field.miss(STAMP, place, axes[1])
    # toward rising readings, whatever the side
    assert miss == pytest.approx(
        [-400.0 * ARCSEC * np.cos(star[1]), 250.0 * ARCSEC], abs=1.5 * ARCSEC)
    off = np.array(centred(*axes, *miss, beyond)) - star
    assert np.abs(wrap(off)).max() < 0.01 * ARCSEC


def test_a_satellite_in_the_field_comes_before_the_stars(star_axes):
    place = place_of_date(MOUNT, star_axes, STAMP * 1e-9, DEFAULT_SITE)
    az, el = MOUNT.horizon_of(*star_axes)

    class Light:
        north = 0.1 * DEG

        def place(self, time, site, weather):
            return az + 0.0 * time, el + self.north + 0.0 * time
    light = Light()
    field = StarField(MOUNT, DEFAULT_SITE, DEFAULT_WEATHER, 0.4 * DEG, noise=0.0, satellite=light)
    seen = field.miss(STAMP, place, star_axes[1])
    assert np.hypot(*seen) == pytest.approx(light.north, rel=1e-3)
    light.north = 1.0 * DEG  # of the stars again
    assert np.hypot(*field.miss(STAMP, place, star_axes[1])) < 2.0 * ARCSEC


def test_no_star_in_the_field_is_no_number_and_noise_is_of_its_stamp(star_axes):
    place = place_of_date(MOUNT, star_axes, STAMP * 1e-9, DEFAULT_SITE)
    empty = StarField(MOUNT, DEFAULT_SITE, DEFAULT_WEATHER, 1.0 * ARCSEC, noise=0.0)
    away = place[0] + 0.3 * DEG, place[1]
    assert np.isnan(empty.miss(STAMP, away, star_axes[1])).all()
    noisy = StarField(MOUNT, DEFAULT_SITE, DEFAULT_WEATHER, 0.4 * DEG, noise=ARCSEC)
    one, same, other = (noisy.miss(stamp, place, star_axes[1])
                        for stamp in (STAMP, STAMP, STAMP + 1))
    assert np.array_equal(one, same) and not np.array_equal(one, other)
    assert np.hypot(*one) < 6.0 * ARCSEC
