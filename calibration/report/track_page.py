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

"""The page of a tracked run: errors in time, innovations, smoothed terms."""

from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.pointing_terms import term_cause, terms_of

from . import page_parts as page
from .drawing import Panel, padded, svg
from .error_ranking import ErrorLine, errors_section
from .page_html import whole
from .provenance import provenance_section
from .wording import worded

_WIDTH = 940
#: standard errors from which a term has moved, and from which a model is better
_CLEAR, _BETTER = 3.0, 2.0


def render_track(tracked, files):
    """The page as text.

    Parameters
    ----------
    tracked : run_track.TrackedRun
    files : iterable of Path
        Input files.

    Returns
    -------
    str
    """
    summary = worded(tracked.summary())
    missed = summary['missed_rms_arcsec']
    begin = datetime.fromtimestamp(tracked.time[0], timezone.utc)
    events = [(datetime.fromtimestamp(event['stamp'] * 1e-9, timezone.utc).strftime('%H:%M:%S'),
               event['star'], event['what'], f'{100.0 * event["chance"]:.0f} %')
              for event in tracked.smoothed.events]
    hours = (tracked.time - tracked.time[0]) / 3600.0
    seen = (tracked.smoothed.stamps * 1e-9 - tracked.time[0]) / 3600.0
    body = [
        page.heading('Adaptive model'),
        page.paragraph(f'{len(tracked.rows)} stars from {begin:%Y-%m-%d %H:%M} UTC on' + (
            f'; fixed model: the {tracked.fitted} stars before' if tracked.fitted else ''), 'meta'),
        page.verdict_section(
            f'Each star predicted: {missed["model of the evening"]:.2f}″ RMS by the fixed '
            f'model, {missed["tracked"]:.2f}″ by the adaptive model', [
                page.cards([(f'{missed[name]:.2f}″', text) for name, text in (
                    ('model of the evening', 'fixed model, RMS'),
                    ('tracked', 'adaptive model, RMS'),
                    ('expected', 'adaptive model, expected by its σ'))]),
                page.legend((('before', 'fixed model (dots)'),
                             ('after', 'adaptive, predicted (squares)'),
                             ('fit', 'expected, 1 σ'))),
                _misses(tracked, hours)]),
        _largest(tracked, missed, files),
        page.section('Jumps and wrong stars', page.table(
            ('UTC', 'from star', 'what jumped, or a wrong star', 'probability'), events)),
        page.folded_section('Filter', [
            page.sentence_list(tracking_lines(summary)),
            innovations_figure(np.sum((tracked.live / tracked.sigma)**2, axis=1))]),
        page.folded_section('Terms, smoothed', [_term(tracked, seen, i)
                                                for i in range(len(tracked.smoothed.names))],
                            'From all stars; ± 2 σ, arcsec.'),
        provenance_section([], files)]
    return whole('Adaptive model', body, 'Tracking of a telescope mount')


def _largest(tracked, missed, files):
    """Terms that moved, and a recommendation which model to use."""
    back, mount, lines = tracked.smoothed, tracked.model.mount, []
    known = terms_of(mount)
    for i, name in enumerate(back.names):
        low, high = (int(find(back.terms[:, i])) for find in (np.argmin, np.argmax))
        reach = (back.terms[high, i] - back.terms[low, i]) / ARCSEC
        error = float(np.hypot(back.sigma[high, i], back.sigma[low, i])) / ARCSEC
        if reach > _CLEAR * error:
            cause, check = term_cause(name, mount) if name in known else (name, '')
            lines.append(ErrorLine(f'{name} moved by {reach:.1f} ± {error:.1f}″', reach, None,
                                   [f'{cause}, changing'], check))
    fixed, adaptive = missed['model of the evening'], missed['tracked']
    squares = np.sum(tracked.evening**2 - tracked.live**2, axis=1) / ARCSEC**2
    # standard error of the difference of the two RMS
    error = float(np.std(squares)) / len(squares)**0.5 / max(fixed + adaptive, 1e-9)
    better, size = fixed - adaptive > _BETTER * error, f'{adaptive - fixed:+.2f} ± {error:.2f}″'
    advice = (f'The adaptive model is {"better" if better else "not clearly better"} ({size} RMS): '
              f'point with the {"adaptive" if better else "fixed"} model.').replace('-', '−')
    return errors_section(
        sorted(lines, key=lambda one: -one.reach_arcsec), page.sentence_list([
            '' if lines else f'No term moved by more than {_CLEAR:g} σ.', advice,
            f'What causes the {adaptive if better else fixed:.2f}″ left: telescope-mount diagnose '
            + ' '.join(Path(path).name for path in files)]), title='Largest drifts')


