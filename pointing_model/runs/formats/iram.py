"""Pointing logs of the IRAM 30 m telescope, as its bolometer cameras wrote them."""

import re

import numpy as np

from .run_table import Table, cost_rows, floats, is_number, own_name, parse_iso, same_width

_ROW = re.compile(r'#?\s*(\d{4}-\d\d-\d\d)\.(\d+)\s', re.ASCII)
_NEEDED = ('id', 'UTh', 'AZd', 'ELd', 'pnt.X', 'pnt.Y')
_NAMES = {'AZd': 'az', 'ELd': 'el', 'pnt.X': 'x_arcsec', 'pnt.Y': 'y_arcsec',
          'Tamb': 'temperature'}
_USED = ('id', 'object', 'project', 'pnt.dAZ', 'pnt.dEL')


def looks_like_iram(lines):
    """Whether the first line names columns behind ``# id``."""
    first = next((line for line in lines if line.strip()), '')
    return re.match(r'#\s*id\s', first) is not None and 'pnt.' in first


def read_iram(path, lines):
    """IRAM 30 m ``.log``: a header ``# id ...`` names the columns, ``#`` before a row rejects it.

    AZd, ELd are the place (whole degrees, north 0, east 90), pnt.X, pnt.Y the total offset in
    arcsec on the sky: the correction that was applied plus the offset measured, pnt.dAZ,
    pnt.dEL. It has the sign of the observers' own models (``.model``), a correction added to the
    place to point there: encoder - catalogue.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str

    Returns
    -------
    Table
        Rejected rows and rows without an offset carry their reason.

    Raises
    ------
    ValueError
        A column is missing, most rows do not fit the header, or most cells of a column are none of
        its.
    """
    begin, head = next((i, line) for i, line in enumerate(lines) if line.strip())
    names = [re.sub(r'\(\w*\)$', '', word) for word in head.lstrip('#').split()]
    missing = [name for name in _NEEDED if name not in names]
    if missing:
        raise ValueError(f'{path}: no column {", ".join(missing)} in the header "# id ..."')
    rows = [(number, line) for number, line in enumerate(lines[begin + 1:], begin + 2)
            if line.strip() and (_ROW.match(line) or not line.lstrip().startswith('#'))]
    if not rows:
        raise ValueError(f'{path} has a header but no observations')
    numbers, reasons = np.array([number for number, _ in rows]), np.zeros(len(rows), dtype=object)
    cells = [line.lstrip('# ').split() for _, line in rows]
    strange = {i: 'does not begin with an id such as 2012-04-16.3'
               for i, (_, line) in enumerate(rows) if not _ROW.match(line)}
    cost_rows(path, numbers, 'id', [row[0] for row in cells], strange, reasons)
    same_width(path, numbers, cells, len(names), 'values',
               f'the header names {len(names)} columns', reasons)
    for i in strange:
        cells[i] = [''] * len(names)
    return _table(path, rows, dict(zip(names, zip(*cells))), numbers, reasons)


def _table(path, rows, cells, numbers, reasons):
    columns, text, renamed = {}, [], []
    for name, column in cells.items():
        column = ['' if set(cell) == {'-'} else cell for cell in column]
        if name in _USED:
            continue
        if name not in (*_NAMES, 'UTh') and not all(is_number(cell or 0) for cell in column):
            text.append(name)
            continue
        own = _NAMES.get(name) or own_name(name, cells, renamed)
        columns[own] = floats(path, numbers, name, column, reasons)
    days = [ident.split('.')[0] for ident in cells['id']]
    columns['time'] = parse_iso(path, numbers, 'id', days, reasons) + 3600.0 * columns['UTh']
    if 'object' in cells:
        columns['star'] = np.array(cells['object'])
    notes = ['x, y are pnt.X, pnt.Y: applied correction plus measured offset, added to the place '
             'to point there; pnt.dAZ, pnt.dEL left out, they are a part of it']
    if np.array_equal(columns['az'], np.rint(columns['az'])):
        notes.append('places are whole degrees')
    notes += renamed
    if text:
        notes.append(f'columns left out, they are not numeric: {", ".join(text)}')
    table = Table(columns, numbers, {'format': 'iram', 'notes': notes}, reasons)
    rejected = np.array([line.startswith('#') for _, line in rows])
    table.exclude(rejected, 'rejected by the observers (#)')
    for name, label in (('x_arcsec', 'pnt.X'), ('y_arcsec', 'pnt.Y')):
        table.exclude(np.isnan(columns[name]), f'{label} was not measured')
    return table
