"""The page of a diagnosis: one HTML file that opens from disk, offline, and prints."""

from pointing_model.effects.base import arcsec
from pointing_model.mount_kinds import kind_of

from . import diagnosis_sections as page
from . import page_parts as html
from .diagnosis_summary import MOST_EFFECTS
from .drawing import clean
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
        f'<h1>{clean(title)}</h1>', html.paragraph(view.meta, 'meta'), _summary(view),
        controls(data),
        html.section('Residuals on the sky', sky_maps(data)),
        html.section('Outliers', page.outliers(document)),
        html.folded_section('Verdict in full', _verdict(view)),
        html.folded_section('Error before and after', page.gain_bars(view),
                            page.held_out(document, data.axes)),
        html.folded_section('Target', targets(data)),
        html.folded_section(
            'Next observations', page.next_observations(view.proposals, data.mount),
            html.paragraph(view.serves), *map(html.paragraph, view.no_star.values()),
            note='Observations that would best tell causes apart. They are no lower than the rows: '
                 'where the mount may go lower, stars there tell more of what follows the '
                 'elevation.'),
        _effects(view),
        html.folded_section('Notes on the data', html.listed(
            [*view.notes, *view.page_notes, *view.signs])),
        html.folded_section('Residuals by driver', page.legend(view.changed),
                            page.driver_figures(view), note=view.axes_note),
        html.folded_section('Candidate effects', page.ranking(
            view.ranking, (document.get('wander') or {}).get('like', ())),
                            note=f'Each alone, on what {view.model} leave.'),
        html.folded_section('Histograms', histograms(data)),
        html.folded_section(
            'Terms', terms_table(view.terms), page.run_terms_table(view.run_terms),
            html.folded('Correlations of the terms',
                        correlation_table(view.correlated, view.correlations)),
            note='Encoder − catalogue, σ from the fit, each axis weighed by its own scatter; '
            '`fit` weighs both alike and has no effects, so its terms may differ. '
            f'{_tpoint_signs(document)}'),
        html.folded_section('Stars', stars_table(data),
                            note='Point at a star: it lights up everywhere.'),
        html.folded_section('Excluded rows', page.exclusions(
            document.get('excluded') or (), document.get('rows_are') or 'row')
            or html.paragraph('No row was excluded.')),
        html.folded_section('Not testable in this run',
                            page.untestable(view.untestable)),
        '' if files is None else provenance_section([], files),
        f'<footer>Offsets: encoder − catalogue, {_offsets(view)}, arcsec on the sky.</footer>',
        preview(data, view.fits, view.lines, 'diagnose', view.file) if view.fits else '',
    ]
    return html.whole(f'{title} ({view.word})', body,
                      'Pointing diagnosis of a telescope mount')


def _summary(view):
    """What is read in five seconds, and in a minute."""
    summary = view.summary
    return html.verdict(
        view.badge[1], summary.headline, [], html.cards(summary.numbers), view.badge[0],
        html.listed([*summary.cautions, summary.todo]),
        html.paragraph(f'RMS on the sky, {summary.validation}.' * bool(summary.numbers), 'note')
        + _effect_table(summary.effects[:MOST_EFFECTS])
        + html.folded(f'And {len(summary.effects) - MOST_EFFECTS} smaller',
                      _effect_table(summary.effects, MOST_EFFECTS)))


def _effect_table(effects, first=0):
    """The ranked table of effects, from the one that is to come first."""
    return html.table(
        ('', 'effect', 'peak to peak', 'RMS removed', 'likely causes', 'check first'),
        ((str(i), one.name, _size(one.reach_arcsec), _size(one.removes_arcsec), one.causes_text,
          one.check) for i, one in list(enumerate(effects, 1))[first:]), 'folding stack')


def _size(value):
    return None if value is None else arcsec(value)


def _verdict(view):
    """All that is to be said, in sentences."""
    found = view.verdict
    return (html.paragraph(found.headline) + html.statements(found.first)
            + html.statements(found.ranked, True)
            + html.folded(f'And {len(found.smaller)} more, smaller',
                          html.statements(found.smaller))
            + html.listed([found.raw]) + html.statements(found.rest) + page.words(view.said))


def _tpoint_signs(document):
    """Which signs of another program are the other way round."""
    kind = kind_of(document)
    terms = ('IE' if kind.vertical else 'the terms of both axes' if kind.celestial else None)
    return f'TPOINT writes {terms} with the opposite sign, which `export --to tpoint` sees to.' \
        if terms else ''


def _effects(view):
    parts = []
    for effect in view.effects:
        drawing = page.effect_figure(view, effect)
        kind = 'effect one' if drawing.count('<svg') == 1 else 'effect'
        parts.append(html.subsection(
            effect.name, html.paragraph(effect.text),
            f'<div class="{kind}">{html.definitions(effect.facts)}{drawing}</div>',
            page.alternatives(effect.ranking)))
    parts.append(page.words(' '.join(f'{e.name} {e.text}' for e in view.effects)))
    return html.folded_section('Effects in detail', *parts, note=' '.join(filter(None, [
        'By RMS removed.' if len(parts) > 2 else '', view.axes_note])))


def _offsets(view):
    first, second = (name.partition(' × ')[0] for name in view.residuals.axes)
    return f'{first} times cos {second}'
