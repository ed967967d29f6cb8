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

"""Observed azimuth and elevation of stars by ERFA, and their rates.

IAU 2006/2000A precession-nutation, light deflection by the Sun, annual and diurnal aberration,
parallax, Earth rotation with UT1-UTC and polar motion, refraction. All that depends only on time
is cached for two hours (`frame`); each star then costs less than a microsecond (``atciq``,
``atioq``). The celestial pole offsets, below 0.001", are neglected.
"""

from typing import NamedTuple

import erfa
import numpy as np

from msg_tools.units import wrap

from .earth import terrestrial
from .frame import frame
from .refraction import DEFAULT_WEATHER, Weather, with_refraction
from .site import DEFAULT_SITE

#: rotation rate of the Earth relative to the stars, rad/s
SIDEREAL = 2.0 * np.pi / 86164.0905
#: largest relative difference of measured rates from those of stars that noise explains: satellites
#: at rest over the ground or 20 000 km high differ by all of the rate, an axis that slips by 10" by
#: 0.6
_UNLIKE = 0.8


def observed_place(stars, time, site=DEFAULT_SITE, weather=DEFAULT_WEATHER):
    """Observed place of catalogue stars.

    Parameters
    ----------
    stars : Stars
        n of them.
    time : float or ndarray
        UTC, seconds since 1970-01-01: one time, one for each star, or many for a single star.
    site : Site
    weather : Weather
        ``pressure_hpa=0`` for the direction without refraction.

    Returns
    -------
    az, el : ndarray, shape (n,)
        Radians; azimuth from north through east, in [0, 2 pi). ERFA's refraction is valid above
        some 5 degrees and meaningless below the horizon.

    Raises
    ------
    ValueError
        A time is outside 1900-2100, or the number of times does not match.
    """
    astrom = _frame(time, site, len(stars))
    return _directions(erfa.ufunc.atciq(*stars.at_j2000, astrom), astrom, weather)[:2]


def icrs_to_observed(ra, dec, time, site=DEFAULT_SITE, weather=DEFAULT_WEATHER):
    """Observed place of ICRS directions at infinity, without proper motion.

    Parameters
    ----------
    ra, dec : float or ndarray
        ICRS, radians.
    time, site, weather
        See `observed_place`; `ra`, `dec` and `time` broadcast.

    Returns
    -------
    az, el : float or ndarray
        Radians.
    """
    return observed_directions(ra, dec, time, site, weather)[:2]


class Observed(NamedTuple):
    """An observed direction, refracted, in both pairs of axes of an ideal mount; radians.

    Attributes
    ----------
    az, el : float or ndarray
        Azimuth from north through east, in [0, 2 pi), and elevation.
    ha, dec : float or ndarray
        The same direction relative to the pole at the site's latitude: hour angle, west
        positive, in (-pi, pi], and declination.
    """

    az: np.ndarray
    el: np.ndarray
    ha: np.ndarray
    dec: np.ndarray


def observed_directions(ra, dec, time, site=DEFAULT_SITE, weather=DEFAULT_WEATHER):
    """Observed directions of ICRS places at infinity, for mounts with any axes.

    Parameters
    ----------
    ra, dec : float or ndarray
        ICRS, radians.
    time, site, weather
        See `observed_place`; `ra`, `dec` and `time` broadcast.

    Returns
    -------
    Observed
    """
    ra, dec = np.broadcast_arrays(np.asarray(ra, float), np.asarray(dec, float))
    astrom = _frame(time, site, None if ra.ndim == 0 else ra.size)
    return _directions(erfa.ufunc.atciq(ra, dec, 0.0, 0.0, 0.0, 0.0, astrom), astrom, weather)


def observed_to_icrs(az, el, time, site=DEFAULT_SITE, weather=DEFAULT_WEATHER):
    """ICRS direction that is observed at a place: the inverse of `icrs_to_observed`.

    Parameters
    ----------
    az, el : float or ndarray
        Observed azimuth and elevation, radians.
    time, site, weather
        See `observed_place`; `az`, `el` and `time` broadcast.

    Returns
    -------
    ra, dec : float or ndarray
        ICRS, radians, of an object at infinity; accurate to 0.003" above 15 degrees (ERFA's
        inverse refraction).
    """
    az, el = np.broadcast_arrays(np.asarray(az, float), np.asarray(el, float))
    astrom = with_refraction(_frame(time, site, None if az.ndim == 0 else az.size), weather)
    cirs = erfa.ufunc.atoiq(b'A', az, np.pi / 2.0 - el, astrom)
    return erfa.ufunc.aticq(*cirs, astrom)


