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

"""The method of paper 001, with its faults; the baseline of `template_reader`."""

from dataclasses import dataclass

import numpy as np

from .disc import INVERSION, WINDOW
from .frame_readings import EXACT, REJECTED, FrameReadings, checked_frames

THRESHOLD = 150.0
WIDTH_THRESHOLD = 3000.0
TOLERANCE = 1e-6
MIN_R_SQUARE = 0.6
_TURN = 2.0 * np.pi
_CHUNK = 64  # frames worked on at once, to bound the memory


class BarReader:
    """Decoding of paper 001, section 2.1, common to its method and its rivals.

    The row is inverted (eq. 4). Bars are runs of pixels above a threshold, '0' if their integrated
    grey level reaches the width threshold, else '1'. Bars that touch an end of the row are ignored.
    The first 18 are searched in the code, for which the paper uses the Knuth-Morris-Pratt search; a
    table of all windows gives the same answer.

    Parameters
    ----------
    design : design.Design
        Uses its `pixels`, `bar_pitch` and `mounting`.
    disc : disc.Disc, optional
        A disc other than that of the design.

    Notes
    -----
    With noise the edge of a bar crosses the threshold several times. The paper does not say how it
    treats that; here gaps and bars narrower than 5 pixels are ignored.
    """

    #: number of frames to read at once, so that the last digit does not depend on their number
    BLOCK = 8
    _SMALLEST = 5
    _READINGS = FrameReadings
    _COLUMNS = 1  # number returned by `_place`: place in bars, not wrapped, and others

    def __init__(self, design, disc=None):
        self.disc = design.disc if disc is None else disc
        self.pitch, self.pixels = design.bar_pitch, design.pixels
        self._turned = design.mounting == 'reversed'
        self.middle = 0.5 * (self.pixels - 1)

    def read(self, frames):
        """Read frames.

        Parameters
        ----------
        frames : ndarray, shape (n, pixels)
            Grey levels as delivered by the CCD, with dark bars.

        Returns
        -------
        PaperReadings
            EXACT or REJECTED, without sigma: these methods correct and estimate nothing.

        Raises
        ------
        ValueError
            Wrong number of pixels.
        """
        frames = checked_frames(frames, self.pixels)
        frames = frames[:, ::-1] if self._turned else frames
        columns = np.full((self._COLUMNS, len(frames)), np.nan)
        for i in range(0, len(frames), _CHUNK):
            grey = INVERSION - frames[i : i + _CHUNK]
            bars = self.decode(grey)
            found = np.flatnonzero(bars.first >= 0)
            if len(found):
                columns[:, i + found] = self._place(grey[found], bars.rows(found))
        angle = columns[0] % self.disc.bars * self.disc.bar_angle
        # values just below a full turn are rounded up to it
        angle = np.where(angle >= _TURN, 0.0, angle)
        quality = np.where(np.isnan(angle), REJECTED, EXACT).astype(np.int8)
        return self._READINGS(angle, quality, np.full(len(frames), np.nan), *columns[1:])

    def decode(self, grey):
        """Complete bars of inverted frames, shape (n, pixels).

        Returns
        -------
        PaperBars
        """
        n, pixels = grey.shape
        row_length = pixels + 2  # a dark pixel at either end keeps the rows apart
        bright = np.zeros((n, row_length), dtype=bool)
        bright[:, 1:-1] = grey > THRESHOLD
        steps = np.diff(bright.ravel().view(np.int8))
        starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
        # in both, pixel x of row r is at r * row_length + x; `ends` is one past the bar
        separate = starts[1:] - ends[:-1] >= self._SMALLEST
        separate |= starts[1:] // row_length != starts[:-1] // row_length
        if len(starts):
            starts = starts[np.concatenate([[True], separate])]
            ends = ends[np.concatenate([separate, [True]])]
        row = starts // row_length
        starts, ends = starts - row * row_length, ends - row * row_length
        whole = (starts > 0) & (ends < pixels) & (ends - starts >= self._SMALLEST)
        # NaN is never above the threshold: do not trust such a frame
        whole &= np.isfinite(grey).all(axis=1)[row]
        row, starts, ends = row[whole], starts[whole], ends[whole]

        count = np.bincount(row, minlength=n)
        rank = np.arange(len(row)) - (np.cumsum(count) - count)[row]
        shape = n, max(WINDOW, int(count.max(initial=0)))
        start, end = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)
        start[row, rank], end[row, rank] = starts, ends
        total = np.zeros((n, pixels + 1))
        np.cumsum(grey, axis=1, out=total[:, 1:])
        rows = np.arange(n)[:, np.newaxis]
        narrow = total[rows, end[:, :WINDOW]] - total[rows, start[:, :WINDOW]] < WIDTH_THRESHOLD
        first = np.where(count >= WINDOW, self.disc.find(narrow), -1)
        return PaperBars(first, count, start, end)


