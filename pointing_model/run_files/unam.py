"""Pointing runs of the telescope control system of the UNAM, as COATLI writes them."""

import re

import numpy as np

from pointing_model.mounts import KINDS
from pointing_model.plate_solved.frames import ICRS

from .table import Table, content, floats, parse_iso, same_width

_NAME = re.compile(r'(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)\w*')
_COLUMNS = ('name', 'requested ra', 'requested dec', 'observed ra', 'observed dec', 'mount ha',
            'mount ra', 'mount dec', 'rotation', 'solved ra', 'solved dec', 'equinox')
_USED = _COLUMNS[5:]


def looks_like_unam(lines):
    """Whether the first row begins with a name that is a time stamp, among so many columns."""
    first = next((line for _, line in content(lines)), '').split()
    return len(first) == len(_COLUMNS) and _NAME.fullmatch(first[0]) is not None


def read_unam(path, lines):
    """Solved images with the angles of a German mount, and the side of the pier.

    The catalogue is the solved place (J2000), the reading hour angle and declination of the mount;
    rotation 180 is the side through the pole. The stamp in the name has whole seconds, so the
    moment is told by the sidereal time, which is hour angle plus right ascension of the mount.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str

    Returns
    -------
    Table

    Raises
    ------
    ValueError
        A row of another length, a cell that is no number, a rotation other than 0 and 180, an
        equinox other than 2000.
    """
    body = content(lines)
    numbers = np.array([number for number, _ in body])
    cells = [line.split() for _, line in body]
    same_width(path, numbers, cells, len(_COLUMNS), 'columns', f'{len(_COLUMNS)} are read')
    stamps = [_NAME.fullmatch(row[0]) for row in cells]
    if None in stamps:
        i = stamps.index(None)
        raise ValueError(f'{path}, row {numbers[i]}: {cells[i][0][:40]!r} does not begin with a '
                         'time stamp such as 20211103T044721')
    value = {name: floats(path, numbers, name, [row[_COLUMNS.index(name)] for row in cells])
             for name in _USED}
    for name, allowed, words in (('rotation', (0.0, 180.0), '0 or 180'),
                                 ('equinox', (2000.0,), '2000')):
        bad = ~np.isin(value[name], allowed)
        if bad.any():
            i = int(np.argmax(bad))
            raise ValueError(f'{path}, row {numbers[i]}, column {name}: {value[name][i]:g} is not '
                             f'{words}')
    times = ['{}-{}-{}T{}:{}:{}Z'.format(*match.groups()) for match in stamps]
    beyond = value['rotation'] == 180.0
    columns = {
        'ra_deg': value['solved ra'], 'dec_deg': value['solved dec'],
        'time': parse_iso(path, numbers, 'name', times),
        'lst_told': np.remainder(value['mount ha'] + value['mount ra'], 360.0),
        'az_enc': value['mount ha'], 'el_enc': value['mount dec'],
        'pier_side': np.where(beyond, -1, 1)}
    meta = {'format': 'unam', 'mount_told': 'german', 'sky_frame': ICRS, 'notes': [
        'places are the solved ones, readings hour angle and declination of the mount; rotation '
        '180 is the side through the pole; the moment is told by the sidereal time of the mount']}
    return Table(columns, numbers, [' '.join(row) for row in cells], meta,
                 commented=_commented(lines), names=KINDS['equatorial'])


def _commented(lines):
    """Numbers of the rows that were taken back by a # before them."""
    rows = ((number, line.lstrip().removeprefix('#').split())
            for number, line in enumerate(lines, 1) if line.lstrip().startswith('#'))
    return [number for number, row in rows
            if len(row) == len(_COLUMNS) and _NAME.fullmatch(row[0])]
