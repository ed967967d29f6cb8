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

"""Read satellite tracks from CSV: each row has encoder readings or an observed place."""

from dataclasses import dataclass

import numpy as np

from pointing_model.mounts import ALTAZ

from .columns.cell_values import CLOCK, day_unit
from .columns.cells import Cells
from .columns.column_names import OTHER_NAMES
from .columns.declarations import declarations
from .columns.run_table import read_lines
from .run import column_name

#: columns that name the satellite of a row
_NAMES = ('satellite', 'object')
#: columns of the observed place, for files without encoder readings
_SEEN = (('az_deg', 'el_deg'), ('ra_deg', 'dec_deg'))


@dataclass
class TrackFile:
    """One track file: the n valid rows as numbers.

    Attributes
    ----------
    path : Path
    cells : dict of str to ndarray, shape (n,)
        ``time`` (s, UTC) and other columns, with the names of the file.
    names : ndarray of str, shape (n,)
        Satellite of each row, empty if none is named.
    site, weather : dict
        As declared in the file.
    mount : str or None
    keys : tuple of str
        Names of the reading columns for this mount.
    notes : list of str
    """

    path: object
    cells: dict
    names: np.ndarray
    site: dict
    weather: dict
    mount: str | None
    keys: tuple
    notes: list


def read_track(path, mount=None):
    """Read a track file.

    Parameters
    ----------
    path : Path
    mount : str, optional
        By default as declared in the file.

    Returns
    -------
    TrackFile

    Raises
    ------
    ValueError
        One line: there is no header or no valid row, a column is missing, or times are not UTC.
    OSError
        The file cannot be read.
    """
    lines = read_lines(path)
    table, declared = Cells(path, lines), declarations(path, lines, header=True)
    header = set(table.header)
    kind = next((names for names, _ in OTHER_NAMES
                 if f'{names.columns[0]}_enc_deg' in header), ALTAZ.names)
    keys = tuple(column_name(axis, kind) for axis in ('az_enc', 'el_enc'))
    seen = next((pair for pair in _SEEN if set(pair) <= header), None)
    if 'time' not in header or not (set(keys) <= header or seen):
        raise ValueError(
            f'{path}: a track needs time and {", ".join(keys)} (or where the satellite was seen: '
            f'az_deg, el_deg, or ra_deg, dec_deg); there are {", ".join(table.header[:20])}')
    read = {'time': table.times('time', table['time'])}
    _check_clock(table, read['time'])
    wanted = [*(keys if set(keys) <= header else seen), 'miss_x_arcsec', 'miss_y_arcsec',
              'temperature_c', 'pressure_hpa', 'run']
    for column in wanted:
        if column in header:
            read[column] = table.floats(column, table[column])
    column = next((one for one in _NAMES if one in header), None)
    names = np.array(table[column] if column else [''] * len(table), dtype=object)
    good = (table.reasons == 0) & np.all(
        [np.isfinite(read[one]) for one in ('time', *wanted[:2])], axis=0)
    notes = list(declared['notes'])
    if 'pier_side' in header:
        read['pier_side'] = np.array(table['pier_side'], dtype=object)
    if not good.any():
        raise ValueError(f'{path}: no row has {", ".join(("time", *wanted[:2]))}')
    if not good.all():
        first = table.lines[np.flatnonzero(~good)[0]]
        notes.append(f'{path}: {int((~good).sum())} rows excluded, the first in line {first}')
    return TrackFile(path, {one: value[good] for one, value in read.items()}, names[good],
                 declared.get('site') or {}, declared.get('weather') or {},
                 mount or declared.get('mount_declared'),
                 keys, notes)


def _check_clock(table, time):
    """Refuse times that do not count from 1970: an orbit needs UTC."""
    known = time[np.isfinite(time)]
    if not len(known) or np.median(known) >= CLOCK:
        return
    unit = day_unit(known.min())
    asked = f'is this {unit}?' if unit else 'they count from an arbitrary start.'
    raise ValueError(f'{table.path}, column time: {known.min():.10g} to {known.max():.10g} are no '
                     f'seconds since 1970: {asked} Give seconds since 1970 (UTC) or ISO 8601')
