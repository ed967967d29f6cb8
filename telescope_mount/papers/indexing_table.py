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

"""The simulated bench of paper 001, section 3: an indexing table turns the disc to 23 angles.

The two methods with which the paper compares its own are also here.
"""

import math
from functools import partial

import numpy as np

from encoder_reading.disc import INVERSION, WINDOW
from encoder_reading.paper_reader import BarReader, PaperReader
from encoder_reading.template_reader import TemplateReader
from msg_tools.units import ARCSEC, wrap

from ..simulation import Absolute, LinearCCD

FACES = 23
#: readings with damaged bars in the paper's fig. 12, counted from 1
DAMAGED = (5, 10, 15)
#: the paper's CCD at the two scales consistent with its figures, with the best grey levels
SCALES = {
    48: Absolute(noise=2.0),
    60: Absolute(noise=2.0, bar_pitch=60.0, blur=8.0, base=88.0),
}
#: largest error of the table used in the paper, rad
TABLE_ERROR = 0.2 * ARCSEC


class CentroidReader(BarReader):
    """Centroid of one bar, the first complete one (paper 001, reference 17).

    Its pixels above the threshold are weighted with their inverted grey level, which still includes
    the base. Noise at the edges decides which pixels count, and there is no averaging over bars.
    """

    def _place(self, grey, bars):
        start, end = bars.start[:, 0], bars.end[:, 0]
        inside = np.arange(self.pixels) < end[:, np.newaxis]
        inside &= np.arange(self.pixels) >= start[:, np.newaxis]
        light = np.where(inside, grey, 0.0)
        centroid = light @ np.arange(float(self.pixels)) / light.sum(axis=1)
        return bars.first + (self.middle - centroid) / self.pitch


class ParabolaReader(BarReader):
    """A parabola through the pixels of each decoded bar, a straight line through the 18 vertices.

    Bars whose parabola has no maximum within the bar are not used for the line.

    Parameters
    ----------
    design, disc
        See `BarReader`.
    at : {'start', 'middle'}
        Where the line is read: at pixel 0, as the paper reads its phase, or where it is most
        accurate, in the middle of the 18 bars.
    """

    def __init__(self, design, disc=None, at='start'):
        super().__init__(design, disc)
        if at not in ('start', 'middle'):
            raise ValueError(f"at {at!r} is not one of 'start', 'middle'")
        self.at = at

    def _place(self, grey, bars):
        rank = np.arange(float(WINDOW))
        vertex, good = _vertices(grey, bars.start[:, :WINDOW], bars.end[:, :WINDOW])
        enough = good.sum(axis=1) >= 3
        weight = np.where(enough[:, np.newaxis], good, 1.0)
        total = weight.sum(axis=1)
        mean_rank, mean_pixel = weight @ rank / total, (weight * vertex).sum(axis=1) / total
        offset = rank - mean_rank[:, np.newaxis]
        slope = (weight * offset * vertex).sum(axis=1) / (weight * offset**2).sum(axis=1)
        pixel = 0.0 if self.at == 'start' else mean_pixel
        place = bars.first + mean_rank + (pixel - mean_pixel) / slope
        return np.where(enough, place + (self.middle - pixel) / self.pitch, np.nan)


def _vertices(grey, start, end):
    """Vertex of the parabola through each run of pixels, and whether it is valid."""
    centre = 0.5 * (start + end - 1)
    pixel = start[:, :, np.newaxis] + np.arange(int((end - start).max()))
    inside = pixel < end[:, :, np.newaxis]
    rows = np.arange(len(grey))[:, np.newaxis, np.newaxis]
    value = grey[rows, np.minimum(pixel, grey.shape[1] - 1)] * inside
    x = (pixel - centre[:, :, np.newaxis]) * inside
    # the pixels lie symmetrically about the centre, so odd sums vanish
    n, x2 = inside.sum(axis=2), (x**2).sum(axis=2)
    x4 = (x**4).sum(axis=2)
    linear = (x * value).sum(axis=2) / x2
    square = (n * (x**2 * value).sum(axis=2) - x2 * value.sum(axis=2)) / (n * x4 - x2**2)
    with np.errstate(divide='ignore', invalid='ignore'):
        shift = -0.5 * linear / square
    good = (square < 0.0) & (np.abs(shift) <= 0.5 * (end - start))
    return centre + np.where(good, shift, 0.0), good


