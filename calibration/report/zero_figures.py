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

"""The zero of each power-on, from the sky and from the encoders, and against temperature."""

from datetime import datetime, timezone

import numpy as np

from msg_tools.units import ARCSEC, wrap

from . import page_parts as page
from .drawing import Panel, padded, svg
from .number_wording import number

AXES = ('az', 'el')
#: zero against temperature: fewest power-ons, and smallest range of temperature, degC
_FEWEST, _LEAST_SPREAD = 4, 0.2


def zeros_of(report, run=None, marks=()):
    """The zero of each power-on, from the sky and from the encoders.

    Parameters
    ----------
    report : dict
        Report of `CalibrationState.fit`: ``zeros`` (from dedicated exposures),
        ``zeros_in_force`` (from all rows).
    run : PointingRun, optional
        All rows, for the difference of the two encoders and the air temperature.
    marks : list of dict
        ``marks`` of `log_health.log_health`: temperature and supply voltage of the encoder.

    Returns
    -------
    list of dict
        ``run``, ``begin`` (UTC s), ``rows``, ``exposures``, ``rejected``; by axis ``measured``,
        ``sigma``, ``in_force``, ``apart`` (incremental - absolute) in arcsec; ``air`` and
        ``encoder`` in degC, ``supply`` in V. None: unknown.
    """
    measured = {zero['run']: zero for zero in report.get('zeros') or ()}
    active = {zero['run']: zero for zero in report.get('zeros_in_force') or ()}
    numbers = np.zeros(0) if run is None else run.columns.get('run', np.zeros(0))
    out = []
    for number_ in sorted({*measured, *active, *np.unique(numbers).tolist()}):
        own = np.flatnonzero(numbers == number_)
        zero, all_rows = measured.get(number_, {}), active.get(number_, {})
        row = {'run': number_, 'rows': len(own), 'exposures': zero.get('exposures'),
               'rejected': zero.get('rejected'), 'begin': _mean(run, 'time', own, np.min),
               'air': _mean(run, 'temperature', own), 'encoder': None, 'supply': None}
        for key, name in (('encoder', 'temperature'), ('supply', 'supply')):
            known = [mark[name] for mark in marks
                    if mark['power_on'] == number_ and mark[name] is not None]
            row[key] = float(np.mean(known)) if known else None
        for axis in AXES:
            row[axis] = {'measured': zero.get(f'{axis}_arcsec'),
                         'sigma': zero.get(f'sigma_{axis}_arcsec'),
                         'in_force': all_rows.get(f'{axis}_arcsec'),
                         'apart': _encoder_difference(run, axis, own)}
        out.append(row)
    return out


def _mean(run, name, rows, how=np.mean):
    if run is None or name not in run or not len(rows):
        return None
    values = run[name][rows]
    values = values[np.isfinite(values)]
    return float(how(values)) if len(values) else None


def _encoder_difference(run, axis, rows):
    if run is None or f'{axis}_abs' not in run or not len(rows):
        return None
    difference = wrap(run[f'{axis}_enc'][rows] - run[f'{axis}_abs'][rows]) / ARCSEC
    difference = difference[np.isfinite(difference)]
    return float(np.median(difference)) if len(difference) else None


def zeros_section(report, rows, axes=('azimuth', 'elevation')):
    """Section on the zeros: table and figures, with the cross-check of the encoders.

    Parameters
    ----------
    report : dict
        See `zeros_of`; also ``witnesses`` and ``changes``.
    rows : list of dict
        Result of `zeros_of`.
    axes : tuple of str
        Names of the axes of the mount.
    """
    cross_check = report.get('witnesses') or {}
    alarms = [f'Alarm: {text}' for text in cross_check.get('alarms', ())]
    if not any(row[axis][key] is not None for row in rows for axis in AXES
               for key in ('measured', 'in_force')):
        return page.folded_section('Zero by power-on', [
            page.paragraph('No zero was set.'),
            page.sentence_list([*alarms, *cross_check.get('notes', ())])])
    lines = alarms or ['The cross-check of the encoders raises no alarm.']
    statements = [zero['statement'] for zero in (
        report.get('changes') or report.get('zeros') or [])[-1:] if zero.get('statement')]
    marks = page.legend((('before', 'by the exposures for it, ± 1 σ'),
                         ('after', 'by all rows, active'),
                         ('third', 'incremental − absolute encoder')))
    drawn = [page.figure_pair([_against(rows, i, [row['run'] for row in rows], 'power-on', axes)
                               for i in range(2)])] if len(rows) > 1 else []
    warm = [row['encoder'] if row['encoder'] is not None else row['air'] for row in rows]
    if len(rows) >= _FEWEST and None not in warm and np.ptp(warm) > _LEAST_SPREAD:
        drawn.append(page.figure_pair([_against(rows, i, warm, 'temperature [°C]', axes)
                                       for i in range(2)]))
    return page.folded_section('Zero by power-on', [
        page.sentence_list([*lines, *cross_check.get('notes', ())]), drawn and [marks, *drawn],
        _table(rows, axes), page.sentence_list(statements)],
        'Of the incremental encoder, arcsec; drawn against the first power-on.' if drawn else '')


def _table(rows, axes):
    head = ['power-on', 'begin UTC', 'rows', 'exposures for it']
    head += [f'{name} {what}' for name in axes
             for what in ('by these ″', '± ″', 'active ″', 'inc. − abs. ″')]
    head += ['air °C', 'encoder °C', 'supply V']
    cells = []
    for row in rows:
        begin = row['begin'] and datetime.fromtimestamp(row['begin'], timezone.utc)
        out = [f'{row["run"]:g}', begin and f'{begin:%m-%d %H:%M}', row['rows'], row['exposures']]
        for axis in AXES:
            one = row[axis]
            out += [number(one['measured'], 2, True), number(one['sigma'], 2),
                    number(one['in_force'], 2, True), number(one['apart'], 2, True)]
        cells.append([*out, number(row['air'], 1), number(row['encoder'], 1),
                      number(row['supply'], 3)])
    kept = [i for i in range(len(head)) if i < 3 or any(cell[i] not in (None, '–')
                                                        for cell in cells)]
    return page.table([head[i] for i in kept], [[cell[i] for i in kept] for cell in cells],
                      'numbers keep', 'Zero of each power-on')


def _against(rows, i, values, label, axes):
    """The zeros of one axis against some values."""
    axis, x = AXES[i], np.asarray(values, float)
    series = []
    for key, style in (('measured', 'before'), ('in_force', 'after'),
                       ('apart', 'third')):
        y = np.array([np.nan if row[axis][key] is None else row[axis][key] for row in rows])
        known = y[np.isfinite(y)]
        if len(known):
            series.append((y - known[0], style))
    sigma = np.array([row[axis]['sigma'] or np.nan for row in rows])
    panel = Panel((56, 24, 372, 180), padded(x, 0.08, 1e-3), padded(
        [y for y, _ in series] or [0.0], 0.12, 1.0))
    whole = label == 'power-on' and len(x) <= 14
    panel.axes(label, 'arcsec', axes[i], x if whole else None,
               [f'{v:g}' for v in x] if whole else None)
    for k, (y, style) in enumerate(series):
        moved = x + (k - 1) * 0.012 * max(float(np.ptp(x)), 1e-3)
        panel.bars(moved, y, sigma if style == 'before' else np.zeros(len(x)), style)
        panel.points(moved, y, style + ' big')
    return page.figure(svg(440, 254, panel.parts, f'Zero of the {axes[i]} against {label}'))
