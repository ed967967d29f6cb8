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

"""Satellites: elements, observed place against Skyfield, every correction, the Sun."""

import itertools
import warnings

import erfa
import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.earth import TURN_RATE, EarthOrientation, earth_orientation, split_utc
from pointing_model.sky.elements import GPS_26690, parse_elements
from pointing_model.sky.places import icrs_to_observed, sun_place
from pointing_model.sky.refraction import Weather
from pointing_model.sky.satellite_place import Corrections, in_sunlight, satellite_place
from pointing_model.sky.site import Site

GPS = parse_elements(GPS_26690)
SITE = Site()
AIR = Weather()
VACUUM = Weather(pressure_hpa=0.0)
START = 1379721600.0  # 2013-09-21
# a low orbit, where light time, parallax and refraction differ most from those of GPS
ISS = ('1 25544U 98067A   13264.51000000  .00002182  00000-0  45000-4 0  9991',
       '2 25544  51.6480 100.0000 0003000  80.0000 280.0000 15.50000000849993')


@pytest.fixture(scope='module')
def one_pass():
    """Times through the pass of GPS 26690 on the evening of its epoch."""
    time = np.arange(START, START + 86400.0, 10.0)
    up = time[satellite_place(GPS, time)[1] >= 20.0 * DEG]
    assert np.all(np.diff(up) == 10.0)
    return np.linspace(up[0], up[-1], 40)


def _vector(az, el):
    return np.stack([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)], axis=-1)


def _separation(az1, el1, az2, el2):
    """Arcsec."""
    difference = np.linalg.norm(_vector(az1, el1) - _vector(az2, el2), axis=-1)
    return 2.0 * np.arcsin(difference / 2.0) / ARCSEC


def _with_checksum(line):
    from sgp4.io import compute_checksum
    return line[:68] + str(compute_checksum(line[:68] + '0'))


# place, against code that shares nothing with it but the SGP4 library


def _skyfield(lines, time, orientation, site):
    api = pytest.importorskip('skyfield.api', reason='Skyfield (extra "test") is the reference')
    data = pytest.importorskip('skyfield_data', reason='ephemeris of the reference')
    utc = split_utc(time)
    tt = erfa.taitt(*erfa.ufunc.utctai(*utc)[:2])
    ut1 = erfa.ufunc.utcut1(*utc, orientation.dut1)
    delta_t = ((tt[0] - ut1[0]) + (tt[1] - ut1[1])) * 86400.0
    scale = api.load.timescale(delta_t=float(np.mean(delta_t)))
    scale.polar_motion_table = (
        [0.0], [float(orientation.xp) / ARCSEC], [float(orientation.yp) / ARCSEC])
    moment = scale.tt_jd(*tt)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)
        planets = api.Loader(data.get_skyfield_data_path(), verbose=False)('de421.bsp')
    place = api.wgs84.latlon(site.latitude / DEG, site.longitude / DEG, site.height)
    satellite = api.EarthSatellite(*lines, ts=scale)
    geometric = (satellite - place).at(moment).altaz()
    apparent = (planets['earth'] + place).at(moment).observe(
        planets['earth'] + satellite).apparent().altaz()
    planets.close()
    return geometric, apparent


def _orientation(time):
    """As Skyfield can take it: one UT1-UTC and one pole."""
    middle = earth_orientation(float(np.mean(time)))
    return EarthOrientation(middle.dut1, middle.xp, middle.yp, 0.0, 0.0, middle.source)


@pytest.mark.parametrize(('lines', 'limit'), [(GPS_26690, 0.01), (ISS, 0.01)])
@pytest.mark.parametrize('day', [-100, 0, 3, 400])
def test_place_agrees_with_skyfield(lines, limit, day):
    lines = tuple(_with_checksum(line) for line in lines)
    satellite = parse_elements(lines)
    time = START + 86400.0 * day + np.linspace(0.0, 86400.0, 200)
    orientation = _orientation(time)
    geometric, apparent = _skyfield(lines, time, orientation, SITE)
    az, el, distance = satellite_place(
        satellite, time, SITE, VACUUM, orientation,
        Corrections(light_time=False, diurnal_aberration=False))
    assert np.max(_separation(az, el, geometric[1].radians, geometric[0].radians)) < limit
    assert np.max(np.abs(distance - geometric[2].m)) < 0.1 + 1e-8 * np.max(distance)
    az, el, _ = satellite_place(satellite, time, SITE, VACUUM, orientation)
    error = _separation(az, el, apparent[1].radians, apparent[0].radians)
    # through the barycentre: 20" of light time and 20" of annual aberration that must cancel
    assert np.max(error) < limit, f'{np.max(error):.4f} arcsec'


def test_the_comparison_sees_a_hundredth_of_an_arcsecond():
    time = START + np.linspace(0.0, 86400.0, 50)
    orientation = _orientation(time)
    _, apparent = _skyfield(GPS_26690, time, orientation, SITE)
    seen = {}
    for name in ('light_time', 'diurnal_aberration', 'annual_aberration'):
        wrong = Corrections(**{name: name == 'annual_aberration'})
        az, el, _ = satellite_place(GPS, time, SITE, VACUUM, orientation, wrong)
        seen[name] = np.max(_separation(az, el, apparent[1].radians, apparent[0].radians))
    assert 2.0 < seen['light_time'] < 4.0
    assert 0.2 < seen['diurnal_aberration'] < 0.3
    assert 15.0 < seen['annual_aberration'] < 20.7
    moved = EarthOrientation(orientation.dut1, orientation.xp + 0.02 * ARCSEC, orientation.yp,
                             0.0, 0.0, '')
    az, el, _ = satellite_place(GPS, time, SITE, VACUUM, moved)
    assert np.max(_separation(az, el, apparent[1].radians, apparent[0].radians)) > 0.015


