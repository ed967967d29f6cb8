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

"""Pier side of each row, from a column or from the readings."""

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import is_beyond, sides

_UNKNOWN = ('', 'nan', 'unknown', 'none', 'null', 'n/a', '?', '-')
#: largest fraction of rows that may violate a rule by the hour angle
_AGAINST = 0.1
_FEWEST = 3  # rows needed for a rule
#: this near the pole the zero of the second axis can put a reading beyond it; zeros are smaller
_NEAR = 10.0 * DEG
#: least mean resultant length of the differences of the first angles that have one common zero
_ALIKE = 0.9
#: this far past the meridian a counterweight is well above or below level; least fraction of rows
#: of each kind for a warning
_PAST_MERIDIAN, _EITHER = 30.0 * DEG, 0.2
_CLEAR = 0.5  # least |cosine| of the first axis's rotation that decides the side
_COUNTERWEIGHT = (
    'the readings have the counterweight up in every row. If it was down, hour angles count '
    'eastward: change their sign (else IH, CH, NP, MA get the wrong sign)')


def read_beyond(mount, place, reads, sound):
    """Which rows look through the pole, from the mount's readings.

    Near the pole the first axis decides: through the pole its reading is half a turn off. If that
    is unclear, the second axis decides, after subtracting its zero as found from the other rows. A
    mount that is not two-sided has such rows only if some of them are far from the pole.

    Parameters
    ----------
    mount : Mount
    place, reads : sequence of ndarray, shape (n,)
        Axis angles of the stars, and readings, radians.
    sound : ndarray of bool, shape (n,)
        Rows to test.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    with np.errstate(invalid='ignore', over='ignore'):
        high = is_beyond(reads[1]) & sound
        near = np.abs(np.cos(reads[1])) < np.sin(_NEAR)
        if not (near & sound).any():
            return high
        if not mount.two_sided and not (high & ~near).any():
            return np.zeros_like(high)
        first, second, _ = sides(*place[:2])
        away = np.exp(1j * (reads[0] - first))
        off = wrap(reads[1] - np.where(high, np.pi - second, second))
        far = sound & ~near & np.isfinite(off) & np.isfinite(away)
        zero, index, alike = 1.0, 0.0, True
        if far.any():
            zero, index = np.where(high, -away, away)[far].mean(), np.median(off[far])
            alike, index = np.abs(zero) > _ALIKE, index if np.abs(index) < _NEAR else 0.0
        turn = (away / zero).real
        by_first = alike & (np.abs(turn) > _CLEAR)
        return np.where(near & sound, np.where(by_first, turn < 0.0, is_beyond(reads[1] - index)),
                        high)


def through_the_pole(path, table, side, hour_angle):
    """Which rows look through the pole, from the column ``pier_side``.

    Through the pole are: ``west`` (ASCOM's ``pierWest``), -1 in a column of 1 and -1, and 1 in a
    column of 0 and 1. Blank cells are unknown, and so is -1 beside words or a 0 (ASCOM's numbers).
    A 1 without a 0 may be ASCOM's west too: it is taken so if the counterweight is then down in
    more rows. A row of unknown side gets its side from the hour angle if the others follow a rule.
    Otherwise it is excluded.

    Parameters
    ----------
    path : Path
        For messages.
    table : Table
        Gets notes, and reasons of excluded rows.
    side : ndarray, shape (n,)
        Cells: text or numbers.
    hour_angle : ndarray, shape (n,)
        Of the stars, radians, west positive.

    Returns
    -------
    ndarray of bool, shape (n,)

    Raises
    ------
    ValueError
        The column has other cells, or no row has a known side.
    """
    seen = (table.reasons == 0) & np.isfinite(hour_angle)
    values, note = sides_of(path, side.tolist(), hour_angle, seen)
    known = np.isfinite(values)
    table.meta['notes'] += note
    if not known.any():
        raise ValueError(f'{path}: pier_side is unknown in every row; leave the column out if no '
                         'row is through the pole')
    beyond, sound, east = values == 1.0, known & seen, wrap(hour_angle) < 0.0
    down = beyond == east  # the counterweight hangs below the tube
    far = np.abs(np.sin(hour_angle)) > np.sin(_PAST_MERIDIAN)
    up = sound & ~down & far
    if len(np.unique(values[sound])) == 1 and min(up.sum(), (sound & down & far).sum()) > (
            _EITHER * sound.sum()):
        table.meta['notes'].insert(0, (
            f'pier_side is {side[np.argmax(sound)]} in every row, on both sides of the meridian: '
            f'in {up.sum()} of {sound.sum()} rows the counterweight would be far above level. '
            'If the driver always writes this, leave the column out'))
    if not known.all():
        _place_unknown(table, known, sound, beyond, down, hour_angle)
    else:
        note_counterweight(
            table, beyond, hour_angle, 'pier_side has the counterweight up in every row. If it was '
            'down, the column is where the tube points: swap east and west (else ID, CH, NP get '
            'the wrong sign)')
    return beyond


def note_counterweight(table, beyond, hour_angle, text=_COUNTERWEIGHT):
    """Add a note if the counterweight is up in every row.

    Parameters
    ----------
    table : Table
        Gets the note.
    beyond : ndarray of bool, shape (n,)
        Rows through the pole.
    hour_angle : ndarray, shape (n,)
        Of the stars, radians.
    text : str
        The note; by default for sides from readings.
    """
    sound = (table.reasons == 0) & np.isfinite(hour_angle)
    with np.errstate(invalid='ignore'):
        down = beyond == (wrap(hour_angle) < 0.0)
    if sound.sum() >= _FEWEST and not down[sound].any():
        table.meta['notes'].append(text)


def sides_of(path, cells, hour_angle, sound):
    """Pier sides from the cells of their column.

    Parameters
    ----------
    path : Path
        For messages.
    cells : sequence, shape (n,)
        Text or numbers.
    hour_angle : ndarray, shape (n,)
        Of the stars, radians, west positive.
    sound : ndarray of bool, shape (n,)
        Rows used to decide what a 1 without a 0 means.

    Returns
    -------
    values : ndarray, shape (n,)
        1: through the pole, 0: not, NaN: unknown.
    notes : list of str

    Raises
    ------
    ValueError
        Cells other than those of `through_the_pole`.
    """
    cells = [str(v).strip().lower().removeprefix('pier').lstrip(' _') for v in cells]
    reads = _readings(set(cells))
    if not reads:
        others = sorted(set(cells) - {'east', 'west', 'e', 'w', *_UNKNOWN})
        raise ValueError(f'{path}: pier_side holds {", ".join(c[:20] for c in others[:4])}; give '
                         'east or west (west: through the pole), 1 or -1, or 0 or 1; unknown or '
                         'nothing where it is not known')
    east = wrap(hour_angle) < 0.0
    each = [np.array([read[cell] for cell in cells]) for read in reads]
    down = [np.sum((values == east) & sound) / max(np.sum(np.isfinite(values) & sound), 1)
            for values in each]
    if len(each) < 2 or not down[1] > down[0]:
        return each[0], []
    return each[1], [
        'pier_side has 1 and no 0: read as in ASCOM, 1 west (through the pole) and -1 '
        f'unknown. The counterweight is then down in {100.0 * down[1]:.0f} % of the rows, '
        f'with 1 as east in {100.0 * down[0]:.0f} %']


def _readings(cells):
    """Possible meanings of the cells, each a dict: 1.0 through the pole, 0.0 not, NaN unknown."""
    out = {cell: np.nan for cell in cells if cell in _UNKNOWN}
    rest = cells - set(out)
    words = {cell: float(cell[0] == 'w') for cell in rest if cell in ('east', 'west', 'e', 'w')}
    try:
        numbers = {cell: float(cell) for cell in rest - set(words)}
    except ValueError:
        return []
    there = set(numbers.values())
    if not there <= {-1.0, 0.0, 1.0} or (words and there - {-1.0}):
        return []
    by_sign = {cell: float(v < 0.0) for cell, v in numbers.items()}
    by_ascom = {cell: np.nan if v < 0.0 else v for cell, v in numbers.items()}
    ways = [by_ascom] if words or 0.0 in there else (
        [by_sign, by_ascom] if 1.0 in there else [by_sign])
    return [out | words | way for way in ways]


def _place_unknown(table, known, sound, beyond, down, hour_angle):
    """Set the side of rows where it is unknown by the rule of the others; changes `beyond`.

    If the counterweight is always down (or always up), the hour angle gives the side. It does not
    for stars as near the meridian as those that violate the rule.
    """
    up = not down[sound].mean() >= 0.5
    against = sound & (down == up)
    near = np.abs(wrap(hour_angle[against])).max(initial=0.0)
    rule = sound.sum() >= _FEWEST and against.sum() <= _AGAINST * sound.sum()
    with np.errstate(invalid='ignore'):
        placed = ~known & rule & (np.abs(wrap(hour_angle)) > near)
    beyond[placed] = (wrap(hour_angle[placed]) < 0.0) != up
    table.exclude(~known & ~placed, 'pier_side is unknown')
    if placed.any():
        table.meta['notes'].append(
            f'pier_side is unknown in {int((~known).sum())} of {len(known)} rows: '
            f'set by the hour angle in {int(placed.sum())}, as in the others')
