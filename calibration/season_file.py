"""Measured zeros of power-ons from a CSV file, and what they follow.

Columns (unknown cells empty; of others a note says that they are not used):

- ``zero_az_arcsec``, ``zero_el_arcsec``: zero by Polaris, coordinate angles, from any one origin.
- ``sigma_az_arcsec``, ``sigma_el_arcsec``: its error (optional).
- ``time``: UTC, as seconds or ISO 8601 (optional: without it the order of the rows counts).
- ``run``: number of the power-on (optional: the number of the row).
- what may have moved it, one for both axes or ``_az`` and ``_el`` before the unit:
  ``temperature_c``, ``supply_v``, ``since_h`` (hours since the power-on before), ``side`` (of the
  mark: below and above, or +1 and -1).

The file ``zeros.csv`` of `season_report.write_season` is one. A last row without zeros is tonight.
"""

import csv
import difflib
from datetime import datetime, timezone

import numpy as np

from msg_tools.units import ARCSEC

from .diagnosis.rows_told import listed
from .zero_causes import AXES, Season, zero_causes

_DRIVERS = {'temperature': 'temperature{}_c', 'supply': 'supply{}_v', 'hours': 'since{}_h',
            'side': 'side{}'}
_SIDES = {'below': 1.0, 'above': -1.0}
_SHORT = ('_az', '_el')
_NEEDED = 'zero_az_arcsec and zero_el_arcsec'


def read_zeros(path):
    """Read such a file.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    season : Season
        In order of time.
    tonight : dict of str to ndarray, shape (2,), or None
        The drivers of a last row that has no zero.
    notes : list of str
        Rows that are left out, columns that are not used.

    Raises
    ------
    ValueError
        An empty file, no such columns, a cell that is no number, nothing that the zeros could
        follow.
    OSError
        It cannot be read.
    """
    try:
        with open(path, newline='', encoding='utf-8-sig') as file:
            table = csv.DictReader(file)
            rows, lines = [], []
            for row in table:
                rows.append(row)
                lines.append(table.line_num)
            names = [name.strip() for name in table.fieldnames or () if name]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f'{path} is no CSV file: {error}') from None
    if not names:
        raise ValueError(f'{path} is empty: give a header row with {_NEEDED} and what may have '
                         'moved them (temperature_c, supply_v, since_h, side), and a row for each '
                         'power-on')
    rows = [{(name or '').strip(): cell for name, cell in row.items()} for row in rows]
    for name in ('zero_az_arcsec', 'zero_el_arcsec'):
        if name not in names:
            raise ValueError(f'{path} has no column {name}: zeros of power-ons are in {_NEEDED}')
    if not rows:
        raise ValueError(f'{path} has a header and no row: write a row for each power-on')
    notes = _unknown_columns(path, names)

    def column(name, words=None):
        return np.array([_number(path, line, name, row.get(name), words)
                         for line, row in zip(lines, rows)], dtype=float)

    def pair(pattern, words=None):
        own = [pattern.format(axis) for axis in _SHORT]
        common = pattern.format('')
        return np.array([column(name if name in names else common, words)
                         for name in own]).T.reshape(-1, 2)

    drivers = {name: pair(pattern, _SIDES if name == 'side' else None)
               for name, pattern in _DRIVERS.items()}
    if not any(np.isfinite(values).any() for values in drivers.values()):
        raise ValueError('; '.join([
            f'{path} tells nothing that the zeros could follow: give temperature_c '
            '(or temperature_az_c and temperature_el_c), supply_v, since_h or side', *notes]))
    time = np.array([_time(path, line, row.get('time')) for line, row in zip(lines, rows)])
    run = column('run')
    season = Season(
        np.where(np.isfinite(run), run, np.arange(1.0, len(rows) + 1.0)).astype(int),
        time, pair('zero{}_arcsec') * ARCSEC, pair('sigma{}_arcsec') * ARCSEC, drivers)
    lines = np.array(lines)
    if np.isfinite(time).all():
        order = np.argsort(time, kind='stable')
        season, lines = season.select(order), lines[order]
    tonight = None
    if np.isnan(season.zeros[-1]).all():
        tonight = {name: values[-1] for name, values in season.drivers.items()}
        season, lines = season.select(slice(0, -1)), lines[:-1]
    there = np.isfinite(season.zeros).sum(axis=1)
    for count, why in ((1, f'one of {_NEEDED} is empty; a power-on counts with both'),
                       (0, 'no zero; only the last row may be without, it is tonight')):
        if (there == count).any():
            away = lines[there == count].tolist()
            notes.append(f'{path}, line{"s" * (len(away) > 1)} {listed(away)} left out: {why}')
    return season.select(there == 2), tonight, notes


def _unknown_columns(path, names):
    """Notes of columns that mean nothing here: a driver that is misspelt would be missed."""
    known = ['time', 'run', *(pattern.format(axis) for pattern in (
        'zero{}_arcsec', 'sigma{}_arcsec', *_DRIVERS.values()) for axis in ('', *_SHORT))]
    notes, others = [], []
    for name in (name for name in names if name not in known):
        near = difflib.get_close_matches(name.lower(), known, 1, 0.75)
        if near:
            notes.append(f'{path}: column {name} is not used: did you mean {near[0]}?')
        else:
            others.append(name)
    if others:
        notes.append(f'{path}: columns not used, nothing that a zero may follow is called so: '
                     + ', '.join(others))
    return notes


def judge_zeros(path):
    """What the zeros in a file follow, and tonight's.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict
        JSON-ready, as of `season_report.judge_season`: ``causes``, ``tonight``; and ``notes``, as
        of `read_zeros`.

    Raises
    ------
    ValueError
        As of `read_zeros`; too few power-ons; no driver varied.
    OSError
    """
    season, tonight, notes = read_zeros(path)
    found = zero_causes(season, tonight)
    if found['p'] is None:
        raise ValueError('; '.join([f'{path}: {found["text"]}', *notes]))
    expected = found['tonight']
    return {'causes': found, 'notes': notes, 'tonight': expected and {axis: {
        'expected_arcsec': expected[axis]['zero_arcsec'],
        'sigma_arcsec': expected[axis]['sigma_arcsec'], 'measured_arcsec': None,
        'measured_sigma_arcsec': None, 'by': expected[axis]['by'],
        'missing': expected[axis]['missing']} for axis in AXES}}


def _number(path, line, name, cell, words=None):
    text = (cell or '').strip()
    if words and text.lower() in words:
        return words[text.lower()]
    try:
        value = float(text or 'nan')
    except ValueError:
        value = np.inf
    if np.isinf(value):
        raise ValueError(f'{path}, line {line}: {name} is no number: {text!r:.40}') from None
    return value


def _time(path, line, cell):
    text = (cell or '').strip()
    try:
        return float(text or 'nan')
    except ValueError:
        pass
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(f'{path}, line {line}: time is neither seconds nor a date: '
                         f'{text!r:.40}') from None
    return (when if when.tzinfo else when.replace(tzinfo=timezone.utc)).timestamp()
