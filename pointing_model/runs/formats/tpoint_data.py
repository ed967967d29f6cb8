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

"""Pointing runs in TPOINT format 4, its format for equatorial mounts, and the short forms."""

import re
from datetime import date

import numpy as np

from msg_tools.units import DEG
from pointing_model.runs.run import REQUIRED

from ..columns.cell_values import WordRows, is_number, sexagesimal
from ..columns.run_table import NoObservations, RunFormat, RunTable, content
from .equatorial import PLACES, read_exported, read_short

_SHORT = 'EQUATORIAL, SHORT'  # marks the short form; no file has such an option
_OPTIONS = ('ALTAZ', 'J2000', 'NODA', 'ALLSKY')  # besides EQUAT... and ROT...
_ANGLES = ('observed azimuth', 'observed elevation', 'mount azimuth', 'mount elevation')


def looks_like(lines):
    """Whether there are option lines, or the short form's line ``A`` or ``E``."""
    body = content(lines, '!')
    if any(line.startswith(':') for _, line in body[:10]):
        return True
    return len(body) > 1 and body[1][1].strip().upper() in ('A', 'E')


def read(path, lines):
    """Read caption, options, run parameters and rows of observed and mount azimuth and elevation.

    A line that begins with ``#`` is an observation rejected by the observers if it holds numbers,
    else a comment.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str

    Returns
    -------
    RunTable
        ``meta['told_origin']`` is the direction of azimuth 0 given in a comment: 'N', 'S' or None.
        If a comment gives azimuth 90 as west, the azimuths are converted to count through east and
        ``meta['told_west']`` is True.

    Raises
    ------
    ValueError
        The format is another one, the latitude is missing, or a cell is not a number.
    """
    comments = ' '.join(line for line in lines if line.lstrip().startswith('!'))
    # the first mention counts: a comment may go on to describe another program
    origin = re.search(r'\b(N|S|North|South)\s*=\s*0(?:\.0*)?(?![.\d])', comments, re.IGNORECASE)
    sense = re.search(r'\b(E|W|East|West)\s*=\s*90(?:\.0*)?(?![.\d])', comments, re.IGNORECASE)
    meta = {'format': 'tpoint', 'notes': [],
            'told_origin': origin.group(1)[0].upper() if origin else None}
    body, commented = _body(lines, meta)
    if not body:
        raise ValueError(f'{path} holds only comments')
    meta['caption'] = body.pop(0)[1]
    body = [(number, line) for number, line in body if not line.startswith('#') or _rejected(line)]
    caption_date = re.search(r'\b(\d{4}-\d\d-\d\d)', meta['caption'], re.ASCII)
    if caption_date:
        meta['date'] = caption_date.group(1)
    options = [line[1:].strip().upper() for _, line in body if line.startswith(':')]
    body = [(number, line) for number, line in body if not line.startswith(':')]
    if body and body[0][1].upper() in ('A', 'E'):
        options.append('ALTAZ' if body.pop(0)[1].upper() == 'A' else _SHORT)
    words = [word for option in options if option != _SHORT for word in option.split()]
    _know(path, words, meta)
    exported, short = any(word.startswith('EQUAT') for word in words), _SHORT in options
    if not (exported or short or 'ALTAZ' in words):
        raise ValueError(f'{path}: no option ": ALTAZ" or ": EQUAT" says which mount it is of')
    if not body:
        raise ValueError(f'{path} ends before the line with the latitude')
    i = next((i for i, (_, line) in enumerate(body) if not line.startswith('#')), 0)
    begin, parameters = body[i]
    body = body[i + 1:]
    _run_parameters(path, begin, parameters, meta)
    if short:
        body = [(number, line) for number, line in body if not line.startswith('#')]
    if not body:
        raise NoObservations(f'{path} has a header but no observations')
    if short:
        return read_short(path, body, meta)
    if exported or len(body[0][1].lstrip('# ').split()) >= PLACES:
        return read_exported(path, body, meta, words, altaz=not exported)
    rotator = any(option.startswith('ROT') for option in options)
    rows, width = WordRows.of_usual_width(path, body)
    if not 4 <= width <= 8:
        raise ValueError(f'{path}, row {rows.lines[0]}: {width} numbers; only format 4 (observed '
                         'azimuth and elevation, mount azimuth and elevation) is read')
    rows.same_width(width, 'numbers', f'{width} in most rows')
    names = [*_ANGLES, *('rotator_deg' if rotator and i == 0 else f'auxiliary_{i + 1}'
                         for i in range(width - 4))]
    columns = {key: rows.floats(name, column)
               for key, name, column in zip([*REQUIRED, *names[4:]], names, zip(*rows.cells))}
    commented = [n for n, words in commented if len(words) == width and n > begin]
    table = RunTable(columns, rows.lines, meta, rows.reasons, commented=commented)
    table.exclude(rows.commented, 'rejected by the observers (#)')
    if sense is not None and sense.group(1)[0].upper() == 'W':
        for name in (REQUIRED[0], REQUIRED[2]):
            columns[name] = np.mod(-columns[name], 360.0)
        meta['told_west'] = True
    return table


