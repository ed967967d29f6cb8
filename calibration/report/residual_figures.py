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

"""Residual figures: sky maps, target plot, in time, against the axes, histograms, star table."""

import numpy as np

from pointing_model.effects.base import arcsec

from . import page_parts as page
from .drawing import MAGNIFIED, MAX_LINKED, Panel, limit_of, padded, svg, text, thinned, ticks
from .number_wording import group_name, number
from .sky_map import SkyMap
from .star_table import WHENS, stars_table
from .target_plot import row_marks, targets

#: largest number of arrows on a map
MAX_ARROWS = 400


def controls(data):
    """The control bar of the page; None without rows.

    Parameters
    ----------
    data : Residuals

    Returns
    -------
    Controls or None
    """
    if not len(data):
        return None
    several = data.groups is not None and len(np.unique(data.groups)) > 1
    return page.controls(data.group_word, tuple(_groups(data)) if several else ())


def _groups(data):
    """Name and summary sentence of each group."""
    for value in np.unique(data.groups):
        rows, name = data.groups == value, group_name(value)
        caption = ', '.join(f'{arcsec(size)} {when}' for when in WHENS
                         if (size := data.radial(when, rows)) is not None)
        yield name, (f'{data.group_word} {name}: {int((rows & data.used).sum())} rows'
                     + (f', radial RMS {caption}' if caption else ''))


# ---------------------------------------------------------------------------------------- figures

def sky_maps(data, beside=None):
    """Maps of residual vectors before and after on one scale; after also magnified if small.

    One map if both are the same. `beside` is a figure shown in place of the magnified map.
    """
    used = data.used
    if not used.any():
        return None
    lowest = min(max(0.0, 10.0 * np.floor(np.degrees(data.el[used].min()) / 10.0)), 60.0)
    drawn = thinned(np.flatnonzero(used), MAX_ARROWS)
    long = 34.0 if len(drawn) <= 150 else 24.0
    typical = {when: float(np.quantile(np.hypot(*data.of(when)[:, used]), 0.9)) for when in WHENS}
    places, toward = (data.az[drawn], data.el[drawn]), {}
    for when in WHENS:
        x, y = data.of(when)[:, drawn]
        toward[when] = (x, y) if data.turned is None else tuple(
            one[0, drawn] * x + one[1, drawn] * y for one in data.turned)
    blank = SkyMap(400, lowest)
    scale = min(blank.scale_for(*places, *toward[when], long / max(*typical.values(), 1e-6))
                for when in WHENS)
    own = blank.scale_for(*places, *toward['after'], long / max(typical['after'], 1e-6))
    same = np.array_equal(data.of('before'), data.of('after'), equal_nan=True)
    maps = [('before', scale, ''), *[('after', scale, '')] * (not same)]
    if own > MAGNIFIED * scale and beside is None:
        times = float(f'{own / scale:.1g}')
        maps.append(('after', times * scale, f', drawn {times:g} times as large'))
    skies = []
    for when, size, _ in maps:
        sky = SkyMap(400, lowest, data.grid)
        x, y = data.of(when)[:, drawn]
        names = [f'{data.names[i]}: {number(a, 2, True)}″ {data.axes[0]}, {number(b, 2, True)}″ '
                 f'{data.axes[1]}' for i, a, b in zip(drawn, x, y)] if len(drawn) <= 150 else None
        sky.arrows(*places, *toward[when], size, when, names, [data.keys[i] for i in drawn])
        skies.append(sky)
    out, margins = [], np.ceil(np.max([sky.beyond for sky in skies], axis=0))
    margins += 3.0 * (margins > 0.0)
    for (when, size, more), sky in zip(maps, skies):
        unit = ticks(0.0, max(60.0 / size, 1e-9), 2)
        unit = float(unit[unit > 0][0]) if (unit > 0).any() else 1.0
        left, low = 12 - margins[0], 388 + margins[3]
        sky.parts.append(f'<path class="{when} key" d="M{left:g} {low:g}h{unit * size:.1f}"/>'
                         + text(left, low - 6, f'{unit:g}″', anchor='start'))
        what, rms_of = f'{data.text_of(when).capitalize()}: ', data.radial(when)
        longer = f' {sky.shortened} of the arrows {"is" if sky.shortened == 1 else "are"} ' \
            'longer than drawn.' if sky.shortened else ''
        out.append(page.figure(
            svg(400, 400, sky.parts, f'Map of the sky. {what}{arcsec(rms_of)} RMS{more}', 'link',
                margins),
            (what, page.size(rms_of, when), f' RMS{more}.{longer}'), '' if same else when))
    some = f' {len(drawn)} of {int(used.sum())} rows drawn.' if len(drawn) < used.sum() else ''
    if beside is not None:
        out.append(beside)
    return [page.figure_pair(out), page.paragraph(
        f'Encoder − model; zenith at the centre, rim at {lowest:g}°.{some}', 'note')]


