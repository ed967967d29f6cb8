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

"""Report on causes of the zeros of a season: table, lines, CSV."""

from msg_tools.whole_files import beside
from pointing_model.runs.columns.cells import write_rows

from ..analysis.zero.zero_causes import AXES, zero_causes
from ..analysis.zero.zero_season import season_from_rows
from .terminal_tables import decimals, new_table
from .wording import worded
from .zero_wording import COVARIATES

#: entry of a power-on -> its column in the CSV, for each axis
COLUMNS = {'zero_arcsec': 'zero_{}_arcsec', 'sigma_arcsec': 'sigma_{}_arcsec',
            'temperature': 'temperature_{}_c', 'supply': 'supply_{}_v', 'hours': 'since_{}_h',
            'side': 'side_{}'}


def zero_season(power_ons, expected=None):
    """Causes of the zeros before tonight, and the zero of tonight, predicted and measured.

    Parameters
    ----------
    power_ons : list of dict
        From a report of `night_series.NightSeries.fit`; the last is tonight's.
    expected : dict, optional
        ``zero_expected`` of that report: prediction for tonight, before Polaris was measured.

    Returns
    -------
    dict
        ``power_ons``; ``causes``, `zero_causes.zero_causes` of all but the last, cross-validated
        by nights; ``tonight``, or None: for each axis ``expected_arcsec``, ``sigma_arcsec``,
        ``measured_arcsec``, ``measured_sigma_arcsec``, the covariates ``by`` which it is predicted
        and the ``missing`` ones.
    """
    season = season_from_rows(power_ons[:-1])
    tonight = None
    if expected and power_ons:
        tonight = {'run': power_ons[-1]['run'], **expected_zero(expected, power_ons[-1])}
    return {'power_ons': power_ons, 'causes': worded(zero_causes(season)), 'tonight': tonight}


def expected_zero(expected, measured=None):
    """``tonight`` of `zero_season`; `measured`: the row of its power-on, if it has a zero."""
    return {axis: {'expected_arcsec': expected[axis]['zero_arcsec'],
                   'sigma_arcsec': expected[axis]['sigma_arcsec'],
                   'measured_arcsec': measured and measured['zero_arcsec'][k],
                   'measured_sigma_arcsec': measured and measured['sigma_arcsec'][k],
                   'by': expected[axis]['by'], 'missing': expected[axis]['missing']}
            for k, axis in enumerate(AXES)}


def season_table(document):
    """The table of `zero_season`.

    Parameters
    ----------
    document : dict

    Returns
    -------
    rich.table.Table
    """
    found = document['causes']
    axes = [found['axes'][name] for name in AXES]
    out = new_table(f'Causes of changes of the zero, {found["nights"]} power-ons', '', *AXES)

    def row(what, cell, *more):
        out.add_row(what, *(cell(*values) for values in zip(axes, *more)))
    row('verdict', lambda axis: ': '.join(
        filter(None, (axis['verdict'], ' or '.join(axis['alike'])))))
    for driver in dict.fromkeys(c['driver'] for axis in axes for c in axis['causes']):
        row(COVARIATES[driver], lambda axis, driver=driver: _slope(axis['causes'], driver))
    row('p over all drivers and both axes', lambda axis: decimals(axis['p'], 3))
    row('zeros, std, arcsec', lambda axis: decimals(axis['std_arcsec']))
    row('unexplained, arcsec', lambda axis: decimals(axis['unexplained_arcsec']))
    row('cross-validated by night, without causes, arcsec',
        lambda axis: decimals(axis.get('left_out_before_arcsec')))
    row('cross-validated by night, with causes, arcsec',
        lambda axis: decimals(axis.get('left_out_after_arcsec')))
    if document['tonight']:
        tonight = [document['tonight'][name] for name in AXES]
        row('tonight, predicted, arcsec',
            lambda _, t: _value(t['expected_arcsec'], t['sigma_arcsec']), tonight)
        if all(t['measured_arcsec'] is not None for t in tonight):
            row('tonight, measured, arcsec',
                lambda _, t: _value(t['measured_arcsec'], t['measured_sigma_arcsec']), tonight)
    return out


def _slope(causes, driver):
    for cause in causes:
        if cause['driver'] == driver:
            return _value(cause['slope_arcsec'], cause['sigma_arcsec'], 2,
                          f' arcsec/{cause["unit"]}')
    return '-'


def _value(value, sigma, digits=1, unit=''):
    return f'{value:+.{digits}f} ± {decimals(sigma, digits)}{unit}'


def season_lines(document):
    """Lines in addition to the table, a list of str."""
    found = document['causes']
    lines = [found['text'], *(f'caution: {line}' for line in found['far']), *found['odd']]
    if document['tonight']:
        lines += [f'caution: {COVARIATES[name]} is not known tonight: the prediction of {axis} is '
                  'the mean of all power-ons' for axis in AXES
                  for name in document['tonight'][axis]['missing']]
    if found['drivers']:  # else the text has them
        lines += [f'not tried: {line}' for line in found['not_tried']]
    if found['left_out']:
        lines.append('power-ons excluded, a driver is unknown: '
                     + ', '.join(map(str, found['left_out'])))
    return lines


def write_season(power_ons, path):
    """A CSV with a row for each power-on; an empty cell is unknown."""
    with beside(path) as part, open(part, 'w', newline='', encoding='utf-8') as file:
        write_rows(file, [
            ['run', 'time', *(pattern.format(axis) for pattern in COLUMNS.values()
                              for axis in ('az', 'el'))],
            *([row['run'], row['time'], *('' if value is None else value
                                          for name in COLUMNS for value in row[name])]
              for row in power_ons)])
