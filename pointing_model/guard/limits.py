"""Where the axes and the tube may be, and how fast."""

import math
import re
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG, wrap

from ..mounts import ALTAZ, Mount

_TURN = 2.0 * np.pi
#: steps of azimuth in which a horizon is kept, each with the highest that is in it
_STEPS = 1440
#: travel of the axes where nothing else is said, deg: first and second axis
TRAVEL_DEG = {
    'altaz': ((-270.0, 270.0), (-5.0, 95.0)),
    'equatorial': ((-180.0, 180.0), (-90.0, 100.0)),
    'german': ((-10.0, 190.0), (-90.0, 270.0)),
    'free': ((-180.0, 180.0), (-90.0, 270.0)),
}


def travel_of(mount):
    """Ends of the travel of both axes where nothing else is said, deg.

    In the south an equatorial mount has the other pole up, and a German one goes through that.

    Parameters
    ----------
    mount : Mount
    """
    first, second = TRAVEL_DEG[mount.kind]
    if mount.kind in ('equatorial', 'german') and mount.latitude < 0.0:
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


class Horizon:
    """The lowest elevation at each azimuth.

    Parameters
    ----------
    least : float
        Everywhere, rad.
    points : sequence of (float, float)
        Azimuth and elevation of the corners of a higher skyline, rad; straight between them, all
        round.

    Attributes
    ----------
    top : float
        The highest of it, rad.
    """

    def __init__(self, least, points=()):
        self.least, self.points = least, tuple(points)
        self.flat = not self.points
        self.top = max([least, *(el for _, el in self.points)])
        if self.flat:
            return
        az, el = np.array(sorted((az % _TURN, el) for az, el in self.points)).T
        self._az = np.concatenate([[az[-1] - _TURN], az, [az[0] + _TURN]])
        self._el = np.concatenate([[el[-1]], el, [el[0]]])
        self._step = _TURN / _STEPS
        edges = self.at(np.arange(_STEPS + 1) * self._step)
        highest = np.maximum(edges[:-1], edges[1:])
        np.maximum.at(highest, (az / self._step).astype(int) % _STEPS, np.maximum(el, least))
        # maxima of 1, 2, 4 ... steps from each one on
        rows = [np.tile(highest, 3)]
        for k in range(int(np.log2(_STEPS))):
            rows.append(np.maximum(rows[-1], np.roll(rows[-1], -2**k)))
        self._highest = np.array(rows)

    def at(self, az):
        """Lowest elevation at azimuths (rad), rad."""
        if self.flat:
            return np.full(np.shape(az), self.least)
        return np.maximum(np.interp(np.mod(az, _TURN), self._az, self._el), self.least)

    def over(self, az):
        """As `at`, of one azimuth: a float."""
        return self.least if self.flat else float(self.at(az))

    def highest(self, az, half):
        """The largest `at` within `half` of azimuths; both of shape (n,), rad."""
        if self.flat:
            return self.least
        first = np.floor((az - half) / self._step).astype(int)
        count = np.minimum(np.floor((az + half) / self._step).astype(int) - first + 1, _STEPS)
        first = np.mod(first, _STEPS)
        level = np.log2(count).astype(int)
        return np.maximum(self._highest[level, first],
                          self._highest[level, first + count - 2**level])


    def highest_between(self, first, last):
        """The largest `at` between two azimuths, floats, rad."""
        if self.flat:
            return self.least
        begin = math.floor(first / self._step)
        count = min(math.floor(last / self._step) - begin + 1, _STEPS)
        level, begin = count.bit_length() - 1, begin % _STEPS
        row = self._highest[level]
        return float(max(row[begin], row[begin + count - 2**level]))


@dataclass(frozen=True)
class Limits:
    """What a mount must not leave.

    Parameters
    ----------
    mount : Mount
    axes : tuple of Axis
        First and second.
    horizon : Horizon
    sun : float
        Least distance from the Sun, rad; 0: it is no matter.
    timing : float
        The axes slew at no less than this share of their rates and accelerations, 0 to 1; each
        on its own, and no track may ask for more. 0: nothing is known of it, one axis may go while
        the other waits.
    """

    mount: Mount = ALTAZ
    axes: tuple = (Axis(-270.0 * DEG, 270.0 * DEG, 4.0 * DEG, 2.0 * DEG),
                   Axis(-5.0 * DEG, 95.0 * DEG, 4.0 * DEG, 2.0 * DEG))
    horizon: Horizon = Horizon(10.0 * DEG)
    sun: float = 20.0 * DEG
    timing: float = 0.5

    @property
    def blocked_pole(self):
        """How high the pole is through which a German mount changes its side, and the horizon.

        rad; None where the tube may pass there, or need not.
        """
        if self.mount.kind != 'german':
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
        if self.mount.altaz or not np.isfinite([first, second]).all():
            return first, second
        return tuple(angle + _TURN * round((0.5 * (axis.low + axis.high) - angle) / _TURN)
                     for angle, axis in zip((first, second), self.axes))

    def nearest_turn(self, place, here):
        """A place, rad, with the azimuth on the turn nearest to `here` if its travel has it."""
        first = here + wrap(place[0] - here) if self.mount.altaz else place[0]
        return np.array([first if self.axes[0].low <= first <= self.axes[0].high else place[0],
                         place[1]])

    def __post_init__(self):
        for axis, word in zip(self.axes, self.mount.names.axes):
            if not axis.low < axis.high:
                raise ValueError(f'travel of the {word} from {axis.low / DEG:g} to '
                                 f'{axis.high / DEG:g} deg: give the smaller end first')
            if not (axis.rate > 0.0 and axis.acceleration > 0.0):
                raise ValueError(f'speed and acceleration of the {word} must be above 0')


def parse_horizon(text):
    """Corners of a skyline.

    Parameters
    ----------
    text : str
        ``0 12, 45 20.5, 180 8``: azimuth and elevation of each corner, deg; or a file with a
        corner on each line. Empty: none.

    Returns
    -------
    list of (float, float)
        rad.

    Raises
    ------
    ValueError, OSError
        One line: what is wrong.
    """
    text = text.strip()
    if not text:
        return []
    if re.search(r'[^\d\s.,;+\-eE]', text):
        with open(text, encoding='utf-8') as file:
            text = ','.join(line.partition('#')[0] for line in file)
    points = []
    for corner in re.split(r'[;,\n]', text):
        if not corner.strip():
            continue
        try:
            az, el = (float(part) for part in corner.split())
        except ValueError:
            raise ValueError(f'corner {corner.strip()!r} of the horizon: give azimuth and '
                             'elevation in degrees, as 45 20.5') from None
        if not (-360.0 <= az <= 360.0 and -90.0 <= el <= 90.0):
            raise ValueError(f'corner {corner.strip()!r} of the horizon: no azimuth and elevation')
        points.append((az * DEG, el * DEG))
    return points


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
