"""How the axes go: a slew that catches up with a track, then the track, as boxes of axis angles.

A row of `Boxes` holds every pair of angles that the axes may have in a stretch of time, however
much of their speed they use; what must hold of every pair is then asked of all of them at once.
"""

import copy
import math
from bisect import bisect_right
from functools import cached_property
from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG

from .boxes import Boxes, points

#: the boxes of a slew are about so large, rad, and not more than so many
STEP, MOST = 2.0 * DEG, 120
#: a track is cut so that it leaves the straight line between cuts by less, rad
BENT = 0.02 * DEG
#: of each axis, places that are tried where both may go in any order
_ALONG = 9
#: the place of an arrival is known to so much, rad; a target moves so fast at least, rad/s
CLOSE, CREEP = 0.01 * DEG, 0.005 * DEG
#: a track that is faster is run after in ways that are the mount's own, rad/s
FAST = 0.05 * DEG
_AXES = (0, 1)
_largest, _smallest = np.maximum.reduce, np.minimum.reduce  # begin sooner than arrays' methods


class State(NamedTuple):
    """Of both axes: angles, rad, and rates, rad/s."""

    angles: tuple
    rates: tuple = (0.0, 0.0)


class Cubic:
    """A track: cubic Hermite between its knots.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Seconds.
    angles, rates : ndarray, shape (n, 2)
        rad, rad/s.

    Attributes
    ----------
    peak_rate, peak_acceleration : ndarray, shape (2,)
        The largest of each axis, rad/s and rad/s^2.
    low, high : list of float
        Ends of the angles of each axis, rad.
    """

    def __init__(self, times, angles, rates):
        self.times, self.angles, self.rates = times, angles, rates
        if len(times) == 1:
            self.peak_rate, self.peak_acceleration = np.abs(rates[0]), np.zeros(2)
            self._between = np.zeros((0, 2))
            return
        h = (times[1:] - times[:-1])[:, None]
        step = angles[1:] - angles[:-1]
        v0, v1 = rates[:-1], rates[1:]
        mean = step / h
        first = (6.0 * mean - 4.0 * v0 - 2.0 * v1) / h
        last = (-6.0 * mean + 2.0 * v0 + 4.0 * v1) / h
        change = first - last
        at = np.minimum(np.maximum(first / np.where(change == 0.0, 1.0, change), 0.0), 1.0)
        between = v0 + h * (first * at - 0.5 * change * at * at)
        self.peak_rate = np.maximum(_largest(np.abs(rates)), _largest(np.abs(between)))
        bend = np.maximum(np.abs(first), np.abs(last))
        self.peak_acceleration = _largest(bend)
        self._between, self._parts = between, (h, step, v0, v1, bend)

    @cached_property
    def _fine(self):
        """Times and angles of cuts, and by how much the track leaves the lines between them."""
        times, angles = self.times, self.angles
        if len(times) == 1:
            return times, angles, np.zeros(2)
        h, step, v0, v1, bend = self._parts
        squares = bend * (h * h)
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
    def low(self):
        """See above."""
        _, places, bent = self._fine
        return (_smallest(places) - bent).tolist()

    @cached_property
    def high(self):
        """See above."""
        _, places, bent = self._fine
        return (_largest(places) + bent).tolist()

    @cached_property
    def _knots(self):
        """Times, and of each axis angles and rates, as lists: one number is had sooner."""
        return self.times.tolist(), self.angles.T.tolist(), self.rates.T.tolist()

    def turned(self, first, second=0):
        """The same, with whole turns added to the axes."""
        add = np.array([first, second]) * 2.0 * math.pi
        out = copy.copy(self)
        out.__dict__.pop('_knots', None)
        times, places, bent = self._fine
        out.angles, out._fine = self.angles + add, (times, places + add, bent)
        out.low, out.high = (list(map(float, ends + add)) for ends in (self.low, self.high))
        return out

    def at(self, t, axis):
        """Angle and rate of one axis at `t`, floats; the end stands for what is after it."""
        times, angles, rates = self._knots
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
        """Angles of one axis at times `t` (n,), to within `BENT`."""
        return np.interp(t, self._fine[0], self._fine[1][:, axis])

    def change(self, begin, end, axis):
        """By how much the rate of one axis changes at most from `begin` to `end`, rad/s.

        At the end of the track it stands still.
        """
        times = self.times
        first = max(int(times.searchsorted(begin, 'right')) - 1, 0)
        last = max(int(times.searchsorted(end)), first + 1)
        rates = np.concatenate([self.rates[first:last + 1, axis], self._between[first:last, axis]])
        low, high = float(rates.min()), float(rates.max())
        if end > times[-1]:
            low, high = min(low, 0.0), max(high, 0.0)
        return high - low

    def brakes(self, slow):
        """How far each axis goes on at most when it is stopped on the track, rad, floats.

        Parameters
        ----------
        slow : tuple of float
            Accelerations with which the axes brake, rad/s^2.
        """
        return [v * v / (2.0 * a) for v, a in zip(self.peak_rate.tolist(), slow)]

    def points(self):
        """`Boxes` of no size: some of its angles, the knots among them."""
        return points(self._fine[1].T, self._fine[0])

    def boxes(self, slow=None):
        """`Boxes` of all of it, and of where the axes come to rest if they are stopped on it.

        Parameters
        ----------
        slow : tuple of float, optional
            As of `brakes`; without, they are not stopped.
        """
        times, angles, bent = self._fine
        if len(times) == 1:
            return points(angles.T, times)
        a, b = angles[:-1].T, angles[1:].T
        low, high = np.minimum(a, b), np.maximum(a, b)
        if slow is not None and max(self.brakes(slow)) > BENT:
            h = times[1:] - times[:-1]
            bend = 0.5 * self.peak_acceleration[:, None] * h
            rate, slow = (b - a) / h, 2.0 * np.array(slow)[:, None]
            low = low - np.minimum(rate - bend, 0.0) ** 2 / slow
            high = high + np.maximum(rate + bend, 0.0) ** 2 / slow
        pad = bent[:, None] + BENT
        return Boxes(low - pad, high + pad, 0.5 * (times[:-1] + times[1:]))


