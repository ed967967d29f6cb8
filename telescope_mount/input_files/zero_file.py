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

"""Reads measured zeros of power-ons from a CSV file, and finds what they depend on.

Columns (unknown cells empty; unused columns are noted):

- ``zero_az_arcsec``, ``zero_el_arcsec``: zero by Polaris, coordinate angles, from any fixed origin.
- ``sigma_az_arcsec``, ``sigma_el_arcsec``: its error (optional).
- ``time``: UTC, as seconds or ISO 8601 (optional: otherwise the order of the rows is used).
- ``run``: number of the power-on (optional: otherwise the number of the row).
- possible causes, one for both axes or with ``_az`` and ``_el`` before the unit:
  ``temperature_c``, ``supply_v``, ``since_h`` (hours since the previous power-on), ``side`` (of the
  mark: below and above, or +1 and -1).

The file ``zeros.csv`` of `zero_season_report.write_season` has this form. A last row without zeros
is tonight.
"""

import difflib
from pathlib import Path

import numpy as np

from calibration.analysis.zero.zero_causes import COVARIATES, Season, zero_causes
from calibration.analysis.zero.zero_season import SIDES
from calibration.report.row_wording import listed
from calibration.report.wording import worded
from calibration.report.zero_season_report import COLUMNS, expected_zero
from msg_tools.units import ARCSEC, wrap
from pointing_model.runs.columns.cells import Cells
from pointing_model.runs.columns.row_checks import fill_rows
from pointing_model.runs.columns.run_table import read_lines

_SHORT = ('az', 'el')
_LARGEST = 1e50  # largest measured value: sums of squares stay finite
_LEAST = 0.1  # arcsec: zeros by stars differ by more
_NEEDED = 'zero_az_arcsec and zero_el_arcsec'


def read_zeros(path):
    """Read a file of zeros.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    season : Season
        In order of time.
    tonight : dict of str to ndarray, shape (2,), or None
        The covariates of a last row that has no zero.
    notes : list of str
        Excluded rows and unused columns.

    Raises
    ------
    ValueError
        An empty file, missing columns, a needed column whose cells are mostly not numbers, or no
        possible cause.
    OSError
        The file cannot be read.
    """
    path = Path(path)
    cells = Cells(path, read_lines(path))
    for name in ('zero_az_arcsec', 'zero_el_arcsec'):
        if name not in cells.header:
            raise ValueError(f'{path} has no column {name}: zeros of power-ons are in {_NEEDED}')
    if not len(cells):
        raise ValueError(f'{path} has a header and no row: write a row for each power-on')
    notes = _unknown_columns(path, cells.header)
    numbers = {name: _pair(cells, pattern, SIDES if name == 'side' else {})
               for name, pattern in COLUMNS.items()}
    zeros, sigmas = numbers['zero_arcsec'], numbers['sigma_arcsec']
    time, run = _time(cells), _column(cells, 'run')
    notes += _without_fills(cells, path, numbers)
    covariates = {name: numbers[name] for name in COVARIATES}
    for k, axis in enumerate(_SHORT):
        cells.exclude(sigmas[:, k] <= 0.0, f'sigma_{axis}_arcsec is not positive')
    _leave_out_copies(cells, np.column_stack([time * 1e3, zeros * 1e6]))
    kept = cells.reasons == 0
    notes += _left_out(path, cells.lines, cells.reasons)
    if not kept.any():
        raise ValueError('; '.join([f'{path}: no row can be used', *notes]))
    if not any(np.isfinite(values[kept]).any() for values in covariates.values()):
        raise ValueError('; '.join([
            f'{path} has no column that may explain the zeros: give temperature_c '
            '(or temperature_az_c and temperature_el_c), supply_v, since_h or side', *notes]))
    season = Season(
        np.where(np.isfinite(run), run, np.arange(1.0, len(cells) + 1.0)).astype(int),
        time, _on_one_turn(zeros * ARCSEC), sigmas * ARCSEC, covariates).select(kept)
    lines = cells.lines[kept]
    if np.isfinite(season.time).all():
        order = np.argsort(season.time, kind='stable')
        season, lines = season.select(order), lines[order]
    tonight = None
    if np.isnan(season.zeros[-1]).all():
        tonight = {name: values[-1] for name, values in season.covariates.items()}
        season, lines = season.select(slice(0, -1)), lines[:-1]
    there = np.isfinite(season.zeros).sum(axis=1)
    reasons = np.zeros(len(there), dtype=object)
    reasons[there == 1] = f'one of {_NEEDED} is empty; a power-on needs both'
    reasons[there == 0] = 'no zero; only the last row, tonight, may be without'
    return season.select(there == 2), tonight, notes + _left_out(path, lines, reasons)


