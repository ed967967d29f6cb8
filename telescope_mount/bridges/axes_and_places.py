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

"""Conversion between the axes of a mount and the places of date that its driver takes."""

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import Mount, is_beyond, through_pole
from pointing_model.sky.places import sidereal_time

#: one hour of right ascension, rad
HOUR = 15.0 * DEG


def check_kind(mount):
    """Raise ValueError if right ascension and declination do not determine a mount's axes."""
    if mount.kind not in ('equatorial', 'german', 'altaz'):
        raise ValueError(f'right ascension and declination alone cannot command the axes of a '
                         f'{mount.kind} mount; this bridge drives altaz, equatorial, german')


def hour_angle_of(mount, first, second, site):
    """Hour angle and declination at which perfect axes point.

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
        For a mount not through the pole, rad.

    Raises
    ------
    ValueError
        The mount is of another kind.
    """
    check_kind(mount)
    if mount.vertical:
        return Mount.equatorial(site.latitude).axes_of(first, second)
    return through_pole(first, second, is_beyond(second))


def place_of_date(mount, axes, time, site):
    """Right ascension and declination of date at which perfect axes point.

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
    """The inverse of `place_of_date`: angles of perfect axes, within the mount's travel.

    Parameters
    ----------
    mount : Mount
    ra, dec : float or ndarray
        Of date, rad.
    time : float or ndarray
        UTC, s since 1970.
    site : Site
    beyond : bool or ndarray of bool
        Whether the mount points there through the pole.

    Returns
    -------
    first, second : ndarray
        rad; azimuths are from 0 to 2 pi.
    """
    hour_angle = wrap(sidereal_time(time, site) - ra)
    if mount.vertical:
        return Mount.equatorial(site.latitude).horizon_of(hour_angle, dec)
    return mount.on_travel(*through_pole(hour_angle, dec, beyond))


class AxisFollower:
    """Moves the axes to their demand with a driver that only takes places of the sky.

    A driver with its own pointing model goes to a place of the sky, and its axes end beside the
    place by that model; a driver without one ends on it. In both cases only the axis readings
    count: the axes are sent again, farther by the error. Between these steps the driver tracks.

    Parameters
    ----------
    mount : Mount
    site : Site
    tolerance : float
        Largest error of the axes that is not corrected, rad.

    Attributes
    ----------
    correction : ndarray, shape (2,)
        Correction added to the demand, rad.
    """

    #: largest correction, since only the demand has been checked, rad
    LARGEST = 2.0 * DEG

    def __init__(self, mount, site, tolerance=1.0 * ARCSEC):
        self.mount, self.site, self.tolerance = mount, site, tolerance
        self.correction = np.zeros(2)

    def begin(self):
        """Start a new track, at which the effect of the driver's model is unknown."""
        self.correction = np.zeros(2)

    def off(self, demand, reading):
        """Error of the axes, demand - reading, rad, shape (2,)."""
        return wrap(np.asarray(demand, float) - np.asarray(reading, float))

    def arrived(self, demand, reading):
        """Whether the axes are within the tolerance."""
        return bool(np.all(np.abs(self.off(demand, reading)) <= self.tolerance))

    def other_side(self, demand, reading):
        """Whether the axes point through the pole and should not, or vice versa."""
        return bool(is_beyond(demand[1]) != is_beyond(reading[1]))

    def learn(self, demand, reading):
        """Update the correction from the axes at rest; True if they are to be sent again."""
        if self.arrived(demand, reading) or self.other_side(demand, reading):
            return False
        self.correction = np.clip(self.correction + self.off(demand, reading), -self.LARGEST,
                                  self.LARGEST)
        return True

    def target(self, demand, time):
        """Right ascension and declination of date to be sent to the driver, rad."""
        return place_of_date(self.mount, np.asarray(demand, float) + self.correction, time,
                             self.site)
