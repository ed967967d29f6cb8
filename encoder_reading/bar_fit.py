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

"""Fits one line through the positions of the bars: position and scale of the image."""

import numpy as np

from .bar_decoding import median

_PASSES = 3
_OUTLIER = 4.5 * 1.4826  # median deviations from which level or contrast is not that of a bar
_FLAT = 0.01  # relative deviation that is always accepted
_SHARPEST = 3.0  # pixels of blur: the response is linear over a fraction of it
_CUT = 6.0  # cut-off of Tukey's weights: costs 2 % for normal noise
_FAR = np.float32(4.5)  # sigmas: bars beyond this affect the line too much
_DEVIATION = np.float32(1.4826)  # 1-sigma in units of the median deviation
_BEND = np.float32(1.4826 / 6.0**0.5)  # the same for second differences
_TINY = np.float32(1e-6)


class BarLine:
    """Least-squares fit of the template of the decoded bars, as a robust line through their shifts.

    Parameters
    ----------
    design : design.Design
    lattice : bar_lattice.BarLattice
    template : bar_template.BarTemplate
    codes : ndarray of int, shape (disc.bars, bars)
        For the window with its middle at each bar of the disc, the bits of each bar and its
        neighbours: 4 * left + 2 * own + right.
    """

    def __init__(self, design, lattice, template, codes):
        self._lattice, self._template = lattice, template
        # bar periods, up to which the response is linear: 0.06 % of it remain
        self._enough = np.float32(0.05 * max(design.blur, _SHARPEST) / design.bar_pitch)
        per_pixel = float(lattice.per_pixel)
        self._expected = np.stack(
            [table[codes] for table in (
                1.0 / template.contrast_of, template.level_of, template.response,
                template.ground_moment * per_pixel, template.contrast_moment * per_pixel,
                per_pixel / template.response_slope)], axis=1).astype(np.float32)
        rank = lattice.rank.astype(float)
        n, reach = len(rank), rank[-1]
        self._rank, self._turned = lattice.rank, lattice.rank[-1] / 3.0
        powers = (rank / reach) ** np.arange(5)[:, np.newaxis]
        self._x, self._per_bar = powers[1].astype(np.float32), np.float32(1.0 / reach)
        self._moments = np.ascontiguousarray(powers.T.astype(np.float32))
        slopes = np.stack([np.zeros(n), np.ones(n), 2.0 * rank / reach]) / reach
        # values and slopes of a parabola from its coefficients
        self._curves = np.concatenate([powers[:3], slopes], axis=1).astype(np.float32)
        # parabola through all bars but the first and the last, one of which is often cut
        inner = np.zeros((n, 3))
        inner[1:-1] = np.linalg.pinv(powers[:3, 1:-1])
        self._parabola = inner.astype(np.float32)
        self._powers = np.stack([np.ones(n), rank, rank * rank], axis=1).astype(np.float32)
        self._straight = np.ascontiguousarray(self._powers[:, :2].T)
        self._lines = self._least_squares(template.response_slope[codes])

    def _least_squares(self, slopes):
        """Matrices from shifts to their weighted least-squares line, shape (disc.bars, 4, bars, 2).

        Second index: whether the first (1) and the last bar (2) are included.
        """
        out = np.empty((len(slopes), 4, len(self._rank), 2), dtype=np.float32)
        powers = self._straight.T.astype(float)
        for ends in range(4):
            weight = slopes.copy()
            weight[:, 0] *= ends & 1
            weight[:, -1] *= ends >> 1
            weighted = weight[:, :, np.newaxis] * powers
            out[:, ends] = weighted @ np.linalg.inv(powers.T @ weighted)
        return out

    def fit(self, bar, bars):
        """Correction of the line ``alpha + beta * rank`` of the bars' positions.

        Parameters
        ----------
        bar : ndarray of int, shape (n,)
            Number of the bar in the middle.
        bars : Bars
            Results are added to it.

        Returns
        -------
        alpha, beta : ndarray, shape (n,)
            In bar periods, and relative.
        used : ndarray of int, shape (n,)
            Number of bars that determine the line.
        spread : ndarray, shape (n,)
            1-sigma scatter of bars about the line, bar periods.
        """
        bars.bar, expected = bar, self._expected[bar]
        bars.in_view = np.add.reduce(bars.visible, axis=1)
        curves = np.empty((2, *bars.good.shape), dtype=np.float32)
        np.multiply(bars.contrast, expected[:, 0], out=curves[1])
        np.multiply(curves[1], expected[:, 1], out=curves[0])
        curves[0] += bars.measured[0]
        values, slopes = self._smooth(curves, bars)
        bars.contrast_curve = contrast = values[1]
        ground = slopes[0] * expected[:, 3]
        ground -= slopes[1] * expected[:, 4]
        scale = expected[:, 5] / contrast
        if self._lattice.flat:
            magnification = self._lattice.magnification(bars.pixel)
            ground *= magnification
            scale *= magnification
        ground -= contrast * expected[:, 2]
        bars.ground, bars.scale = ground, scale
        bars.series = np.where(bars.narrow, bars.measured[7:11], bars.measured[3:7])
        return self._find_line(bars, bars.shift, None, _PASSES - 1)

    # --- level and contrast along the row -----------------------------------------------------

    def _smooth(self, curves, bars):
        """Parabolas through level and contrast; bars that deviate are no longer good.

        Returns
        -------
        values, slopes : ndarray, shape (2, n, bars)
            Values of the parabolas, and their change per bar.
        """
        good, n = bars.good, curves.shape[2]
        bars.whole = np.logical_and.reduce(good[:, 1:-1], axis=1)
        if not np.logical_or.reduce(bars.whole):
            values, slopes, bars.good = self._smooth_dirty(curves, good)
            return values, slopes
        both = np.matmul(np.matmul(curves[..., np.newaxis, :], self._parabola),
                         self._curves)[..., 0, :]
        values, slopes = both[..., :n], both[..., n:]
        rest = np.abs(curves - values)
        bars.good = good & _near(rest, values, median(rest))
        bars.whole = np.logical_and.reduce(bars.good[:, 1:-1], axis=1)
        if not np.logical_and.reduce(bars.whole):
            rows = np.flatnonzero(~bars.whole)
            values[:, rows], slopes[:, rows], bars.good[rows] = self._smooth_dirty(
                curves[:, rows], good[rows])
        return values, slopes

    def _smooth_dirty(self, curves, good):
        """Like `_smooth`, with parabolas only through bars close to those of the good ones."""
        values, _ = self._parabolas(curves, good)
        rest = np.abs(curves - values)
        ranked = np.where(good, rest, np.float32(np.inf))
        ranked.sort()
        middle = ranked[:, np.arange(len(good)), np.add.reduce(good, axis=1) // 2]
        good = good & _near(rest, values, middle[..., np.newaxis])
        return *self._parabolas(curves, good), good

    def smooth(self, values, good):
        """Least-squares parabola of each row through its good bars, shape (n, bars)."""
        return self._parabolas(values[np.newaxis], good)[0][0]

    def _parabolas(self, curves, good):
        """Values and slopes of least-squares parabolas through good bars, row by row.

        Parameters
        ----------
        curves : ndarray, shape (k, n, bars)
        good : ndarray of bool, shape (n, bars)

        Returns
        -------
        values, slopes : ndarray, shape (k, n, bars)
        """
        # one product per row of the image
        weighted = np.empty((len(good), len(curves) + 1, good.shape[1]), dtype=np.float32)
        weighted[:, 0] = good
        np.multiply(curves, good, out=weighted[:, 1:].transpose(1, 0, 2))
        sums = np.ascontiguousarray(np.matmul(weighted, self._moments).transpose(2, 1, 0))
        s0, s1, s2, s3, s4 = sums[:, 0]
        t0, t1, t2 = sums[:3, 1:]
        # Cramer's rule
        m00, m01, m02 = s2 * s4 - s3 * s3, s2 * s3 - s1 * s4, s1 * s3 - s2 * s2
        m11, m12, m22 = s0 * s4 - s2 * s2, s1 * s2 - s0 * s3, s0 * s2 - s1 * s1
        part = 1.0 / (s0 * m00 + s1 * m01 + s2 * m02)
        level = ((t0 * m00 + t1 * m01 + t2 * m02) * part)[..., np.newaxis]
        tilt = ((t0 * m01 + t1 * m11 + t2 * m12) * part)[..., np.newaxis]
        bend = ((t0 * m02 + t1 * m12 + t2 * m22) * part)[..., np.newaxis]
        slopes = bend * self._x
        values = slopes + tilt
        values *= self._x
        values += level
        slopes += slopes
        slopes += tilt
        slopes *= self._per_bar
        return values, slopes

    # --- the line -----------------------------------------------------------------------------

    def _find_line(self, bars, shift, crosstalk, more):
        """The line for bar templates at `shift`, repeated `more` times from the result."""
        m0, m1, m2, m3 = bars.series
        # the weights shifted by `shift`, as a Taylor series
        rest = m3 * shift
        rest -= m2
        rest *= shift
        rest += m1
        rest *= shift
        rest -= m0
        rest += bars.ground
        if crosstalk is not None:
            rest -= crosstalk
        rest *= bars.scale
        alpha, beta, weight, spread, left = self._line(rest, bars, crosstalk is None)
        used = np.add.reduce(weight > 0.0, axis=1)
        if more:
            # repeat if the line has moved, or bars off the line disturb their neighbours; a
            # rotation of the line about the middle hardly changes the angle
            again = np.maximum(np.abs(alpha), np.abs(beta) * self._turned) > self._enough
            again |= used < bars.in_view
            if np.logical_or.reduce(again):
                rows = np.flatnonzero(again)
                part = bars.rows(rows)
                pixels = self._lattice.pixels_of(part.pixel)
                line = alpha[rows, np.newaxis] + beta[rows, np.newaxis] * self._rank
                off = part.visible & (weight[rows] == 0.0)
                crosstalk = self._crosstalk(left[rows] * pixels, off, part)
                a, b, used[rows], spread[rows] = self._find_line(
                    part, shift[rows] + line * pixels, crosstalk, more - 1)
                alpha[rows] += a
                beta[rows] += b
        return alpha, beta, used, spread

    def _line(self, values, bars, from_median):
        """Robust straight line.

        Least squares, if no bar (except at the ends) is missing or far from it; else two steps with
        Tukey's weights, starting from the median or from zero.

        Returns
        -------
        alpha, beta : ndarray, shape (n,)
        weight : ndarray, shape (n, bars)
            Above zero for bars that are used.
        spread : ndarray, shape (n,)
        rest : ndarray, shape (n, bars)
        """
        if not np.logical_or.reduce(bars.whole):
            return self._robust_line(values, bars.good / bars.scale, from_median)
        good = bars.good
        line = np.matmul(values[:, np.newaxis], self._lines[bars.bar, good[:, 0] + 2 * good[:, -1]])
        rest = values - np.matmul(line, self._straight)[:, 0]
        size = np.abs(rest)
        spread = median(size) * _DEVIATION
        # several wrong bars together tilt the line and so hide; second differences reveal them
        bend = values[:, 2:] - 2.0 * values[:, 1:-1] + values[:, :-2]
        far = size > np.minimum(spread, median(np.abs(bend)) * _BEND) * _FAR
        far &= good
        out = line[:, 0, 0], line[:, 0, 1], good, spread[:, 0], rest
        simple = bars.whole & ~np.logical_or.reduce(far, axis=1)
        if not np.logical_and.reduce(simple):
            rows = np.flatnonzero(~simple)
            out = (*out[:2], good.astype(np.float32), *out[3:])
            robust = self._robust_line(values[rows], good[rows] / bars.scale[rows], from_median)
            for all_rows, part in zip(out, robust):
                all_rows[rows] = part
        return out

    def _robust_line(self, values, weight0, from_median):
        """Like `_line`, with Tukey's weights times `weight0`."""
        middle = median(values) if from_median else np.float32(0.0)
        a, b, weight, cut = self._step(values - middle, weight0)
        a += middle
        rest = values - a - b * self._rank
        if from_median:
            da, db, weight, cut = self._step(rest, weight0)
            a, b = a + da, b + db
            rest = values - a - b * self._rank
        return a[:, 0], b[:, 0], weight, cut[:, 0] * (1.0 / _CUT), rest

    def _step(self, rest, weight0):
        """Line through `rest` with Tukey's weights, these weights, and their cut-off."""
        cut = median(np.abs(rest)) * (_DEVIATION * np.float32(_CUT)) + _TINY
        weight = rest / cut
        weight *= weight
        np.subtract(1.0, weight, out=weight)
        np.maximum(weight, 0.0, out=weight)
        weight *= weight
        weight *= weight0
        both = np.empty((2, len(rest), 1, rest.shape[1]), dtype=np.float32)
        both[0, :, 0] = weight
        np.multiply(weight, rest, out=both[1, :, 0])
        sums = np.matmul(both, self._powers)
        s, t = sums[0], sums[1]
        s0, s1, s2, t0, t1 = s[:, :, 0], s[:, :, 1], s[:, :, 2], t[:, :, 0], t[:, :, 1]
        det = s0 * s2 - s1 * s1 + _TINY
        return (s2 * t0 - s1 * t1) / det, (s0 * t1 - s1 * t0) / det, weight, cut

    def _crosstalk(self, apparent, off, bars):
        """Effect of bars off the line, by an `apparent` distance (pixels), on their neighbours."""
        if bars.like_missing is None:
            level, contrast = bars.measured[0], bars.contrast
            bars.like_missing = np.abs(contrast) < 0.25 * median(contrast)
            bars.like_missing &= level > median(level)
            # level and contrast of a bar, not of dust
            ratio = contrast / np.maximum(level, 1.0)
            bars.like_bar = np.abs(ratio / median(ratio) - 1.0) < 0.12
        missing, shifted = off & bars.like_missing, off & bars.like_bar
        return bars.contrast_curve * self._template.crosstalk(
            apparent, shifted, missing, bars.narrow)


def _near(rest, values, middle):
    """Which bars deviate from both curves by no more than expected from the median deviation."""
    near = rest <= middle * _OUTLIER + values * _FLAT
    return near[0] & near[1]


class Bars:
    """State of the bars of n frames; arrays of shape (n, bars) by default.

    Attributes
    ----------
    visible, good : ndarray of bool
        Completely in the row; legible, and matching the code.
    narrow : ndarray of bool
        Narrow by the code.
    pixel, shift : ndarray
        Middle of the window, and expected offset of the bar from it, pixels.
    measured : ndarray, shape (11, n, bars)
    contrast : ndarray
    contrast_curve, ground, scale : ndarray
        Set by `BarLine.fit`: contrast along the row; response of a bar at its position to a
        template at its position; bar periods per unit of response.
    bar, whole, in_view : ndarray, shape (n,)
        The bar in the middle; whether all but the first and the last are good; number of visible
        bars.
    like_missing, like_bar : ndarray of bool, or None
        Whether a bar is missing, or has the level and contrast of a bar; computed when needed.
    series : ndarray, shape (4, n, bars)
        Terms of the response to a shifted template.
    """

    like_missing = like_bar = None
    _FIRST = ('visible', 'good', 'narrow', 'pixel', 'shift', 'contrast', 'contrast_curve',
              'ground', 'scale', 'bar', 'whole', 'in_view')
    _SECOND = ('measured', 'series')

    def __init__(self, **fields):
        self.__dict__.update(fields)

    def rows(self, rows):
        """The bars of some of the frames."""
        if len(rows) == len(self.visible):
            return self
        return Bars(**{name: getattr(self, name)[rows] for name in self._FIRST},
                    **{name: getattr(self, name)[:, rows] for name in self._SECOND})
