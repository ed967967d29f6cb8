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

"""Terminal output for a fit to a measured run."""

from pointing_model.effects.base import readable

from .bolt_wording import alignment_lines
from .fit_wording import VALIDATED, origin_sentence
from .night_document import RAW
from .row_wording import left_out_lines, outlier_sentence, used_sentence
from .terminal_layout import layered
from .terminal_tables import (
    base_table,
    decimals,
    harmonic_tables,
    new_table,
    rms_cells,
    terms_table,
)
from .wording import noted, wording

#: largest number of parts of a prediction that are listed
_PARTS = 8


def fit_tables(found, document, verbose=True, files=0):
    """Terminal output for a fit to a measured run.

    Parameters
    ----------
    found : calibration.analysis.run_fit.RunFit
    document : dict
        Result of `documents.fit_document`.
    verbose : bool
        Whether to show all notes, or only those that fit in 24 lines of 80 columns.
    files : int
        Number of lines printed afterwards.

    Returns
    -------
    list
        Tables and lines of text for `rich.console.Console.print`.
    """
    run, result = found.run, found.terms
    steps = new_table('', 'RMS on the sky, arcsec', *run.mount.names.columns, 'radial')
    terms = f'{len(result.names)} terms'
    for label, when, key in (
            (RAW, 'before', 'rms'), (f'{terms}, fit residuals', 'after', 'rms'),
            (f'{terms}, {VALIDATED}', 'after', 'cv_rms')):
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
    cautions, notes = noted(document['notes'])
    alarms += cautions
    if document['polar_axis']:
        urgent.append(' '.join(alignment_lines(document['polar_axis'])))
    details = [*left_out_lines(document['excluded'], word=document['rows_are']), *notes]
    if found.origin is not None:
        details.append(f'sides of the pier: {origin_sentence(found.origin)}')
    strong = ', '.join(f'{" ".join(one["terms"])} {one["value"]:+.3f}'
                       for one in document['correlations'] if abs(one['value']) > 0.9)
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
    if found.predicted:  # the predictive model is saved, so its errors come first
        shown, *parts = predicting_tables(found.predicted, run.mount)
        urgent += [part for part in parts if isinstance(part, str)]
        tables += [*(part for part in parts if not isinstance(part, str)), steps]
    if found.base:
        tables += [base_table(found.base, found.plain),
                   *(f'note: {wording(note)}' for note in found.base.notes)]
    return layered([used_sentence(document), terms_table(result.term_rows()), shown, *alarms],
                   [*urgent, *details, *tables, *statistics], verbose, files)


def predicting_tables(found, mount):
    """The tables of a predictive model.

    Parameters
    ----------
    found : calibration.analysis.diagnosis.prediction.PredictiveModel
    mount : Mount

    Returns
    -------
    list
        See `fit_tables`; the first is the table of errors.
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
            errors.add_row(label, *rms_cells(one._asdict()))
    if found.after:
        for label, each in (('validated by random rows, terms alone', found.before),
                            ('validated by random rows, prediction', found.after)):
            errors.add_row(label, *rms_cells({
                key: sum(getattr(one, key) for one in each) / len(each)
                for key in ('x', 'y', 'radial')}))
    errors.add_row('prediction, fit residuals', *rms_cells(found.fitted._asdict()))
    return [errors, *([chosen] if found.parts else []), *map(wording, found.findings())]
