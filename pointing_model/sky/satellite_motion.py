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

"""Derivatives of a satellite's observed place with respect to time and orbit errors."""

from dataclasses import replace
from typing import NamedTuple

import erfa
import numpy as np

from msg_tools.units import wrap
from pointing_model.mounts import ALTAZ

from .earth import TURN_RATE
from .elements import turned
from .refraction import DEFAULT_WEATHER
from .satellite_place import horizon_axes, satellite_place
from .site import DEFAULT_SITE

#: s, to either side: the third derivative of a low satellite's place causes 0.01" in it
_STEP = 0.25
#: steps of site coordinates, m and rad: differences well above rounding
_SITE_STEPS = {'height': 100.0, 'latitude': 1e-5, 'longitude': 1e-5}


class SatelliteMotion(NamedTuple):
    """Observed places in the axes of a mount, and their derivatives; n times.

    Attributes
    ----------
    az, el : ndarray, shape (n,)
        Observed place, rad: angles of the first and the second axis.
    distance : ndarray, shape (n,)
        m.
    speed : ndarray, shape (n,)
        Speed along the orbit in inertial space, m/s.
    clock : ndarray, shape (2, n)
        On the sky, rad per second of later time stamps: x and y.
    ahead : ndarray, shape (2, n)
        The same per second that the satellite is ahead on its orbit.
    across, out : ndarray, shape (2, n)
        The same per metre to the left of the orbital plane, and away from the Earth.
    common : dict of str to ndarray, shape (2, n)
        The same for errors common to all satellites: ``height`` (per metre of a higher site),
        ``latitude``, ``longitude`` (per radian), ``refraction`` (standard refraction added once).
    """

    az: np.ndarray
    el: np.ndarray
    distance: np.ndarray
    speed: np.ndarray
    clock: np.ndarray
    ahead: np.ndarray
    across: np.ndarray
    out: np.ndarray
    common: dict


def satellite_motion(orbit, time, site=DEFAULT_SITE, weather=DEFAULT_WEATHER, mount=ALTAZ):
    """Observed places of a satellite and their derivatives.

    Parameters
    ----------
    orbit : elements.Satellite, or orbits.ephemeris.Orbit
    time : ndarray, shape (n,)
        UTC, seconds since 1970-01-01.
    site : Site
    weather : Weather
    mount : Mount

    Returns
    -------
    SatelliteMotion

    Raises
    ------
    ValueError
        The orbit does not cover a time.
    """
    time = np.atleast_1d(np.asarray(time, float))
    az, el, distance = satellite_place(orbit, time, site, weather)
    here = mount.axes_of(az, el)

    def moved(other):
        """Offset on the sky from the place to another one on the horizon."""
        first, second = mount.axes_of(*other)
        return np.stack((wrap(first - here[0]) * np.cos(here[1]), wrap(second - here[1])))

    def rate(by):
        late, early = (satellite_place(orbit, time, site, weather, **{by: sign * _STEP})
                       for sign in (1.0, -1.0))
        return (moved(late[:2]) - moved(early[:2])) / (2.0 * _STEP)

    late = distance / erfa.CMPS
    place = orbit.itrf(time, -late)
    velocity = (turned(orbit.itrf(time, _STEP - late), -TURN_RATE * _STEP)
                - turned(orbit.itrf(time, -_STEP - late), TURN_RATE * _STEP)) / (2.0 * _STEP)
    pole = np.cross(place, velocity)
    east_up = ALTAZ.tangents(az, el)

    def by_metre(direction):
        enu = horizon_axes(site) @ (direction / np.linalg.norm(direction, axis=1)[:, None]).T
        x, y = (np.sum(one * enu, axis=0) / distance for one in east_up)
        metre = 100.0  # a difference well above rounding
        return moved((az + metre * x / np.cos(el), el + metre * y)) / metre

    def of_site(name, step):
        value = getattr(site, name)
        step = -np.copysign(step, value)  # toward zero, so it stays a valid site
        there = replace(site, **{name: value + step})
        return moved(satellite_place(orbit, time, there, weather)[:2]) / step

    none, usual = (moved(satellite_place(orbit, time, site, air)[:2])
                   for air in (replace(DEFAULT_WEATHER, pressure_hpa=0.0), DEFAULT_WEATHER))
    common = {name: of_site(name, step) for name, step in _SITE_STEPS.items()}
    return SatelliteMotion(
        *here, distance, np.linalg.norm(velocity, axis=1), rate('rest'),
        rate('time_bias'), by_metre(pole), by_metre(place),
        common | {'refraction': usual - none})
