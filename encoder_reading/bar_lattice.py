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

"""Positions of the bars in the row of pixels, independent of their bits."""

import numpy as np

from .bar_template import fixed_point
from .disc import pixel_places

_TURN = 2.0 * np.pi
_WIDTH, _STEP = 5.0, 2.5  # of the windows, in bar periods
_EVERY = 3  # pixels: enough for a tenth of a pixel
_LARGEST = 0.012  # largest relative scale error
_TINY = np.float32(1e-6)


class BarLattice:
    """Phase and scale of the bar period along the row.

    Parameters
    ----------
    design : design.Design
        Its nominal image is used.
    bars : int
        Number of bars of the disc.
    half : int
        Pixels that a complete bar needs on either side of its middle.

    Attributes
    ----------
    rank : ndarray of float32, shape (bars in view,)
        Numbers of the bars that may be in view; 0 is the one nearest to the middle of the row.
        All but the first and the last are always in view.
    per_pixel : float
        Bar periods per pixel, in the middle of the row.
    flat : bool
        Whether they decrease towards the ends.
    """

    def __init__(self, design, bars, half):
        self._half, self._last = half, design.pixels - 1 - half
        self._pitch = np.float32(design.bar_pitch)
        self._middle = np.float32(0.5 * (design.pixels - 1))
        self._place = pixel_places(design, bars)
        self.flat = design.geometry == 'tangent'
        self.per_pixel = np.float32(1.0 / design.bar_pitch)
        self._magnification = (np.gradient(self._place) * design.bar_pitch).astype(np.float32)
        reach = int(np.interp(self._last, np.arange(design.pixels), self._place) + 0.5)
        self.rank = np.arange(-reach, reach + 1, dtype=np.float32)
        self._prepare_windows()

    def _prepare_windows(self):
        """Windowed sine and cosine of the bar period, shape (pixels / 3, 2 * windows)."""
        place = self._place[::_EVERY]
        n = int((place[-1] - place[0] - _WIDTH) / _STEP) + 1
        middles = _STEP * (np.arange(n) - 0.5 * (n - 1))
        columns = []
        for middle in middles:
            x = place - middle
            window = np.where(np.abs(x) < 0.5 * _WIDTH, np.cos(np.pi * x / _WIDTH) ** 2, 0.0)
            # remove level and slope of the background
            ground = np.stack([np.ones_like(x), x], axis=1)
            wave = -np.exp(-1j * _TURN * place)
            project = np.linalg.solve(ground.T @ (window[:, None] * ground), ground.T * window)
            column = window * (wave - ground @ (project @ wave))
            columns += [column.real, column.imag]
        self._waves = np.ascontiguousarray(fixed_point(np.array(columns)).T)
        self._turns = (_TURN * middles).astype(np.float32)
        self._lag = min(8, n // 3)
        self._scale = np.float32(1.0 / (_TURN * _STEP * self._lag))

    def locate(self, frames):
        """Position of bar 0, and relative scale error.

        Parameters
        ----------
        frames : ndarray, shape (n, pixels)

        Returns
        -------
        alpha, beta : ndarray of float32, shape (n,)
            Bar `rank` is at alpha + (1 + beta) * rank bar periods from the middle of the row.
        """
        # pairs of cosine and sine products, viewed as complex numbers
        waves = (frames[:, ::_EVERY].astype(np.float32) @ self._waves).view(np.complex64)
        # use only their phase, so that dust has no more weight than the bars that it hides
        waves /= np.maximum(np.abs(waves), _TINY)
        lag = self._lag
        lagged = np.add.reduce(waves[:, lag:] * waves[:, :-lag].conj(), axis=1)
        scale = np.arctan2(lagged.imag, lagged.real) * -self._scale
        scale = np.minimum(np.maximum(scale, -_LARGEST), _LARGEST)
        turns = scale[:, np.newaxis] * self._turns
        turned = np.empty_like(waves)
        np.cos(turns, out=turned.real)
        np.sin(turns, out=turned.imag)
        waves *= turned
        total = np.add.reduce(waves, axis=1)
        return np.arctan2(total.imag, total.real) * (-1.0 / _TURN) * (1.0 + scale), scale

    def pixels(self, alpha, beta):
        """Pixel at which to expect each bar.

        Returns
        -------
        pixel : ndarray of int, shape (n, bars)
            The nearest pixel whose window is within the row.
        beyond : ndarray of float32, shape (n, bars)
            Offset of the bar from its pixel.
        visible : ndarray of bool, shape (n, bars)
            Whether the bar is completely in the row.
        """
        alpha, beta = alpha[:, np.newaxis], beta[:, np.newaxis]
        if self.flat:
            place = alpha + self.rank * (1.0 + beta)
            exact = np.interp(place, self._place, np.arange(len(self._place)), -1.0,
                              len(self._place)).astype(np.float32)
        else:
            exact = self.rank * (self._pitch + self._pitch * beta)
            exact += alpha * self._pitch + self._middle
        pixel = np.rint(exact)
        inside = np.minimum(np.maximum(pixel, self._half), self._last)
        exact -= pixel
        return inside.astype(np.intp), exact, inside == pixel

    def magnification(self, pixel):
        """Bar periods per pixel at a pixel, relative to the middle of the row."""
        return self._magnification[pixel]

    def pixels_of(self, pixel):
        """Pixels per bar period at a pixel."""
        return self._pitch / self._magnification[pixel]
