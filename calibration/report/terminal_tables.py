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

"""What people see of a calibration on the terminal: tables."""

from itertools import zip_longest

from pointing_model.effects.base import readable
from pointing_model.mount_kinds import kind_of
from pointing_model.zero import BY_POLARIS

from ..analysis.harmonic_fit import READ_AS
from .alignment_wording import alignment_lines
from .fit_wording import UNDETERMINED, origin_sentence
from .night_document import RAW, steps_of
from .row_wording import expected_sentence, left_out_lines, outlier_sentence, used_sentence
from .terminal_layout import TerminalTable, layered
from .wording import wording

#: parts of a prediction that are listed; terms that are listed in one column
_PARTS, _ONE_COLUMN = 8, 8


def new_table(title, *columns):
    """An empty table, first column left, the others right; see `terminal_layout`."""
    out = TerminalTable(title=title)
    for i, name in enumerate(columns):
        out.add_column(name, justify='left' if i == 0 else 'right')
    return out


def decimals(value, digits=2):
    """A number for a table; what is not known is a dash."""
    return '-' if value is None else f'{value:.{digits}f}'


def _angle(value, sigma):
    return f'{value:+9.2f} ± {sigma:.2f}'


def night_parts(report):
    """What the terminal has of a calibration report.

    Parameters
    ----------
    report : dict
        From `calibration.calibration_state.CalibrationState.fit`.

    Returns
    -------
    first, more, rest : list
        As of `terminal_layout.layered`: texts and tables.
    """
    names, first, more = kind_of(report), [], []
    chosen = [step for step in steps_of(report) if step]
    if chosen:
        stars = chosen[-1]['held_out'].get('n')
        held = new_table('', 'RMS on the sky, arcsec' + (
            f', {stars} stars held out' if stars else ''), *names.columns, 'radial')
        for step in chosen:
            held.add_row(step['step'], *_rms_cells(step['held_out']))
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
    rest = night_tables(report)
    return first, more, rest


