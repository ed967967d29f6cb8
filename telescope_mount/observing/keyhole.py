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

"""Where an axis is too slow for a pass, and the fastest way across, with the least time lost.

Near the pole of the first axis a pass at any speed requires half a turn at once: in the zenith for
an alt-azimuth mount, low in the north and south for an X/Y mount. The axis leaves the track shortly
before and moves at its full rate, so that it arrives when the track has become slow enough: the
shortest possible time.
"""

from typing import NamedTuple

import numpy as np

#: s between the times that are examined
STEP = 0.25
#: fractions of the full rate and acceleration used for the crossing: the guard needs a margin,
#: since the cubic between knots has sharper corners
_PART, _PART_OF_ACCELERATION = 0.97, 0.45
#: fraction of the acceleration that a track itself may need
_SHARP = 0.6
#: gap between parts that are too fast or too sharp for one keyhole, s
_GAP = 60.0


class Keyhole(NamedTuple):
    """Part of a pass that an axis cannot follow.

    Attributes
    ----------
    axis : int
        0 or 1.
    begin, end : float
        Times when the axis leaves the track and returns to it, UTC seconds since 1970-01-01.
    wanted : float
        Largest rate required by the pass, rad/s.
    """

    axis: int
    begin: float
    end: float
    wanted: float

    @property
    def lost(self):
        """Seconds off the track."""
        return self.end - self.begin


def keyholes(time, angles, axes):
    """The parts of a pass that cannot be followed.

    Parameters
    ----------
    time : ndarray, shape (n,)
        In steps of `STEP`, UTC seconds since 1970-01-01.
    angles : ndarray, shape (n, 2)
        Axis angles on the track, without jumps by a turn, rad.
    axes : sequence of guard.limits.Axis
        Rates (rad/s) and accelerations (rad/s^2).

    Returns
    -------
    list of Keyhole
        In order of time.
    """
    out = []
    rates = np.gradient(angles, time, axis=0)
    accelerations = np.gradient(rates, time, axis=0)
    for k, axis in enumerate(axes):
        rate = _PART * axis.rate
        fast = np.flatnonzero((np.abs(rates[:, k]) > rate)
                              | (np.abs(accelerations[:, k]) > _SHARP * axis.acceleration))
        for rows in np.split(fast, np.flatnonzero(np.diff(time[fast]) > _GAP) + 1) if len(
                fast) else ():
            begin, end = _shortest(angles[:, k], rates[:, k], time, rows, rate,
                                   _PART_OF_ACCELERATION * axis.acceleration)
            out.append(Keyhole(k, float(time[begin]), float(time[end]),
                               float(np.abs(rates[rows, k]).max())))
    return sorted(out, key=lambda one: one.begin)


def _shortest(angle, rates, time, rows, rate, acceleration):
    """First and last row of the shortest crossing of rows that are too fast."""
    sign = np.sign(rates[rows[len(rows) // 2]])
    # angle lost by starting and ending slower than the full rate
    cost = np.square(np.clip(rate - sign * rates, 0.0, None)) / (2.0 * acceleration)
    # needed: (angle + cost) at the end - (angle - cost) at the begin <= rate (t_end - t_begin)
    late = sign * angle - rate * time
    ends = late + cost
    best = 0, len(time) - 1
    j = min(rows[-1] + 1, len(time) - 1)
    for i in range(max(rows[0] - 1, 0), -1, -1):
        if time[j] - time[i] >= time[best[1]] - time[best[0]]:
            break
        stop = np.flatnonzero(ends[j:] <= late[i] - cost[i])
        if len(stop) and time[j + stop[0]] - time[i] < time[best[1]] - time[best[0]]:
            best = i, j + int(stop[0])
    return best


def across(time, angles, rates, keyhole, axis):
    """Angles and rates of an axis, with the crossing of a keyhole instead of the track.

    It changes its rate at full acceleration, moves uniformly, and changes it again.

    Parameters
    ----------
    time : ndarray, shape (n,)
    angles, rates : ndarray, shape (n,)
        Angles and rates of this axis on the track, rad, rad/s.
    keyhole : Keyhole
    axis : guard.limits.Axis

    Returns
    -------
    angles, rates : ndarray, shape (n,)
    """
    angles, rates = angles.copy(), rates.copy()
    begin, end = np.searchsorted(time, [keyhole.begin, keyhole.end])
    span, way = time[end] - time[begin], angles[end] - angles[begin]
    sign = np.sign(way)
    first, last, way = sign * rates[begin], sign * rates[end], abs(way)
    # v: v span - ((v - first)^2 + (v - last)^2) / 2a = way
    a = _PART_OF_ACCELERATION * axis.acceleration
    b = span + (first + last) / a
    c = way + (first**2 + last**2) / (2.0 * a)
    even = 0.5 * a * (b - np.sqrt(max(b * b - 4.0 * c / a, 0.0)))
    rows = np.arange(begin, end + 1)
    at = time[rows] - time[begin]
    up, down = max((even - first) / a, 0.0), max((even - last) / a, 0.0)
    late = np.clip(at - (span - down), 0.0, None)
    early = np.minimum(at, up)
    moved = first * early + 0.5 * a * early**2 + even * np.clip(at - up, 0.0, None) \
        - 0.5 * a * late**2
    angles[rows] = angles[begin] + sign * moved
    rates[rows] = sign * (np.where(at < up, first + a * at, even) - a * late)
    return angles, rates
