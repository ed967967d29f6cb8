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

"""The page of a diagnosis: one HTML file that opens from disk, offline, and prints."""

from pointing_model.mount_kinds import kind_of

from . import diagnosis_sections as page
from . import page_parts as html
from .drawing import clean
from .error_table import MOST_ERRORS, errors_section
from .provenance import provenance_section
from .refit_preview import preview
from .residual_figures import controls, histograms, sky_maps, targets
from .star_table import stars_table
from .terms_section import correlation_table, terms_table


def render(view, files=None):
    """The page as text: HTML that is well-formed XML too; it refers to nothing outside itself.

    Parameters
    ----------
    view : DiagnosisView
    files : iterable of Path, optional
        From which it is made: where it comes from is told with their sums.

    Returns
    -------
    str
    """
    document, data = view.document, view.residuals
    title = 'Pointing diagnosis' + f': {view.about}' * bool(view.about)
    body = [
        f'<h1>{clean(title)}</h1>', html.paragraph(view.meta, 'meta'), controls(data),
        *_summary(view),
        html.section('Outliers', page.outliers(document)),
        html.folded_section('Evidence', page.evidence(view), page.detection_limits(document)),
        html.folded_section('RMS', page.gain_bars(view),
                            page.held_out(document, data.axes)),
        _effects(view),
        html.folded_section('Next observations', page.next_observations(
            view.proposals, data.mount)),
        html.folded_section('Residuals by driver', page.legend(view.changed),
                            page.driver_figures(view),
                            note='' if view.effects else view.axes_note),
        html.folded_section('Target', targets(data)),
        html.folded_section('Histograms', histograms(data)),
        html.folded_section('Candidate effects', page.ranking(
            view.ranking, (document.get('wander') or {}).get('like', ())),
                            note=f'Each alone, beside {view.model}.'),
        html.folded_section(
            'Terms', terms_table(view.terms), page.run_terms_table(view.run_terms),
            correlation_table(view.correlated, view.correlations),
            note=f'Encoder − catalogue. {_tpoint_signs(document)}'),
        html.folded_section('Stars', stars_table(data)),
        html.folded_section('Notes on the data', html.listed(
            [*view.page_notes, *view.signs])),
        html.folded_section('Excluded rows', page.exclusions(
            document.get('excluded') or (), document.get('rows_are') or 'row')),
        html.folded_section('Not testable', page.untestable(view.untestable)),
        '' if files is None else provenance_section([], files),
        f'<footer>Encoder − catalogue, {data.axes[0]}, arcsec on the sky.</footer>',
        preview(data, view.fits, view.lines, 'diagnose', view.file) if view.fits else '',
    ]
    return html.whole(f'{title} ({view.word})', body,
                      'Pointing diagnosis of a telescope mount')


def _summary(view):
    """What is read in five seconds; and in a minute."""
    summary = view.summary
    return (
        html.verdict(
            view.badge[1], summary.headline, [], html.cards(summary.numbers), view.badge[0],
            sky_maps(view.residuals),
            html.paragraph(f'RMS on the sky, {summary.validation}.' * bool(summary.numbers),
                           'note')),
        errors_section(
            summary.effects, html.listed([*summary.cautions, summary.todo]),
            title='Largest errors' if summary.effects else 'Cautions'))


def _tpoint_signs(document):
    """Which signs of another program are the other way round."""
    kind = kind_of(document)
    terms = ('IE' if kind.vertical else 'the terms of both axes' if kind.celestial else None)
    return f'TPOINT: {terms} with the opposite sign.' if terms else ''


def _effects(view):
    parts = []
    for effect in view.effects[:MOST_ERRORS]:
        drawing = page.effect_figure(view, effect)
        kind = 'effect one' if drawing.count('<svg') == 1 else 'effect'
        parts.append(html.subsection(
            effect.name, f'<div class="{kind}"><div>{page.causes(effect.causes)}'
            f'{html.definitions(effect.facts)}</div>{drawing}</div>'))
    left = len(view.effects) - MOST_ERRORS
    more = f'{left} smaller ones: in the JSON result.' if left > 0 else ''
    return html.folded_section('Effects', *parts, note=' '.join(
        filter(None, [view.axes_note, more])))
