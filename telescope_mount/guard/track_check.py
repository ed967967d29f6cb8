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

"""Checks a whole track before it is sent, and the whole way of the axes onto it."""

import math
from operator import sub
from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG

from .axis_track import BENT, Cubic, resting
from .motion import FAST, AxisState, Slew
from .sky_clearance import SkyClearance

_TURN = 2.0 * np.pi
#: longest track, s
LONGEST = 3600.0
#: factor by which the boxes of an apparently refused way are refined
FINER = 6
#: largest number of boxes before refinement, and when many ways are tried
QUICK = 200
#: largest number of bisections of a slew in time, and of the possible angles in space, before it is
#: checked in boxes
IN_TIME, IN_SPACE = 5, 4
#: least interval between knots, s
SOON = 1e-6
#: factor on a limit for rounding
ROUNDED = 1.0 + 1e-9
#: larger numbers are not angles, rad: a hundred turns
NO_ANGLE = 100.0 * _TURN


class Allowed(NamedTuple):
    """A track that may be sent.

    Attributes
    ----------
    cubic : Cubic
        Its knots, with the first axis on the turn that the mount uses.
    """

    cubic: Cubic


class Refused(NamedTuple):
    """A refused track: one line that says what is wrong, where, and what to do.

    Attributes
    ----------
    reason : str
    cubic : Cubic or None
        The track, if it could be followed and only the way onto it is refused.
    """

    reason: str
    cubic: Cubic | None = None


