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

"""Pointing runs of RTS2, in the input format of its gpoint."""

import re

import numpy as np

from pointing_model.mount_kinds import KINDS
from pointing_model.mounts import ALTAZ

from ..columns.cell_values import YEAR_1900, YEAR_2100, WordRows, commented_rows, is_number
from ..columns.declarations import declarations, declare
from ..columns.run_table import NoObservations, RunFormat, RunTable, content

_SITE = re.compile(r'#\s*(observatory|gem|altaz|altaz-manual)\s+(\S+)\s+(\S+)\s+(\S+)\s*')
_TOP = 30  # the site is within this many lines
#: name or number, JD or MJD, sidereal time, mount's angles, counts of the axes, true angles
_NAMES = ('observation', 'JD', 'LST', 'RA-MNT', 'DEC-MNT', 'AXRA', 'AXDEC', 'RA-TRUE', 'DEC-TRUE')
_NAMES_ALTAZ = ('observation', 'JD', 'LST', 'AZ-MNT', 'ALT-MNT', 'AXAZ', 'AXALT', 'AZ-TRUE',
                'ALT-TRUE')
_DAY, _JD_1970, _MJD_1970 = 86400.0, 2440587.5, 40587.0
_JD = 2.4e6  # larger dates are JD, smaller ones MJD


def looks_like(lines):
    """Whether a comment at the top names the kind of mount and the site."""
    return any(_site(line) for line in lines[:_TOP])


def _site(line):
    found = _SITE.fullmatch(line.strip())
    return found if found and all(map(is_number, found.groups()[1:])) else None


def read(path, lines):
    """Read RTS2 gpoint input: a comment with mount and site, then rows of 9 columns.

    For a German mount (``# gem`` or ``# observatory``, longitude, latitude, height) a row has the
    right ascension and declination of the mount, as angles of its axes (declinations beyond 90
    degrees are through the pole), and those of the image centre from its WCS. For an alt-azimuth
    mount (``# altaz``) it has azimuth and altitude of both; RTS2 counts azimuth from south through
    west. Angles are in degrees. A comment ``# frame: of date`` declares the frame of the true
    places; without it they are taken as ICRS, which a fit then checks.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str

    Returns
    -------
    RunTable

    Raises
    ------
    ValueError
        The mount is ``altaz-manual`` (the sign of its offsets is not documented), there are two
        sites, most rows have another number of columns, or most cells of a column are not numbers
        or not dates from 1900 to 2100.
    """
    heads = [(number, found) for number, line in enumerate(lines, 1) for found in [_site(line)]
             if found]
    kind, *place = heads[0][1].groups()
    for number, found in heads[1:]:
        if found.groups() != heads[0][1].groups():
            raise ValueError(f'{path}, row {number}: another mount or site than in row '
                             f'{heads[0][0]}: a run is of one mount')
    if kind == 'altaz-manual':
        raise ValueError(f'{path}, row {heads[0][0]}: altaz-manual is not read: the sign of '
                         'its offsets is documented nowhere; give a CSV file')
    meta = {'format': 'gpoint', **declarations(path, lines)}
    for name, value in zip(('longitude_deg', 'latitude_deg', 'height_m'), place):
        declare(meta, name, value, f'{path}, row {heads[0][0]}')
    altaz = kind == 'altaz'
    names = _NAMES_ALTAZ if altaz else _NAMES
    body = content(lines)
    if not body:
        raise NoObservations(f'{path} has a header but no observations')
    rows = WordRows(path, body)
    rows.same_width(len(names), 'columns', f'{len(names)} are read')
    values = {name: rows.floats(name, rows.column(i)) for i, name in enumerate(names) if i}
    columns = {'star': np.array(rows.column(0)), 'time': _time(rows, values['JD'])}
    meta['notes'].append(f'{names[5]}, {names[6]} left out: counts of an unknown size')
    if altaz:
        for name, given in zip(('az', 'el', 'az_enc', 'el_enc'),
                               ('AZ-TRUE', 'ALT-TRUE', 'AZ-MNT', 'ALT-MNT')):
            columns[name] = values[given]
        columns['az'] = columns['az'] + 180.0
        columns['az_enc'] = columns['az_enc'] + 180.0
        columns['lst_h'] = values['LST'] / 15.0
        meta['notes'].append('azimuth turned by 180 degrees: RTS2 counts from south through west; '
                             'AZ-TRUE, ALT-TRUE are taken as observed')
    else:
        hour_angle = values['LST'] - values['RA-MNT']
        columns |= {
            'ra_deg': values['RA-TRUE'], 'dec_deg': values['DEC-TRUE'], 'lst_given': values['LST'],
            'az_enc': (hour_angle + 180.0) % 360.0 - 180.0,
            'el_enc': (values['DEC-MNT'] + 180.0) % 360.0 - 180.0}
        meta |= {'sidereal_clock': True, 'mount_declared': 'german'}
        meta['notes'].append('time: of the sidereal clock')

    def unsolved(words):
        """Whether a commented-out row is an image without a WCS, as RTS2 writes it."""
        return len(words) == len(names) and all(map(is_number, words[1:]))

    return RunTable(columns, rows.lines, meta, rows.reasons,
                    commented=commented_rows(lines, unsolved),
                    names=ALTAZ.names if altaz else KINDS['equatorial'])


def _time(rows, dates):
    seconds = (dates - np.where(dates > _JD, _JD_1970, _MJD_1970)) * _DAY
    bad = np.flatnonzero((seconds < YEAR_1900) | (seconds > YEAR_2100))
    rows.refuse('JD', rows.column(1), {
        int(i): 'is outside 1900 to 2100, as JD and as MJD' for i in bad})
    seconds[bad] = np.nan
    return seconds


FORMAT = RunFormat('input of gpoint', looks_like, read)
