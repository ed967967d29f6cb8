"""What a camera on the tube would see of the catalogue, where it is known where the tube looks."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import is_beyond
from pointing_model.sky import observed_place
from pointing_model.star_catalogue import load_catalogue

from .pointing import axes_at

#: stars that are looked at closer, rad, and when they are chosen anew
AROUND, MOVED = 4.0 * DEG, 1.0 * DEG


class StarField:
    """Miss distance of the brightest star of the field.

    Parameters
    ----------
    mount : Mount
    site : Site
    weather : Weather
    field : float
        Radius, rad.
    magnitude : float
        Faintest star.
    noise : float
        Of each axis, rad.
    seed : int
    """

    def __init__(self, mount, site, weather, field, magnitude=8.0, noise=0.3 * ARCSEC, seed=1):
        self.mount, self.site, self.weather = mount, site, weather
        self._field, self._noise, self._seed = field, noise, seed
        self._all = load_catalogue(mag_limit=magnitude)
        self._near, self._about = None, None

    def miss(self, stamp, place, second):
        """Star minus boresight in the frame of the tube, rad, shape (2,); NaN without a star.

        Parameters
        ----------
        stamp : int
            ns since 1970.
        place : array_like, shape (2,)
            Right ascension and declination of date at which the tube looks, rad.
        second : float
            Angle of the second axis, which says whether that is through the pole, rad.
        """
        time = stamp * 1e-9
        axes = axes_at(self.mount, *place, time, self.site, bool(is_beyond(second)))
        forward = self.mount.direction(*map(np.asarray, axes))
        stars = self._around(time, forward)
        directions = _directions(*observed_place(stars, time, self.site, self.weather))
        inside = np.flatnonzero(forward @ directions > np.cos(self._field))
        if not len(inside):
            return np.full(2, np.nan)
        star = directions[:, inside[np.argmin(stars.mag[inside])]]
        # about the boresight, to the right and the top of the tube, whatever its side
        right, top = self.mount.tangents(*map(np.asarray, axes))
        rng = np.random.default_rng([self._seed, stamp])
        return (np.array([star @ right, star @ top]) / (star @ forward)
                + self._noise * rng.normal(size=2))

    def _around(self, time, forward):
        if self._about is None or forward @ self._about < np.cos(MOVED):
            places = _directions(*observed_place(self._all, time, self.site, self.weather))
            self._near = self._all.select(np.flatnonzero(forward @ places > np.cos(AROUND)))
            self._about = forward
        return self._near


def _directions(az, el):
    """East, north, up; shape (3, n)."""
    return np.array([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)])
