"""The absolute encoder of paper 001 on an axis: disc, linear CCD and reader."""

import numpy as np

from encoder_reading.axis_reader import AxisReader, read_frames
from encoder_reading.frame_readings import FrameReadings

from .ccd import LinearCCD
from .encoder_scale import ZeroDrift, disc_angle, stamp_delays, tilted_angle


class AbsoluteEncoder:
    """One axis. It reads at once after power-on; where its zero then is, the scenario says.

    Parameters
    ----------
    params : scenario_encoders.Absolute
    seed : int
    axis : str
        What it is called.
    start : float
        Start of the night, UTC s, from which drifts with time count.
    lowest : float, optional
        Reading from which a turn begins, as for `axis_reader.AxisReader`.

    Attributes
    ----------
    power_on : int
        Number of this power-on, 1 for the first, without those of `params.power_cycles`.
    """

    def __init__(self, params, seed, axis, start=0.0, lowest=None):
        self.params, self.start, self._seed = params, start, seed
        device = f'absolute/{axis}'
        self._zero = ZeroDrift(params, seed, device)
        self.power_on, self._cycles = 1, np.sort(params.power_cycles)
        self.reader = AxisReader(params.design, axis, lowest)
        ccd = LinearCCD(params, self.reader.design.disc, seed, device)
        self.heads = [ccd, *(ccd.other_head(k) for k in range(1, params.heads))]

    def power_cycle(self):
        """Off and on again: what is read from now on may have another zero."""
        self.power_on += 1

    def power_ons(self, stamps):
        """Number of the power-on at `stamps` (ns), with those that the scenario made, int."""
        return self.power_on + np.searchsorted(
            self._cycles, np.asarray(stamps) * 1e-9 - self.start, side='right')

    def zeros(self, stamps):
        """Shift of the reading by its power-on at `stamps` (ns, shape (n,)), rad."""
        return np.array([self._zero.at_power_on(n) for n in self.power_ons(stamps).tolist()])

    def _shown(self, stamps, angles, rates, temperature, head):
        """Disc angle at the middle of the row of a head."""
        p = self.params
        temperature = p.reference_temperature if temperature is None else temperature
        past = angles - rates * (
            p.latency + stamp_delays(p, self._seed, 'absolute', stamps))
        opposite = np.pi * head
        shown = disc_angle(
            past, p.eccentricity, p.eccentricity_phase + opposite, 0.5 * p.diameter)
        shown = tilted_angle(shown, p.tilt, p.tilt_phase)
        drift = self._zero.later(stamps * 1e-9 - self.start, temperature)
        return shown + opposite + p.zero_offset + self.zeros(stamps) + drift

    def lamp(self, stamps):
        """Light of the lamp at `stamps` (ns, shape (n,)), relative to a new one; None: as new."""
        p = self.params
        if p.lamp_left == 1.0 and p.lamp_halving == 0.0:
            return None
        fading = 1.0 / p.lamp_halving if p.lamp_halving else 0.0
        return p.lamp_left * np.exp2(-fading * (stamps * 1e-9 - self.start))

    def frames(self, stamps, angles, rates=0.0, temperature=None):
        """What the CCDs see.

        Parameters
        ----------
        stamps : int or ndarray of int, shape (n,)
            ns.
        angles : float or ndarray, shape (n,)
            True angle of the axis, rad.
        rates : float or ndarray, shape (n,)
            rad/s; with the latency they say where the axis was, with the exposure how the image
            smears.
        temperature : float or ndarray, optional
            degC.

        Returns
        -------
        ndarray of uint8, shape (heads, n, pixels)
        """
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        angles = np.atleast_1d(np.asarray(angles, dtype=float))
        rates, lamp = np.asarray(rates, dtype=float), self.lamp(stamps)
        return np.array([
            ccd.frames(stamps, self._shown(stamps, angles, rates, temperature, head), rates, lamp)
            for head, ccd in enumerate(self.heads)])

    def read(self, stamps, angles, rates=0.0, temperature=None):
        """Read the axis; parameters as for `frames`.

        Returns
        -------
        FrameReadings
            Angles in rad, NaN where rejected.
        """
        part = read_frames([self.reader], [self.frames(stamps, angles, rates, temperature)])
        return FrameReadings(part.angle[:, 0], part.quality[:, 0], part.sigma[:, 0])