def _stacked(data, when, x, label, linked=True, gaps=(), texts=''):
    """Both components against `x`, one below the other."""
    used, values = data.used, data.of(when)
    span, parts = padded(np.asarray(x)[data.known], 0.02), []
    for axis, title in enumerate(data.axes):
        limit = limit_of(values[axis][used] if used.any() else values[axis])
        panel = Panel((56, 24 + 146 * axis, 372, 110), span, (-limit, limit))
        panel.axes(label if axis else '', 'arcsec', f'{title}, {when}')
        for at in gaps:
            panel.parts.append(f'<path class="gap" d="M{float(panel.x(at)):.1f} {panel.top}'
                               f'v{panel.height}"/>')
        row_marks(panel, x, values[axis], data, when, linked, (None, axis))
        parts += panel.parts
    return page.figure(svg(440, 324, parts, f'Residuals {data.text_of(when)} against {label}',
                           'link' if linked else ''), texts, when)


def in_time(data):
    """Residuals in time, before and after."""
    if not data.known.any():
        return None
    x, label = data.order
    gaps = []
    if data.groups is not None and data.time is not None:
        order = np.argsort(data.time, kind='stable')
        moved = np.flatnonzero(data.groups[order][1:] != data.groups[order][:-1])
        gaps = [0.5 * (x[order[i]] + x[order[i + 1]]) for i in moved] if len(moved) <= 40 else []
    text = f'Dashed: another {data.group_word} begins.' if gaps else ''
    return page.figure_pair([_stacked(data, when, x, label, gaps=gaps, texts=text)
                             for when in WHENS])


def along_axes(data):
    """Residuals after against the angle of each axis."""
    if not data.known.any():
        return None
    places = data.places or (np.mod(data.az, 2.0 * np.pi), data.el)
    return page.figure_pair([_stacked(data, 'after', np.degrees(place), f'{word} [°]',
                                      len(data) <= MAX_LINKED)
                      for place, word in zip(places, data.place_words)])


def histograms(data):
    """Histograms of each axis before and after: same bins, unless after is much smaller."""
    if not data.used.any():
        return None
    out = []
    magnify = limit_of(data.before[:, data.used]) > MAGNIFIED * limit_of(data.after[:, data.used])
    for axis, title in enumerate(data.axes):
        before, after = (data.of(when)[axis][data.used] for when in WHENS)
        limit, small = limit_of(before, after), limit_of(after)
        if magnify:
            out.append(page.figure_pair([_histogram(before, before, limit, title, ('before',)),
                                         _histogram(after, after, small, title, ('after',))]))
        else:
            out.append(_histogram(before, after, limit, title, WHENS))
    return [out if magnify else page.figure_pair(out), page.legend()]


def histogram(before, after, limit):
    """Counts of residuals before and after in the same bins; the end bins include all beyond.

    Parameters
    ----------
    before, after : ndarray, shape (n,)
    limit : float
        Outer edge of the bins, on both sides.

    Returns
    -------
    edges : ndarray, shape (b + 1,)
    counts : list of ndarray, shape (b,)
    sigmas : list of float
        Standard deviations.
    """
    bins = int(np.clip(np.sqrt(len(before)) * 1.6, 9, 41)) | 1
    edges = np.linspace(-limit, limit, bins + 1)
    both = before, after
    return (edges, [np.histogram(np.clip(v, -limit, limit), edges)[0] for v in both],
            [float(np.std(v)) if len(v) else np.nan for v in both])


def _histogram(before, after, limit, title, whens):
    """Histogram of one axis, with before, after, or both."""
    edges, counts, sizes = histogram(before, after, limit)
    shown = [(when, counts[WHENS.index(when)], sizes[WHENS.index(when)]) for when in whens]
    panel = Panel((52, 26, 350, 190), (-limit, limit),
                  (0.0, 1.12 * max(1, *(count.max() for _, count, _ in shown))))
    panel.axes(f'residual, {title} [arcsec]', 'observations', f'{title}, {" and ".join(whens)}')
    for when, values, _ in shown:
        x, y = np.repeat(edges, 2), np.concatenate([[0], np.repeat(values, 2), [0]])
        panel.line(x, y, f'{when} area when-{when}', close=True)
    caption = f'{title}: σ ' + ', '.join(
        f'{arcsec(size)} {when}' for when, _, size in shown)
    sigma = sizes[1]
    if 'after' in whens and np.isfinite(sigma) and sigma > 0.0:
        u = np.linspace(-limit, limit, 120)
        panel.line(u, np.minimum(len(after) * (edges[1] - edges[0]) / sigma / np.sqrt(2 * np.pi)
                                 * np.exp(-0.5 * (u / sigma)**2), panel.y_range[1]),
                   'gauss when-after')
        caption += '; dotted: normal'
    return page.figure(svg(420, 262, panel.parts, f'Histogram. {caption}'), f'{caption}.',
                       whens[0] if len(whens) == 1 else '')


def residual_sections(data):
    """All residual figures except the map, as a list of folded sections.

    Parameters
    ----------
    data : Residuals
    """
    parts = (('Target', targets), ('Residuals in time', in_time),
             ('Residuals by axis', along_axes), ('Histograms', histograms),
             ('Stars', stars_table))
    return [page.folded_section(title, make(data)) for title, make in parts]
