"""Pointing runs with places among the stars, as TPOINT, TheSky and SPK write them."""

import re

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mount_kinds import KINDS
from pointing_model.mounts import ALTAZ, Mount, sides
from pointing_model.runs.plate_solves.frames import ICRS, OF_DATE, to_icrs

from .run_table import Table, cost_rows, floats, is_number, same_width, usual_width

#: numbers of catalogue right ascension and declination, those of the telescope, sidereal time
PLACES = 14
_MOTION = 3  # more: proper motion in both and a year
_J2000, _YEAR = 946728000.0, 365.25 * 86400.0  # s since 1970, s
_EPOCH = np.datetime64('1970-01-01', 's')


def read_exported(path, body, meta, options=(), altaz=False):
    """Rows of places among the stars and sidereal time, as TPOINT and exports of TheSky have them.

    Each row has the right ascension (h m s) and declination (d m s) of the catalogue, those of
    the telescope (a declination beyond 90 degrees is one through the pole), and the local sidereal
    time (h m, decimal). Which equinox the catalogue has the file does not say; ``meta['equinox']``
    is None. With proper motions (s and arcsec a year) and a year after the catalogue's place it is
    J2000, which the year tells or the option ``J2000``: it is then the epoch of the place. The
    telescope's places are of date. Further numbers are auxiliary readings.

    Parameters
    ----------
    path : Path
        For messages.
    body : list of (int, str)
        Lines with rows; those that begin with ``#`` are rejected by the observers.
    meta : dict
        With ``site`` and, of the run's parameters, ``date`` and ``weather``.
    options : sequence of str
        Of the file.
    altaz : bool
        Of an alt-azimuth mount: its place among the stars, with the sidereal time, is what its
        axes read.

    Returns
    -------
    Table

    Raises
    ------
    ValueError
        No date, another number of columns, a cell that is no number or no angle, another equinox.
    """
    if 'date' not in meta:
        raise ValueError(f'{path}: no date in the line with the latitude; the places of the stars '
                         'need it')
    width = usual_width(body)
    body = [(number, line) for number, line in body
            if not line.startswith('#') or len(line.lstrip('# ').split()) == width]
    numbers = np.array([number for number, _ in body])
    cells = [line.lstrip('# ').split() for _, line in body]
    if width < PLACES:
        raise ValueError(f'{path}, row {numbers[0]}: {width} numbers; {PLACES} are read '
                         '(right ascension and declination of catalogue and telescope, sidereal '
                         'time)')
    reasons = np.zeros(len(cells), dtype=object)
    same_width(path, numbers, cells, width, 'numbers', f'{width} in most rows', reasons)
    first = next(row for row in cells if row[0])
    moving = width >= PLACES + _MOTION and is_number(first[8]) and float(first[8]) >= 60.0
    after = 6 + _MOTION * moving
    angles = {}
    for name, at, count, unit in (
            ('ra', 0, 3, 15.0), ('dec', 3, 3, 1.0), ('ra of the telescope', after, 3, 15.0),
            ('dec of the telescope', after + 3, 3, 1.0), ('sidereal time', after + 6, 2, 15.0)):
        angles[name] = unit * _sexagesimal(
            path, numbers, name, [row[at:at + count] for row in cells], reasons)
    day = (np.datetime64(meta['date'], 's') - _EPOCH).astype(float)
    lst = angles['sidereal time']
    meta.update(equinox=None, clock_tells=True)
    if moving:
        _move(path, numbers, cells, angles, day, options, meta, reasons)
    meta['time_note'] = 'time: made from the sidereal time of each row and the date of the file'
    columns = {'ra_deg': angles['ra'], 'dec_deg': angles['dec'], 'lst_told': lst,
               'time': np.full(len(lst), day + 43200.0)}
    first = np.remainder(lst - angles['ra of the telescope'] + 180.0, 360.0) - 180.0
    second = angles['dec of the telescope']
    if altaz:
        place = Mount.equatorial(meta['site']['latitude']).horizon_of(first * DEG, second * DEG)
        columns['az_enc'], columns['el_enc'] = (angle / DEG for angle in place)
        meta['notes'].append('azimuth and elevation of the mount are made of its right ascension, '
                             'declination and the sidereal time')
    else:
        columns['az_enc'], columns['el_enc'] = first, second
        beyond = np.abs(second) > 90.0
        meta['mount_told'] = 'german' if beyond.any() else 'equatorial'
    if 'NODA' in options:
        meta['notes'].append('option NODA changes nothing here: the places have the diurnal '
                             'aberration (0.32 arcsec at most)')
    _auxiliary(path, numbers, [row[after + 8:] for row in cells], options, columns, meta)
    table = Table(columns, numbers, meta, reasons,
                  names=ALTAZ.names if altaz else KINDS['equatorial'])
    table.exclude(np.array([line.startswith('#') for _, line in body]),
                  'rejected by the observers (#)')
    return table


