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

"""OEM: orbit ephemeris messages of the CCSDS, as keywords and values (CCSDS 502.0-B-3, 2023).

Blocks of metadata, rows of date, position (km) and velocity (km/s), and covariances. Frames ITRF,
EME2000 and TEME; the latter two are transformed to ITRF at each epoch.
"""

import re

import erfa
import numpy as np

from msg_tools.iso_time import read_iso

from ..earth import TURN_RATE, earth_orientation, split_utc, terrestrial
from .orbit_table import ObjectRows, OrbitFormat, number
from .time_scales import SCALES, tai_of, utc_of

_ITRF = re.compile(r'ITRF([-_]?(19|20)?\d\d)?$')
FRAMES = ('ITRF', 'EME2000', 'TEME')
_DAY_OF_YEAR = re.compile(r'(\d{4})-(\d{3})(?=T)')
_KEY = re.compile(r'\s*([A-Z_0-9]+)\s*=\s*(.*?)\s*$')


def looks_like(lines):
    """Whether this is an OEM with keywords."""
    return any(line.strip().startswith('CCSDS_OEM_VERS') for line in lines[:5])


def read(path, lines):
    """Positions of all blocks of a file.

    Parameters
    ----------
    path : str or Path
        For messages.
    lines : list of str

    Returns
    -------
    list of ObjectRows

    Raises
    ------
    ValueError
        One line: an unknown frame, centre or time scale, or an invalid date or
        number.
    """
    head, block, where, out = {}, None, '', []
    for at, line in enumerate(lines, 1):
        text = line.strip()
        if not text or text.startswith('COMMENT'):
            continue
        if text in ('META_START', 'META_STOP', 'COVARIANCE_START', 'COVARIANCE_STOP'):
            where = text
            if text == 'META_START':
                block = _Block(path, head.get('ORIGINATOR', ''))
                out.append(block)
            continue
        found = _KEY.match(line)
        if where == 'META_START' and found:
            block.meta[found[1]] = (at, found[2])
        elif where == 'COVARIANCE_START':
            block.covariance.append((at, text))
        elif found:
            head[found[1]] = found[2]
        elif block is None:
            raise ValueError(f'{path}, line {at}: a row before META_START')
        else:
            block.take(at, text)
    if not out:
        raise ValueError(f'{path} has no block META_START ... META_STOP')
    return [block.rows() for block in out]


