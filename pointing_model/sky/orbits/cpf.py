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

"""CPF: predictions of the ILRS for ranging, versions 1 and 2 (R. Ricklefs, Consolidated Laser
Ranging Prediction Format, 2018).

Header lines H1 (provider, date, target) and H2 (numbers, times, frame), then positions in lines 10
and velocities in lines 20, m and m/s in ITRF. Dates are MJD and seconds of UTC.
"""

import numpy as np

from .orbit_table import ObjectRows, OrbitFormat, number
from .time_scales import calendar_seconds, tai_of

_MJD_1970 = 40587
_FRAMES = {0: 'Earth-fixed', 1: 'inertial, true of date', 2: 'inertial, mean of J2000'}
#: points of a polynomial, by the specification
_COUNT = 10


def looks_like(lines):
    """Whether this is a CPF file."""
    return any(line[:2].upper() == 'H1' and line.split()[1:2] == ['CPF'] for line in lines[:5])


def read(path, lines):
    """Positions of a file; concatenated files are read separately.

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
        One line: another frame, a truncated line, or an invalid number.
    """
    begins = [i for i, line in enumerate(lines) if line[:2].upper() == 'H1']
    return [_one(path, lines[first:last], first) for first, last in zip(
        begins, [*begins[1:], len(lines)])]


def _one(path, lines, before):
    name, provider, others, frame, issued = 'target', '', (), 0, None
    rows, rates = [], {}
    for at, line in enumerate(lines, before + 1):
        kind, *words = line.split() or ['']
        if kind.upper() == 'H1':
            name, provider, issued = _first(path, at, words)
        elif kind.upper() == 'H2':
            others, frame = _second(path, at, words)
        elif kind == '10' and words:
            direction = words[0]
            if direction not in ('0', '1', '2') or len(words) < 7:
                raise ValueError(f'{path}, line {at}: a position of {len(words)} numbers; seven '
                                 'are needed: is the file cut off?')
            if direction == '0':
                rows.append((at, *(number(word, path, at, 'number') for word in words[1:7])))
        elif kind == '20' and words and words[0] == '0' and rows:
            rates[len(rows) - 1] = [number(word, path, at, 'velocity') for word in words[1:4]]
    if frame:
        raise ValueError(f'{path}: its frame is {_FRAMES.get(frame, frame)}; give a prediction in '
                         'the Earth-fixed frame (H2, frame 0)')
    if not rows:
        raise ValueError(f'{path} has no position in it: lines that begin with 10 0')
    table = np.array(rows)
    # seconds of the file continue over a leap second within it, whose number is in the row
    seconds = (table[:, 1] - _MJD_1970) * 86400.0 + np.floor(table[:, 2])
    whole = tai_of(seconds - table[:, 3], 'UTC')
    velocity = None if not rates else np.array([rates.get(i, (np.nan,) * 3)
                                                for i in range(len(rows))])
    return ObjectRows(name, table[:, 0].astype(int), whole, table[:, 2] - np.floor(table[:, 2]),
                      table[:, 4:7], velocity, None, provider, True, issued, _COUNT, others)


def _first(path, at, words):
    """Name, provider and TAI of its creation."""
    if len(words) < 9:
        raise ValueError(f'{path}, line {at}: the first header line has {len(words)} words; is '
                         'the file cut off?')
    date = [number(word, path, at, 'number of a date') for word in words[3:7]]
    whole, _ = calendar_seconds([[*date, 0.0, 0.0]])
    # version 2 has the number of the prediction within the day before the name
    name = words[9] if words[1] != '1' and len(words) > 9 else words[8]
    issued = None if np.isnan(whole[0]) else float(tai_of(whole[0], 'UTC'))
    return name.lower(), words[2], issued


def _second(path, at, words):
    """Catalogue numbers of the satellite, and the frame."""
    if len(words) < 18:
        raise ValueError(f'{path}, line {at}: the second header line has {len(words)} words; is '
                         'the file cut off?')
    frame = int(number(words[18], path, at, 'frame')) if len(words) > 18 else 0
    return tuple(word for word in words[:3] if word.strip('0')), frame


ORBIT_FORMATS = (OrbitFormat('CPF', looks_like, read),)
