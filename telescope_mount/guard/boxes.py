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

"""Boxes of pairs of axis angles, and their distance to a direction."""

import math
from typing import NamedTuple

import numpy as np

_TURN = 2.0 * math.pi


class Boxes(NamedTuple):
    """Ranges of pairs of angles.

    Attributes
    ----------
    low, high : ndarray, shape (2, n)
        rad.
    time : ndarray, shape (n,)
        Time of the middle of each, seconds after the start of the track.
    pad : ndarray, shape (2, 1), or float
        Margin added to the axes' ranges in them, rad.
    """

    low: np.ndarray
    high: np.ndarray
    time: np.ndarray
    pad: object = 0.0

    def of(self, which):
        """Subset of the boxes, by a mask or indices."""
        return Boxes(self.low[:, which], self.high[:, which], self.time[which], self.pad)


def points(places, time):
    """`Boxes` of zero size.

    Parameters
    ----------
    places : ndarray, shape (2, n)
        rad.
    time : ndarray, shape (n,)
        s.
    """
    return Boxes(places, places, time)


def arc(function, value):
    """An arc function of a value that may exceed its range by rounding."""
    return function(np.minimum(np.maximum(value, -1.0), 1.0))


def most_cosine(toward, boxes):
    """Largest cosine of the angle between a direction and the directions in a box, shape (n,).

    ``z sin b + h cos b cos(a - a0)`` is largest at an end of the range of cos(a - a0), where it is
    again a cosine of b.
    """
    x, y, z = toward
    h = np.hypot(x, y)
    low, high = boxes.low[0] - np.arctan2(x, y), boxes.high[0] - np.arctan2(x, y)
    cos_low, cos_high = np.cos(low), np.cos(high)
    most = np.where(_passes(low, high, 0.0), 1.0, np.maximum(cos_low, cos_high))
    least = np.where(_passes(low, high, np.pi), -1.0, np.minimum(cos_low, cos_high))
    out = -1.0
    for cosine in (h * most, h * least):
        size, peak = np.hypot(z, cosine), np.arctan2(z, cosine)
        low, high = boxes.low[1] - peak, boxes.high[1] - peak
        out = np.maximum(out, size * np.where(
            _passes(low, high, 0.0), 1.0, np.maximum(np.cos(low), np.cos(high))))
    return out


def largest_cosine(toward, first, second):
    """The same as `most_cosine` for one box: ends of both axes as pairs of floats."""
    x, y, z = map(float, toward)
    h, zero = math.hypot(x, y), math.atan2(x, y)
    low, high = first[0] - zero, first[1] - zero
    ends = math.cos(low), math.cos(high)
    most = 1.0 if _holds(low, high, 0.0) else max(ends)
    least = -1.0 if _holds(low, high, math.pi) else min(ends)
    out = -1.0
    for cosine in (h * most, h * least):
        size, peak = math.hypot(z, cosine), math.atan2(z, cosine)
        low, high = second[0] - peak, second[1] - peak
        out = max(out, size * (1.0 if _holds(low, high, 0.0)
                               else max(math.cos(low), math.cos(high))))
    return out


def _holds(low, high, angle):
    return math.floor((high - angle) / _TURN) >= math.ceil((low - angle) / _TURN)


def _passes(low, high, angle):
    """Whether ranges contain an angle, on any turn."""
    return np.floor((high - angle) / _TURN) >= np.ceil((low - angle) / _TURN)


def quartered(boxes, which):
    """Subset of boxes, each cut into four."""
    low, high, time = boxes.of(which)[:3]
    middle = 0.5 * (low + high)
    lows, highs = [], []
    for first in (0, 1):
        for second in (0, 1):
            side = np.array([[first], [second]]) == 1
            lows.append(np.where(side, middle, low))
            highs.append(np.where(side, high, middle))
    return Boxes(np.concatenate(lows, 1), np.concatenate(highs, 1), np.tile(time, 4))
