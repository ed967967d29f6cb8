"""Measured zeros of power-ons from a CSV file, and what they follow.

Columns (unknown cells empty; others are ignored):

- ``zero_az_arcsec``, ``zero_el_arcsec``: zero by Polaris, coordinate angles, from any one origin.
- ``sigma_az_arcsec``, ``sigma_el_arcsec``: its error (optional).
- ``time``: UTC, as seconds or ISO 8601 (optional: without it the order of the rows counts).
- ``run``: number of the power-on (optional: the number of the row).
- what may have moved it, one of both axes or ``_az`` and ``_el`` before the unit:
  ``temperature_c``, ``supply_v``, ``since_h`` (hours since the power-on before), ``side`` (of the
  mark: below and above, or +1 and -1).

The file ``zeros.csv`` of `season_report.write_season` is one. A last row without zeros is tonight.
"""

import csv
from datetime import datetime, timezone

import numpy as np

from msg_tools.units import ARCSEC

from .zero_causes import AXES, Season, zero_causes

_DRIVERS = {'temperature': 'temperature{}_c', 'supply': 'supply{}_v', 'hours': 'since{}_h',
            'side': 'side{}'}
_SIDES = {'below': 1.0, 'above': -1.0}
_SHORT = ('_az', '_el')


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

    Raises
    ------
    ValueError
        No such columns, a cell that is no number, nothing that the zeros could follow.
    OSError
        It cannot be read.
    """
    try:
        with open(path, newline='', encoding='utf-8-sig') as file:
            table = csv.DictReader(file)
            rows = list(table)
            names = [name.strip() for name in table.fieldnames or () if name]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f'{path} is no CSV file: {error}') from None
    rows = [{(name or '').strip(): cell for name, cell in row.items()} for row in rows]
    for name in ('zero_az_arcsec', 'zero_el_arcsec'):
        if name not in names:
            raise ValueError(f'{path} has no column {name}: zeros of power-ons are in '
                             'zero_az_arcsec and zero_el_arcsec')

    def column(name, words=None):
        return np.array([_number(path, line, name, row.get(name), words)
                         for line, row in enumerate(rows, 2)], dtype=float)

    def pair(pattern, words=None):
        own = [pattern.format(axis) for axis in _SHORT]
        common = pattern.format('')
        return np.array([column(name if name in names else common, words)
                         for name in own]).T.reshape(-1, 2)

    drivers = {name: pair(pattern, _SIDES if name == 'side' else None)
               for name, pattern in _DRIVERS.items()}
    if rows and not any(np.isfinite(values).any() for values in drivers.values()):
        raise ValueError(f'{path} tells nothing that the zeros could follow: give temperature_c '
                         '(or temperature_az_c and temperature_el_c), supply_v, since_h or side')
    time = np.array([_time(path, line, row.get('time')) for line, row in enumerate(rows, 2)])
    run = column('run')
    season = Season(
        np.where(np.isfinite(run), run, np.arange(1.0, len(rows) + 1.0)).astype(int),
        time, pair('zero{}_arcsec') * ARCSEC, pair('sigma{}_arcsec') * ARCSEC, drivers)
    if len(season) and np.isfinite(time).all():
        season = season.select(np.argsort(time, kind='stable'))
    tonight = None
    if len(season) and np.isnan(season.zeros[-1]).all():
        tonight = {name: values[-1] for name, values in season.drivers.items()}
        season = season.select(slice(0, -1))
    return season.select(np.isfinite(season.zeros).all(axis=1)), tonight


def judge_zeros(path):
    """What the zeros in a file follow, and tonight's.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict
        JSON-ready, as of `season_report.judge_season`: ``causes``, ``tonight``.

    Raises
    ------
    ValueError
        As of `read_zeros`; too few power-ons; no driver varied.
    OSError
    """
    season, tonight = read_zeros(path)
    found = zero_causes(season, tonight)
    if found['p'] is None:
        raise ValueError(f'{path}: {found["text"]}')
    expected = found['tonight']
    return {'causes': found, 'tonight': expected and {axis: {
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
