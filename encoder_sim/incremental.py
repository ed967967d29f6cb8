"""The incremental encoder of paper 000: a counter that a reference mark clears after power-on.

Three stages, each a method of its own: what the grating shows to the head (`_shown`), where the
index pulse is triggered (`_crossing`), and what the counter makes of both (`feed`).
"""

import numpy as np

from . import keyed_noise
from .encoder_scale import ZeroDrift, disc_angle

_TURN = 2.0 * np.pi


class IncrementalEncoder:
    """One axis: grating, index pulse, counter.

    Parameters
    ----------
    params : scenario.Incremental
    seed : int
    axis : str
        ``azimuth`` or ``elevation``: with the seed it decides the random numbers.
    power_on : int
        Number of this power-on, 1 for the first: it decides the zero drift.
    start : float, optional
        Start of the night, UTC s, from which drifts with time count; without it the first stamp.
    """

    def __init__(self, params, seed, axis, power_on=1, start=None):
        self.params, self.seed, self.axis = params, seed, axis
        self.power_on, self.start = power_on, start
        self._device = f'incremental/{axis}'
        self._zero = ZeroDrift(params, seed, self._device)
        self._count_angle = _TURN / (params.lines * params.interpolation)
        self._clear()

    @property
    def count_angle(self):
        """rad a count: 0.0686" for paper 000's grating."""
        return self._count_angle

    @property
    def homed(self):
        """Whether the mark has cleared the counter since power-on."""
        return self._cleared_at is not None

    @property
    def zero_drift(self):
        """Shift of the reading since this power-on, rad."""
        return self._zero.at_power_on(self.power_on)

    def power_cycle(self):
        """Off and on again: the counter is lost, and the mark will be found elsewhere."""
        self.power_on += 1
        self._clear()

    def _clear(self):
        self._cleared_at = None  # grating count at which the counter was cleared
        self._last = None  # stamp and angle of the last sample
        self._lost = 0  # counts lost since

    def _shown(self, angle):
        """Angle that the head's interpolator sees, rad."""
        p = self.params
        shown = disc_angle(
            angle, p.eccentricity, p.eccentricity_phase, 0.5 * p.diameter, p.heads
        )
        if p.subdivision_1 or p.subdivision_2:
            phase = p.lines * shown
            shown = (
                shown
                + p.subdivision_1 * np.cos(phase - p.subdivision_phase)
                + p.subdivision_2 * np.cos(2.0 * phase - p.subdivision_phase)
            )
        return shown

    def _grating_count(self, angle, shift=0.0):
        return np.floor((self._shown(angle) + shift) / self._count_angle)

    def _crossing(self, stamps, angles):
        """The first index pulse in the samples.

        Returns
        -------
        tuple of (int, float) or None
            Number of the sample after it, and the axis angle at which it was triggered.
        """
        p = self.params
        before, after = angles[:-1], angles[1:]
        sense = np.where(after >= before, 1.0, -1.0)
        # the pulse begins at its near edge, met from below or from above, once a turn
        lower = p.mark_angle - self.zero_drift
        edge = np.where(sense > 0.0, lower, lower + p.pulse_width)
        turns_before = np.floor(sense * (before - edge) / _TURN)
        turns_after = np.floor(sense * (after - edge) / _TURN)
        crossed = turns_after > turns_before
        if p.pulse_time > 0.0:
            seconds = np.maximum(np.diff(stamps) * 1e-9, 1e-12)
            rate = np.abs(after - before) / seconds
            crossed &= rate * p.pulse_time <= p.pulse_width
        hits = np.flatnonzero(crossed)
        if len(hits) == 0:
            return None
        i = hits[0]
        return i + 1, edge[i] + sense[i] * _TURN * (turns_before[i] + 1.0)

    def _count_losses(self, stamps, angles):
        """Counts lost up to each sample because the counter could not follow, shape (n,)."""
        lost = np.zeros(len(stamps))
        if self.params.max_count_rate > 0.0:
            counts = np.diff(angles) / self._count_angle
            excess = np.abs(counts) - self.params.max_count_rate * np.diff(stamps) * 1e-9
            lost[1:] = np.cumsum(np.sign(counts) * np.floor(np.maximum(excess, 0.0)))
        return lost

    def feed(self, stamps, angles, rates=0.0, temperature=None):
        """Read the axis at rising stamps.

        Parameters
        ----------
        stamps : int or ndarray of int, shape (n,)
            ns.
        angles : float or ndarray, shape (n,)
            True angle of the axis, rad, not wrapped from one sample to the next. Samples must be
            close enough for the mark to be seen at the rate at which it is passed.
        rates : float or ndarray, shape (n,)
            rad/s; with the latency they say where the axis was.
        temperature : float or ndarray, optional
            degC.

        Returns
        -------
        ndarray, shape (n,)
            Reading, rad, whole counts; NaN until the mark has been met.
        """
        p = self.params
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        angles = np.atleast_1d(np.asarray(angles, dtype=float))
        if len(stamps) == 0:
            return np.empty(0)
        if self.start is None:
            self.start = stamps[0] * 1e-9
        temperature = p.reference_temperature if temperature is None else temperature
        past = angles - np.asarray(rates) * p.latency

        # the last sample of the call before belongs to the motion seen now
        known = 0 if self._last is None else 1
        if known:
            stamps_seen = np.concatenate([[self._last[0]], stamps])
            angles_seen = np.concatenate([[self._last[1]], past])
        else:
            stamps_seen, angles_seen = stamps, past
        self._last = stamps[-1], past[-1]

        lost = self._count_losses(stamps_seen, angles_seen)
        valid_from = 0
        if not self.homed:
            hit = self._crossing(stamps_seen, angles_seen)
            if hit is None:
                return np.full(len(stamps), np.nan)
            self._cleared_at = float(self._grating_count(hit[1]))
            valid_from = hit[0] - known
            lost = lost - lost[hit[0]]
        lost = lost[known:] + self._lost
        self._lost = lost[-1]

        drift = p.zero_offset + self._zero.later(stamps * 1e-9 - self.start, temperature)
        counts = self._grating_count(past, drift) - self._cleared_at - lost
        if p.jitter > 0.0:
            noise = keyed_noise.normal(self.seed, self._device, 'jitter', stamps)
            counts = counts + np.round(p.jitter * noise)
        reading = p.mark_angle + counts * self._count_angle
        reading[:valid_from] = np.nan
        return reading
