"""The incremental encoder of paper 000: a counter that a reference mark clears after power-on.

What the grating shows to the head (`_shown`), where the index pulse lies (`_pulse`) and when it is
met (`_passages`), and what the counter makes of both (`feed`): in one file, as they share the state
of one device.
"""

from typing import NamedTuple

import numpy as np

from . import keyed_noise
from .encoder_scale import SineSignals, ZeroDrift, disc_angle, stamp_delays, tilted_angle

_TURN = 2.0 * np.pi
_MILLION = 1e6
#: counts by which the mark may be off at a later passage: rounding, jitter, a breath of the pulse
MARK_TOLERANCE = 10
#: of the monitor of the supply, ns
MONITOR_PERIOD = 10**9


class Status(NamedTuple):
    """What the electronics of an axis know of themselves; no truth in it.

    Attributes
    ----------
    homed : bool
    side : str
        ``below`` or ``above``: from where the mark was met that cleared the counter; '' before.
    missed_marks : int
        Index pulses since power-on that were too short to be taken.
    passages : int
        Of the mark since then.
    mark_error : float
        Counts by which the counter was off at the last passage, against the first one and the
        pulse's nominal width; NaN without one. More than `MARK_TOLERANCE`: counts were lost, the
        mark moved, or one of both pulses was not of the mark.
    supply : float
        As its monitor measured it in the second of the last sample, V.
    power_on : int
        Number of this power-on.
    mark_supply, mark_temperature : float
        As measured when the mark cleared the counter, V and degC; NaN before.
    """

    homed: bool
    side: str
    missed_marks: int
    passages: int
    mark_error: float
    supply: float
    power_on: int
    mark_supply: float = np.nan
    mark_temperature: float = np.nan

    @property
    def miscounted(self):
        """Whether the last passage of the mark gave the counter the lie."""
        return bool(abs(self.mark_error) > MARK_TOLERANCE)


class _Passages(NamedTuple):
    """Pulses met: number of the sample behind each, sense (-1, 1), axis angle of its near edge.

    And the rate of the axis there, rad/s.
    """

    row: np.ndarray
    sense: np.ndarray
    angle: np.ndarray
    rate: np.ndarray


_NONE = _Passages(np.empty(0, dtype=int), np.empty(0), np.empty(0), np.empty(0))
#: the mark is nowhere else, whatever drifts
_REACH = 0.2


