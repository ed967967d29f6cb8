"""The absolute encoder of paper 001: from the CCD's frame to an angle."""

from dataclasses import dataclass

import numpy as np

from . import keyed_noise
from .ccd import INVERSION, LinearCCD
from .disc import BAR_ANGLE, BARS, WINDOW, Disc
from .encoder_scale import ZeroDrift, disc_angle

_TURN = 2.0 * np.pi
_CHUNK = 128  # frames worked on at once, to bound the memory


@dataclass(frozen=True)
class Readings:
    """What a reader made of n frames.

    Attributes
    ----------
    angle : ndarray, shape (n,)
        Disc angle at the middle of the row, rad in [0, 2 pi); NaN where not valid.
    valid : ndarray of bool, shape (n,)
        Window found on the disc, and fit accepted.
    r_square : ndarray, shape (n,)
        Goodness of the fit (paper 001, eq. 7).
    first_bar : ndarray of int, shape (n,)
        Number of the first whole bar of the frame, -1: unknown.
    """

    angle: np.ndarray
    valid: np.ndarray
    r_square: np.ndarray
    first_bar: np.ndarray


class PaperReader:
    """The reading of paper 001, section 2.

    The frame is inverted (eq. 4), bars are the pixels above a threshold, wide ('0') or narrow
    ('1') by their integrated grey level, and 18 of them give the coarse angle. A sine (eq. 5)
    fitted to the whole row by Gauss-Newton iteration gives the fine angle by its phase at
    pixel 0 (eq. 10). Which period belongs to which bar is resolved from the centres of the
    decoded bars: the rule of eq. 12 takes 1 % of the readings one bar off.

    Parameters
    ----------
    disc : disc.Disc
    pitch : float
        Nominal pixels a bar period.
    threshold, width_threshold : float
        Inverted grey level of a bar, and the integrated one from which it is wide.
    min_r_square : float
        Of an accepted fit.

    Notes
    -----
    The fine angle has a bias of 4 to 5" (1 sigma over the disc): the bars cut at the ends of the
    row bend the fitted period, and the phase at pixel 0 extrapolates that.
    """

    # a bar's edge is some pixels of ramp, where noise may cross the threshold more than once
    _SMALLEST_GAP = 5
    _TOLERANCE = 1e-6
    _MAX_ITERATIONS = 30

    def __init__(
        self, disc, pitch=48.0, threshold=150.0, width_threshold=3000.0, min_r_square=0.6
    ):
        self.disc = disc
        self.pitch = pitch
        self.threshold = threshold
        self.width_threshold = width_threshold
        self.min_r_square = min_r_square

    def read(self, frames):
        """Read frames.

        Parameters
        ----------
        frames : ndarray of uint8, shape (n, pixels)
            As the CCD delivers them, bars dark.

        Returns
        -------
        Readings
        """
        frames = np.atleast_2d(frames)
        parts = [self._read(frames[i : i + _CHUNK]) for i in range(0, len(frames), _CHUNK)]
        if not parts:
            nothing = np.empty(0)
            return Readings(nothing, nothing.astype(bool), nothing, nothing.astype(int))
        names = ('angle', 'valid', 'r_square', 'first_bar')
        return Readings(**{n: np.concatenate([getattr(p, n) for p in parts]) for n in names})

    def _read(self, frames):
        grey = INVERSION - frames
        windows, centres, complete = self._decode(grey)
        first = np.where(complete, self.disc.find(windows), -1)
        omega, phase, r_square = self._fit(grey, centres)

        # bar k of the window has its centre at the maximum with this number
        cycles = (omega[:, np.newaxis] * centres + phase[:, np.newaxis]) / _TURN - 0.25
        number = np.rint(np.mean(cycles - np.arange(WINDOW), axis=1))
        at_zero = first - number + phase / _TURN - 0.25
        middle = 0.5 * (grey.shape[1] - 1) / self.pitch
        angle = (at_zero + middle) % BARS * BAR_ANGLE
        valid = (first >= 0) & (r_square >= self.min_r_square)
        return Readings(np.where(valid, angle, np.nan), valid, r_square, first)

    def _decode(self, grey):
        """The first 18 whole bars of each frame.

        Returns
        -------
        windows : ndarray of int, shape (n, 18)
            Bits.
        centres : ndarray, shape (n, 18)
            Of the bars, pixels.
        complete : ndarray of bool, shape (n,)
            Whether there are 18.
        """
        n, pixels = grey.shape
        row_length = pixels + 2  # a dark pixel at either end keeps the rows apart
        bright = np.zeros((n, row_length), dtype=bool)
        bright[:, 1:-1] = grey > self.threshold
        steps = np.diff(bright.ravel().astype(np.int8))
        starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
        if len(starts) == 0:
            return _no_bars(n)
        # in both, pixel x of row r is at r * row_length + x; `ends` is one past the bar
        apart = starts[1:] - ends[:-1] >= self._SMALLEST_GAP
        apart |= starts[1:] // row_length != starts[:-1] // row_length
        starts = starts[np.concatenate([[True], apart])]
        ends = ends[np.concatenate([apart, [True]])]
        row = starts // row_length
        starts, ends = starts - row * row_length, ends - row * row_length
        whole = (starts > 0) & (ends < pixels) & (ends - starts >= self._SMALLEST_GAP)
        row, starts, ends = row[whole], starts[whole], ends[whole]

        total = np.zeros((n, pixels + 1))
        np.cumsum(grey, axis=1, out=total[:, 1:])
        narrow = total[row, ends] - total[row, starts] < self.width_threshold

        count = np.bincount(row, minlength=n)
        rank = np.arange(len(row)) - (np.cumsum(count) - count)[row]
        chosen = rank < WINDOW
        windows, centres, _ = _no_bars(n)
        windows[row[chosen], rank[chosen]] = narrow[chosen]
        centres[row[chosen], rank[chosen]] = 0.5 * (starts + ends - 1)[chosen]
        return windows, centres, count >= WINDOW

    def _fit(self, grey, centres):
        """Least-squares sine of each row: frequency and phase at pixel 0, rad, and R-square."""
        pixels = grey.shape[1]
        half = 0.5 * (pixels - 1)
        x = (np.arange(pixels) - half) / half  # well scaled: the optimum is the same
        omega = np.full(len(grey), _TURN / self.pitch * half)
        turns = np.exp(1j * (omega[:, np.newaxis] * (centres - half) / half)).mean(axis=1)
        phase = 0.5 * np.pi - np.angle(turns)
        level = grey.mean(axis=1)
        swing = grey - level[:, np.newaxis]
        spread = np.sum(swing * swing, axis=1)
        amplitude = np.sqrt(2.0 * spread / pixels)
        unknowns = np.stack([amplitude, omega, phase, level], axis=1)

        columns = np.ones((len(grey), 4, pixels))
        misfit = np.empty(len(grey))
        going = np.arange(len(grey))
        for _ in range(self._MAX_ITERATIONS):
            a, w, p, c = unknowns[going, :, np.newaxis].transpose(1, 0, 2)
            argument = w * x + p
            part = columns[: len(going)]
            np.sin(argument, out=part[:, 0])
            np.multiply(a, np.cos(argument), out=part[:, 2])
            np.multiply(part[:, 2], x, out=part[:, 1])
            rest = grey[going] - a * part[:, 0] - c
            misfit[going] = np.sum(rest * rest, axis=1)
            normal = part @ part.transpose(0, 2, 1)
            right = part @ rest[:, :, np.newaxis]
            try:
                step = np.linalg.solve(normal, right)[:, :, 0]
            except np.linalg.LinAlgError:  # a row without any bar
                normal += 1e-9 * np.eye(4)
                step = np.linalg.solve(normal, right)[:, :, 0]
            unknowns[going] += step
            going = going[np.linalg.norm(step, axis=1) > self._TOLERANCE]
            if len(going) == 0:
                break
        r_square = 1.0 - misfit / np.maximum(spread, 1e-9)
        r_square[going] = 0.0  # did not converge
        omega, phase = unknowns[:, 1], unknowns[:, 2]
        phase = phase - omega
        return omega / half, (phase + np.pi) % _TURN - np.pi, r_square


