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

"""Target plot: residuals as hits around the centre, with the circle of the noise."""

import numpy as np

from pointing_model.effects.base import arcsec
from pointing_model.rms import rms

from . import page_parts as page
from .drawing import MAGNIFIED, MAX_LINKED, MAX_POINTED, Panel, limit_of, svg, thinned
from .star_table import WHENS

#: share of isotropic normal noise within its radial RMS
_WITHIN = 1.0 - np.exp(-1.0)


def target(axes, limit, x, y, what, when, noise=None, draw=None):
    """A target plot.

    Parameters
    ----------
    axes : tuple of str
        Names of x and y.
    limit : float
        Value at the edge, arcsec.
    x, y : ndarray, shape (n,)
        Used rows, arcsec.
    what : str
        Description for the caption.
    when : str
        ``before`` or ``after``: style of the marks.
    noise : float, optional
        Radial RMS of the noise, arcsec.
    draw : callable, optional
        ``draw(panel)``, by default a mark for each hit.

    Returns
    -------
    Markup
    """
    panel = Panel((52, 12, 330, 330), (-limit, limit), (-limit, limit))
    panel.axes(f'{axes[0]} [arcsec]', f'{axes[1]} [arcsec]')
    cx, cy = float(panel.x(0.0)), float(panel.y(0.0))
    panel.parts.append(f'<path class="zero" d="M{cx:.1f} {panel.top}v{panel.height}"/>')
    size = float(rms(x, y)) if len(x) else None
    what, rest = f'{what[:1].upper()}{what[1:]}: ', f' RMS, {len(x)} rows.'
    if noise is not None and noise > 0.0:
        panel.parts.append(f'<circle class="noise" cx="{cx:.1f}" cy="{cy:.1f}" '
                           f'r="{min(panel.width * noise / (2 * limit), 165.0):.1f}"/>')
        inside = float(np.mean(np.hypot(x, y) <= noise))
        rest += (f' {100 * inside:.0f} % within {arcsec(noise)}, dashed '
                 f'(noise alone: {100 * _WITHIN:.0f} %).')
    if draw is None:
        panel.points(x, y, when)
    else:
        draw(panel)
    drawing = svg(400, 384, panel.parts, f'Target plot. {what}{arcsec(size)}{rest}',
                  'link' if draw else '')
    # a refit in the page updates the RMS of linked plots
    size = page.size(size, when if draw and len(x) else '')
    return page.figure(drawing, (what, size, rest), when)


def targets(data):
    """Target plots of all residuals, before and after on one scale; after also magnified if small.
    """
    if not data.used.any():
        return None
    noise = float(np.hypot(*data.noise)) if data.noise is not None else None
    each = {when: max(limit_of(*data.of(when)[:, data.used]), 1.15 * (noise or 0.0))
            for when in WHENS}
    both = max(each.values())
    drawn = [(when, both, '') for when in WHENS]
    if both > MAGNIFIED * each['after']:
        drawn.append(('after', each['after'], ', drawn larger'))
    out = []
    for when, limit, more in drawn:
        x, y = data.of(when)
        out.append(target(data.axes, limit, x[data.used], y[data.used],
                          data.text_of(when) + more, when, noise,
                          lambda panel, x=x, y=y, when=when, linked=not more: row_marks(
                              panel, x, y, data, when, linked, (0, 1))))
    return [page.figure_pair(out), marks_legend(data)]


def row_marks(panel, x, y, data, when, linked=True, axes=(None, None)):
    """Draw used rows as dots, the others as crosses; `axes`: which residuals are drawn."""
    moves = f' data-when="{when}"{panel.moving(axes)}'
    linked = linked and len(data) <= MAX_POINTED
    rest = thinned(np.flatnonzero(data.known & ~data.used & np.isfinite(x)), MAX_LINKED)
    rows = np.flatnonzero(data.used & np.isfinite(x))
    panel.points(np.asarray(x)[rows], np.asarray(y)[rows], when,
                 keys=[data.keys[i] for i in rows] if linked else None,
                 moves=moves if linked else '')
    if len(rest):
        panel.crosses(np.asarray(x)[rest], np.asarray(y)[rest], when,
                      [data.keys[i] for i in rest], moves)


def marks_legend(data):
    """Legend of dots, squares and crosses."""
    left = bool((data.known & ~data.used).any())
    return page.legend((('before', f'{data.before_text} (dots)'),
                        ('after', f'{data.after_text} (squares)'),
                        *[('noise', data.noise_text)] * (data.noise is not None),
                        *[('cross', 'not used in the fit')] * left))
