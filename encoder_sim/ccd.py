"""The linear CCD that looks at the code disc of paper 001."""

import math

import numpy as np

from .disc import BAR_ANGLE, BARS

#: paper 001, eq. 4: inverted grey level = 250 - grey level
INVERSION = 250.0
_STEPS = 64  # of the table, a pixel


class LinearCCD:
    """Frames of a disc: dark bars on light ground, blurred, in 8 bits.

    Parameters
    ----------
    params : scenario.Absolute
    disc : disc.Disc

    Notes
    -----
    A bar is bright in the inverted image, base + contrast at most. Its edges are Gaussian
    integrals. A pixel sees no more than the nearest bar and its two neighbours, so the light of
    each of the eight combinations of them is tabulated once over the distance from the nearest.
    """

    def __init__(self, params, disc):
        self.params = params
        pitch = params.bar_pitch
        bits = disc.bits.astype(np.int64)
        self._combination = 4 * np.roll(bits, 1) + 2 * bits + np.roll(bits, -1)

        scale = pitch / (math.pi * params.diameter / BARS)  # pixels a metre on the circle
        self._half_table = math.ceil((0.5 * pitch + 1.0) * _STEPS)
        distance = np.arange(-self._half_table, self._half_table + 1) / _STEPS
        bars = [
            [
                _blurred_bar(distance - k * pitch, 0.5 * width * scale, params.blur)
                for width in (params.bar_wide, params.bar_narrow)
            ]
            for k in (-1, 0, 1)
        ]
        light = np.array(
            [bars[0][c >> 2] + bars[1][(c >> 1) & 1] + bars[2][c & 1] for c in range(8)]
        )
        self._table = INVERSION - (params.base + params.contrast * light)
        self._slope = np.diff(self._table, axis=1, append=self._table[:, -1:])
        # bars from the middle of the row, where the head reads, to each pixel
        self._offset = (np.arange(params.pixels) - 0.5 * (params.pixels - 1)) / pitch

    def light(self, angles):
        """Grey levels without noise or rounding.

        Parameters
        ----------
        angles : array_like, shape (n,)
            Angle of the disc at the middle of the row, rad.

        Returns
        -------
        ndarray, shape (n, pixels)
        """
        angles = np.atleast_1d(np.asarray(angles, dtype=float))
        place = angles[:, np.newaxis] / BAR_ANGLE % BARS + self._offset
        bar = np.rint(place)
        at = (place - bar) * (self.params.bar_pitch * _STEPS) + self._half_table
        entry = at.astype(np.int64)
        at -= entry
        combination = self._combination[bar.astype(np.int64) % BARS]
        entry += combination * self._table.shape[1]
        return self._table.ravel()[entry] + at * self._slope.ravel()[entry]

    def render(self, angles, noise=None):
        """Frames as the CCD delivers them.

        Parameters
        ----------
        angles : array_like, shape (n,)
            Angle of the disc at the middle of the row, rad.
        noise : ndarray, shape (n, pixels), optional
            In units of its standard deviation ``params.noise``.

        Returns
        -------
        ndarray of uint8, shape (n, pixels)
        """
        grey = self.light(angles)
        if noise is not None:
            grey = grey + self.params.noise * noise
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def _blurred_bar(distance, half_width, blur):
    """Light 0..1 of a bar behind a Gaussian blur, at distances from its centre, in pixels."""
    erf = np.frompyfunc(math.erf, 1, 1)
    root = math.sqrt(2.0) * blur
    edges = erf((distance + half_width) / root) - erf((distance - half_width) / root)
    return 0.5 * edges.astype(float)
