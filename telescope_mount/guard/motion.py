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

"""Motion of the axes: a slew that catches up with a track, then the track, as boxes of angles.

A row of `Boxes` contains every pair of angles that the axes may have in an interval of time, at any
fraction of their speed. A condition on all pairs is then checked for all boxes at once.
"""

import math
from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG

from .axis_track import BENT, STEP
from .boxes import Boxes, points

#: largest number of boxes of a slew
MOST = 120
#: number of places per axis that are tried if both may move in any order
_ALONG = 9
#: accuracy of the place of arrival, rad; least assumed speed of a target, rad/s
CLOSE, CREEP = 0.01 * DEG, 0.005 * DEG
#: for faster tracks the mount chooses its own way of catching up, rad/s
FAST = 0.05 * DEG


class AxisState(NamedTuple):
    """State of both axes: angles, rad, and rates, rad/s."""

    angles: tuple
    rates: tuple = (0.0, 0.0)


class Move(NamedTuple):
    """A slew of one axis relative to its target: coefficients of

    ``x(t) = origin + frame t + (start u + first u^2 / 2) + cruise w + (cruise q + last q^2 / 2)``
    with u, w, q the parts of t before `t1`, `t2` and `end`.
    """

    origin: float
    frame: float
    start: float
    first: float
    cruise: float
    last: float
    t1: float
    t2: float
    end: float


def plan_move(here, rate, cubic, axis, top, acceleration, close=CLOSE):
    """Fastest move of an axis from its present state onto a track.

    Parameters
    ----------
    here, rate : float
        Present angle and rate of the axis, rad and rad/s.
    cubic : Cubic
    axis : int
    top, acceleration : float
        Limits of the axis, rad/s and rad/s^2.
    close : float
        Accuracy of its end on the track, rad.

    Returns
    -------
    Move or None
        None if it cannot catch up.
    """
    end = 0.0
    for _ in range(12):
        move = _caught_at(end, here, rate, cubic, axis, top, acceleration)
        if move is None:
            return None
        before, end = end, move.end
        if abs(end - before) * max(abs(move.frame), CREEP) < close:
            return move
    # oscillates, e.g. for a curved track: bisect for the end that reproduces itself
    low, high = 0.0, cubic.times[-1] + 1.0
    while (move := _caught_at(high, here, rate, cubic, axis, top, acceleration)) is not None and (
            move.end > high):
        high *= 2.0
    while move is not None and high - low > 0.01:
        end = 0.5 * (low + high)
        move = _caught_at(end, here, rate, cubic, axis, top, acceleration)
        low, high = (end, high) if move is None or move.end > end else (low, end)
    return move


def _caught_at(end, here, rate, cubic, axis, top, acceleration):
    target, frame = cubic.at(end, axis)
    if end > cubic.times[-1]:
        frame = 0.0
    speed = top - abs(frame)
    if speed <= 0.0:
        return None
    return Move(here, frame, *_trapezoid(target - frame * end - here, rate - frame, speed,
                                         acceleration))


def _trapezoid(distance, rate, top, a):
    beyond = distance - rate * abs(rate) / (2.0 * a)
    sign = math.copysign(1.0, beyond if beyond != 0.0 else rate)
    d, v = sign * distance, sign * rate
    peak = min(math.sqrt(max(a * d + 0.5 * v * v, 0.0)), top)
    t1, t3 = abs(peak - v) / a, peak / a
    rest = d - 0.5 * (peak + v) * t1 - 0.5 * peak * t3
    t2 = t1 + (max(rest, 0.0) / peak if peak > 0.0 else 0.0)
    return (rate, sign * math.copysign(a, peak - v), sign * peak, -sign * a, t1, t2, t2 + t3)


def moment(move, cubic, t, axis):
    """Angle and rate of one axis at `t` (s) of a slew, and of the track after it, floats."""
    if t >= move.end:
        angle, rate = cubic.at(t, axis)
        return angle, rate if t <= cubic.times[-1] else 0.0
    rate = (move.start + move.first * t if t < move.t1
            else move.cruise + move.last * max(t - move.t2, 0.0))
    return _place(move, t), move.frame + rate


def outermost(move, begin, end, low, high):
    """Extreme angles of one axis from `begin` to `end` (s) of a slew, floats.

    Parameters
    ----------
    move : Move
    begin, end : float
        s.
    low, high : float
        Extremes of the track after it, rad.
    """
    t1, t2, last = move.t1, move.t2, move.end
    a, b = _place(move, begin if begin < last else last), _place(move, end if end < last else last)
    least, most = (a, b) if a < b else (b, a)
    if begin < t1 and move.first:  # where it reverses
        t = -(move.start + move.frame) / move.first
        if begin < t < min(end, t1):
            a = _place(move, t)
            least, most = min(least, a), max(most, a)
    if end > t2 and move.last:
        t = t2 - (move.cruise + move.frame) / move.last
        if max(begin, t2) < t < min(end, last):
            a = _place(move, t)
            least, most = min(least, a), max(most, a)
    return (min(least, low), max(most, high)) if end > last else (least, most)


