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

"""Nights of a season: the terms fitted to each pointing run, its date and possible causes."""

import re
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import rms
from pointing_model.runs.columns.cell_values import CLOCK
from pointing_model.runs.columns.column_names import is_cause
from pointing_model.runs.columns.row_checks import Caution
from pointing_model.runs.copies import without_copies

from ..diagnosis.mistaken_columns import ColumnCheck, MistakenColumns, check_columns
from ..finding import Finding, is_caution
from ..term_fit import fit_terms

NO_DATE = 'no date'
#: a longer gap in a run ends a night, h
PAUSE_H = 6.0
#: fewest nights to reject outliers among them, and their threshold relative to the scatter
_FEWEST, _ODD = 8, 10.0
#: fewest rows per term in a night
ROWS_A_TERM = 2
_STAMP = re.compile(r'(\d{4})-?(\d{2})-?(\d{2})(?:[T_\s](\d{2})[-:]?(\d{2})(?:[-:]?(\d{2}))?)?')
_DAY = 86400.0


class SeasonNight(NamedTuple):
    """Terms fitted to one night.

    Attributes
    ----------
    source : str
        File, and the number of the night in it if there are several.
    time : float
        UTC, s since 1970.
    rows : int
        Number of rows used.
    values : ndarray, shape (k,)
        Terms, rad.
    covariance : ndarray, shape (k, k)
        rad^2, of the fit only.
    rms : float
        Radial RMS of the fit residuals, rad.
    causes : dict of str to (float, float)
        Mean of each possible cause over the night, and its scatter in it.
    run : PointingRun
        Its rows.
    """

    source: str
    time: float
    rows: int
    values: np.ndarray
    covariance: np.ndarray
    rms: float
    causes: dict
    run: object = None


class Nights(NamedTuple):
    """The nights of a season in order of time.

    Attributes
    ----------
    names : tuple of str, length k
        The terms.
    mount : pointing_model.mounts.Mount
    nights : list of Night
    notes : list of str
        Excluded nights and reasons; doubts about columns.
    columns : tuple of str
        Columns declared as causes by the user.
    """

    names: tuple
    mount: object
    nights: list
    notes: list
    columns: tuple = ()


def nights_of(runs, names=None, columns=()):
    """Fit each night separately; observations contained in two runs are used once.

    Parameters
    ----------
    runs : iterable of PointingRun
        Of one mount; ``meta['source']`` is the name of each.
    names : sequence of str, optional
        Terms; by default the physical ones of the mount.
    columns : sequence of str
        Further columns to use as causes, not recognised by their names.

    Returns
    -------
    Nights

    Raises
    ------
    ValueError
        Runs of two mounts, a column that no run has, or fewer than three nights.
    """
    runs, notes = without_copies(runs)
    found, checked, mount, seen = [], [], None, set()
    for run in runs:
        source = str(run.meta.get('source', 'run'))
        if mount is None:
            mount, first = run.mount, source
            names = tuple(names or mount.names.physical)
        elif not run.mount.agrees(mount):
            raise ValueError(f'{source} is of another mount than {first}: make a season of each')
        try:
            checked.append(check_columns(run))
        except MistakenColumns as error:
            notes.append(f'{error} (left out)')
            continue
        for part, rows in _parts(run):
            label = Path(source).name + (f' ({part})' if part else '')
            try:
                found.append(_night(rows, names, label, columns, seen))
            except ValueError as err:
                notes.append(Finding('night left out', evidence={'night': label, 'why': str(err)}))
    missing = set(columns) - seen
    if missing:
        raise ValueError(f'no run has a column {", ".join(sorted(missing))}')
    if len(found) < 3:
        raise ValueError('a season takes three nights with a date and enough stars, not '
                         f'{len(found)}: '
                         + ('; '.join(_reason(note) for note in notes[:3]) or 'give more runs'))
    found.sort(key=lambda night: night.time)
    notes = [*_cautions(runs), *notes, *ColumnCheck.of(checked).doubts(mount.names)]
    return Nights(names, mount, found, notes, tuple(columns))


def _cautions(runs):
    """Cautions of the file readers; those of many files that differ in numbers only are one."""
    files = {}
    for run in runs:
        for note in filter(is_caution, run.meta.get('notes', ())):
            files.setdefault(re.sub(r'[-+.\d]+', '', note), []).append(
                (Path(str(run.meta.get('source', 'run'))).name, note))
    return [Caution(f'{rows[0][0]}{f" and {len(rows) - 1} more" * (len(rows) > 1)}: {rows[0][1]}')
            for rows in files.values()]


def _reason(note):
    return note if isinstance(note, str) else f'{note["night"]}: {note["why"]}'


