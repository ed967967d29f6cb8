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

"""A target: residuals as hits about the middle, and the circle of the noise."""

import numpy as np

from pointing_model.effects.base import arcsec
from pointing_model.rms import rms

from . import page_parts as page
from .drawing import Panel, svg

#: within its radial RMS lies this much of noise that is alike in both axes
_WITHIN = 1.0 - np.exp(-1.0)


def target(axes, limit, x, y, what, when, noise=None, draw=None):
    """A target with its hits.

    Parameters
    ----------
    axes : tuple of str
        What x and y are.
    limit : float
        At the edge, arcsec.
    x, y : ndarray, shape (n,)
        arcsec; what counts.
    what : str
        Of what.
    when : str
        ``before`` or ``after``: how they are drawn.
    noise : float, optional
        Radial RMS of the noise, arcsec.
    draw : callable, optional
        ``draw(panel)``, by default a mark for each hit.

    Returns
    -------
    Figure
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
    # of what is linked a refit changes the RMS
    size = page.Size(size, when if draw and len(x) else '')
    return page.Figure(drawing, (what, size, rest), when)
