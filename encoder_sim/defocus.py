"""What a disc does to its image that does not stay in the focus of its CCD."""

import math

import numpy as np

#: by which the square of the blur grows from one table of the track to the next
_GROWTH = 1.1


class Defocus:
    """A disc with axial run-out, or tilted, in front of its optics.

    Parameters
    ----------
    params : scenario_encoders.Absolute
    steps : float
        Entries of the track's table a pixel.

    Attributes
    ----------
    sharp : bool
        Whether the disc stays in focus, and the image is that of any ideal disc.

    Notes
    -----
    At a distance z from the focus a point becomes a patch of radius z tan u, with sin u the
    numerical aperture, whose 1-sigma is half of that; as a Gaussian it joins the blur in
    quadrature. Where the light comes at an angle w along the track, the image moves by z tan w.
    """

    def __init__(self, params, steps):
        p = self._params = params
        self._radius = 0.5 * p.diameter
        self._stroke = self._radius * math.sin(p.tilt)
        self._farthest = abs(p.focus_error) + p.runout + abs(self._stroke)
        self._steps = steps
        self.sharp = self._farthest * max(p.defocus_slope, abs(p.lean), abs(p.image_growth)) == 0.0

    def height(self, angles):
        """Distance of the track from the focus, m, where the disc angle `angles` is read."""
        p = self._params
        return (p.focus_error + p.runout * np.cos(angles - p.runout_phase)
                + self._stroke * np.sin(angles - p.tilt_phase))

    def shift(self, height):
        """By how much the disc seems further, rad, with the track at `height` (m)."""
        return height * math.tan(self._params.lean) / self._radius

    def growth(self, height):
        """Scale of the image, relative, with the track at `height` (m)."""
        return 1.0 + self._params.image_growth * height

    def tables(self, track):
        """The track through more and more blur.

        Parameters
        ----------
        track : ndarray, shape (entries,)
            Once around.

        Returns
        -------
        ndarray, shape (tables, entries)
        """
        sharp = self._params.blur**2
        most = (self._params.defocus_slope * self._farthest) ** 2
        n = 1 + math.ceil(math.log1p(most / sharp) / math.log(_GROWTH))
        self._variance = sharp * (_GROWTH ** np.arange(n) - 1.0)
        wave = np.fft.rfftfreq(len(track)) * (2.0 * np.pi * self._steps)  # 1/pixel
        spectrum = np.fft.rfft(track.astype(float))
        return np.array([
            np.fft.irfft(spectrum * np.exp(-0.5 * more * wave**2), len(track))
            for more in self._variance], dtype=np.float32)

    def between(self, height):
        """Which of `tables` lies below the blur of each height, and how far it is to the next."""
        more = (self._params.defocus_slope * height) ** 2
        if len(self._variance) == 1:
            return np.zeros(len(more), dtype=np.intp), np.zeros(len(more))
        lower = np.clip(np.searchsorted(self._variance, more, side='right') - 1, 0,
                        len(self._variance) - 2)
        return lower, (more - self._variance[lower]) / np.diff(self._variance)[lower]
