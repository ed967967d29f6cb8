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

"""From what the bars show to their bits, and from the bits to the place on the disc."""

import math
from dataclasses import dataclass

import numpy as np

from .disc import WINDOW, windows_of

#: why a frame was rejected, by the number in `template_reader.TemplateReadings.reason`
REASONS = ('', 'not finite', 'saturated', 'no contrast', 'not on the disc', 'ambiguous',
           'bars out of line', 'wrong direction')
(NOT_FINITE, SATURATED, NO_CONTRAST, NOT_ON_DISC, AMBIGUOUS, OUT_OF_LINE,
 WRONG_DIRECTION) = range(1, 8)
_UNLIKE = 0.1  # of the level, by which a bar may be darker or brighter than those around it
_HALF = np.float32(0.5)


def median(values):
    """Median along the last axis, of odd length, which is kept with length 1."""
    middle = values.shape[-1] // 2
    part = values.copy()
    part.partition(middle)
    return part[..., middle : middle + 1]


@dataclass
class Bits:
    """What n rows say, bar by bar; arrays of shape (n, bars).

    Attributes
    ----------
    visible, legible, narrow : ndarray of bool
        Whether the bar is whole in the row, looks like one, and like a narrow one.
    contrast, usual : ndarray
        Its contrast, and the one that a bar at this level has, for shading changes both alike.
    """

    visible: np.ndarray
    legible: np.ndarray
    narrow: np.ndarray
    contrast: np.ndarray
    usual: np.ndarray