def _know(path, words, meta):
    """Refuse options of unsupported mounts; add a note on unknown options."""
    if 'GIMBAL' in words:
        raise ValueError(f'{path}: option GIMBAL is not read: give a CSV with a line '
                         '"# mount: free:AZ,EL[,ROLL]"')
    if 'ALTAZ' in words and any(word.startswith('EQUAT') for word in words):
        raise ValueError(f'{path}: options ALTAZ and EQUAT contradict each other')
    other = [word for word in words if word not in _OPTIONS and not is_number(word)
             and not word.startswith(('EQUAT', 'ROT'))]
    if other:
        meta['notes'].append(f'option {", ".join(w[:20] for w in other)} is not known: '
                             'ignored')


def _rejected(line):
    """Whether a line with a # holds an observation: at least the four numbers of format 4."""
    words = line.lstrip('# ').split()
    return len(words) >= len(_ANGLES) and all(map(is_number, words))


def _body(lines, meta):
    """(line number, text) without comments up to END; and the comments that are all numbers."""
    body, commented = [], []
    for number, line in enumerate(lines, 1):
        line, _, comment = line.partition('!')
        line = line.strip()
        if line.upper() == 'END':
            left = len(content(lines[number:], '!'))
            if left:
                meta['notes'].append(f'{left} lines after END not read')
            break
        if line:
            body.append((number, line))
            continue
        words = comment.partition('!')[0].split()  # a commented-out line may have a comment
        if words and all(map(is_number, words)):
            commented.append((number, words))
    return body, commented


def _run_parameters(path, number, line, meta):
    """Latitude (deg, deg min or deg min sec), date, temperature, pressure, height, humidity."""
    where = f'{path}, row {number}'
    words = line.split()
    if not all(map(is_number, words)):
        raise ValueError(f'{where}: {line[:60]!r} is not the line of run parameters, which begins '
                         'with the latitude')
    values = [float(word) for word in words]
    if not np.all(np.isfinite(values)):
        raise ValueError(f'{where}: {line[:60]!r} has a run parameter that is not finite')
    if not all(0.0 <= v < 60.0 for v in values[1:3]):
        raise ValueError(f'{where}: {line[:60]!r} begins with a latitude whose minutes or '
                         'seconds are outside 0 to 60')
    latitude = sexagesimal(words[:3])
    if abs(latitude) > 90.0:
        raise ValueError(f'{where}: latitude {line[:60]!r} is beyond 90 degrees')
    meta['site'] = {'latitude': latitude * DEG}
    if len(values) >= 6:
        meta['date'] = '{:04.0f}-{:02.0f}-{:02.0f}'.format(*values[3:6])
        try:
            date.fromisoformat(meta['date'])
        except ValueError:
            raise ValueError(f'{where}: {line[:60]!r} has no date behind the latitude: write year, '
                             'month, day') from None
    if len(values) >= 8:
        meta['weather'] = {'temperature_c': values[6], 'pressure_hpa': values[7]}
    if len(values) >= 9:
        meta['site']['height'] = values[8]
    if len(values) >= 10:
        meta['weather']['humidity'] = values[9]
    if len(values) >= 11:
        meta['weather']['wavelength_um'] = values[10]


FORMAT = RunFormat('a TPOINT file (caption, ": ALTAZ" or ": EQUAT", latitude, rows)', looks_like,
                   read, rank=2, taken=(
                       'columns without names, taken as catalogue (observed places if it has no '
                       'right ascensions), then mount'))
