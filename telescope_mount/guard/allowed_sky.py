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

"""Where a guard lets the tube point: published in its status, and used to choose stars."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import ALTAZ
from pointing_model.sky.skyline import Horizon, parse_horizon

from ..guard.limits import parse_pair
from ..guard.sky_limits import SKY_LIMITS, SkyCircles

#: margin of a star to the horizon and the ends of travel, and to limits in the sky, which move
#: during the slew, rad: readings differ from places of the sky by zero, model and refraction, and
#: the guard checks tracks in boxes
NEAR, NEAR_LIMIT = 1.5 * DEG, 2.0 * DEG
#: rows of `guard/status`
LEAST, HORIZON = 'least_elevation_deg', 'horizon'
TRAVEL = 'first_travel_deg', 'second_travel_deg'
#: largest rates and accelerations of a track, for both axes
RATES, ACCELERATIONS = 'track_rates_deg_s', 'track_accelerations_deg_s2'
#: the site, needed to compute limits in the sky
PLACE = 'latitude_deg', 'longitude_deg'
#: sites that differ by less are equal, deg
SAME_SITE = 0.01
_TURN = 2.0 * np.pi


def rows_of(limits):
    """The guard's limits for the choice of stars: rows of `guard/status`.

    Parameters
    ----------
    limits : guard.limits.Limits

    Returns
    -------
    dict of str to str
        Degrees; the corners of the skyline as in its parameter.
    """
    corners = ', '.join(f'{az / DEG:.10g} {el / DEG:.10g}' for az, el in limits.horizon.points)
    travel = {name: f'{axis.low / DEG:.10g},{axis.high / DEG:.10g}'
              for name, axis in zip(TRAVEL, limits.axes)}
    least = limits.timing or 1.0
    motion = {name: ','.join(f'{least * getattr(axis, what) / DEG:.10g}' for axis in limits.axes)
              for name, what in ((RATES, 'rate'), (ACCELERATIONS, 'acceleration'))}
    return {LEAST: f'{limits.horizon.least / DEG:.10g}', HORIZON: corners,
            **{limit.parameter: '0' for limit in SKY_LIMITS},
            **{limit.parameter: f'{distance / DEG:.10g}' for limit, distance in limits.keep_out},
            **travel, **motion}


def differ(one, other):
    """Whether two sites, each latitude and longitude in degrees, are different."""
    return max(abs(one[0] - other[0]), abs(wrap((one[1] - other[1]) * DEG)) / DEG) >= SAME_SITE


def _elsewhere(rows, site):
    ours = site.latitude / DEG, site.longitude / DEG
    theirs = tuple(float(rows.get(name, own)) for name, own in zip(PLACE, ours))
    if not differ(ours, theirs):
        return ''
    return (f'the guard takes the mount to be at {theirs[0]:.4f}, {theirs[1]:.4f} deg, not at '
            f'{ours[0]:.4f}, {ours[1]:.4f}: give both one site (under /**: in the parameter file)')


class AllowedSky(NamedTuple):
    """The sky that a guard allows.

    Attributes
    ----------
    horizon : Horizon
    circles : SkyCircles
    travel : tuple of (float, float)
        Ends of both axes, rad; empty for an older guard, which does not report them.
    motion : tuple of (float, float)
        Largest rates (rad/s) and accelerations (rad/s^2) of a track for both axes; likewise.
    elsewhere : str
        Why this may be a different sky: the guard uses another site; '' if it does not.
    """

    horizon: Horizon
    circles: SkyCircles
    travel: tuple = ()
    elsewhere: str = ''
    motion: tuple = ()

    @classmethod
    def from_rows(cls, rows, site):
        """From the rows of a status; None if missing. ValueError for invalid rows."""
        if not {LEAST, HORIZON} <= rows.keys():
            return None
        kept = [(limit, float(rows.get(limit.parameter, 0.0)) * DEG) for limit in SKY_LIMITS]
        return cls(Horizon(float(rows[LEAST]) * DEG, parse_horizon(rows[HORIZON])),
                   SkyCircles([pair for pair in kept if pair[1]], site),
                   tuple(tuple(end * DEG for end in parse_pair(rows[name]))
                         for name in TRAVEL if name in rows), _elsewhere(rows, site),
                   tuple(tuple(value * DEG for value in parse_pair(rows[name]))
                         for name in (RATES, ACCELERATIONS) if name in rows))

    def __call__(self, time, az, el):
        """Whether places on the horizon are allowed.

        Parameters
        ----------
        time : float
            UTC, s.
        az, el : ndarray, shape (n,)
            rad.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        beside = NEAR / np.maximum(np.cos(el), NEAR / np.pi)
        out = el >= self.horizon.highest(az, beside) + NEAR
        place = ALTAZ.direction(az, el)
        for circle in self.circles.at(time):
            out = out & (circle.toward @ place < np.cos(circle.distance + NEAR_LIMIT))
        return out

    def within(self, first, second):
        """Whether the travel of the axes includes some angles, on any turn.

        Parameters
        ----------
        first, second : ndarray, shape (n,)
            Axis angles, rad.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        inside = np.ones(len(first), bool)
        for angles, (low, high) in zip((first, second), self.travel):
            inside &= np.mod(angles - low - NEAR, _TURN) <= high - low - 2.0 * NEAR
        return inside
