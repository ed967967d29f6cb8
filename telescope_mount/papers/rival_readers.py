"""The two methods that paper 001 compares its own with."""

import numpy as np

from encoder_reading.disc import WINDOW
from encoder_reading.paper_reader import BarReader


class CentroidReader(BarReader):
    """Centroid of one bar, the first whole one (paper 001, reference 17).

    Its pixels above the threshold are weighted with their inverted grey level, which still holds
    the base. Noise at the edges decides which pixels count, and one bar has no other to average
    with.
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

    A bar whose parabola has no top within it is left out of the line.

    Parameters
    ----------
    design, disc
        As for the others.
    at : {'start', 'middle'}
        Where the line is read: at pixel 0, as the paper reads its phase, or where it is best
        known, in the middle of the 18 bars.
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
    """Top of the parabola through each run of pixels, and whether it is one."""
    centre = 0.5 * (start + end - 1)
    offset = np.arange(int((end - start).max()))
    pixel = start[:, :, np.newaxis] + offset
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
