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

"""Appearance of the bars in the row of pixels, and the weights that measure it."""

import numpy as np

from .disc import blurred_bar, half_widths

_TURN = 2.0 * np.pi
_UNLIKE = 0.1  # largest difference of a bar from both kinds, relative to the contrast
_DISPLACED = 0.08  # displacement in bar periods from which the width of a bar misleads
_SHARPEST = 3.0  # least blur of the template's slopes, pixels: keeps their series short


def fixed_point(weights):
    """Weights rounded so that sums of their products with grey levels are exact.

    The grey levels are integers, 0 to 255, and the weights become multiples of a power of two, so
    large that no sum along the last axis needs more than the 24 bits of a float32. Such a matrix
    product is identical to the last bit, in whatever order and blocks it is computed, and so is a
    reading, whatever else is read with it.

    Parameters
    ----------
    weights : ndarray, shape (..., k)

    Returns
    -------
    ndarray of float32, shape (..., k)
    """
    total = np.abs(weights).sum(axis=-1, keepdims=True)
    fine = 2.0 ** np.floor(np.log2((2.0**24 / 255.0 - weights.shape[-1]) / total))
    return (np.rint(weights * fine) / fine).astype(np.float32)


class BarTemplate:
    """The window of the row around one bar.

    Parameters
    ----------
    design : design.Design
        Its nominal image is used.
    bars : int
        Number of bars of the disc.

    Attributes
    ----------
    half : int
        Pixels of the window on either side of its middle.
    inner : slice
        Its central bar period.
    columns : ndarray of float32, shape (14, 2 * half + 1)
        Factors of the window: for level, amount of a wide and of a narrow bar; for the slope of a
        wide bar's edges and three terms of its Taylor series; the same for a narrow one; and for
        the part explained by the first three, in three orthogonal components.
    contrast_of, level_of, response, response_slope, ground_moment, contrast_moment : ndarray
        Measurements of an undisturbed bar of contrast 1, by its bits and those of its neighbours,
        4 * left + 2 * own + right: sum of amounts and level, response of the slope and its change
        with a shift (per pixel), and change of the response with a tilt of the background and of
        the contrast.
    share : tuple of float
        Centre and half range of abs(narrow - wide) / contrast for a bar.
    unlike : float
        Largest rms difference of a bar from the nearest sum of both kinds, over the contrast.
    displaced : float
        Response, relative to the contrast, of a bar so displaced that its width misleads.

    Raises
    ------
    ValueError
        Bars are so blurred that wide and narrow cannot be distinguished.
    """

    def __init__(self, design, bars):
        self._pitch, self._blur = design.bar_pitch, design.blur
        self._halves = half_widths(design, bars)
        self._slope_blur = max(design.blur, _SHARPEST)
        self.half = int(np.ceil(self._halves[0] + 2.0 * self._slope_blur))
        self._x = np.arange(-self.half, self.half + 1.0)
        combos = np.arange(8)
        self._bits = np.stack([combos >> 2, combos >> 1 & 1, combos & 1], axis=1)
        solve, basis = self._prepare_kinds()
        weights = fixed_point(self._prepare_slopes().reshape(8, -1))
        self.columns = np.concatenate([solve, weights, basis])
        self._prepare_neighbours(weights.reshape(2, 4, -1)[:, 0].astype(float))

    def _light(self, x, shift=0.0):
        """Light at pixels `x` from a bar, for all bits of it and its neighbours, shape (8, x)."""
        return np.array([
            sum(blurred_bar(np.abs(x - shift - (k - 1) * self._pitch), self._halves[b[k]],
                            self._blur) for k in range(3)) for b in self._bits])

    def _prepare_kinds(self):
        """Weights for level, wide and narrow, and those for the part that these explain."""
        x = self._x
        inner = np.abs(x) <= 0.5 * self._pitch
        lights = self._light(x)
        wide = lights[[0, 1, 4, 5]].mean(axis=0)
        narrow = lights[[2, 3, 6, 7]].mean(axis=0)
        wide, narrow = 0.5 * (wide + wide[::-1]), 0.5 * (narrow + narrow[::-1])
        shapes = np.stack([np.ones(len(x)), -wide, -narrow], axis=1)[inner]
        n = np.count_nonzero(inner)
        exact = np.zeros((6, len(x)))
        exact[:3, inner] = np.linalg.pinv(shapes)
        # the first component is symmetric, so that the large level does not affect the others
        exact[3:, inner] = np.linalg.qr(shapes)[0].T / np.sqrt(n)
        rounded = fixed_point(exact)
        rounded[3, inner] = 2.0**-6
        self._explained = np.float32(2.0**12 / n**2)
        solve = rounded[:3].astype(float)
        self.inner = slice(int(np.argmax(inner)), int(np.argmax(inner)) + np.count_nonzero(inner))
        measured = lights @ solve.T
        self.level_of, self.contrast_of = measured[:, 0], -(measured[:, 1] + measured[:, 2])
        # the range for bars half a pixel off; noise is added
        share = np.abs(measured[:, 2] - measured[:, 1]) / self.contrast_of
        if np.linalg.cond(shapes) > 200.0 or share.min() < 0.3:
            raise ValueError(
                f'bar_pitch {self._pitch:g} px with blur {self._blur:g} px: wide and narrow bars '
                'cannot be distinguished; use a larger pitch, less blur or other widths')
        low, high = 0.45 * share.min(), 0.9 + share.max()
        self.share = 0.5 * (high + low), 0.5 * (high - low)
        moved = self._light(x, 0.75)
        rest = self.misfit(moved.astype(np.float32), rounded[3:] @ moved.T.astype(np.float32))
        self.unlike = max(_UNLIKE, 1.3 * np.sqrt(rest.max()))
        return rounded[:3], rounded[3:]

    def misfit(self, cells, parts):
        """Mean square of the residuals of each window from both a wide and a narrow bar.

        Parameters
        ----------
        cells : ndarray, shape (n, 2 * half + 1)
        parts : ndarray, shape (3, n)
            Products of the windows with the last three columns.

        Returns
        -------
        ndarray, shape (n,)
        """
        cells = cells[:, self.inner]
        left = np.einsum('ij,ij->i', cells, cells)
        left /= cells.shape[1]
        level, second, third = np.square(parts)
        level *= self._explained
        left -= level
        left -= second
        left -= third
        return left

    def _prepare_slopes(self):
        """Slopes of the edges and the terms of their Taylor series, shape (2, 4, pixels)."""
        blur, h = self._slope_blur, self.half

        def slope(x, half):
            # zero at the ends, since they move with the template
            edge = np.clip((h - np.abs(x)) / (0.35 * h), 0.0, 1.0)
            taper = edge * edge * (3.0 - 2.0 * edge)
            root = -0.5 / blur**2
            norm = 1.0 / (np.sqrt(_TURN) * blur)
            return norm * taper * (np.exp(root * (x - half) ** 2) - np.exp(root * (x + half) ** 2))

        step, rows = 0.05, []
        for half in self._halves:
            f = [slope(self._x + k * step, half) for k in (-2, -1, 0, 1, 2)]
            rows += [f[2], (f[3] - f[1]) / (2 * step), (f[3] - 2 * f[2] + f[1]) / (2 * step**2),
                     (f[4] - 2 * f[3] + 2 * f[1] - f[0]) / (12 * step**3)]
        return np.array(rows).reshape(2, 4, -1)

    def _prepare_neighbours(self, slopes):
        """Responses to the light of a bar and of its neighbours; `slopes` has shape (2, pixels)."""
        x, pitch = self._x, self._pitch
        own = slopes[self._bits[:, 1]]
        low, middle, high = (np.sum(own * self._light(x, s), axis=1) for s in (-0.25, 0.0, 0.25))
        self.response, self.response_slope = middle, (high - low) / 0.5
        self.displaced = _DISPLACED * pitch * self.response_slope.min()
        # a slope of the background, or of the contrast, acts like a shift
        self.ground_moment = np.sum(own * x, axis=1)
        self.contrast_moment = np.sum(own * x * self._light(x), axis=1)
        # contribution of a shifted right neighbour, by both bits; a left neighbour shifted in the
        # opposite direction contributes the negative
        self._shifts = np.linspace(-0.3, 0.3, 25) * pitch
        self._neighbour = np.array([
            [[slopes[mine] @ blurred_bar(np.abs(x - pitch - s), self._halves[other], self._blur)
              for s in self._shifts] for other in (0, 1)] for mine in (0, 1)])
        alone = np.array([[slopes[k] @ blurred_bar(np.abs(x - s), self._halves[k], self._blur)
                           for s in self._shifts] for k in (0, 1)])
        # a shift beyond the slope appears smaller
        middle = len(self._shifts) // 2
        gain = (alone[:, middle + 1] - alone[:, middle - 1]) / (
            self._shifts[middle + 1] - self._shifts[middle - 1])
        self._apparent = np.maximum.accumulate(alone / gain[:, np.newaxis], axis=1)

    def crosstalk(self, apparent, shifted, missing, narrow):
        """Effect of displaced or missing bars on the response of others.

        Parameters
        ----------
        apparent : ndarray, shape (n, bars)
            Displacement in pixels, assuming a linear response.
        shifted, missing : ndarray of bool, shape (n, bars)
        narrow : ndarray of bool, shape (n, bars)

        Returns
        -------
        ndarray, shape (n, bars)
            For contrast 1.
        """
        out = np.zeros_like(apparent)
        off = np.flatnonzero(shifted | missing)
        off = off[np.isfinite(apparent.take(off))]
        bar = off % out.shape[1]
        kind, apparent, gone = narrow.take(off), apparent.take(off), missing.take(off)
        shift = np.where(kind, np.interp(apparent, self._apparent[1], self._shifts),
                         np.interp(apparent, self._apparent[0], self._shifts))
        places = len(self._shifts)
        middle = places // 2
        shift *= 1.0 / (self._shifts[1] - self._shifts[0])
        for side, end in ((-1, out.shape[1] - 1), (1, 0)):
            # the bar is the neighbour on this `side` of another one
            inside = np.flatnonzero(bar != end)
            other = off[inside] - side
            table = places * (2 * narrow.take(other) + kind[inside])
            at = np.clip(side * shift[inside] + middle, 0.0, 2 * middle - 1e-6)
            low = at.astype(np.int64)
            at -= low
            low += table
            below = self._neighbour.take(low)
            value = below + at * (self._neighbour.take(low + 1) - below)
            value[gone[inside]] = 0.0
            out.ravel()[other] += side * (value - self._neighbour.take(table + middle))
        return out