def sun_place(time, site=DEFAULT_SITE):
    """Azimuth and elevation of the Sun's centre, without refraction.

    Parameters
    ----------
    time : float or ndarray, shape (n,)
        UTC, seconds since 1970-01-01.
    site : Site

    Returns
    -------
    az, el : float or ndarray, shape (n,)
        rad. Accurate to 30": the Earth's position is ERFA's, the parallax is neglected.
    """
    ra, dec = erfa.c2s(-erfa.ufunc.epv00(*terrestrial(time))[0]['p'])
    return icrs_to_observed(ra, dec, time, site, Weather(pressure_hpa=0.0))


def sidereal_time(time, site=DEFAULT_SITE):
    """Local apparent sidereal time, radians in [0, 2 pi).

    Parameters
    ----------
    time : ndarray, shape (n,)
        UTC, seconds since 1970-01-01.
    site : Site
    """
    time = np.asarray(time, float)
    origins = erfa.ufunc.eo06a(*terrestrial(time))
    return np.mod(_frame(time, site, None)['eral'] - origins, 2.0 * np.pi)


def moment_of(lst, near, site=DEFAULT_SITE):
    """UTC closest to a given time at which a sidereal clock shows `lst`.

    Parameters
    ----------
    lst : ndarray, shape (n,)
        Local apparent sidereal time, radians.
    near : ndarray, shape (n,), or float
        UTC, seconds since 1970-01-01.
    site : Site

    Returns
    -------
    ndarray, shape (n,)
        UTC, seconds since 1970-01-01.
    """
    time = np.broadcast_to(np.asarray(near, float), np.shape(lst)).copy()
    for _ in range(3):  # each leaves the change of the equation of the equinoxes
        time += wrap(lst - sidereal_time(time, site)) / SIDEREAL
    return time


def _frame(time, site, count):
    """ERFA's astrom for each time, without refraction."""
    time = np.asarray(time, float)
    if time.ndim > 1 or (time.ndim == 1 and count not in (None, 1) and time.size != count):
        raise ValueError(f'{time.size} times for {count} stars: give one time, or one for each')
    return frame(time, site)


def _directions(cirs, astrom, weather):
    az, zenith_distance, ha, dec, _ = erfa.ufunc.atioq(*cirs, with_refraction(astrom, weather))
    return Observed(az, np.pi / 2.0 - zenith_distance, ha, dec)


def star_rates(directions, tangents, latitude):
    """Rates of stars on the sky, due to rotation about the pole: -(pole x direction).

    Parameters
    ----------
    directions : ndarray, shape (3, n)
        East, north, up.
    tangents : sequence of ndarray, shape (3, n)
        Unit vectors of increasing axis angles.
    latitude : float
        rad.

    Returns
    -------
    ndarray, shape (2, n)
        rad/s; the first axis is multiplied by the cosine of the second.
    """
    pole = np.array([[0.0], [np.cos(latitude)], [np.sin(latitude)]])
    moves = -SIDEREAL * np.cross(pole, directions, axis=0)
    return np.array([np.sum(moves * along, axis=0) for along in tangents])


def are_star_rates(x, y, star_x, star_y):
    """Whether measured rates are those of stars, within the noise of readings.

    Their difference is then not a rate that drives an error: an axis with stick-slip has its error
    in both reading and rate.

    Parameters
    ----------
    x, y, star_x, star_y : ndarray, shape (n,)
        rad/s on the sky: measured rates, and rates of the stars.

    Returns
    -------
    bool
    """
    off, fast = np.hypot(x - star_x, y - star_y), np.hypot(star_x, star_y)
    known = np.isfinite(off)
    return bool(known.any() and np.median(off[known]) < _UNLIKE * np.median(fast[known]))
