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

"""Two-line elements of a satellite: read, check, propagate by SGP4, rotate with the Earth.

Elements of a GPS satellite are wrong by 0.2 to 1 km at their epoch, those of a low satellite by a
kilometre or two, growing daily, worst along the orbit (T. S. Kelso, AAS 07-127).
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import erfa
import numpy as np

from .earth import DAY, MJD_1970, earth_orientation, split_utc, terrestrial
from .orbits.time_scales import leap_seconds

#: error of a coordinate from two-line elements, m: lower limit of the revolutions per day, error at
#: the epoch of the elements, and growth per day
ERRORS = ((11.25, 700.0, 1000.0), (-np.inf, 400.0, 100.0))

#: Elements of the satellite that paper 000 tracked (NORAD 26690, USA 156), 2013 day 264.
GPS_26690 = (
    '1 26690U 01004A   13264.32975019 -.00000016  00000-0  00000+0 0  9784',
    '2 26690  53.1031 214.8630 0147879 241.2580   4.0622  2.00567355 92659',
)

#: types of elements that SGP4 accepts: unspecified, SGP, SGP4, SDP4 (4 would be SGP4-XP)
TYPES = '0', '1', '2', '3'
_FIELDS_1 = (('year', 19, 20), ('day', 21, 32), ('drift of the mean motion', 34, 43))
_FIELDS_2 = (('inclination', 9, 16), ('node', 18, 25), ('eccentricity', 27, 33),
             ('perigee', 35, 42), ('mean anomaly', 44, 51), ('mean motion', 53, 63))
_SGP4_ERRORS = {
    1: 'the orbit is no ellipse any more', 2: 'its mean motion is negative',
    3: 'the perturbed orbit is no ellipse any more', 4: 'its semilatus rectum is negative',
    6: 'it has decayed',
}


@dataclass(frozen=True)
class Satellite:
    """An orbit given by two-line elements.

    Attributes
    ----------
    line1, line2 : str
        The elements, checked by `parse_elements`.
    """

    line1: str
    line2: str

    @cached_property
    def record(self):
        """The propagator, an `sgp4.api.Satrec`."""
        from sgp4.api import Satrec
        return Satrec.twoline2rv(self.line1, self.line2)

    #: whether its sigma is that of a precise orbit; otherwise it is typical of elements
    precise = False
    #: time range of the orbit: UTC seconds since 1970-01-01
    begin, end = -np.inf, np.inf

    @property
    def name(self):
        """Catalogue number, for people."""
        return str(self.number)

    @property
    def number(self):
        """Catalogue number."""
        return self.record.satnum

    @property
    def epoch(self):
        """Epoch of the elements: UTC, seconds since 1970-01-01."""
        record = self.record
        return (record.jdsatepoch - erfa.DJM0 - MJD_1970 + record.jdsatepochF) * DAY

    def state(self, time):
        """Position and velocity in TEME.

        Parameters
        ----------
        time : float or ndarray
            UTC, seconds since 1970-01-01.

        Returns
        -------
        position, velocity : ndarray, shape (..., 3)
            Metres and m/s.

        Raises
        ------
        ValueError
            The time is too far from the epoch for SGP4.
        """
        time = np.asarray(time, float)
        elapsed = (time - self.epoch + leap_seconds(time) - leap_seconds(self.epoch)) / DAY
        start = np.full(elapsed.size, self.record.jdsatepoch)
        error, position, velocity = self.record.sgp4_array(
            start, self.record.jdsatepochF + elapsed.ravel())
        if np.any(error):
            code = int(error[error != 0][0])
            raise ValueError(
                f'satellite {self.number}: {_SGP4_ERRORS.get(code, f"SGP4 error {code}")}, '
                f'{np.max(np.abs(elapsed)):.0f} days from the epoch of its elements; '
                'give elements nearer to the time')
        shape = (*time.shape, 3)
        return 1e3 * position.reshape(shape), 1e3 * velocity.reshape(shape)

    def itrf(self, time, rest=0.0, orientation=None):
        """Positions in ITRF.

        The z axis of TEME is the pole of date; GMST (IAU 1982, of UT1) rotates it to the Earth,
        then polar motion (Vallado et al., AIAA 2006-6753, appendix C).

        Parameters
        ----------
        time : float or ndarray
            UTC, seconds since 1970-01-01.
        rest : float or ndarray
            Seconds to add to `time`.
        orientation : EarthOrientation, optional
            Taken from the IERS tables by default.

        Returns
        -------
        ndarray, shape (..., 3)
            m.

        Raises
        ------
        ValueError
            The time is too far from the epoch for SGP4.
        """
        time = np.asarray(time, float) + rest
        orientation = orientation or earth_orientation(time)
        turn = erfa.ufunc.gmst82(*erfa.ufunc.utcut1(*split_utc(time), orientation.dut1)[:2])
        pole = erfa.ufunc.pom00(orientation.xp, orientation.yp,
                                erfa.ufunc.sp00(*terrestrial(time)))
        return np.einsum('...ij,...j->...i', pole, turned(self.state(time)[0], turn))

    def sigma(self, time, rest=0.0):
        """Expected error of a coordinate at a time, shape (...), m; largest along the orbit."""
        turns = self.record.no_kozai * 1440.0 / (2.0 * np.pi)
        first, growth = next(one[1:] for one in ERRORS if turns > one[0])
        return first + growth * np.abs(np.asarray(time, float) + rest - self.epoch) / DAY


def turned(vectors, angle):
    """Components, shape (..., 3), in axes rotated by `angle` about z."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([cos * x + sin * y, cos * y - sin * x, z + 0.0 * angle], axis=-1)


