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

"""Pointing logs of the IRAM 30 m telescope, as its bolometer cameras wrote them."""

import re

import numpy as np

from ..columns.cell_values import WordRows, is_number
from ..columns.run_table import RunFormat, RunTable, own_name

_ROW = re.compile(r'#?\s*(\d{4}-\d\d-\d\d)\.(\d+)\s', re.ASCII)
_NEEDED = ('id', 'UTh', 'AZd', 'ELd', 'pnt.X', 'pnt.Y')
_NAMES = {'AZd': 'az', 'ELd': 'el', 'pnt.X': 'x_arcsec', 'pnt.Y': 'y_arcsec',
          'Tamb': 'temperature'}
_USED = ('id', 'object', 'project', 'pnt.dAZ', 'pnt.dEL')


def looks_like(lines):
    """Whether the first line names columns after ``# id``."""
    first = next((line for line in lines if line.strip()), '')
    return re.match(r'#\s*id\s', first) is not None and 'pnt.' in first


def read(path, lines):
    """Read an IRAM 30 m ``.log``: a header ``# id ...``, then rows; ``#`` marks rejected rows.

    AZd, ELd are the place (whole degrees, north 0, east 90). pnt.X, pnt.Y are the total offset in
    arcsec on the sky: the applied correction plus the measured offset pnt.dAZ, pnt.dEL. The sign
    is that of the observers' models (``.model``), a correction added to the place: encoder -
    catalogue.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str

    Returns
    -------
    RunTable
        Rejected rows and rows without an offset are excluded with a reason.

    Raises
    ------
    ValueError
        A column is missing, most rows do not fit the header, or most cells of a column are bad.
    """
    begin, head = next((i, line) for i, line in enumerate(lines) if line.strip())
    names = [re.sub(r'\(\w*\)$', '', word) for word in head.lstrip('#').split()]
    missing = [name for name in _NEEDED if name not in names]
    if missing:
        raise ValueError(f'{path}: no column {", ".join(missing)} in the header "# id ..."')
    body = [(number, line) for number, line in enumerate(lines[begin + 1:], begin + 2)
            if line.strip() and (_ROW.match(line) or not line.lstrip().startswith('#'))]
    if not body:
        raise ValueError(f'{path} has a header but no observations')
    rows = WordRows(path, body)
    strange = {i: 'does not begin with an id such as 2012-04-16.3'
               for i, (_, line) in enumerate(body) if not _ROW.match(line)}
    rows.refuse('id', rows.column(0), strange)
    rows.same_width(len(names), 'values', f'the header names {len(names)} columns')
    for i in strange:
        rows.cells[i] = [''] * len(names)
    table = _table(rows, dict(zip(names, zip(*rows.cells))))
    table.exclude(rows.commented, 'rejected by the observers (#)')
    for name, label in (('x_arcsec', 'pnt.X'), ('y_arcsec', 'pnt.Y')):
        table.exclude(np.isnan(table.columns[name]), f'{label} was not measured')
    return table


def _table(rows, cells):
    columns, text, renamed = {}, [], []
    for name, column in cells.items():
        column = ['' if set(cell) == {'-'} else cell for cell in column]
        if name in _USED:
            continue
        if name not in (*_NAMES, 'UTh') and not all(is_number(cell or 0) for cell in column):
            text.append(name)
            continue
        own = _NAMES.get(name) or own_name(name, cells, renamed)
        columns[own] = rows.floats(name, column)
    days = [ident.split('.')[0] for ident in cells['id']]
    columns['time'] = rows.iso_times('id', days) + 3600.0 * columns['UTh']
    if 'object' in cells:
        columns['star'] = np.array(cells['object'])
    notes = ['x, y are pnt.X, pnt.Y: applied correction plus measured offset, added to the '
             'place. pnt.dAZ, pnt.dEL are a part of it and left out']
    if np.array_equal(columns['az'], np.rint(columns['az'])):
        notes.append('places are whole degrees')
    notes += renamed
    if text:
        notes.append(f'columns left out, they are not numeric: {", ".join(text)}')
    return RunTable(columns, rows.lines, {'format': 'iram', 'notes': notes}, rows.reasons)


FORMAT = RunFormat('an IRAM log (# id ...)', looks_like, read, (
    'the pointing offsets of the log were taken as encoder minus catalogue'))
