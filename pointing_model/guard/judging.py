"""Judges a track before it is sent: over all of it, and the whole way of the axes onto it."""

import math

import numpy as np

from msg_tools.units import DEG

from ..earth import TURN_RATE
from .boxes import Boxes, arc, largest_cosine, most_cosine, quartered
from .motion import BENT, FAST, Cubic, Slew, State
from .sun import turned
from .verdicts import Allowed, Refused

_TURN = 2.0 * np.pi
#: longest track, s
LONGEST = 3600.0
#: what is so near to a limit counts as beyond it, rad
NEAR = 0.1 * DEG
#: whoever is beyond a limit may come back: by so much he may seem to go on, rad
SLACK = 0.05 * DEG
#: a way around the Sun, or of axes whose timing is not known, keeps away by so much more: it
#: moves while they go, rad
MARGIN_SUN = 1.0 * DEG
#: a way that seems refused is looked at again with so many boxes for one
FINER = 6
#: boxes into which a way may be cut that passes close by a limit
MOST_BOXES = 20000
#: the same before finer boxes are taken, and where many ways are tried
QUICK = 200
#: knots are apart by so much at least, s
SOON = 1e-6
#: the largest number that is an angle, rad: a hundred turns
NO_ANGLE = 100.0 * _TURN
# of the knots of a track; the methods of arrays take longer to begin
_largest, _smallest = np.maximum.reduce, np.minimum.reduce


