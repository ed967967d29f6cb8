"""The page of a run that was tracked: misses in time, innovations, terms in hindsight."""

from datetime import datetime, timezone
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from msg_tools.units import ARCSEC

from ..diagnosis_page.sections import figure, section, table
from ..diagnosis_page.style import CSS
from ..diagnosis_page.svg_plot import Panel, clean, svg
from .told import tracking_lines

_STYLE = """
path.expected { fill:none; stroke:var(--fit); stroke-width:1.8 }
rect.count { fill:#b3bbc6 }
"""
_WIDTH = 940


def write_page(tracked, path):
    """Write the page, a file that refers to nothing outside itself.

    Parameters
    ----------
    tracked : of_run.TrackedRun
    path : str or Path

    Raises
    ------
    OSError
        It cannot be written.
    """
    Path(path).write_text(render(tracked), encoding='utf-8')


def render(tracked):
    """The page as text.

    Parameters
    ----------
    tracked : of_run.TrackedRun

    Returns
    -------
    str
    """
    summary = tracked.summary()
    missed = summary['missed_rms_arcsec']
    begin = datetime.fromtimestamp(tracked.time[0], timezone.utc)
    lines = ''.join(f'<li>{clean(line)}</li>' for line in tracking_lines(summary))
    cards = ''.join(f'<div><b>{missed[name]:.2f}″</b><span>{text}</span></div>' for name, text in (
        ('model of the evening', 'missed by the model of the evening, RMS'),
        ('tracked', 'by the tracked model, before each star was seen'),
        ('expected', 'expected of it')))
    events = [(datetime.fromtimestamp(event['stamp'] * 1e-9, timezone.utc).strftime('%H:%M:%S'),
               event['star'], event['what']) for event in tracked.hindsight.events]
    hours = (tracked.time - tracked.time[0]) / 3600.0
    seen = (tracked.hindsight.stamps * 1e-9 - tracked.time[0]) / 3600.0
    body = [
        '<h1>A mount that was followed</h1>',
        f'<p class="meta">{len(tracked.rows)} stars from {begin:%Y-%m-%d %H:%M} UTC on'
        + (f'; the model of the evening is of the {tracked.fitted} stars before'
           if tracked.fitted else '') + '</p>',
        f'<section class="verdict"><div class="numbers-row">{cards}</div><ul>{lines}</ul>'
        '</section>',
        section('What each star was missed by', '<p class="legend"><span class="swatch before">'
                '</span>model of the evening<span class="swatch after"></span>tracked, before it '
                'was seen<span class="swatch fit"></span>expected, 1 σ</p>',
                figure(_misses(tracked, hours), '')),
        section('Whether the expected errors hold', figure(_innovations(tracked), 'Normalised '
                'innovation squared of each star beside chi squared with two degrees of freedom.')),
        section('What happened, in hindsight', table(('UTC', 'star', 'what'), events)
                if events else ''),
        section('Terms in hindsight', *(figure(_term(tracked, seen, i), '')
                                        for i in range(len(tracked.hindsight.names))),
                note='By all stars, before and after; ± 2 σ, arcsec.')]
    return ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"/>'
            '<meta name="viewport" content="width=device-width, initial-scale=1"/>'
            f'<title>A mount that was followed</title><style>{CSS}{_STYLE}</style>'
            '</head><body><main>\n' + '\n'.join(part for part in body if part)
            + '\n</main></body></html>\n')


def _span(hours):
    room = 0.02 * max(float(np.ptp(hours)), 0.01)
    return float(hours.min()) - room, float(hours.max()) + room


def _misses(tracked, hours):
    before, after = (np.hypot(*v.T) / ARCSEC for v in (tracked.evening, tracked.live))
    expected = np.sqrt(np.sum(tracked.sigma**2, axis=1)) / ARCSEC
    top = 1.1 * max(float(np.quantile(before, 0.95)), float(np.quantile(after, 0.95)),
                    float(np.quantile(expected, 0.9)))
    panel = Panel((64, 12, _WIDTH - 84, 230), _span(hours), (0.0, top))
    panel.axes('hours since the first star', 'missed by, arcsec')
    panel.points(hours, before, 'before')
    panel.points(hours, after, 'after')
    panel.line(hours, np.minimum(expected, top), 'expected')
    return svg(_WIDTH, 290, panel.parts, 'radial miss of each star in time')


def _innovations(tracked):
    nis = np.sum((tracked.live / tracked.sigma)**2, axis=1)
    edges = np.linspace(0.0, 12.0, 25)
    counts = np.histogram(np.minimum(nis, 11.99), edges)[0]
    wanted = len(nis) * np.diff(chi2.cdf(edges, 2))
    panel = Panel((64, 12, _WIDTH - 84, 180), (0.0, 12.0),
                  (0.0, 1.1 * max(float(counts.max()), float(wanted.max()))))
    panel.axes('normalised innovation squared', 'stars')
    left, right, top = panel.x(edges[:-1]), panel.x(edges[1:]), panel.y(counts)
    bottom = float(panel.y(0.0))
    panel.parts += [f'<rect class="count" x="{a + 1:.1f}" y="{b:.1f}" width="{c - a - 2:.1f}" '
                    f'height="{bottom - b:.1f}"/>' for a, c, b in zip(left, right, top)]
    panel.line(0.5 * (edges[1:] + edges[:-1]), wanted, 'expected')
    return svg(_WIDTH, 240, panel.parts, 'distribution of the normalised innovations')


def _term(tracked, hours, i):
    back = tracked.hindsight
    value, wide = back.terms[:, i] / ARCSEC, 2.0 * back.sigma[:, i] / ARCSEC
    low, high = float((value - wide).min()), float((value + wide).max())
    pad = 0.06 * max(high - low, 0.5)
    panel = Panel((64, 22, _WIDTH - 84, 110), _span(hours), (low - pad, high + pad))
    panel.axes('hours', '', back.names[i])
    panel.band(hours, value - wide, value + wide)
    panel.line(hours, value, 'level')
    return svg(_WIDTH, 180, panel.parts, f'{back.names[i]} in hindsight')
