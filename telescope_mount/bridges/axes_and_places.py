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

"""Between the axes of a mount and what its driver is sent: places of date."""

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import Mount, is_beyond, through_pole
from pointing_model.sky.places import sidereal_time

#: one hour of right ascension, rad
HOUR = 15.0 * DEG


def check_kind(mount):
    """Raise ValueError where a mount cannot be told its axes by right ascension and declination."""
    if mount.kind not in ('equatorial', 'german', 'altaz'):
        raise ValueError(f'right ascension and declination alone cannot command the axes of a '
                         f'{mount.kind} mount; this bridge drives altaz, equatorial, german')


def hour_angle_of(mount, first, second, site):
    """Hour angle and declination at which perfect axes look.

    Parameters
    ----------
    mount : Mount
        Equatorial or alt-azimuth.
    first, second : float or ndarray
        Axis angles, rad; the second may be beyond the pole.
    site : Site

    Returns
    -------
    hour_angle, declination : float or ndarray
        Not through the pole, rad.

    Raises
    ------
    ValueError
        A mount of another kind.
    """
    check_kind(mount)
    if mount.vertical:
        return Mount.equatorial(site.latitude).axes_of(first, second)
    return through_pole(first, second, is_beyond(second))


def place_of_date(mount, axes, time, site):
    """Right ascension and declination of date at which perfect axes look.

    Parameters
    ----------
    mount : Mount
    axes : array_like, shape (2,)
        rad.
    time : float
        UTC, s since 1970.
    site : Site

    Returns
    -------
    ra, dec : float
        rad; `ra` in [0, 2 pi).
    """
    hour_angle, dec = hour_angle_of(mount, *axes, site)
    return float(np.mod(sidereal_time(time, site) - hour_angle, 2.0 * np.pi)), float(dec)


def axes_at(mount, ra, dec, time, site, beyond):
    """The inverse of `place_of_date`: the angles of perfect axes, on the mount's travel.

    Parameters
    ----------
    mount : Mount
    ra, dec : float or ndarray
        Of date, rad.
    time : float or ndarray
        UTC, s since 1970.
    site : Site
    beyond : bool or ndarray of bool
        Whether the mount looks there through the pole.

    Returns
    -------
    first, second : ndarray
        rad; an azimuth is from 0 to 2 pi.
    """
    hour_angle = wrap(sidereal_time(time, site) - ra)
    if mount.vertical:
        return Mount.equatorial(site.latitude).horizon_of(hour_angle, dec)
    return mount.on_travel(*through_pole(hour_angle, dec, beyond))


class AxisFollower:
    """Brings the axes to where they are demanded, through a driver that only takes places.

    A driver with its own model goes to a place of the sky, and its axes end beside the place
    by that model; one without ends on it. Either way what counts is what the axes read: they are
    sent again, by as much farther as they fell short. Between two such steps the driver tracks.

    Parameters
    ----------
    mount : Mount
    site : Site
    tolerance : float
        Axes that are farther from their demand are sent again, rad.

    Attributes
    ----------
    correction : ndarray, shape (2,)
        By how much farther the axes are sent than demanded, rad.
    """

    #: the correction is no larger: what was checked is where the axes are demanded, rad
    LARGEST = 2.0 * DEG

    def __init__(self, mount, site, tolerance=1.0 * ARCSEC):
        self.mount, self.site, self.tolerance = mount, site, tolerance
        self.correction = np.zeros(2)

    def begin(self):
        """A new track: what the driver's model does there is not known."""
        self.correction = np.zeros(2)

    def off(self, demand, reading):
        """By how far the axes lie from their demand, rad, shape (2,)."""
        return wrap(np.asarray(demand, float) - np.asarray(reading, float))

    def arrived(self, demand, reading):
        """Whether they are on it."""
        return bool(np.all(np.abs(self.off(demand, reading)) <= self.tolerance))

    def other_side(self, demand, reading):
        """Whether the axes look through the pole and should not, or the other way round."""
        return bool(is_beyond(demand[1]) != is_beyond(reading[1]))

    def learn(self, demand, reading):
        """Take where the axes came to rest; True where they are to be sent again."""
        if self.arrived(demand, reading) or self.other_side(demand, reading):
            return False
        self.correction = np.clip(self.correction + self.off(demand, reading), -self.LARGEST,
                                  self.LARGEST)
        return True

    def target(self, demand, time):
        """Right ascension and declination of date to send the driver to, rad."""
        return place_of_date(self.mount, np.asarray(demand, float) + self.correction, time,
                             self.site)