def _no_bars(n):
    windows, centres = np.zeros((n, WINDOW), dtype=np.int64), np.zeros((n, WINDOW))
    return windows, centres, np.zeros(n, dtype=bool)


class AbsoluteEncoder:
    """One axis: disc, CCD and reading. It keeps its zero without power.

    Parameters
    ----------
    params : scenario.Absolute
    seed : int
    axis : str
        ``azimuth`` reads from 0 to 360 degrees, ``elevation`` from -180 to 180.
    power_on : int
        Number of this power-on, 1 for the first: it decides the (small) zero drift.
    start : float, optional
        Start of the night, UTC s, from which drifts with time count; without it the first stamp.
    """

    def __init__(self, params, seed, axis, power_on=1, start=None):
        self.params, self.seed, self.axis = params, seed, axis
        self.power_on, self.start = power_on, start
        self._device = f'absolute/{axis}'
        self._zero = ZeroDrift(params, seed, self._device)
        self.disc = Disc(params.code)
        self.ccd = LinearCCD(params, self.disc)
        self.reader = PaperReader(self.disc, params.bar_pitch)

    @property
    def zero_drift(self):
        """Shift of the reading since this power-on, rad."""
        return self._zero.at_power_on(self.power_on)

    def power_cycle(self):
        """Off and on again."""
        self.power_on += 1

    def _shown(self, stamps, angles, rates, temperature):
        p = self.params
        if self.start is None:
            self.start = stamps[0] * 1e-9
        temperature = p.reference_temperature if temperature is None else temperature
        past = angles - np.asarray(rates) * p.latency
        shown = disc_angle(past, p.eccentricity, p.eccentricity_phase, 0.5 * p.diameter)
        drift = self._zero.later(stamps * 1e-9 - self.start, temperature)
        return shown + p.zero_offset + self.zero_drift + drift

    def frames(self, stamps, angles, rates=0.0, temperature=None):
        """What the CCD sees.

        Parameters
        ----------
        stamps : int or ndarray of int, shape (n,)
            ns.
        angles : float or ndarray, shape (n,)
            True angle of the axis, rad.
        rates : float or ndarray, shape (n,)
            rad/s; with the latency they say where the axis was.
        temperature : float or ndarray, optional
            degC.

        Returns
        -------
        ndarray of uint8, shape (n, pixels)
        """
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        angles = np.atleast_1d(np.asarray(angles, dtype=float))
        if len(stamps) == 0:
            return np.empty((0, self.params.pixels), dtype=np.uint8)
        noise = None
        if self.params.noise > 0.0:
            noise = keyed_noise.normal(
                self.seed, self._device, 'pixels', stamps, self.params.pixels
            )
        return self.ccd.render(self._shown(stamps, angles, rates, temperature), noise)

    def frame(self, stamp, angle, rate=0.0, temperature=None):
        """One row of the image, shape (pixels,), uint8; parameters as for `frames`."""
        return self.frames(stamp, angle, rate, temperature)[0]

    def read(self, stamps, angles, rates=0.0, temperature=None):
        """Read the axis; parameters as for `frames`.

        Returns
        -------
        angle : ndarray, shape (n,)
            rad; NaN where not valid.
        valid : ndarray of bool, shape (n,)
            Decoded, and the fit accepted.
        """
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        angles = np.atleast_1d(np.asarray(angles, dtype=float))
        rates = np.broadcast_to(rates, angles.shape)
        angle, valid = np.empty(len(stamps)), np.empty(len(stamps), dtype=bool)
        for i in range(0, len(stamps), _CHUNK):
            rows = slice(i, i + _CHUNK)
            warmth = temperature if np.ndim(temperature) == 0 else temperature[rows]
            frames = self.frames(stamps[rows], angles[rows], rates[rows], warmth)
            readings = self.reader.read(frames)
            angle[rows], valid[rows] = readings.angle, readings.valid
        if self.axis == 'elevation':
            angle = (angle + np.pi) % _TURN - np.pi
        return angle, valid
