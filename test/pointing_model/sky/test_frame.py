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

import calendar
from concurrent.futures import ThreadPoolExecutor

import erfa
import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.sky.frame import GRID, frame, full_frame
from pointing_model.sky.places import icrs_to_observed, observed_place
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import DEFAULT_SITE, Site
from pointing_model.sky.star_catalogue import load_catalogue

AIRLESS = Weather(pressure_hpa=0.0)
STAR = load_catalogue(hip=[71683])  # near, and fast
CUBIC = 2e-5 * ARCSEC  # what the cubic through four times of a cell leaves


def _posix(year):
    return calendar.timegm((year, 1, 1, 0, 0, 0))


def fully(time, site):
    """Azimuth and elevation with everything computed for each time."""
    astrom = full_frame(time, site)
    az, distance, *_ = erfa.ufunc.atioq(*erfa.ufunc.atciq(*STAR.at_j2000, astrom), astrom)
    return az, np.pi / 2 - distance


# a night; leap second; before C04, in it and after the tables; UTC that drifts
@pytest.mark.parametrize('begin', [
    1.77e9, 1483228800.0 - 40e3, -1e9, -3e8, -252460800.0 - 30e3, 2.5e9, -1e8])
@pytest.mark.parametrize('site', [DEFAULT_SITE, Site(-70 * DEG, 0.0, 3000.0)],
                         ids=['middle', 'south'])
def test_a_day_is_as_the_full_computation(begin, site):
    time = np.sort(np.random.default_rng(1).uniform(begin, begin + 86400.0, 300))
    az, el = observed_place(STAR, time, site, AIRLESS)
    full = fully(time, site)
    off = np.hypot(wrap(az - full[0]) * np.cos(el), el - full[1])
    assert off.max() < CUBIC


def test_any_date_and_the_whole_sky():
    rng = np.random.default_rng(3)
    edges = GRID * np.arange(90_000, 300_000, 10_000)
    time = np.concatenate([edges, edges - 1e-3, rng.uniform(_posix(1990), _posix(2040), 200)])
    ra = rng.uniform(0.0, 2 * np.pi, (100, 1))
    dec = np.arcsin(rng.uniform(-1.0, 1.0, (100, 1)))
    site = Site(52 * DEG, -1.0, 100.0)

    def places(astrom):
        cirs = erfa.ufunc.atciq(ra, dec, 1e-6, -1e-6, 0.5, 20.0, astrom)
        return erfa.ufunc.atioq(*cirs, astrom)[:2]

    whole = full_frame(time, site)
    (az, distance), (full_az, full_distance) = (
        places(np.array([frame(np.array(t), site) for t in time])), places(whole))
    off = np.hypot(wrap(az - full_az) * np.sin(distance), distance - full_distance)
    assert off.max() < CUBIC


def test_hardly_a_step_between_cells():
    for begin in np.arange(1.2e9, 1.8e9, 3.7e7) // GRID * GRID:
        before, after = (frame(np.array(begin + s), DEFAULT_SITE) for s in (-1e-6, 1e-6))
        for name in ('v', 'bpn', 'eral', 'xpl', 'ypl'):
            assert np.abs(wrap(after[name] - before[name])).max() < 2.0 * CUBIC, name


def test_the_same_alone_in_any_order_and_in_threads():
    rng = np.random.default_rng(2)
    time = rng.uniform(1.5e9, 1.5e9 + 5 * 86400.0, 400)
    time[7] = time[300]
    sites = [Site(0.1 * i, 0.2 * i) for i in range(4)]
    weathers = [Weather(600.0 + 100.0 * i) for i in range(4)]

    def places(i):
        return [icrs_to_observed(0.5, 0.2, one, sites[i], weathers[i]) for one in time.tolist()]

    with ThreadPoolExecutor(4) as pool:
        alone = list(pool.map(places, range(4)))
    for i in range(4):
        np.testing.assert_array_equal(
            np.stack(icrs_to_observed(0.5, 0.2, time, sites[i], weathers[i])),
            np.array(alone[i]).T)


def test_what_is_given_is_the_callers_own():
    time = np.array(1.6e9)
    first = frame(time, DEFAULT_SITE)
    first['eral'] = 0.0
    assert frame(time, DEFAULT_SITE)['eral'] != 0.0


def test_times_that_cannot_be():
    for time in (np.nan, np.inf, 1e20, -1e10):
        with pytest.raises(ValueError, match='outside 1900 to 2100'):
            frame(np.array(time), DEFAULT_SITE)
        with pytest.raises(ValueError, match='outside 1900 to 2100'):
            frame(np.array([1.6e9, time, 1.7e9]), DEFAULT_SITE)
    end = 4133980800.0 // GRID * GRID + GRID - 1.0
    with pytest.raises(ValueError, match='outside 1900 to 2100'):
        frame(np.array(end), DEFAULT_SITE)