class PaperBars:
    """Complete bars of n frames.

    Attributes
    ----------
    first : ndarray of int, shape (n,)
        Number on the disc of the first bar; -1 if the first 18 are not on the disc.
    count : ndarray of int, shape (n,)
    start, end : ndarray of int, shape (n, k)
        First pixel, and one past the last; meaningless beyond `count`.
    """

    def __init__(self, first, count, start, end):
        self.first, self.count, self.start, self.end = first, count, start, end

    def rows(self, rows):
        return PaperBars(self.first[rows], self.count[rows], self.start[rows], self.end[rows])

    @property
    def centre(self):
        """Middle of each run, pixels, shape (n, k)."""
        return 0.5 * (self.start + self.end - 1)


@dataclass(frozen=True)
class PaperReadings(FrameReadings):
    """Readings of `PaperReader` with the fit; NaN if there was nothing to fit.

    Attributes
    ----------
    r_square : ndarray, shape (n,)
        Goodness of the fit (eq. 7).
    period : ndarray, shape (n,)
        Period of the fitted sine, pixels.
    """

    r_square: np.ndarray
    period: np.ndarray


class PaperReader(BarReader):
    """The paper's own method: a sine through the whole row (eqs. 5 to 13).

    Newton's method fits ``A sin(w x + phi) + n`` to the inverted row, starting from a straight
    line through the decoded bars, until the norm of the step is at most 1e-6; fits with an
    R-square below 0.6 or without convergence are rejected. The phase at pixel 0, by the rule of
    eq. 12, gives the position within a bar, and the first complete bar the number. Eq. 11 is
    relative to a first reading; here that is the nominal row with bar 0 in its middle.

    Parameters
    ----------
    design, disc
        As for the others.
    cycle : {'equation12', 'centres'}
        How the phase is assigned to a bar: by the paper's rule, or by the decoded bars' centres.

    Notes
    -----
    Eq. 12 is only valid if the widest bar takes less than half a period. At 48 pixels per bar the
    wide bars take 25.9: a phase just below 0 then belongs to a bar that is cut off and ignored, and
    the reading is wrong by one bar (1200").

    Bars cut by the ends of the row distort the fitted period, and the phase at pixel 0 extrapolates
    this: 4 to 5" (1 sigma over the disc).
    """

    _MAX_ITERATIONS = 30
    _READINGS = PaperReadings
    _COLUMNS = 3

    def __init__(self, design, disc=None, cycle='equation12'):
        super().__init__(design, disc)
        if cycle not in ('equation12', 'centres'):
            raise ValueError(f"cycle {cycle!r} is not one of 'equation12', 'centres'")
        self.cycle = cycle
        self._x = np.arange(float(self.pixels))

    def _place(self, grey, bars):
        rank = np.arange(WINDOW)
        centre = bars.centre[:, :WINDOW]
        omega, phase = sine_start(rank, centre)
        (_, omega, phase, _), r_square = self.fit(grey, omega, phase)
        if self.cycle == 'equation12':
            phase = self._equation12(phase, omega, bars.start[:, 0])
        else:
            # bar k of the window has its centre at the maximum with this number
            cycles = (omega[:, np.newaxis] * centre + phase[:, np.newaxis]) / _TURN - 0.25
            phase = phase - _TURN * np.rint(np.mean(cycles - rank, axis=1))
        nominal = 0.5 * np.pi - _TURN * self.middle / self.pitch
        place = bars.first + (phase - nominal) / _TURN  # eq. 11 with p1 = 0
        place = np.where(r_square >= MIN_R_SQUARE, place, np.nan)
        return np.stack([place, r_square, _TURN / omega])

    def _equation12(self, phase, omega, start):
        period = _TURN / (0.5 * (omega + _TURN / self.pitch))  # eq. 13, with the nominal reading
        return np.where((phase > 0.0) & (start >= period / 3.0), phase - _TURN, phase)

    def fit(self, grey, omega, phase):
        """Least-squares sine of each row by Newton's method.

        Parameters
        ----------
        grey : ndarray, shape (n, pixels)
            Inverted grey levels.
        omega, phase : ndarray, shape (n,)
            Initial values, rad per pixel and rad.

        Returns
        -------
        unknowns : ndarray, shape (4, n)
            Amplitude (positive), frequency, phase at pixel 0 in [-pi, pi) and level (eq. 5).
        r_square : ndarray, shape (n,)
            Goodness of the fit (eq. 7), 0 without convergence.
        """
        x = self._x[: grey.shape[1]]
        level = grey.mean(axis=1)
        spread = np.sum((grey - level[:, np.newaxis]) ** 2, axis=1)
        amplitude = np.sqrt(2.0 * spread / len(x))
        unknowns = np.stack([amplitude, omega, phase, level], axis=1)
        misfit = np.empty(len(grey))
        going = np.arange(len(grey))
        for _ in range(self._MAX_ITERATIONS):
            gradient, hessian, misfit[going] = _derivatives(grey[going], x, unknowns[going])
            # far from the solution the Hessian may be singular: such fits do not converge
            hessian[np.linalg.det(hessian) == 0.0] = np.eye(4)
            step = np.linalg.solve(hessian, -gradient[:, :, np.newaxis])[:, :, 0]
            unknowns[going] += step
            going = going[~(np.linalg.norm(step, axis=1) <= TOLERANCE)]  # eq. 6
            if len(going) == 0:
                break
        r_square = 1.0 - misfit / np.maximum(spread, 1e-9)
        r_square[going] = 0.0
        amplitude, omega, phase, level = unknowns.T
        phase = np.where(amplitude < 0.0, phase + np.pi, phase)
        phase = (phase + np.pi) % _TURN - np.pi
        return np.stack([np.abs(amplitude), omega, phase, level]), r_square


