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

Its errors (`Incremental`), the grating as seen by the head (`_shown`), and the counter with the
mark (`feed`) are in one file, as they share the state of one device.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.homing import AxisHoming

from . import keyed_noise
from .encoder_scale import EncoderScale, ZeroDrift, stamp_delays
from .field_kinds import choice, number, sections
from .graduated_disc import SineSignals, disc_angle, tilted_angle
from .reference_mark import Passages, ReferenceMark

_TURN = 2.0 * np.pi
_MILLION = 1e6
#: counts by which a later passage of the mark may differ: rounding, jitter, pulse variations
MARK_TOLERANCE = 10
#: period of the supply monitor, ns
MONITOR_PERIOD = 10**9


@dataclass(frozen=True)
class CountLoss:
    """A fault: the counter suddenly loses `counts`, `at` seconds after the start."""

    at: float = number(0.0, 's', 0.0, 1e6)
    counts: int = number(0, '', -10**9, 10**9, kind=int)


@dataclass(frozen=True)
class Incremental(EncoderScale):
    """The incremental encoder of paper 000 on one axis.

    The reference mark gives a triangular signal (a slit seen through a slit), which a comparator
    converts to the index pulse. At the reference temperature and the nominal supply its peak is 1.

    Attributes
    ----------
    lines, interpolation : int
        Lines of the grating, and counts (quadrature edges) per line.
    tilt, tilt_phase : float
        Angle between the disc and the plane normal to the axis (rad), and the axis angle at which
        their line of intersection is at the head (rad).
    heads : int
        One reading head, or the mean of two opposite ones.
    subdivision_1, subdivision_2, subdivision_phase : float
        Interpolation error once and twice per line (rad), and its phase (rad).
    worm_teeth : int
        Teeth of the worm wheel, for an encoder on the worm: its periodic error then appears in the
        reading, so many times per turn of the axis.
    worm_1, worm_2, worm_phase : float
        Amplitudes once and twice per turn of the worm (rad), and phase (rad). Amateurs measured
        7 to 10" peak to peak for good worms and 30" for mass-produced ones (ATM list, July 1995).
    offset_cos, offset_sin : float
        DC offsets of the two grating signals, relative to their amplitude at rest. The scope manual
        of Heidenhain (PWM 20, 2014) allows +-15 degrees of on-to-off ratio, 13 %, an amplitude
        ratio of 0.8 to 1.25 and a phase of 80 to 100 degrees; for encoders with fine interpolation
        10 %, 0.9 to 1.1 and 85 to 95 degrees.
    amplitude_mismatch : float
        Difference of the amplitudes, cosine - sine, relative to their mean.
    quadrature_error : float
        Excess of the phase between both signals over a quarter of a line, rad.
    bandwidth : float
        -3 dB bandwidth of the signals, Hz of lines; 0: unlimited. The inputs of PWM 8 have 60 to
        100 kHz, which no telescope reaches: 6 deg/s with paper 000's grating are 790 Hz. A noise
        filter or a slow converter has less.
    mark_angle : float
        Nominal axis angle of the reference mark, rad.
    mark_scatter : float
        1-sigma of the position at which the mark is detected, per passage, rad. A mark tied to a
        line of the grating can be good to a count; no manufacturer's figure was found, for these
        (Renishaw calls that of its RESR rings "a repeatable home position") or for others.
    spurious_index : float
        Rate of false index pulses from disturbances on the line, 1/s. The first one after power-on
        clears the counter as the mark would; later ones contradict the count, which controllers
        call a broken index. No rates were found: it is a fault, not a property.
    pulse_width : float
        Width of the mark's signal at half its peak, rad. The counter is cleared at the near edge
        of the pulse: from above, this is one pulse width higher than from below.
    threshold : float
        Threshold of the comparator: determines the width of the pulse; a mark with a weaker signal
        gives no pulse.
    signal_slope, signal_supply : float
        Relative change of the signal per degC and per volt.
    pulse_time : float
        Shortest pulse that is detected, s.
    mark_from : {'any', 'below', 'above'}
        The direction from which the mark clears the counter.
    mark_slope, mark_supply : float
        Shift of the mark on the grating, in the reading, rad/degC and rad/V, at the time when the
        mark is passed.
    zero_supply : float
        Permanent dependence of the reading on the supply, rad/V.
    supply, supply_nominal, supply_rate : float
        Supply at the start (V), nominal supply (V), and its change (V/s).
    supply_scatter : float
        1-sigma of the supply between power-ons, the same for both axes, V.
    thermometer_noise, voltmeter_noise : float
        1-sigma of the electronics' measurements of temperature (degC) and supply (V).
    voltmeter_step : float
        Resolution of the voltmeter, V: 4 mV for a common 12-bit monitor (Texas Instruments,
        INA219); 0: unlimited.
    supply_ripple, ripple_frequency : float
        Amplitude (V) and frequency (Hz) of mains ripple on the supply.
    max_count_rate : float
        Highest count rate, edges per second; excess edges are lost. 0: no limit.
    miscounts : float
        Wrong counts due to noise, up or down, per million counts.
    jitter : float
        1-sigma noise of one reading, counts.
    rate_gate : float
        Gate time of the rate, s: counts in this time before the reading, divided by it (M method of
        a counter: Ohmae et al. 1982, IEEE Trans. Ind. Electron. IE-29, 207). Its noise is that of
        two counts with their jitter: 0.7"/s for one count in 100 ms.
    losses : tuple of CountLoss
        Faults: counts lost by disturbances.
    home_side : {'below', 'above'}
        Side from which homing approaches the mark.
    home_rate : float
        Rate at which homing passes it, rad/s.
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
    """The encoder of one axis: grating, index pulse, counter.

    Parameters
    ----------
    params : Incremental
    seed : int
    axis : str
        ``azimuth`` or ``elevation``: selects the random numbers, together with the seed.
    power_on : int
        Number of this power-on, 1 for the first: selects the zero drift.
    start : float
        Start of the night, UTC s, the origin of drifts and faults.

    Attributes
    ----------
    count_angle : float
        Angle of a count, rad: 0.0686" for paper 000's grating.
    zero : float
        Zero of the reading after homing, rad: drift of this power-on, side and shift of the mark.
        NaN before; truth, for the simulator's own log.
    supply : float
        Supply measured by the monitor in the second of the last sample, V.
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
        self._cycles = sorted(params.power_cycles)  # future ones
        self._flicker = None, 0.0  # key and value of the monitor's noise
        self.supply = self._monitor(params.supply, int(start))
        self._clear()

    @property
    def homed(self):
        """Whether the mark has cleared the counter since power-on."""
        return self._cleared_at is not None

    @property
    def zero_drift(self):
        """Shift of the reading in this power-on, rad."""
        return self._zero.at_power_on(self.power_on)

    @property
    def homing(self):
        """`AxisHoming` after the last sample, without the start of the power-on."""
        return AxisHoming(self.homed, {0: '', 1: 'below', -1: 'above'}[self._sense], self._missed,
                          self._passed, self._mark_error, self.count_angle,
                          self.params.pulse_width, self.power_on, np.nan, *self._measured)

    @property
    def miscounted(self):
        """Whether the last passage of the mark contradicted the counter.

        Counts were lost, the mark moved, or one of the two pulses was false.
        """
        return bool(abs(self._mark_error) > MARK_TOLERANCE)

    def power_cycle(self):
        """Switch off and on: the count is lost, and the mark will be found elsewhere."""
        self.power_on += 1
        self._clear()

    def _clear(self):
        self._cleared_at = None  # grating count at which the counter was cleared
        self.zero = np.nan
        self._sense = 0  # direction of the motion that cleared it
        self._last = None  # stamp and angle of the last sample
        self._since = None  # stamp of the first reading
        self._lost = 0  # counts lost since
        self._missed = self._passed = 0
        self._mark_error = np.nan
        self._measured = (np.nan, np.nan)  # supply and temperature at the mark

    # --- grating --------------------------------------------------------------------------------

    def _shown(self, angle, rate=0.0, seconds=0.0):
        """Angle from the head's interpolator, rad."""
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
        """The electronics' measurement of the supply, V, with the noise for `key`."""
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
        """Compare the counter with the mark at passages after the one that cleared it."""
        self._passed += len(passages.row)
        if len(passages.row) == 0:
            return
        row, sense, angle, rate = (column[-1] for column in passages)  # the last one is reported
        counts = self._grating_count(angle, self._last[0], rate) - self._cleared_at - lost[row]
        sides = 0.5 * (self._sense - sense)  # 1: cleared from below, passed from above
        error = counts - sides * self.params.pulse_width / self.count_angle
        error -= self._turn_counts * np.rint(error / self._turn_counts)
        self._mark_error = float(np.rint(error))

    def _count_losses(self, stamps, angles):
        """Counts lost between the first sample and each of the samples, shape (n,)."""
        p = self.params
        lost = np.zeros(len(stamps))
        if not (p.max_count_rate or p.miscounts or p.losses) and self._signals.ideal:
            return lost
        counts = np.nan_to_num(np.diff(angles) / self.count_angle)  # none at a bad sample
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
        """Read the axis at increasing stamps.

        Parameters
        ----------
        stamps : int or ndarray of int, shape (n,)
            ns.
        angles : float or ndarray, shape (n,)
            True angle of the axis, rad, not wrapped between samples. Motion is assumed uniform
            between two samples, so they must be close enough for the rate at which the mark is
            passed and counts are lost.
        rates : float or ndarray, shape (n,)
            rad/s; determine the axis angle before the latency.
        temperature : float or ndarray, optional
            degC.

        Returns
        -------
        ndarray, shape (n,)
            Readings, rad, in whole counts; NaN until the mark has been passed.
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
        """`feed` within one power-on."""
        if len(stamps) == 0:
            return np.empty(0)
        p = self.params
        volts = self._volts(stamps * 1e-9 - self.start)
        # motion starts at the last sample of the previous call
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
            met = (round(self.start) << 16) + self.power_on  # key for this night
            noise = float(keyed_noise.normal(self.seed, self._device, 'thermometer', met))
            self._measured = (self._monitor(volts[valid_from], met),
                              float(temperature[valid_from]) + p.thermometer_noise * noise)
            self._since = stamps[valid_from]
            lost = lost - lost[row]
            passages = Passages(*(column[hits[0] + 1:] for column in passages))
        self._check_mark(passages, lost)
        lost = lost[known:]
        self._lost = lost[-1]

        # late stamps do not affect the counter, only what is read at the stamp
        read = past - rates * stamp_delays(p, self.seed, 'incremental', stamps)
        counts = self._counter(stamps, read, rates, temperature, volts) - self._cleared_at - lost
        reading = p.mark_angle + counts * self.count_angle
        reading[:valid_from] = np.nan
        return reading

    def _counter(self, stamps, past, rates, temperature, volts):
        """Grating counts read by the electronics at `stamps`, without clearing or losses."""
        p = self.params
        drift = (p.zero_offset + self._zero.later(stamps * 1e-9 - self.start, temperature)
                 + p.zero_supply * (volts - p.supply_nominal))
        counts = self._grating_count(past, stamps, rates, drift)
        if p.jitter > 0.0:
            noise = keyed_noise.normal(self.seed, self._device, 'jitter', stamps)
            counts = counts + np.round(p.jitter * noise)
        return counts

    def only_counts(self, stamps, angles):
        """Whether samples cause nothing but counting, shape (n,), parameters as in `feed`.

        No mark is near the path and the power stays on, so the state of the marks does not
        change.
        """
        return (self.homed and not self.params.spurious_index
                and self._mark.far_from(np.append(angles, self._last[1]))
                and not (self._cycles and stamps[-1] * 1e-9 - self.start >= self._cycles[0]))

    def rate(self, stamps, angles, rates=0.0, temperature=None):
        """Rate that the electronics send with the reading of a sample.

        Parameters
        ----------
        stamps, angles, rates, temperature
            Samples as in `feed`, which must have taken them before.

        Returns
        -------
        ndarray, shape (n,)
            Counts during the gate time up to now, divided by that time, rad/s. NaN if there was no
            reading yet at its start.
        """
        p = self.params
        gate = round(p.rate_gate * 1e9)
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        if self._since is None:
            return np.full(len(stamps), np.nan)
        # where the axis was at that time is all that the head has seen
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
    """`values` as an array with one number per sample."""
    values = np.asarray(values, dtype=float)
    return values if values.shape == samples.shape else np.broadcast_to(values, samples.shape)
