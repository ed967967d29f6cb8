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

"""Pointing runs of the telescope control system of the UNAM: COATLI, DDOTI, RATIR."""

import re

import numpy as np

from pointing_model.mount_kinds import KINDS
from pointing_model.runs.plate_solves.frames import ICRS

from ..columns.cell_values import WordRows, commented_rows, is_number, usual_width
from ..columns.run_table import RunFormat, RunTable, content

#: name of an image with a time stamp, to the second or finer
_NAME = re.compile(r'\S*?(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d(?:\.\d+)?)\S*')
_COLUMNS = ('name', 'requested ra', 'requested dec', 'observed ra', 'observed dec', 'mount ha',
            'mount ra', 'mount dec', 'rotation', 'solved ra', 'solved dec', 'equinox')
_WIDTHS = (len(_COLUMNS), len(_COLUMNS) - 1)  # some logs have no equinox


def looks_like(lines):
    """Whether the first row is a name with a time stamp, then the right count of numbers."""
    return _is_row(next((line for _, line in content(lines)), '').split())


def _is_row(cells):
    return (len(cells) in _WIDTHS and _NAME.fullmatch(cells[0]) is not None
            and all(map(is_number, cells[1:])))


def read(path, lines):
    """Read solved images with the angles and the pier side of a German mount.

    The place is the solution (J2000); the readings are hour angle and declination of the mount.
    Rotation 180 means through the pole. The time stamp in the name may have whole seconds only, so
    the time is taken from the sidereal time: hour angle plus right ascension of the mount.

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
        Most rows have another length, or most cells of a column are bad.
    """
    body = content(lines)
    rows, names = WordRows(path, body), _COLUMNS[:usual_width(body)]
    rows.same_width(len(names), 'columns', f'{len(names)} in most rows')
    images = rows.column(0)
    stamps = [_NAME.fullmatch(image) for image in images]
    rows.refuse('name', images, {
        i: 'does not hold a time stamp such as 20211103T044721'
        for i, (stamp, image) in enumerate(zip(stamps, images)) if not stamp and image})
    value = {name: rows.floats(name, rows.column(i)) for i, name in enumerate(names) if i >= 5}
    times = ['{}-{}-{}T{}:{}:{}Z'.format(*match.groups()) if match else '' for match in stamps]
    columns = {
        'ra_deg': value['solved ra'], 'dec_deg': value['solved dec'],
        'time': rows.iso_times('name', times),
        'lst_given': np.remainder(value['mount ha'] + value['mount ra'], 360.0),
        'az_enc': value['mount ha'], 'el_enc': value['mount dec'],
        'pier_side': np.where(value['rotation'] == 180.0, 'west', 'east')}
    meta = {'format': 'unam', 'mount_declared': 'german', 'sky_frame': ICRS, 'notes': [
        'places are the solved ones, readings hour angle and declination of the mount. Rotation '
        '180 is the side through the pole; the time is from the sidereal time of the mount']}
    if 'equinox' not in value:
        meta['notes'].append('the log has no column of the equinox: solved places taken as J2000')
    table = RunTable(columns, rows.lines, meta, rows.reasons,
                     commented=commented_rows(lines, _is_row), names=KINDS['equatorial'])
    for name, allowed, words in (('rotation', (0.0, 180.0), '0 or 180'),
                                 ('equinox', (2000.0,), '2000')):
        for i in np.flatnonzero(~np.isin(value.get(name, allowed[0]), allowed)):
            table.exclude_row(i, f'{name}: {value[name][i]:g} is not {words}')
    return table


FORMAT = RunFormat('a log of the UNAM control system', looks_like, read)
