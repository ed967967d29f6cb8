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

"""The star camera: position of the brightest star of the field on the chip."""

from collections import Counter
from dataclasses import astuple, dataclass, replace
from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG
from pointing_model.sky.earth import TURN_RATE
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER, Weather, refraction_constants
from pointing_model.sky.site import DEFAULT_SITE, Site
from pointing_model.sky.star_catalogue import load_catalogue

from . import keyed_noise
from .field_kinds import number
from .mount_geometry import FORWARD, RIGHT, UP, direction
from .seeing import TurbulentRefraction, seeing_sigma

#: error of a coarse place, without refraction, precession and aberration since the first exposure
_MARGIN = 0.5 * DEG
_CHUNK = 64


@dataclass(frozen=True)
class CameraErrors:
    """The star camera.

    Attributes
    ----------
    field_of_view : float
        Full width of the square field, rad.
    mag_limit : float
        Magnitude of the faintest visible star.
    star_noise : float
        1-sigma of one measured star, per axis, rad.
    scale_error : float
        Relative error of the plate scale; positive: distances come out too large.
    rotation : float
        Rotation of the measured miss distances, from +x towards +y, rad.
    rotator_x, rotator_y : float
        For a camera on a field rotator: position of its centre at rotator angle 0, relative to the
        rotator's axis, to the right and up, rad; miss distances are from the centre.
    trail : float
        Charge left behind by the read-out displaces the image of a star of magnitude 4 towards
        +x by this, rad; less for a bright one (proportional to its flux to the power -0.1).
    """

    field_of_view: float = number(40.0, 'arcmin', 0.1, 600.0)
    mag_limit: float = number(7.0, '', -2.0, 13.0)
    star_noise: float = number(0.0, 'arcsec', 0.0, 600.0)
    scale_error: float = number(0.0, 'percent', -50.0, 50.0)
    rotation: float = number(0.0, 'deg', -180.0, 180.0)
    trail: float = number(0.0, 'arcsec', -600.0, 600.0)
    rotator_x: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    rotator_y: float = number(0.0, 'arcsec', -3600.0, 3600.0)


class ExposureTimes(NamedTuple):
    """Measurements of n exposures.

    Attributes
    ----------
    miss : ndarray, shape (n, 2)
        Star - boresight to the right and up in the tube's frame (for a perfect mount that is not
        through its pole: towards increasing angles), rad in the tangent plane; NaN without a star.
    hip : ndarray of int, shape (n,)
        HIP number of the star, 0: none. For tests: a real camera does not know it.
    mag : ndarray, shape (n,)
        Magnitude, NaN without a star.
    """

    miss: np.ndarray
    hip: np.ndarray
    mag: np.ndarray


