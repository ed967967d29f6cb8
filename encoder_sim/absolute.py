"""The absolute encoder of paper 001 on an axis: disc, linear CCD and reader."""

import numpy as np

from encoder_reading.axis_reader import AxisReader, read_frames
from encoder_reading.readings import Readings

from .ccd import LinearCCD
from .encoder_scale import ZeroDrift, disc_angle

_CHUNK = 256  # samples worked on at once, to bound the memory


class AbsoluteEncoder:
    """One axis. It keeps its zero without power.

    Parameters
    ----------
    params : scenario_encoders.Absolute
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
        device = f'absolute/{axis}'
        self._zero, self._drifts = ZeroDrift(params, seed, device), {}
        self.reader = AxisReader(params.design, axis)
        ccd = LinearCCD(params, self.reader.design.disc, seed, device)
        self.heads = [ccd, *(ccd.other_head(k) for k in range(1, params.heads))]

    @property
    def zero_drift(self):
        """Shift of the reading since this power-on, rad."""
        if self.power_on not in self._drifts:
            self._drifts[self.power_on] = self._zero.at_power_on(self.power_on)
        return self._drifts[self.power_on]

    def power_cycle(self):
        """Off and on again."""
        self.power_on += 1

    def _shown(self, stamps, angles, rates, temperature, head):
        """Disc angle at the middle of the row of a head."""
        p = self.params
        if self.start is None:
            self.start = stamps[0] * 1e-9
        temperature = p.reference_temperature if temperature is None else temperature
        past = angles - rates * p.latency
        opposite = np.pi * head
        shown = disc_angle(
            past, p.eccentricity, p.eccentricity_phase + opposite, 0.5 * p.diameter)
        drift = self._zero.later(stamps * 1e-9 - self.start, temperature)
        return shown + opposite + p.zero_offset + self.zero_drift + drift

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
        rates = np.asarray(rates, dtype=float)
        if len(stamps) == 0:
            return np.empty((len(self.heads), 0, self.params.pixels), dtype=np.uint8)
        rows = [ccd.frames(stamps, self._shown(stamps, angles, rates, temperature, head), rates)
                for head, ccd in enumerate(self.heads)]
        return rows[0][np.newaxis] if len(rows) == 1 else np.stack(rows)

    def read(self, stamps, angles, rates=0.0, temperature=None):
        """Read the axis; parameters as for `frames`.

        Returns
        -------
        Readings
            Angles in rad, NaN where rejected.
        """
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        angles = np.atleast_1d(np.asarray(angles, dtype=float))
        rates = np.broadcast_to(rates, angles.shape)
        parts = []
        for i in range(0, len(stamps), _CHUNK):
            rows = slice(i, i + _CHUNK)
            warmth = temperature if np.ndim(temperature) == 0 else temperature[rows]
            parts.append(read_together(
                [self], stamps[rows], angles[rows, np.newaxis], rates[rows, np.newaxis], warmth))
        if not parts:
            return Readings(np.empty(0), np.empty(0, dtype=np.int8), np.empty(0))
        return Readings(*(np.concatenate([getattr(part, name)[:, 0] for part in parts])
                          for name in ('angle', 'quality', 'sigma')))


def read_together(encoders, stamps, angles, rates, temperature=None):
    """Read several axes at the same stamps, all of one design in one go.

    Parameters
    ----------
    encoders : sequence of AbsoluteEncoder
    stamps : ndarray of int, shape (n,)
        ns.
    angles, rates : ndarray, shape (n, len(encoders))
        rad and rad/s.
    temperature : float or ndarray, shape (n,), optional
        degC.

    Returns
    -------
    Readings
        All arrays of shape (n, len(encoders)).
    """
    frames = [
        encoder.frames(stamps, angles[:, i], rates[:, i], temperature)
        for i, encoder in enumerate(encoders)]
    return read_frames([encoder.reader for encoder in encoders], frames)
