"""The absolute encoder of paper 001 on an axis: disc, linear CCD and reading."""

import dataclasses
from functools import lru_cache

import numpy as np

from encoder_reading.disc import Disc
from encoder_reading.readings import CORRECTED, EXACT, REJECTED, Readings

from .ccd import LinearCCD
from .encoder_scale import ZeroDrift, disc_angle
from .scenario import Absolute

__all__ = ['CORRECTED', 'EXACT', 'REJECTED', 'AbsoluteEncoder', 'Readings', 'read_together']

_TURN = 2.0 * np.pi
_CHUNK = 256  # samples worked on at once, to bound the memory
_BLOCK = 8  # frames that the paper's reading gets at once
#: what a reading knows of its encoder: the drawing of the disc and of the optics, no flaw
_NOMINAL = ('diameter', 'code', 'bar_wide', 'bar_narrow', 'geometry', 'pixels', 'bar_pitch',
            'blur', 'reading')


@lru_cache(maxsize=8)
def _disc(code):
    return Disc(code)


@lru_cache(maxsize=8)
def _reader(nominal):
    params = dataclasses.replace(Absolute(), **dict(zip(_NOMINAL, nominal)))
    disc = _disc(params.code)
    if params.reading == 'paper':
        from encoder_reading.paper_reader import PaperReader
        return PaperReader(params, disc)
    from encoder_reading.template_reader import TemplateReader
    return TemplateReader(params, disc)


def reader_of(params):
    """The reading that `params` ask for; encoders of one design share it.

    Parameters
    ----------
    params : scenario.Absolute

    Raises
    ------
    ValueError
        The design cannot be read.
    """
    return _reader(tuple(getattr(params, name) for name in _NOMINAL))


class AbsoluteEncoder:
    """One axis. It keeps its zero without power.

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
        device = f'absolute/{axis}'
        self._zero, self._drifts = ZeroDrift(params, seed, device), {}
        self.reader = reader_of(params)
        self.disc = _disc(params.code)
        ccd = LinearCCD(params, self.disc, seed, device)
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

    def reading(self, readings):
        """The axis from the readings of its heads.

        Parameters
        ----------
        readings : Readings
            Of frames as `frames` gives them, one head after the other.

        Returns
        -------
        Readings
            Rejected where any head is: a single head would bring the eccentricity back.
        """
        angle, quality = readings.angle, readings.quality
        if len(self.heads) == 2:
            first, second = angle.reshape(2, -1)
            apart = (second - first) % _TURN - np.pi
            angle = (first + 0.5 * apart) % _TURN
            quality = quality.reshape(2, -1).max(axis=0)
        if self.axis == 'elevation':
            angle = (angle + np.pi) % _TURN - np.pi
        return Readings(angle, quality)

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
            return Readings(np.empty(0), np.empty(0, dtype=np.int8))
        return Readings(np.concatenate([part.angle[:, 0] for part in parts]),
                        np.concatenate([part.quality[:, 0] for part in parts]))


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
        Both arrays of shape (n, len(encoders)).
    """
    frames = [
        encoder.frames(stamps, angles[:, i], rates[:, i], temperature)
        for i, encoder in enumerate(encoders)]
    return read_frames(encoders, frames)


def read_frames(encoders, frames):
    """As `read_together`, from the frames of each encoder, shapes (heads, n, pixels)."""
    n = frames[0].shape[1]
    angle = np.empty((n, len(encoders)))
    quality = np.empty((n, len(encoders)), dtype=np.int8)
    for reader in {id(e.reader): e.reader for e in encoders}.values():
        mine = [i for i, e in enumerate(encoders) if e.reader is reader]
        rows = np.concatenate([frames[i].reshape(-1, frames[i].shape[2]) for i in mine])
        paper = encoders[mine[0]].params.reading == 'paper'
        readings = _read_in_blocks(reader, rows) if paper else reader.read(rows)
        begin = 0
        for i in mine:
            end = begin + frames[i].shape[0] * n
            axis = encoders[i].reading(
                Readings(readings.angle[begin:end], readings.quality[begin:end]))
            angle[:, i], quality[:, i] = axis.angle, axis.quality
            begin = end
    return Readings(angle, quality)


def _read_in_blocks(reader, rows):
    """Always so many frames at once.

    The last digit of a product of matrices depends on their size. In blocks of one size a reading
    is the same to the last bit whatever else is read with it, as ours is by itself.
    """
    angle, quality = np.empty(len(rows)), np.empty(len(rows), dtype=np.int8)
    for i in range(0, len(rows), _BLOCK):
        block = rows[i : i + _BLOCK]
        n = len(block)
        if n < _BLOCK:
            block = np.concatenate([block, np.repeat(block[-1:], _BLOCK - n, axis=0)])
        readings = reader.read(block)
        angle[i : i + n], quality[i : i + n] = readings.angle[:n], readings.quality[:n]
    return Readings(angle, quality)