class Move(NamedTuple):
    """A slew of one axis in the frame of what it catches up with: numbers of its formula.

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
    """How an axis gets from where it is onto a track, as fast as it may.

    Parameters
    ----------
    here, rate : float
        Of the axis, rad and rad/s.
    cubic : Cubic
    axis : int
    top, acceleration : float
        Of the axis, rad/s and rad/s^2.
    close : float
        How well its end must be on the track, rad.

    Returns
    -------
    Move or None
        None where it cannot catch up.
    """
    end = 0.0
    for _ in range(12):
        move = _caught_at(end, here, rate, cubic, axis, top, acceleration)
        if move is None:
            return None
        before, end = end, move.end
        if abs(end - before) * max(abs(move.frame), CREEP) < close:
            return move
    # to and fro, as of a track that bends: where the guess is what comes of it
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
    u, w = min(t, move.t1), min(max(t - move.t1, 0.0), move.t2 - move.t1)
    q = max(t - move.t2, 0.0)
    rate = move.start + move.first * t if t < move.t1 else move.cruise + move.last * q
    return (move.origin + move.frame * t + (move.start + 0.5 * move.first * u) * u
            + move.cruise * w + (move.cruise + 0.5 * move.last * q) * q), move.frame + rate


def along(moves, cubic, t):
    """Angles of slews, and of the track from the end of each on.

    Parameters
    ----------
    moves : sequence of Move, length m
        Those of the first axis and the second in turn.
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
    """Between what each axis may be while it runs after a fast target, whatever it aims at.

    Not farther than it can have come, and between where it was and where the target has been.
    `moves` are the soonest and the latest of either axis.
    """
    fine, places, _ = cubic._fine
    lows, highs = np.empty((2, len(t))), np.empty((2, len(t)))
    for i, axis in enumerate(axes):
        here, rate = state.angles[i], state.rates[i]
        slowest = axis.acceleration * timing
        stop = here + rate * abs(rate) / (2.0 * slowest)
        until = np.searchsorted(fine, t + brakes[i] + np.diff(t[:2]), 'right')
        until = np.clip(until, 1, len(fine) - 1) if len(fine) > 1 else 0 * until
        least = np.minimum.accumulate(places[:, i])[until]
        most = np.maximum.accumulate(places[:, i])[until]
        # with the speed of the target it overshoots, and before it has braked
        over = float(cubic.peak_rate[i]) ** 2 / (2.0 * slowest) + STEP / 4.0
        # and where the target brakes while the axis does, relative to it
        begin, end = min(m.t2 for m in moves[i::2]), max(m.end for m in moves[i::2])
        over += cubic.change(begin, end, i) * abs(moves[-2 + i].cruise) / slowest
        reach = axis.rate * (t + brakes[i])
        lows[i] = np.maximum(np.minimum(min(here, stop), least - over), here - reach)
        highs[i] = np.minimum(np.maximum(max(here, stop), most + over), here + reach)
    return lows, highs, highs