def _place(move, t):
    origin, frame, start, first, cruise, last, t1, t2, _ = move
    u, w, q = ((t, 0.0, 0.0) if t < t1 else (t1, t - t1, 0.0) if t < t2
               else (t1, t2 - t1, t - t2))
    return (origin + frame * t + (start + 0.5 * first * u) * u + cruise * w
            + (cruise + 0.5 * last * q) * q)


def along(moves, cubic, t):
    """Angles of slews, and of the track after the end of each.

    Parameters
    ----------
    moves : sequence of Move, length m
        Slews of the first and the second axis in turn.
    cubic : Cubic
    t : ndarray, shape (m, n)
        Seconds.

    Returns
    -------
    ndarray, shape (m, n)
    """
    origin, frame, start, first, cruise, last, t1, t2, end = np.array(moves).T[:, :, None]
    u = np.minimum(t, t1)
    w = np.minimum(np.maximum(t - t1, 0.0), t2 - t1)
    q = np.minimum(np.maximum(t - t2, 0.0), end - t2)
    x = (origin + frame * np.minimum(t, end) + (start + 0.5 * first * u) * u + cruise * w
         + (cruise + 0.5 * last * q) * q)
    if len(cubic.times) > 1:
        for k, move in enumerate(moves):
            late = t[k] > move.end
            x[k, late] = cubic.near(t[k, late], k % 2)
    return x


def _chased(state, cubic, axes, t, brakes, timing, moves):
    """Bounds of each axis while it chases a fast target, however it aims.

    Each axis is within its reach, and between its start and the past places of the target.
    `moves` are the fastest and the slowest of either axis.
    """
    lows, highs = np.empty((2, len(t))), np.empty((2, len(t)))
    for i, axis in enumerate(axes):
        here, rate = state.angles[i], state.rates[i]
        slowest = axis.acceleration * timing
        stop = here + rate * abs(rate) / (2.0 * slowest)
        least, most = cubic.reached(t + brakes[i] + np.diff(t[:2]), i)
        # overshoot at the speed of the target, until it has braked
        over = cubic.peak_rate[i] ** 2 / (2.0 * slowest) + STEP / 4.0
        # and relative to a target that brakes at the same time
        begin, end = min(m.t2 for m in moves[i::2]), max(m.end for m in moves[i::2])
        over += cubic.change(begin, end, i) * abs(moves[-2 + i].cruise) / slowest
        reach = axis.rate * (t + brakes[i])
        lows[i] = np.maximum(np.minimum(min(here, stop), least - over), here - reach)
        highs[i] = np.minimum(np.maximum(max(here, stop), most + over), here + reach)
    return lows, highs, highs


