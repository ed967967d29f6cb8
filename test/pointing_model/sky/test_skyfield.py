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

"""Observed place against Skyfield, which shares no code with ERFA."""

import warnings

import erfa
import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.earth import earth_orientation, split_utc
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site
from pointing_model.sky.star_catalogue import Stars, load_catalogue

REASON = 'Skyfield and skyfield-data (extra "test") are the independent reference'
skyfield_api = pytest.importorskip('skyfield.api', reason=REASON)
skyfield_data = pytest.importorskip('skyfield_data', reason=REASON)

SITE = Site(34.3 * DEG, 109.0 * DEG, 500.0)
VACUUM = Weather(pressure_hpa=0.0)
TIMES = np.linspace(0.0, 2.04e9, 20) + 12345.678 * np.arange(20)  # 1970 to 2034


def _vector(az, el):
    return np.stack([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)], axis=-1)


def _separation(az1, el1, az2, el2):
    a, b = _vector(az1, el1), _vector(az2, el2)
    return 2.0 * np.arcsin(np.linalg.norm(a - b, axis=-1) / 2.0)


def _synthetic(ra, dec):
    n = len(ra)
    zero = np.zeros(n)
    return Stars(np.arange(n), np.asarray(ra), np.asarray(dec), zero, zero, zero, zero, zero)


def _join(first, second):
    names = ('hip', 'ra', 'dec', 'pm_ra_cosdec', 'pm_dec', 'parallax', 'rv', 'mag')
    return Stars(*(np.concatenate([getattr(first, n), getattr(second, n)]) for n in names))


def _zenith_and_pole(time, orientation):
    """ICRS directions that are at the zenith and at the celestial pole of that moment."""
    utc = split_utc(time)
    ra, dec, _ = erfa.ufunc.atoc13(
        b'A', [0.3, 0.3], [1e-5, np.pi / 2.0 - SITE.latitude], *utc, orientation.dut1,
        SITE.longitude, SITE.latitude, SITE.height, orientation.xp, orientation.yp,
        0.0, 0.0, 0.0, 0.5)
    ra[1], dec[1] = erfa.c2s(erfa.pnm06a(*utc)[2])  # the pole of date itself
    return _synthetic(ra, dec)


def _skyfield_place(stars, time, orientation, planets):
    utc = split_utc(time)
    tt = erfa.taitt(*erfa.ufunc.utctai(*utc)[:2])
    ut1 = erfa.ufunc.utcut1(*utc, orientation.dut1)
    delta_t = ((tt[0] - ut1[0]) + (tt[1] - ut1[1])) * 86400.0
    scale = skyfield_api.load.timescale(delta_t=delta_t)
    scale.polar_motion_table = ([0.0], [orientation.xp / ARCSEC], [orientation.yp / ARCSEC])
    moment = scale.tt_jd(*tt)
    mas = ARCSEC / 1000.0
    star = skyfield_api.Star(
        ra_hours=stars.ra * 12.0 / np.pi, dec_degrees=stars.dec / DEG,
        ra_mas_per_year=stars.pm_ra_cosdec / mas, dec_mas_per_year=stars.pm_dec / mas,
        parallax_mas=np.maximum(stars.parallax, 1e-9 * mas) / mas,
        radial_km_per_s=stars.rv, epoch=2448349.0625)
    place = skyfield_api.wgs84.latlon(SITE.latitude / DEG, SITE.longitude / DEG, SITE.height)
    el, az, _ = (planets['earth'] + place).at(moment).observe(star).apparent().altaz()
    return az.radians, el.radians


@pytest.fixture(scope='module')
def planets():
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)  # its IERS table is old, and not used
        folder = skyfield_data.get_skyfield_data_path()
    ephemeris = skyfield_api.Loader(folder, verbose=False)('de421.bsp')
    yield ephemeris
    ephemeris.close()


def test_a_hundred_stars_on_twenty_dates(planets):
    catalogue = load_catalogue(6.0)
    stars = catalogue.select(np.random.default_rng(1).choice(len(catalogue), 97, replace=False))
    # the fastest star, the nearest bright one, and Polaris
    stars = _join(stars, load_catalogue(hip=[87937, 71683, 11767]))
    worst = []
    for time in TIMES:
        orientation = earth_orientation(time)
        all_stars = _join(stars, _zenith_and_pole(time, orientation))
        az, el = observed_place(all_stars, time, SITE, VACUUM)
        assert el[-2] / DEG > 89.99 and abs(el[-1] - SITE.latitude) < 30 * ARCSEC  # aberration
        reference = _skyfield_place(all_stars, time, orientation, planets)
        worst.append(_separation(az, el, *reference) / ARCSEC)
    worst = np.array(worst)
    assert worst.shape == (20, 102)
    assert worst.max() < 0.01, f'worst {worst.max():.4f} arcsec'


def test_the_comparison_sees_a_hundredth_of_an_arcsecond(planets):
    """UT1 wrong by 2 ms must break the agreement, else the test above proves nothing."""
    stars = load_catalogue(4.0)
    time = TIMES[10]
    right = earth_orientation(time)
    az, el = observed_place(stars, time + 0.002, SITE, VACUUM)
    reference = _skyfield_place(stars, time, right, planets)
    assert np.max(_separation(az, el, *reference)) > 0.02 * ARCSEC
