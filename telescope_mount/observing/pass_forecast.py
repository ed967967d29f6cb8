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

"""Forecast of a pass: height, speed, sunlight, and time lost in keyholes."""

from typing import NamedTuple

import numpy as np

from pointing_model.mounts import ALTAZ
from pointing_model.sky.places import sun_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.satellite_passes import passes
from pointing_model.sky.satellite_place import in_sunlight, satellite_place
from pointing_model.sky.site import DEFAULT_SITE

from .keyhole import STEP, keyholes

#: coarse time step for a pass, s, and fraction of an axis' rate above which it is examined in steps
#: of `STEP`
_COARSE, _FAST = 5.0, 0.3


class PassForecast(NamedTuple):
    """A pass over a site, for one mount.

    Attributes
    ----------
    name : str
        Name of the satellite.
    start, end, top : float
        UTC, seconds since 1970-01-01.
    top_az, top_el : float
        rad.
    sunlit : float
        Sunlit fraction of the pass, 0 to 1.
    sun_el : float
        Elevation of the Sun at culmination, rad.
    sun_distance : float
        Smallest distance from the Sun, rad.
    phase : float
        Angle at the satellite between Sun and observer at culmination, rad: 0 is full.
    fastest : float
        Largest rate on the sky, rad/s.
    keyholes : list of Keyhole
    orbit_sigma : float
        Sigma of a coordinate of the orbit at culmination, m.
    """

    name: str
    start: float
    end: float
    top: float
    top_az: float
    top_el: float
    sunlit: float
    sun_el: float
    sun_distance: float
    phase: float
    fastest: float
    keyholes: list
    orbit_sigma: float

    @property
    def lost(self):
        """Seconds lost in keyholes."""
        return sum(one.lost for one in self.keyholes)

    def document(self):
        """JSON-ready."""
        from msg_tools.units import ARCSEC, DEG
        return {
            'satellite': self.name, 'start': self.start, 'end': self.end, 'top': self.top,
            'top_az_deg': self.top_az / DEG, 'top_el_deg': self.top_el / DEG,
            'sunlit': self.sunlit, 'sun_el_deg': self.sun_el / DEG,
            'sun_distance_deg': self.sun_distance / DEG, 'phase_deg': self.phase / DEG,
            'fastest_arcsec_s': self.fastest / ARCSEC, 'lost_s': self.lost,
            'orbit_sigma_m': self.orbit_sigma, 'keyholes': [
                {'axis': one.axis, 'begin': one.begin, 'end': one.end, 'lost_s': one.lost,
                 'wanted_deg_s': one.wanted / DEG} for one in self.keyholes]}


def pass_track(orbit, one, site, weather=DEFAULT_WEATHER, mount=ALTAZ, step=STEP, margin=60.0):
    """Times and axis angles through a pass.

    Parameters
    ----------
    orbit
        See `passes`.
    one : satellite_passes.Pass
    site : Site
    weather : Weather
    mount : Mount
    step, margin : float
        s between the times, and s before and after the pass.

    Returns
    -------
    time : ndarray, shape (n,)
    angles : ndarray, shape (n, 2)
        Without jumps by a turn, rad.
    """
    begin, end = max(one.start - margin, orbit.begin + 1.0), min(one.end + margin, orbit.end)
    time = np.arange(begin, end, step)
    first, second = mount.axes_of(*satellite_place(orbit, time, site, weather)[:2])
    first, second = mount.on_travel(first, second)
    return time, np.stack((np.unwrap(first), np.unwrap(second)), axis=1)


def pass_forecasts(orbit, start, hours, site=DEFAULT_SITE, *, mount=ALTAZ, axes=None, low=0.35,
                   dark=True):
    """The passes of a satellite.

    Parameters
    ----------
    orbit
        See `passes`.
    start, hours, site
        See `passes`.
    mount : Mount
    axes : sequence of guard.limits.Axis, optional
        Rates and accelerations; without them keyholes are not searched.
    low : float
        Least elevation, rad.
    dark : bool
        Only while visible: sunlit, with the Sun 12 degrees below the horizon.

    Returns
    -------
    list of PassForecast
        In order of time.
    """
    out = []
    for one in passes(orbit, start, hours, site, low, dark=dark, step=30.0):
        if not one.end > one.start:
            continue  # it ends where the search begins
        time, angles = pass_track(orbit, one, site, mount=mount, step=_COARSE)
        inside = np.linspace(one.start, one.end, max(
            3, int(np.ceil((one.end - one.start) / _COARSE)) + 1))
        az, el, distance = satellite_place(orbit, inside, site)
        sun_az, sun_el = sun_place(inside, site)
        apart = _angle(az, el, sun_az, sun_el)
        top = int(np.argmax(el))
        found = _keyholes(orbit, one, site, mount, axes, time, angles) if axes else []
        sky = np.hypot(np.gradient(np.unwrap(az), inside) * np.cos(el), np.gradient(el, inside))
        # the Sun is so far away that its direction is the same from satellite and observer
        out.append(PassForecast(
            orbit.name, one.start, one.end, one.top, float(az[top]), float(one.top_el),
            float(np.mean(in_sunlight(orbit, inside))), float(sun_el[top]),
            float(apart.min()), float(np.pi - apart[top]), float(sky.max()),
            [hole for hole in found if hole.end > one.start and hole.begin < one.end],
            float(orbit.sigma(one.top))))
    return out


def _keyholes(orbit, one, site, mount, axes, time, angles):
    rates = np.abs(np.gradient(angles, time, axis=0)).max(axis=0)
    if all(rate < _FAST * axis.rate for rate, axis in zip(rates, axes)):
        return []
    return keyholes(*pass_track(orbit, one, site, mount=mount), axes)


def _angle(az, el, az2, el2):
    cosine = np.sin(el) * np.sin(el2) + np.cos(el) * np.cos(el2) * np.cos(az - az2)
    return np.arccos(np.clip(cosine, -1.0, 1.0))
