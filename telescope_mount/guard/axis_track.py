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

"""A requested track of the axes, with its peaks, and boxes of its angles."""

import copy
import math
from bisect import bisect_left, bisect_right
from functools import cached_property

import numpy as np

from msg_tools.units import DEG

from ..observing.axis_demand import Track
from .boxes import Boxes, points

#: approximate size of the pieces into which a track is cut, rad
STEP = 2.0 * DEG
#: largest deviation of the track from the straight lines between cuts, rad
BENT = 0.02 * DEG
_largest, _smallest = np.maximum.reduce, np.minimum.reduce  # less overhead than array methods


class Cubic:
    """A track: cubic Hermite interpolation between its knots.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Seconds.
    angles, rates : ndarray, shape (n, 2)
        rad, rad/s.

    Attributes
    ----------
    peak_acceleration, peak_rate : list of float
        Peak values of each axis, rad/s^2 and rad/s.
    most_rate : list of float
        Upper bound of `peak_rate`, faster to compute.
    low, high : list of float
        Lowest and highest angle of each axis, rad.
    hull : tuple of list of float
        Bounds of `low` and `high`, faster to compute.
    """

    def __init__(self, times, angles, rates):
        self.times, self.angles, self.rates = times, angles, rates

    @cached_property
    def knots(self):
        """Times (s), and angles and rates of each axis (rad, rad/s), as lists for fast access."""
        return self.times.tolist(), self.angles.T.tolist(), self.rates.T.tolist()

    @cached_property
    def _pieces(self):
        """For each axis its angles, its rates, and the pieces between two knots.

        A piece has its length (s), and angles and rates at both ends. For a dozen knots lists take
        half the time of arrays, for thirty the same.
        """
        times, angles, rates = self.knots
        steps = [b - a for a, b in zip(times, times[1:])]
        return [(places, speeds, list(zip(steps, places, places[1:], speeds, speeds[1:])))
                for places, speeds in zip(angles, rates)]

    @cached_property
    def _bounds(self):
        most_rate, peak_acceleration, lows, highs = [], [], [], []
        for places, speeds, pieces in self._pieces:
            low, high, fast, bent = min(places), max(places), max(max(speeds), -min(speeds)), 0.0
            for h, p0, p1, v0, v1 in pieces:
                # a polynomial lies within its Bezier coefficients: of a rate v0, middle, v1
                middle = 3.0 * (p1 - p0) / h - v0 - v1
                first, last, third = abs(middle - v0) / h, abs(v1 - middle) / h, h / 3.0
                a, b, middle = p0 + third * v0, p1 - third * v1, abs(middle)
                # not min and max, which would take most of the time
                if first > bent:
                    bent = first
                if last > bent:
                    bent = last
                if middle > fast:
                    fast = middle
                if a < low:
                    low = a
                if a > high:
                    high = a
                if b < low:
                    low = b
                if b > high:
                    high = b
            most_rate.append(fast)
            peak_acceleration.append(2.0 * bent)
            lows.append(low)
            highs.append(high)
        return most_rate, peak_acceleration, (lows, highs)

    most_rate = property(lambda self: self._bounds[0])
    peak_acceleration = property(lambda self: self._bounds[1])
    hull = property(lambda self: self._bounds[2])

    @cached_property
    def _between(self):
        """For each axis the extreme rates between two knots, or the rate of one of them."""
        out = []
        for _, _, pieces in self._pieces:
            out.append(turns := [])
            for h, p0, p1, v0, v1 in pieces:
                first = 3.0 * (p1 - p0) / h - 2.0 * v0 - v1
                change = 2.0 * first + v0 - v1
                at = min(max(first / change, 0.0), 1.0) if change else 0.0
                turns.append(v0 + at * (2.0 * first - change * at))
        return out

    @cached_property
    def peak_rate(self):
        """See the class."""
        return [max(map(abs, speeds + turns)) for speeds, turns in zip(
            self.knots[2], self._between)]

    @cached_property
    def _fine(self):
        """Times and angles of cuts, and the largest deviation of the track from their chords."""
        times, angles = self.times, self.angles
        if len(times) == 1:
            return times, angles, np.zeros(2)
        h = (times[1:] - times[:-1])[:, None]
        v0, v1, step = self.rates[:-1], self.rates[1:], angles[1:] - angles[:-1]
        middle = 3.0 * step / h - v0 - v1
        squares = 2.0 * h * np.maximum(np.abs(middle - v0), np.abs(v1 - middle))
        bent = _largest(squares, 1) / 8.0
        way = _largest(np.abs(step), 1) + _largest(np.abs(v0), 1) * h[:, 0] * (bent > BENT)
        cuts = max(float(_largest(way)) / STEP, math.sqrt(float(_largest(bent)) / BENT))
        cuts = int(min(max(math.ceil(cuts), 1), 400))
        bent = _largest(squares) / (8.0 * cuts * cuts)
        if cuts == 1:
            return times, angles, bent
        s = np.arange(cuts) / cuts
        s = s[None, :, None]
        h, v0, v1, step = h[:, None], v0[:, None], v1[:, None], step[:, None]
        fine = (angles[:-1, None] + s * s * (3.0 - 2.0 * s) * step
                + h * s * (1.0 - s) * ((1.0 - s) * v0 - s * v1))
        return (np.append((times[:-1, None] + h[:, :, 0] * s[:, :, 0]).ravel(), times[-1]),
                np.concatenate([fine.reshape(-1, 2), angles[-1:]]), bent)

    @cached_property
    def _ends(self):
        lows, highs = [], []
        for places, _, pieces in self._pieces:
            low, high = min(places), max(places)
            for h, p0, p1, v0, v1 in pieces:
                third, step = h / 3.0, p1 - p0
                a, b = p0 + third * v0, p1 - third * v1
                if low <= a <= high and low <= b <= high:
                    continue
                # where its rate is 0: v0 + 2 first s + bend s^2 = 0
                first = 3.0 * step / h - 2.0 * v0 - v1
                bend = v1 - v0 - 2.0 * first
                root = first * first - v0 * bend
                if root < 0.0:
                    continue
                q = -first - math.copysign(math.sqrt(root), first)
                for s in (q / bend if bend else 0.0, v0 / q if q else 0.0):
                    if 0.0 < s < 1.0:
                        at = p0 + s * s * (3.0 - 2.0 * s) * step + h * s * (1.0 - s) * (
                            (1.0 - s) * v0 - s * v1)
                        low, high = min(low, at), max(high, at)
            lows.append(low)
            highs.append(high)
        return lows, highs

    low = property(lambda self: self._ends[0])
    high = property(lambda self: self._ends[1])

    def turned(self, first, second=0):
        """The same track with whole turns added to the axes."""
        turns = first * 2.0 * math.pi, second * 2.0 * math.pi
        out = copy.copy(self)
        for name in ('knots', '_pieces', '_fine', '_ends'):
            out.__dict__.pop(name, None)
        out.angles = self.angles + turns
        hull = tuple([a + b for a, b in zip(ends, turns)] for ends in self.hull)
        out._bounds = self.most_rate, self.peak_acceleration, hull
        return out

    def at(self, t, axis):
        """Angle and rate of one axis at `t`, floats; constant after the end."""
        times, angles, rates = self.knots
        angles, rates = angles[axis], rates[axis]
        t = min(max(t, times[0]), times[-1])
        if len(times) == 1:
            return angles[0], rates[0]
        i = min(bisect_right(times, t) - 1, len(times) - 2)
        t0, t1 = times[i], times[i + 1]
        p0, p1 = angles[i], angles[i + 1]
        v0, v1 = rates[i], rates[i + 1]
        h, step = t1 - t0, p1 - p0
        s = (t - t0) / h
        return (p0 + s * s * (3.0 - 2.0 * s) * step
                + h * s * (1.0 - s) * ((1.0 - s) * v0 - s * v1),
                6.0 * s * (1.0 - s) * step / h + (1.0 - s) * (1.0 - 3.0 * s) * v0
                + s * (3.0 * s - 2.0) * v1)

    def near(self, t, axis):
        """Angles of one axis at times `t` (n,), accurate to `BENT`."""
        return np.interp(t, self._fine[0], self._fine[1][:, axis])

    def reached(self, t, axis):
        """Extreme angles of one axis until times `t` (n,): low and high, (n,)."""
        times, places, _ = self._fine
        until = np.searchsorted(times, t, 'right')
        until = np.clip(until, 1, len(times) - 1) if len(times) > 1 else 0 * until
        return (np.minimum.accumulate(places[:, axis])[until],
                np.maximum.accumulate(places[:, axis])[until])

    def change(self, begin, end, axis):
        """Upper bound of the change of one axis' rate from `begin` to `end`, rad/s.

        It includes rest after the end of the track.
        """
        times = self.knots[0]
        first = max(bisect_right(times, begin) - 1, 0)
        last = max(bisect_left(times, end), first + 1)
        rates = self.knots[2][axis][first:last + 1] + self._between[axis][first:last]
        low, high = min(rates), max(rates)
        if end > times[-1]:
            low, high = min(low, 0.0), max(high, 0.0)
        return high - low

    def brakes(self, slow):
        """Largest braking distance of each axis if it is stopped on the track, rad, floats.

        Parameters
        ----------
        slow : tuple of float
            Braking accelerations of the axes, rad/s^2.
        """
        return [v * v / (2.0 * a) for v, a in zip(self.peak_rate, slow)]

    def surely_within(self, slow):
        """Bounds of each axis on the track, even if stopped on it: low, high for both, rad.

        Parameters
        ----------
        slow : tuple of float
            See `brakes`.
        """
        return [(low - v * v / (2.0 * a), high + v * v / (2.0 * a))
                for low, high, v, a in zip(*self.hull, self.most_rate, slow)]

    def boxes(self, slow=None):
        """`Boxes` of the whole track, and of where the axes come to rest if stopped on it.

        Parameters
        ----------
        slow : tuple of float, optional
            See `brakes`; by default without stops.
        """
        times, angles, bent = self._fine
        if len(times) == 1:
            return points(angles.T, times)
        a, b = angles[:-1].T, angles[1:].T
        low, high = np.minimum(a, b), np.maximum(a, b)
        if slow is not None and max(self.brakes(slow)) > BENT:
            h = times[1:] - times[:-1]
            bend = 0.5 * np.array(self.peak_acceleration)[:, None] * h
            rate, slow = (b - a) / h, 2.0 * np.array(slow)[:, None]
            low = low - np.minimum(rate - bend, 0.0) ** 2 / slow
            high = high + np.maximum(rate + bend, 0.0) ** 2 / slow
        pad = bent[:, None] + BENT
        return Boxes(low - pad, high + pad, 0.5 * (times[:-1] + times[1:]))