def _misses(tracked, hours):
    before, after = (np.hypot(*v.T) / ARCSEC for v in (tracked.evening, tracked.live))
    expected = np.sqrt(np.sum(tracked.sigma**2, axis=1)) / ARCSEC
    top = 1.1 * max(float(np.quantile(before, 0.95)), float(np.quantile(after, 0.95)),
                    float(np.quantile(expected, 0.9)))
    panel = Panel((64, 12, _WIDTH - 84, 230), padded(hours, 0.02, 0.01), (0.0, top))
    panel.axes('hours since the first star', 'error, arcsec')
    panel.points(hours, before, 'before')
    panel.points(hours, after, 'after')
    panel.line(hours, np.minimum(expected, top), 'expected')
    return _wide(svg(_WIDTH, 290, panel.parts, 'radial error of each star in time'))


def _wide(drawing):
    return page.figure(page.block(drawing, 'scroll'))


def innovations_figure(squares):
    """Distribution of normalised innovations squared, with that of a consistent filter.

    Parameters
    ----------
    squares : array_like, shape (n,)
        NIS of each star: chi squared with two degrees of freedom for a consistent filter.

    Returns
    -------
    Markup or None
    """
    from scipy.special import chdtr, chdtri  # takes 0.25 s to load, so for tracked nights only

    nis = np.asarray(squares, float)
    if not nis.size:
        return None
    edges = np.linspace(0.0, 12.0, 25)
    counts = np.histogram(np.minimum(nis, 11.99), edges)[0]
    wanted = len(nis) * np.diff(chdtr(2, edges))
    panel = Panel((52, 12, 380, 180), (0.0, 12.0),
                  (0.0, 1.1 * max(float(counts.max()), float(wanted.max()))))
    panel.axes('normalised innovation squared', 'stars')
    left, right, top = panel.x(edges[:-1]), panel.x(edges[1:]), panel.y(counts)
    bottom = float(panel.y(0.0))
    panel.parts += [f'<rect class="count" x="{a + 1:.1f}" y="{b:.1f}" width="{c - a - 2:.1f}" '
                    f'height="{bottom - b:.1f}"/>' for a, c, b in zip(left, right, top)]
    panel.line(0.5 * (edges[1:] + edges[:-1]), wanted, 'expected')
    mean, beyond = float(np.mean(nis)) / 2.0, float(np.mean(nis > chdtri(2, 0.05)))
    text = (f'{len(nis)} stars: mean {mean:.2f} of the expected, {100 * beyond:.0f} % beyond the '
            '95 % point')
    return page.figure_pair([page.figure(
        svg(450, 240, panel.parts, f'Normalised innovations squared. {text}'),
        f'{text}. Line: chi squared, two degrees of freedom.')])


def _term(tracked, hours, i):
    back = tracked.smoothed
    value, wide = back.terms[:, i] / ARCSEC, 2.0 * back.sigma[:, i] / ARCSEC
    panel = Panel((64, 22, _WIDTH - 84, 110), padded(hours, 0.02, 0.01),
                  padded([value - wide, value + wide], 0.06, 0.5))
    panel.axes('hours', '', back.names[i])
    panel.band(hours, value - wide, value + wide)
    panel.line(hours, value, 'level')
    return _wide(svg(_WIDTH, 180, panel.parts, f'{back.names[i]}, smoothed'))


def tracking_lines(document):
    """Summary lines from the document of `tracked_night.TrackedNight`.

    Parameters
    ----------
    document : dict

    Returns
    -------
    list of str
    """
    expected, rates = document['expected_arcsec'], document['rates_arcsec_per_root_hour']
    found = document['innovations']
    out = [f'{document["stars"]} stars; expected error {expected["now"]:.2f}″ now, '
           f'{expected["10 min"]:.2f}″ in 10 min, {expected["1 h"]:.2f}″ in 1 h',
           f'drift: zeros {rates["zero"]:.1f}″/√h, tilt of the first axis {rates["tilt"]:.1f}″/√h']
    if found['stars']:
        out.append(f'{found["stars"]} stars: RMS error {found["mean_square"]**0.5:.2f} times the '
                   f'predicted, {found["beyond_95"]} beyond 95 %; filter: '
                   f'{document["confidence_sentence"]}')
    begun = document.get('opening')
    if begun:
        out.append(f'since the nights before, by the first {begun["stars"]} stars: ' + ', '.join(
            f'{story} {100.0 * chance:.0f} %' for story, chance in begun['chances'].items()))
    for event in document['events']:
        when = datetime.fromtimestamp(event['stamp'] * 1e-9, timezone.utc)
        out.append(f'{when:%H:%M:%S} {event["text"]}')
    return out