def _without_fills(cells, path, numbers):
    """Set fill values to NaN; notes on them, and on zeros that hardly differ."""
    notes, zeros = [], numbers['zero_arcsec']
    for name, values in numbers.items():
        for axis, column in zip(_SHORT, values.T):
            rows, text = fill_rows(_named(cells, COLUMNS[name], axis), column)
            if rows.any():
                column[rows] = np.nan
                notes.append(f'{path}: {text} in {rows.sum()} of {len(rows)} rows: not measured')
    spread = np.nanmax(zeros, axis=0, initial=-np.inf) - np.nanmin(zeros, axis=0, initial=np.inf)
    if 0.0 < spread.max() < _LEAST:
        notes.append(f'{path}: all zeros are within {spread.max():.2g} arcsec: are they degrees?')
    return list(dict.fromkeys(notes))


def _on_one_turn(zeros):
    """Zeros, rad, shape (n, 2), each axis within half a turn of its mean direction."""
    middle = np.angle(np.nansum(np.exp(1j * zeros), axis=0))
    near = middle + wrap(zeros - middle)
    # zeros that are on one turn as written are left unchanged
    together = np.nanmax(np.abs(zeros - near), axis=0, initial=0.0) < ARCSEC
    return np.where(together, zeros, near)


def _left_out(path, lines, reasons):
    """Notes on rows with a reason for exclusion."""
    return [f'{path}, line{"s" * (len(away) > 1)} {listed(away)} left out: {why}'
            for why in dict.fromkeys(reasons[reasons != 0])
            for away in [lines[reasons == why].tolist()]]


def _leave_out_copies(cells, values):
    """Exclude power-ons with the same time and zeros as an earlier one."""
    first = {}
    for i in np.flatnonzero((cells.reasons == 0) & np.isfinite(values).all(axis=1)):
        line = first.setdefault(tuple(np.rint(values[i])), cells.lines[i])
        if line != cells.lines[i]:
            cells.reasons[i] = f'the same as line {line}'


def _pair(cells, pattern, words=None):
    """Numbers of both axes, from separate columns or a common one, shape (n, 2)."""
    return np.array([_column(cells, _named(cells, pattern, axis), words) for axis in _SHORT]).T


def _named(cells, pattern, axis):
    """Name of the column of an axis: its own, or the common one."""
    name = pattern.format(axis)
    return name if name in cells.header else pattern.replace('_{}', '')


def _column(cells, name, words=None):
    if name not in cells.header:
        return np.full(len(cells), np.nan)
    texts = [str((words or {}).get(cell.lower(), cell)) for cell in cells[name]]
    values = cells.floats(name, texts)
    cells.exclude(np.isinf(values), f'{name} is infinite')
    cells.exclude(np.abs(values) > _LARGEST, f'{name} is beyond {_LARGEST:g}')
    return values


def _time(cells):
    if 'time' not in cells.header:
        return np.full(len(cells), np.nan)
    return cells.times('time', cells['time'])


def _unknown_columns(path, names):
    """Notes on unknown columns: a misspelt covariate would go unnoticed."""
    known = ['time', 'run', *(name for pattern in COLUMNS.values() for name in (
        pattern.replace('_{}', ''), *map(pattern.format, _SHORT)))]
    notes, others = [], []
    for name in (name for name in names if name not in known):
        near = difflib.get_close_matches(name.lower(), known, 1, 0.75)
        if near:
            notes.append(f'{path}: column {name} is not used: did you mean {near[0]}?')
        else:
            others.append(name)
    if others:
        notes.append(f'{path}: columns not used, names unknown: '
                     + ', '.join(others))
    return notes


def zero_file_causes(path):
    """Causes of the zeros in a file, and the prediction for tonight.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict
        JSON-ready, see `zero_season_report.zero_season`: ``causes``, ``tonight``; and ``notes``,
        see `read_zeros`.

    Raises
    ------
    ValueError
        See `read_zeros`; too few power-ons; or no covariate varied.
    OSError
    """
    season, tonight, notes = read_zeros(path)
    found = worded(zero_causes(season, tonight))
    if found['p'] is None:
        raise ValueError('; '.join([f'{path}: {found["text"]}', *notes]))
    return {'causes': found, 'notes': notes,
            'tonight': found['tonight'] and expected_zero(found['tonight'])}
