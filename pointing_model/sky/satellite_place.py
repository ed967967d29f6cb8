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

"""Observed place of a satellite: from its orbit to azimuth and elevation.

Steps, with their basis:

* An orbit (elements, or a precise one: `orbits`) gives positions in ITRF.
* Light time is solved in the geocentric inertial frame: the satellite at t - tau, the observer
  at t, the Earth rotated in between. An observer at rest in that frame would see exactly this
  direction. The observer on the ground moves with the Earth's rotation, which adds the diurnal
  aberration (0.26" at latitude 34). There is no annual aberration: seen from the solar system's
  barycentre the satellite shares the Earth's 30 km/s and is displaced by 20.5" during the light
  time; aberration displaces it back by as much (planetary aberration: Urban & Seidelmann,
  Explanatory Supplement, 3rd ed., ch. 7; the tests do it that way, with Skyfield, and agree to
  0.001"). A star keeps its aberration.
* Refraction and parallactic refraction: `refraction.refracted_elevation`.

These steps are accurate to 0.001"; the accuracy of the orbit is its `sigma`.
"""

from dataclasses import dataclass

import erfa
import numpy as np

from .earth import DAY, EARTH_RADIUS, TURN_RATE, earth_orientation, split_utc, terrestrial
from .elements import turned
from .refraction import DEFAULT_WEATHER, refracted_elevation
from .site import DEFAULT_SITE


@dataclass(frozen=True)
class Corrections:
    """Corrections on the way from the orbit to the observed place.

    Attributes
    ----------
    light_time, diurnal_aberration, refraction, parallactic_refraction : bool
        On by default; off to see the effect of omitting one.
    annual_aberration : bool
        Off by default, since it is wrong for a satellite of the Earth.
    """

    light_time: bool = True
    diurnal_aberration: bool = True
    annual_aberration: bool = False
    refraction: bool = True
    parallactic_refraction: bool = True


def satellite_place(satellite, time, site=DEFAULT_SITE, weather=DEFAULT_WEATHER,
                    orientation=None, corrections=None, time_bias=0.0, rest=0.0):
    """Observed place of a satellite.

    Parameters
    ----------
    satellite : elements.Satellite, or orbits.ephemeris.Orbit
    time : float or ndarray
        UTC, seconds since 1970-01-01.
    site : Site
    weather : Weather
        ``pressure_hpa=0`` for the direction without refraction.
    orientation : EarthOrientation, optional
        With the shape of `time`, for elements; taken from the IERS tables by default.
    corrections : Corrections, optional
    time_bias : float
        Seconds by which the satellite is ahead of its orbit.
    rest : float or ndarray
        Seconds to add to `time`, separate to keep all digits.

    Returns
    -------
    az, el : float or ndarray
        Radians; azimuth from north through east, in [0, 2 pi).
    distance : float or ndarray
        Metres, at the time when the light was emitted.

    Raises
    ------
    ValueError
        A time is outside 1900-2100, or not covered by the orbit.
    """
    corrections = corrections or Corrections()
    time = np.asarray(time, float)
    given = {} if orientation is None else {'orientation': orientation}
    ground = erfa.gd2gc(1, site.longitude, site.latitude, site.height)  # WGS84

    def seen_from_here(late):
        """Position `late` seconds ago, in the present axes of the Earth."""
        place = satellite.itrf(time, rest + time_bias - late, **given)
        return turned(place, TURN_RATE * (late - time_bias)) - ground

    path = seen_from_here(0.0)
    if corrections.light_time:
        delay = _length(path) / erfa.CMPS
        first, path = path, seen_from_here(delay)
        # the remaining error of the delay, a microsecond, is a few millimetres
        late = (_length(path) / erfa.CMPS - delay) / delay
        path = path + late[..., None] * (path - first)
    distance = _length(path)
    seen = path / distance[..., None]
    velocity = np.zeros_like(seen)
    if corrections.diurnal_aberration:
        velocity[..., 0] -= TURN_RATE * ground[1]
        velocity[..., 1] += TURN_RATE * ground[0]
    if corrections.annual_aberration:
        velocity += _sun_and_motion(time)[1]
    az, el = _horizontal(seen + velocity / erfa.CMPS, site)
    if corrections.refraction:
        far = np.inf if not corrections.parallactic_refraction else distance
        el = refracted_elevation(el, weather, far, float(_length(ground)))
    return np.mod(az, 2.0 * np.pi), el, distance


def in_sunlight(satellite, time):
    """Whether the satellite is in sunlight.

    Parameters
    ----------
    satellite : elements.Satellite, or orbits.ephemeris.Orbit
    time : float or ndarray
        UTC, seconds since 1970-01-01.

    Returns
    -------
    bool or ndarray of bool
        False in a cylindrical shadow with the Earth's equatorial radius: for a GPS satellite the
        true shadow lasts a few minutes more or less.
    """
    time = np.asarray(time, float)
    sun = _sun_and_motion(time)[0]
    place = satellite.itrf(time)
    along = np.sum(place * sun, axis=-1)
    across = _length(place - along[..., None] * sun)
    return (along > 0.0) | (across > EARTH_RADIUS)


def _length(vector):
    return np.sqrt(np.sum(vector * vector, axis=-1))


def _horizontal(direction, site):
    """Azimuth and elevation of a direction in ITRF."""
    east, north, up = np.moveaxis(direction @ horizon_axes(site).T, -1, 0)
    return np.arctan2(east, north), np.arctan2(up, np.hypot(east, north))


def horizon_axes(site):
    """East, north and up in ITRF, as rows, shape (3, 3)."""
    sin_lon, cos_lon = np.sin(site.longitude), np.cos(site.longitude)
    sin_lat, cos_lat = np.sin(site.latitude), np.cos(site.latitude)
    return np.array([[-sin_lon, cos_lon, 0.0],
                     [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
                     [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat]])


def _sun_and_motion(time):
    """Direction to the Sun, and the Earth's velocity (m/s), in the Earth's axes of date.

    This uses the CIO (ERA), while the satellite's axes use the equinox of 1982's GMST: after the
    rotation both are the Earth's axes.
    """
    utc = split_utc(time)
    tt = terrestrial(time)
    ut1 = erfa.ufunc.utcut1(*utc, earth_orientation(time).dut1)[:2]
    heliocentric, barycentric, _ = erfa.ufunc.epv00(*tt)
    # precession and nutation once an hour; they change by 0.01" in this time
    hours, which = np.unique(np.floor(24.0 * (tt[0] - erfa.DJM0 + tt[1])), return_inverse=True)
    matrix = erfa.ufunc.c2i00b(erfa.DJM0, (hours + 0.5) / 24.0)[which.reshape(time.shape)]
    turn = erfa.ufunc.era00(*ut1)
    sun, motion = (turned(np.einsum('...ij,...j->...i', matrix, vector), turn)
                   for vector in (-heliocentric['p'], barycentric['v']))
    return sun / _length(sun)[..., None], motion * (erfa.DAU / DAY)
