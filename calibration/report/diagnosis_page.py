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

"""The page of a diagnosis: one HTML file for offline use and printing."""

from pointing_model.mount_kinds import kind_of

from . import diagnosis_sections as tables
from . import page_parts as page
from .diagnosis_wording import limit_rows
from .driver_figures import drivers_section, effects_section, largest_effect
from .error_ranking import errors_section
from .figure_wording import model_words
from .observation_wording import proposal_groups
from .page_html import whole
from .provenance import provenance_section
from .refit_preview import preview
from .residual_figures import controls, histograms, sky_maps
from .star_table import stars_table
from .target_plot import targets
from .terms_section import correlation_table, run_terms_table, terms_page_table


def render(view, files=None):
    """The page as text: self-contained HTML that is also well-formed XML.

    Parameters
    ----------
    view : DiagnosisView
    files : iterable of Path, optional
        Input files, listed with their checksums.

    Returns
    -------
    str
    """
    document, kind = view.document, kind_of(view.document)
    summary = view.summary
    data = view.residuals
    title = 'Pointing diagnosis' + f': {view.about}' * bool(view.about)
    return whole(f'{title} ({view.word})', [
        page.heading(title), page.paragraph(view.meta, 'meta'), controls(data),
        page.verdict_section(summary.headline, [
            page.cards(summary.numbers),
            page.paragraph(summary.numbers and f'RMS on the sky, {summary.validation}.', 'note'),
            sky_maps(data, largest_effect(view))], view.badge[1], view.badge[0]),
        errors_section(summary.effects, page.sentence_list([*summary.cautions, summary.todo]),
                       'Largest errors' if summary.effects else 'Cautions and limits'),
        page.section('Outliers', tables.outliers(document)),
        page.folded_section('Evidence', [tables.evidence(view), page.table(
            ('error', 'limit'), limit_rows(document), 'numbers', 'Detection limits')]),
        page.folded_section('RMS', [tables.gain_bars(view), tables.held_out(document, data.axes)]),
        effects_section(view),
        page.folded_section('Next observations', tables.next_observations(
            proposal_groups(document), kind, data.grid)),
        drivers_section(view),
        page.folded_section('Target', targets(data)),
        page.folded_section('Histograms', histograms(data)),
        page.folded_section('Candidate effects', tables.ranking(view.ranking),
                            f'Each alone, beside {model_words(document, whose=False)}.'),
        page.folded_section('Terms', [
            terms_page_table(view.terms), run_terms_table(view.run_terms),
            correlation_table(view.correlated, view.correlations)],
            f'Encoder − catalogue. {_tpoint_signs(kind)}'),
        page.folded_section('Stars', stars_table(data)),
        page.folded_section('Notes on the data',
                            page.sentence_list([*view.page_notes, *view.signs])),
        page.folded_section('Excluded rows', tables.exclusions(
            document.get('excluded') or (), document.get('rows_are') or 'row')),
        page.folded_section('Not testable', tables.untestable(view.untestable)),
        None if files is None else provenance_section([], files),
        page.footer(f'Encoder − catalogue, {data.axes[0]}, arcsec on the sky.'),
        preview(data, view.fits, view.lines, 'diagnose', view.file) if view.fits else None,
    ], 'Pointing diagnosis of a telescope mount')


def _tpoint_signs(kind):
    """Terms with the opposite sign in TPOINT."""
    terms = ('IE' if kind.vertical else 'the terms of both axes' if kind.celestial else None)
    return f'TPOINT: {terms} with the opposite sign.' if terms else ''
