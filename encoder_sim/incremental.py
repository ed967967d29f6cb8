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

"""The incremental encoder of paper 000: a counter that a reference mark clears after power-on.

What is wrong with it (`Incremental`), what the grating shows to the head (`_shown`), and what the
counter makes of that and of the mark (`feed`): in one file, as they share the state of one device.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.homing import AxisHoming

from . import keyed_noise
from .encoder_scale import (
    EncoderScale,
    SineSignals,
    ZeroDrift,
    disc_angle,
    stamp_delays,
    tilted_angle,
)
from .field_kinds import choice, number, sections
from .reference_mark import Passages, ReferenceMark

_TURN = 2.0 * np.pi
_MILLION = 1e6
#: counts by which the mark may be off at a later passage: rounding, jitter, a breath of the pulse
MARK_TOLERANCE = 10
#: of the monitor of the supply, ns
MONITOR_PERIOD = 10**9


@dataclass(frozen=True)
class CountLoss:
    """A fault: at once the counter is `counts` too low, `at` seconds after the start."""

    at: float = number(0.0, 's', 0.0, 1e6)
    counts: int = number(0, '', -10**9, 10**9, kind=int)


@dataclass(frozen=True)
class Incremental(EncoderScale):
    """The incremental encoder of paper 000 on one axis.

    The reference mark gives a triangular signal (a slit seen through a slit) that a comparator
    turns into the index pulse. At the reference temperature and the nominal supply its peak is 1.

    Attributes
    ----------
    lines, interpolation : int
        Lines of the grating, and counts (edges in quadrature) a line.
    tilt, tilt_phase : float
        Of the disc against the plane across the axis (rad), and the axis angle at which the line
        of both planes lies at the head (rad).
    heads : int
        One reading head, or the mean of two opposite ones.
    subdivision_1, subdivision_2, subdivision_phase : float
        Error of the interpolation, once and twice a line (rad), and its phase (rad).
    worm_teeth : int
        Of the wheel, where the encoder sits on the worm: its periodic error is then in the
        reading, so many times a turn of the axis.
    worm_1, worm_2, worm_phase : float
        Amplitude once and twice a turn of the worm (rad) and phase (rad). Amateurs measured 7 to
        10" from peak to peak of good worms and 30" of mass-produced ones (ATM list, July 1995).
    offset_cos, offset_sin : float
        Direct voltage left on either signal of the grating, relative to its amplitude at rest.
        The scope manual of Heidenhain (PWM 20, 2014) allows +-15 degrees of on-to-off ratio, 13 %,
        and an amplitude ratio of 0.8 to 1.25 and a phase of 80 to 100 degrees; for encoders that
        are interpolated finely 10 %, 0.9 to 1.1 and 85 to 95 degrees.
    amplitude_mismatch : float
        By how much the cosine is larger than the sine, relative to their mean.
    quadrature_error : float
        By how much the phase between both is more than a quarter of a line, rad.
    bandwidth : float
        At which the signals have fallen by 3 dB, Hz of lines; 0: none. The inputs of PWM 8 have
        60 to 100 kHz, which no telescope reaches: 6 deg/s of paper 000's grating are 790 Hz. A
        noise filter or a slow converter does.
    mark_angle : float
        Nominal axis angle of the reference mark, rad.
    mark_scatter : float
        1-sigma of where the mark is noticed, passage by passage, rad. One that is tied to a line
        of the grating can be good to a count; no maker's figure was found, for these (Renishaw
        calls that of its RESR rings "a repeatable home position") or for others.
    spurious_index : float
        Index pulses where there is no mark, by disturbances on its line, a second. The first one
        after power-on clears the counter as a mark would; a later one gives it the lie, which
        controllers call a broken index. No rates were found: it is a fault, not a property.
    pulse_width : float
        Width of the mark's signal at half its peak, rad. The counter is cleared at the near edge
        of the pulse, so from above that much further up than from below.
    threshold : float
        Of the comparator: it decides how wide the pulse is, and a mark with a weaker signal gives
        none.
    signal_slope, signal_supply : float
        Relative change of the signal by a degC and by a volt.
    pulse_time : float
        The shortest pulse that is noticed, s.
    mark_from : {'any', 'below', 'above'}
        The direction from which the mark clears the counter.
    mark_slope, mark_supply : float
        How the place of the mark on the grating moves, in the reading: rad/degC, rad/V. It counts
        when the mark is met.
    zero_supply : float
        Drift of the reading with the supply at any time, rad/V.
    supply, supply_nominal, supply_rate : float
        Supply at the start (V), that of the data sheet (V), and its change (V/s).
    supply_scatter : float
        1-sigma of the supply from one power-on to the next, the same on both axes, V.
    thermometer_noise, voltmeter_noise : float
        1-sigma of what the electronics measure of temperature (degC) and supply (V).
    voltmeter_step : float
        Resolution of the latter, V: 4 mV of a usual monitor of 12 bits (Texas Instruments,
        INA219); 0: none.
    supply_ripple, ripple_frequency : float
        Amplitude (V) and frequency (Hz) of what the mains leave on it.
    max_count_rate : float
        Edges a second that the counter can follow; the others are lost. 0: all.
    miscounts : float
        Wrong counts by noise, up or down, in a million counts passed.
    jitter : float
        1-sigma noise of one reading, in counts.
    rate_gate : float
        The rate is the counts of so long a time before the reading, over it (s): the M method of
        a counter (Ohmae et al. 1982, IEEE Trans. Ind. Electron. IE-29, 207). Two counts and
        their jitter are its noise: 0.7"/s a count in 100 ms.
    losses : tuple of CountLoss
        A fault: counts lost by a disturbance.
    home_side : {'below', 'above'}
        From where homing comes to the mark.
    home_rate : float
        At which homing passes it, rad/s.
    """

    lines: int = number(47200, '', 1, 1_000_000, kind=int)
    interpolation: int = number(400, '', 1, 100_000, kind=int)
    tilt: float = number(0.0, 'deg', 0.0, 30.0)
    tilt_phase: float = number(0.0, 'deg', -360.0, 360.0)
    heads: int = number(1, '', 1, 2, kind=int)
    subdivision_1: float = number(0.0, 'arcsec', 0.0, 60.0)
    subdivision_2: float = number(0.0, 'arcsec', 0.0, 60.0)
    subdivision_phase: float = number(0.0, 'deg', -360.0, 360.0)
    worm_teeth: int = number(180, '', 1, 10000, kind=int)
    worm_1: float = number(0.0, 'arcsec', 0.0, 600.0)
    worm_2: float = number(0.0, 'arcsec', 0.0, 600.0)
    worm_phase: float = number(0.0, 'deg', -360.0, 360.0)
    offset_cos: float = number(0.0, 'percent', -200.0, 200.0)
    offset_sin: float = number(0.0, 'percent', -200.0, 200.0)
    amplitude_mismatch: float = number(0.0, 'percent', -150.0, 150.0)
    quadrature_error: float = number(0.0, 'deg', -60.0, 60.0)
    bandwidth: float = number(0.0, 'hz', 0.0, 1e9)
    mark_angle: float = number(180.0, 'deg', -360.0, 360.0)
    mark_scatter: float = number(0.0, 'arcsec', 0.0, 600.0)
    spurious_index: float = number(0.0, 'hz', 0.0, 1.0)
    pulse_width: float = number(0.0, 'arcsec', 0.0, 3600.0)
    threshold: float = number(50.0, 'percent', 1.0, 1000.0)
    signal_slope: float = number(0.0, 'percent_per_degc', -100.0, 100.0)
    signal_supply: float = number(0.0, 'percent_per_v', -1000.0, 1000.0)
    pulse_time: float = number(0.0, 'ms', 0.0, 1000.0)
    mark_from: str = choice('any', 'any', 'below', 'above')
    mark_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)
    mark_supply: float = number(0.0, 'arcsec_per_v', -3600.0, 3600.0)
    zero_supply: float = number(0.0, 'arcsec_per_v', -3600.0, 3600.0)
    supply: float = number(5.0, 'v', 0.0, 100.0)
    supply_nominal: float = number(5.0, 'v', 0.1, 100.0)
    supply_rate: float = number(0.0, 'v_per_hour', -10.0, 10.0)
    supply_scatter: float = number(0.0, 'v', 0.0, 10.0)
    thermometer_noise: float = number(0.0, 'c', 0.0, 60.0)
    voltmeter_noise: float = number(0.0, 'v', 0.0, 10.0)
    voltmeter_step: float = number(0.0, 'v', 0.0, 1.0)
    supply_ripple: float = number(0.0, 'v', 0.0, 10.0)
    ripple_frequency: float = number(100.0, 'hz', 0.01, 1e6)
    max_count_rate: float = number(0.0, 'mhz', 0.0, 1000.0)
    miscounts: float = number(0.0, '', 0.0, 1e5)
    jitter: float = number(0.0, '', 0.0, 1000.0)
    rate_gate: float = number(100.0, 'ms', 0.1, 10000.0)
    losses: tuple = sections(CountLoss)
    home_side: str = choice('below', 'below', 'above')
    home_rate: float = number(0.25, 'deg_s', 1e-4, 90.0)


class IncrementalEncoder:
    """One axis: grating, index pulse, counter.

    Parameters
    ----------
    params : Incremental
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
    supply : float
        As its monitor measured it in the second of the last sample, V.
    """

    def __init__(self, params, seed, axis, power_on=1, start=0.0):
        self.params, self.seed = params, seed
        self.power_on, self.start = power_on, start
        self._device = f'incremental/{axis}'
        self._zero = ZeroDrift(params, seed, self._device)
        self._signals = SineSignals(params)
        self._mark = ReferenceMark(params, seed, self._device)
        self._turn_counts = params.lines * params.interpolation
        self.count_angle = _TURN / self._turn_counts
        self._cycles = sorted(params.power_cycles)  # still to come
        self._flicker = None, 0.0  # what a noise of the monitor belongs to, and it
        self.supply = self._monitor(params.supply, int(start))
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
    def homing(self):
        """`AxisHoming` after the last sample; of when the power-on began it knows nothing."""
        return AxisHoming(self.homed, {0: '', 1: 'below', -1: 'above'}[self._sense], self._missed,
                          self._passed, self._mark_error, self.count_angle,
                          self.params.pulse_width, self.power_on, np.nan, *self._measured)

    @property
    def miscounted(self):
        """Whether the last passage of the mark gave the counter the lie.

        Counts were lost, the mark moved, or one of both pulses was not of the mark.
        """
        return bool(abs(self._mark_error) > MARK_TOLERANCE)

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

    def _shown(self, angle, rate=0.0, seconds=0.0):
        """Angle that the head's interpolator gives, rad."""
        p = self.params
        shown = disc_angle(
            angle, p.eccentricity, p.eccentricity_phase + p.eccentricity_rate * seconds,
            0.5 * p.diameter, p.heads)
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

    def _grating_count(self, angle, stamps, rate=0.0, shift=0.0):
        shown = self._shown(angle, rate, np.asarray(stamps) * 1e-9 - self.start)
        return np.floor((shown + shift) / self.count_angle)

    # --- supply ---------------------------------------------------------------------------------

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

    # --- counter --------------------------------------------------------------------------------

    def _check_mark(self, passages, lost):
        """Compare the counter with the mark at passages after that which cleared it."""
        self._passed += len(passages.row)
        if len(passages.row) == 0:
            return
        row, sense, angle, rate = (column[-1] for column in passages)  # the last one is told
        counts = self._grating_count(angle, self._last[0], rate) - self._cleared_at - lost[row]
        sides = 0.5 * (self._sense - sense)  # 1: cleared from below, passed from above
        error = counts - sides * self.params.pulse_width / self.count_angle
        error -= self._turn_counts * np.rint(error / self._turn_counts)
        self._mark_error = float(np.rint(error))

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
        self.supply = self._monitor(volts[-1], int(stamps[-1]) // MONITOR_PERIOD)

        lost = self._count_losses(all_stamps, all_angles) + self._lost
        passages, short = self._mark.passages(
            all_stamps, all_angles, volts[1 - known:], temperature[1 - known:], self.zero_drift)
        self._missed += len(short)
        valid_from = 0
        if not self.homed:
            hits = np.flatnonzero(self._mark.clears(passages))
            if len(hits) == 0:
                return np.full(len(stamps), np.nan)
            row, self._sense, angle, rate = (column[hits[0]] for column in passages)
            self._cleared_at = float(self._grating_count(angle, all_stamps[row], rate))
            off = p.mark_angle - angle
            self.zero = float(off - _TURN * np.rint(off / _TURN))
            valid_from = row - known
            met = (round(self.start) << 16) + self.power_on  # of this night
            noise = float(keyed_noise.normal(self.seed, self._device, 'thermometer', met))
            self._measured = (self._monitor(volts[valid_from], met),
                              float(temperature[valid_from]) + p.thermometer_noise * noise)
            self._since = stamps[valid_from]
            lost = lost - lost[row]
            passages = Passages(*(column[hits[0] + 1:] for column in passages))
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
        counts = self._grating_count(past, stamps, rates, drift)
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
                and self._mark.far_from(np.append(angles, self._last[1]))
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