def _move(path, numbers, cells, angles, day, options, meta, reasons):
    """Apply proper motions from the epoch of the catalogue to the day of the run, in place."""
    across, up, year = (floats(path, numbers, name, [row[6 + i] for row in cells], reasons)
                        for i, name in enumerate(('proper motion in ra', 'proper motion in dec',
                                                  'year of the catalogue')))
    bad = (year != 2000.0) if 'J2000' not in options else ~((year > 1800.0) & (year < 2200.0))
    cost_rows(path, numbers, 'year after the proper motions', [row[8] for row in cells], {
        int(i): 'is not 2000, and only with the option ": J2000" it is that of the epoch alone; '
        'give places of J2000' for i in np.flatnonzero(bad & ~np.isnan(year))}, reasons)
    if 'J2000' in options:
        _refuse_j2000(path, angles, day)
    years = 2000.0 + (day + 43200.0 - _J2000) / _YEAR - year
    angles['ra'] = angles['ra'] + 15.0 * across * years / 3600.0
    angles['dec'] = angles['dec'] + up * years / 3600.0
    meta['sky_frame'] = ICRS
    meta['notes'].append(f'proper motion applied, from {np.nanmin(year):g} to the date of the file')


def _refuse_j2000(path, angles, day):
    """Refuse places of the telescope that are of J2000 too, as some programs mean the option."""
    ra, dec = (angles[name] * DEG for name in ('ra of the telescope', 'dec of the telescope'))
    ra, dec, _ = sides(ra, dec)
    scatter = []
    for place in ((ra, dec), to_icrs(ra, dec, OF_DATE, np.full(len(ra), day))):
        away = np.array([wrap(place[0] - angles['ra'] * DEG) * np.cos(dec),
                         place[1] - angles['dec'] * DEG])
        scatter.append(np.median(np.abs(away - np.median(away, axis=1, keepdims=True))))
    if len(ra) >= 6 and scatter[0] < 0.3 * scatter[1]:
        raise ValueError(f'{path}: the telescope\'s places are J2000 too, as the option ": J2000" '
                         'may mean; only places of date are read')


def _auxiliary(path, numbers, cells, options, columns, meta):
    """Numbers after the sidereal time, under names; words there are left out with a note."""
    rotator = any(option.startswith('ROT') for option in options)
    words = []
    for i, column in enumerate(zip(*cells), 1):
        if all(is_number(cell or 0) for cell in column):
            name = 'rotator_deg' if rotator and i == 1 else f'auxiliary_{i}'
            columns[name] = floats(path, numbers, name, column)
        else:
            words.append(next(filter(None, column))[:40])
    if words:
        meta['notes'].append(f'after the sidereal time left out, no numbers: {", ".join(words)} '
                             '...')


def _sexagesimal(path, numbers, name, cells, reasons):
    """Degrees, or hours, of cells with degrees (hours), minutes and seconds."""
    out, bad = np.full(len(cells), np.nan), {}
    for i, parts in enumerate(cells):
        if not any(parts):
            continue  # of a row that is left out
        if not all(map(is_number, parts)):
            bad[i] = 'is no angle'
            continue
        values = [abs(float(part)) for part in parts]
        if any(not v < 60.0 for v in values[1:]):
            bad[i] = 'has minutes or seconds beyond 60'
            continue
        out[i] = sum(v / 60.0**k for k, v in enumerate(values))
        if parts[0].startswith('-'):
            out[i] = -out[i]
    cost_rows(path, numbers, name, [' '.join(parts).strip() for parts in cells], bad, reasons)
    return out


def _four_angles(body):
    """Lines and cells of rows with four angles in fixed columns, which may touch."""
    numbers, cells = np.array([number for number, _ in body]), []
    places = next((len(match.group(1)) for _, line in body
                   for match in [re.match(r'[-+]?\d+\.(\d+)', line.strip())] if match), 6)
    for _, line in body:
        row = line.split()
        if len(row) < 4:
            row = re.findall(rf'[-+]?\d+\.\d{{{places}}}', line)
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
    numbers, cells = _four_angles(body)
    reasons = np.zeros(len(cells), dtype=object)
    same_width(path, numbers, cells, 4, 'numbers', 'four are read (hour angle and declination, '
               'true and of the mount)', reasons)
    names = ('az', 'el', 'az_enc', 'el_enc')
    columns = {}
    for i, name in enumerate(names):
        columns[name] = floats(path, numbers, name, [row[i] for row in cells], reasons)
    meta['mount_told'] = 'german' if (np.abs(columns['el_enc']) > 90.0 + 5.0).any() \
        else 'equatorial'
    meta['notes'].append(f'hour angle and declination, in degrees, at latitude '
                         f'{meta["site"]["latitude"] / DEG:.6g}')
    return Table(columns, numbers, meta, reasons, names=KINDS['equatorial'])