class Judge:
    """Judges tracks by the limits of a mount.

    Parameters
    ----------
    limits : limits.Limits

    Attributes
    ----------
    limits : limits.Limits
    keep_out : float
        Distance that is kept from the Sun, rad.
    """

    def __init__(self, limits):
        self.limits, mount = limits, limits.mount
        self._frame = np.array(mount.frame)
        self._zenith = np.array(mount.zenith)
        self._words = mount.names.axes
        self._slow = tuple(axis.acceleration * (limits.timing or 1.0) for axis in limits.axes)
        # without any timing nothing is known of when either
        self.keep_out = limits.sun + (MARGIN_SUN if limits.sun and not limits.timing else 0.0)
        self._straight = bool(np.allclose(self._frame, np.eye(3)))

    def judge(self, times, angles, rates, state, sun=None, pole=None, turns=None):
        """Judge a track from where the axes are.

        Parameters
        ----------
        times : array_like, shape (n,)
            Of the knots, s from now; the first is not after it.
        angles, rates : array_like, shape (n, 2)
            rad, rad/s; cubic in between.
        state : State
            Of the axes now, the first on the turn that it is on.
        sun : ndarray, shape (3,), optional
            East, north, up of the Sun now; None: it is no matter.
        pole : ndarray, shape (3,), optional
            The same of the celestial north pole, about which the Sun turns; None: it stands.
        turns : int, optional
            Whole turns to add to the azimuth; without, those to the nearest that it can take.

        Returns
        -------
        Allowed or Refused
        """
        times, angles, rates = (np.asarray(v, float) for v in (times, angles, rates))
        reason = self._no_track(times, angles, rates, state)
        if reason:
            return Refused(reason)
        cubic = Cubic(times, angles, rates)
        reason = self._too_fast(cubic)
        if reason:
            return Refused(reason)
        turns = self._turns(cubic, state.angles[0]) if turns is None else turns
        second = 0 if self.limits.mount.altaz else self._middle(cubic, 1)
        if turns or second:
            cubic = cubic.turned(turns, second)
        reason = self._track_out_of_travel(cubic)
        if reason:
            return Refused(reason)
        return self._way(cubic, state, self.in_axes(sun, pole, state), True)

    def onto(self, cubic, here, sun=None, pole=None, quick=False):
        """As `judge`, of a slew from rest at a pair of angles onto a `Cubic` that is allowed.

        What is `quick` may refuse more.
        """
        state = State(tuple(here))
        return self._way(cubic, state, self.in_axes(sun, pole, state), quick=quick)

    def way(self, here, there, sun=None, pole=None, quick=False):
        """As `onto`, of a slew from rest to rest between two pairs of angles."""
        cubic = Cubic(np.zeros(1), np.array([there], float), np.zeros((1, 2)))
        return self.onto(cubic, here, sun, pole, quick)

    def other_turns(self, cubic, state):
        """The same track on the other turns that the azimuth's travel has room for, nearest first.

        Parameters
        ----------
        cubic : Cubic
        state : State

        Returns
        -------
        list of Cubic
        """
        if not self.limits.mount.altaz:
            return []
        axis, first = self.limits.axes[0], float(cubic.angles[0, 0])
        brake = cubic.brakes(self._slow)[0]
        turns = [n for n in range(math.ceil((axis.low - cubic.low[0] + brake) / _TURN),
                                  math.floor((axis.high - cubic.high[0] - brake) / _TURN) + 1)
                 if n]
        turns.sort(key=lambda n: abs(first + n * _TURN - state.angles[0]))
        return [cubic.turned(n) for n in turns[:2]]

    def free(self, boxes, sun):
        """Which of many boxes are surely free of horizon and Sun (of `in_axes`), bool (n,)."""
        above, apart = self._clearances(boxes, sun)[0]
        return above >= 0.0 if sun is None else (above >= 0.0) & (
            apart >= self.keep_out)

    def _way(self, cubic, state, sun, track=False, quick=False):
        """Judge the way onto a track and, if told so, what it passes of the sky itself."""
        if self._surely_clear(cubic, state, sun):
            return Allowed(cubic)
        reason = track and self._begins_out(cubic, sun) and self.where_not(cubic.points(), sun)
        if reason:
            return Refused(f'the track {reason}')
        try:
            slew = Slew(state, cubic, self.limits.axes, self.limits.timing)
        except ValueError as err:
            return Refused(f'{self._words[err.args[0]]} cannot catch up with the track: ask for a '
                           'slower one')
        refused = self.where_not(slew.passed(), sun, state)  # tells soon what is told mostly
        boxes = None if refused else slew.boxes()
        out = not refused and self._out_of_travel(boxes, 'the way to it', state)
        track = None if not track or self._track_clear(cubic, sun) else cubic.boxes(self._slow)
        if refused or out or not self._surely_free(boxes, track, sun):
            reason = track is not None and self.where_not(track, sun)
            if reason:
                return Refused(f'the track {reason}')
            if out:
                return Refused(out, cubic)
            reason = refused or self.where_not(boxes, sun, state, QUICK)
            if reason and not refused and not quick:  # it may be both axes of two moments
                reason = self.where_not(slew.boxes(FINER), sun, state)
            if reason:
                return Refused(f'the way to the track {reason}', cubic)
        return Allowed(cubic)

    def _surely_clear(self, cubic, state, sun):
        """Whether all pairs of angles between begin and track are far from everything.

        Most slews are found to be free so, however the axes go, in a tenth of the time.
        """
        limits, ends, seconds = self.limits, [], float(cubic.times[-1])
        for i, axis in enumerate(limits.axes):
            here, rate, slow = state.angles[i], state.rates[i], self._slow[i]
            peak = float(cubic.peak_rate[i])
            if peak > FAST:
                return False
            low, high = min(here, cubic.low[i]), max(here, cubic.high[i])
            seconds = max(seconds, 1.1 * (high - low + peak * seconds) / (
                axis.rate * (limits.timing or 0.1)) + 2.0 * (axis.rate + abs(rate)) / slow)
            stop = here + 0.5 * rate * abs(rate) / slow
            low = min(low, stop) - BENT - peak * peak / slow
            high = max(high, stop) + BENT + peak * peak / slow
            if low < axis.low or high > axis.high:
                return False
            ends.append((low, high))
        return self._clear(*ends, sun, seconds)

    def _track_clear(self, cubic, sun):
        """Whether all pairs of angles of a track are far from everything, stopped on it or not."""
        ends = [(low - brake - BENT, high + brake + BENT) for low, high, brake in zip(
            cubic.low, cubic.high, cubic.brakes(self._slow))]
        return self._clear(*ends, sun, float(cubic.times[-1]))

    def _clear(self, first, second, sun, seconds):
        """Whether all pairs of angles between two ends of each axis are far from everything."""
        if self._straight and second[1] <= 0.5 * math.pi and second[0] >= -0.5 * math.pi:
            lowest = second[0]
        else:
            lowest = math.asin(max(min(-largest_cosine(-self._zenith, first, second), 1.0), -1.0))
        if lowest < self.limits.horizon.top:
            return False
        if sun is None:
            return True
        near = math.acos(max(min(largest_cosine(sun[0], first, second), 1.0), -1.0))
        return near > self.keep_out + TURN_RATE * seconds + BENT

    # --- the track by itself ------------------------------------------------------------------

    def _no_track(self, times, angles, rates, state):
        if not (times.ndim == 1 and len(times) and angles.shape == rates.shape == (len(times), 2)):
            return 'no track: give times, and angles and rates of both axes for each'
        # what is largest is not finite where any is not, nor is a step beside it
        largest = _largest(np.abs(np.concatenate((angles, rates), 1)))
        step = float(_smallest(times[1:] - times[:-1], initial=np.inf)) if len(times) > 1 else 1.0
        if not all(map(math.isfinite, (*largest.tolist(), step, times[0], times[-1]))):
            return 'a track with a value that is not finite: give numbers'
        if not all(map(math.isfinite, (*state.angles, *state.rates))):
            return 'where the axes stand is not known: home the mount, or wait for its encoder'
        if step < SOON:
            return 'times of the track do not increase: give the knots in their order'
        if max(largest[2:]) > NO_ANGLE:
            return 'a rate of the track that is none of an axis: give radians a second'
        if times[0] > 1.0 or times[-1] < 0.0:
            return (f'a track from {times[0]:.1f} to {times[-1]:.1f} s from now: '
                    'send one that is of now')
        if times[-1] - times[0] > LONGEST + 60.0:  # and braking at its end
            return (f'a track of {times[-1] - times[0]:.0f} s: send {LONGEST:.0f} s at most, '
                    'and the next one in time')
        if len(times) == 1 and rates.any():
            return 'a track of one knot with a rate has no end: give the last knot too'
        if max(largest[:2]) > NO_ANGLE:
            i = int(largest[:2].argmax())
            return (f'{self._words[i]} {largest[i]:.6g} rad is no angle of an axis: '
                    'give radians')
        return ''

    def _turns(self, cubic, here):
        """Whole turns to add to the first axis: the nearest that its travel has room for."""
        axis = self.limits.axes[0]
        nearest = (round((here - float(cubic.angles[0, 0])) / _TURN) if self.limits.mount.altaz
                   else self._middle(cubic, 0))
        brake = cubic.brakes(self._slow)[0]
        fewest = math.ceil((axis.low - cubic.low[0] + brake) / _TURN)
        most = math.floor((axis.high - cubic.high[0] - brake) / _TURN)
        if fewest > most:
            return 0
        return min(max(nearest, fewest), most)

    def _middle(self, cubic, i):
        """Whole turns that lead nearest to the middle of the travel of an axis."""
        axis = self.limits.axes[i]
        return round((0.5 * (axis.low + axis.high) - float(cubic.angles[0, i])) / _TURN)

    def _too_fast(self, cubic):
        # an axis at its slowest that falls behind the track is anywhere beside it
        least = self.limits.timing or 1.0
        sure = ', with which it surely follows (slew_timing)' if least < 1.0 else ''
        for i, (axis, word) in enumerate(zip(self.limits.axes, self._words)):
            rate, bend = float(cubic.peak_rate[i]), float(cubic.peak_acceleration[i])
            most, sharpest = least * axis.rate, least * axis.acceleration
            if not rate <= most:  # one that is no number neither
                return (f'{word} at {rate / DEG:.3g} deg/s on the track is faster than '
                        f'{most / DEG:.3g} deg/s{sure}: ask for a slower one')
            if not bend <= sharpest:
                return (f'{word} at {bend / DEG:.3g} deg/s^2 on the track is over '
                        f'{sharpest / DEG:.3g} deg/s^2{sure}: ask for a smoother one')
        return ''

    def _track_out_of_travel(self, cubic):
        for i, brake in enumerate(cubic.brakes(self._slow)):
            reason = self._beyond(i, cubic.low[i] - brake, cubic.high[i] + brake, 'the track')
            if reason:
                return reason
        return ''

    def _out_of_travel(self, boxes, what, state):
        # the ends of a way onto a track are the outermost of it, but for braking at first
        low, high = (boxes.low.min(1) + boxes.pad[:, 0]), (boxes.high.max(1) - boxes.pad[:, 0])
        for i, (here, rate) in enumerate(zip(state.angles, state.rates)):
            stop = here + rate * abs(rate) / (2.0 * self._slow[i])
            # whoever stands outside may come back
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

    # --- the sky ------------------------------------------------------------------------------

    def in_axes(self, sun, pole, state):
        """Sun and pole in the frame of the axes; None where the Sun is no matter from `state`."""
        if sun is None or not self.limits.sun:
            return None
        # one that is so low is out of reach of all that is above the horizon, or the begin
        first, second = state.angles
        x, y, z = self._zenith
        up = math.cos(second) * (x * math.sin(first) + y * math.cos(first)) + z * math.sin(second)
        lowest = min(self.limits.horizon.least, math.asin(min(max(up, -1.0), 1.0)))
        if math.asin(min(max(float(sun[2]), -1.0), 1.0)) + self.limits.sun < lowest - 15.0 * DEG:
            return None
        return self._frame @ sun, None if pole is None else self._frame @ pole

    def _surely_free(self, boxes, track, sun):
        """Whether way and track are far from all limits; most are, and this takes less time."""
        if track is not None:
            boxes = Boxes(np.concatenate([boxes.low, track.low], 1),
                          np.concatenate([boxes.high, track.high], 1),
                          np.concatenate([boxes.time, track.time]))
        if sun is None:
            return bool((self._clearances(boxes, None, False)[0][0] >= 0.0).all())
        above, apart = self._clearances(boxes, (sun[0], None), False)[0]
        far = self.keep_out + TURN_RATE * max(boxes.time[-1], 0.0) + 0.1 * DEG
        return bool((above >= 0.0).all() and (apart >= far).all())

    def _begins_out(self, cubic, sun):
        """Whether a track seems to begin where nothing may be: a first look."""
        place, az, el = self._seen(*cubic.angles[0].tolist())
        if el < self.limits.horizon.over(az):
            return True
        return sun is not None and float(sun[0] @ place) > math.cos(min(self.keep_out, math.pi))

    def _seen(self, a, b):
        """Direction of angles of the axes in their frame; azimuth and elevation of it, floats."""
        place = np.array([math.cos(b) * math.sin(a), math.cos(b) * math.cos(a), math.sin(b)])
        x, y, z = (place @ self._frame).tolist()
        return place, math.atan2(x, y), math.asin(min(max(z, -1.0), 1.0))

    def where_not(self, boxes, sun=None, state=None, most=MOST_BOXES):
        """Why the axes may not be at all pairs of angles of boxes, '' if they may.

        Parameters
        ----------
        boxes : Boxes
        sun : tuple, optional
            Of `in_axes`.
        state : State, optional
            Where they are: from where a limit is passed already, the way may lead back.
        most : int
            Boxes into which they may be cut.
        """
        lowest, begin = 0.0, None
        done, exact = 0, False
        cleared = self._clearances(boxes, sun, exact)
        while True:
            (above, apart), (above_here, apart_here), half = cleared
            sure = above >= lowest
            if sun is not None:
                near_sun = self.keep_out if begin is None else np.minimum(
                    self.keep_out, self._stayed(begin, boxes.time, sun) - SLACK)
                sure &= apart >= near_sun
            if sure.all():
                return ''
            if state is not None:
                (place, az, el), here, state = self._seen(*state.angles), state.angles, None
                above = el - self.limits.horizon.over(az) - SLACK
                if sun is not None and math.acos(min(max(float(sun[0] @ place), -1.0), 1.0)) - (
                        SLACK) < self.keep_out + TURN_RATE * float(boxes.time.max()):
                    begin = np.array(here)[:, None]
                if begin is not None or above < lowest:
                    lowest = min(lowest, above)
                    continue
            bad = above_here < lowest
            if sun is not None:
                bad |= apart_here < near_sun
            if exact:
                bad |= ~sure & (half < NEAR / 2.0)
                done += len(sure)
            if bad.any() or done > most:
                i = int(np.argmax(bad if bad.any() else ~sure))
                return self._said(boxes, i, above_here[i] < lowest + NEAR or sun is None, sun)
            boxes = quartered(boxes, ~sure) if exact else boxes.of(~sure)
            exact = not exact
            cleared = self._clearances(boxes, sun, exact)

    def _stayed(self, begin, time, sun):
        """How near the Sun comes by itself to where the axes began, at the time of each box."""
        there = np.repeat(begin, len(time), axis=1)
        return self._clearances(Boxes(there, there, time), sun, False)[1][1]

    def _clearances(self, boxes, sun, exact=True):
        """Elevation above the horizon and distance from the Sun: least in a box, in its middle.

        And half the size of each box on the sky. What is not `exact` is too small and quick.
        """
        if boxes.low is boxes.high:
            (a, b), ha, half, exact = boxes.low, 0.0, np.zeros(boxes.low.shape[1]), False
            cos_b, hb = np.cos(b), 0.0
        else:
            a, b = 0.5 * (boxes.low + boxes.high)
            ha, hb = 0.5 * (boxes.high - boxes.low)
            cos_b = np.cos(b)
            half = np.hypot(np.minimum(np.abs(cos_b) + hb, 1.0) * ha, hb)
        place = np.array([cos_b * np.sin(a), cos_b * np.cos(a), np.sin(b)])
        el = arc(np.arcsin, self._zenith @ place)
        lowest = arc(np.arcsin, -most_cosine(-self._zenith, boxes)) if exact else el - half
        horizon = self.limits.horizon
        if horizon.flat or lowest.min(initial=np.inf) >= horizon.top:
            above_here, above = el - horizon.top, lowest - horizon.top
        else:
            az = a if self._straight and not np.any(cos_b < 0.0) else np.arctan2(
                *(self._frame.T @ place)[:2])
            above_here = above = el - horizon.at(az)
            if boxes.low is not boxes.high:  # of all that is so near on the sky
                share = np.sin(np.minimum(half, np.pi / 2.0)) / np.maximum(np.cos(el), 1e-9)
                wide = np.where((share < 1.0) & (half < np.pi / 2.0),
                                np.arcsin(np.minimum(share, 1.0)), np.pi)
                if self._straight:
                    wide = np.where(np.abs(b) + hb < np.pi / 2.0, np.minimum(ha, wide), wide)
                above = lowest - horizon.highest(az, wide)
        if sun is None:
            return (above, None), (above_here, None), half
        toward, pole = sun
        if pole is not None:
            toward = turned(toward, pole, boxes.time)
        apart_here = arc(np.arccos, np.sum(toward.T * place.T, -1))
        apart = arc(np.arccos, most_cosine(toward, boxes)) if exact else apart_here - half
        return (above, apart), (above_here, apart_here), half

    def _said(self, boxes, i, horizon, sun):
        _, az, el = self._seen(*(0.5 * (boxes.low[:, i] + boxes.high[:, i])).tolist())
        where = f'azimuth {np.mod(az, _TURN) / DEG:.1f} deg, elevation {el / DEG:.1f} deg'
        if horizon:
            least = self.limits.horizon.over(az) / DEG
            return (f'comes below the horizon of {least:.1f} deg at {where}: choose a higher '
                    'target')
        return (f'comes within {self.limits.sun / DEG:g} deg of the Sun at {where}: choose '
                'another target or wait')
