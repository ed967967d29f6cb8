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

"""Satellite tracks as rows of a run: places from the orbits, and their derivatives."""

from dataclasses import dataclass, field, replace

import numpy as np

from ..mounts import ALTAZ, is_beyond, through_pole
from ..sky.earth import TURN_RATE
from ..sky.refraction import DEFAULT_WEATHER, refracted_elevation
from ..sky.satellite_motion import satellite_motion
from .run import PointingRun

#: s: a longer gap between rows of a satellite starts another arc
_GAP = 1200.0
#: parameters of site and air, common to all rows
COMMON = 'height', 'latitude', 'longitude', 'refraction'
#: relative decrease of the standard atmosphere's refraction per metre of height
_AIR_OF_A_METRE = 1.18e-4
#: name in rows of stars
STARS = ''


@dataclass
class SatelliteTracks:
    """Rows of satellites and of stars, n of them, in order of time within each arc.

    Attributes
    ----------
    run : PointingRun
        For satellites ``az``, ``el`` are the places from the orbits.
    objects : tuple of str
        Names of the satellites, with `STARS` first if there are stars.
    object : ndarray of int, shape (n,)
        Index in `objects` of each row.
    arc : ndarray of int, shape (n,)
        Number of the arc: one pass of one object, or the stars of one night.
    clock, ahead, across, out : ndarray, shape (2, n)
        See `satellite_motion.SatelliteMotion`; the last three are zero for stars.
    speed, orbit_sigma : ndarray, shape (n,)
        Speed along the orbit, m/s, and standard error of each orbit coordinate, m; zero for stars.
    common : dict of str to ndarray, shape (2, n)
        Derivatives by site and air (`COMMON`), see `satellite_motion.SatelliteMotion`.
    """

    run: PointingRun
    objects: tuple
    object: np.ndarray
    arc: np.ndarray
    clock: np.ndarray
    ahead: np.ndarray
    across: np.ndarray
    out: np.ndarray
    speed: np.ndarray
    orbit_sigma: np.ndarray
    common: dict = field(default_factory=dict)

    def __len__(self):
        return len(self.run)

    @property
    def satellites(self):
        """Names, without the stars."""
        return tuple(name for name in self.objects if name != STARS)

    @property
    def is_star(self):
        """Rows of stars, ndarray of bool, shape (n,)."""
        return np.array([name == STARS for name in self.objects])[self.object]

    def along(self, x, y):
        """Residuals on the sky along and across the track, radians; NaN for stars.

        Parameters
        ----------
        x, y : ndarray, shape (n,)
        """
        length = np.hypot(*self.ahead)
        a, b = np.where(length > 0.0, self.ahead / np.where(length > 0.0, length, 1.0), np.nan)
        return x * a + y * b, y * a - x * b

    def select(self, rows):
        """The tracks with only some rows (a mask or indices); names keep their numbers."""
        of_rows = 'object', 'arc', 'clock', 'ahead', 'across', 'out', 'speed', 'orbit_sigma'
        return replace(self, run=self.run.select(rows),
                       **{name: getattr(self, name)[..., rows] for name in of_rows},
                       common={name: of[:, rows] for name, of in self.common.items()})


def star_rates(az, el, latitude, mount=ALTAZ):
    """Rates of stars on the sky along the axes of a mount, rad/s, shape (2, n).

    Parameters
    ----------
    az, el : ndarray, shape (n,)
        Places as axis angles of the mount, radians.
    latitude : float
        Radians.
    mount : Mount
    """
    pole = TURN_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    return _turned_about(-pole, az, el, mount)


def _turned_about(axis, az, el, mount):
    """Motion on the sky of directions rotated about an axis (east, north, up), shape (2, n)."""
    motion = np.cross(axis, mount.direction(az, el).T).T
    return np.stack([np.sum(one * motion, axis=0) for one in mount.tangents(az, el)])


