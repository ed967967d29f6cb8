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

"""Duplicate observations: in one file, in several files, or in a log and the file of its night.

Two rows are one observation if time and readings agree to the digits of the less precise one. If
either has no time, places and readings must agree. For rows of two files it is enough that UTC and
places agree, since readings in a log have their zeros subtracted. Rows of one star seconds apart
differ in time. If an image was solved twice, the solution of smaller sigma is kept.
"""

import numpy as np

from msg_tools.units import DEG, wrap

#: beginning of the reason for excluding a copy
SAME = 'the same as '
#: what angles (degrees; arcseconds; seconds of time) and times (s) may be rounded to, coarse first
_ANGLES = sorted([*(10.0**-k for k in range(3, 10)), *(10.0**-k / 3600.0 for k in range(4)),
                  *(15.0 * 10.0**-k / 3600.0 for k in range(1, 4))], reverse=True)
_TIMES = (1.0, 0.1, 0.01, 1e-3, 4e-6)
_MINUTE = 60.0
_CLOCK = 1e8  # s: smaller times count from an arbitrary start
_ANGLE_ERROR, _TIME_ERROR = 1e-11, 5e-7  # deg, s: rounding of numbers in memory
_SAME_FIELD = 0.1  # deg: places of one observation differ by less, whatever the refraction
#: largest differences of two solutions of one image: time (s), readings (deg)
_TWIN_TIME, _TWIN_READING = 1e-3, 0.02 / 3600.0
_LARGEST = 1e12  # larger numbers in a file count as unknown
_SIDEREAL = 239.3447  # s of UT per degree of sidereal time
_BESIDE = 64  # each row is compared with this many neighbours in the order of their readings


def copies(columns, source=None):
    """For each row, the row that it is a copy of.

    Parameters
    ----------
    columns : mapping of str to ndarray, shape (n,)
        ``az, el, az_enc, el_enc`` (rad); ``time`` (s), NaN where unknown, may be absent.
    source : ndarray of int, shape (n,), optional
        Number of the file of each row.

    Returns
    -------
    ndarray of int, shape (n,)
        Index of the first row of this observation; -1 if the row itself is the first.
    """
    reading = np.array([columns['az_enc'], columns['el_enc']], float) / DEG
    place = np.array([columns['az'], columns['el']], float) / DEG
    n = place.shape[1]
    time = np.asarray(columns.get('time', np.full(n, np.nan)), float)
    one_file = source is None
    source = np.zeros(n, int) if one_file else source
    units = [_unit(reading, _ANGLES, _ANGLE_ERROR, source, 0.15),
             _unit(place, _ANGLES, _ANGLE_ERROR, source, 0.15), _time_unit(time, source)]
    out = np.arange(n)
    for i, j in _beside(reading, place, units[0]):
        reading_limit, place_limit, time_limit = (_within(unit, i, j) for unit in units)
        timed = np.isfinite(time[i]) & np.isfinite(time[j])
        same = (_distance(reading, i, j) < reading_limit) & np.where(
            timed, (np.abs(time[i] - time[j]) < time_limit)
            & (_distance(place, i, j) < _SAME_FIELD), _distance(place, i, j) < place_limit)
        np.minimum.at(out, j[same], i[same])
    if not one_file:
        utc = np.where(np.abs(time) > _CLOCK, time, np.nan)
        for i, j in _beside(place, reading, units[1]):
            same = (source[i] != source[j]) & (np.abs(utc[i] - utc[j]) < _within(units[2], i, j)) \
                & (_distance(place, i, j) < _within(units[1], i, j))
            np.minimum.at(out, j[same], i[same])
    while (out[out] != out).any():  # a copy of a copy is a copy of the first
        out = out[out]
    return np.where(out < np.arange(n), out, -1)


def _beside(angles, others, unit):
    """Pairs of rows, the earlier first, that are neighbours in two angles (degrees)."""
    # neighbours in both angles are neighbours in this, across north too
    along = angles[1] + np.degrees(np.e * np.cos(np.radians(angles[0]) - 1.0))
    rows = np.flatnonzero(np.isfinite(along) & np.isfinite(others).all(axis=0))
    order = rows[np.argsort(along[rows], kind='stable')]
    reach = 4.0 * unit[rows].max(initial=0.0)
    for k in range(1, min(_BESIDE, len(order))):
        near = along[order[k:]] - along[order[:-k]] < reach
        if not near.any():
            return
        i, j = order[:-k][near], order[k:][near]
        yield np.minimum(i, j), np.maximum(i, j)


def _within(unit, i, j):
    """Largest difference: half the rounding unit if both rows have the same, else one unit."""
    return np.where(unit[i] == unit[j], 0.5, 1.0 + 1e-3) * np.maximum(unit[i], unit[j])


def _distance(angles, i, j):
    first = wrap((angles[0, i] - angles[0, j]) * DEG) / DEG
    return np.maximum(np.abs(first), np.abs(angles[1, i] - angles[1, j]))


