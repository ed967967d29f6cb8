"""The wind on the simulated mount: `scenario.Wind` by time and direction."""

import numpy as np

from pointing_model.mounts import ALTAZ

from .seeing import SlowNoise

#: speed at which the sizes are stated, m/s
REFERENCE_SPEED = 10.0


def von_karman(frequency, speed, length):
    """Spectrum of the speed along a turbulent wind, of integral 1.

    Parameters
    ----------
    frequency : ndarray
        Hz.
    speed, length : float
        Mean speed (m/s) and size of the largest eddies (m).

    Returns
    -------
    ndarray
        1/Hz: 4 t / (1 + 70.8 (f t)^2)^(5/6) with t = length / speed (ESDU 85020).
    """
    t = length / speed
    return 4.0 * t / (1.0 + 70.8 * (frequency * t) ** 2) ** (5.0 / 6.0)


class WindLoad:
    """What the wind does at any time.

    Parameters
    ----------
    params : scenario.Wind
    seed : int
    mount : pointing_model.mounts.Mount
        How the axes stand.

    Attributes
    ----------
    turns, bends : bool
        Whether it does anything to the axes, to the structure.
    """

    def __init__(self, params, seed, mount=ALTAZ):
        self.params, self._mount = params, mount
        blows = params.speed > 0.0
        self.turns, self.bends = blows and params.shake > 0.0, blows and params.bending > 0.0
        if not (self.turns or self.bends):
            return
        # towards where it blows, east, north, up
        self._towards = -np.array([np.sin(params.origin), np.cos(params.origin), 0.0])
        self._mean = (params.speed / REFERENCE_SPEED) ** 2
        corner = params.speed / params.length

        def gusts(response):
            return SlowNoise(
                lambda f: von_karman(f, params.speed, params.length), 1e-3 * corner,
                max(1e3 * corner, 20.0), seed, 'wind', 'gust', response)
        self._gusts, self._unheld = gusts(self._admittance), gusts(
            lambda f: self._admittance(f) * f / np.hypot(f, params.bandwidth))

    def _admittance(self, frequency):
        """Aerodynamic admittance: eddies smaller than the structure cancel (Vickery 1965)."""
        p = self.params
        return 1.0 / (1.0 + (2.0 * frequency * p.size / p.speed) ** (4.0 / 3.0))

    def _pressure(self, azimuth):
        """Of the mean wind, over that of 10 m/s, where the tube looks."""
        p = self.params
        return self._mean * (1.0 - 0.5 * p.shelter * (1.0 - np.cos(azimuth - p.origin)))

    def turn(self, seconds, angles):
        """By how much the axes are turned, and the encoders see.

        Parameters
        ----------
        seconds : ndarray, shape (n,)
            Since the start of the night.
        angles : ndarray, shape (n, 2)
            Of the axes, rad.

        Returns
        -------
        ndarray, shape (n, 2)
            rad.
        """
        if not self.turns:
            return np.zeros((len(seconds), 2))
        (east, north, _), (az, el) = self._towards, np.asarray(angles).T
        if not self._mount.vertical:
            right, up = (self._towards @ t for t in self._mount.tangents(az, el))
            across, az = right * np.cos(el), self._mount.horizon_of(az, el)[0]
            return self._torques(seconds, az, across, up)
        # torque about each axis: the force across the tube, and its lever
        across = (east * np.cos(az) - north * np.sin(az)) * np.cos(el)
        up = -np.sin(el) * (east * np.sin(az) + north * np.cos(az))
        return self._torques(seconds, az, across, up)

    def _torques(self, seconds, az, across, up):
        size = 2.0 * self.params.intensity * self.params.shake * self._pressure(az)
        return (size * self._unheld.at(seconds))[:, np.newaxis] * np.stack([across, up], axis=1)

    def bend(self, seconds, boresight, exposure=0.0):
        """Rotation vectors by which the structure is bent, steadily and by gusts.

        Parameters
        ----------
        seconds : ndarray, shape (n,)
            Since the start of the night, of the middle of exposures.
        boresight : ndarray, shape (n, 3)
            Unit vectors east, north, up.
        exposure : float
            Length, s.

        Returns
        -------
        ndarray, shape (n, 3)
            rad.
        """
        if not self.bends:
            return np.zeros(np.shape(boresight))
        p = self.params
        azimuth = np.arctan2(boresight[:, 0], boresight[:, 1])
        gust = 1.0 + 2.0 * p.intensity * self._gusts.at(seconds, exposure)
        size = p.bending * self._pressure(azimuth) * gust
        # about boresight x wind the boresight turns to where the wind goes
        return size[:, np.newaxis] * np.cross(boresight, self._towards)
