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

"""Terminal output for a night: the calibration report."""

from pointing_model.mount_kinds import kind_of
from pointing_model.zero import BY_POLARIS

from .night_document import steps_of
from .row_wording import expected_sentence
from .terminal_tables import harmonic_tables, new_table, rms_cells, terms_table


def night_parts(report):
    """Terminal output for a calibration report.

    Parameters
    ----------
    report : dict
        From `calibration.calibration_state.CalibrationState.fit`.

    Returns
    -------
    first, more, rest : list
        Texts and tables, see `terminal_layout.layered`.
    """
    names, first, more = kind_of(report), [], []
    chosen = [step for step in steps_of(report) if step]
    if chosen:
        stars = chosen[-1]['held_out'].get('n')
        held = new_table('', 'RMS on the sky, arcsec' + (
            f', {stars} stars held out' if stars else ''), *names.columns, 'radial')
        for step in chosen:
            held.add_row(step['step'], *rms_cells(step['held_out']))
        first.append(held)
    if report.get('expected'):
        first.append(expected_sentence(report))
    if report['zeros']:
        zero = report['zeros'][-1]
        first.append(f'zero of power-on {zero["run"]} by {zero.get("by", BY_POLARIS)}, arcsec: '
                     + ', '.join(f'{axis} {_angle(zero[f"{key}_arcsec"], zero[sigma]).strip()}'
                                 for axis, key, sigma in zip(
                                     names.axes, ('az', 'el'),
                                     ('sigma_az_arcsec', 'sigma_el_arcsec'))))
    if report['terms']:
        first.append(terms_table(report['terms']))
    zeros = report['changes'] or report['zeros']
    cross_check = report['witnesses']
    first += [f'alarm: {line}' for line in cross_check['alarms']]
    more += [*(f'note: {line}' for line in (
                 *(zero['statement'] for zero in zeros[-1:]), *report['notes'],
                 *cross_check['notes']))]
    return first, more, night_tables(report)


def night_tables(report):
    """All tables of a calibration report except that of the terms.

    Parameters
    ----------
    report : dict
        From `calibration.calibration_state.CalibrationState.fit`.

    Returns
    -------
    list of rich.table.Table
    """
    tables, names = [], kind_of(report)
    first, second = names.columns
    if report['zeros']:
        ways = [zero.get('by', BY_POLARIS) for zero in report['zeros']]
        alone = set(ways) == {BY_POLARIS}
        zeros = new_table(
            f'Zero on {BY_POLARIS if alone else "stars"}, arcsec', 'power-on', *names.axes,
            'exposures')
        for zero, way in zip(report['zeros'], ways):
            label = f'{zero["run"]}' + ('' if alone else f' by {way}')
            zeros.add_row(label, *_zero_cells(zero))
        for change in report['changes']:
            zeros.add_row(f'change {change["from"]} to {change["to"]}', *_zero_cells(change))
            truth = change.get('simulated')
            if truth:
                zeros.add_row('  simulated', f'{truth["az_arcsec"]:+9.2f}       ',
                              f'{truth["el_arcsec"]:+9.2f}       ', '')
        tables.append(zeros)
    steps = new_table('RMS on the sky, arcsec', 'correction', f'used: {first}', second,
                      'radial', f'held out: {first}', second, 'radial')
    for step in report['steps']:
        steps.add_row(step['step'], *rms_cells(step['used']), *rms_cells(step['held_out']))
    tables.append(steps)
    if report['external_check']:
        check = new_table('External check, RMS on the sky, arcsec', 'model and stars', first,
                          second, 'radial', 'stars')
        for row in report['external_check']:
            check.add_row(row['check'], *rms_cells(row), str(row['n']))
        tables.append(check)
    if report.get('harmonics'):
        tables += harmonic_tables(report['harmonics'])
    return tables


def _zero_cells(zero):
    return (_angle(zero['az_arcsec'], zero['sigma_az_arcsec']),
            _angle(zero['el_arcsec'], zero['sigma_el_arcsec']), str(zero['exposures']))


def _angle(value, sigma):
    return f'{value:+9.2f} ± {sigma:.2f}'