def resting(place):
    """A `Cubic` at rest at a pair of angles, rad."""
    return Cubic(np.zeros(1), np.array([place], float), np.zeros((1, 2)))


#: shortest braking, s
SOONEST = 0.1
#: larger rates are impossible for an axis, rad/s
NO_RATE = 1e3


def braked(times, angles, rates, axes):
    """A track with each axis braked at its end in its own time, so none goes farther than needed.

    Parameters
    ----------
    times : ndarray, shape (n,)
        s.
    angles, rates : ndarray, shape (n, 2)
        rad, rad/s.
    axes : sequence of limits.Axis, length 2

    Returns
    -------
    times, angles, rates : ndarray
        With one or two more knots.
    """
    angle, rate = angles[-1], rates[-1]
    own = np.array([max(SOONEST, abs(v) / axis.acceleration)
                    for v, axis in zip(rate.tolist(), axes)])
    if np.ptp(own) < 0.05:
        own[:] = own.max()
    after = np.unique(own)[:, None]
    passed = np.minimum(after, own)
    return (np.concatenate([times, times[-1] + after[:, 0]]),
            np.concatenate([angles, angle + rate * passed * (1.0 - 0.5 * passed / own)]),
            np.concatenate([rates, rate * (1.0 - passed / own)]))


def ended(track, slow):
    """A `Track` that ends at rest: with another knot if the last one has a rate.

    Parameters
    ----------
    track : Track
    slow : sequence of float
        Braking accelerations of the axes, rad/s^2.

    Returns
    -------
    Track
    """
    rate = track.rates[-1]
    if not (np.abs(track.rates).max() < NO_RATE and rate.any()):
        return track  # also with NaN: it will be refused
    brake = max(SOONEST, *(abs(v) / most for v, most in zip(rate.tolist(), slow)))
    return Track(track.start, np.append(track.times, track.times[-1] + brake),
                 np.vstack([track.angles, track.angles[-1] + 0.5 * brake * rate]),
                 np.vstack([track.rates, np.zeros(2)]))