def test_light_time_is_that_of_the_distance(one_pass):
    """Ignoring it equals looking later by distance / c, but for the Earth's turn in that time."""
    az, el, distance = satellite_place(GPS, one_pass, SITE, VACUUM)
    az_0, el_0, _ = satellite_place(GPS, one_pass, SITE, VACUUM,
                                    corrections=Corrections(light_time=False))
    early = satellite_place(GPS, one_pass, SITE, VACUUM,
                            corrections=Corrections(light_time=False),
                            time_bias=-distance / erfa.CMPS)
    # seconds since 1970 have steps of 2.4e-7 s, in which it goes 1 mm
    assert np.max(_separation(az, el, *early[:2])) < 2e-5
    lag = _separation(az, el, az_0, el_0)
    speed = 3.9e3 / erfa.CMPS / ARCSEC
    assert np.all((0.5 * speed < lag) & (lag < 1.05 * speed))


def test_diurnal_aberration_points_east(one_pass):
    az, el, _ = satellite_place(GPS, one_pass, SITE, VACUUM)
    az_0, el_0, _ = satellite_place(GPS, one_pass, SITE, VACUUM,
                                    corrections=Corrections(diurnal_aberration=False))
    shift = (_vector(az, el) - _vector(az_0, el_0)) / ARCSEC
    east = np.array([1.0, 0.0, 0.0])
    direction = _vector(az_0, el_0)
    radius = np.hypot(*erfa.gd2gc(1, SITE.longitude, SITE.latitude, SITE.height)[:2])
    size = TURN_RATE * radius / erfa.CMPS / ARCSEC
    expected = size * (east - (direction @ east)[:, None] * direction)
    assert np.max(np.abs(shift - expected)) < 1e-5


def test_shapes_follow_the_time():
    az, el, distance = satellite_place(GPS, START)
    assert np.shape(az) == np.shape(el) == np.shape(distance) == ()
    many = satellite_place(GPS, np.array([START, START + 100.0]))
    assert many[0].shape == (2,) and many[0][0] == pytest.approx(float(az), abs=1e-12)


# refraction


def test_parallactic_refraction_of_a_pass(one_pass):
    _, el, _ = satellite_place(GPS, one_pass)
    _, star, _ = satellite_place(GPS, one_pass,
                                 corrections=Corrections(parallactic_refraction=False))
    lower = (star - el) / ARCSEC
    assert np.all(lower > 0.0) and lower.argmax() in (0, len(lower) - 1)
    assert 0.1 < lower.max() < 0.25


# light


def test_shadow_and_sun():
    # the equinox of 2013-09-22 20:44 UTC: over the equator, where it is noon
    noon = -(20.733 + 0.122 - 12.0) * 15.0 + 360.0  # with the equation of time, in degrees east
    assert sun_place(1379882640.0, Site(0.0, (noon - 360.0) * DEG))[1] > 89.9 * DEG
    # a low orbit is in shadow for more than a third of its turn and never for more than half
    iss = parse_elements([_with_checksum(line) for line in ISS])
    dark = ~in_sunlight(iss, START + np.linspace(0.0, 86400.0 / 15.5, 1000))
    assert 0.2 < dark.mean() < 0.5


def test_sun_shines_on_the_day_side():
    iss = parse_elements([_with_checksum(line) for line in ISS])
    time = START + np.arange(0.0, 86400.0, 240.0)
    lit = in_sunlight(iss, time)
    day, night = np.zeros((2, len(time)), bool)
    for latitude, longitude in itertools.product((-45.0, 0.0, 45.0), np.arange(0.0, 360.0, 40.0)):
        site = Site(latitude * DEG, longitude * DEG)
        overhead = satellite_place(iss, time, site)[1] > 20.0 * DEG
        sun = sun_place(time, site)[1] / DEG
        day |= overhead & (sun > 0.0)
        night |= overhead & (sun < -40.0)
    assert day.sum() > 3 and lit[day].all()
    assert night.sum() > 3 and not lit[night].any()


def test_sun_elevation_of_a_known_direction():
    """Against the Sun's place of the Astronomical Almanac's formula, good to 0.01 degrees."""
    for time in START + 86400.0 * np.arange(0.0, 365.0, 30.3):
        days = (time - 946728000.0) / 86400.0
        anomaly = (357.528 + 0.9856003 * days) * DEG
        longitude = (280.460 + 0.9856474 * days + 1.915 * np.sin(anomaly)
                     + 0.020 * np.sin(2 * anomaly) - 0.0139695 * days / 365.25) * DEG  # to J2000
        obliquity = 23.439 * DEG
        ra = np.arctan2(np.cos(obliquity) * np.sin(longitude), np.cos(longitude))
        dec = np.arcsin(np.sin(obliquity) * np.sin(longitude))
        _, el = icrs_to_observed(ra, dec, float(time), SITE, VACUUM)
        assert abs(sun_place(float(time))[1] - el) < 0.03 * DEG
