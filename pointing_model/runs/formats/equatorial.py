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

"""Pointing runs with right ascensions and declinations, as TPOINT, TheSky and SPK write them."""

import re

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mount_kinds import KINDS
from pointing_model.mounts import ALTAZ, Mount, sides
from pointing_model.runs.plate_solves.frames import ICRS, OF_DATE, to_icrs
from pointing_model.runs.run import REQUIRED

from ..columns.cell_values import WordRows, is_number, sexagesimal
from ..columns.pier_side import read_beyond
from ..columns.row_checks import PAIRS
from ..columns.run_table import RunTable

#: count of numbers in a row: right ascension and declination of catalogue and telescope, and
#: sidereal time
PLACES = 14
_MOTION = 3  # additional numbers: two proper motions and a year
_J2000, _YEAR = 946728000.0, 365.25 * 86400.0  # s since 1970, s
_EPOCH = np.datetime64('1970-01-01', 's')


def read_exported(path, body, meta, options=(), altaz=False):
    """Read rows with right ascension, declination and sidereal time of TPOINT or TheSky.

    Each row has the right ascension (h m s) and declination (d m s) of the catalogue, those of
    the telescope (a declination beyond 90 degrees means through the pole), and the local sidereal
    time (h m, decimal). The file does not give the equinox of the catalogue; ``meta['equinox']``
    is None. If proper motions (s and arcsec a year) and a year follow the catalogue place, it is
    J2000: the year must be 2000, or with the option ``J2000`` it is the epoch of the place. The
    telescope's places are of date. Further numbers are auxiliary readings.

    Parameters
    ----------
    path : Path
        For messages.
    body : list of (int, str)
        Line number and text of each row; the observers rejected those that begin with ``#``.
    meta : dict
        With ``site`` and the run parameters ``date`` and ``weather``.
    options : sequence of str
        Of the file.
    altaz : bool
        For an alt-azimuth mount: its readings are computed from its right ascension, declination
        and the sidereal time.

    Returns
    -------
    RunTable

    Raises
    ------
    ValueError
        There is no date, the number of columns is wrong, a cell is not a number or angle, or the
        equinox is another one.
    """
    if 'date' not in meta:
        raise ValueError(f'{path}: no date in the line with the latitude; the places of the stars '
                         'need it')
    rows, width = WordRows.of_usual_width(path, body)
    if width < PLACES:
        raise ValueError(f'{path}, row {rows.lines[0]}: {width} numbers; {PLACES} are read '
                         '(right ascension and declination of catalogue and telescope, sidereal '
                         'time)')
    rows.same_width(width, 'numbers', f'{width} in most rows')
    first = next(row for row in rows.cells if row[0])
    moving = width >= PLACES + _MOTION and is_number(first[8]) and float(first[8]) >= 60.0
    after = 6 + _MOTION * moving
    angles = {}
    for name, at, count, unit in (
            ('ra', 0, 3, 15.0), ('dec', 3, 3, 1.0), ('ra of the telescope', after, 3, 15.0),
            ('dec of the telescope', after + 3, 3, 1.0), ('sidereal time', after + 6, 2, 15.0)):
        angles[name] = unit * _sexagesimal(
            rows, name, [row[at:at + count] for row in rows.cells])
    day = (np.datetime64(meta['date'], 's') - _EPOCH).astype(float)
    lst = angles['sidereal time']
    meta.update(equinox=None, sidereal_clock=True)
    if moving:
        _move(rows, angles, day, options, meta)
    meta['time_note'] = 'time: from the sidereal time of each row and the date of the file'
    columns = {'ra_deg': angles['ra'], 'dec_deg': angles['dec'], 'lst_given': lst,
               'time': np.full(len(lst), day + 43200.0)}
    first = np.remainder(lst - angles['ra of the telescope'] + 180.0, 360.0) - 180.0
    second = angles['dec of the telescope']
    if altaz:
        place = Mount.equatorial(meta['site']['latitude']).horizon_of(first * DEG, second * DEG)
        columns['az_enc'], columns['el_enc'] = (angle / DEG for angle in place)
        meta['notes'].append('azimuth and elevation of the mount are computed from its right '
                             'ascension, declination and the sidereal time')
    else:
        columns['az_enc'], columns['el_enc'] = first, second
        _declare(meta, (lst - angles['ra'], angles['dec']), (first, second))
    if 'NODA' in options:
        meta['notes'].append('option NODA ignored: the places include the diurnal '
                             'aberration (0.32 arcsec at most)')
    _auxiliary(rows, after + 8, options, columns, meta)
    table = RunTable(columns, rows.lines, meta, rows.reasons,
                     names=ALTAZ.names if altaz else KINDS['equatorial'])
    table.exclude(rows.commented, 'rejected by the observers (#)')
    return table