class IncrementalEncoder:
    """One axis: grating, index pulse, counter.

    Parameters
    ----------
    params : scenario_encoders.Incremental
    seed : int
    axis : str
        ``azimuth`` or ``elevation``: with the seed it decides the random numbers.
    power_on : int
        Number of this power-on, 1 for the first: it decides the zero drift.
    start : float
        Start of the night, UTC s, from which drifts and faults count.

    Attributes
    ----------
    count_angle : float
        rad a count: 0.0686" for paper 000's grating.
    zero : float
        What homing left in the reading, rad: drift of this power-on, side and shift of the mark.
        NaN before; truth, for the simulator's own log.
    """

    def __init__(self, params, seed, axis, power_on=1, start=0.0):
        self.params, self.seed = params, seed
        self.power_on, self.start = power_on, start
        self._device = f'incremental/{axis}'
        self._zero = ZeroDrift(params, seed, self._device)
        self._signals = SineSignals(params)
        self._turn_counts = params.lines * params.interpolation
        self.count_angle = _TURN / self._turn_counts
        self._cycles = sorted(params.power_cycles)  # still to come
        self._flicker = None, 0.0  # what a noise of the monitor belongs to, and it
        self._supply = self._monitor(params.supply, int(start))
        self._clear()

    @property
    def homed(self):
        """Whether the mark has cleared the counter since power-on."""
        return self._cleared_at is not None

    @property
    def zero_drift(self):
        """Shift of the reading since this power-on, rad."""
        return self._zero.at_power_on(self.power_on)

    @property
    def status(self):
        """`Status` after the last sample."""
        return Status(self.homed, {0: '', 1: 'below', -1: 'above'}[self._sense], self._missed,
                      self._passed, self._mark_error, self._supply, self.power_on,
                      *self._measured)

    def power_cycle(self):
        """Off and on again: the counter is lost, and the mark will be found elsewhere."""
        self.power_on += 1
        self._clear()

    def _clear(self):
        self._cleared_at = None  # grating count at which the counter was cleared
        self.zero = np.nan
        self._sense = 0  # of the motion that did
        self._last = None  # stamp and angle of the last sample
        self._since = None  # stamp of the first reading
        self._lost = 0  # counts lost since
        self._missed = self._passed = 0
        self._mark_error = np.nan
        self._measured = (np.nan, np.nan)  # supply and temperature at the mark

    # --- grating --------------------------------------------------------------------------------

    def _shown(self, angle, rate=0.0):
        """Angle that the head's interpolator gives, rad."""
        p = self.params
        shown = disc_angle(
            angle, p.eccentricity, p.eccentricity_phase, 0.5 * p.diameter, p.heads
        )
        if p.tilt:
            shown = tilted_angle(shown, p.tilt, p.tilt_phase)
        if p.worm_1 or p.worm_2:
            phase = p.worm_teeth * angle
            shown = (shown + p.worm_1 * np.cos(phase - p.worm_phase)
                     + p.worm_2 * np.cos(2.0 * phase - p.worm_phase))
        if p.subdivision_1 or p.subdivision_2:
            phase = p.lines * shown
            shown = (
                shown
                + p.subdivision_1 * np.cos(phase - p.subdivision_phase)
                + p.subdivision_2 * np.cos(2.0 * phase - p.subdivision_phase)
            )
        return shown if self._signals.ideal else self._signals.shown(shown, rate)

    def _grating_count(self, angle, rate=0.0, shift=0.0):
        return np.floor((self._shown(angle, rate) + shift) / self.count_angle)

    # --- reference mark -------------------------------------------------------------------------

    def _volts(self, seconds):
        p = self.params
        volts = p.supply + p.supply_rate * seconds
        if p.supply_scatter > 0.0:
            volts = volts + p.supply_scatter * float(keyed_noise.normal(
                self.seed, 'incremental', 'supply', self.power_on))
        if p.supply_ripple > 0.0:
            volts = volts + p.supply_ripple * np.sin(_TURN * p.ripple_frequency * seconds)
        return volts

    def _monitor(self, volts, key):
        """What the electronics measure of the supply, V, with the noise that belongs to `key`."""
        p, volts = self.params, float(volts)
        if p.voltmeter_noise > 0.0:
            if self._flicker[0] != key:
                self._flicker = key, float(
                    keyed_noise.normal(self.seed, self._device, 'voltmeter', key))
            volts += p.voltmeter_noise * self._flicker[1]
        if p.voltmeter_step > 0.0:
            volts = p.voltmeter_step * round(volts / p.voltmeter_step)
        return volts

    def _pulse(self, volts, temperature):
        """Lower edge and width of the index pulse, rad; no width where the signal is too weak."""
        p = self.params
        volts, warmth = volts - p.supply_nominal, temperature - p.reference_temperature
        peak = (1.0 + p.signal_supply * volts) * (1.0 + p.signal_slope * warmth)
        there = peak > p.threshold
        peak = np.where(there, peak, 1.0)
        width = np.where(there, 2.0 * p.pulse_width * (1.0 - p.threshold / peak), np.nan)
        shift = self.zero_drift + p.mark_supply * volts + p.mark_slope * warmth
        return p.mark_angle - shift + 0.5 * (p.pulse_width - width), width

    def _passages(self, stamps, angles, volts, temperature):
        """`_Passages` that are noticed, and the rows behind those that are too short."""
        if len(stamps) < 2:
            return _NONE, _NONE.row
        met, short = _NONE, _NONE.row
        if not self._far_from_mark(angles):
            met, short = self._met(stamps, angles, volts, temperature)
        if self.params.spurious_index > 0.0:
            met = _merged(met, self._spurious(stamps, angles))
        return met, short

    def _spurious(self, stamps, angles):
        """`_Passages` where there is no mark: what a disturbance makes of the index signal."""
        moments = keyed_noise.pulses(
            self.seed, self._device, 'spurious index', self.params.spurious_index,
            int(stamps[0]), int(stamps[-1]))
        row = np.searchsorted(stamps, moments)
        span, step = np.diff(stamps)[row - 1] * 1e-9, np.diff(angles)[row - 1]
        part = (moments - stamps[row - 1]) * 1e-9 / span
        found = _Passages(row, np.where(step >= 0.0, 1.0, -1.0), angles[row - 1] + part * step,
                          step / span)
        known = np.isfinite(found.angle)
        return _Passages(*(column[known] for column in found))

    def _met(self, stamps, angles, volts, temperature):
        """`_passages` of the mark itself."""
        p = self.params
        before, after = angles[:-1], angles[1:]
        sense = np.where(after >= before, 1.0, -1.0)
        lower, width = (np.broadcast_to(v, before.shape) for v in self._pulse(volts, temperature))
        # the pulse begins at its near edge, met from below or from above, once a turn
        edge = np.where(sense > 0.0, lower, lower + width)
        # a comparison with NaN, where there is no pulse, is never true
        turns_before = np.floor(sense * (before - edge) / _TURN)
        turns_after = np.floor(sense * (after - edge) / _TURN)
        crossed = turns_after > turns_before
        rate = (after - before) / np.maximum(np.diff(stamps) * 1e-9, 1e-12)
        short = crossed & (np.abs(rate) * p.pulse_time > width)
        rows = np.flatnonzero(crossed & ~short)
        place = edge[rows] + sense[rows] * _TURN * (turns_before[rows] + 1.0)
        if p.mark_scatter > 0.0:
            place = place + p.mark_scatter * keyed_noise.normal(
                self.seed, self._device, 'mark scatter', stamps[rows + 1])
        return _Passages(rows + 1, sense[rows], place, rate[rows]), np.flatnonzero(short) + 1

    def _far_from_mark(self, angles):
        """Whether no passage is possible; most calls end here."""
        low, high = angles.min() - _REACH, angles.max() + _REACH
        turn = np.ceil((low - self.params.mark_angle) / _TURN)
        return self.params.mark_angle + turn * _TURN > high

    def _clears(self, passages):
        """Which passages may clear the counter."""
        wanted = {'any': 0.0, 'below': 1.0, 'above': -1.0}[self.params.mark_from]
        return (passages.sense == wanted) | (wanted == 0.0)

    def _check_mark(self, passages, lost):
        """Compare the counter with the mark at passages after that which cleared it."""
        self._passed += len(passages.row)
        if len(passages.row) == 0:
            return
        row, sense, angle, rate = (column[-1] for column in passages)  # the status has the last
        counts = self._grating_count(angle, rate) - self._cleared_at - lost[row]
        sides = 0.5 * (self._sense - sense)  # 1: cleared from below, passed from above
        error = counts - sides * self.params.pulse_width / self.count_angle
        error -= self._turn_counts * np.rint(error / self._turn_counts)
        self._mark_error = float(np.rint(error))

    # --- counter --------------------------------------------------------------------------------

    def _count_losses(self, stamps, angles):
        """Counts lost from the first sample up to each, shape (n,)."""
        p = self.params
        lost = np.zeros(len(stamps))
        if not (p.max_count_rate or p.miscounts or p.losses) and self._signals.ideal:
            return lost
        counts = np.nan_to_num(np.diff(angles) / self.count_angle)  # a bad sample loses none
        if p.max_count_rate > 0.0:
            excess = np.abs(counts) - p.max_count_rate * np.diff(stamps) * 1e-9
            lost[1:] = np.cumsum(np.sign(counts) * np.floor(np.maximum(excess, 0.0)))
        if not self._signals.ideal:
            rate = counts * self.count_angle / np.maximum(np.diff(stamps) * 1e-9, 1e-12)
            lines = np.diff(np.floor(np.nan_to_num(angles) * (p.lines / _TURN)))
            lost[1:] += p.interpolation * np.cumsum(lines * ~self._signals.counting(rate))
        if p.miscounts > 0.0:
            spread = np.sqrt(p.miscounts * np.abs(counts) / _MILLION)
            noise = keyed_noise.normal(self.seed, self._device, 'miscounts', stamps[1:])
            lost[1:] += np.cumsum(np.rint(spread * noise))
        if p.losses:
            seconds = stamps * 1e-9 - self.start
            happened = np.array([loss.counts * (seconds >= loss.at) for loss in p.losses]).sum(0)
            lost += happened - happened[0]
        return lost

    def feed(self, stamps, angles, rates=0.0, temperature=None):
        """Read the axis at rising stamps.

        Parameters
        ----------
        stamps : int or ndarray of int, shape (n,)
            ns.
        angles : float or ndarray, shape (n,)
            True angle of the axis, rad, not wrapped from one sample to the next. Between two
            samples the motion is taken as uniform: so close they must be for the rate at which
            the mark is passed and counts are lost.
        rates : float or ndarray, shape (n,)
            rad/s; with the latency they say where the axis was.
        temperature : float or ndarray, optional
            degC.

        Returns
        -------
        ndarray, shape (n,)
            Reading, rad, whole counts; NaN until the mark has been met.
        """
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        angles = np.atleast_1d(np.asarray(angles, dtype=float))
        if len(stamps) == 0:
            return np.empty(0)
        temperature = self.params.reference_temperature if temperature is None else temperature
        temperature, rates = _for_each(temperature, angles), _for_each(rates, angles)
        past = angles - rates * self.params.latency
        seconds = stamps * 1e-9 - self.start

        def part(rows):
            return self._count(stamps[rows], past[rows], rates[rows], temperature[rows])

        parts, begin = [], 0
        while self._cycles and seconds[-1] >= self._cycles[0]:
            end = int(np.searchsorted(seconds, self._cycles.pop(0)))
            parts.append(part(slice(begin, end)))
            self.power_cycle()
            begin = end
        parts.append(part(slice(begin, None)))
        return np.concatenate(parts)

    def _count(self, stamps, past, rates, temperature):
        """`feed` while the power is on."""
        if len(stamps) == 0:
            return np.empty(0)
        p = self.params
        seconds = stamps * 1e-9 - self.start
        volts = self._volts(seconds)
        # the last sample of the call before belongs to the motion seen now
        known = 0 if self._last is None else 1
        all_stamps, all_angles = stamps, past
        if known:
            all_stamps = np.concatenate([[self._last[0]], stamps])
            all_angles = np.concatenate([[self._last[1]], past])
        self._last = stamps[-1], past[-1]
        self._supply = self._monitor(volts[-1], int(stamps[-1]) // MONITOR_PERIOD)

        lost = self._count_losses(all_stamps, all_angles) + self._lost
        passages, short = self._passages(
            all_stamps, all_angles, volts[1 - known:], temperature[1 - known:])
        self._missed += len(short)
        valid_from = 0
        if not self.homed:
            hits = np.flatnonzero(self._clears(passages))
            if len(hits) == 0:
                return np.full(len(stamps), np.nan)
            row, self._sense, angle, rate = (column[hits[0]] for column in passages)
            self._cleared_at = float(self._grating_count(angle, rate))
            off = p.mark_angle - angle
            self.zero = float(off - _TURN * np.rint(off / _TURN))
            valid_from = row - known
            met = int(stamps[valid_from])
            noise = float(keyed_noise.normal(self.seed, self._device, 'thermometer', met))
            self._measured = (self._monitor(volts[valid_from], met),
                              float(temperature[valid_from]) + p.thermometer_noise * noise)
            self._since = stamps[valid_from]
            lost = lost - lost[row]
            passages = _Passages(*(column[hits[0] + 1:] for column in passages))
        self._check_mark(passages, lost)
        lost = lost[known:]
        self._lost = lost[-1]

        # a late stamp is none of the counter's business
        read = past - rates * stamp_delays(p, self.seed, 'incremental', stamps)
        counts = self._counter(stamps, read, rates, temperature, volts) - self._cleared_at - lost
        reading = p.mark_angle + counts * self.count_angle
        reading[:valid_from] = np.nan
        return reading

    def _counter(self, stamps, past, rates, temperature, volts):
        """Grating counts that the electronics read at `stamps`, none cleared, none lost."""
        p = self.params
        drift = (p.zero_offset + self._zero.later(stamps * 1e-9 - self.start, temperature)
                 + p.zero_supply * (volts - p.supply_nominal))
        counts = self._grating_count(past, rates, drift)
        if p.jitter > 0.0:
            noise = keyed_noise.normal(self.seed, self._device, 'jitter', stamps)
            counts = counts + np.round(p.jitter * noise)
        return counts

    def only_counts(self, stamps, angles):
        """Whether nothing but counting happens at samples, shape (n,), as `feed` takes them.

        No mark is near on the way, and the power stays on: what is known of the marks stays as it
        is.
        """
        return (self.homed and not self.params.spurious_index
                and self._far_from_mark(np.append(angles, self._last[1]))
                and not (self._cycles and stamps[-1] * 1e-9 - self.start >= self._cycles[0]))

    def rate(self, stamps, angles, rates=0.0, temperature=None):
        """The rate that the electronics tell with the reading of a sample.

        Parameters
        ----------
        stamps, angles, rates, temperature
            Samples as for `feed`, which took them before.

        Returns
        -------
        ndarray, shape (n,)
            Counts that have passed in the gate time up to now, over that time, rad/s. NaN where
            there was no reading yet when it began.
        """
        p = self.params
        gate = round(p.rate_gate * 1e9)
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        if self._since is None:
            return np.full(len(stamps), np.nan)
        # where the axis was then: the head sees nothing else
        if temperature is None:
            temperature = p.reference_temperature
        both, rates, temperature = (
            stamps.repeat(2), *(_for_each(v, stamps).repeat(2) for v in (rates, temperature)))
        past = _for_each(angles, stamps).repeat(2) - rates * np.tile(
            [p.latency + p.rate_gate, p.latency], len(stamps))
        both[::2] -= gate
        counts = self._counter(both, past, rates, temperature,
                               self._volts(both * 1e-9 - self.start))
        passed = (counts[1::2] - counts[::2]) * self.count_angle / p.rate_gate
        return np.where(both[::2] >= self._since, passed, np.nan)


def _for_each(values, samples):
    """A number for each sample: `values`, or the same one."""
    values = np.asarray(values, dtype=float)
    return values if values.shape == samples.shape else np.broadcast_to(values, samples.shape)


def _merged(*parts):
    """All passages of `parts`, as they were met."""
    row, sense, angle, rate = map(np.concatenate, zip(*parts))
    order = np.lexsort((sense * angle, row))
    return _Passages(row[order], sense[order], angle[order], rate[order])
