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

"""Limits in the sky that the tube must keep away from: the Sun.

A new one is an entry of `SKY_LIMITS`. Its parameter of the guard, its row in ``guard/status``, the
check of tracks and the choice of stars follow from that.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pointing_model.mounts import ALTAZ
from pointing_model.sky.earth import TURN_RATE
from pointing_model.sky.places import sun_place

#: interval after which the place is recomputed, s; in between it turns with the sky
_FRESH = 600.0


@dataclass(frozen=True)
class SkyLimit:
    """An object to keep away from.

    Parameters
    ----------
    name : str
        Name in sentences.
    parameter : str
        Parameter of the guard with the least distance in degrees.
    distance_deg : float
        Default; 0: inactive.
    place : callable
        ``place(time, site)``: azimuth and elevation, rad, at a time (UTC, s).
    turns : bool
        Whether it turns with the sky, so that it needs a site; otherwise it is fixed.
    """

    name: str
    parameter: str
    distance_deg: float
    place: Callable
    turns: bool = True


SUN = SkyLimit('the Sun', 'sun_distance_deg', 20.0, sun_place)
SKY_LIMITS = (SUN,)


class Circle(NamedTuple):
    """Circle around a limit where the tube may not point.

    Attributes
    ----------
    toward : ndarray, shape (3,)
        Present direction of the limit: east, north, up, or in the frame of the axes.
    pole : ndarray, shape (3,), or None
        Direction of the celestial north pole, about which it turns; None: fixed.
    distance : float
        Radius of the circle, rad.
    limit : SkyLimit
    """

    toward: np.ndarray
    pole: np.ndarray | None
    distance: float
    limit: SkyLimit = SUN

    def at(self, seconds):
        """Direction of the limit after some seconds, shape (3,) or (3, n)."""
        return self.toward if self.pole is None else turned(self.toward, self.pole, seconds)

    def later(self, seconds, wider=0.0):
        """The circle after some seconds, with a radius that is larger by `wider`, rad."""
        return self._replace(toward=self.at(seconds), distance=self.distance + wider)

    def in_frame(self, frame):
        """The circle in another frame, whose axes are the rows of a matrix."""
        return self._replace(toward=frame @ self.toward,
                             pole=None if self.pole is None else frame @ self.pole)


class SkyCircles:
    """The circles over a site, at any time.

    Parameters
    ----------
    keep_out : sequence of (SkyLimit, float)
        Least distance from each, rad.
    site : Site
    """

    def __init__(self, keep_out, site):
        self._keep_out, self._site = tuple(keep_out), site
        self._pole = np.array([0.0, np.cos(site.latitude), np.sin(site.latitude)])
        self._known = {}  # limit -> time of computation, and its circle then

    def at(self, time):
        """Tuple of `Circle` at a time (UTC, s)."""
        return tuple(self._circle(limit, distance, time) for limit, distance in self._keep_out)

    def _circle(self, limit, distance, time):
        then, circle = self._known.get(limit, (None, None))
        if then is None or abs(time - then) > _FRESH:
            toward = ALTAZ.direction(*limit.place(time, self._site))
            circle = Circle(toward, self._pole if limit.turns else None, distance, limit)
            self._known[limit] = then, circle = time, circle
        return circle.later(time - then)


def turned(place, pole, seconds):
    """A direction on the sky after diurnal motion for some time.

    Parameters
    ----------
    place, pole : ndarray, shape (3,)
        The direction, and that of the celestial north pole.
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
