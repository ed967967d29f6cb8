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

"""Frames of right ascension and declination, and conversion to the ICRS and to date."""

import re
from dataclasses import dataclass

import erfa
import numpy as np

from pointing_model.sky.earth import terrestrial
from pointing_model.sky.places import icrs_to_observed
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site

#: names of frames, for messages
KNOWN = 'ICRS, J2000, J<year> (mean of that equinox), mean of date, of date (apparent), B1950'
_NAMES = {
    'icrs': ('icrs', None), 'j2000': ('icrs', None), 'fk5': ('icrs', None),
    'fk5 j2000': ('icrs', None), 'of date': ('apparent', None), 'apparent': ('apparent', None),
    'apparent of date': ('apparent', None), 'jnow': ('apparent', None),
    'mean of date': ('mean', None), 'fk4': ('fk4', None), 'b1950': ('fk4', None),
    'fk4 b1950': ('fk4', None)}
_EQUINOX = re.compile(r'(?:fk[45] +)?([jb]?)(\d{3,5}(?:\.\d*)?)')
_YEARS = (1900.0, 2100.0)


@dataclass(frozen=True)
class Frame:
    """A frame of right ascension and declination.

    Parameters
    ----------
    kind : {'icrs', 'mean', 'apparent', 'fk4'}
        'icrs': ICRS and J2000 (they differ by 0.02", and what solvers call J2000 is the ICRS of
        their catalogue). 'mean': mean equator and equinox. 'apparent': true equator and equinox of
        date with annual aberration (geocentric apparent place). 'fk4': FK4, equinox B1950.
    equinox : float, optional
        Julian year for 'mean'; None: of date.
    """

    kind: str
    equinox: float | None = None

    @property
    def text(self):
        """Name of the frame for people and for headers of files."""
        if self.kind == 'mean':
            return 'mean of date' if self.equinox is None else f'J{self.equinox:g}'
        return {'icrs': 'ICRS', 'apparent': 'of date', 'fk4': 'B1950'}[self.kind]


ICRS = Frame('icrs')
MEAN_OF_DATE, OF_DATE, B1950 = Frame('mean'), Frame('apparent'), Frame('fk4')


def parse_frame(text):
    """The frame with a name or equinox.

    Parameters
    ----------
    text : str or float
        One of `KNOWN`, upper or lower case. A bare year is a Julian equinox, 1950 the Besselian
        one.

    Returns
    -------
    Frame

    Raises
    ------
    ValueError
        The frame is unknown, or the equinox is outside 1900 to 2100.
    """
    name = ' '.join(str(text).split()).lower()
    if name in _NAMES:
        return Frame(*_NAMES[name])
    found = _EQUINOX.fullmatch(name)
    if not found:
        raise ValueError(f'frame {str(text)[:40]!r} is unknown; known are {KNOWN}')
    letter, year = found[1], float(found[2])
    if letter == 'b' or (not letter and year == 1950.0) or name.startswith('fk4'):
        if year != 1950.0:
            raise ValueError(f'equinox {str(text)[:40]!r}: of Besselian ones only B1950 is read')
        return B1950
    if not _YEARS[0] <= year <= _YEARS[1]:
        raise ValueError(f'equinox {str(text)[:40]!r} is outside 1900 to 2100')
    return ICRS if year == 2000.0 else Frame('mean', year)