class TrackCheck:
    """Checks tracks against the limits of a mount.

    Parameters
    ----------
    limits : limits.Limits

    Attributes
    ----------
    limits : limits.Limits
    sky : sky_clearance.SkyClearance
    """

    def __init__(self, limits):
        self.limits, self.sky = limits, SkyClearance(limits)
        self._words = limits.mount.names.axes
        self._slow = tuple(axis.acceleration * (limits.timing or 1.0) for axis in limits.axes)

    def check(self, times, angles, rates, state, circles=(), turns=None):
        """Check a track from the present axis state.

        Parameters
        ----------
        times : array_like, shape (n,)
            Times of the knots, s from now; the first is not later than now.
        angles, rates : array_like, shape (n, 2)
            rad, rad/s; cubic in between.
        state : AxisState
            Present axis state, the first axis on its actual turn.
        circles : sequence of sky_limits.Circle, optional
            Circles that the tube must avoid, at present: east, north, up.
        turns : int, optional
            Whole turns to add to the azimuth; by default those to the closest possible turn.

        Returns
        -------
        Allowed or Refused
        """
        times, angles, rates = (np.asarray(v, float) for v in (times, angles, rates))
        if not (times.ndim == 1 and len(times) and angles.shape == rates.shape == (len(times), 2)):
            return Refused('no track: give times, and angles and rates of both axes for each')
        cubic = Cubic(times, angles, rates)
        reason = self._no_track(cubic, state) or self._too_fast(cubic)
        if reason:
            return Refused(reason)
        turns = self._turns(cubic, state.angles[0]) if turns is None else turns
        second = 0 if self.limits.mount.vertical else self._middle(cubic, 1)
        if turns or second:
            cubic = cubic.turned(turns, second)
        reason = self._track_out_of_travel(cubic)
        if reason:
            return Refused(reason)
        return self._way(cubic, state, self.sky.in_axes(circles, state), True)

    def onto(self, cubic, here, circles=(), quick=False):
        """Check a slew from rest at a pair of angles onto an allowed `Cubic`.

        With `quick` more may be refused.
        """
        state = AxisState(tuple(here))
        return self._way(cubic, state, self.sky.in_axes(circles, state), quick=quick)

    def way(self, here, there, circles=(), quick=False):
        """Check a slew from rest to rest between two pairs of angles; see `onto`."""
        return self.onto(resting(there), here, circles, quick)

    def other_turns(self, cubic, state):
        """The same track on the other possible turns of the azimuth, the closest first.

        Parameters
        ----------
        cubic : Cubic
        state : AxisState

        Returns
        -------
        list of Cubic
        """
        if not self.limits.mount.vertical:
            return []
        axis, first = self.limits.axes[0], float(cubic.angles[0, 0])
        brake = cubic.brakes(self._slow)[0]
        turns = [n for n in range(math.ceil((axis.low - cubic.low[0] + brake) / _TURN),
                                  math.floor((axis.high - cubic.high[0] - brake) / _TURN) + 1)
                 if n]
        turns.sort(key=lambda n: abs(first + n * _TURN - state.angles[0]))
        return [cubic.turned(n) for n in turns[:2]]

    def _way(self, cubic, state, circles, track=False, quick=False):
        """Check the way onto a track and, with `track`, the sky along the track itself."""
        if self._surely_clear(cubic, state, circles):
            return Allowed(cubic)
        reason = track and self.sky.why_not(*cubic.angles[0].tolist(), float(cubic.times[0]),
                                            circles)
        if reason:
            return Refused(f'the track {reason}')
        if track and not self._track_clear(cubic, circles):
            reason = self.sky.where_not(cubic.boxes(self._slow), circles)
            if reason:
                return Refused(f'the track {reason}')
        try:
            slew = Slew(state, cubic, self.limits.axes, self.limits.timing)
        except ValueError as err:
            return Refused(f'{self._words[err.args[0]]} cannot catch up with the track: ask for a '
                           'slower one')
        if self._clear_in_parts(slew, state, circles):
            return Allowed(cubic)
        reason = self.sky.where_not(slew.passed(), circles, state)  # fast, and finds most refusals
        if not reason:
            boxes = slew.boxes()
            out = self._out_of_travel(boxes, 'the way to it', state)
            if out:
                return Refused(out, cubic)
            reason = self.sky.where_not(boxes, circles, state, QUICK)
            if reason and not quick:  # a coarse box may combine two moments
                reason = self.sky.where_not(slew.boxes(FINER), circles, state)
        return Refused(f'the way to the track {reason}', cubic) if reason else Allowed(cubic)

    def _surely_clear(self, cubic, state, circles):
        """Whether all pairs of angles between start and track are surely allowed.

        This proves most slews safe for any motion of the axes, in a tenth of the time.
        """
        limits, ends, seconds = self.limits, [], float(cubic.times[-1])
        for i, axis in enumerate(limits.axes):
            here, rate, slow = state.angles[i], state.rates[i], self._slow[i]
            peak = cubic.most_rate[i]
            if peak > FAST:
                return False
            low, high = min(here, cubic.hull[0][i]), max(here, cubic.hull[1][i])
            seconds = max(seconds, 1.1 * (high - low + peak * seconds) / (
                axis.rate * (limits.timing or 0.1)) + 2.0 * (axis.rate + abs(rate)) / slow)
            stop = here + 0.5 * rate * abs(rate) / slow
            low = min(low, stop) - BENT - peak * peak / slow
            high = max(high, stop) + BENT + peak * peak / slow
            if low < axis.low or high > axis.high:
                return False
            ends.append((low, high))
        return self.sky.surely_clear(*ends, circles, seconds)

    def _clear_in_parts(self, slew, state, circles):
        """Whether all possible pairs of angles in each part of a slew are surely allowed.

        Parts that are too close are bisected: fewer and larger parts than `Slew.boxes`, in floats.
        """
        whole = slew.outermost(0.0, slew.arrival)
        for axis, here, rate, slow, (low, high) in zip(self.limits.axes, *state, self._slow, whole):
            stop = here + rate * abs(rate) / (2.0 * slow)
            if min(low, stop) < min(axis.low, here) or max(high, stop) > max(axis.high, here):
                return False
        in_time = 0 if slew.chases or not self.limits.timing else IN_TIME
        parts = [(0.0, slew.arrival, in_time)]
        while parts:
            begin, end, left = parts.pop()
            ends = slew.outermost(begin, end) if left < in_time else whole
            if self.sky.surely_clear(*ends, circles, end):
                continue
            if left:
                half = 0.5 * (begin + end)
                parts += (half, end, left - 1), (begin, half, left - 1)
            elif not self._clear_in_space(*ends, circles, end):
                return False
        return True

    def _clear_in_space(self, first, second, circles, seconds, left=IN_SPACE):
        if not left:
            return False
        halves = ((_halves(first), (second, second)) if first[1] - first[0] > second[1] - second[0]
                  else ((first, first), _halves(second)))
        return all(self.sky.surely_clear(a, b, circles, seconds)
                   or self._clear_in_space(a, b, circles, seconds, left - 1)
                   for a, b in zip(*halves))

    def _track_clear(self, cubic, circles):
        """Whether all pairs of angles of a track are surely allowed, even if stopped on it."""
        ends = [(low - BENT, high + BENT) for low, high in cubic.surely_within(self._slow)]
        return self.sky.surely_clear(*ends, circles, float(cubic.times[-1]))

    # --- the track by itself ------------------------------------------------------------------

    def _no_track(self, cubic, state):
        knots, angles, rates = cubic.knots
        speeds, places = rates[0] + rates[1], angles[0] + angles[1]
        if not math.isfinite(sum(knots) + sum(places) + sum(speeds)) and not all(
                map(math.isfinite, (*knots, *places, *speeds))):
            return 'a track with a value that is not finite: give numbers'
        if not all(map(math.isfinite, (*state.angles, *state.rates))):
            return 'where the axes stand is not known: home the mount, or wait for its encoder'
        if len(knots) > 1 and min(map(sub, knots[1:], knots)) < SOON:
            return 'times of the track do not increase: give the knots in their order'
        if max(map(abs, speeds)) > NO_ANGLE:
            return 'a rate of the track is too high for an axis: give radians a second'
        if knots[0] > 1.0 or knots[-1] < 0.0:
            return (f'a track from {knots[0]:.1f} to {knots[-1]:.1f} s from now: '
                    'send one that includes now')
        if knots[-1] - knots[0] > LONGEST + 60.0:  # with braking at its end
            return (f'a track of {knots[-1] - knots[0]:.0f} s: send {LONGEST:.0f} s at most, '
                    'and the next one in time')
        if len(knots) == 1 and any(speeds):
            return 'a track of one knot with a rate has no end: give the last knot too'
        if max(map(abs, places)) > NO_ANGLE:
            largest = [max(map(abs, of)) for of in angles]
            i = largest.index(max(largest))
            return (f'{self._words[i]} {largest[i]:.6g} rad is too large for an axis: '
                    'give radians')
        return ''

    def _turns(self, cubic, here):
        """Whole turns to add to the first axis: the closest that fit into its travel."""
        axis = self.limits.axes[0]
        nearest = (round((here - float(cubic.angles[0, 0])) / _TURN) if self.limits.mount.vertical
                   else self._middle(cubic, 0))
        low, high = cubic.surely_within(self._slow)[0]
        if axis.low - low <= nearest * _TURN <= axis.high - high:
            return nearest
        brake = cubic.brakes(self._slow)[0]
        fewest = math.ceil((axis.low - cubic.low[0] + brake) / _TURN)
        most = math.floor((axis.high - cubic.high[0] - brake) / _TURN)
        if fewest > most:
            return 0
        return min(max(nearest, fewest), most)

    def _middle(self, cubic, i):
        """Whole turns to the place closest to the middle of the travel of an axis."""
        axis = self.limits.axes[i]
        return round((0.5 * (axis.low + axis.high) - float(cubic.angles[0, i])) / _TURN)

    def _too_fast(self, cubic):
        # the place of an axis at its slowest that falls behind the track is unknown
        least = self.limits.timing or 1.0
        sure = ', with which it surely follows (slew_timing)' if least < 1.0 else ''
        for i, (axis, word) in enumerate(zip(self.limits.axes, self._words)):
            rate, bend = cubic.most_rate[i], cubic.peak_acceleration[i]
            most, sharpest = least * axis.rate, least * axis.acceleration
            if not rate <= most and not (rate := cubic.peak_rate[i]) <= most:  # also false for NaN
                return (f'{word} at {rate / DEG:.3g} deg/s on the track is faster than '
                        f'{most / DEG:.3g} deg/s{sure}: ask for a slower one')
            if not bend <= sharpest * ROUNDED:  # braking at the end uses exactly the limit
                return (f'{word} at {bend / DEG:.3g} deg/s^2 on the track is over '
                        f'{sharpest / DEG:.3g} deg/s^2{sure}: ask for a smoother one')
        return ''

    def _track_out_of_travel(self, cubic):
        if all(axis.low <= low and high <= axis.high for axis, (low, high) in zip(
                self.limits.axes, cubic.surely_within(self._slow))):
            return ''
        for i, brake in enumerate(cubic.brakes(self._slow)):
            reason = self._beyond(i, cubic.low[i] - brake, cubic.high[i] + brake, 'the track')
            if reason:
                return reason
        return ''

    def _out_of_travel(self, boxes, what, state):
        # the ends of a way onto a track are its extremes, except for initial braking
        low, high = (boxes.low.min(1) + boxes.pad[:, 0]), (boxes.high.max(1) - boxes.pad[:, 0])
        for i, (here, rate) in enumerate(zip(state.angles, state.rates)):
            stop = here + rate * abs(rate) / (2.0 * self._slow[i])
            # an axis outside its travel may come back
            reason = self._beyond(i, min(low[i], stop), max(high[i], stop), what, here)
            if reason:
                return reason
        return ''

    def _beyond(self, i, low, high, what, here=None):
        axis = self.limits.axes[i]
        least, most = axis.low, axis.high
        if here is not None:
            least, most = min(least, here), max(most, here)
        if low >= least - 1e-9 and high <= most + 1e-9:
            return ''
        return (f'{self._words[i]} of {what} from {low / DEG:.1f} to {high / DEG:.1f} deg leaves '
                f'its travel of {axis.low / DEG:g} to {axis.high / DEG:g} deg: choose another '
                'target or the other side')


def _halves(ends):
    middle = 0.5 * (ends[0] + ends[1])
    return (ends[0], middle), (middle, ends[1])
