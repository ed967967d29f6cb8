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

"""Limits of the axes and the tube, and their rates."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.sky.skyline import Horizon

from .sky_limits import SUN

#: fraction of an axis' rate and acceleration used by a slew in pieces: the rest is for catching up
SLEW_SHARE = 0.8
#: margin of via points to the ends of the travel, rad
EDGE = 0.5 * DEG
#: readings farther beyond the travel are impossible, rad
BEYOND = 10.0 * DEG
#: places closer than this to the horizon or a limit in the sky count as beyond it, rad
NEAR = 0.1 * DEG
#: a mount beyond these limits may come back: tolerance for apparent motion outward, rad
SLACK = 0.05 * DEG
#: extra distance from moving limits in the sky for axes with unknown timing, rad
MARGIN = 1.0 * DEG
_TURN = 2.0 * np.pi


def travel_of(mount):
    """Default travel of both axes, deg.

    In the south an equatorial mount has the other pole up, and a German mount goes through it.

    Parameters
    ----------
    mount : Mount
    """
    first, second = mount.names.travel_deg
    if mount.celestial and mount.latitude < 0.0:
        second = -second[1], -second[0]
    return first, second


class Axis(NamedTuple):
    """Limits of an axis.

    Attributes
    ----------
    low, high : float
        Ends of its travel, rad: for azimuth with turns counted (cable wrap), for the first axis
        of a German mount its meridian limits.
    rate : float
        rad/s.
    acceleration : float
        rad/s^2.
    """

    low: float
    high: float
    rate: float
    acceleration: float


@dataclass(frozen=True)
class Limits:
    """Limits of a mount.

    Parameters
    ----------
    mount : Mount
    axes : tuple of Axis
        First and second.
    horizon : Horizon
    keep_out : tuple of (SkyLimit, float)
        Least distance from each active limit in the sky, rad.
    timing : float
        In slews each axis uses at least this fraction of its rate and acceleration, 0 to 1, and no
        track may require more. 0: unknown, one axis may move while the other waits.
    """

    mount: Mount = ALTAZ
    axes: tuple = (Axis(-270.0 * DEG, 270.0 * DEG, 4.0 * DEG, 2.0 * DEG),
                   Axis(-5.0 * DEG, 95.0 * DEG, 4.0 * DEG, 2.0 * DEG))
    horizon: Horizon = Horizon(10.0 * DEG)
    keep_out: tuple = ((SUN, SUN.distance_deg * DEG),)
    timing: float = 0.5

    @property
    def blocked_pole(self):
        """Elevation of the pole through which a German mount changes sides, and the horizon there.

        rad; None if the tube may pass there, or does not need to.
        """
        if not self.mount.two_sided:
            return None
        turn = 0.5 * np.pi if self.axes[1].high > np.pi else -0.5 * np.pi
        az, el = self.mount.horizon_of(0.0, turn)
        least = float(self.horizon.at(az))
        return None if el >= least else (float(el), least)

    def on_travel(self, first, second):
        """Angles on the turn closest to the middle of the travel; azimuth is left unchanged.

        Parameters
        ----------
        first, second : float
            rad.
        """
        if self.mount.vertical or not np.isfinite([first, second]).all():
            return first, second
        return tuple(angle + _TURN * round((0.5 * (axis.low + axis.high) - angle) / _TURN)
                     for angle, axis in zip((first, second), self.axes))

    def nearest_turn(self, place, here):
        """A place, rad, with the azimuth on the turn closest to `here` if within its travel."""
        first = here + wrap(place[0] - here) if self.mount.vertical else place[0]
        return np.array([first if self.axes[0].low <= first <= self.axes[0].high else place[0],
                         place[1]])

    def on_turn_of(self, reading):
        """The same limits for a first axis on an unknown turn; its reading, rad."""
        first, second = self.axes
        low, high = safe_travel(reading, first.low, first.high)
        return replace(self, axes=(first._replace(low=low, high=high), second))

    def __post_init__(self):
        for axis, word in zip(self.axes, self.mount.names.axes):
            if not axis.low < axis.high:
                raise ValueError(f'travel of the {word} from {axis.low / DEG:g} to '
                                 f'{axis.high / DEG:g} deg: give the smaller end first')
            if not (axis.rate > 0.0 and axis.acceleration > 0.0):
                raise ValueError(f'speed and acceleration of the {word} must be above 0')


def parse_pair(text, names='two numbers'):
    """Parse two numbers separated by a comma; '' gives None.

    Raises
    ------
    ValueError
        The text is something else.
    """
    if not text.strip():
        return None
    try:
        first, second = (float(part) for part in text.split(','))
    except ValueError:
        raise ValueError(f'{text!r}: give {names}, separated by a comma') from None
    if not np.isfinite([first, second]).all():
        raise ValueError(f'{text!r}: give {names} that are finite')
    return first, second


def safe_travel(reading, low, high):
    """The travel of an axis on an unknown turn, in the turn of its reading.

    On any of its possible turns no end of the travel is passed.

    Parameters
    ----------
    reading : float
        Reading at power-on, rad.
    low, high : float
        Ends of the travel, with turns counted, rad.

    Returns
    -------
    low, high : float
        rad; at least (reading, reading).

    Raises
    ------
    ValueError
        The reading lies within the travel on no turn.
    """
    fewest = np.ceil((low - reading) / _TURN)
    most = np.floor((high - reading) / _TURN)
    if fewest > most:
        raise ValueError(f'a reading of {reading / DEG:.1f} deg lies on no turn within the travel '
                         f'of {low / DEG:g} to {high / DEG:g} deg')
    return float(low - fewest * _TURN), float(high - most * _TURN)
