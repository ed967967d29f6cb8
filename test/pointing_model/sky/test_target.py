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

from pointing_model.sky.elements import GPS_26690
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import (
    POLARIS_HIP,
    StarTarget,
    load_catalogue,
    satellite_target,
)

NIGHT = 1_379_854_800.0  # 2013-09-22 13:00 UTC


def test_a_star_is_where_the_sky_has_it():
    polaris = load_catalogue(hip=[POLARIS_HIP])
    target = StarTarget(polaris)
    times = NIGHT + np.array([0.0, 600.0])
    az, el = target.place(times, DEFAULT_SITE, DEFAULT_WEATHER)
    for i, time in enumerate(times):
        assert (az[i], el[i]) == pytest.approx(
            [v[0] for v in observed_place(polaris, time)], abs=1e-12)
    assert (target.number, target.name) == (POLARIS_HIP, f'HIP {POLARIS_HIP}')
    assert 1.5 < target.magnitude < 2.5


def test_the_satellite_of_the_paper_by_name_and_by_file(tmp_path):
    by_name = satellite_target('gps-26690')
    (tmp_path / 'gps.tle').write_text('USA 156\n' + '\n'.join(GPS_26690) + '\n')
    by_file = satellite_target(str(tmp_path / 'gps.tle'))
    places = [t.place(np.array([NIGHT]), DEFAULT_SITE, DEFAULT_WEATHER) for t in (by_name, by_file)]
    np.testing.assert_array_equal(places[0], places[1])
    assert by_name.number == -26690 and by_name.name == 'satellite 26690'
    assert np.isnan(by_name.magnitude)
    # a GPS satellite goes round the Earth twice a day: half a degree a minute, not 15'
    az, el = by_name.place(NIGHT + np.array([0.0, 60.0]), DEFAULT_SITE, DEFAULT_WEATHER)
    moved = np.hypot(np.diff(az) * np.cos(el[0]), np.diff(el))[0] * 3437.7
    assert 20.0 < moved < 45.0


def test_no_satellite():
    assert satellite_target('') is None


@pytest.mark.parametrize('text', ['nowhere.tle', 'empty.tle'])
def test_bad_elements(tmp_path, text):
    (tmp_path / 'empty.tle').write_text('nothing\n')
    with pytest.raises((ValueError, OSError)):
        satellite_target(str(tmp_path / text))
