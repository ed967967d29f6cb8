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

"""Rows that a user excludes: by number, by range, or by a condition on a column."""

import operator
import re
from dataclasses import replace

import numpy as np

from msg_tools.iso_time import iso_seconds
from msg_tools.units import DEG, wrap

from ..mounts import sides
from .copies import without_rows
from .run import COLUMNS, column_name

_ROWS = re.compile(r'(\d+)(?:-(\d+))?$')
_CONDITION = re.compile(r'([A-Za-z_][\w.]*)\s*(<=|>=|!=|=|<|>)\s*(.+)$')
_COMPARED = {'<': operator.lt, '>': operator.gt, '<=': operator.le, '>=': operator.ge,
             '=': operator.eq, '!=': operator.ne}
#: reason given for them
REASON = 'excluded by --exclude'


def excluded_rows(run, text):
    """Rows selected by a text.

    Parameters
    ----------
    run : PointingRun
    text : str
        Comma-separated: row numbers as in messages and pages (``30``), ranges (``45-48``), and
        conditions on a column in the units of a file (``el<20``, ``magnitude>=9``,
        ``star=HIP 5447``, ``time>2026-01-15T21:00``; for an equatorial mount also ``ha<0``,
        ``dec>60``).

    Returns
    -------
    ndarray of bool, shape (n,)

    Raises
    ------
    ValueError
        There is no such row or column, or a condition is malformed.
    """
    out = np.zeros(len(run), bool)
    for part in _parts(text):
        numbers, condition = _ROWS.match(part), _CONDITION.match(part)
        if numbers:
            first, last = (int(one) for one in (numbers[1], numbers[2] or numbers[1]))
            rows = (run.lines >= first) & (run.lines <= last)
            if not rows.any():
                raise ValueError(f'--exclude {part}: no such row; rows in use go from '
                                 f'{run.lines.min()} to {run.lines.max()}')
        elif condition:
            rows = _where(run, *condition.groups())
        else:
            raise ValueError(f'--exclude {part}: write a row number, a range such as 45-48, or a '
                             'condition such as el<20')
        out |= rows
    return out


def _parts(text):
    return [part for part in map(str.strip, text.split(',')) if part]


def without_excluded(run, texts):
    """A run without the rows that texts select (`excluded_rows`); its ``meta`` lists them."""
    found = {part: excluded_rows(run, part) for text in texts for part in _parts(text)}
    rows = np.any([np.zeros(len(run), bool), *found.values()], axis=0)
    if rows.all():
        raise ValueError('--exclude leaves no row')
    none = [part for part, of in found.items() if not of.any()]
    if none:  # not an error: it may select rows of another run
        run = replace(run, meta={**run.meta, 'notes': [
            f'--exclude {", ".join(none)} matches no row', *run.meta.get('notes', ())]})
    return without_rows(run, rows, REASON) if rows.any() else run


def _where(run, name, sign, value):
    values, unit = _column(run, name)
    try:
        wanted = iso_seconds(value) if name == 'time' and '-' in value[1:] else float(value) * unit
    except ValueError:
        if sign not in ('=', '!='):
            raise ValueError(f'--exclude {name}{sign}{value}: {value} is no number') from None
        values, wanted = np.asarray(values).astype(str), value
    if unit == DEG and isinstance(wanted, float) and wanted >= np.pi:
        values = np.mod(values, 2.0 * np.pi)  # hour angles up to 360 degrees, as a file may have
    if values.dtype.kind not in 'fiub' and not isinstance(wanted, str):
        values, wanted = values.astype(str), value
    if isinstance(wanted, str):  # names as people write them
        values, wanted = np.char.lower(values), wanted.lower()
    return np.asarray(_COMPARED[sign](values, wanted), bool)


def _column(run, name):
    """Values and unit of a column, by its name in memory or in a file, with or without the unit.

    For mounts other than alt-azimuth ones, ``az`` and ``el`` are azimuth and elevation, and the
    mount's own angles are those on the sky, the same for both pier sides.
    """
    names = run.mount.names
    if not run.mount.vertical:
        place, bare = (run['az'], run['el']), name.removesuffix('_deg')
        if bare in ('az', 'el'):
            az, el = run.mount.horizon_of(*place)
            return (np.mod(az, 2.0 * np.pi) if bare == 'az' else el), DEG
        if bare in names.columns:
            first, second = sides(*place)[:2] if run.mount.two_sided else place
            return (wrap(first), second)[names.columns.index(bare)], DEG
    by_name = {}
    for own, (_, unit, _) in COLUMNS.items():
        if own in run.columns:
            written = column_name(own, names)
            by_name |= dict.fromkeys((own, written, written.removesuffix('_deg')), (own, unit))
    own, unit = by_name.get(name, (name, 1.0))
    if own not in run.columns:
        own = f'column_{name}'
    if own not in run.columns:
        raise ValueError(f'--exclude: no column {name}; the run has '
                         + ', '.join(sorted(column_name(one, names) for one in run.columns)))
    return run.columns[own], unit
