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

"""Direction in which each axis moved to a row, from the order of the rows."""

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap

_TURN = 2.0 * np.pi
_GAP = 6 * 3600.0  # s: after a longer gap the direction is unknown
#: an axis that moved less stood still: the sign would be that of the pointing error itself
_STANDS = 60.0 * ARCSEC


def derive_approach(table):
    """Derive missing directions of approach from the order of the rows in time.

    If some row has no time, the order in the file is taken. Excluded rows count: the mount was
    there. The direction is unknown, 0, after a row without a place, in the first row of each run
    and after 6 hours without a row. If the axis moves by less than 1′, the row keeps the last
    direction.
    """
    columns, notes = table.columns, table.meta['notes']
    derived = []
    if len(table.lines) == 0:
        return
    order, by_time = _sequence(columns)
    new_run = _new_runs(columns, order)
    whole_path = False
    for axis in ('az', 'el'):
        name = f'approach_{axis}'
        given = np.isfinite(columns[name]) if name in columns else np.zeros(1, dtype=bool)
        if given.any():
            if not given.all():
                notes.append(f'{table.label(name)} is empty in {(~given).sum()} of '
                             f'{len(given)} rows: unknown there, 0')
            columns[name] = np.nan_to_num(columns[name], nan=0.0)
            continue
        angle = columns[f'{axis}_enc']
        angle = np.where(np.isfinite(angle), angle, np.nan)
        move = np.diff(angle[order], prepend=np.nan)
        if axis == 'az':
            whole_path = _reads_past_a_turn(table, angle)
            move = move if whole_path else wrap(move)
        move[np.abs(move) < _STANDS] = 0.0
        move[new_run] = np.nan
        columns[name] = np.empty(len(order))
        columns[name][order] = _carry(np.sign(move))
        derived.append(axis)
    if derived:
        table.meta['approach_from'] = {'axes': derived, 'order': 'time' if by_time else 'rows'}
        words = ' and '.join(table.names.word(axis) for axis in derived)
        notes.append(
            f'direction of approach in {words}: no column of the file, derived from the order '
            + ('in time, ' if by_time else 'of the rows, ')
            + (f'as the {table.names.word("az")} reads' if whole_path else 'shortest way'))


def _sequence(columns):
    """Rows in the order of observation, and whether this is the order in time."""
    time = columns.get('time')
    if time is None or not np.isfinite(time).all() or np.ptp(time) == 0.0:
        return np.arange(len(columns['az'])), False
    # the clock may restart in each run
    return np.lexsort((time, columns['run']) if 'run' in columns else (time,)), True


def _new_runs(columns, order):
    new = np.ones(len(order), dtype=bool)
    run = columns['run'][order] if 'run' in columns else np.zeros(len(order))
    new[1:] = run[1:] != run[:-1]
    if 'time' in columns:
        with np.errstate(invalid='ignore'):
            new[1:] |= np.diff(columns['time'][order]) > _GAP
    return new


def _reads_past_a_turn(table, reading):
    """Whether azimuth readings fit neither 0..360 nor -180..180, allowing for their zero."""
    sound = table.reasons == 0
    if not table.meta.get('raw_reading', True) or not sound.any():
        return False
    reading = reading[sound]
    reach = 5.0 * DEG + np.median(np.abs(wrap(reading - table.columns['az'][sound])))
    low, high = reading.min(), reading.max()
    return bool((low < -reach and high > np.pi + reach) or low < -np.pi - reach
                or high > _TURN + reach)


def _carry(sign):
    """Replace each 0 by the last value that is not 0, then NaN by 0."""
    own = np.flatnonzero(sign != 0.0)  # NaN too
    if own.size == 0:
        return np.zeros(len(sign))
    last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), 0))
    return np.nan_to_num(sign[last], nan=0.0)