class Camera:
    """The camera in the tube.

    Parameters
    ----------
    scenario : scenario.Scenario
    seed : int
    site : site.Site
        Site of the mount if the scenario has none.
    weather : refraction.Weather
        Weather if the scenario has none.
    start : float
        Start of the night, UTC s, the origin of temperature changes.
    satellite : star_catalogue.SatelliteTarget, optional
        An additional visible object.
    exposure : float
        Length of an exposure, s, which affects the noise.

    Attributes
    ----------
    exposed : collections.Counter
        How often each star (its HIP number; 0: the satellite) was measured. The noise is drawn for
        the star and that number, not for the time, so it does not change if slews take longer.
    """

    def __init__(self, scenario, seed, site=DEFAULT_SITE, weather=DEFAULT_WEATHER, start=0.0,
                 satellite=None, exposure=1.0):
        self.params, self.clock_offset = scenario.camera, scenario.clock_offset
        self.seed, self.start, self.satellite = seed, start, satellite
        self.site, self.weather, self._true_air = site, weather, scenario.weather
        self._seeing, self._exposure = scenario.seeing, exposure
        if scenario.site is not None:
            self.site = Site(*astuple(scenario.site))
        if scenario.weather is not None:
            air = scenario.weather
            self.weather = Weather(
                air.pressure, air.temperature, air.humidity, air.wavelength * 1e6)
        self._layers = TurbulentRefraction(
            scenario.layers, refraction_constants(self.weather)[0], seed)
        self._stars = load_catalogue(self.params.mag_limit)
        self._coarse = None  # (time, unit vectors of all stars then)
        self.exposed = Counter()

    def expose(self, stamps, frames, rotator=0.0):
        """Measure the brightest star of the field.

        Parameters
        ----------
        stamps : int or ndarray of int, shape (n,)
            Middle of the exposures, ns.
        frames : ndarray, shape (n, 3, 3)
            Frames of the tube, from `geometry.MountGeometry.frames`.
        rotator : float or ndarray, shape (n,)
            Angle of a field rotator, from right to up, rad; the miss distances are rotated back.

        Returns
        -------
        ExposureTimes
        """
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        frames = np.asarray(frames, dtype=float).reshape(-1, 3, 3)
        n = len(stamps)
        miss, hip, mag = np.full((n, 2), np.nan), np.zeros(n, dtype=np.int64), np.full(n, np.nan)
        if n == 0:
            return ExposureTimes(miss, hip, mag)
        time = stamps * 1e-9 + self.clock_offset
        exposure, star = self._candidates(time, frames[:, FORWARD])
        if len(exposure):
            exposure, star, place, height = self._in_field(time, frames, exposure, star)
            # brightest first, then the first candidate of each exposure
            order = np.lexsort((self._stars.mag[star], exposure))
            rows, first = np.unique(exposure[order], return_index=True)
            chosen = order[first]
            hip[rows], mag[rows] = self._stars.hip[star[chosen]], self._stars.mag[star[chosen]]
            miss[rows] = self._measure(
                hip[rows], place[chosen], height[chosen], mag[rows])
        return ExposureTimes(miss - self._middle(rotator), hip, mag)

    def _middle(self, rotator):
        """Position of the centre of the camera, (n, 2) or (2,), rad."""
        c, s = np.cos(rotator), np.sin(rotator)
        x, y = self.params.rotator_x, self.params.rotator_y
        return np.stack([c * x - s * y, s * x + c * y], axis=-1)

    def expose_satellite(self, stamps, frames):
        """Measure the satellite.

        Parameters
        ----------
        stamps, frames
            See `expose`.

        Returns
        -------
        ndarray, shape (n, 2)
            As `ExposureTimes.miss`; NaN if it is not in the field.
        """
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        miss = np.full((len(stamps), 2), np.nan)
        if self.satellite is None or len(stamps) == 0:
            return miss
        time = stamps * 1e-9 + self.clock_offset
        place = self.satellite.place(time, self.site, self._air(time))
        inside, tangent = self._on_chip(self._refracted(time, place), frames)
        miss[inside] = self._measure(
            np.zeros(inside.sum(), int), tangent[inside], place[1][inside])
        return miss

    def _candidates(self, time, boresight):
        """Pairs (exposure, star) that are close enough to need an exact place."""
        pole = np.array([0.0, np.cos(self.site.latitude), np.sin(self.site.latitude)])
        if self._coarse is None:
            no_air = replace(self.weather, pressure_hpa=0.0)
            self._coarse = time[0], direction(
                *observed_place(self._stars, time[0], self.site, no_air))
        when, stars = self._coarse
        # rotate the boresight back with the sky, about the pole
        angle = (TURN_RATE * (time - when))[:, np.newaxis]
        back = (
            np.cos(angle) * boresight
            + np.sin(angle) * np.cross(pole, boresight)
            + (1.0 - np.cos(angle)) * (boresight @ pole)[:, np.newaxis] * pole
        )
        reach = self.params.field_of_view / np.sqrt(2.0) + _MARGIN
        parts = []
        for i in range(0, len(time), _CHUNK):
            rows, star = np.nonzero(back[i : i + _CHUNK] @ stars.T > np.cos(reach))
            parts.append((rows + i, star))
        return tuple(np.concatenate(one) for one in zip(*parts))

    def _in_field(self, time, frames, exposure, star):
        """Candidates within the field, their positions in the tangent plane, elevation, rad."""
        moments = time[exposure]
        place = observed_place(
            self._stars.select(star), moments, self.site, self._air(moments))
        inside, tangent = self._on_chip(self._refracted(moments, place), frames[exposure])
        return exposure[inside], star[inside], tangent[inside], place[1][inside]

    def _refracted(self, moments, place):
        """Directions (n, 3) as seen through tilted layers of air."""
        return self._layers.bent(moments - self.start, direction(*place))

    def _air(self, moments):
        if self._true_air is None:
            return self.weather
        return replace(
            self.weather, temperature_c=self._true_air.temperature_at(moments, self.start))

    def _on_chip(self, towards, frames):
        """Whether directions (n, 3) fall on the chip, and their tangent plane coordinates, rad."""
        rows = np.einsum('nij,nj->ni', frames, towards)
        ahead = np.maximum(rows[:, FORWARD], 1e-9)
        tangent = np.stack([rows[:, RIGHT] / ahead, rows[:, UP] / ahead], axis=1)
        inside = np.all(np.abs(tangent) <= 0.5 * self.params.field_of_view, axis=1)
        inside &= (towards[:, 2] > 0.0) & (rows[:, FORWARD] > 0.0)
        return inside, tangent

    def _measure(self, star, place, elevation, mag=4.0):
        """Positions with the camera's scale, rotation, trail and noise."""
        p = self.params
        c, s = np.cos(p.rotation), np.sin(p.rotation)
        turned = place @ np.array([[c, s], [-s, c]])
        if p.trail:
            turned[:, 0] += p.trail * 10.0 ** (0.04 * (mag - 4.0))
        noise, sigma = 0.0, p.star_noise
        if self._seeing.fwhm > 0.0:
            sigma = np.hypot(sigma, seeing_sigma(
                self._seeing, elevation, mag, self._exposure,
                1e-6 * self.weather.wavelength_um))[:, np.newaxis]
        if np.any(sigma):
            noise = sigma * keyed_noise.normal(
                self.seed, 'camera', f'star, night of {self.start:.0f}', self._numbers(star), 2)
        return (1.0 + p.scale_error) * turned + noise

    def _numbers(self, stars):
        """Noise keys of exposures of `stars` (n,), int: star and number of its exposure."""
        out = []
        for star in stars.tolist():
            self.exposed[star] += 1
            out.append((star << 32) + self.exposed[star])
        return np.array(out, dtype=np.int64)