class _Block:
    """Metadata and the rows that follow."""

    def __init__(self, path, originator):
        self._path, self._originator = path, originator
        self.meta, self.covariance = {}, []
        self._lines, self._dates, self._numbers = [], [], []

    def take(self, at, text):
        """Read a row with date, position and velocity."""
        date, *words = text.split()
        if len(words) < 3:
            raise ValueError(f'{self._path}, line {at}: {len(words)} numbers after the date; three '
                             'of a position are needed, and three of a velocity')
        self._lines.append(at)
        self._dates.append(date)
        self._numbers.append([number(word, self._path, at, 'number') for word in words[:6]])

    def _known(self, key, default):
        return self.meta.get(key, (0, default))

    def rows(self):
        """The block as `ObjectRows`."""
        (_, name), (_, identity) = self._known('OBJECT_NAME', '?'), self._known('OBJECT_ID', '')
        at, frame = self._known('REF_FRAME', '')
        frame = frame.upper()
        if not (_ITRF.match(frame) or frame in FRAMES):
            raise ValueError(f'{self._path}, line {at}: frame {frame or "(none)"} is not read; '
                             f'known are {", ".join(FRAMES)}')
        at, centre = self._known('CENTER_NAME', 'EARTH')
        if centre.upper() != 'EARTH':
            raise ValueError(f'{self._path}, line {at}: positions relative to {centre}; give '
                             'geocentric ones')
        at, scale = self._known('TIME_SYSTEM', '')
        if scale not in SCALES:
            raise ValueError(f'{self._path}, line {at}: time scale {scale or "(none)"} is not '
                             f'known; known are {", ".join(SCALES)}')
        if not self._dates:
            raise ValueError(f'{self._path}: {name} has no row of positions')
        whole, rest = self._seconds(scale)
        moving = all(len(row) == 6 for row in self._numbers)
        table = 1e3 * np.array([row[:6 if moving else 3] for row in self._numbers])
        places, rates = table[:, :3], table[:, 3:] if moving else None
        if frame in ('EME2000', 'TEME'):
            places, rates = _terrestrial(frame, whole, rest, places, rates)
        return ObjectRows(name, np.array(self._lines), whole, rest, places, rates,
                          self._sigmas(len(whole), whole + rest, scale), self._originator,
                          other_names=(identity,) if identity else ())

    def _seconds(self, scale):
        whole, rest = read_iso([_calendar(date) for date in self._dates])
        if np.isnan(rest).any():
            row = int(np.flatnonzero(np.isnan(rest))[0])
            raise ValueError(f'{self._path}, line {self._lines[row]}: no date: {self._dates[row]}')
        tai = tai_of(whole.astype(float), scale)
        return np.floor(tai), rest + np.round(tai - np.floor(tai), 6)

    def _sigmas(self, count, tai, scale):
        """1-sigma of a coordinate, from the covariances if there are any."""
        moments, sigmas, rows = [], [], []
        for at, text in [*self.covariance, (0, 'EPOCH =')]:
            found = _KEY.match(text)
            if found is None:
                rows.append([number(word, self._path, at, 'number') for word in text.split()])
            elif found[1] == 'EPOCH':
                if len(rows) >= 3 and len(moments) > len(sigmas):
                    trace = sum(rows[i][i] for i in range(3))
                    sigmas.append(1e3 * np.sqrt(max(trace, 0.0) / 3.0))
                rows = []
                if found[2]:
                    whole, rest = read_iso([_calendar(found[2])])
                    moments.append(float(tai_of(whole.astype(float), scale)[0] + rest[0]))
        if not sigmas or len(sigmas) != len(moments):
            return np.full(count, np.nan)
        return np.interp(tai, moments, sigmas)


def _calendar(date):
    """Convert a date with day of year to a calendar date."""
    found = _DAY_OF_YEAR.match(date)
    if not found:
        return date
    day = np.datetime64(f'{found[1]}-01-01') + np.timedelta64(int(found[2]) - 1, 'D')
    return f'{day}{date[found.end():]}'


def _terrestrial(frame, whole, rest, places, rates):
    """Positions and velocities in ITRF."""
    utc = utc_of(whole)
    time = utc + rest
    orientation = earth_orientation(time)
    tt = terrestrial(utc)
    tt = tt[0], tt[1] + rest / 86400.0
    ut1 = erfa.ufunc.utcut1(*split_utc(time), orientation.dut1)[:2]
    pole = erfa.ufunc.pom00(orientation.xp, orientation.yp, erfa.ufunc.sp00(*tt))
    if frame == 'TEME':
        # the pole of date, and the equinox of GMST 1982 (Vallado et al., AIAA 2006-6753)
        turn = erfa.ufunc.rz(erfa.ufunc.gmst82(*ut1), np.eye(3))
        matrix = erfa.ufunc.rxr(pole, turn)
    else:
        # EME2000 is the mean equator and equinox of J2000, offset from GCRS by the frame bias
        to_mean = erfa.bp00(erfa.DJ00, 0.0)[0]
        celestial = erfa.ufunc.c2t06a(*tt, *ut1, orientation.xp, orientation.yp)
        matrix = np.einsum('nij,kj->nik', celestial, to_mean)
    places = np.einsum('nij,nj->ni', matrix, places)
    if rates is not None:
        rates = np.einsum('nij,nj->ni', matrix, rates) - TURN_RATE * np.stack(
            (-places[:, 1], places[:, 0], 0.0 * time), axis=1)
    return places, rates


ORBIT_FORMATS = (OrbitFormat('OEM', looks_like, read),)