#: all tested methods, by name
METHODS = {
    'paper': PaperReader,
    'centroid': CentroidReader,
    'parabola': ParabolaReader,
    'template': TemplateReader,
    'paper_by_centres': partial(PaperReader, cycle='centres'),
    'parabola_at_middle': partial(ParabolaReader, at='middle'),
}


class IndexingTable:
    """A disc and its CCD on an indexing table.

    Parameters
    ----------
    params : absolute.Absolute
    seed : int
        Seed of disc, table and noise.
    methods : iterable of str
        Names from `METHODS`.

    Attributes
    ----------
    standard : ndarray, shape (23,)
        Angles of the table, rad.
    table_errors : ndarray, shape (23,)
        True angle - standard angle of the table, rad.
    damaged_readings : tuple of int
        Their numbers, counted from 1.
    gross : float
        Error from which a reading is grossly wrong: half a bar, rad.
    """

    def __init__(self, params, seed, methods=tuple(METHODS)):
        self.params, self.seed = params, seed
        self.disc = params.design.disc
        self.readers = {name: METHODS[name](params.design) for name in methods}
        self.ccd = LinearCCD(params, self.disc, seed)
        self.standard = 2.0 * np.pi * np.arange(FACES) / FACES
        self.damaged_readings = DAMAGED
        self.gross = 0.5 * self.disc.bar_angle
        self._rng = np.random.default_rng(seed)
        self.table_errors = self._rng.uniform(-TABLE_ERROR, TABLE_ERROR, FACES)

    def _frames(self, ccd, angles, noise=True):
        noise = self._rng.standard_normal((len(angles), self.params.pixels)) if noise else None
        return ccd.render(angles, noise)

    def _errors(self, frames, angles):
        return {name: wrap(reader.read(frames).angle - angles)
                for name, reader in self.readers.items()}

    def turns(self, n, damage=None):
        """Turn the disc to the standard angles, `n` times.

        Each time the disc has another known orientation on the table.

        Parameters
        ----------
        n : int
        damage : float, optional
            At the readings `DAMAGED`, displace one in ten of the bars in view by this number of
            bar periods, including the first complete one.

        Returns
        -------
        dict of str to ndarray, shape (n, 23)
            Reading - standard angle for each method, rad; NaN if it rejected the frame.
        """
        parts = []
        for _ in range(n):
            shown = self._rng.uniform(0.0, 2.0 * np.pi) + self.standard
            angles = shown + self.table_errors
            frames = self._frames(self.ccd, angles)
            if damage is not None:
                rows = np.array(DAMAGED) - 1
                ccd = self._damaged(angles[rows], frames[rows], damage)
                frames[rows] = self._frames(ccd, angles[rows])
            parts.append(self._errors(frames, shown))
        return {name: np.stack([part[name] for part in parts]) for name in self.readers}

    def _damaged(self, angles, frames, damage):
        """A CCD in front of the disc with one bar in ten displaced in the view of `frames`."""
        bars = self.disc.bars
        shift = np.zeros(bars)
        reach = int(0.5 * self.params.pixels / self.params.bar_pitch)
        grey = INVERSION - frames.astype(float)
        first = PaperReader(self.params.design).decode(grey).first
        for angle, bar in zip(angles, first):
            view = round(angle / self.disc.bar_angle) + np.arange(-reach, reach + 1)
            chosen = self._rng.choice(view, math.ceil(0.1 * len(view)) - 1, replace=False)
            shift[np.append(chosen, bar if bar >= 0 else view[0]) % bars] = damage
        return _DisplacedBars(self.params, self.disc, self.seed, shift)

    def one_bar(self, n=240, noise=True):
        """Turn the disc through one bar in equal steps.

        Returns
        -------
        position : ndarray, shape (n,)
            Position relative to the middle of the bar, rad.
        errors : dict of str to ndarray, shape (n,)
        """
        start = self._rng.integers(self.disc.bars) * self.disc.bar_angle
        position = self.disc.bar_angle * np.arange(n) / n
        angles = start + position
        return position, self._errors(self._frames(self.ccd, angles, noise), angles)

    def fits(self, n):
        """R-square and period (pixels) of the paper's sine fit at `n` random angles, shape (n,)."""
        angles = self._rng.uniform(0.0, 2.0 * np.pi, n)
        read = PaperReader(self.params.design).read(self._frames(self.ccd, angles))
        return read.r_square, read.period


class _DisplacedBars(LinearCCD):

    def __init__(self, params, disc, seed, shift):
        self._shift = shift
        super().__init__(params, disc, seed)

    def bar_places(self, device):
        place, present = super().bar_places(device)
        return place + self._shift, present
