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

"""Determines the bits of the bars, and from the bits the place on the disc."""

import math
from dataclasses import dataclass

import numpy as np

from .disc import WINDOW, windows_of

#: reasons for rejecting a frame, by the number in `template_reader.TemplateReadings.reason`
REASONS = ('', 'not finite', 'saturated', 'no contrast', 'not on the disc', 'ambiguous',
           'bars out of line', 'wrong direction')
(NOT_FINITE, SATURATED, NO_CONTRAST, NOT_ON_DISC, AMBIGUOUS, OUT_OF_LINE,
 WRONG_DIRECTION) = range(1, 8)
_UNLIKE = 0.1  # largest relative deviation of a bar's level from those around it
_HALF = np.float32(0.5)


def median(values):
    """Median along the last axis, of odd length, which is kept with length 1."""
    middle = values.shape[-1] // 2
    part = values.copy()
    part.partition(middle)
    return part[..., middle : middle + 1]


@dataclass
class Bits:
    """Decoded bars of n rows; arrays of shape (n, bars).

    Attributes
    ----------
    visible, legible, narrow : ndarray of bool
        Whether the bar is completely in the row, looks like a bar, and like a narrow one.
    contrast, usual : ndarray
        Contrast of the bar, and the usual one at its level, as shading changes both in proportion.
    """

    visible: np.ndarray
    legible: np.ndarray
    narrow: np.ndarray
    contrast: np.ndarray
    usual: np.ndarray


class BarDecoder:
    """Decodes the bits of the bars in view, and finds them on the disc.

    Parameters
    ----------
    disc : disc.Disc
    rank : ndarray, shape (bars,)
        Numbers of the bars that may be in view; 0 in the middle.
    template : bar_template.BarTemplate
    smooth : callable
        Replaces rows of values, shape (n, bars), by the parabolas through their good bars.
    min_contrast : float
        Least contrast of a legible bar, grey levels.
    """

    #: bits of evidence by which a match must exceed chance, over all places and both directions
    MIN_EVIDENCE = 13.0
    #: the same if all legible bars match, so that some bars may be illegible
    MIN_EVIDENCE_EXACT = 9.0
    #: bits by which all other places must match worse, unless all bars match
    MIN_MARGIN = 2

    def __init__(self, disc, rank, template, smooth, min_contrast):
        self._disc, self._smooth = disc, smooth
        self._min_contrast = np.float32(min_contrast)
        n, reach = len(rank), len(rank) // 2
        windows = np.roll(windows_of(disc.bits, n), reach, axis=0)
        #: bits of the window with its middle at each bar of the disc, shape (disc.bars, bars)
        self.narrow = windows.astype(bool)
        # doubled, since they multiply halves: the product is the number of equal minus unequal bits
        self._signs = np.ascontiguousarray((4.0 * windows - 2.0).T.astype(np.float32))
        first = (n - WINDOW) // 2
        self._central, self._to_middle = slice(first, first + WINDOW), reach - first
        middle, reach = template.share
        # a displaced bar looks wider or narrower than it is
        self._usual = np.array([1.05, middle, 0.0, 0.0], np.float32)[:, np.newaxis, np.newaxis]
        self._limits = np.array([0.45, reach, template.displaced, template.unlike**2],
                                np.float32)[:, np.newaxis, np.newaxis]
        # bits of evidence with `wrong` of `count` bars, over all places and both directions
        evidence = np.full((n + 1, n + 1), -np.inf)
        for count in range(n + 1):
            ways = np.cumsum([float(math.comb(count, k)) for k in range(count + 1)])
            evidence[count, : count + 1] = count - np.log2(ways) - np.log2(2.0 * disc.bars)
        self._evidence = evidence

    def bits(self, measured, unlike, visible):
        """Determine which bars look like bars, and which like narrow ones.

        Parameters
        ----------
        measured : ndarray, shape (11, n, bars)
            Products of the windows with the columns of the template.
        unlike : ndarray, shape (n, bars)
            Mean square of the residuals from both a wide and a narrow bar.
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
        """If not all bars are legible, allow for noise; then drop bars partly hidden by dust."""
        rows = np.flatnonzero(np.logical_or.reduce(legible != visible, axis=1))
        level, unlike = level[rows], unlike[rows]
        limit = self._limits[3] * usual[rows] ** 2 + 2.0 * median(unlike)
        good = tests[0, rows] & tests[1, rows] & tests[2, rows] & visible[rows]
        good &= unlike < limit
        good &= usual[rows] > self._min_contrast
        # near dust, part of which is in the window, the background is lower than elsewhere
        dirty = np.flatnonzero(np.logical_or.reduce(good != visible[rows], axis=1))
        level, near = level[dirty], good[dirty]
        near &= level > 0.25 * median(level)
        curve = self._smooth(level, near)
        good[dirty] = near & (np.abs(level - curve) < _UNLIKE * curve)
        legible[rows] = good

    def find(self, bits):
        """Find the place on the disc.

        Parameters
        ----------
        bits : Bits

        Returns
        -------
        bar : ndarray of int, shape (n,)
            Number of the bar in the middle of the row.
        good : ndarray of bool, shape (n, bars)
            Bars that are legible and match the code.
        wrong : ndarray of int, shape (n,)
            Number of other visible bars.
        reason : ndarray of int8, shape (n,)
            0 if the place is certain.
        """
        n, legible, visible = len(bits.legible), bits.legible, bits.visible
        bar = self._disc.find(bits.narrow[:, self._central])
        bar += self._to_middle
        bar %= self._disc.bars
        good = self.narrow[bar] == bits.narrow
        good &= legible
        wrong, reason = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int8)
        # all windows of the disc differ: if all visible bars match, no other place can
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
        """The best matching place, and a reason for rejecting it."""
        count = np.add.reduce(legible, axis=1)
        bar, wrong, clear = self._compare(legible, narrow, count)
        reason = np.zeros(len(bar), dtype=np.int8)
        doubtful = count - 2 * wrong < np.add.reduce(visible, axis=1)
        needed = np.where(wrong > 0, self.MIN_EVIDENCE, self.MIN_EVIDENCE_EXACT)
        reason[doubtful & (self._evidence[count, wrong] < needed)] = NOT_ON_DISC
        reason[doubtful & (reason == 0) & ~clear] = AMBIGUOUS
        return bar, reason

    def _compare(self, legible, narrow, count):
        """Best matching place, number of its wrong bars, and whether all others match far worse."""
        signs = np.subtract(narrow, _HALF, dtype=np.float32)
        signs *= legible
        match = signs @ self._signs  # integers: matching minus other bits
        each = np.arange(len(match))
        bar = match.argmax(axis=1)
        score = match[each, bar].astype(np.int64)
        match[each, bar] = -np.inf
        return bar, (count - score) // 2, score - match.max(axis=1) >= 2 * self.MIN_MARGIN
