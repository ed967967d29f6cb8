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

"""The page of a fit to a measured run."""

from pathlib import Path

import numpy as np

from calibration.analysis.finding import is_caution
from calibration.report.row_wording import outlier_sentence
from msg_tools.units import ARCSEC
from pointing_model.effects.base import arcsec, readable

from . import page_parts as page
from .bolt_wording import alignment_lines
from .diagnosis_sections import exclusions
from .error_ranking import errors_section, term_lines
from .fit_wording import VALIDATED
from .number_wording import group_name
from .page_html import whole
from .provenance import provenance_section, site_degrees, site_text
from .refit_preview import preview
from .residual_figures import controls, residual_sections, sky_maps
from .residuals import run_residuals
from .terms_section import terms_section
from .wording import wording


def render_fit(found, document):
    """The page as text.

    Parameters
    ----------
    found : calibration.analysis.run_fit.RunFit
    document : dict
        Result of `documents.fit_document`.

    Returns
    -------
    str
    """
    run, result, encoder = found.run, found.terms, found.encoder
    data = _residuals(found)
    source = run.meta.get('source') or ''
    before, after = document['before'], document['after']
    label, last = ('cross-validated', after['cv_rms_arcsec']) \
        if after.get('cv_rms_arcsec') is not None else ('fit residuals', after['rms_arcsec'])
    names = run.mount.names.axes
    headline = 'Nothing was fitted' if last is None else (
        f'{arcsec(last)} RMS after a {len(result.names)}-term fit ({label}), '
        f'{arcsec(before["rms_arcsec"])} raw')
    outliers = outlier_sentence(document) if document['outliers'] else ''
    terms = document['terms'] or ()
    more = None if not terms or 'within95_arcsec' not in terms[0] else (
        page.paragraph(f'{document["degrees_of_freedom"]} degrees of freedom.', 'note'))
    body = [
        page.heading('Fit of a pointing model'),
        page.paragraph(f'{document["rows_used"]} of {document["rows_read"]} rows used · '
                       f'{Path(str(source)).name} · terms {", ".join(result.names)} · mount '
                       f'{run.mount.kind}', 'meta'),
        controls(data),
        page.verdict_section(headline, [
            page.cards([(before['rms_arcsec'], 'raw', 'before'),
                        (after['rms_arcsec'], 'fit residuals', 'after'),
                        (after.get('cv_rms_arcsec'), VALIDATED)]),
            page.paragraph('RMS on the sky.', 'note'), sky_maps(data),
            page.sentence_list([outliers, *map(wording, [
                *filter(is_caution, found.findings), *result.findings(run)])])]),
        errors_section(term_lines(document['terms'], run), note='' if last is None else (
            f'The model corrects these; each RMS is of one term alone. What causes the '
            f'{arcsec(last)} left: telescope-mount diagnose {Path(str(source)).name}')),
        terms_section(document['terms'], result.correlations, list(result.names),
                      f'Encoder − catalogue; σ from the {result.covariance_from}; condition '
                      f'{result.condition:.0f}, rank {result.rank} of {len(result.names)}.', more),
        *residual_sections(data),
        _alignment(document['polar_axis']),
        _compared(document, names),
        page.folded_section('Excluded rows', exclusions(document['excluded'], limit=40)),
        page.folded_section('Notes', page.sentence_list(document['notes'])),
        provenance_section([
            ('site', site_text(site_degrees(run.meta))), ('mount', run.mount.kind),
            ('encoder', {'enc': 'incremental', 'abs': 'absolute'}.get(encoder, encoder))],
            [source] if source else ()),
        page.FOOTER, _preview(found, data, source)]
    return whole(f'Fit: {headline}', body, 'Fit of a pointing model')


def _residuals(found):
    run, result = found.run, found.terms
    before = np.array(run.offsets(found.encoder)) / ARCSEC
    after = np.array([result.residual_x, result.residual_y] if found.plain is result.model
                     else found.plain.residuals(run, found.encoder)) / ARCSEC
    words = np.where(result.weights > 0.0, 'used', '').astype(object)
    far = np.hypot(*after)
    for i in np.flatnonzero(~(result.weights > 0.0)):
        words[i] = f'rejected: an outlier, {far[i]:.1f}″ off' if np.isfinite(far[i]) else 'excluded'
    for one in result.excluded:
        words[one['row']] = f'excluded: {one["reason"]}'
    stars = run.columns.get('star')
    row = 'row' if run.meta.get('lines') is None else 'line'
    return run_residuals(
        run, [f'{row} {line}' for line in run.lines] if stars is None else
        list(map(group_name, stars)), before, after, result.weights > 0.0, words,
        noise=tuple(float(v) / ARCSEC for v in result.scatter),
        before_text='raw', after_text='model, fit residuals')


def _preview(found, data, source):
    """Data for a refit without excluded rows; None with harmonics or a predictive model."""
    linear = found.terms.linear
    if linear is None or found.plain is not found.terms.model:
        return None
    return preview(data, [('before', None, []), ('after', linear, list(linear.names))],
                   found.run.lines, 'fit', source)


def _alignment(found):
    """Section on polar alignment of an equatorial mount."""
    return None if not found else page.section(
        'The way back to the bolts', page.sentence_list(alignment_lines(found)),
        'From the exact azimuth and altitude of the axis, for a level base; after a turn '
        'measure again. The stars need their refraction, or the altitude is that of another pole.')


def _compared(document, names):
    """Table comparing the requested models, fitted and cross-validated."""
    rows = [('raw', 'fit residuals', *_rms(document['before'])),
            ('the terms', 'fit residuals', *_rms(document['after']))]
    if document['after'].get('cv_rms_arcsec') is not None:
        rows.append(('the terms', VALIDATED, *_rms(document['after'], 'cv_')))
    predicted, more = document.get('predicted'), []
    if predicted:
        rows += [(name, judged, *_rms(predicted[key], 'cv_')) for judged, before, after in (
                     ('cross-validated in blocks of time', 'blocks_before', 'blocks'),
                     ('cross-validated, random folds', 'before', 'after'))
                 for name, key in (('the terms', before), ('to predict', after))]
        rows.append(('to predict', 'all rows', *_rms(predicted)))
        more = [
            [page.paragraph(f'{note}.') for note in predicted['notes']],
            page.folded('Parts of the prediction', page.table(
                ('part', 'coefficients', 'RMS on these stars ″'),
                [(readable(row['name']), str(row['columns']), page.number(row['rms_arcsec'], 2))
                 for row in predicted['parts']], 'numbers')),
            page.folded('Coefficients of the prediction', page.table(
                ('coefficient', 'value ″', 'σ ″'),
                [(readable(row['name']), page.number(row['value_arcsec'], 2, True),
                  page.number(row['sigma_arcsec'], 2)) for row in predicted['coefficients']
                 if row['value_arcsec']], 'numbers'))]
    harmonics = document.get('harmonics')
    if harmonics:
        rows.append((harmonics['label'], 'fit residuals', *(
            page.number(harmonics['fitted'].get(key)) for key in ('x', 'y', 'radial'))))
    return page.folded_section('Models compared', [page.table(
        ('model', 'on', f'{names[0]} ″', f'{names[1]} ″', 'radial ″'), rows, 'numbers'), more],
        'RMS on the sky, arcsec.')


def _rms(entry, before=''):
    return [page.number(entry.get(f'{before}rms_{part}arcsec')) for part in ('x_', 'y_', '')]
