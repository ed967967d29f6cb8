"""The page of a diagnosis: one HTML file that opens from disk, offline, and prints."""

from dataclasses import replace

from calibration.report.row_wording import used_sentence
from msg_tools.output import write_text
from pointing_model.mount_kinds import kind_of

from . import diagnosis_sections as page
from . import page_parts as html
from .cause_wording import counted, open_causes
from .diagnosis_view import view_of
from .drawing import clean
from .figure_wording import FITTED, STAYS, best_pair, floor_words, model_words, way_size
from .observation_wording import causes_of, no_star_sentences, proposals, serves_sentence
from .provenance import provenance_section
from .residual_figures import controls, histograms, sky_maps, targets
from .star_table import stars_table
from .term_table import correlation_table, terms_table
from .verdict_wording import count_sentence, led, verdict_summary
from .wording import Statement

_VERDICTS = {'none': 'nothing missing', 'wanders': 'the zero wanders', 'undecided': 'undecided',
             'identified': 'cause identified', 'ambiguous': 'found; the cause is open',
             'unknown': 'cause unknown', 'refused': 'nothing concluded',
             'withheld': 'not published', 'taken_back': 'taken back'}


def write_report(diagnosis, path, files=None):
    """Write the page of a diagnosis.

    Parameters
    ----------
    diagnosis : calibration.analysis.diagnosis.Diagnosis
    path : str or Path
        HTML file to write; it refers to nothing outside itself.
    files : iterable of Path, optional
        From which it is made: where it comes from is told with their sums.

    Raises
    ------
    OSError
        It cannot be written.
    """
    made = '' if files is None else provenance_section([], files)
    write_text(path, render(view_of(diagnosis), made))


def render(view, more=''):
    """The page as text: HTML that is well-formed XML too.

    Parameters
    ----------
    view : View
    more : str
        HTML at the end.

    Returns
    -------
    str
    """
    document, data = view.document, view.residuals
    title = 'Pointing diagnosis' + f': {view.about}' * bool(view.about)
    body = [
        f'<h1>{clean(title)}</h1>', _meta(view), controls(data), _verdict(view),
        html.section('Error before and after', page.gain_bars(document, data.axes),
                     page.held_out(document, data.axes)),
        html.section('Where the residuals are on the sky', sky_maps(data)),
        html.section('Target', targets(data)),
        _effects(view),
        html.section('What to observe next', page.next_observations(
            proposals(document), data.mount,
            causes_of(document)), html.paragraph(serves_sentence(document)),
            *map(html.paragraph, no_star_sentences(document)),
            note='Observations that would best tell causes apart. They are no lower than the rows: '
                 'where the mount may go lower, stars there tell more of what follows the '
                 'elevation.'),
        html.section('Notes on the data', html.listed(view.notes)),
        html.section('Residual against each driver', page.legend(view.changed),
                     page.driver_figures(view), note=view.axes_note),
        html.section('Ranking of the candidate effects', page.ranking(
            view.ranking, (document.get('wander') or {}).get('like', ())),
                     note=f'Each alone, on what {model_words(document, whose=False)} leave.'),
        html.section('Distribution of the residuals', histograms(data)),
        html.section('Terms of the model', terms_table(view.terms),
                     page.run_terms_table(view.run_terms),
                     html.folded('Correlations of the terms',
                            correlation_table(view.correlated, view.correlations)),
                     note='Encoder − catalogue, σ from the fit, each axis weighed by its own '
                     'scatter; `fit` weighs both alike and has no effects, so its terms may '
                     f'differ. {_tpoint_signs(document)}'),
        html.section('Stars', stars_table(data), note='Point at a star: it lights up everywhere.'),
        html.section('What was left out, and why', page.exclusions(
            document.get('excluded') or (), document.get('rows_are') or 'row')
            or html.paragraph('Nothing was left out.')),
        html.section('What these observations cannot show', page.untestable(view.untestable)),
        more,
        f'<footer>All offsets are encoder − catalogue, {_offsets(view)}, in seconds of '
        'arc on the sky (arcsec, ″). RMS values are radial unless an axis is named.</footer>',
    ]
    return html.whole(f'{title} ({_VERDICTS.get(document["verdict"], document["verdict"])})', body,
                      'Pointing diagnosis of a telescope mount')


def _meta(view):
    document = view.document
    runs = document.get('runs')
    runs = len(runs) if isinstance(runs, (list, tuple)) else runs
    text = used_sentence(document) if 'rows_read' in document \
        else f'{document["observations"]} observations'
    if runs and runs > 1:
        text += f' in {runs} runs'
    sources = view.sources[:3] + ([f'and {len(view.sources) - 3} more'] if len(view.sources) > 3
                                  else [])
    if sources:
        text += ' · ' + ', '.join(sources)
    base = document.get('base_terms') or []
    text += f' · model: {model_words(document)}' + (
        f' ({", ".join(map(str, base))})' if base else '')
    return html.paragraph(text, 'meta')


def _verdict(view):
    document = view.document
    name = document['verdict']
    found = verdict_summary(document, [e.summary for e in view.effects], caution=view.caution)
    badge = name
    if view.effects and name in ('ambiguous', 'identified'):
        badge = 'ambiguous' if any(
            open_causes(row) > 1 for row in document['effects']) else 'identified'
    headline, _, then = found.headline.partition('. ')
    first, ranked = found.first, found.ranked
    if ranked and ranked[0].more and headline.startswith(ranked[0].lead[:-1]):
        # what the headline has said is not said again
        first = [one for one in first if one.text != count_sentence(document)]
        ranked = [led(ranked[0].more) if len(ranked) == 1 else replace(
            ranked[0], lead=f'{view.effects[0].name}.'), *ranked[1:]]
    return html.verdict(
        _VERDICTS.get(badge, badge), headline, [], html.cards(_numbers(document)),
        badge if badge in _VERDICTS else '',
        page.words(' '.join((found.headline, *found.sentences, floor_words(document)))),
        html.statements(first) + html.statements(ranked, True)
        + html.folded(f'And {len(found.smaller)} more, smaller', html.statements(found.smaller))
        + html.statements([Statement(found.raw)] if found.raw else [])
        + html.statements(found.rest), then)


def _numbers(document):
    """What the large numbers say."""
    label, before, after = best_pair(document)
    read, stays = document.get('as_read_rms_arcsec'), document['verdict'] in STAYS
    quote = '' if label == FITTED else ': quote this'
    effects = counted(len(document['effects']), 'effect')
    numbers = [(read and way_size(read), 'as the encoders read'),
               (before, f'with {model_words(document, whose=False)}, {label}{quote * stays}')]
    if not stays:
        numbers.append((after, f'with {effects} more, {label}{quote}'))
    return numbers


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
            effect.name, html.paragraph(effect.summary.text),
            f'<div class="{kind}">{html.definitions(effect.facts)}{drawing}</div>',
            page.alternatives(effect.ranking)))
    parts.append(page.words(' '.join(f'{e.name} {e.summary.text}' for e in view.effects)))
    return html.section('What was added to the model', *parts, note=' '.join(filter(None, [
        'In the order of what each takes off.' if len(parts) > 2 else '', view.axes_note])))


def _offsets(view):
    first, second = (name.partition(' × ')[0] for name in view.residuals.axes)
    return f'{first} times cos {second}'
