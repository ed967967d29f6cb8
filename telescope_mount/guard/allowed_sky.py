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

"""Where a guard lets the tube look: told by it in words, and known where stars are chosen."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import ALTAZ
from pointing_model.sky.skyline import Horizon, parse_horizon

from ..guard.limits import parse_pair
from ..guard.sky_limits import SKY_LIMITS, SkyCircles

#: a star keeps so far from horizon and ends of travel, and from limits in the sky, which move while
#: it is gone to, rad: readings are beside places of the sky by zero, model and refraction, and the
#: guard looks at tracks in boxes
NEAR, NEAR_LIMIT = 1.5 * DEG, 2.0 * DEG
#: rows of `guard/status`
LEAST, HORIZON = 'least_elevation_deg', 'horizon'
TRAVEL = 'first_travel_deg', 'second_travel_deg'
#: that a track may ask for, of both axes
RATES, ACCELERATIONS = 'track_rates_deg_s', 'track_accelerations_deg_s2'
#: without which nobody knows where a limit in the sky is
PLACE = 'latitude_deg', 'longitude_deg'
#: sites that differ by less are one, deg
SAME_SITE = 0.01
_TURN = 2.0 * np.pi


def rows_of(limits):
    """What of a guard's limits a chooser of stars must know: rows of `guard/status`.

    Parameters
    ----------
    limits : guard.limits.Limits

    Returns
    -------
    dict of str to str
        Degrees; the corners of the skyline as its parameter has them.
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
    """Whether two sites, each latitude and longitude in degrees, are not the same."""
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
        Ends of both axes, rad; empty where an older guard does not report it.
    motion : tuple of (float, float)
        Rates (rad/s) and accelerations (rad/s^2) that a track may ask of both axes; the same.
    elsewhere : str
        Why that may be another sky: the guard goes by another site; '' where it does not.
    """

    horizon: Horizon
    circles: SkyCircles
    travel: tuple = ()
    elsewhere: str = ''
    motion: tuple = ()

    @classmethod
    def from_rows(cls, rows, site):
        """From the rows of a status; None where it does not report it. ValueError for bad ones."""
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
        """Whether places of the horizon system are allowed.

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
        """Whether the travel of the axes has such angles, on whatever turn.

        Parameters
        ----------
        first, second : ndarray, shape (n,)
            Of the axes, rad.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        inside = np.ones(len(first), bool)
        for angles, (low, high) in zip((first, second), self.travel):
            inside &= np.mod(angles - low - NEAR, _TURN) <= high - low - 2.0 * NEAR
        return inside
