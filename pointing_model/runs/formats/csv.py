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

"""Pointing runs as CSV, read and written."""

import csv

import numpy as np

from msg_tools.units import DEG
from msg_tools.whole_files import beside
from pointing_model.mounts import ALTAZ, is_beyond, mount_text, through_pole
from pointing_model.runs.run import COLUMNS, column_name, known_site
from pointing_model.sky.site import SITE

from ..columns import hints, run_table, solve_columns
from ..columns.cell_values import CLOCK, UNKNOWN, day_unit, decimal_points, is_number
from ..columns.cells import Cells, delimiter_of, split_row, write_rows
from ..columns.column_names import CSV_NAMES, HORIZON_NAMES, OTHER_NAMES, near_column
from ..columns.declarations import declarations
from ..columns.run_table import RunFormat, RunTable, content

_TEXT = ('star', 'block', 'run', 'pier_side')  # may hold names in place of numbers
_TOO_CLOSE = 0.05  # s: mean interval below which no mount can go from star to star


def looks_like(lines):
    """The delimiter if this is a table with a header row, else None."""
    top = content(lines)[:2]
    if not top:
        return None
    delimiter = delimiter_of(top[0][1])
    names, *cells = ([cell.strip() for cell in split_row(line, delimiter) or ()]
                     for _, line in top)
    if len(names) < 2 or any(map(is_number, names)):
        return None
    known = [name for name in names
             if any(name in own for own in (CSV_NAMES, OTHER_NAMES[0][1], OTHER_NAMES[1][1]))]
    if delimiter == ' ':  # words of a caption may look like column names
        return delimiter if sum('_' in name for name in known) > 1 else None
    alike = cells and len(cells[0]) == len(names) > 3
    return delimiter if known or alike else None


def read(path, lines, encoder=None):
    """Read a table with a header row.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str
    encoder : {'enc', 'abs'}, optional
        Which pair of encoder columns must be there.

    Returns
    -------
    RunTable

    Raises
    ------
    ValueError
        A column is missing, occurs twice or has mostly bad cells, or most rows have another
        length.
    """
    delimiter = looks_like(lines)
    cells = Cells(path, lines, delimiter)
    header = cells.header
    names, by_header = _header_names(header)
    _require(path, header, encoder, names)
    if not len(cells):
        raise run_table.NoObservations(f'{path} has a header row but no observations')
    columns, meta = {}, {'format': 'csv', **declarations(path, lines, header=True)}
    if {'az', 'el'} <= {by_header.get(name) for name in header if name in HORIZON_NAMES}:
        meta['from_horizon'] = True
    for i, header_name in enumerate(header):
        _take_column(cells, header_name, cells.column(i), columns, meta, by_header, names)
        _note_near(header_name, header, by_header, names, meta['notes'])
    _one_source(columns, meta, names)
    first = content(lines)[0][0]
    commented = [number for number, line in enumerate(lines, 1) if number > first
                 and line.startswith('#') and _is_row(line[1:], delimiter, len(header))]
    return RunTable(columns, cells.lines, meta, cells.reasons, commented=commented, names=names)


def _header_names(header):
    """Kind of mount that the columns belong to, and name in the header -> name in memory."""
    for names, by_header in OTHER_NAMES:
        first = names.columns[0]
        ascension = {'ra_enc_deg'} if first == 'ha' else set()  # the mount's right ascension
        if ({f'{first}_deg', f'{first}_enc_deg', f'{first}_abs_deg'} | ascension) & set(header):
            by_header = dict(by_header)
            if 'ra_deg' in header:  # declination of the catalogue, not of the axis
                by_header['dec_deg'] = 'dec_deg'
            if f'{first}_deg' not in header:
                by_header.update(HORIZON_NAMES)
            return names, by_header
    return ALTAZ.names, CSV_NAMES


def _is_row(line, delimiter, width):
    cells = split_row(line, delimiter) or ()
    return len(cells) == width and sum(is_number(cell) for cell in cells) >= 4