def to_icrs(ra, dec, frame, time):
    """Convert directions from a frame to the ICRS.

    Parameters
    ----------
    ra, dec : ndarray, shape (n,)
        In the frame, radians.
    frame : Frame
    time : ndarray, shape (n,)
        UTC, seconds since 1970: date of frames of date, epoch of FK4 places.

    Returns
    -------
    ra, dec : ndarray, shape (n,)
        ICRS, radians; FK4 and mean places via FK5 (IAU 2006), accurate to about 0.02".

    Raises
    ------
    ValueError
        A time is outside 1900 to 2100.
    """
    ra, dec, time = (np.asarray(v, float) for v in (ra, dec, time))
    if frame.kind == 'icrs':
        return ra, dec
    moments = terrestrial(time)
    if frame.kind == 'apparent':
        # apparent right ascension counts from the equinox, CIRS' from the intermediate origin
        origins = erfa.ufunc.eo06a(*moments)
        ra, dec, _ = erfa.ufunc.atic13(ra + origins, dec, *moments)
        return np.mod(ra, 2.0 * np.pi), dec
    if frame.kind == 'fk4':
        ra, dec = erfa.ufunc.fk45z(ra, dec, erfa.ufunc.epb(*moments))
        return np.mod(ra, 2.0 * np.pi), dec
    if frame.equinox is not None:
        moments = erfa.ufunc.epj2jd(frame.equinox)
    to_mean = erfa.ufunc.pmat06(*moments)
    ra, dec = erfa.ufunc.c2s(erfa.ufunc.trxp(to_mean, erfa.ufunc.s2c(ra, dec)))
    return np.mod(ra, 2.0 * np.pi), dec


def to_date(ra, dec, frame, time):
    """Apparent places of date, consistent with apparent sidereal time.

    Parameters
    ----------
    ra, dec, frame, time
        See `to_icrs`.

    Returns
    -------
    ra, dec : ndarray, shape (n,)
        True equator and equinox of date with annual aberration, radians.

    Raises
    ------
    ValueError
        A time is outside 1900 to 2100.
    """
    if frame.kind == 'apparent':
        return np.asarray(ra, float), np.asarray(dec, float)
    ra, dec, origins = erfa.ufunc.atci13(*to_icrs(ra, dec, frame, time), 0.0, 0.0, 0.0, 0.0,
                                         *terrestrial(np.asarray(time, float)))
    return np.mod(ra - origins, 2.0 * np.pi), dec


@dataclass(frozen=True)
class Solved:
    """Right ascensions and declinations of a run, before conversion to observed places.

    Parameters
    ----------
    lines : ndarray of int, shape (n,)
        Lines of the file, see `PointingRun.lines`.
    ra, dec : ndarray, shape (n,)
        As given, radians.
    time : ndarray, shape (n,)
        UTC, seconds since 1970.
    frame : Frame
        Declared, or assumed if none was.
    declared : bool
        Whether the file or the caller names the frame.
    site : Site
    weather : Weather
        Of each row.
    from_images : bool
        Whether the rows are plate solutions (with a sigma or scale), not catalogue stars.
    """

    lines: np.ndarray
    ra: np.ndarray
    dec: np.ndarray
    time: np.ndarray
    frame: Frame
    declared: bool
    site: Site
    weather: Weather
    from_images: bool = False

    def observed(self, frame=None, ra=None):
        """Observed azimuth and elevation, radians, also with another frame.

        Parameters
        ----------
        frame : Frame, optional
            Replaces the frame of the places.
        ra : ndarray, shape (n,), optional
            Replaces their right ascensions.
        """
        ra, dec = to_icrs(self.ra if ra is None else ra, self.dec, frame or self.frame, self.time)
        return icrs_to_observed(ra, dec, self.time, self.site, self.weather)

    def at(self, lines):
        """The places of some lines, in the order of these.

        Parameters
        ----------
        lines : ndarray of int, shape (m,)
            A subset of `self.lines`.
        """
        order = np.argsort(self.lines, kind='stable')
        rows = order[np.searchsorted(self.lines[order], lines)]
        air = self.weather
        each = {name: np.broadcast_to(getattr(air, name), self.ra.shape)[rows]
                for name in ('pressure_hpa', 'temperature_c', 'humidity')}
        return Solved(self.lines[rows], self.ra[rows], self.dec[rows], self.time[rows], self.frame,
                      self.declared, self.site,
                      Weather(wavelength_um=air.wavelength_um, **each), self.from_images)
