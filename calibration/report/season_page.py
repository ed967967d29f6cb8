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

"""The page of a season: each term night by night, causes of changes, prediction for tonight."""


import numpy as np

from msg_tools.units import ARCSEC

from ..analysis.season.season_nights import date_of
from . import page_parts as page
from .cause_wording import counted
from .drawing import Panel, padded, svg, text
from .number_wording import number
from .page_html import whole
from .provenance import provenance_section
from .season_wording import cause_rows
from .wording import worded

_YEAR = 365.25 * 86400.0
_WIDTH, _HEIGHT = 940, 190
_MOST = 6  # number of causes not folded away


def render_season(result, files):
    """The page as text.

    Parameters
    ----------
    result : season_analysis.SeasonAnalysis
    files : iterable of Path
        Input files.

    Returns
    -------
    str
    """
    document, season = worded(result.document()), result.season
    first, last = (date_of(season.nights[i].time) for i in (0, -1))
    causes = cause_rows(result.findings(), season.mount)
    headline = (f'{counted(len(causes), "change")} found. Largest: {" ".join(causes[0][:2])}, '
                f'{causes[0][2]}.' if causes else 'The terms drift; no change has a cause.')
    largest = season.names.index(causes[0][0]) if causes else 0
    rms = np.median([night['rms_arcsec'] for night in document['nights']])
    others = [i for i in range(len(season.names)) if i != largest]
    body = [
        page.heading('Season of a mount'),
        page.paragraph(f'{len(season.nights)} nights from {first} to {last}, terms '
                       f'{", ".join(season.names)}', 'meta'),
        page.verdict_section(f'{headline[:1].upper()}{headline[1:]}', [
            page.cards([(f'{len(season.nights)}', 'nights'),
                        (f'{len(causes)}', f'change{"s" * (len(causes) != 1)}'),
                        (f'{rms:.2f}″', 'RMS of fit residuals, median night')]),
            _legend(bool(causes)), _figure(result, largest)], kind='' if causes else 'none'),
        page.section('Largest changes', [_causes(causes[:_MOST]), page.folded(
            f'And {len(causes) - _MOST} smaller', _causes(causes[_MOST:]))]),
        page.section(f'Predicted terms for {document["tonight"]["time"]}', _tonight(document)),
        page.folded_section('Other terms', [_legend(bool(causes)), *(
            _figure(result, i) for i in others)]),
        page.folded_section('Nights', _nights(document),
                            'RMS: fit of that night. Off: the term farthest from its prediction.'),
        page.folded_section('Notes', page.sentence_list(document['notes'])),
        provenance_section([], files),
        page.footer('Terms in arcsec, ± 1 σ.')]
    return whole(f'Season of a mount: {headline}', body, 'Season of a telescope mount')


def _causes(rows):
    return page.table(('term', 'change', 'when, or with', 'likely cause', 'check first'), rows,
                      'folding stack')


def _tonight(document):
    predicted, drift = document['tonight'], document['wander']
    return page.table(('term', 'predicted ″', 'σ ″', 'random walk, ″/√day',
                       'scatter from night to night ″'),
                      [(name, page.number(predicted['terms_arcsec'][name], 1, True),
                        page.number(predicted['sigma_arcsec'][name], 1),
                        page.number(drift[name]['walk_arcsec_per_root_day'], 2),
                        page.number(drift[name]['night_arcsec'], 1)) for name in document['terms']],
                      'numbers')


def _legend(steps):
    return page.legend((('before', 'fit of the night ± 1 σ'), ('level', 'level, smoothed ± 2 σ'),
                        ('fit', 'step, and prediction ± 1 σ' if steps else 'prediction ± 1 σ')))


def _figure(result, i):
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
    years_alone = tonight - years[0] > 2.0
    shown = (np.arange(np.ceil(years[0]), np.floor(tonight) + 1.0) if years_alone
             else np.linspace(years[0], tonight, 5))
    panel.axes('1 January' if years_alone else 'date', f'{name}, arcsec', '', shown,
               [f'{v:.0f}' if years_alone else date_of((v - 1970.0) * _YEAR) for v in shown])
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
    label = f'{name} night by night: {number(predicted, 1)} ± {number(spread, 1)} arcsec predicted'
    return page.figure(page.block(svg(_WIDTH, _HEIGHT, [
        *panel.parts, text(panel.left, 14, name, 'title', 'start')], label), 'scroll'))


def _nights(document):
    rows = []
    for night in document['nights']:
        off = {k: v for k, v in night['off_foretold_sigmas'].items() if v is not None}
        worst = max(off, key=lambda name: abs(off[name])) if off else None
        rows.append((night['time'].replace('T', ' ')[:16], night['source'], night['rows'],
                     page.number(night['rms_arcsec']),
                     f'{worst} {number(off[worst], 1, True)} σ' if worst else None,
                     *(page.number(night['terms_arcsec'][name], 1, True)
                       for name in document['terms'])))
    return page.table(('UTC', 'run', 'rows', 'RMS ″', 'off', *document['terms']), rows,
                      'nights numbers')