def _declare(meta, place, reads):
    """Declare a German mount if it reads beyond the pole; angles in deg."""
    place, reads = (np.array(pair) * DEG for pair in (place, reads))
    sound = np.isfinite(reads).all(axis=0)
    if read_beyond(Mount.equatorial(0.0, 'german'), place, reads, sound).any():
        meta['mount_declared'] = 'german'


def _move(rows, angles, day, options, meta):
    """Apply proper motions from the epoch of the catalogue to the day of the run, in place."""
    across, up, year = (rows.floats(name, rows.column(i)) for i, name in enumerate(
        ('proper motion in ra', 'proper motion in dec', 'year of the catalogue'), 6))
    bad = (year != 2000.0) if 'J2000' not in options else ~((year > 1800.0) & (year < 2200.0))
    rows.refuse('year after the proper motions', rows.column(8), {
        int(i): 'is not 2000: without the option ": J2000" it is the equinox, too; '
        'give places of J2000' for i in np.flatnonzero(bad & ~np.isnan(year))})
    if 'J2000' in options:
        _refuse_j2000(rows.path, angles, day)
    years = 2000.0 + (day + 43200.0 - _J2000) / _YEAR - year
    angles['ra'] = angles['ra'] + 15.0 * across * years / 3600.0
    angles['dec'] = angles['dec'] + up * years / 3600.0
    meta['sky_frame'] = ICRS
    meta['notes'].append(f'proper motion applied, from {np.nanmin(year):g} to the date of the file')


def _refuse_j2000(path, angles, day):
    """Refuse J2000 places of the telescope: some programs use the option in this sense."""
    ra, dec = (angles[name] * DEG for name in ('ra of the telescope', 'dec of the telescope'))
    ra, dec, _ = sides(ra, dec)
    scatter = []
    for place in ((ra, dec), to_icrs(ra, dec, OF_DATE, np.full(len(ra), day))):
        away = np.array([wrap(place[0] - angles['ra'] * DEG) * np.cos(dec),
                         place[1] - angles['dec'] * DEG])
        scatter.append(np.median(np.abs(away - np.median(away, axis=1, keepdims=True))))
    if len(ra) >= 6 and scatter[0] < 0.3 * scatter[1]:
        raise ValueError(f'{path}: the telescope\'s places look like J2000, which the option '
                         '": J2000" may mean; give places of date')


def _auxiliary(rows, begin, options, columns, meta):
    """Add the numbers after the sidereal time as columns; words there only cause a note."""
    rotator = any(option.startswith('ROT') for option in options)
    words = []
    for i, column in enumerate(zip(*(row[begin:] for row in rows.cells)), 1):
        if all(is_number(cell or 0) for cell in column):
            name = 'rotator_deg' if rotator and i == 1 else f'auxiliary_{i}'
            columns[name] = rows.floats(name, column)
        else:
            words.append(next(filter(None, column))[:40])
    if words:
        meta['notes'].append('columns after the sidereal time left out, not numeric: '
                             f'{", ".join(words)} ...')


def _sexagesimal(rows, name, cells):
    """Degrees (or hours) from cells with degrees (or hours), minutes and seconds."""
    out, bad = np.full(len(cells), np.nan), {}
    for i, parts in enumerate(cells):
        if not any(parts):
            continue  # the row is excluded
        if not all(map(is_number, parts)):
            bad[i] = 'is no angle'
            continue
        if any(not abs(float(part)) < 60.0 for part in parts[1:]):
            bad[i] = 'has minutes or seconds beyond 60'
            continue
        out[i] = sexagesimal(parts)
    rows.refuse(name, [' '.join(parts).strip() for parts in cells], bad)
    return out


def _four_angles(body):
    """Cells of rows with four angles in fixed columns, possibly without blanks between them."""
    places = next((len(match.group(1)) for _, line in body
                   for match in [re.match(r'[-+]?\d+\.(\d+)', line.strip())] if match), 6)
    return [line.split() if len(line.split()) >= 4 else re.findall(
        rf'[-+]?\d+\.\d{{{places}}}', line) for _, line in body]


def read_short(path, body, meta):
    """Read the short form with a line ``E``: hour angle and declination, true and mount's, deg.

    Parameters
    ----------
    path : Path
    body : list of (int, str)
    meta : dict
        With ``site``.

    Returns
    -------
    RunTable
    """
    rows = WordRows(path, body)
    rows.cells = _four_angles(body)
    rows.same_width(4, 'numbers', 'four are read (hour angle and declination, true and of the '
                    'mount)')
    columns = {name: rows.floats(name, rows.column(i)) for i, name in enumerate(REQUIRED)}
    _declare(meta, *([columns[name] for name in pair] for pair in PAIRS[:2]))
    meta['notes'].append(f'hour angle and declination, in degrees, at latitude '
                         f'{meta["site"]["latitude"] / DEG:.6g}')
    return RunTable(columns, rows.lines, meta, rows.reasons, names=KINDS['equatorial'])