def parse_sets(lines):
    """All sets of two-line elements, checked.

    Parameters
    ----------
    lines : sequence of str
        Names and empty lines around a pair are skipped.

    Returns
    -------
    list of Satellite

    Raises
    ------
    ValueError
        See `parse_elements`.
    """
    lines = [line.rstrip() for line in lines]
    starts = [i for i, line in enumerate(lines) if line.startswith('1 ')]
    if not starts:
        raise ValueError('no two-line elements: a line that begins with "1 " is missing')
    found = []
    for i in starts:
        if i + 1 == len(lines) or not lines[i + 1].startswith('2 '):
            raise ValueError(f'two-line elements: line {i + 2} should begin with "2 "')
        found.append(_pair(lines[i], lines[i + 1], i + 1))
    return found


def parse_elements(lines):
    """Two-line elements of one satellite, checked.

    Parameters
    ----------
    lines : sequence of str
        Names and empty lines around the pair are skipped.

    Returns
    -------
    Satellite

    Raises
    ------
    ValueError
        A line is too short, its checksum is wrong, the lines do not belong together, a number
        is invalid, or there are several pairs.
    """
    found = parse_sets(lines)
    if len(found) > 1:
        known = ', '.join(str(s.number) for s in found[:5])
        raise ValueError(f'{len(found)} sets of elements, but one is needed: keep one of '
                         f'{known}')
    return found[0]


def load_elements(path):
    """Read a file of two-line elements.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Satellite

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        See `parse_elements`; the message has the file's name.
    """
    text = Path(path).read_text(encoding='ascii', errors='replace')
    try:
        return parse_elements(text.splitlines())
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None


def _pair(line1, line2, row):
    from sgp4.io import compute_checksum
    for line, at in ((line1, row), (line2, row + 1)):
        if len(line) != 69:
            raise ValueError(f'two-line elements: line {at} has {len(line)} characters, not 69')
        if not line[68].isdigit() or compute_checksum(line) != int(line[68]):
            raise ValueError(f'two-line elements: line {at} has checksum {line[68]}, it should '
                             f'be {compute_checksum(line)}; copy it again')
    if line1[2:7] != line2[2:7]:
        raise ValueError(f'two-line elements: line {row} is of satellite {line1[2:7].strip()}, '
                         f'line {row + 1} of {line2[2:7].strip()}')
    for line, at, fields in ((line1, row, _FIELDS_1), (line2, row + 1, _FIELDS_2)):
        for what, first, last in fields:
            try:
                float(line[first - 1 : last])  # the propagator accepts anything
            except ValueError:
                raise ValueError(f'two-line elements: line {at}, columns {first} to {last} '
                                 f'({what}): {line[first - 1 : last]!r} is no number') from None
    if line1[62] not in (' ', *TYPES):
        raise ValueError(f'two-line elements: line {row}, column 63: elements of type {line1[62]}, '
                         'not SGP4 (type 0); give SGP4 elements, or a precise orbit')
    satellite = Satellite(line1, line2)
    error = satellite.record.error
    if error or not satellite.record.no_kozai > 0.0:
        raise ValueError(f'two-line elements: lines {row} and {row + 1} describe no orbit')
    return satellite