def _take_column(table, header_name, cells, columns, meta, by_header, names):
    name = by_header.get(header_name)
    if name == 'time':
        columns['time'] = _time(table, cells, meta)
    elif name == 'run':
        columns['run'] = _run_numbers(cells, meta)
    elif name in _TEXT:
        columns[name] = _numbers_or_text(cells)
    elif name:
        columns[name] = table.floats(header_name, cells)
        if name in ('approach_az', 'approach_el'):
            table.refuse(header_name, cells, {
                int(i): 'is not -1, 0 or 1' for i in np.flatnonzero(
                    ~np.isin(columns[name], (-1.0, 0.0, 1.0)) & ~np.isnan(columns[name]))})
    elif header_name in ('mount', 'telescope'):
        solve_columns.one_mount(table.path, zip(map('row {}'.format, table.lines), cells))
    elif header_name in COLUMNS:
        meta['notes'].append(f'column {header_name!r} left out: its unit is unknown, the name is '
                             f'{column_name(header_name, names)}')
    elif header_name:
        _take_own(table, header_name, cells, columns, meta)
    elif any(cells):
        meta['notes'].append('a column without a name left out')


def _note_near(header_name, header, by_header, names, notes):
    """Add a note if the name of an unknown column resembles a known one."""
    if not header_name or header_name in by_header or header_name in COLUMNS:
        return
    near = near_column(header_name, header, by_header, names)
    if near:
        notes.append(f'column {header_name[:40]!r} is not read; is it {near}? Then give it that '
                     'name')


def _take_own(table, header_name, cells, columns, meta):
    """Keep a user's column; a bad cell is taken as unknown and does not exclude its row."""
    bad = [i for i, cell in enumerate(decimal_points(cells))
           if cell.lower() not in UNKNOWN and not is_number(cell)]
    text = bad and f'(row {table.lines[bad[0]]}: {cells[bad[0]][:40]!r})'
    if 2 * len(bad) > sum(map(bool, cells)):
        meta['notes'].append(f'column {header_name[:40]!r} left out: it is not numeric {text}')
        return
    known = np.array(cells, dtype=object)
    known[bad] = ''
    values = table.floats(header_name, known.tolist())
    own = run_table.sidereal_name(values, table.header, meta['notes']) if header_name == 'lst' \
        else run_table.own_name(header_name, table.header, meta['notes'])
    columns[own] = values
    if bad:
        meta['notes'].append(f'column {header_name[:40]!r} is not a number in {len(bad)} of '
                             f'{len(cells)} rows: unknown there {text}')


def _one_source(columns, meta, names):
    """Drop redundant columns: kept as a driver, offsets would explain all pointing errors."""
    if {'az_enc', 'az_abs'} & set(columns):
        for name in ('x_arcsec', 'y_arcsec'):
            if columns.pop(name, None) is not None:
                meta['notes'].append(f'{name} left out: the encoder columns are used')
    if {'az', 'el'} <= set(columns):
        of = ALTAZ.names if meta.get('from_horizon') else names
        taken = ', '.join(column_name(name, of) for name in ('az', 'el'))
        for name in ('ra_deg', 'dec_deg'):
            if columns.pop(name, None) is not None:
                meta['notes'].append(f'{name} left out: {taken} are used')


