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

"""Small figures as inline SVG: no library needed, sharp in print, searchable text."""


import numpy as np

from .page_parts import Markup, clean

#: largest number of points drawn in one panel; numbers in captions are of all rows
MAX_POINTS = 3000
#: marks other than dots, by class
_MARKS = {'third': 'm-2.8 2.4h5.6l-2.8 -5z', 'fit': 'm-2.6 -2.6l5.2 5.2m0 -5.2l-5.2 5.2'}
MAX_NAMED = 400  # largest number of points with names as tooltips
#: largest number of rows linked in all plots, and in any plot
MAX_LINKED, MAX_POINTED = 1100, 1500
#: "after" is drawn again, magnified, if smaller than "before" by more than this factor
MAGNIFIED = 4.0


def ticks(low, high, count=5):
    """About `count` round values from `low` to `high`.

    Returns
    -------
    ndarray
    """
    span = high - low
    if not span > 0.0 or not np.isfinite(span):
        return np.array([low])
    raw = span / max(count, 1)
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * min((m for m in (1, 2, 2.5, 5, 10) if m * power >= raw), default=10)
    first = np.ceil(low / step - 1e-9) * step
    values = first + step * np.arange(int((high - first) / step + 1e-9) + 1)
    return np.where(np.abs(values) < 1e-9 * step, 0.0, values)


def _tick(value):
    return f'{value:.6g}'.replace('-', '\u2212')


def pt(value):
    """A coordinate as text, rounded to a tenth."""
    return f'{value:.1f}'.rstrip('0').rstrip('.')


def _rounding(n):
    """Format of coordinates: whole numbers if there are many marks, to limit the page size."""
    return pt if n <= MAX_NAMED else '{:.0f}'.format


def text(x, y, words, style='tick', anchor='middle', dy=''):
    """A line of text in a drawing.

    Parameters
    ----------
    x, y : float
    words : str
    style : str
        CSS class.
    anchor : {'start', 'middle', 'end'}
        Part of the text that is at x.
    dy : str
        Shift below y.
    """
    anchor = '' if anchor == 'start' else f' text-anchor="{anchor}"'
    dy = f' dy="{dy}"' if dy else ''
    return f'<text class="{style}"{anchor} x="{pt(x)}" y="{pt(y)}"{dy}>{clean(words)}</text>'