def _common_of_stars(az, el, latitude, mount):
    """Derivatives of star places by site and air, see `satellite_motion.SatelliteMotion`."""
    up = mount.horizon_of(az, el)[1]
    raised = (refracted_elevation(up, DEFAULT_WEATHER) - up) / np.cos(up)
    zenith = np.stack([one[2] for one in mount.tangents(az, el)])
    return {'latitude': _turned_about(np.array([1.0, 0.0, 0.0]), az, el, mount),
            'longitude': star_rates(az, el, latitude, mount) / TURN_RATE,
            'refraction': zenith * raised}


def satellite_tracks(columns, names, orbits, site, weather, mount=ALTAZ, meta=None):
    """Satellite tracks from measured rows.

    Parameters
    ----------
    columns : dict of str to ndarray, shape (n,)
        ``time``, ``az_enc``, ``el_enc`` (with the object centred), radians; for stars also ``az``
        and ``el``. Other columns are kept.
    names : sequence of str, length n
        Object of each row; `STARS` for stars.
    orbits : dict of str to orbit
        Orbit of each satellite by name.
    site : pointing_model.sky.site.Site
    weather : Weather or callable
        A callable returns the weather of some rows (indices).
    mount : Mount
    meta : dict, optional
        Of the run.

    Returns
    -------
    SatelliteTracks

    Raises
    ------
    ValueError
        An orbit does not cover a time.
    """
    time, label = np.asarray(columns['time'], float), np.asarray(names, dtype=object)
    order = np.lexsort((time, label.astype(str)))
    time, label = time[order], label[order]
    columns = {name: np.asarray(value)[order] for name, value in columns.items()}
    objects = tuple(sorted(set(label.tolist())))
    number = np.array([objects.index(name) for name in label])
    new = (np.diff(number, prepend=-1) != 0) | (np.diff(time, prepend=-np.inf) > np.where(
        label == STARS, 6.0 * 3600.0, _GAP))
    n = len(time)
    az, el = (np.array(columns.get(axis, np.full(n, np.nan)), float) for axis in ('az', 'el'))
    moves = {name: np.zeros((2, n)) for name in ('clock', 'ahead', 'across', 'out')}
    common = {name: np.zeros((2, n)) for name in COMMON}
    speed, sigma = np.zeros(n), np.zeros(n)
    for i, name in enumerate(objects):
        rows = np.flatnonzero(number == i)
        if name == STARS:
            moves['clock'][:, rows] = star_rates(az[rows], el[rows], site.latitude, mount)
            for what, of in _common_of_stars(az[rows], el[rows], site.latitude, mount).items():
                common[what][:, rows] = of
            continue
        air = weather(order[rows]) if callable(weather) else weather
        motion = satellite_motion(orbits[name], time[rows], site, air, mount)
        beyond = mount.two_sided & is_beyond(columns['el_enc'][rows])
        az[rows], el[rows] = mount.on_travel(*through_pole(motion.az, motion.el, beyond))
        turn = np.where(beyond, -1.0, 1.0)  # through the pole both axes are reversed on the sky
        for what, of in moves.items():
            of[:, rows] = turn * getattr(motion, what)
        for what, of in common.items():
            of[:, rows] = turn * motion.common[what]
        speed[rows], sigma[rows] = motion.speed, orbits[name].sigma(time[rows])
    common['height and air'] = common['height'] - _AIR_OF_A_METRE * common['refraction']
    rates = moves['clock'] / np.stack((np.cos(el), np.ones(n)))
    run = PointingRun({**columns, 'az': az, 'el': el, 'star': label.astype(str),
                       'az_rate': rates[0], 'el_rate': rates[1]},
                      {**(meta or {}), 'site': site, **({} if mount.vertical else {
                          'mount': mount})})
    return SatelliteTracks(run, objects, number, np.cumsum(new) - 1, **moves, speed=speed,
                           orbit_sigma=sigma, common=common)