class Slew:
    """The way onto a track, however late either axis is.

    Parameters
    ----------
    state : State
    cubic : Cubic
    axes : sequence of limits.Axis, length 2
    timing : float
        Of `limits.Limits`.

    Raises
    ------
    ValueError
        The track is too fast to be caught up with; the text is the axis, 0 or 1.
    """

    def __init__(self, state, cubic, axes, timing):
        self._state, self._cubic, self._axes, self._timing = state, cubic, axes, timing
        self._chased = float(cubic.peak_rate.max()) > FAST  # how is the mount's own
        if timing == 0.0:
            return
        shares = (1.0, timing) if timing < 1.0 else (1.0,)
        self._moves = []  # of both axes at their fastest, then at their slowest
        for share in shares:
            for i, axis in enumerate(axes):
                move = plan_move(float(state.angles[i]), float(state.rates[i]), cubic, i,
                                 share * axis.rate, share * axis.acceleration)
                if move is None:
                    raise ValueError(i)
                self._moves.append(move)
        # stopped on the way, an axis goes on for as long as it brakes, and the other may stand
        # already; gone on with that speed it covers twice the braking distance; of the slowest
        # drive once
        longer = max(1.0, 0.5 / timing)
        self._brakes = np.array([[longer * abs(move.cruise) / axis.acceleration]
                                 for move, axis in zip(self._moves, axes)])
        way = max(abs(float(cubic.angles[0, i]) - state.angles[i]) for i in _AXES)
        self._count = int(min(max(way / STEP, 8.0), MOST))
        self._arrival = max(move.end for move in self._moves[-2:])

    def _times(self, finer=1):
        count = finer * self._count
        return self._arrival / count * np.arange(count + 1)

    def _lags(self, t):
        return _chased(self._state, self._cubic, self._axes, t, self._brakes[:, 0], self._timing,
                       self._moves)

    def passed(self):
        """Pairs of angles that the axes may have on it: `boxes.points`."""
        state, cubic = self._state, self._cubic
        if self._timing == 0.0:
            ways = [here + np.linspace(0.0, 1.0, _ALONG) * (float(there) - here)
                    for here, there in zip(state.angles, cubic.angles[0])]
            places = np.stack(np.meshgrid(*ways)).reshape(2, -1)
            return points(places, np.full(places.shape[1], 0.5 * cubic.times[-1]))
        t = self._times()
        x = along(self._moves, cubic, np.broadcast_to(t, (len(self._moves), len(t))))
        if self._chased:
            low, high, _ = self._lags(t)
            x = np.clip(x, np.tile(low, (len(x) // 2, 1)), np.tile(high, (len(x) // 2, 1)))
        if len(x) == 2:
            return points(x, t)
        a, b, late_a, late_b = x  # whichever is the slower one
        return points(np.array([np.concatenate([a, late_a, a, late_a]),
                                np.concatenate([b, late_b, late_b, b])]), np.tile(t, 4))

    def boxes(self, finer=1):
        """`Boxes` of it.

        Parameters
        ----------
        finer : int
            So many for one.
        """
        if self._timing == 0.0:  # in any order, at any time: all pairs of what each may pass
            return self._hull()
        t = self._times(finer)
        dt, n = float(t[1]), len(t)
        later = np.concatenate([np.broadcast_to(t, (2, n)), t + self._brakes], 1)
        x = along(self._moves, self._cubic, np.tile(later, (len(self._moves) // 2, 1)))
        near, late, ahead = x[:2, :n], x[-2:, :n], x[:2, n:]
        if self._chased:
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
            if self._chased:  # a target that stops while the axis comes
                brake += cubic.change(-math.inf, math.inf, i) * axis.rate / axis.acceleration
            ends.append((min(here, here + stop, cubic.low[i] - brake),
                         max(here, here + stop, cubic.high[i] + brake)))
        low, high = np.array(ends).T[:, :, None]
        pad = np.full((2, 1), BENT)
        return Boxes(low - pad, high + pad, np.array([0.5 * cubic.times[-1]]), pad)
