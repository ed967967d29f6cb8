"""The page of a season: each term night by night, what moved it, what tonight's will be."""


import numpy as np

from msg_tools.units import ARCSEC

from ..analysis.season.season_analysis import date_of
from .drawing import Panel, clean, padded, svg, text
from .page_parts import figure, legend, listed, number, scrolled, section, table, verdict, whole
from .provenance import provenance_section
from .wording import worded

_YEAR = 365.25 * 86400.0
_WIDTH, _HEIGHT = 940, 190


def render_season(result, files):
    """The page as text.

    Parameters
    ----------
    result : season_analysis.SeasonAnalysis
    files : iterable of Path
        From which it is made.

    Returns
    -------
    str
    """
    document, season = worded(result.document()), result.season
    first, last = (date_of(season.nights[i].time) for i in (0, -1))
    sentences = worded(result.findings())
    headline = (f'{len(sentences)} cause{"s" * (len(sentences) != 1)} found' if sentences else
                'Nothing moves the terms beyond their own wander')
    body = [
        '<h1>Season of a mount</h1>',
        f'<p class="meta">{len(season.nights)} nights from {first} to {last}, terms '
        f'{clean(", ".join(season.names))}</p>',
        verdict('', headline, sentences, kind='' if sentences else 'none'),
        section(f'Foretold for {document["tonight"]["time"]}, before its first star',
                _tonight(document)),
        section('Terms night by night', _legend(bool(sentences)), *(
            figure(scrolled(_panel(result, i)), '') for i in range(len(season.names)))),
        section('Nights', _nights(document),
                note='RMS of what the night’s own fit leaves. Off: the term that lay '
                'farthest from what the nights before it say, with the causes that all nights '
                'together show.'),
        section('Notes', listed(document['notes'])), provenance_section([], files),
        '<footer>Terms in arcsec with 1 σ. The level wanders from night to night; each night is '
        'off it by what is of that night alone and by the error of its fit.</footer>']
    return whole(f'Season of a mount: {headline}', body, 'Season of a telescope mount')


def _tonight(document):
    predicted, drift = document['tonight'], document['wander']
    return table(('term', 'foretold ″', '± ″', 'wanders by ″ per √day',
                  'scatter from night to night ± ″'),
                 [(name, number(predicted['terms_arcsec'][name], 1, True),
                   number(predicted['sigma_arcsec'][name], 1),
                   number(drift[name]['walk_arcsec_per_root_day'], 2),
                   number(drift[name]['night_arcsec'], 1)) for name in document['terms']],
                 'numbers')


def _legend(steps):
    return legend(('before', 'fit of the night ± 1 σ'), ('level', 'level in hindsight ± 2 σ'),
                  ('fit', 'step, and the night to come ± 1 σ' if steps else
                   'the night to come ± 1 σ'))


def _panel(result, i):
    season, seen = result.season, result.path
    name = season.names[i]
    time = np.array([night.time for night in season.nights])
    values = np.array([night.values[i] for night in season.nights]) / ARCSEC
    sigma = np.sqrt([night.covariance[i, i] for night in season.nights]) / ARCSEC
    level = seen.levels[:, i] / ARCSEC
    wide = 2.0 * np.sqrt(np.maximum(seen.covariances[:, i, i], 0.0)) / ARCSEC
    years = 1970.0 + time / _YEAR
    tonight, predicted = 1970.0 + result.tonight / _YEAR, result.mean[i] / ARCSEC
    spread = np.sqrt(result.covariance[i, i]) / ARCSEC
    reach = [predicted - spread, predicted, predicted + spread]
    ends = np.concatenate([values, level - wide, level + wide, reach])
    panel = Panel((64, 22, _WIDTH - 84, _HEIGHT - 62), padded([years[0], tonight], 0.02, 0.02),
                  padded(ends, 0.06, 1.0))
    whole = tonight - years[0] > 2.0
    shown = (np.arange(np.ceil(years[0]), np.floor(tonight) + 1.0) if whole
             else np.linspace(years[0], tonight, 5))
    panel.axes('1 January' if whole else 'date', f'{name}, arcsec', '', shown,
               [f'{v:.0f}' if whole else date_of((v - 1970.0) * _YEAR) for v in shown])
    x = panel.x(years)
    panel.band(years, level - wide, level + wide)
    panel.line(years, level, 'level')
    panel.parts.append('<path class="error" d="' + ''.join(
        f'M{a:.1f} {b:.1f}V{c:.1f}' for a, b, c in zip(
            x, panel.y(np.clip(values - sigma, *panel.y_range)),
            panel.y(np.clip(values + sigma, *panel.y_range)))) + '"/>')
    panel.points(years, values, 'before', [
        f'{date_of(t)}: {v:.1f} ± {s:.1f}' for t, v, s in zip(time, values, sigma)])
    for found in result.causes:
        if i in found.cause.terms and found.cause.kind in ('step', 'declared'):
            at = int(np.argmax(found.cause.shape[:, 0]))
            middle = float(panel.x(0.5 * (years[at - 1] + years[at])))
            panel.parts.append(f'<path class="step" d="M{middle:.1f} {panel.top}v'
                               f'{panel.height}"/>')
    a, b, c = (float(panel.y(v)) for v in reach)
    at = float(panel.x(tonight))
    panel.parts.append(f'<path class="tonight" d="M{at:.1f} {a:.1f}V{c:.1f}M{at - 4:.1f} '
                       f'{b:.1f}h8"/>')
    label = f'{name} night by night: {number(predicted, 1)} ± {number(spread, 1)} arcsec foretold'
    return svg(_WIDTH, _HEIGHT, [*panel.parts, text(panel.left, 14, name, 'title', 'start')],
               label)


def _nights(document):
    rows = []
    for night in document['nights']:
        off = {k: v for k, v in night['off_foretold_sigmas'].items() if v is not None}
        worst = max(off, key=lambda name: abs(off[name])) if off else None
        rows.append((night['time'].replace('T', ' ')[:16], night['source'], night['rows'],
                     number(night['rms_arcsec']),
                     f'{worst} {number(off[worst], 1, True)} σ' if worst else None,
                     *(number(night['terms_arcsec'][name], 1, True) for name in document['terms'])))
    return table(('UTC', 'run', 'rows', 'RMS ″', 'off', *document['terms']), rows, 'nights numbers')
