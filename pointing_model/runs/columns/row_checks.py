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

"""Checks that exclude bad rows: radians, missing numbers, impossible elevations, copies."""

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import ALTAZ, unit_vector
from pointing_model.runs.copies import SAME, copies, written_twice
from pointing_model.runs.run import COLUMNS, REQUIRED, PointingRun
from pointing_model.sky.refraction import AIR

from .column_names import is_cause
from .run_table import SPECIAL

#: degrees: rows with observed elevations outside are excluded (90.1: a star past the zenith)
ELEVATION_LIMITS = (-5.0, 90.1)
_SIGMAS = {'sigma_x', 'sigma_y'}
PAIRS = (('az', 'el'), ('az_enc', 'el_enc'), ('az_abs', 'el_abs'))
_TURNS = 10  # a larger number is not an angle in degrees
_TURN = 2.0 * np.pi
_QUARTER = ELEVATION_LIMITS[1] * DEG
_AIR = {'temperature': AIR['temperature_c'], 'pressure': AIR['pressure_hpa']}
_KELVIN = (230.0, 330.0)
_MEASURED = 5  # smallest number of values in a column of measurements
_NEARBY = 3600.0  # s: within this time the air hardly changes
_WRITTEN = 20_000  # rows kept as the file has them
_NAMED = 5  # for up to this many rows that have copies, each copy is listed with its line
_LARGEST = 1e50  # squares and their sums stay finite
#: deg/s from star to star, including the exposure: no mount is faster than the first; a unit of
#: time is suggested if it brings the speed below the second
_FASTEST, _USUAL = 10.0, 3.0
_FAR, _MOVES = 5.0 * DEG, 5  # smallest move that counts, and number of such moves needed
_CLOCKS = ('minutes', 60.0), ('hours', 3600.0)
#: beginnings and ends of the reasons for excluding a row because of its place
_NO_PLACE = ('elevation outside', 'all angles below'), (f'beyond {_TURNS} turns',)


class Caution(str):
    """A note that is reported first: it bears on all rows."""

    caution = True


class NoUsableRow(ValueError):
    """Every row of a file is excluded.

    Parameters
    ----------
    text : str
    run : PointingRun, optional
        Without rows; ``meta['as_written']`` has the excluded places.
    """

    def __init__(self, text, run=None):
        super().__init__(text)
        self.run = run


def refuse_radians(path, table):
    """Refuse columns of angles that look like radians; exclude single rows that do.

    Raises
    ------
    ValueError
        A pair of columns or the elevations stay within the range of radians, or azimuths do and
        the readings confirm it, see `_azimuth_in_radians`.
    """
    columns, small = table.columns, []
    sound, altazimuth = table.reasons == 0, table.names is ALTAZ.names
    for pair in PAIRS:
        if not set(pair) <= set(columns):
            continue
        az, el = (columns[name] for name in pair)
        used = sound & np.isfinite(az) & np.isfinite(el)
        if not used.any() or _are_offsets(columns, pair, used):
            continue
        both = np.maximum(np.abs(az), np.abs(el))
        highest = np.abs(el[used]).max()
        if both[used].max() <= _TURN and highest <= _QUARTER:
            _radians(path, table, pair, both[used].max())
        if not altazimuth:
            continue  # hour angles and declinations near zero are the middle of the sky
        if used.sum() >= 3 and highest <= _QUARTER and np.ptp(el[used]) > 0.05:
            _radians(path, table, pair[1:], highest)
        if (used.sum() >= 8 and np.ptp(az[used]) > 4.0 and az[used].min() >= 0.0
                and az[used].max() <= _TURN and np.ptp(el[used]) > 15.0):
            if _azimuth_in_radians(columns, pair, used):
                _radians(path, table, pair[:1], az[used].max())
            table.meta['notes'].append(f'{table.label(pair[0])} never exceeds '
                                       f'{az[used].max():.3g}: taken as degrees')
        small.append(used & (both <= _TURN) & (np.abs(el) <= _QUARTER))
    if small:
        table.exclude(np.all(small, axis=0), 'all angles below 2 pi: they look like radians')


