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

"""Turbulent air and photon noise: noise of star positions, and refraction that drifts."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC, DEG

from . import keyed_noise
from .field_kinds import number

#: full width at half maximum of a Gaussian in units of sigma
_FWHM = 2.0 * np.sqrt(2.0 * np.log(2.0))


@dataclass(frozen=True)
class Seeing:
    """Noise of star positions due to turbulence and photons, in addition to `Camera.star_noise`.

    The image motion of one axis, (0.182 (D/r0)^(5/3))^(1/2) lambda/D at one instant (Noll 1976, J.
    Opt. Soc. Am. 66, 207; as a measure of seeing: H. M. Martin 1987, PASP 99, 1360), decreases
    with the root of the exposure beyond `motion_time`. Photon noise: the image width over the
    root of their number, and background noise (K. A. Winick 1986, J. Opt. Soc. Am. A 3, 1809).

    Attributes
    ----------
    fwhm : float
        Full width at half maximum at the zenith, rad; proportional to airmass^0.6.
    aperture : float
        Aperture of the telescope, m.
    motion_time : float
        Correlation time of the image motion, s: size of the largest eddies over the wind speed.
    star_rate : float
        Electrons per second from a star of magnitude 0 above the air; 0: no photon noise.
    extinction : float
        Magnitudes per airmass.
    sky : float
        Magnitude of a square arcsecond of sky.
    """

    fwhm: float = number(0.0, 'arcsec', 0.0, 60.0)
    aperture: float = number(0.2, 'm', 0.01, 50.0)
    motion_time: float = number(1.0, 's', 1e-3, 100.0)
    star_rate: float = number(0.0, 'ke_per_s', 0.0, 1e9)
    extinction: float = number(0.2, '', 0.0, 5.0)
    sky: float = number(20.0, '', 0.0, 25.0)


@dataclass(frozen=True)
class AirLayers:
    """Layers of the air that are temporarily tilted: refraction drifts.

    Their tilt is a vector of two components that follow an AR(1) process in time; refraction is
    about their normal. So a star is displaced by R0 tilt / sin^2 E in elevation and by
    R0 tilt / sin E across, with R0 = 55" (C. Hirt 2006, Astron. Astrophys. 459, 283, finds
    zenith refraction of 0.05-0.2"; M. S. Taylor et al. 2013, Astron. J. 145, 82: some tenths of
    an arcsecond over ten minutes, from structures below 60 m).

    Attributes
    ----------
    lean : float
        1-sigma of each component, rad; 1 deg displaces a star at the zenith by 1".
    correlation_time : float
        s.
    """

    lean: float = number(0.0, 'deg', 0.0, 10.0)
    correlation_time: float = number(10.0, 'min', 0.01, 10000.0)


def airmass(elevation):
    """Airmass at elevations (rad): F. Kasten and A. T. Young 1989, Appl. Opt. 28, 4735."""
    degrees = np.maximum(np.asarray(elevation, dtype=float) / DEG, 0.0)
    return 1.0 / (np.sin(degrees * DEG) + 0.50572 * (degrees + 6.07995) ** -1.6364)


def motion_sigma(seeing, elevation, exposure, wavelength):
    """1-sigma of the image motion on one axis.

    Parameters
    ----------
    seeing : Seeing
    elevation : ndarray
        rad.
    exposure, wavelength : float
        s, m.

    Returns
    -------
    ndarray
        rad.
    """
    # Fried parameter at the zenith; r0^(-5/3) is proportional to airmass, so the width to ^0.6
    r0 = 0.98 * wavelength / seeing.fwhm
    instant = 0.182 * (seeing.aperture / r0) ** (5.0 / 3.0) * (wavelength / seeing.aperture) ** 2
    return np.sqrt(instant * airmass(elevation) / (1.0 + exposure / seeing.motion_time))


def photon_sigma(seeing, elevation, mag, exposure):
    """1-sigma of the centroid on one axis due to photon noise of star and sky.

    Parameters
    ----------
    seeing, elevation, exposure
        See `motion_sigma`.
    mag : ndarray
        Magnitude of the star above the air.

    Returns
    -------
    ndarray
        rad: s / sqrt(N) sqrt(1 + 8 pi s^2 b / N), with N electrons from the star, b from the sky
        per unit of solid angle, and s the width of the image.
    """
    if seeing.star_rate == 0.0:
        return np.zeros(np.shape(elevation))
    air = airmass(elevation)
    width = seeing.fwhm * air**0.6 / _FWHM
    first = seeing.star_rate * exposure
    star = first * 10.0 ** (-0.4 * (mag + seeing.extinction * air))
    sky = first * 10.0 ** (-0.4 * seeing.sky) / ARCSEC**2
    return width / np.sqrt(star) * np.sqrt(1.0 + 8.0 * np.pi * width**2 * sky / star)


def seeing_sigma(seeing, elevation, mag, exposure, wavelength):
    """Both together; 0 without seeing. Parameters as in `motion_sigma` and `photon_sigma`."""
    if seeing.fwhm == 0.0:
        return np.zeros(np.shape(elevation))
    return np.hypot(motion_sigma(seeing, elevation, exposure, wavelength),
                    photon_sigma(seeing, elevation, mag, exposure))


class TurbulentRefraction:
    """Refraction about the normal of air layers whose tilt varies.

    Parameters
    ----------
    layers : AirLayers
    constant : float
        Refraction constant: refraction = constant times tan z, rad.
    seed : int
    """

    def __init__(self, layers, constant, seed):
        self._size = layers.lean * constant
        if self._size > 0.0:
            self._lean = [ar_noise(layers.correlation_time, seed, 'air', side)
                          for side in ('east', 'north')]

    def bent(self, seconds, towards):
        """Directions in which stars are seen.

        Parameters
        ----------
        seconds : ndarray, shape (n,)
            Time since the start of the night.
        towards : ndarray, shape (n, 3)
            Unit vectors east, north, up, as seen through level layers.

        Returns
        -------
        ndarray, shape (n, 3)
            Unit vectors. Refraction adds constant / cos z times the normal of the layers, across
            the ray; here its change with the tilt, to first order.
        """
        if self._size <= 0.0:
            return towards
        lean = np.zeros(towards.shape)
        for axis, process in enumerate(self._lean):
            lean[:, axis] = process.at(seconds)
        up = np.maximum(towards[:, 2:], 0.02)
        along = np.einsum('ni,ni->n', lean, towards)[:, np.newaxis]
        # derivative of n / (n . s) for a normal n: lean / up - normal (lean . s) / up^2
        shift = lean / up - np.array([0.0, 0.0, 1.0]) * along / up**2
        shift -= towards * np.einsum('ni,ni->n', shift, towards)[:, np.newaxis]
        bent = towards + self._size * shift
        return bent / np.linalg.norm(bent, axis=1, keepdims=True)


#: sines per decade of frequency, each at a random frequency within its band
_A_DECADE = 40
_CHUNK = 4096


class SlowNoise:
    """A random process of mean 0, by default of standard deviation 1.

    Parameters
    ----------
    spectrum : callable
        One-sided power spectrum at frequencies (n,), Hz, in any units.
    slowest, fastest : float
        Range of the frequencies, Hz.
    seed : int
    device, purpose : str
        See `keyed_noise.uniform`.
    response : callable, optional
        Gain at frequencies (n,), applied to the process of standard deviation 1. The same seed,
        device and purpose with another response is the same gust elsewhere.
    """

    def __init__(self, spectrum, slowest, fastest, seed, device, purpose, response=None):
        count = max(2, int(np.ceil(_A_DECADE * np.log10(fastest / slowest))))
        edges = np.geomspace(slowest, fastest, count + 1)
        keys = np.arange(count)
        place = keyed_noise.uniform(seed, device, f'{purpose} frequency', keys)
        self._frequency = edges[:-1] * (edges[1:] / edges[:-1]) ** place
        self._phase = 2.0 * np.pi * keyed_noise.uniform(seed, device, f'{purpose} phase', keys)
        power = spectrum(self._frequency) * np.diff(edges)
        self._amplitude = np.sqrt(2.0 * power / power.sum())
        if response is not None:
            self._amplitude = self._amplitude * response(self._frequency)

    @property
    def sigma(self):
        """Standard deviation."""
        return float(np.sqrt(0.5 * np.sum(self._amplitude**2)))

    def at(self, seconds, exposure=0.0):
        """Values at `seconds` (any shape), each averaged over `exposure` (s) around it."""
        seconds = np.asarray(seconds, dtype=float)
        amplitude = self._amplitude * np.sinc(self._frequency * exposure)
        flat = seconds.ravel()
        out = [np.cos(np.multiply.outer(flat[i:i + _CHUNK], 2.0 * np.pi * self._frequency)
                      + self._phase) @ amplitude for i in range(0, len(flat), _CHUNK)]
        return (np.concatenate(out) if out else flat).reshape(seconds.shape)


def ar_noise(correlation_time, seed, device, purpose):
    """`SlowNoise` of first order: its autocorrelation is exp(-lag / `correlation_time`)."""
    corner = 0.5 / (np.pi * correlation_time)

    def lorentzian(frequency):
        return 1.0 / (1.0 + (frequency / corner) ** 2)
    return SlowNoise(lorentzian, 1e-3 * corner, 1e3 * corner, seed, device, purpose)