class BarDecoder:
    """Bits of the bars in view, and where on the disc they are found.

    Parameters
    ----------
    disc : disc.Disc
    rank : ndarray, shape (bars,)
        Numbers of the bars that may be in view; 0 in the middle.
    template : bar_template.BarTemplate
    smooth : callable
        Makes of rows of values, shape (n, bars), the parabolas through their good bars.
    min_contrast : float
        Of a legible bar, grey levels.
    """

    #: bits by which the match must surpass what chance finds among all places and directions
    MIN_EVIDENCE = 13.0
    #: the same where every legible bar fits, so that bars may be illegible
    MIN_EVIDENCE_EXACT = 9.0
    #: bits by which any other place must fit worse, unless all bars fit
    MIN_MARGIN = 2

    def __init__(self, disc, rank, template, smooth, min_contrast):
        self._disc, self._smooth = disc, smooth
        self._min_contrast = np.float32(min_contrast)
        n, reach = len(rank), len(rank) // 2
        windows = np.roll(windows_of(disc.bits, n), reach, axis=0)
        #: bits of the window with its middle at each bar of the disc, shape (disc.bars, bars)
        self.narrow = windows.astype(bool)
        # doubled, for they meet halves: a product counts equal less unequal bits
        self._signs = np.ascontiguousarray((4.0 * windows - 2.0).T.astype(np.float32))
        first = (n - WINDOW) // 2
        self._central, self._to_middle = slice(first, first + WINDOW), reach - first
        middle, reach = template.share
        # a bar that is out of place looks wider or narrower than it is
        self._usual = np.array([1.05, middle, 0.0, 0.0], np.float32)[:, np.newaxis, np.newaxis]
        self._limits = np.array([0.45, reach, template.displaced, template.unlike**2],
                                np.float32)[:, np.newaxis, np.newaxis]
        # bits of evidence in `wrong` of `count` bars, against all places and both directions
        evidence = np.full((n + 1, n + 1), -np.inf)
        for count in range(n + 1):
            ways = np.cumsum([float(math.comb(count, k)) for k in range(count + 1)])
            evidence[count, : count + 1] = count - np.log2(ways) - np.log2(2.0 * disc.bars)
        self._evidence = evidence

    def bits(self, measured, unlike, visible):
        """Which bars look like bars, and which of them like narrow ones.

        Parameters
        ----------
        measured : ndarray, shape (11, n, bars)
            Products of the windows with the columns of the template.
        unlike : ndarray, shape (n, bars)
            Mean square of what neither a wide nor a narrow bar explains.
        visible : ndarray of bool, shape (n, bars)

        Returns
        -------
        Bits
        """
        level, wide, narrower = measured[0], measured[1], measured[2]
        contrast = wide + narrower
        ratio = contrast / np.maximum(level, 1.0)
        typical = median(ratio)
        usual = typical * level
        difference = narrower - wide
        narrow = difference > 0.0
        odd = np.empty((4, *contrast.shape), dtype=np.float32)
        np.divide(ratio, typical, out=odd[0])
        np.divide(np.abs(difference), contrast, out=odd[1])
        np.divide(np.where(narrow, measured[7], measured[3]), contrast, out=odd[2])
        np.divide(unlike, usual * usual, out=odd[3])
        odd -= self._usual
        np.abs(odd, out=odd)
        tests = odd < self._limits
        legible = np.logical_and.reduce(tests, axis=0)
        legible &= visible
        legible &= usual > self._min_contrast
        if np.logical_or.reduce(legible != visible, axis=None):
            self._look_closer(legible, tests, level, unlike, usual, visible)
        return Bits(visible, legible, narrow, contrast, usual)

    def _look_closer(self, legible, tests, level, unlike, usual, visible):
        """Where not all is well, allow for noise; then drop bars of which a blob hides a part."""
        rows = np.flatnonzero(np.logical_or.reduce(legible != visible, axis=1))
        level, unlike = level[rows], unlike[rows]
        limit = self._limits[3] * usual[rows] ** 2 + 2.0 * median(unlike)
        good = tests[0, rows] & tests[1, rows] & tests[2, rows] & visible[rows]
        good &= unlike < limit
        good &= usual[rows] > self._min_contrast
        # near a blob, of which part is in the window, the ground is lower than elsewhere
        dirty = np.flatnonzero(np.logical_or.reduce(good != visible[rows], axis=1))
        level, near = level[dirty], good[dirty]
        near &= level > 0.25 * median(level)
        curve = self._smooth(level, near)
        good[dirty] = near & (np.abs(level - curve) < _UNLIKE * curve)
        legible[rows] = good

    def find(self, bits):
        """Place on the disc.

        Parameters
        ----------
        bits : Bits

        Returns
        -------
        bar : ndarray of int, shape (n,)
            Number of the bar in the middle of the row.
        good : ndarray of bool, shape (n, bars)
            Bars that are legible and as the code has them.
        wrong : ndarray of int, shape (n,)
            How many others are visible.
        reason : ndarray of int8, shape (n,)
            0 where the place is certain.
        """
        n, legible, visible = len(bits.legible), bits.legible, bits.visible
        bar = self._disc.find(bits.narrow[:, self._central])
        bar += self._to_middle
        bar %= self._disc.bars
        good = self.narrow[bar] == bits.narrow
        good &= legible
        wrong, reason = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int8)
        # any two windows of the disc differ: nothing else can fit where all visible bars do
        other = good != visible
        if np.logical_or.reduce(other, axis=None):
            rows = np.flatnonzero(np.logical_or.reduce(other, axis=1))
            legible, narrow, visible = legible[rows], bits.narrow[rows], visible[rows]
            bar[rows], reason[rows] = self._match(legible, narrow, visible)
            fits = legible & (self.narrow[bar[rows]] == narrow)
            good[rows] = fits
            wrong[rows] = np.add.reduce(visible, axis=1) - np.add.reduce(fits, axis=1)
        return bar, good, wrong, reason

    def _match(self, legible, narrow, visible):
        """The place that fits best of all, and what speaks against it."""
        count = np.add.reduce(legible, axis=1)
        bar, wrong, clear = self._compare(legible, narrow, count)
        reason = np.zeros(len(bar), dtype=np.int8)
        doubtful = count - 2 * wrong < np.add.reduce(visible, axis=1)
        needed = np.where(wrong > 0, self.MIN_EVIDENCE, self.MIN_EVIDENCE_EXACT)
        reason[doubtful & (self._evidence[count, wrong] < needed)] = NOT_ON_DISC
        reason[doubtful & (reason == 0) & ~clear] = AMBIGUOUS
        return bar, reason

    def _compare(self, legible, narrow, count):
        """The place that fits best, its wrong bars, and whether all others are far worse."""
        signs = np.subtract(narrow, _HALF, dtype=np.float32)
        signs *= legible
        match = signs @ self._signs  # whole numbers: bits that fit, less those that do not
        each = np.arange(len(match))
        bar = match.argmax(axis=1)
        score = match[each, bar].astype(np.int64)
        match[each, bar] = -np.inf
        return bar, (count - score) // 2, score - match.max(axis=1) >= 2 * self.MIN_MARGIN
