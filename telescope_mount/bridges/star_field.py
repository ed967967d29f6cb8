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

"""Catalogue stars seen by a camera on the tube, and the base class of exposure sources."""

from collections import deque

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import ALTAZ, is_beyond
from pointing_model.sky.places import icrs_to_observed, observed_place
from pointing_model.sky.star_catalogue import load_catalogue

from .axes_and_places import axes_at
from .connection import Reconnection

#: radius within which stars are preselected, and motion after which this is repeated, rad
AROUND, MOVED = 4.0 * DEG, 1.0 * DEG


class StarField:
    """Miss distance of the brightest star of the field, or of a satellite in it.

    Parameters
    ----------
    mount : Mount
    site : Site
    weather : Weather
    field : float
        Radius of the field, rad.
    magnitude : float
        Magnitude of the faintest star.
    noise : float
        1-sigma noise of each axis, rad.
    seed : int
    satellite : star_catalogue.SatelliteTarget, optional
        An additional object, preferred to stars.
    """

    def __init__(self, mount, site, weather, field, magnitude=8.0, noise=0.3 * ARCSEC, seed=1,
                 satellite=None):
        self.mount, self.site, self.weather = mount, site, weather
        self._field, self._noise, self._seed, self._satellite = field, noise, seed, satellite
        self._all = load_catalogue(mag_limit=magnitude)
        self._near, self._about = None, None

    def miss(self, stamp, place, second):
        """Star - boresight in the frame of the tube, rad, shape (2,); NaN without a star.

        Parameters
        ----------
        stamp : int
            ns since 1970.
        place : array_like, shape (2,)
            Right ascension and declination of date at which the tube points, rad.
        second : float
            Angle of the second axis, which shows whether it points through the pole, rad.
        """
        axes = axes_at(self.mount, *place, stamp * 1e-9, self.site, bool(is_beyond(second)))
        return self.miss_of(stamp * 1e-9, axes,
                            self._noise * np.random.default_rng([self._seed, stamp]).normal(size=2))

    def looks_at(self, time, ra, dec, beyond):
        """Axes of a perfect mount that points at an ICRS place with refraction, rad, shape (2,).

        Parameters
        ----------
        time : float
            UTC, s since 1970.
        ra, dec : float
            rad.
        beyond : bool
            Whether it points there through the pole.
        """
        az, el = icrs_to_observed(np.array([ra]), np.array([dec]), time, self.site, self.weather)
        return np.array(self.mount.on_travel(*self.mount.axes_of(az[0], el[0], beyond)))

    def miss_of(self, time, axes, noise=0.0):
        """Like `miss`, for given perfect axes `axes` (rad) at a time (s since 1970)."""
        forward = self.mount.direction(*map(np.asarray, axes))
        star = self._light(time, forward)
        if star is None:
            return np.full(2, np.nan)
        # relative to the boresight, to the right and top of the tube on both sides of the pier
        right, top = self.mount.tangents(*map(np.asarray, axes))
        return np.array([star @ right, star @ top]) / (star @ forward) + noise

    def _light(self, time, forward):
        """Direction of the measured object, shape (3,); None if the field is empty."""
        if self._satellite is not None:
            place = self._satellite.place(np.array([time]), self.site, self.weather)
            direction = ALTAZ.direction(*place)[:, 0]
            if forward @ direction > np.cos(self._field):
                return direction
        stars = self._around(time, forward)
        directions = ALTAZ.direction(*observed_place(stars, time, self.site, self.weather))
        inside = np.flatnonzero(forward @ directions > np.cos(self._field))
        return directions[:, inside[np.argmin(stars.mag[inside])]] if len(inside) else None

    def _around(self, time, forward):
        if self._about is None or forward @ self._about < np.cos(MOVED):
            places = ALTAZ.direction(*observed_place(self._all, time, self.site, self.weather))
            self._near = self._all.select(np.flatnonzero(forward @ places > np.cos(AROUND)))
            self._about = forward
        return self._near


class SkySource:
    """Finds its devices in its own thread, by `work`, which also exposes with a camera.

    A protocol implements `work`; it raises BridgeError on failure.

    Parameters
    ----------
    field : StarField
    where : str
        Host and port, for people.

    Attributes
    ----------
    on : bool
        Whether exposures are wanted; otherwise a camera is not used.
    exposures : deque of (int, ndarray)
        Stamp (ns) and miss distance (rad; NaN: no star) of each exposure.
    why : str
        What is missing; '' if nothing.
    note : str
        Warning, although there are exposures.
    """

    def __init__(self, field, where):
        self.field, self.where, self.exposures, self.on = field, where, deque(maxlen=100), True
        self.why, self.note = f'connecting to {where}', ''
        self._reconnection = Reconnection(self.work, self._failed)

    def start(self):
        """Begin; returns at once."""
        self._reconnection.start()

    def close(self):
        """End it."""
        self._reconnection.close()

    def switch(self, on):
        """Start or stop exposures."""
        self.on = on
        self.exposures.clear()
        self._reconnection.wake()

    def _failed(self, why):
        self.why = why
