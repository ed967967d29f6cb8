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

"""The default method: compares every visible bar with its expected appearance."""

from dataclasses import dataclass

import numpy as np

from .bar_decoding import (
    NO_CONTRAST,
    NOT_FINITE,
    NOT_ON_DISC,
    OUT_OF_LINE,
    SATURATED,
    WRONG_DIRECTION,
    BarDecoder,
)
from .bar_fit import BarLine, Bars
from .bar_lattice import BarLattice
from .bar_template import BarTemplate
from .disc import windows_of
from .frame_readings import REJECTED, FrameReadings, checked_frames

_CHUNK = 1024  # frames processed at once: calls then cost little, with 12 MB
_WINDOWS = 8192  # bars processed at once, which fit in the cache
_FEWEST = 22  # bars needed to determine the direction
_LARGEST = 1e6  # grey level in float frames


@dataclass(frozen=True)
class TemplateReadings(FrameReadings):
    """Readings of `TemplateReader` with further results.

    Attributes
    ----------
    reason : ndarray of int8, shape (n,)
        Index into `bar_decoding.REASONS`; 0 if the frame was read.
    backwards : ndarray of bool, shape (n,)
        Whether the pixels run against the disc.
    wrong : ndarray of int, shape (n,)
        Number of visible bars that differ from the code or could not be read.
    used : ndarray of int, shape (n,)
        Number of bars that determined the angle.

    Notes
    -----
    `sigma` is computed from the scatter of the bars about their line.
    """

    reason: np.ndarray
    backwards: np.ndarray
    wrong: np.ndarray
    used: np.ndarray


