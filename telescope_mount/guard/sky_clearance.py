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

"""Distance of a mount to the horizon and limits in the sky, and the reason for a refusal."""

import math

import numpy as np

from msg_tools.units import DEG
from pointing_model.sky.earth import TURN_RATE

from .axis_track import BENT
from .boxes import Boxes, arc, largest_cosine, most_cosine, quartered
from .limits import MARGIN, NEAR, SLACK

_TURN = 2.0 * np.pi
#: largest number of boxes into which a way close to a limit is cut
MOST_BOXES = 20000


class SkyClearance:
    """Distance of a mount to the horizon and limits in the sky, and reasons for refusals.

    Parameters
    ----------
    limits : limits.Limits
    """

    def __init__(self, limits):
        self.limits, mount = limits, limits.mount
        self._frame = np.array(mount.frame)
        self._columns = self._frame.T.tolist()
        self._zenith = np.array(mount.zenith)
        self._nadir = (-self._zenith).tolist()
        # with unknown timing the time of each place is unknown
        self._margin = 0.0 if limits.timing else MARGIN
        self._straight = bool(np.allclose(self._frame, np.eye(3)))

    def in_axes(self, circles, state):
        """Circles in the frame of the axes, with margin; only those relevant from `state`."""
        if not circles:
            return ()
        # circles far below the horizon and the start are out of reach
        first, second = state.angles
        x, y, z = self._zenith
        up = math.cos(second) * (x * math.sin(first) + y * math.cos(first)) + z * math.sin(second)
        lowest = min(self.limits.horizon.least, math.asin(min(max(up, -1.0), 1.0))) - 15.0 * DEG
        return tuple(
            circle.later(0.0, self._margin).in_frame(self._frame) for circle in circles
            if math.asin(min(max(float(circle.toward[2]), -1.0), 1.0)) + circle.distance >= lowest)

    def free(self, boxes, circles):
        """Which boxes are surely free of the horizon and of circles from `in_axes`, bool (n,)."""
        above, distances = self._clearances(boxes, circles)[0]
        out = above >= 0.0
        for circle, distance in zip(circles, distances):
            out &= distance >= circle.distance
        return out

    def surely_clear(self, first, second, circles, seconds):
        """Whether all pairs of angles between two ends of each axis are surely allowed."""
        if self._straight and second[1] <= 0.5 * math.pi and second[0] >= -0.5 * math.pi:
            lowest = second[0]
        else:
            lowest = math.asin(max(min(-largest_cosine(self._nadir, first, second), 1.0), -1.0))
        if lowest < self.limits.horizon.top and lowest < self._skyline(first, second):
            return False
        moved = TURN_RATE * seconds + BENT
        return all(math.acos(max(min(largest_cosine(circle.toward, first, second), 1.0), -1.0))
                   > circle.distance + moved for circle in circles)

    def _skyline(self, first, second):
        """Highest horizon behind all pairs of angles between two ends of each axis."""
        horizon = self.limits.horizon
        if horizon.flat:
            return horizon.top
        if self._straight and max(second[1], -second[0]) <= 0.5 * math.pi:
            return horizon.highest_between(*first)
        a, b = 0.5 * (first[0] + first[1]), 0.5 * (second[0] + second[1])
        ha, hb = 0.5 * (first[1] - first[0]), 0.5 * (second[1] - second[0])
        half = math.hypot(min(abs(math.cos(b)) + hb, 1.0) * ha, hb)
        _, az, el = self._direction(a, b)
        if half + abs(el) >= 0.5 * math.pi:
            return horizon.top
        wide = math.asin(min(math.sin(half) / math.cos(el), 1.0))
        return horizon.highest_between(az - wide, az + wide)

    def why_not(self, first, second, time, circles):
        """Why the axes may not be at a pair of angles at a time; '' if they may.

        Parameters
        ----------
        first, second : float
            rad.
        time : float
            s from now.
        circles : tuple of Circle
            From `in_axes`.
        """
        place, az, el = self._direction(first, second)
        if el < self.limits.horizon.over(az):
            return self._reason(az, el)
        for circle in circles:
            near = math.cos(min(circle.distance, math.pi))
            soon = math.cos(min(circle.distance + TURN_RATE * abs(time), math.pi))
            if float(circle.toward @ place) > soon and float(circle.at(time) @ place) > near:
                return self._reason(az, el, circle)
        return ''

    def _direction(self, a, b):
        """Direction of axis angles in the axis frame; its azimuth and elevation, floats."""
        along = math.cos(b)
        place = u, v, w = along * math.sin(a), along * math.cos(a), math.sin(b)
        x, y, z = (u * p + v * q + w * r for p, q, r in self._columns)
        return place, math.atan2(x, y), math.asin(min(max(z, -1.0), 1.0))

    def where_not(self, boxes, circles=(), state=None, most=MOST_BOXES):
        """Why the axes may not be at all pairs of angles in boxes; '' if they may.

        Parameters
        ----------
        boxes : Boxes
        circles : tuple of Circle, optional
            From `in_axes`.
        state : State, optional
            Present state: if a limit is already exceeded there, the way may lead back.
        most : int
            Largest number of boxes into which they may be cut.
        """
        lowest, begin = 0.0, None
        done, exact = 0, False
        cleared = self._clearances(boxes, circles, exact)
        while True:
            (above, distances), (above_here, distances_here), half = cleared
            near = [circle.distance for circle in circles]
            if begin is not None:
                near = [np.minimum(own, stayed - SLACK)
                        for own, stayed in zip(near, self._stayed(begin, boxes.time, circles))]
            sure = above >= lowest
            for distance, own in zip(distances, near):
                sure &= distance >= own
            if sure.all():
                return ''
            if state is not None:
                (place, az, el), here, state = self._direction(*state.angles), state.angles, None
                above = el - self.limits.horizon.over(az) - SLACK
                soon = TURN_RATE * float(boxes.time.max()) + SLACK
                if any(math.acos(min(max(float(circle.toward @ place), -1.0), 1.0))
                       < circle.distance + soon for circle in circles):
                    begin = np.array(here)[:, None]
                if begin is not None or above < lowest:
                    lowest = min(lowest, above)
                    continue
            bad = above_here < lowest
            for distance, own in zip(distances_here, near):
                bad |= distance < own
            if exact:
                bad |= ~sure & (half < NEAR / 2.0)
                done += len(sure)
            if bad.any() or done > most:
                i = int(np.argmax(bad if bad.any() else ~sure))
                _, az, el = self._direction(
                    *(0.5 * (boxes.low[:, i] + boxes.high[:, i])).tolist())
                if not circles or above_here[i] < lowest + NEAR:
                    return self._reason(az, el)
                beyond = [distance[i] - circle.distance
                          for distance, circle in zip(distances_here, circles)]
                return self._reason(az, el, circles[int(np.argmin(beyond))])
            boxes = quartered(boxes, ~sure) if exact else boxes.of(~sure)
            exact = not exact
            cleared = self._clearances(boxes, circles, exact)

    def _stayed(self, begin, time, circles):
        """Distance of each limit to the start if the axes had stayed, at the time of each box."""
        there = np.repeat(begin, len(time), axis=1)
        return self._clearances(Boxes(there, there, time), circles, False)[1][1]

    def _clearances(self, boxes, circles, exact=True):
        """Elevation above the horizon, distances to limits: least in each box, and at its centre.

        Also half the size of each box on the sky. If not `exact`, a fast lower bound.
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
            if boxes.low is not boxes.high:  # over everything this close on the sky
                share = np.sin(np.minimum(half, np.pi / 2.0)) / np.maximum(np.cos(el), 1e-9)
                wide = np.where((share < 1.0) & (half < np.pi / 2.0),
                                np.arcsin(np.minimum(share, 1.0)), np.pi)
                if self._straight:
                    wide = np.where(np.abs(b) + hb < np.pi / 2.0, np.minimum(ha, wide), wide)
                above = lowest - horizon.highest(az, wide)
        toward = [circle.at(boxes.time) if circle.pole is not None else circle.toward
                  for circle in circles]
        distances_here = [arc(np.arccos, np.sum(to.T * place.T, -1)) for to in toward]
        distances = [arc(np.arccos, most_cosine(to, boxes)) for to in toward] if exact else [
            distance - half for distance in distances_here]
        return (above, distances), (above_here, distances_here), half

    def _reason(self, az, el, circle=None):
        """Reason why a direction is not allowed: the horizon, or a circle."""
        where = f'azimuth {np.mod(az, _TURN) / DEG:.1f} deg, elevation {el / DEG:.1f} deg'
        if circle is None:
            least = self.limits.horizon.over(az) / DEG
            return (f'comes below the horizon of {least:.1f} deg at {where}: choose a higher '
                    'target')
        degrees = (circle.distance - self._margin) / DEG
        return (f'comes within {degrees:g} deg of {circle.limit.name} where it passes {where}: '
                'choose another target or wait')