class Slew:
    """The slew onto a track, for any delay of either axis.

    Parameters
    ----------
    state : AxisState
    cubic : Cubic
    axes : sequence of limits.Axis, length 2
    timing : float
        See `limits.Limits`.

    Attributes
    ----------
    chases : bool
        Whether the track is so fast that the mount chooses its own way onto it.
    arrival : float
        Latest arrival, s; with unknown timing the end of the track.

    Raises
    ------
    ValueError
        The track is too fast to catch up with; the argument is the axis, 0 or 1.
    """

    def __init__(self, state, cubic, axes, timing):
        self._state, self._cubic, self._axes, self._timing = state, cubic, axes, timing
        # then the way is the mount's own
        self.chases = max(cubic.most_rate) > FAST and max(cubic.peak_rate) > FAST
        if timing == 0.0:
            self.arrival = float(cubic.times[-1])
            return
        shares = (1.0, timing) if timing < 1.0 else (1.0,)
        self._moves = []  # both axes at their fastest, then at their slowest
        for share in shares:
            for i, axis in enumerate(axes):
                move = plan_move(state.angles[i], state.rates[i], cubic, i, share * axis.rate,
                                 share * axis.acceleration)
                if move is None:
                    raise ValueError(i)
                self._moves.append(move)
        # an axis stopped on the way moves on while it brakes, and the other may stand already;
        # going on at full speed for that time covers twice the braking distance; for the slowest
        # drive once
        longer = max(1.0, 0.5 / timing)
        self._brakes = [longer * abs(move.cruise) / axis.acceleration
                        for move, axis in zip(self._moves, axes)]
        way = max(abs(there - here) for there, here in zip(cubic.angles[0].tolist(), state.angles))
        self._count = int(min(max(way / STEP, 8.0), MOST))
        self.arrival = max(move.end for move in self._moves[-2:])

    def outermost(self, begin, end):
        """Bounds of both axes from `begin` to `end` (s), stopped in the meantime or not.

        Returns
        -------
        list of (float, float)
            rad.
        """
        if self._timing == 0.0:
            box = self._hull()
            return list(zip(box.low[:, 0].tolist(), box.high[:, 0].tolist()))
        if self.chases:  # the bounds only grow
            dt = self.arrival / self._count
            low, high, _ = self._lags(np.array([end - dt, end]))
            pads = [axis.acceleration * dt * dt / 8.0 + BENT for axis in self._axes]
            return [(a - pad, b + pad) for a, b, pad in zip(
                low[:, 1].tolist(), high[:, 1].tolist(), pads)]
        out = []
        for soon, late, brake, low, high in zip(
                self._moves, self._moves[-2:], self._brakes, *self._cubic.hull):
            a, b = outermost(soon, begin, end + brake, low, high)
            c, d = outermost(late, begin, end, low, high)
            out.append(((a if a < c else c) - BENT, (b if b > d else d) + BENT))
        return out

    def _times(self, finer=1):
        count = finer * self._count
        return self.arrival / count * np.arange(count + 1)

    def _lags(self, t):
        return _chased(self._state, self._cubic, self._axes, t, self._brakes, self._timing,
                       self._moves)

    def passed(self):
        """Possible pairs of angles on the way: `boxes.points`."""
        state, cubic = self._state, self._cubic
        if self._timing == 0.0:
            ways = [here + np.linspace(0.0, 1.0, _ALONG) * (float(there) - here)
                    for here, there in zip(state.angles, cubic.angles[0])]
            places = np.stack(np.meshgrid(*ways)).reshape(2, -1)
            return points(places, np.full(places.shape[1], 0.5 * cubic.times[-1]))
        t = self._times()
        x = along(self._moves, cubic, np.broadcast_to(t, (len(self._moves), len(t))))
        if self.chases:
            low, high, _ = self._lags(t)
            x = np.clip(x, np.tile(low, (len(x) // 2, 1)), np.tile(high, (len(x) // 2, 1)))
        if len(x) == 2:
            return points(x, t)
        a, b, late_a, late_b = x  # either may be the slower one
        return points(np.array([np.concatenate([a, late_a, a, late_a]),
                                np.concatenate([b, late_b, late_b, b])]), np.tile(t, 4))

    def boxes(self, finer=1):
        """`Boxes` of the slew.

        Parameters
        ----------
        finer : int
            Factor by which the number of boxes is increased.
        """
        if self._timing == 0.0:  # any order, any time: all pairs of possible angles
            return self._hull()
        t = self._times(finer)
        dt, n = float(t[1]), len(t)
        later = np.concatenate([np.broadcast_to(t, (2, n)), t + np.array(self._brakes)[:, None]], 1)
        x = along(self._moves, self._cubic, np.tile(later, (len(self._moves) // 2, 1)))
        near, late, ahead = x[:2, :n], x[-2:, :n], x[:2, n:]
        if self.chases:
            near, ahead, late = self._lags(t)
        edges = np.stack([near[:, :-1], near[:, 1:], ahead[:, :-1], ahead[:, 1:], late[:, :-1],
                          late[:, 1:]])
        pad = np.array([[axis.acceleration] for axis in self._axes]) * dt * dt / 8.0 + BENT
        return Boxes(edges.min(0) - pad, edges.max(0) + pad, t[:-1] + 0.5 * dt, pad)

    def _hull(self):
        state, cubic, ends = self._state, self._cubic, []
        for i, axis in enumerate(self._axes):
            here, rate = state.angles[i], state.rates[i]
            brake, stop = cubic.brakes((axis.acceleration,) * 2)[i], rate * abs(rate) / (
                2.0 * axis.acceleration)
            if self.chases:  # a target that stops while the axis approaches
                brake += cubic.change(-math.inf, math.inf, i) * axis.rate / axis.acceleration
            ends.append((min(here, here + stop, cubic.low[i] - brake),
                         max(here, here + stop, cubic.high[i] + brake)))
        low, high = np.array(ends).T[:, :, None]
        pad = np.full((2, 1), BENT)
        return Boxes(low - pad, high + pad, np.array([0.5 * cubic.times[-1]]), pad)
