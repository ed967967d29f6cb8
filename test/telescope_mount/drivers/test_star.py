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

"""A bright star to nudge beside."""

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import parse_mount
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from telescope_mount.drivers.nudge import BRIGHT, HIGH, LOW, bright_star, place_of
from telescope_mount.observing.star_choice import ANYWHERE, axes_at

NIGHT = 1768482000.0


@pytest.mark.parametrize('kind', ['altaz', 'equatorial', 'german'])
def test_a_bright_star_is_followed_on_the_turn_and_side_of_the_mount(kind):
    mount = parse_mount(kind, DEFAULT_SITE.latitude)
    here = np.array([400.0, 45.0]) * DEG if mount.vertical else np.array([10.0, 40.0]) * DEG
    target = bright_star(mount, DEFAULT_SITE, NIGHT, here)
    assert target.magnitude <= BRIGHT
    times = NIGHT + np.arange(0.0, 200.0, 10.0)
    az, el = target.place(times, DEFAULT_SITE, DEFAULT_WEATHER)
    assert LOW < el[0] < HIGH
    angles = place_of(target, mount, DEFAULT_SITE, here)(times)
    assert np.abs(np.diff(angles, axis=0)).max() < 0.5 * DEG
    if mount.vertical:
        assert abs(angles[0, 0] - here[0]) <= np.pi
    wanted = np.column_stack(axes_at(mount, az, el, ANYWHERE, np.full(len(az), target.number)))
    # on the sky: whatever the turn
    np.testing.assert_allclose(np.exp(1j * angles), np.exp(1j * wanted), atol=0.01 * ARCSEC)


class Sky:
    """Allowed where `free(az)` says so."""

    def __init__(self, free):
        self._free = free

    def __call__(self, time, az, el):
        return self._free(az)

    def within(self, first, second):
        return np.ones(len(first), bool)


def test_a_star_is_taken_only_where_the_guard_lets_the_tube_look():
    mount, here = parse_mount('altaz', DEFAULT_SITE.latitude), np.array([100.0, 45.0]) * DEG

    target = bright_star(mount, DEFAULT_SITE, NIGHT, here, Sky(lambda az: np.sin(az) < -0.2))
    assert np.sin(target.place(np.array([NIGHT]), DEFAULT_SITE, DEFAULT_WEATHER)[0][0]) < -0.2
    with pytest.raises(ValueError, match='no star brighter than 3 between 30 and 75 deg where'):
        bright_star(mount, DEFAULT_SITE, NIGHT, here, Sky(lambda az: np.zeros(len(az), bool)))