def sine_start(rank, centre):
    """Frequency and phase at pixel 0 from the line through bars, whose centres are maxima.

    Parameters
    ----------
    rank : ndarray, shape (k,)
    centre : ndarray, shape (n, k)
        Pixels.
    """
    offset = rank - rank.mean()
    slope = centre @ offset / (offset @ offset)
    start = centre.mean(axis=1) - slope * rank.mean()
    return _TURN / slope, 0.5 * np.pi - _TURN * start / slope


def _derivatives(grey, x, unknowns):
    """Gradient, Hessian and value of the sum of squares (the derivatives halved)."""
    a, w, p, level = unknowns[:, :, np.newaxis].transpose(1, 0, 2)
    argument = w * x + p
    sine, cosine = np.sin(argument), np.cos(argument)
    rest = grey - a * sine - level
    powers = np.stack([np.ones_like(x), x, x * x], axis=1)
    s, c = sine @ powers, cosine @ powers
    ss, sc = (sine * sine) @ powers, (sine * cosine) @ powers
    cc = powers.sum(axis=0) - ss
    rs, rc = (rest * sine) @ powers, (rest * cosine) @ powers
    a = a[:, 0]
    gradient = -np.stack([rs[:, 0], a * rc[:, 1], a * rc[:, 0], rest.sum(axis=1)], axis=1)
    hessian = np.empty((len(grey), 4, 4))
    hessian[:, 0, 0] = ss[:, 0]
    hessian[:, 0, 1] = hessian[:, 1, 0] = a * sc[:, 1] - rc[:, 1]
    hessian[:, 0, 2] = hessian[:, 2, 0] = a * sc[:, 0] - rc[:, 0]
    hessian[:, 0, 3] = hessian[:, 3, 0] = s[:, 0]
    hessian[:, 1, 1] = a * a * cc[:, 2] + a * rs[:, 2]
    hessian[:, 1, 2] = hessian[:, 2, 1] = a * a * cc[:, 1] + a * rs[:, 1]
    hessian[:, 1, 3] = hessian[:, 3, 1] = a * c[:, 1]
    hessian[:, 2, 2] = a * a * cc[:, 0] + a * rs[:, 0]
    hessian[:, 2, 3] = hessian[:, 3, 2] = a * c[:, 0]
    hessian[:, 3, 3] = len(x)
    return gradient, hessian, np.einsum('ij,ij->i', rest, rest)
