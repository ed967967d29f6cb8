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

"""SP3: orbits of the IGS and the ILRS, versions a to d (S. Hilla, The Extended Standard Product 3
Orbit Format, 2016), including common deviations from the standard.

The end line may be missing, comments begin with ``/*`` or ``%/*``, a time scale of ``ccc`` is GPS
time, SP3-a has only GPS, with numbers as names. Clocks are not read; velocities are in dm/s; a
position of zeros means none.
"""

import re

import numpy as np

from .orbit_table import ObjectRows, OrbitFormat, number
from .time_scales import SCALES, calendar_seconds, tai_of

_HEAD = re.compile(r'#[a-d][PV ]')
#: coordinate systems that rotate with the Earth: realisations of ITRF, and names of providers
_TERRESTRIAL = re.compile(r'(I[TG0-9]|ITR|IGS|IGB|SLR|WGS|ECE|PZ|GTR|UND|CGC|BDC|ETR|$)', re.I)
_SPLIT = (slice(4, 18), slice(18, 32), slice(32, 46))
_EXPONENTS = (slice(61, 63), slice(64, 66), slice(67, 69))
_VELOCITY = 0.1  # m/s


def looks_like(lines):
    """Whether this is an SP3 file."""
    return bool(lines) and bool(_HEAD.match(lines[0])) and any(
        line.startswith('##') for line in lines[1:3])


def read(path, lines):
    """Positions of all satellites of a file.

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
        One line: an unknown frame or time scale, or an invalid date or number.
    """
    head = _Head(path, lines)
    dates, rows, rates = [], {}, {}
    for at, line in enumerate(lines, 1):
        kind = line[:1]
        if kind == '*':
            dates.append(_date(line, path, at))
        elif kind == 'P' and dates:
            name = head.name(line[1:4])
            coordinates = _numbers(line, path, at, 'coordinate')
            rows.setdefault(name, []).append((at, len(dates) - 1, *coordinates,
                                              *head.exponents(line)))
        elif kind == 'V' and dates:
            rates.setdefault(head.name(line[1:4]), {})[len(dates) - 1] = _numbers(
                line, path, at, 'velocity')
        elif line.startswith('EOF'):
            break
    if not rows:
        raise ValueError(f'{path} has no position in it: lines with P after an epoch (*)')
    whole, rest = calendar_seconds(dates)
    if np.isnan(whole).any():
        row = int(np.flatnonzero(np.isnan(whole))[0])
        at = [i for i, line in enumerate(lines, 1) if line.startswith('*')][row]
        raise ValueError(f'{path}, line {at}: no date: {lines[at - 1][1:31].strip()}')
    whole = tai_of(whole, head.scale)
    part = np.round(whole - np.floor(whole), 6)
    whole, rest = np.floor(whole), rest + part
    return [_rows(name, np.array(table), whole, rest, rates.get(name), head)
            for name, table in rows.items()]


def _rows(name, table, whole, rest, rates, head):
    lines, epoch = table[:, 0].astype(int), table[:, 1].astype(int)
    velocity = None
    if rates:
        velocity = _VELOCITY * np.array([rates.get(i, (np.nan,) * 3) for i in epoch])
    places = 1e3 * table[:, 2:5]
    places[np.any(np.abs(places) >= 9.99999e8, axis=1)] = np.nan
    places[np.all(places == 0.0, axis=1)] = np.nan
    sigmas = np.where(np.isfinite(table[:, 5]), table[:, 5], head.sigmas.get(name, np.nan))
    return ObjectRows(name, lines, whole[epoch], rest[epoch], places, velocity, sigmas,
                      head.agency, head.predicted)


class _Head:
    """Contents of the lines before the first epoch."""

    def __init__(self, path, lines):
        first = lines[0].ljust(60)
        self.version, frame, kind, self.agency = (
            first[1], first[46:51].strip(), first[52:55].strip(), first[56:60].strip())
        if not _TERRESTRIAL.match(frame):
            raise ValueError(f'{path}, line 1: frame {frame} does not turn with the Earth; give '
                             'the orbit in ITRF')
        self.predicted = kind in ('EXT', 'PRD', 'PRE', 'BHP')
        before = lines[:next((i for i, line in enumerate(lines) if line.startswith('*')),
                             len(lines))]
        at, scale = next(((i, line[9:12].strip()) for i, line in enumerate(before, 1)
                          if line.startswith('%c')), (0, ''))
        self.scale = 'GPS' if scale in ('', 'cc', 'ccc') else scale
        if self.scale not in SCALES:
            raise ValueError(f'{path}, line {at}: time scale {scale} is not known; known are '
                             f'{", ".join(SCALES)}')
        names = _fields(before, re.compile(r'\+ '))
        codes = _fields(before, re.compile(r'\+\+'))
        base = next((line[3:13].strip() for line in before if line.startswith('%f')), '')
        try:
            self._base = float(base) or 1.25
        except ValueError:
            self._base = 1.25
        self.sigmas = {self.name(name): 2.0 ** int(code) * 1e-3
                       for name, code in zip(names, codes)
                       if code.strip().isdigit() and int(code) and name.strip() not in ('', '0')}

    def name(self, text):
        """Name of a satellite: ``' 18'`` in SP3-a is G18."""
        text = text.strip()
        if text.isdigit():
            return f'G{int(text):02d}'
        return text[:1].upper() + (f'{int(text[1:]):02d}' if text[1:].strip().isdigit()
                                   else text[1:])

    def exponents(self, line):
        """Sigma of the coordinates from the exponents in a row of versions c and d, m; else NaN."""
        texts = [line[part].strip() for part in _EXPONENTS]
        if self.version in 'ab' or not all(text.isdigit() for text in texts):
            return (np.nan,)
        return (1e-3 * float(np.sqrt(np.mean([self._base ** (2 * int(text)) for text in texts]))),)


def _fields(lines, begin):
    return [line[i:i + 3] for line in lines if begin.match(line)
            for i in range(9, min(len(line.rstrip()), 60), 3)]


def _date(line, path, at):
    parts = line[1:].split()[:6]
    if len(parts) < 6:
        raise ValueError(f'{path}, line {at}: an epoch of {len(parts)} numbers; six are needed')
    return [number(part, path, at, 'number of a date') for part in parts]


def _numbers(line, path, at, what):
    return [number(line[part], path, at, what) for part in _SPLIT]


ORBIT_FORMATS = (OrbitFormat('SP3', looks_like, read),)