def _are_offsets(columns, pair, used):
    """Whether a pair of reading columns holds small offsets and not radians.

    Radians would vary with the elevation of the catalogue places; offsets do not.
    """
    if pair == PAIRS[0] or not set(PAIRS[0]) <= set(columns):
        return False
    place, reading = columns['el'][used], columns[pair[1]][used]
    known = np.isfinite(place)
    if not known.any():
        return False
    place, reading = place[known], reading[known]
    if not np.abs(reading).max() <= _QUARTER < np.abs(place).max() < 360.0:
        return False

    def scatter(v):
        return np.median(np.abs(v - np.median(v)))
    with np.errstate(over='ignore', invalid='ignore'):  # a damaged file may hold any number
        return bool(scatter(reading / DEG - place) > 0.3 * scatter(place))


def _azimuth_in_radians(columns, pair, used):
    """Whether the scatter of the azimuth offsets shows that the azimuths are in radians.

    In degrees it is similar to the scatter of the elevation offsets. If both azimuth columns are in
    radians it is 57 times smaller; if only one is, it is as large as the sky.
    """
    other = PAIRS[1] if pair == PAIRS[0] else PAIRS[0]
    if pair == PAIRS[0] and not set(other) <= set(columns):
        other = PAIRS[2]
    if not set(other) <= set(columns):
        return False
    away = [columns[b][used] - columns[a][used] for a, b in zip(pair, other)]
    away[0] = wrap(away[0] * DEG) / DEG
    both = np.isfinite(away).all(axis=0)
    if not both.any():
        return False
    az, el = (np.median(np.abs(v[both] - np.median(v[both]))) for v in away)
    return bool(az > 20.0 or az <= el * np.sqrt(DEG))


def _radians(path, table, pair, largest):
    names = ', '.join(map(table.label, pair))
    raise ValueError(f'{path}: {names} never exceed {largest:.3g}: they look like radians; give '
                     'degrees')


def to_si(columns):
    """Convert columns from the units of the file to SI (`COLUMNS`), in place."""
    for name, values in columns.items():
        unit = COLUMNS[name][1] if name in COLUMNS else SPECIAL.get(name, 1.0)
        if unit != 1.0:
            columns[name] = values * unit


def note_hasty_clock(table):
    """Add a note if the mount would move faster than any mount: the times have another unit."""
    time = table.columns.get('time')
    if time is None:
        return
    place = unit_vector(table.columns['az'], table.columns['el'])
    rows = np.flatnonzero((table.reasons == 0) & np.isfinite(time) & np.isfinite(place).all(axis=0))
    run = table.columns.get('run', np.zeros(len(time)))  # the clock may restart in each run
    rows = rows[np.lexsort((time[rows], run[rows]))]
    seconds, chord = np.diff(time[rows]), np.diff(place[:, rows])
    moved = 2.0 * np.arcsin(np.minimum(np.sqrt(np.square(chord).sum(axis=0)) / 2.0, 1.0))
    far = (run[rows][1:] == run[rows][:-1]) & (seconds > 0.0) & (moved > _FAR)
    speed = moved[far] / seconds[far] / DEG
    if len(speed) >= _MOVES and np.median(speed) > _FASTEST:
        unit = next((name for name, size in _CLOCKS if np.median(speed) / size < _USUAL), 'days')
        table.meta['notes'].append(Caution(
            f'time: the mount would slew at {np.median(speed):.3g} deg/s from star to star; '
            f'seconds are expected: is this {unit}?'))


#: reason for excluding a row that is only a temperature record
LOG_OF_AIR = 'a temperature record without a star'


def flag_numbers(table):
    """Exclude rows with a required number missing, an infinite number or an impossible angle."""
    _take_log(table)
    needed = set(REQUIRED) | set(SPECIAL)
    if 'ra_deg' in table.columns or ('ra_enc_deg' in table.columns
                                     and 'lst_h' not in table.columns):
        needed.add('time')
    for name, values in table.columns.items():
        if values.dtype.kind != 'f':
            continue
        if name in needed:
            table.exclude(np.isnan(values), f'{table.label(name)} is not a number')
        table.exclude(np.isinf(values), f'{table.label(name)} is infinite')
        if name in _SIGMAS:
            table.exclude(~(values > 0.0), f'{table.label(name)} is not positive')
        if name in sum(PAIRS, ()) or name in ('ra_deg', 'dec_deg', 'ra_enc_deg'):
            with np.errstate(invalid='ignore'):
                table.exclude(np.abs(values) > _TURNS * _TURN,
                              f'{table.label(name)} is beyond {_TURNS} turns')


