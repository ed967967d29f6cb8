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

"""Where the axes and the tube may be, and how fast."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.sky.skyline import Horizon

from .sky_limits import SUN

#: of the speed and the acceleration of an axis, what a slew in pieces uses: the rest is for
#: catching up
SLEW_SHARE = 0.8
#: points of a way around keep so far from the ends of the travel, rad
EDGE = 0.5 * DEG
#: readings beyond the travel by more cannot be, rad
BEYOND = 10.0 * DEG
#: what is so near to the horizon or a limit in the sky counts as beyond it, rad
NEAR = 0.1 * DEG
#: whoever is beyond these may come back: by so much he may seem to go on, rad
SLACK = 0.05 * DEG
#: axes whose timing is not known keep away from what moves in the sky by so much more, rad
MARGIN = 1.0 * DEG
_TURN = 2.0 * np.pi


def travel_of(mount):
    """Ends of the travel of both axes where nothing else is given, deg.

    In the south an equatorial mount has the other pole up, and a German one goes through that.

    Parameters
    ----------
    mount : Mount
    """
    first, second = mount.names.travel_deg
    if mount.celestial and mount.latitude < 0.0:
        second = -second[1], -second[0]
    return first, second


class Axis(NamedTuple):
    """What an axis may do.

    Attributes
    ----------
    low, high : float
        Ends of its travel, rad. Of the azimuth with its turns counted (the wrap of the cables), of
        the first axis of a German mount its meridian limits.
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
    """What a mount must not leave.

    Parameters
    ----------
    mount : Mount
    axes : tuple of Axis
        First and second.
    horizon : Horizon
    keep_out : tuple of (SkyLimit, float)
        Least distance from each limit in the sky that matters, rad.
    timing : float
        The axes slew at no less than this share of their rates and accelerations, 0 to 1; each
        on its own, and no track may ask for more. 0: nothing is known of it, one axis may go while
        the other waits.
    """

    mount: Mount = ALTAZ
    axes: tuple = (Axis(-270.0 * DEG, 270.0 * DEG, 4.0 * DEG, 2.0 * DEG),
                   Axis(-5.0 * DEG, 95.0 * DEG, 4.0 * DEG, 2.0 * DEG))
    horizon: Horizon = Horizon(10.0 * DEG)
    keep_out: tuple = ((SUN, SUN.distance_deg * DEG),)
    timing: float = 0.5

    @property
    def blocked_pole(self):
        """How high the pole is through which a German mount changes its side, and the horizon.

        rad; None where the tube may pass there, or need not.
        """
        if not self.mount.two_sided:
            return None
        turn = 0.5 * np.pi if self.axes[1].high > np.pi else -0.5 * np.pi
        az, el = self.mount.horizon_of(0.0, turn)
        least = float(self.horizon.at(az))
        return None if el >= least else (float(el), least)

    def on_travel(self, first, second):
        """Angles on the turn that is nearest to the middle of the travel; an azimuth as it is.

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
        """A place, rad, with the azimuth on the turn nearest to `here` if its travel has it."""
        first = here + wrap(place[0] - here) if self.mount.vertical else place[0]
        return np.array([first if self.axes[0].low <= first <= self.axes[0].high else place[0],
                         place[1]])

    def in_pieces(self):
        """The same for slews in pieces: tracks too leave something to catch up with."""
        return replace(self, timing=min(self.timing, SLEW_SHARE))

    def on_turn_of(self, reading):
        """The same limits where the turn of the first axis is not known; its reading, rad."""
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
    """Two numbers of a text, separated by a comma; '' gives None.

    Raises
    ------
    ValueError
        It is something else.
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
    """The travel of an axis whose turn is not known, in the turn of its reading.

    Wherever it stands among the turns that its travel has room for, no end is passed.

    Parameters
    ----------
    reading : float
        At power-on, rad.
    low, high : float
        Ends of the travel, with turns counted, rad.

    Returns
    -------
    low, high : float
        rad; (reading, reading) at least.

    Raises
    ------
    ValueError
        On no turn does the reading lie within the travel.
    """
    fewest = np.ceil((low - reading) / _TURN)
    most = np.floor((high - reading) / _TURN)
    if fewest > most:
        raise ValueError(f'a reading of {reading / DEG:.1f} deg lies on no turn within the travel '
                         f'of {low / DEG:g} to {high / DEG:g} deg')
    return float(low - fewest * _TURN), float(high - most * _TURN)
