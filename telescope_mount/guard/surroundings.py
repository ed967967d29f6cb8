"""Horizon and Sun: how near a mount comes to them at pairs of angles of its axes."""

import math

import numpy as np

from msg_tools.units import DEG
from pointing_model.sky.earth import TURN_RATE
from pointing_model.sky.sun import turned

from .axis_track import BENT
from .boxes import Boxes, arc, largest_cosine, most_cosine, quartered

_TURN = 2.0 * np.pi
#: what is so near to a limit counts as beyond it, rad
NEAR = 0.1 * DEG
#: whoever is beyond a limit may come back: by so much he may seem to go on, rad
SLACK = 0.05 * DEG
#: a way around the Sun, or of axes whose timing is not known, keeps away by so much more: it
#: moves while they go, rad
MARGIN_SUN = 1.0 * DEG
#: boxes into which a way may be cut that passes close by a limit
MOST_BOXES = 20000


class Surroundings:
    """What is about a mount.

    Parameters
    ----------
    limits : limits.Limits

    Attributes
    ----------
    keep_out : float
        Distance that is kept from the Sun, rad.
    """

    def __init__(self, limits):
        self.limits, mount = limits, limits.mount
        self._frame = np.array(mount.frame)
        self._columns = self._frame.T.tolist()
        self._zenith = np.array(mount.zenith)
        self._nadir = (-self._zenith).tolist()
        # without any timing nothing is known of when either
        self.keep_out = limits.sun + (MARGIN_SUN if limits.sun and not limits.timing else 0.0)
        self._straight = bool(np.allclose(self._frame, np.eye(3)))

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

    def free(self, boxes, sun):
        """Which of many boxes are surely free of horizon and Sun (of `in_axes`), bool (n,)."""
        above, apart = self._clearances(boxes, sun)[0]
        return above >= 0.0 if sun is None else (above >= 0.0) & (
            apart >= self.keep_out)

    def surely_clear(self, first, second, sun, seconds):
        """Whether all pairs of angles between two ends of each axis are far from everything."""
        if self._straight and second[1] <= 0.5 * math.pi and second[0] >= -0.5 * math.pi:
            lowest = second[0]
        else:
            lowest = math.asin(max(min(-largest_cosine(self._nadir, first, second), 1.0), -1.0))
        if lowest < self.limits.horizon.top and lowest < self._skyline(first, second):
            return False
        if sun is None:
            return True
        near = math.acos(max(min(largest_cosine(sun[0], first, second), 1.0), -1.0))
        return near > self.keep_out + TURN_RATE * seconds + BENT

    def _skyline(self, first, second):
        """The highest of the horizon behind all pairs of angles between two ends of each axis."""
        horizon = self.limits.horizon
        if horizon.flat:
            return horizon.top
        if self._straight and max(second[1], -second[0]) <= 0.5 * math.pi:
            return horizon.highest_between(*first)
        a, b = 0.5 * (first[0] + first[1]), 0.5 * (second[0] + second[1])
        ha, hb = 0.5 * (first[1] - first[0]), 0.5 * (second[1] - second[0])
        half = math.hypot(min(abs(math.cos(b)) + hb, 1.0) * ha, hb)
        _, az, el = self._seen(a, b)
        if half + abs(el) >= 0.5 * math.pi:
            return horizon.top
        wide = math.asin(min(math.sin(half) / math.cos(el), 1.0))
        return horizon.highest_between(az - wide, az + wide)

    def why_not(self, first, second, time, sun):
        """Why the axes may not be at a pair of angles at a time, '' if they may.

        Parameters
        ----------
        first, second : float
            rad.
        time : float
            s from now.
        sun : tuple or None
            Of `in_axes`.
        """
        place, az, el = self._seen(first, second)
        if el < self.limits.horizon.over(az):
            return self._said(az, el, True)
        if sun is None:
            return ''
        toward, pole = sun
        near = math.cos(min(self.keep_out, math.pi))
        if float(toward @ place) <= math.cos(min(self.keep_out + TURN_RATE * abs(time), math.pi)):
            return ''
        if pole is not None:
            toward = turned(toward, pole, time)
        return self._said(az, el, False) if float(toward @ place) > near else ''

    def _seen(self, a, b):
        """Direction of angles of the axes in their frame; azimuth and elevation of it, floats."""
        along = math.cos(b)
        place = u, v, w = along * math.sin(a), along * math.cos(a), math.sin(b)
        x, y, z = (u * p + v * q + w * r for p, q, r in self._columns)
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
                _, az, el = self._seen(*(0.5 * (boxes.low[:, i] + boxes.high[:, i])).tolist())
                return self._said(az, el, sun is None or above_here[i] < lowest + NEAR)
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

    def _said(self, az, el, horizon):
        where = f'azimuth {np.mod(az, _TURN) / DEG:.1f} deg, elevation {el / DEG:.1f} deg'
        if horizon:
            least = self.limits.horizon.over(az) / DEG
            return (f'comes below the horizon of {least:.1f} deg at {where}: choose a higher '
                    'target')
        return (f'comes within {self.limits.sun / DEG:g} deg of the Sun where it passes {where}: '
                'choose another target or wait')
