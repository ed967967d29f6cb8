"""Pointing runs of equatorial mounts as TPOINT, TheSky and SPK write them."""

import re

import numpy as np

from msg_tools.units import DEG
from pointing_model.mounts import KINDS

from .table import Table, is_number, same_width

#: catalogue right ascension and declination, those of the telescope, sidereal time
_WIDTH = 14
_EPOCH = np.datetime64('1970-01-01', 's')


def read_exported(path, body, meta):
    """Rows of an export of TheSky or TPOINT (``:EQUAT``): places and sidereal time.

    Each row has the right ascension (h m s) and declination (d m s) of the catalogue, those of
    the telescope (a declination beyond 90 degrees is one through the pole), and the local sidereal
    time (h m, decimal). Which equinox the catalogue has the file does not say; ``meta['equinox']``
    is None.

    Parameters
    ----------
    path : Path
        For messages.
    body : list of (int, str)
        Lines with rows.
    meta : dict
        With ``site`` and, of the run's parameters, ``date`` and ``weather``.

    Returns
    -------
    Table

    Raises
    ------
    ValueError
        No date, another number of columns, a cell that is no number or no angle.
    """
    if 'date' not in meta:
        raise ValueError(f'{path}: no date in the line with the latitude; the places of the stars '
                         'need it')
    numbers = np.array([number for number, _ in body])
    cells = [line.split() for _, line in body]
    if len(cells[0]) < _WIDTH:
        raise ValueError(f'{path}, row {numbers[0]}: {len(cells[0])} numbers; {_WIDTH} are read '
                         '(right ascension and declination of catalogue and telescope, sidereal '
                         'time)')
    same_width(path, numbers, cells, len(cells[0]), 'numbers', f'{len(cells[0])} in the first row')
    angles = {}
    for name, first, count, unit in (('ra', 0, 3, 15.0), ('dec', 3, 3, 1.0), ('ra of the telescope',
                                     6, 3, 15.0), ('dec of the telescope', 9, 3, 1.0),
                                     ('sidereal time', 12, 2, 15.0)):
        angles[name] = unit * _sexagesimal(path, numbers, name,
                                           [row[first:first + count] for row in cells])
    day = (np.datetime64(meta['date'], 's') - _EPOCH).astype(float)
    lst = angles['sidereal time']
    meta.update(equinox=None, clock_tells=True)
    beyond = np.abs(angles['dec of the telescope']) > 90.0
    meta['mount_told'] = 'german' if beyond.any() else 'equatorial'
    meta['time_note'] = 'time: made from the sidereal time of each row and the date of the file'
    columns = {
        'ra_deg': angles['ra'], 'dec_deg': angles['dec'], 'lst_told': lst,
        'time': np.full(len(lst), day + 43200.0),
        'az_enc': np.remainder(lst - angles['ra of the telescope'] + 180.0, 360.0) - 180.0,
        'el_enc': angles['dec of the telescope']}
    return Table(columns, numbers, [' '.join(row) for row in cells], meta,
                 names=KINDS['equatorial'])


def _sexagesimal(path, numbers, name, cells):
    """Degrees, or hours, of cells with degrees (hours), minutes and seconds."""
    out = np.empty(len(cells))
    for i, parts in enumerate(cells):
        if not all(map(is_number, parts)):
            raise ValueError(f'{path}, row {numbers[i]}, {name}: {" ".join(parts)[:40]!r} is no '
                             'angle')
        values = [abs(float(part)) for part in parts]
        if any(not v < 60.0 for v in values[1:]):
            raise ValueError(f'{path}, row {numbers[i]}, {name}: {" ".join(parts)[:40]!r} has '
                             'minutes or seconds beyond 60')
        out[i] = sum(v / 60.0**k for k, v in enumerate(values))
        if parts[0].startswith('-'):
            out[i] = -out[i]
    return out


def four_angles(path, body):
    """Cells of rows with four angles in fixed columns, which may touch.

    Parameters
    ----------
    path : Path
        For messages.
    body : list of (int, str)

    Returns
    -------
    numbers : ndarray of int, shape (n,)
    cells : list of list of str

    Raises
    ------
    ValueError
        A row that does not hold four numbers.
    """
    numbers, cells = np.array([number for number, _ in body]), []
    places = next((len(match.group(1)) for _, line in body
                   for match in [re.match(r'[-+]?\d+\.(\d+)', line.strip())] if match), 6)
    for number, line in body:
        row = line.split()
        if len(row) < 4:
            row = re.findall(rf'[-+]?\d+\.\d{{{places}}}', line)
        if len(row) < 4:
            raise ValueError(f'{path}, row {number}: {line[:60]!r} does not hold four angles')
        cells.append(row)
    return numbers, cells


def read_short(path, body, meta):
    """Rows of the short form with a line ``E``: true hour angle and declination, the mount's, deg.

    Parameters
    ----------
    path : Path
    body : list of (int, str)
    meta : dict
        With ``site``.

    Returns
    -------
    Table
    """
    numbers, cells = four_angles(path, body)
    same_width(path, numbers, cells, 4, 'numbers', 'four are read (hour angle and declination, '
               'true and of the mount)')
    names = ('az', 'el', 'az_enc', 'el_enc')
    columns = {}
    for i, name in enumerate(names):
        bad = [k for k, row in enumerate(cells) if not is_number(row[i])]
        if bad:
            raise ValueError(f'{path}, row {numbers[bad[0]]}: {cells[bad[0]][i]!r} is not a number')
        columns[name] = np.array([float(row[i]) for row in cells])
    meta['mount_told'] = 'german' if (np.abs(columns['el_enc']) > 90.0 + 5.0).any() \
        else 'equatorial'
    meta['notes'].append(f'hour angle and declination, in degrees, at latitude '
                         f'{meta["site"]["latitude"] / DEG:.6g}')
    return Table(columns, numbers, [' '.join(row) for row in cells], meta,
                 names=KINDS['equatorial'])