def thinned(rows, limit):
    """Every k-th of some rows, at most `limit` of them."""
    return rows[::-(-len(rows) // limit) or 1]


class Panel:
    """Axes of one figure: coordinate transform, ticks, points, lines.

    Parameters
    ----------
    box : tuple of float
        Left, top, width, height in the drawing.
    x_range, y_range : tuple of float
        Limits of the data.
    """

    def __init__(self, box, x_range, y_range):
        self.left, self.top, self.width, self.height = box
        self.x_range, self.y_range = _open(x_range), _open(y_range)
        self.parts = []

    def x(self, value):
        """Drawing coordinate x of a value."""
        low, high = self.x_range
        return self.left + self.width * (np.asarray(value, float) - low) / (high - low)

    def y(self, value):
        """Drawing coordinate y of a value."""
        low, high = self.y_range
        return self.top + self.height * (high - np.asarray(value, float)) / (high - low)

    def axes(self, x_label='', y_label='', title='', x_ticks=None, x_texts=None):
        """Draw frame, ticks, zero line and labels."""
        left, right = self.left, self.left + self.width
        top, bottom = self.top, self.top + self.height
        out = self.parts
        out.append(f'<rect class="frame" x="{pt(left)}" y="{pt(top)}" width="{pt(self.width)}" '
                   f'height="{pt(self.height)}"/>')
        for value in ticks(*self.y_range, 4):
            y = self.y(value)
            out.append(f'<path class="{"zero" if value == 0 else "grid"}" d="M{pt(left)} {pt(y)}H'
                       f'{pt(right)}"/>' + text(left - 5, y, _tick(value), 'tick', 'end', '.32em'))
        values = ticks(*self.x_range, 6) if x_ticks is None else x_ticks
        for i, value in enumerate(values):
            x = self.x(value)
            out.append(f'<path class="grid" d="M{pt(x)} {pt(bottom)}v4"/>')
            if x_label:
                out.append(text(x, bottom + 16, _tick(value) if x_texts is None else x_texts[i]))
        if x_label:
            out.append(text((left + right) / 2, bottom + 33, x_label, 'label'))
        if y_label:
            x, y = pt(left - 38), pt((top + bottom) / 2)
            out.append(f'<text class="label" text-anchor="middle" transform="translate({x} {y}) '
                       f'rotate(-90)">{clean(y_label)}</text>')
        if title:
            out.append(text(left, top - 7, title, 'title', 'start'))

    def _places(self, x, y, limit=MAX_POINTS):
        """Indices and coordinates of values to draw; values beyond the frame are at its edge."""
        x, y = np.asarray(x, float), np.asarray(y, float)
        good = thinned(np.flatnonzero(np.isfinite(x) & np.isfinite(y)), limit)
        return good, self.x(x[good]), self.y(np.clip(y[good], *self.y_range))

    def moving(self, axes):
        """Attributes with which the script of a page moves marks when residuals change.

        Parameters
        ----------
        axes : tuple of int or None
            Index of the residual drawn horizontally and vertically: 0, 1, or None.
        """
        (left, right), (low, high) = self.x_range, self.y_range
        across, up = self.width / (right - left), -self.height / (high - low)
        places = ((self.left - across * left, across, self.left, self.left + self.width),
                  (self.top - up * high, up, self.top, self.top + self.height))
        return ''.join(f' data-{name}="{axis} {" ".join(f"{v:.7g}" for v in place)}"'
                       for name, axis, place in zip('xy', axes, places) if axis is not None)

    def points(self, x, y, style, names=None, keys=None, moves=''):
        """Draw dots; points beyond the frame are triangles at its edge.

        Parameters
        ----------
        x, y : array_like, shape (n,)
        style : str
            CSS class.
        names : sequence of str, optional
            Names of the points, for tooltips.
        keys : sequence of str, optional
            Keys of the rows: marks with the same key are highlighted together, and all points are
            drawn.
        moves : str
            Attributes of the group, see `moving`.
        """
        good, px, py = self._places(x, y, len(x) if keys is not None else MAX_POINTS)
        shown = np.asarray(y, float)[good]
        low, high = self.y_range
        over = (shown < low) | (shown > high)
        inside = ~over
        if keys is not None:
            self.parts.append(f'<g class="{style} dots"{moves}>' + ''.join(
                f'<path data-i="{keys[i]}" d="M{pt(a)} {pt(b)}h0"/>'
                for a, b, i in zip(px[inside], py[inside], good[inside])) + '</g>')
        elif names is not None and len(x) <= MAX_NAMED:
            self.parts.append(f'<g class="{style}">' + ''.join(
                f'<circle cx="{pt(a)}" cy="{pt(b)}" r="2.4"><title>{clean(names[i])}'
                f'</title></circle>'
                for a, b, i in zip(px[inside], py[inside], good[inside])) + '</g>')
        else:
            mark = _MARKS.get(style.split(' ')[0], 'h0')
            place = _rounding(len(px))
            d = ''.join(f'M{place(a)} {place(b)}{mark}' for a, b in zip(px[inside], py[inside]))
            self.parts.append(f'<path class="{style} dots" d="{d or "M0 0"}"/>')
        if moves and over.any():
            self.parts.append(f'<g class="over"{moves}>')
        for a, value, i in zip(px[over], shown[over], good[over]):
            b, s = (self.top + 1, 6) if value > high else (self.top + self.height - 1, -6)
            key = '' if keys is None else f' data-i="{keys[i]}"'
            self.parts.append(f'<path class="{style} beyond"{key} d="M{pt(a)} {pt(b)}l4 {s}h-8z">'
                              f'<title>{value:.1f} arcsec, beyond the frame</title></path>')
        if moves and over.any():
            self.parts.append('</g>')

    def crosses(self, x, y, style, keys, moves=''):
        """Draw a cross for each unused row; at the edge if beyond the frame."""
        good, px, py = self._places(x, y, len(x))
        px = np.clip(px, self.left, self.left + self.width)
        self.parts.append(f'<g class="{style} crosses"{moves}>' + ''.join(
            f'<path data-i="{keys[i]}" d="M{pt(a)} {pt(b)}m-3 -3l6 6m0 -6l-6 6"/>'
            for a, b, i in zip(px, py, good)) + '</g>')

    def bars(self, x, y, sigma, style):
        """Draw vertical error bars of 1 sigma."""
        x, y, sigma = (np.asarray(v, float) for v in (x, y, sigma))
        good = np.isfinite(x) & np.isfinite(y) & np.isfinite(sigma)
        ends = (self.y(np.clip(y + s * sigma, *self.y_range)) for s in (-1.0, 1.0))
        d = ''.join(f'M{pt(a)} {pt(b)}V{pt(c)}' for a, b, c, g in zip(self.x(x), *ends, good) if g)
        if d:
            self.parts.append(f'<g class="{style} bars-of"><path d="{d}"/></g>')

    def dashes(self, x, y, style, length=7.0):
        """Draw a short horizontal dash at each value: a fit that is no function of x alone."""
        _, px, py = self._places(x, y)
        place = _rounding(len(px))
        d = ''.join(dict.fromkeys(f'M{place(a - length / 2)} {place(b)}h{length:g}'
                                  for a, b in zip(px, py)))
        self.parts.append(f'<path class="{style}" d="{d or "M0 0"}"/>')

    def band(self, x, low, high):
        """Draw the band between two lines."""
        x, top, bottom = self.x(x), self.y(high), self.y(low)
        d = 'L'.join(f'{pt(a)} {pt(b)}' for a, b in zip(
            np.r_[x, x[::-1]], np.r_[top, bottom[::-1]]))
        self.parts.append(f'<path class="band" d="M{d}z"/>')

    def line(self, x, y, style, close=False):
        """Draw a polyline."""
        px, py = self.x(x), self.y(y)
        d = 'L'.join(f'{pt(a)} {pt(b)}' for a, b in zip(px, py))
        self.parts.append(f'<path class="{style}" d="M{d}{"z" if close else ""}"/>')


def _open(limits):
    low, high = (float(v) for v in limits)
    if not (np.isfinite(low) and np.isfinite(high)):
        return -1.0, 1.0
    if high - low <= 1e-12 * max(abs(low), abs(high), 1e-300):
        pad = 0.5 * abs(low) or 1.0
        return low - pad, high + pad
    return low, high


def svg(width, height, parts, label, kind='', margins=(0.0, 0.0, 0.0, 0.0)):
    """A complete drawing that scales with the page.

    Parameters
    ----------
    width, height : float
        Size in drawing units.
    parts : list of str
    label : str
        For screen readers.
    kind : str
        CSS class; ``link``: rows are highlighted when pointed at.
    margins : sequence of float
        Left, above, right, below: for parts that extend beyond it.
    """
    kind = f' class="{kind}"' if kind else ''
    left, top, right, bottom = margins
    box = f'{0.0 - left:g} {0.0 - top:g} {width + left + right:g} {height + top + bottom:g}'
    return Markup(f'<svg{kind} viewBox="{box}" role="img" aria-label="{clean(label)}">'
                  f'{"".join(parts)}</svg>')


def limit_of(*values):
    """A symmetric axis limit for residuals, robust against single outliers.

    Parameters
    ----------
    *values : ndarray

    Returns
    -------
    float
    """
    size = np.abs(np.concatenate([np.ravel(v) for v in values]))
    size = size[np.isfinite(size)]
    if not size.size:
        return 1.0
    return float(max(min(size.max(), 4.0 * np.quantile(size, 0.9)), 1e-3)) * 1.08


def padded(values, part, least=0.0):
    """Range of some values, extended on both sides by a `part` of the span (or of `least`)."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    room = part * max(high - low, least)
    return low - room, high + room