def _require(path, header, encoder, names):
    pair = 'abs' if encoder == 'abs' else 'enc'
    readings = [column_name(f'{axis}_{pair}', names) for axis in ('az', 'el')]
    if pair == 'enc' and {'x_arcsec', 'y_arcsec'} & set(header) and not set(readings) <= set(
            header):
        readings = ['x_arcsec', 'y_arcsec']
    if pair == 'enc' and 'ra_enc_deg' in header and readings[0] not in header:
        readings = ['ra_enc_deg', readings[1], 'lst_h' if 'lst_h' in header else 'time']
    places = [column_name(axis, names) for axis in ('az', 'el')]
    if names is not ALTAZ.names and set(HORIZON_NAMES) <= set(header):
        places = list(HORIZON_NAMES)
    if {'ra_deg', *({'dec_deg'} - set(places))} & set(header) and not set(places) <= set(header):
        places = ['ra_deg', 'dec_deg', 'time']
    required = list(dict.fromkeys(places + readings))
    missing = [name for name in required if name not in header]
    if not missing:
        return
    absent = []
    for name in missing:
        near = hints.closest(name, [h for h in header if h not in required])
        absent.append(f'{name} (closest: {near[:40]})' if near else name)
    hint = hints.offsets(header) if set(readings) & set(missing) else ''
    second = [column_name(f'{axis}_abs', names) for axis in ('az', 'el')]
    if pair != 'abs' and set(second) <= set(header):
        hint += f"; encoder 'abs' reads {', '.join(second)} in their place"
    there = ', '.join(h[:40] for h in header[:40])
    raise ValueError(f'{path}: no column {", ".join(absent)}; the file has {there}{hint}')


def _numbers_or_text(cells):
    try:
        values = np.array(cells, dtype=float)
    except ValueError:
        return np.array(cells, dtype=str)
    whole = np.isfinite(values) & (values == np.floor(values)) & (np.abs(values) < 2.0**53)
    return values.astype(np.int64) if whole.all() else values


def _run_numbers(cells, meta):
    """Run numbers; named runs are numbered in order of appearance."""
    values = _numbers_or_text(cells)
    if values.dtype.kind != 'U':
        return values
    return run_table.numbered_runs(cells, meta['notes'])


def _time(table, cells, meta):
    values = table.times('time', cells)
    if sum(map(is_number, cells)) * 2 > sum(map(bool, cells)):
        _refuse_other_units(table, values)
        if np.any(np.abs(values) < CLOCK):
            meta['time_is_utc'] = False
            meta['notes'].append('time: below 1e8, so seconds from an arbitrary start')
    return values


def _refuse_other_units(table, values):
    finite = np.isfinite(values)
    known = np.sort(values[finite])
    if len(known) < 5 or known[0] == known[-1]:
        return
    gap = (known[-1] - known[0]) / (len(known) - 1)
    unit = day_unit(known[0]) or ('hours' if known[-1] <= 48.0 else 'days')
    if gap < _TOO_CLOSE:
        raise ValueError(
            f'{table.path}, column time, rows {table.lines[finite][0]} to '
            f'{table.lines[finite][-1]}: rows are {gap:.2g} s apart on average; seconds are '
            f'expected: is this {unit}? Give seconds or ISO 8601')


# ------------------------------------------------------------------------------------- writing

def iso_utc(seconds, unit='ns'):
    """Times as ISO 8601 UTC; nanoseconds are enough to read the same float64 back.

    Parameters
    ----------
    seconds : ndarray, shape (n,)
        UTC, seconds since 1970; NaN gives an empty text.
    unit : {'ns', 'us'}
        The last digit.

    Returns
    -------
    list of str
    """
    known = np.isfinite(seconds)
    whole = np.floor(np.where(known, seconds, 0.0))
    parts = 1e9 if unit == 'ns' else 1e6
    rest = np.rint((np.where(known, seconds, 0.0) - whole) * parts).astype(np.int64)
    stamps = whole.astype(np.int64).astype('datetime64[s]') \
        + rest.astype(f'timedelta64[{unit}]')
    texts = np.datetime_as_string(stamps, unit=unit)
    return [text + 'Z' if ok else '' for text, ok in zip(texts.tolist(), known.tolist())]


def _plain(values, unit):
    """Cells with rounded numbers, see `write_csv`."""
    known = values[values == values]
    if known.size and np.all(known == np.rint(known)) and np.abs(known).max() < 1e15:
        return ['' if v != v else f'{v:.0f}' for v in values.tolist()]
    if unit == 1.0:
        return ['' if v != v else repr(v) for v in values.tolist()]
    digits = 10 if unit == DEG else 6
    # not minus zero
    return ['' if v != v else f'{round(v, digits) + 0.0:.{digits}f}' for v in values.tolist()]


