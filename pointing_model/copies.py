"""Observations that are written twice: in one file, in several, in a log and in what it played.

Two rows are one observation where time and readings agree to the digits of the one that has fewer;
without the time of both, places and readings. Rows of one star seconds after one another differ in
their time.
"""

from pathlib import PurePath

import numpy as np

from msg_tools.units import DEG, wrap

#: what angles (degrees; arcseconds; seconds of time) and times (s) may be rounded to, coarse first
_ANGLES = sorted([*(10.0**-k for k in range(3, 10)), *(10.0**-k / 3600.0 for k in range(4)),
                  *(15.0 * 10.0**-k / 3600.0 for k in range(1, 4))], reverse=True)
_TIMES = (1.0, 0.1, 0.01, 1e-3, 1e-6)
_MINUTE = 60.0
_SAME_FIELD = 0.1  # deg: places of one observation, by whatever refraction
_BESIDE = 64  # rows nearby in the order of their readings that each is compared with


def copies(columns, source=None):
    """Of which row each is a copy.

    Parameters
    ----------
    columns : mapping of str to ndarray, shape (n,)
        ``az, el, az_enc, el_enc`` (rad); ``time`` (s), NaN where it is not known, if at all.
    source : ndarray of int, shape (n,), optional
        Number of the file of each row.

    Returns
    -------
    ndarray of int, shape (n,)
        The first such row; -1 where there is none before it.
    """
    reading = np.array([columns['az_enc'], columns['el_enc']], float) / DEG
    place = np.array([columns['az'], columns['el']], float) / DEG
    n = place.shape[1]
    time = np.asarray(columns.get('time', np.full(n, np.nan)), float)
    units = [_unit(reading, _ANGLES), _unit(place, _ANGLES), _time_unit(time, source)]
    # neighbours in readings are neighbours in this, over north too
    along = reading[1] + np.degrees(np.e * np.cos(np.radians(reading[0]) - 1.0))
    rows = np.flatnonzero(np.isfinite(along) & np.isfinite(place).all(axis=0))
    order = rows[np.argsort(along[rows], kind='stable')]
    out = np.arange(n)
    for k in range(1, min(_BESIDE, len(order))):
        near = along[order[k:]] - along[order[:-k]] < 4.0 * _ANGLES[0]
        if not near.any():
            break
        i, j = order[:-k][near], order[k:][near]
        i, j = np.minimum(i, j), np.maximum(i, j)
        same = _same(i, j, reading, place, time, units)
        np.minimum.at(out, j[same], i[same])
    while (out[out] != out).any():  # a copy of a copy is one of the first
        out = out[out]
    return np.where(out < np.arange(n), out, -1)


def _same(i, j, reading, place, time, units):
    of_reading, of_place, of_time = (np.maximum(u[i], u[j]) * (1.0 - 1e-3) for u in units)

    def away(angles):
        first = wrap((angles[0, i] - angles[0, j]) * DEG) / DEG
        return np.maximum(np.abs(first), np.abs(angles[1, i] - angles[1, j]))
    with np.errstate(invalid='ignore'):
        at_once = np.abs(time[i] - time[j]) < of_time
    timed = np.isfinite(time[i]) & np.isfinite(time[j])
    return (away(reading) < of_reading) & np.where(
        timed, at_once & (away(place) < _SAME_FIELD), away(place) < of_place)


def _unit(values, units):
    """What a row is rounded to: the coarsest of `units` that divides both of its angles."""
    out = np.full(values.shape[1], units[-1])
    for unit in reversed(units):
        with np.errstate(invalid='ignore'):
            out[_divides(unit, values).all(axis=0)] = unit
    return out


def _time_unit(time, source):
    out = _unit(time[np.newaxis], _TIMES)
    source = np.zeros(len(time), int) if source is None else source
    for one in np.unique(source):  # of one row, a whole minute is chance
        rows = source == one
        if np.isfinite(time[rows]).sum() > 2 and _divides(_MINUTE, time[rows]).all():
            out[rows] = _MINUTE
    return out


def _divides(unit, values):
    return np.abs(values / unit - np.rint(values / unit)) < 1e-3


def without_copies(runs, seen=()):
    """Runs whose observations count once.

    Parameters
    ----------
    runs : sequence of PointingRun
        Of one mount.
    seen : sequence of PointingRun
        Whose observations do not count in `runs`.

    Returns
    -------
    runs : list of PointingRun
        Without the rows that are in an earlier one, and without runs that have no other.
    notes : list of str
        How many rows, of which file.
    """
    every = [*seen, *runs]
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
        others = dict.fromkeys(name_of(every[i]) for i in np.unique(source[original[copied]]))
        said = f'as {", ".join(list(others)[:3])} has'
        if copied.all():
            notes.append(f'{name_of(run)}: all {len(run)} rows are those that '
                         f'{", ".join(list(others)[:3])} has: left out, each counts once')
            continue
        notes.append(f'{name_of(run)}: {int(copied.sum())} of {len(run)} rows left out, the same '
                     f'{said}: each counts once')
        kept.append(left_out(run, copied, f'the same {said}'))
    return kept, notes


def left_out(run, rows, reason):
    """A run without `rows` (a mask), which ``meta['excluded']`` then has with the reason."""
    out = run.select(~rows)
    out.meta = dict(run.meta)
    out.meta['excluded'] = sorted(
        [*run.meta.get('excluded', ()),
         *({'row': int(line), 'reason': reason} for line in run.lines[rows])],
        key=lambda one: one['row'])
    out.meta['lines'] = run.lines[~rows]
    return out


def name_of(run):
    """Name of the file of a run, for messages."""
    return PurePath(str(run.meta.get('source', 'a run'))).name
