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

"""Observed place: refraction, shapes, and agreement with ERFA star by star."""

import warnings

import erfa
import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.sky.earth import earth_orientation, split_utc
from pointing_model.sky.places import icrs_to_observed, observed_place
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import DEFAULT_SITE, Site
from pointing_model.sky.star_catalogue import EPOCH_JD, POLARIS_HIP, load_catalogue

TIME = 1.7e9
VACUUM = Weather(pressure_hpa=0.0)


def _up(limit=10.0, site=DEFAULT_SITE):
    stars = load_catalogue(4.0)
    return stars.select(observed_place(stars, TIME, site)[1] > limit * DEG)


def test_polaris_is_near_the_pole():
    time = TIME + np.arange(0.0, 86400.0, 600.0)
    site = Site()
    az, el = observed_place(load_catalogue(hip=[POLARIS_HIP]), time, site, VACUUM)
    assert az.shape == el.shape == (144,)
    assert np.abs(el - site.latitude).max() == pytest.approx(0.63 * DEG, abs=0.02 * DEG)
    assert np.abs(wrap(az)).max() < 0.8 * DEG
    # the sky turns from east to west above the pole: azimuth falls at upper culmination
    top, bottom = np.argmax(el), np.argmin(el)
    rate = wrap(observed_place(load_catalogue(hip=[POLARIS_HIP]), time + 1.0, site, VACUUM)[0] - az)
    assert rate[top] < 0 < rate[bottom]


def test_stars_rise_in_the_east():
    stars = _up()
    az, el = observed_place(stars, TIME)
    rate = observed_place(stars, TIME + 1.0)[1] - el
    assert np.all(rate[np.sin(az) > 0.2] > 0) and np.all(rate[np.sin(az) < -0.2] < 0)


def test_same_as_erfa_star_by_star():
    site = Site(-31.0 * DEG, -70.7 * DEG, 2200.0)
    stars = _up(site=site)
    air = Weather(780.0, 5.0, 0.3, 0.65)
    o = earth_orientation(TIME)
    az, el = observed_place(stars, TIME, site, air)
    ra, dec, pm_ra, pm_dec, parallax, rv, _ = erfa.ufunc.pmsafe(
        stars.ra, stars.dec, stars.pm_ra_cosdec / np.cos(stars.dec), stars.pm_dec,
        np.maximum(stars.parallax, 0) / ARCSEC, stars.rv, EPOCH_JD, 0.0, 2451545.0, 0.0)
    az_erfa, zenith_distance, *_ = erfa.atco13(
        ra, dec, pm_ra, pm_dec, parallax, rv, *split_utc(TIME), o.dut1, site.longitude,
        site.latitude, site.height, o.xp, o.yp, 780.0, 5.0, 0.3, 0.65)
    assert len(stars) > 50
    # what changes slowly is interpolated, see `sky_frame`
    assert np.abs(wrap(az - az_erfa) * np.cos(el)).max() < 1e-4 * ARCSEC
    assert np.abs(el - (np.pi / 2 - zenith_distance)).max() < 1e-4 * ARCSEC


def test_proper_motion_and_parallax_of_barnards_star():
    star = load_catalogue(hip=[87937])
    still = (star.ra[0], star.dec[0])
    times = np.arange(0.0, 2.0e9, 7.0e6)
    moving = observed_place(star, times, weather=VACUUM)
    fixed = icrs_to_observed(*still, times, weather=VACUUM)
    a, b = (np.stack([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)])
            for az, el in (moving, fixed))
    separation = np.linalg.norm(a - b, axis=0) / ARCSEC
    years = times / (365.25 * 86400) + 1970.0 - 1991.25
    assert np.abs(separation - 10.359 * np.abs(years)).max() < 0.6
    late = years > 5
    wiggle = separation[late] - np.polyval(
        np.polyfit(years[late], separation[late], 2), years[late])
    # the motion is across the ecliptic: the ellipse's short axis, 0.548" sin(28 deg) = 0.257"
    assert np.ptp(wiggle) / 2 == pytest.approx(0.257, abs=0.025)


def _refraction_integral(el, pressure, celsius, wavelength):
    """Ray through dry, hydrostatic shells: 6.5 K/km to 11 km, isothermal above (arcsec)."""
    r0, gravity, gas = 6371e3, 9.80665, 287.05
    h = np.concatenate([np.linspace(0, 11e3, 4001), np.linspace(11e3, 80e3, 8001)[1:]])
    t0 = celsius + 273.15
    t = np.where(h <= 11e3, t0 - 0.0065 * h, t0 - 71.5)
    p = pressure * np.where(
        h <= 11e3, (t / t0) ** (gravity / gas / 0.0065),
        ((t0 - 71.5) / t0) ** (gravity / gas / 0.0065) * np.exp(-gravity * (h - 11e3) / gas / t))
    k = 1.0 / wavelength**2  # Edlen 1966 at 15 degrees, 1013.25 hPa
    edlen = 1e-8 * (8342.13 + 2406030.0 / (130.0 - k) + 15997.0 / (38.9 - k))
    n = 1.0 + edlen * p / 1013.25 * 288.15 / t
    sine = n[0] * r0 * np.cos(el) / (n * (r0 + h))
    slope = sine / np.sqrt(1.0 - sine**2) / n
    return np.sum((slope[1:] + slope[:-1]) / 2.0 * -np.diff(n)) / ARCSEC


