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

"""The effect of wind on the simulated mount, by time and direction."""

from dataclasses import dataclass

import numpy as np

from pointing_model.mounts import ALTAZ

from .field_kinds import number
from .seeing import SlowNoise

#: speed for which the sizes are given, m/s
REFERENCE_SPEED = 10.0


@dataclass(frozen=True)
class Wind:
    """Wind on the tube: it bends the structure, which no encoder measures, and turns the axes.

    The force is proportional to the dynamic pressure, so to speed^2, and to the component of the
    wind across the tube; its relative fluctuation is 2 `intensity`, with von Karman's spectrum,
    low-passed by the size of the structure (L. Zago 1995, thesis EPFL 1394, ch. 2 and 4;
    D. G. MacMynowski and T. Andersen 2010, Appl. Opt. 49, 625). The servo corrects what is slower
    than its bandwidth.

    Attributes
    ----------
    speed : float
        Mean speed, m/s.
    origin : float
        Azimuth from which the wind blows, rad.
    intensity : float
        Turbulence intensity: 1-sigma of the speed over its mean.
    length : float
        Size of the largest eddies, m.
    size : float
        Size of the exposed structure, m; smaller eddies average out.
    shelter : float
        Fraction of the pressure that the building removes when the tube points down the wind;
        none against the wind, half of it across the wind.
    bending : float
        Bending of the tube by a steady 10 m/s across it, rad.
    shake : float
        Rotation of an axis by such a wind before the servo reacts, rad.
    bandwidth : float
        Bandwidth of the servo, Hz.
    """

    speed: float = number(0.0, 'm_s', 0.0, 60.0)
    origin: float = number(0.0, 'deg', -360.0, 360.0)
    intensity: float = number(15.0, 'percent', 0.0, 100.0)
    length: float = number(80.0, 'm', 0.1, 2000.0)
    size: float = number(1.0, 'm', 0.01, 100.0)
    shelter: float = number(50.0, 'percent', 0.0, 100.0)
    bending: float = number(0.0, 'arcsec', 0.0, 600.0)
    shake: float = number(0.0, 'arcsec', 0.0, 600.0)
    bandwidth: float = number(2.0, 'hz', 1e-3, 1000.0)


def von_karman(frequency, speed, length):
    """Normalized spectrum of the speed along a turbulent wind.

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
    """The effect of the wind at any time.

    Parameters
    ----------
    params : Wind
    seed : int
    mount : pointing_model.mounts.Mount
        Orientation of the axes.

    Attributes
    ----------
    turns, bends : bool
        Whether it turns the axes, and whether it bends the structure.
    """

    def __init__(self, params, seed, mount=ALTAZ):
        self.params, self._mount = params, mount
        blows = params.speed > 0.0
        self.turns, self.bends = blows and params.shake > 0.0, blows and params.bending > 0.0
        if not (self.turns or self.bends):
            return
        # direction of the wind, east, north, up
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
        """Pressure of the mean wind, relative to 10 m/s, where the tube points."""
        p = self.params
        return self._mean * (1.0 - 0.5 * p.shelter * (1.0 - np.cos(azimuth - p.origin)))

    def turn(self, seconds, angles):
        """Rotation of the axes by the wind, which the encoders measure.

        Parameters
        ----------
        seconds : ndarray, shape (n,)
            Time since the start of the night.
        angles : ndarray, shape (n, 2)
            Angles of the axes, rad.

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
        # torque about each axis: the force across the tube times its lever
        across = (east * np.cos(az) - north * np.sin(az)) * np.cos(el)
        up = -np.sin(el) * (east * np.sin(az) + north * np.cos(az))
        return self._torques(seconds, az, across, up)

    def _torques(self, seconds, az, across, up):
        size = 2.0 * self.params.intensity * self.params.shake * self._pressure(az)
        return (size * self._unheld.at(seconds))[:, np.newaxis] * np.stack([across, up], axis=1)

    def bend(self, seconds, boresight, exposure=0.0):
        """Rotation vectors by which wind and gusts bend the structure.

        Parameters
        ----------
        seconds : ndarray, shape (n,)
            Time since the start of the night, middle of the exposures.
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
        # a rotation about boresight x wind turns the boresight down the wind
        return size[:, np.newaxis] * np.cross(boresight, self._towards)