class TemplateReader:
    """Decodes, then fits the template of the decoded bars.

    1. Sine and cosine of the nominal bar period in windows along the row give phase and scale
       to a tenth of a pixel, independent of the bits (`bar_lattice`).
    2. A window of the row around each bar is compared with a wide and with a narrow bar: bit,
       contrast and level (`bar_template`). Bars that resemble neither are left out.
    3. The bits in the middle are looked up on the disc; if not all of the row matches there, it
       is compared with all places of the disc (`bar_decoding`).
    4. The slope of the bar's two edges, which by the code belong to a wide or a narrow bar between
       known neighbours, gives the shift of each bar; contrast and level are taken from a smooth
       curve along the row, so that shading does not appear as a shift.
    5. A robust straight line through the shifts gives position and scale; with the weights of
       step 4 it is the least-squares fit of the whole template (`bar_fit`). If the line has moved
       beyond the linear range of the response, or bars are off it, the fit is repeated from there,
       including the effect of displaced and missing bars on the windows of their neighbours.

    A frame that runs against the disc is recognised, since from 22 bars on no window of the codes
    read backwards equals one read forwards; the angle in the middle of the row is the same.

    An 8-bit frame is read identically to the last bit, whatever is read with it: products
    with pixels are exact (`bar_template.fixed_point`), and everything else is done row by row.

    Parameters
    ----------
    design : design.Design
        Its `mounting` gives the allowed direction of the pixels; frames in the other direction
        are rejected.
    disc : disc.Disc, optional
        A disc other than that of the design.

    Raises
    ------
    ValueError
        Fewer than 22 bars in view; bars so blurred that wide and narrow cannot be distinguished.
    """

    #: readings do not depend on the number of frames read at once
    BLOCK = None
    #: largest fraction of the pixels at 255
    MAX_SATURATED = 0.05
    #: least contrast, grey levels
    MIN_CONTRAST = 4.0
    #: least fraction of the bars that may be in view in the line
    MIN_SHARE = 0.5
    #: largest scatter of the bars about their line, bar periods
    MAX_SCATTER = 0.1
    #: largest relative error of the scale
    MAX_SCALE = 0.02
    #: largest correction of the line's initial position, bar periods
    MAX_MOVE = 0.25

    def __init__(self, design, disc=None):
        self.disc = disc = design.disc if disc is None else disc
        self.mounting, self.pixels = design.mounting, design.pixels
        self._template = BarTemplate(design, disc.bars)
        self._lattice = BarLattice(design, disc.bars, self._template.half)
        n = len(self._lattice.rank)
        if n - 1 < _FEWEST:
            raise ValueError(
                f'{self.pixels} pixels at {design.bar_pitch:g} px a bar show {n - 1} whole bars: '
                f'{_FEWEST} are needed for place and direction')
        bits = disc.bits.astype(np.int64)
        codes = 4 * np.roll(bits, 1) + 2 * bits + np.roll(bits, -1)
        codes = np.roll(windows_of(codes, n), n // 2, axis=0)
        self._line = BarLine(design, self._lattice, self._template, codes)
        self._decoder = BarDecoder(disc, self._lattice.rank, self._template, self._line.smooth,
                                   self.MIN_CONTRAST)
        self._fewest = self.MIN_SHARE * n
        self._backwards = False

    def read(self, frames):
        """Read frames.

        Parameters
        ----------
        frames : ndarray, shape (n, pixels)
            Grey levels as delivered by the CCD, with dark bars.

        Returns
        -------
        TemplateReadings

        Raises
        ------
        ValueError
            Wrong number of pixels.
        """
        frames = checked_frames(frames, self.pixels)
        if len(frames) == 0:
            kinds = (float, np.int8, float, np.int8, bool, np.int64, np.int64)
            return TemplateReadings(*(np.empty(0, dtype=kind) for kind in kinds))
        # invalid images lead to invalid numbers, and are rejected at the end
        with np.errstate(all='ignore'):
            if len(frames) <= _CHUNK:
                return TemplateReadings(*self._read(frames))
            parts = [self._read(frames[i : i + _CHUNK]) for i in range(0, len(frames), _CHUNK)]
        return TemplateReadings(*(np.concatenate(column) for column in zip(*parts)))

    def _read(self, frames):
        """The fields of TemplateReadings; tries the other direction if the code does not match."""
        turned = self.mounting == 'reversed' or self.mounting == 'detect' and self._backwards
        fields = self._read_one_way(frames[:, ::-1] if turned else frames)
        reason, backwards = fields[3:5]
        backwards[:] = turned
        failed = np.flatnonzero(reason == NOT_ON_DISC)
        if len(failed):
            again = self._read_one_way(frames[failed] if turned else frames[failed, ::-1])
            fits = again[3] == 0
            rows = failed[fits]
            if self.mounting != 'detect':
                reason[rows] = WRONG_DIRECTION
            else:
                again[4][:] = not turned
                for field, values in zip(fields, again):
                    field[rows] = values[fits]
                # the direction tried first only affects the speed
                self._backwards ^= len(rows) > 0.5 * len(frames)
        return fields

    def _read_one_way(self, frames):
        n = len(frames)
        frames, spoilt = _usable(frames)
        alpha, beta = self._lattice.locate(frames)
        pixel, shift, visible = self._lattice.pixels(alpha, beta)
        measured, unlike = self._measure(frames, pixel)
        bits = self._decoder.bits(measured, unlike, visible)
        bar, good, wrong, reason = self._decoder.find(bits)
        move, turn, used, spread = self._line.fit(bar, Bars(
            measured=measured, contrast=bits.contrast, visible=visible, pixel=pixel, shift=shift,
            narrow=self._decoder.narrow[bar], good=good))
        alpha, beta = alpha + move, beta + turn

        fine = used >= self._fewest
        fine &= spread <= self.MAX_SCATTER
        fine &= np.abs(beta) <= self.MAX_SCALE
        fine &= np.abs(move) <= self.MAX_MOVE
        # always positive, so that no angle is rounded up to a full turn
        place = (bar + self.disc.bars) - alpha.astype(float) / (1.0 + beta)
        angle = np.fmod(place, self.disc.bars) * self.disc.bar_angle
        sigma = spread * self.disc.bar_angle / np.sqrt(used)
        quality = (wrong > 0).astype(np.int8)
        bright = np.maximum.reduce(frames, axis=None) >= 255
        if bright or spoilt is not None or not np.logical_and.reduce(fine & (reason == 0)):
            self._reject(frames if bright else None, bits, fine, spoilt, reason)
            rejected = reason > 0
            angle[rejected] = sigma[rejected] = np.nan
            quality[rejected] = REJECTED
        return angle, quality, sigma, reason, np.zeros(n, dtype=bool), wrong, used

    def _reject(self, frames, bits, fine, spoilt, reason):
        """Set the reason of each invalid frame; later checks take precedence.

        `frames`: None if no pixel is saturated.
        """
        reason[~fine & (reason == 0)] = OUT_OF_LINE
        reason[np.maximum.reduce(bits.usual, axis=1) < self.MIN_CONTRAST] = NO_CONTRAST
        if frames is not None:
            reason[np.mean(frames >= 255, axis=1) > self.MAX_SATURATED] = SATURATED
        if spoilt is not None:
            reason[spoilt] = NOT_FINITE

    def _measure(self, frames, pixel):
        """Measure the window of the row around each bar.

        Returns
        -------
        measured : ndarray, shape (11, n, bars)
            Products of the windows with the columns of the template.
        unlike : ndarray, shape (n, bars)
            Mean square of the residuals from both a wide and a narrow bar.
        """
        n, half = len(frames), self._template.half
        length = 2 * half + 1
        # view of all windows of the consecutive rows, without a copy
        windows = np.ndarray((frames.size - length + 1, length), frames.dtype, frames, 0,
                             2 * frames.strides[1:])
        first = (pixel + (self.pixels * np.arange(n)[:, np.newaxis] - half)).ravel()
        measured = np.empty((11, first.size), dtype=np.float32)
        unlike = np.empty(first.size, dtype=np.float32)
        buffer = np.empty((min(first.size, _WINDOWS), length), dtype=np.float32)
        for begin in range(0, first.size, _WINDOWS):
            part = slice(begin, begin + _WINDOWS)
            cells = buffer[: len(first[part])]
            cells[:] = windows[first[part]]
            products = self._template.columns @ cells.T
            measured[:, part] = products[:11]
            unlike[part] = self._template.misfit(cells, products[11:])
        return measured.reshape(-1, *pixel.shape), unlike.reshape(pixel.shape)


def _usable(frames):
    """Contiguous frames, 8-bit or float32, and the rows that are not grey levels."""
    if frames.dtype == np.uint8:
        return np.ascontiguousarray(frames), None
    frames = np.ascontiguousarray(frames, dtype=np.float32)
    spoilt = ~(np.abs(frames).max(axis=1) < _LARGEST)
    if spoilt.any():
        frames = np.where(spoilt[:, np.newaxis], np.float32(0.0), frames)
    return frames, spoilt