def night_tables(report):
    """All tables of a calibration report but that of the terms.

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
        steps.add_row(step['step'], *_rms_cells(step['used']), *_rms_cells(step['held_out']))
    tables.append(steps)
    if report['external_check']:
        check = new_table('External check, RMS on the sky, arcsec', 'model and stars', first,
                          second, 'radial', 'stars')
        for row in report['external_check']:
            check.add_row(row['check'], *_rms_cells(row), str(row['n']))
        tables.append(check)
    if report.get('harmonics'):
        tables += harmonic_tables(report['harmonics'])
    return tables


def harmonic_tables(section):
    """Coefficients of the harmonics, and what cross-validation says of every choice.

    Parameters
    ----------
    section : dict
        From `calibration.analysis.harmonic_fit.fit_chosen`.

    Returns
    -------
    list of rich.table.Table
    """
    own = section['harmonics'], section['alone'], section['degree']
    table = new_table(f'Harmonics of degree {own[2]}, {READ_AS[own[0]]}, arcsec', 'coefficient',
                      'azimuth', 'sigma', 'coefficient', 'elevation', 'sigma')
    rows = section['coefficients']
    for pair in zip(rows, rows[len(rows) // 2:]):
        table.add_row(*(cell for one in pair for cell in (
            one['name'], f'{one["value_arcsec"]:+.2f}',
            UNDETERMINED if one['sigma_arcsec'] is None else f'{one["sigma_arcsec"]:.2f}')))
    tried = section['cross_validation']
    choices = new_table(f'Cross-validated RMS on the sky, arcsec, {tried["stars"]} rows in '
                        f'{tried["folds"]} folds', 'model', 'az', 'el', 'radial', '')
    for one in tried['choices']:
        chosen = (one['harmonics'], one['alone'], one['degree']) == own
        choices.add_row(one['label'], *_rms_cells(one),
                        f'chosen by {section["degree_by"]}' if chosen else '')
    return [table, choices]


def _zero_cells(zero):
    return (_angle(zero['az_arcsec'], zero['sigma_az_arcsec']),
            _angle(zero['el_arcsec'], zero['sigma_el_arcsec']), str(zero['exposures']))


def _rms_cells(values):
    return [f'{values[key]:.2f}' for key in ('x', 'y', 'radial')]


def terms_table(terms):
    """A table of terms with their standard errors.

    Parameters
    ----------
    terms : list of dict
        With ``name``, ``value_arcsec``, ``sigma_arcsec``; of few rows ``within95_arcsec``.

    Returns
    -------
    rich.table.Table
    """
    wide = any('within95_arcsec' in term for term in terms)
    heads = ['arcsec', 'sigma', *(['95 % within'] * wide)]
    cells = []
    for term in terms:
        sigma, within = term['sigma_arcsec'], term.get('within95_arcsec')
        cells.append([term['name'], f'{term["value_arcsec"]:+.2f}',
                      UNDETERMINED if sigma is None else f'{sigma:.2f}',
                      *(['–' if within is None else f'± {within:.2f}'] if wide else ())])
    if len(terms) <= _ONE_COLUMN:
        out = new_table('', 'term, encoder − catalogue', *heads)
        for row in cells:
            out.add_row(*row)
        return out
    out, half = new_table('', 'encoder − catalogue', *heads, 'term', *heads), -(-len(cells) // 2)
    for left, right in zip_longest(cells[:half], cells[half:], fillvalue=[''] * (1 + len(heads))):
        out.add_row(*left, *right)
    return out


def fit_tables(found, document, verbose=True, files=0):
    """What the command says of a fit to a measured run.

    Parameters
    ----------
    found : calibration.analysis.run_fit.RunFit
    document : dict
        Of `documents.fit_document`.
    verbose : bool
        With all notes, and not only those for which 24 lines of 80 columns have room.
    files : int
        Lines that are printed after it.

    Returns
    -------
    list
        What `rich.console.Console.print` takes: tables and lines of text.
    """
    run, result = found.run, found.terms
    steps = new_table('', 'RMS on the sky, arcsec', *run.mount.names.columns, 'radial')
    terms = f'{len(result.names)} terms'
    for label, when, key in (
            (RAW, 'before', 'rms'), (f'{terms}, fit residuals', 'after', 'rms'),
            (f'{terms}, cross-validated (2 halves)', 'after', 'cv_rms')):
        values = [document[when][f'{key}_{axis}arcsec'] for axis in ('x_', 'y_', '')]
        if None not in values:
            steps.add_row(label, *(f'{value:.2f}' for value in values))
    alarms, urgent = [], []
    if document['outliers']:
        alarms.append(outlier_sentence(document))
    if found.few_used:
        alarms.append('more than a third of the rows is left out: see why before you use the '
                      'terms')
    alarms += map(wording, result.open_directions)
    if document['polar_axis']:
        urgent.append(' '.join(alignment_lines(document['polar_axis'])))
    details = [*left_out_lines(document['excluded'], word=document['rows_are']),
               *(f'note: {note}' for note in document['notes'])]
    if found.origin is not None:
        details.append(f'sides of the pier: {origin_sentence(found.origin)}')
    strong = _strong_correlations(result)
    statistics = [
        f'sigma from the {result.covariance_from.removeprefix("measured ")}; '
        f'condition {result.condition:.0f}, rank {result.rank} of {len(result.names)}, '
        f'{result.degrees_of_freedom} degrees of freedom',
        *([f'correlations above 0.9: {strong}'] if strong else [])]
    tables = []
    if found.harmonics:
        urgent.append(f'{found.harmonics["label"]}: {found.harmonics["fitted"]["radial"]:.2f} '
                      'arcsec radial, fit residuals')
        tables += [*harmonic_tables(found.harmonics),
                   *(f'note: {note}' for note in document['harmonics']['notes'])]
    shown = steps
    if found.predicted:  # what is saved is the prediction: its errors come first
        shown, *parts = predicting_tables(found.predicted, run.mount)
        urgent += [part for part in parts if isinstance(part, str)]
        tables += [*(part for part in parts if not isinstance(part, str)), steps]
    if found.base:
        tables += [base_table(found.base, found.plain),
                   *(f'note: {wording(note)}' for note in found.base.notes)]
    return layered([used_sentence(document), terms_table(result.term_rows()), shown, *alarms],
                   [*urgent, *details, *tables, *statistics], verbose, files)


def base_table(base, model):
    """The terms of a `base_model.BaseModel` as its file has them and as they were fitted."""
    out = new_table(f'Terms of {base.path.name} and of this run, arcsec', 'term', 'there',
                    'here', 'sigma', 'here - there', 'in sigma')
    for row in base.compared(model)['terms']:
        there, here, sigma, many = (row[k] for k in (
            'there_arcsec', 'here_arcsec', 'sigma_arcsec', 'in_sigma'))
        out.add_row(row['name'], f'{there:+.2f}', *(['-'] * 4 if here is None else [
            f'{here:+.2f}', UNDETERMINED if sigma is None else f'{sigma:.2f}',
            f'{here - there:+.2f}',
            '-' if many is None else f'{many:+.1f}']))
    return out


def predicting_tables(found, mount):
    """The tables of a model chosen to predict.

    Parameters
    ----------
    found : calibration.analysis.diagnosis.prediction.PredictiveModel
    mount : Mount

    Returns
    -------
    list
        As `fit_tables`; the first is the table of errors.
    """
    chosen = new_table(f'Parts of the prediction, arcsec, beside {len(found.model.terms)} terms',
                       'part', 'coefficients', 'RMS on these stars')
    for part in found.parts[:_PARTS]:
        chosen.add_row(readable(part['name']), str(part['columns']), decimals(part['rms_arcsec']))
    rest = len(found.parts) - _PARTS
    if rest > 0:
        chosen.add_row(f'{rest} smaller ones', str(sum(
            part['columns'] for part in found.parts[_PARTS:])), '')
    errors = new_table(f'Prediction: RMS on the sky, arcsec, all {found.rows} rows; no cause is '
                       'claimed', 'rows',
                       *mount.names.columns, 'radial')
    for label, one in (('validated by blocks of time, terms alone', found.blocks_before),
                       ('validated by blocks of time, prediction', found.blocks)):
        if one is not None:
            errors.add_row(label, *_rms_cells(one._asdict()))
    if found.after:
        for label, each in (('validated by random rows, terms alone', found.before),
                            ('validated by random rows, prediction', found.after)):
            errors.add_row(label, *_rms_cells({
                key: sum(getattr(one, key) for one in each) / len(each)
                for key in ('x', 'y', 'radial')}))
    errors.add_row('prediction, fit residuals', *_rms_cells(found.fitted._asdict()))
    return [errors, *([chosen] if found.parts else []), *map(wording, found.findings())]


def _strong_correlations(result):
    matrix = result.correlations
    return ', '.join(
        f'{a} {b} {matrix[i, j]:+.3f}' for i, a in enumerate(result.names)
        for j, b in enumerate(result.names[:i]) if abs(matrix[i, j]) > 0.9)