def _parts(run):
    """Split a run into nights: number of each (0 if there is only one), and its rows."""
    time = run.get('time')
    if not np.isfinite(time).all() or len(run) < 2:
        return [(0, run)]
    order = np.argsort(time, kind='stable')
    ends = np.flatnonzero(np.diff(time[order]) > PAUSE_H * 3600.0) + 1
    if not len(ends):
        return [(0, run)]
    return [(k + 1, run.select(np.sort(rows))) for k, rows in enumerate(np.split(order, ends))]


def _night(run, names, label, columns, seen):
    """A `SeasonNight`; raises ValueError with the reason if the night is unusable."""
    time = _time_of(run, label)
    if time is None:
        raise ValueError(NO_DATE)
    if len(run) < ROWS_A_TERM * len(names):
        raise ValueError(f'{len(run)} rows for {len(names)} terms')
    several = 'run' in run and len(np.unique(run['run'])) > 1
    fit = fit_terms(run, names, run_zeros=several)
    if fit.dropped:
        raise ValueError(f'does not determine {fit.dropped[0]["text"]}')
    k = len(names)
    used = fit.weights > 0.0
    causes = {}
    for name in run.columns:
        if name in columns or is_cause(name):
            seen.add(name)
            values = run[name][np.isfinite(run[name])]
            if len(values):
                causes[name] = float(values.mean()), float(values.std())
    return SeasonNight(label, time, int(used.sum()), fit.coefficients[:k], fit.covariance[:k, :k],
                 rms(fit.residual_x[used], fit.residual_y[used]), causes, run)


def _time_of(run, label):
    """UTC, s: from the rows, or else from the caption, file name or date; None if unknown."""
    if 'time' in run and np.isfinite(run['time']).any() and np.nanmean(run['time']) >= CLOCK:
        return float(np.nanmean(run['time']))
    for text in (str(run.meta.get('caption', '')), label, str(run.meta.get('date', ''))):
        for found in _STAMP.finditer(text):
            year, month, day, hour, minute, second = (int(v or 0) for v in found.groups())
            try:
                return datetime(year, month, day, hour if found[4] else 12, minute, second,
                                tzinfo=timezone.utc).timestamp()
            except ValueError:  # digits that are no date
                continue
    return None


def days(nights):
    """Days since the first night, shape (n,)."""
    time = np.array([night.time for night in nights])
    return (time - time[0]) / _DAY


def table_rows(season):
    """A dict for each night, JSON-ready."""
    return [{'source': night.source, 'rows': night.rows,
             'time': datetime.fromtimestamp(night.time, timezone.utc).isoformat(
                 timespec='minutes'),
             'rms_arcsec': night.rms / ARCSEC,
             'terms_arcsec': dict(zip(season.names, (night.values / ARCSEC).tolist())),
             'sigma_arcsec': dict(zip(season.names, (np.sqrt(np.diag(night.covariance))
                                                     / ARCSEC).tolist())),
             'causes': {name: mean for name, (mean, _) in night.causes.items()}}
            for night in season.nights]


def without_odd_nights(season):
    """The season without single nights, or two, far from their neighbours, and a Finding on each.

    A misidentified star or a lost zero is no random walk, and one such night hides all causes. The
    first and the last night are kept: their deviation may be a step.
    """
    values = np.array([night.values for night in season.nights])
    n = len(values)
    if n < _FEWEST:
        return season, []
    error = np.sqrt(np.array([np.diag(night.covariance) for night in season.nights]))
    about = np.array([np.median(np.delete(values[max(0, i - 2):i + 3], min(i, 2), axis=0), axis=0)
                      for i in range(n)])
    off = values - about
    scatter = np.hypot(1.4826 * np.median(np.abs(off), axis=0), np.median(error, axis=0))
    times = np.abs(off) / np.hypot(scatter, error)
    # nights on either side of a step agree with one neighbour, of stairs are between both
    alone = np.zeros_like(times)
    for span in (1, 2):
        for i in range(1, n - span):
            here = slice(i, i + span)
            before, after = values[here] - values[i - 1], values[here] - values[i + span]
            beside = np.minimum(np.abs(before), np.abs(after)) * (before * after > 0.0)
            alone[here] = np.maximum(alone[here], beside / np.hypot(scatter, error[here]))
    odd = np.flatnonzero((np.minimum(times, alone) > _ODD).any(axis=1))
    if len(odd) > n // 10 + 1:
        return season, []
    found = []
    for i in odd:
        term = int(np.argmax(times[i]))
        found.append(Finding('odd night', float(off[i, term] / ARCSEC), evidence={
            'date': date_of(season.nights[i].time), 'source': season.nights[i].source,
            'term': season.names[term], 'times': float(times[i, term])}))
    return season._replace(nights=[night for i, night in enumerate(season.nights)
                                   if i not in odd]), found


def date_of(time, other=None):
    """A date as text, with the time of day if `other` is on the same date."""
    day = datetime.fromtimestamp(time, timezone.utc)
    if other is not None and datetime.fromtimestamp(other, timezone.utc).date() == day.date():
        return day.strftime('%Y-%m-%d %H:%M')
    return day.strftime('%Y-%m-%d')
