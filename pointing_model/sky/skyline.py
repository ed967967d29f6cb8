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

"""The skyline around a mount: the lowest allowed elevation at each azimuth, from its corners."""

import re
from bisect import bisect_left, bisect_right

import numpy as np

from msg_tools.units import DEG, wrap

_TURN = 2.0 * np.pi
#: azimuths that differ by less are equal; a wall extends this far to each side, rad
ONE, BESIDE = 1e-8, 1e-9
#: azimuths that fall by less than a quarter of a turn are not taken as rising through north, rad
WIDE = 270.0 * DEG - ONE


class Horizon:
    """The lowest allowed elevation at each azimuth.

    Parameters
    ----------
    least : float
        Minimum everywhere, rad.
    points : sequence of (float, float)
        Azimuth and elevation of the corners of a higher skyline, rad, in one direction around
        the horizon, starting anywhere; straight lines between them, also from the last to the
        first. Corners at the same azimuth are a wall, where the highest counts.

    Attributes
    ----------
    top : float
        Its highest elevation, rad.

    Raises
    ------
    ValueError
        The corners change direction in azimuth, or go more than once around.
    """

    def __init__(self, least, points=()):
        self.least, self.points = least, tuple(points)
        self.flat = not self.points
        self.top = max([least, *(el for _, el in self.points)])
        if self.flat:
            return
        az, el = _with_walls(unwrapped(self.points))
        order = np.argsort(np.mod(az, _TURN))
        az, el = np.mod(az, _TURN)[order], el[order]
        self._az = np.concatenate([[az[-1] - _TURN], az, [az[0] + _TURN]])
        self._el = np.concatenate([[el[-1]], el, [el[0]]])
        # over two turns: maxima of 1, 2, 4 ... corners, starting at each one
        self._corners = np.concatenate([az, az + _TURN])
        self._corner_list = self._corners.tolist()
        rows = [np.tile(el, 2)]
        for k in range(int(np.log2(len(rows[0])))):
            rows.append(np.maximum(rows[-1], np.roll(rows[-1], -2**k)))
        self._highest = np.array(rows)

    def at(self, az):
        """Lowest elevation at azimuths (rad), rad."""
        if self.flat:
            return np.full(np.shape(az), self.least)
        return np.maximum(np.interp(np.mod(az, _TURN), self._az, self._el), self.least)

    def over(self, az):
        """The same as `at` for one azimuth: a float."""
        return self.least if self.flat else float(self.at(az))

    def highest(self, az, half):
        """The maximum of `at` within `half` of azimuths; both of shape (n,), rad."""
        if self.flat:
            return self.least
        half = np.minimum(half, np.pi)
        begin = np.mod(az - half, _TURN)
        end = begin + 2.0 * half
        top = np.maximum(self.at(begin), self.at(end))
        first = np.searchsorted(self._corners, begin, 'left')
        count = np.searchsorted(self._corners, end, 'right') - first
        level = np.log2(np.maximum(count, 1)).astype(int)
        last = np.maximum(first + count - 2**level, 0)
        first = np.minimum(first, len(self._corners) - 1)
        between = np.maximum(self._highest[level, first], self._highest[level, last])
        return np.where(count > 0, np.maximum(top, between), top)

    def highest_between(self, first, last):
        """The maximum of `at` between two azimuths, floats, rad."""
        if self.flat or last - first >= _TURN:
            return self.top
        begin = first % _TURN
        end = begin + last - first
        top = float(self.at(np.array([begin, end])).max())
        i, j = bisect_left(self._corner_list, begin), bisect_right(self._corner_list, end)
        if i == j:
            return top
        level = (j - i).bit_length() - 1
        row = self._highest[level]
        return float(max(top, row[i], row[j - 2**level]))


def unwrapped(points):
    """Corners of a skyline with azimuths that never decrease.

    Parameters
    ----------
    points : sequence of (float, float)
        Azimuth and elevation of each, rad, as given.

    Returns
    -------
    ndarray, shape (n, 2)
        Azimuths increase from the first one, within one turn.

    Raises
    ------
    ValueError
        The corners are not in order in either direction around the horizon.
    """
    points = np.array(points, float)
    steps = np.diff(points[:, 0])
    rising, falling = (bool(np.all(sense * steps > -ONE)) for sense in (1.0, -1.0))
    if rising and steps.sum() < _TURN + ONE:
        return points
    ways = []
    if not (rising or falling and steps.sum() < -_TURN - ONE):
        back = points[::-1]
        ways = [way for way in (_along(points), back if falling else _along(back))
                if way is not None]
    # two azimuths alone are in order both ways: take the one with the shorter steps
    longest = [np.diff(way[:, 0]).max(initial=0.0) for way in ways]
    if ways and not (len(ways) == 2 and np.ptp(longest) < ONE < longest[0] - np.pi):
        return ways[int(np.argmin(longest))]
    steps = wrap(steps)
    turned = steps * (np.sign(np.sign(steps).sum()) or 1.0) < -ONE
    az, el = points[int(np.argmax(turned)) + 1 if turned.any() else -1] / DEG
    raise ValueError(f'corner {az:g} {el:g} of the horizon: azimuths go back and forth, or more '
                     'than once around; give the corners in one direction around the horizon')


def _along(points):
    """Corners with increasing azimuths; None if that takes more than one turn."""
    steps = np.diff(points[:, 0])
    onward = np.mod(steps, _TURN)
    onward[(onward < ONE) | (onward > _TURN - ONE)] = 0.0
    if onward.sum() > _TURN + ONE or np.any(onward[steps < 0.0] > WIDE):
        return None
    return np.column_stack([points[0, 0] + np.append(0.0, np.cumsum(onward)), points[:, 1]])


def _with_walls(points):
    """Strictly increasing azimuths, and elevations, of a skyline; walls become steep ramps."""
    az, el = [], []
    groups = np.split(points, np.flatnonzero(np.diff(points[:, 0]) >= ONE) + 1)
    if len(groups) > 1 and groups[-1][0, 0] - groups[0][0, 0] > _TURN - ONE:
        last = groups.pop()  # it closes at its first azimuth
        groups[0] = np.concatenate([last - [_TURN, 0.0], groups[0]])
    for group in groups:
        at, heights = group[0, 0], group[:, 1]
        if np.ptp(heights) == 0.0:
            az.append(at)
            el.append(heights[0])
            continue
        top = heights.max()
        az += [at - 2.0 * BESIDE, at - BESIDE, at + BESIDE, at + 2.0 * BESIDE]
        el += [heights[0], top, top, heights[-1]]
    return np.array(az), np.array(el)


def parse_horizon(text):
    """Parse the corners of a skyline.

    Parameters
    ----------
    text : str
        ``0 12, 45 20.5, 180 8``: azimuth and elevation of each corner, deg; or a file with one
        corner per line. Empty: no corners.

    Returns
    -------
    list of (float, float)
        rad.

    Raises
    ------
    ValueError, OSError
        One line that says what is wrong.
    """
    text = text.strip()
    if not text:
        return []
    if re.search(r'[^\d\s.,;+\-eE]', text):
        try:
            with open(text, encoding='utf-8-sig') as file:
                text = ','.join(line.partition('#')[0] for line in file)
        except FileNotFoundError:
            raise FileNotFoundError(f'{text[:60]!r} is no file, nor corners as "0 12, 45 20.5": '
                                    'azimuth and elevation, degrees') from None
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
            raise ValueError(f'corner {corner.strip()!r} of the horizon: beyond 360 or 90 degrees')
        points.append((az * DEG, el * DEG))
    if points:
        unwrapped(points)
    return points