@pytest.mark.parametrize('pressure, celsius, wavelength', [
    (1013.25, 10.0, 0.55), (780.0, -5.0, 0.8), (955.0, 25.0, 0.45)])
def test_refraction_against_an_integral(pressure, celsius, wavelength):
    stars = _up()
    _, apparent = observed_place(stars, TIME, weather=Weather(pressure, celsius, 0.0, wavelength))
    az, true = observed_place(stars, TIME, weather=VACUUM)
    refraction = (apparent - true) / ARCSEC
    expected = np.array([_refraction_integral(e, pressure, celsius, wavelength) for e in apparent])
    assert np.abs(refraction / expected - 1.0)[apparent > 20 * DEG].max() < 2e-3
    assert np.abs(refraction - expected)[apparent > 15 * DEG].max() < 0.4
    assert np.all(refraction > 0)


def test_refraction_of_the_almanac():
    """58.294" tan z - 0.0668" tan^3 z at 10 degrees and 760 mm (Smart)."""
    stars = _up(limit=20.0)
    _, apparent = observed_place(stars, TIME, weather=Weather(1013.25, 10.0, 0.0, 0.575))
    _, true = observed_place(stars, TIME, weather=VACUUM)
    tangent = 1.0 / np.tan(apparent)
    almanac = 58.294 * tangent - 0.0668 * tangent**3
    assert np.abs((apparent - true) / ARCSEC / almanac - 1.0).max() < 4e-3


def test_refraction_leaves_azimuth_alone():
    stars = _up()
    with_air, without = observed_place(stars, TIME), observed_place(stars, TIME, weather=VACUUM)
    assert np.abs(wrap(with_air[0] - without[0])).max() < 1e-10


def test_many_times_are_the_same_as_one_by_one():
    stars = _up().select(slice(12))
    time = TIME + np.array([0, 50, 50, 0, 3e7, 9, 8, 7, 6, 5, -3e8, 0.0])
    pressure = np.linspace(900.0, 1000.0, 12)
    together = observed_place(stars, time, weather=Weather(pressure, 5.0, 0.2))
    for k in range(12):
        alone = observed_place(
            stars.select([k]), time[k], weather=Weather(pressure[k], 5.0, 0.2))
        for axis in (0, 1):
            assert together[axis][k] == pytest.approx(alone[axis][0], abs=1e-13)


@pytest.mark.parametrize('time', [-2.2e9, -1e9, -2.8e8, 0.0, 4.1e9])
def test_any_date_without_warning(time):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        az, el = observed_place(load_catalogue(4.0), time)
    assert np.all((az >= 0) & (az < 2 * np.pi)) and np.all(np.abs(el) <= np.pi / 2)


def test_icrs_direction():
    star = load_catalogue(hip=[24436])  # Rigel: hardly any proper motion
    place = observed_place(star, TIME)
    same = icrs_to_observed(float(star.ra[0]), float(star.dec[0]), TIME)
    assert np.ndim(same[0]) == 0
    assert abs(same[0] - place[0][0]) < 0.1 * ARCSEC and abs(same[1] - place[1][0]) < 0.1 * ARCSEC


@pytest.mark.parametrize('make, words', [
    (lambda: Site(latitude=95 * DEG), 'latitude 95 is outside -90 to 90 degrees'),
    (lambda: Site(longitude=np.nan), 'longitude nan'),
    (lambda: Site(height=5e4), 'height'),
    (lambda: Weather(pressure_hpa=101325.0), 'pressure'),
    (lambda: Weather(humidity=50.0), 'humidity'),
    (lambda: Weather(temperature_c=np.array([10.0, 283.15])), 'temperature 283.15'),
    (lambda: Weather(wavelength_um=550.0e-9), 'wavelength'),
    (lambda: observed_place(load_catalogue(4.0), np.zeros(3)), '3 times for'),
    (lambda: observed_place(load_catalogue(4.0), 1e12), 'outside 1900 to 2100'),
])
def test_errors_in_one_line(make, words):
    with pytest.raises(ValueError, match=words) as error:
        make()
    assert '\n' not in str(error.value)