def written_columns(run):
    """The columns of a run with the names and units of a file.

    Parameters
    ----------
    run : PointingRun

    Yields
    ------
    name : str
        Such as ``az_deg``; those of `COLUMNS` in their order, then the user's columns.
    values : ndarray, shape (n,)
        In the unit that the name has; ``time`` in seconds.
    unit : float
        This unit in SI.
    """
    mount, beyond = run.mount, is_beyond(run['el'])
    places = {} if mount.vertical and not beyond.any() else dict(zip(
        ('az', 'el'), through_pole(run['az'], run['el'], beyond)))  # the readings give the side
    for name in [*(one for one in COLUMNS if one in run),
                 *(one for one in run.columns if one not in COLUMNS)]:
        values = places.get(name, run[name])
        if name in ('miss_x', 'miss_y'):
            values = np.where(beyond, -values, values)
        unit = COLUMNS[name][1] if name in COLUMNS else 1.0
        yield (column_name(name, mount.names),
               values / unit if unit != 1.0 and values.dtype.kind in 'fc' else values, unit)


def write_csv(run, path, *, plain=False):
    """Write a run as CSV; `read_run` restores it to better than 1e-9 arcsec.

    Parameters
    ----------
    run : PointingRun
    path : str or Path
        Overwritten.
    plain : bool
        Round numbers: degrees to 1e-10 (3.6e-7 arcsec), arcseconds to 1e-6, times to the
        microsecond; whole numbers are written without a point.

    Raises
    ------
    ValueError
        A text in the run contains a line break.
    OSError
        The file cannot be written.

    Notes
    -----
    For mounts other than alt-azimuth ones, comments before the header declare mount and site.
    Columns are in the order of `COLUMNS`, then the user's. Numbers have all their digits unless
    `plain`; unknown values (NaN) are empty cells. Time is ISO 8601 UTC, or seconds if
    ``meta['time_is_utc']`` is False. The rest of ``meta`` is not written.
    """
    columns = []
    for name, values, unit in written_columns(run):
        if name == 'time' and run.meta.get('time_is_utc', True):
            columns.append(iso_utc(np.asarray(values, dtype=float), 'us' if plain else 'ns'))
        elif values.dtype.kind in 'fc':
            columns.append(_plain(values, unit) if plain else
                           ['' if v != v else repr(v) for v in values.tolist()])
        else:
            columns.append(values.tolist())
    header = [name for name, _, _ in written_columns(run)]
    texts = [cell for cells in [header, *columns] for cell in cells if isinstance(cell, str)]
    if any('\n' in text or '\r' in text for text in texts):
        raise ValueError(f'{path}: a name in the run spans lines; CSV rows are lines here')
    # a row that begins with the comment sign would be lost
    quoting = csv.QUOTE_NONNUMERIC if any(t.startswith('#') for t in texts) else csv.QUOTE_MINIMAL
    with beside(path) as part, open(part, 'w', newline='', encoding='utf-8') as stream:
        stream.writelines(f'# {line}\n' for line in _declarations(run))
        write_rows(stream, [header, *zip(*columns)], quoting=quoting)


def _declarations(run):
    """Comments from which `read` restores mount and site."""
    mount = run.mount
    if mount.vertical:
        return []
    place = dict(known_site(run.meta))
    if mount.celestial:
        place['latitude'] = mount.latitude
    return [f'mount: {mount_text(mount)}', *(
        f'{key}: {place[one.field] / one.size!r}' for key, one in SITE.items()
        if place.get(one.field) is not None)]


FORMAT = RunFormat('a CSV file with a header row (az_deg, el_deg, az_enc_deg, el_enc_deg, ...)',
                   looks_like, read, run_table.AS_NAMED, rank=1, of_encoder=True)
