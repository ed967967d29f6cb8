"""Where the Sun is, well enough to keep away from it."""

import erfa
import numpy as np

from .earth import TURN_RATE, terrestrial
from .places import DEFAULT_SITE, Weather, icrs_to_observed

#: the place is computed anew after so long, s; in between the sky turns
_FRESH = 600.0
_NO_AIR = Weather(pressure_hpa=0.0)


def sun_place(time, site=DEFAULT_SITE):
    """Azimuth and elevation of the Sun's centre, without refraction.

    Parameters
    ----------
    time : float
        UTC, seconds since 1970-01-01.
    site : Site

    Returns
    -------
    az, el : float
        rad. Good to 30": the Earth's place is ERFA's, the parallax is left out.
    """
    earth = erfa.ufunc.epv00(*terrestrial(time))[0]['p']
    ra, dec = erfa.c2s(-earth)
    az, el = icrs_to_observed(ra, dec, time, site, _NO_AIR)
    return float(az), float(el)


class Sun:
    """The Sun over a site.

    Parameters
    ----------
    site : Site
    """

    def __init__(self, site=DEFAULT_SITE):
        self._site, self._time, self._place = site, None, None
        self.latitude = site.latitude
        self._pole = np.array([0.0, np.cos(site.latitude), np.sin(site.latitude)])

    def at(self, time):
        """Its direction (east, north, up) at `time` (UTC, s)."""
        if self._time is None or abs(time - self._time) > _FRESH:
            az, el = sun_place(time, self._site)
            self._place = np.array([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)])
            self._time = time
        return turned(self._place, self._pole, time - self._time)


def turned(place, pole, seconds):
    """A direction on the sky after it has turned with it for a time.

    Parameters
    ----------
    place, pole : ndarray, shape (3,)
        Of the direction, and of the celestial north pole.
    seconds : float or ndarray, shape (n,)

    Returns
    -------
    ndarray, shape (3,) or (3, n)
    """
    angle = -TURN_RATE * np.asarray(seconds, float)  # westward
    along = pole @ place * pole
    across = place - along
    (a, b, c), (x, y, z) = pole.tolist(), place.tolist()
    side = np.array([b * z - c * y, c * x - a * z, a * y - b * x])  # np.cross, in a tenth of time
    if angle.ndim == 0:
        return along + np.cos(angle) * across + np.sin(angle) * side
    return along[:, None] + across[:, None] * np.cos(angle) + side[:, None] * np.sin(angle)