def _unit(values, units, error, source, chance):
    """Rounding unit of each row: the coarsest of `units` that divides all of its values.

    Last digits may be zero by chance. So only units that more than `chance` of a file's rows have
    are used; other rows get the next finer one.
    """
    level = np.full(values.shape[1], len(units) - 1)
    for k in reversed(range(len(units))):
        level[_divides(units[k], values, error).all(axis=0)] = k
    for one in np.unique(source):
        rows = source == one
        counts = np.bincount(level[rows], minlength=len(units))
        usual = np.append(np.flatnonzero(counts > chance * counts.sum()), len(units) - 1)
        level[rows] = usual[np.searchsorted(usual, level[rows])]
    return np.array(units)[level]


def _time_unit(time, source):
    out = _unit(time[np.newaxis], _TIMES, _TIME_ERROR, source, 0.2)
    for one in np.unique(source):
        rows = source == one
        if np.isfinite(time[rows]).sum() > 2 and _divides(_MINUTE, time[rows], _TIME_ERROR).all():
            out[rows] = _MINUTE
    return out


def _divides(unit, values, error):
    return np.abs(values - unit * np.rint(values / unit)) < error


def flag_solved_twice(table):
    """Exclude the less certain of two solutions of one image (same time, same readings)."""
    columns = table.columns
    if 'ra_deg' not in columns or not {'time', 'az_enc', 'el_enc'} <= set(columns):
        return
    time = columns['time']
    if 'lst_given' in columns:  # the time is only that of the day then
        time = columns['lst_given'] * _SIDEREAL
    known = np.abs([time, columns['az_enc'], columns['el_enc']]) < _LARGEST
    rows = np.flatnonzero((table.reasons == 0) & known.all(axis=0))
    order = rows[np.argsort(time[rows], kind='stable')]
    # only rows with a neighbour in time are looked at one by one
    beside = np.diff(time[order], prepend=-np.inf, append=np.inf) <= _TWIN_TIME
    order = order[beside[:-1] | beside[1:]]
    sigma = columns.get('sigma_x', np.zeros(len(time)))
    kept = order[:1]
    moved = 0
    for row in order[1:]:
        near = [k for k in kept[-8:] if time[row] - time[k] <= _TWIN_TIME]
        moves = [max(abs((columns['az_enc'][row] - columns['az_enc'][k] + 180.0) % 360.0 - 180.0),
                     abs(columns['el_enc'][row] - columns['el_enc'][k])) for k in near]
        twin = next((k for k, far in zip(near, moves) if far <= _TWIN_READING), None)
        moved += bool(near) and twin is None
        if twin is None:
            kept = np.append(kept[-8:], row)
            continue
        worse, better = (row, twin) if sigma[row] >= sigma[twin] else (twin, row)
        table.exclude_row(worse, f'a second solution of the image of row {table.lines[better]}')
        if worse == twin:
            kept = np.append(kept[kept != twin], row)
    if moved:
        table.meta['notes'].append(f'{moved} rows have the time of another row but other encoder '
                                   'readings: one of the two times is wrong')


def without_copies(runs, seen=()):
    """Runs without observations that an earlier run has.

    Parameters
    ----------
    runs : iterable of PointingRun
        Of one mount.
    seen : sequence of PointingRun
        Earlier runs: their observations are removed from `runs` too.

    Returns
    -------
    runs : list of PointingRun
        Without copies; runs that have only copies are left out.
    notes : list of str
        How many rows were removed, and which file they are in.

    Raises
    ------
    ValueError
        All observations are copies of those in `seen`.
    """
    runs = list(runs)
    every = [*seen, *runs]
    if len(every) < 2:
        return runs, []
    source = np.repeat(np.arange(len(every)), [len(run) for run in every])
    columns = {name: np.concatenate([run[name] for run in every])
               for name in ('az', 'el', 'az_enc', 'el_enc')}
    columns['time'] = np.concatenate([np.asarray(run.get('time'), float) for run in every])
    first = copies(columns, source)
    kept, notes = [], []
    for number, run in enumerate(every):
        if number < len(seen):
            continue
        original = first[source == number]
        copied = original >= 0
        if not copied.any():
            kept.append(run)
            continue
        others = dict.fromkeys(_name(every[i]) for i in np.unique(source[original[copied]]))
        where = f'in {", ".join(list(others)[:3])}'
        if copied.all():
            notes.append(f'{_name(run)} left out: all {len(run)} rows are also {where}')
            continue
        notes.append(f'{_name(run)}: {int(copied.sum())} of {len(run)} rows excluded: they are '
                     f'also {where}')
        kept.append(without_rows(run, copied, f'{SAME}a row {where}'))
    if runs and not kept:
        raise ValueError(f'{"; ".join(notes)}; give other observations to validate with')
    return kept, notes


def written_twice(copied):
    """Note on duplicate rows; `copied` is their mask."""
    return (f'{int(copied.sum())} of {len(copied)} rows are duplicates, with the same time and '
            'readings: each counts once')


def without_rows(run, rows, reason):
    """A run without `rows` (a mask); they are added to ``meta['excluded']`` with the reason."""
    return run.part(~rows, excluded=sorted(
        [*run.meta.get('excluded', ()),
         *({'row': int(line), 'reason': reason} for line in run.lines[rows])],
        key=lambda one: one['row']))


def _name(run):
    return str(run.meta.get('source', 'a run'))
