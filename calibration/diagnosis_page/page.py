"""The page of a diagnosis: one HTML file that opens from disk, offline, and prints."""

from pathlib import Path

from calibration.diagnosis.rows_told import used_sentence
from pointing_model.effects.base import arcsec

from . import sections as page
from .plain_words import best_pair, floor_words, verdict_sentences
from .style import CSS
from .svg_plot import clean
from .view import view_of

_VERDICTS = {'none': 'nothing missing', 'wanders': 'the zero wanders', 'undecided': 'undecided',
             'identified': 'cause identified', 'ambiguous': 'cause ambiguous',
             'unknown': 'cause unknown', 'refused': 'nothing concluded',
             'withheld': 'not published', 'taken_back': 'taken back'}
#: of these the model stays as it was
_STAYS = ('none', 'wanders', 'undecided', 'refused', 'withheld', 'taken_back')


def write_report(diagnosis, path):
    """Write the page of a diagnosis.

    Parameters
    ----------
    diagnosis : calibration.diagnosis.Diagnosis
    path : str or Path
        HTML file to write; it refers to nothing outside itself.

    Raises
    ------
    OSError
        It cannot be written.
    """
    Path(path).write_text(render(view_of(diagnosis)), encoding='utf-8')


def render(view):
    """The page as text: HTML that is well-formed XML too.

    Parameters
    ----------
    view : View

    Returns
    -------
    str
    """
    document = view.document
    title = 'Pointing diagnosis'
    body = [
        f'<h1>{title}</h1>', _meta(view), _verdict(view),
        page.section('Where the residuals are on the sky', page.sky_maps(view)),
        _effects(view),
        page.section('Residual against each driver', page.legend(view.changed),
                     page.driver_figures(view)),
        page.section('Ranking of the candidate effects',
                     page.ranking(view.ranking, view.set_width),
                     note='Each alone, on what the declared model leaves.'),
        page.section('Distribution of the residuals', page.histograms(view)),
        page.section('Terms of the model', page.terms_table(view.terms),
                     page.run_terms_table(view.run_terms),
                     page.correlation_table(view.correlated, view.correlations),
                     note='Encoder − catalogue, σ from the fit.'),
        page.section('What was left out, and why', page.exclusions(document.get('excluded'))),
        page.section('What to observe next', page.next_observations(
            document.get('next_observations') or [], document.get('mount') or 'altaz'),
            note='Observations that would best tell the members of the set apart.'),
        page.section('What these observations cannot show', page.untestable(view.untestable)),
        page.section('Notes on the data', _list(view.notes)),
        f'<footer>All offsets are encoder − catalogue, {_offsets(view)}, in seconds of '
        'arc on the sky (arcsec, ″). RMS values are radial unless an axis is named.</footer>',
    ]
    return ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"/>'
            '<meta name="viewport" content="width=device-width, initial-scale=1"/>'
            f'<title>{title}: {clean(_VERDICTS.get(document["verdict"], document["verdict"]))}'
            f'</title><style>{CSS}</style></head><body><main>\n' + '\n'.join(b for b in body if b)
            + '\n</main></body></html>\n')


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
    text += f' · declared model: {", ".join(map(str, base)) if base else "none"}'
    return f'<p class="meta">{clean(text)}</p>'


def _verdict(view):
    document = view.document
    verdict = document['verdict']
    headline, sentences = verdict_sentences(document, [e.sentence for e in view.effects],
                                            caution=view.caution)
    label, before, after = best_pair(document)
    cards = []
    for value, text in ((before, f'before, {label}'), (after, f'after, {label}'),
                        (document.get('noise_floor_arcsec'), floor_words(document))):
        if value is not None and not (verdict in _STAYS and text.startswith('after')):
            cards.append(f'<div><b>{arcsec(value)}</b><span>{clean(text)}</span></div>')
    told = document.get('expected')
    if told:
        cards.append(f'<div><b>{arcsec(told["rms_arcsec"])}</b><span>expected on fresh stars, '
                     f'{arcsec(told["low_arcsec"])} to {arcsec(told["high_arcsec"])}</span></div>')
    kind = verdict if verdict in _VERDICTS else ''
    return (f'<section class="verdict {kind}"><span class="badge">'
            f'{clean(_VERDICTS.get(verdict, verdict))}</span><h2>{clean(headline)}</h2>'
            f'{_list(sentences)}<div class="numbers-row">{"".join(cards)}</div></section>'
            + page.section('Error before and after', page.gain_bars(document, view.axes)))


def _effects(view):
    parts = []
    for effect in view.effects:
        facts = ''.join(f'<dt>{clean(name)}</dt><dd>{clean(text)}</dd>'
                        for name, text in effect.facts)
        drawing = page.effect_figure(view, effect)
        kind = 'effect one' if drawing.count('<svg') == 1 else 'effect'
        parts.append(f'<h3>{clean(effect.name)}</h3><p>{clean(effect.sentence)}</p>'
                     f'<div class="{kind}"><dl>{facts}</dl>{drawing}</div>'
                     f'{page.rivals(effect.ranking)}')
    return page.section('What was added to the model', *parts)


def _list(texts):
    items = ''.join(f'<li>{clean(text)}</li>' for text in texts)
    return f'<ul>{items}</ul>' if items else ''


def _offsets(view):
    first, second = (name.partition(' × ')[0] for name in view.axes)
    return f'{first} times cos {second}'