def _take_log(table):
    """Move rows with time and temperature but no angles to ``meta['temperature_log']``."""
    columns = table.columns
    angles = [columns[name] for name in sum(PAIRS, ()) if name in columns]
    if 'temperature' not in columns or 'time' not in columns or not angles:
        return
    both = [np.asarray(columns[name], float) for name in ('time', 'temperature')]
    rows = np.isfinite(both).all(axis=0) & np.isnan(angles).all(axis=0) & (table.reasons == 0)
    if rows.any():
        table.exclude(rows, LOG_OF_AIR)
        table.meta['temperature_log'] = [values[rows].tolist() for values in both]


def blank_absurd(table):
    """Treat numbers that cannot have been measured as missing; notes give their number.

    If the number is required, its row is excluded.
    """
    for name, values in list(table.columns.items()):
        if values.dtype.kind != 'f' or name in (*REQUIRED, 'time', 'run', 'star', 'block'):
            continue
        low, high, unit = -_LARGEST, _LARGEST, ''
        if name in _AIR:  # a pressure of 0 was not measured
            unit, low, high = _AIR[name].unit, _AIR[name].low or 1.0, _AIR[name].high
        absurd = (table.reasons == 0) & np.isfinite(values) & ((values < low) | (values > high))
        text = f'{table.label(name)} is outside {low:g} to {high:g} {unit}'.strip()
        if not absurd.any() and (name in _AIR or name not in (*COLUMNS, *SPECIAL)):
            absurd, text = fill_rows(
                table.label(name), np.where(table.reasons == 0, values, np.nan))
        if not absurd.any():
            continue
        if name in SPECIAL or name in _SIGMAS:
            table.exclude(absurd, text)
            continue
        i = int(np.argmax(absurd))
        where = f'first in row {table.lines[i]} ({values[i]:g})'
        if absurd[(table.reasons == 0) & np.isfinite(values)].all():
            kelvin = name == 'temperature' and (
                (values[absurd] > _KELVIN[0]) & (values[absurd] < _KELVIN[1])).all()
            table.meta['notes'].append(Caution(
                f'{text} in all rows, {where}'
                f'{", and looks like kelvin (subtract 273.15)" if kelvin else ""}: '
                'the whole column is treated as missing'))
            del table.columns[name]
            continue
        table.columns[name] = np.where(absurd, np.nan, values)
        table.meta['notes'].append(f'{text} in {absurd.sum()} of {len(values)} rows, {where}: '
                                   'treated as missing')


def fill_rows(label, values):
    """Rows with a fill value, and a text that describes it.

    A fill value is all nines (-99, 999.9), and farther from the other values than their range, or
    negative in all rows.
    """
    there = np.unique(values[np.isfinite(values)])
    for fill in (*there[:1], *there[-1:]):
        others, digits = there[there != fill], f'{abs(fill):g}'.replace('.', '')
        if digits.startswith('99') and not digits.strip('9') and (
                np.abs(fill - others).min() > np.ptp(others) if len(others) else fill < 0.0):
            more = f' (the others {others[0]:.3g} to {others[-1]:.3g})' if len(others) else ''
            return values == fill, f'{label} is {fill:g}{more}'
    return np.zeros(len(values), bool), ''


def bridge_gaps(table):
    """Interpolate missing air values and causes from values measured nearby in time.

    Otherwise refraction would be computed for different air there, and effects of the cause would
    be zero. Values that the file declares for all rows are kept.
    """
    columns, declared = table.columns, table.meta.get('weather') or {}
    time = columns.get('time', np.full(len(table.lines), np.nan))
    for name, values in list(columns.items()):
        if values.dtype.kind != 'f' or not (
                name in _AIR and _AIR[name].field not in declared
                or name not in COLUMNS and is_cause(name)):
            continue
        known = np.flatnonzero(np.isfinite(values) & np.isfinite(time))
        at, measured = (v[known[np.argsort(time[known], kind='stable')]] for v in (time, values))
        rows = np.flatnonzero(np.isnan(values) & np.isfinite(time))
        if not len(known) or name not in _AIR and len(np.unique(measured)) < _MEASURED:
            continue  # such as a filter or a side: cannot be interpolated
        after = np.searchsorted(at, time[rows])
        beside = at[[np.maximum(after - 1, 0), np.minimum(after, len(at) - 1)]]
        rows = rows[np.abs(time[rows] - beside).min(axis=0) <= _NEARBY]
        if len(rows):
            columns[name] = np.array(values)
            columns[name][rows] = np.interp(time[rows], at, measured)
            table.meta['notes'].append(f'{table.label(name)} is empty in {len(rows)} rows: '
                                       'interpolated in time')


def flag_rows(table, mount):
    """Exclude rows with impossible elevations, and copies of an earlier row."""
    low, high = ELEVATION_LIMITS
    el = table.columns['el']  # of an alt-azimuth mount as written
    if not mount.vertical:
        el = mount.horizon_of(table.columns['az'], el)[1]
    with np.errstate(invalid='ignore'):
        table.exclude((el < low * DEG) | (el > high * DEG),
                      f'elevation outside {low:g}..{high:g} deg')
    rows = np.flatnonzero(table.reasons == 0)
    first = copies({name: values[rows] for name, values in table.columns.items()})
    again = np.flatnonzero(first >= 0)
    few = len(np.unique(first[again])) <= _NAMED
    for i in again:
        where = f'line {table.lines[rows[first[i]]]}' if few else 'one before'
        table.reasons[rows[i]] = f'{SAME}{where}'
    if not few:
        table.meta['notes'].append(written_twice(first >= 0))


def _as_written(table):
    """``meta['as_written']``: rows for the check of the columns, a subset if there are many.

    Places and readings are those of the file, before rows are placed beyond the pole, since a
    mistaken column would be mistaken there too. ``line``: line in the file. ``misplaced``: rows
    excluded for their place. ``beyond``: rows that ``pier_side`` puts through the pole.
    ``misplaced_rows``: total number of misplaced rows.
    """
    begins, ends = _NO_PLACE
    misplaced = np.zeros(len(table.lines), bool)
    for i in np.flatnonzero(table.reasons != 0):
        misplaced[i] = table.reasons[i].startswith(begins) or table.reasons[i].endswith(ends)
    rows = np.flatnonzero(misplaced | (table.reasons == 0))
    if len(rows) > _WRITTEN:
        rows = rows[np.linspace(0, len(rows) - 1, _WRITTEN).astype(int)]
    columns = {**table.columns, **table.written}
    names = [name for pair in PAIRS if set(pair) <= set(columns) for name in pair]
    if table.names is not ALTAZ.names:  # with the clock, which gives right ascensions
        names += [name for name in ('lst_h', 'time') if name in columns]
    names += ['beyond'] if 'beyond' in columns else []
    return {'line': table.lines[rows], 'misplaced': misplaced[rows],
            'misplaced_rows': int(misplaced.sum()), **{name: columns[name][rows] for name in names}}


def finish(path, table):
    """Remove the excluded rows; ``meta['excluded']`` lists them all.

    Also sets ``meta['as_written']``, see `_as_written`.

    Returns
    -------
    dict of str to ndarray
        The columns of the rows to keep.

    Raises
    ------
    NoUsableRow
        No row is left.
    """
    table.meta['as_written'] = _as_written(table)
    keep = table.reasons == 0
    excluded = [(int(table.lines[i]), table.reasons[i]) for i in np.flatnonzero(~keep)]
    excluded += [(line, 'commented out') for line in table.commented]
    table.meta['excluded'] = [{'row': row, 'reason': reason} for row, reason in sorted(excluded)]
    if not keep.any():
        row, reason = excluded[0]
        where = table.meta.get('row_names', {}).get(row, f'row {row}')
        raise NoUsableRow(
            f'{path}: none of {len(keep)} rows can be used ({where}: {reason})',
            PointingRun({name: np.zeros(0) for name in REQUIRED}, table.meta))
    table.meta['lines'] = table.lines[keep]
    columns = {}
    for name, values in table.columns.items():
        values = values[keep]
        missing = int(np.isnan(values).sum()) if values.dtype.kind == 'f' else 0
        if missing == len(values) and name not in REQUIRED:
            table.meta['notes'].append(f'{table.label(name)} left out: it is empty')
            continue
        if missing:
            table.meta['notes'].append(f'{table.label(name)} is empty in {missing} of '
                                       f'{len(values)} rows')
        columns[name] = values
    lone = _SIGMAS & set(columns)
    if len(lone) == 1:
        (given,), (other,) = lone, _SIGMAS - lone
        table.meta['notes'].append(f'{table.label(given)} without {table.label(other)} is not '
                                   'used: give both')
    return columns
