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

"""A detour around what the straight slew would pass: points to visit one after the other."""

import math
from functools import lru_cache

import numpy as np

from msg_tools.units import DEG
from pointing_model.mounts import ALTAZ
from pointing_model.sky.earth import TURN_RATE

from .axis_track import resting
from .boxes import Boxes
from .limits import EDGE
from .motion import plan_move
from .track_check import Allowed

#: spacing of the grids used to search for a way, tried in this order, rad
GRIDS = (5.0 * DEG, 1.5 * DEG)
#: distance searched beyond both ends if the travel has no end there, rad
REACH = 2.0 * math.pi
#: the way must stay clear of moving limits in the sky for this time, s; if it takes longer, the
#: search is repeated for a longer time, up to this many times
WINDOW, TRIES = 480.0, 4
#: extra time at an intermediate point until the mount is at rest, s
SETTLED = 2.0


def lead(check, cubic, state, circles=()):
    """A way to a track whose straight slew is refused: on its turn, else on another turn.

    Parameters
    ----------
    check, cubic, state, circles
        See `around`.

    Returns
    -------
    (list of (float, float), axis_track.Cubic) or None
        Points as in `around`, none if the straight slew is allowed; the track on its turn.
    """
    for track in (cubic, *check.other_turns(cubic, state)):
        if _ok(check.onto(track, state.angles, circles)):
            return [], track
        vias = around(check, track, state, circles)
        if vias is not None:
            return vias, track
    return None


def around(check, cubic, state, circles=()):
    """Points that lead to a track whose straight slew is refused.

    Between grid points only one axis moves, so the result does not depend on timing; then points
    are dropped wherever the check allows the straight slew.

    Parameters
    ----------
    check : track_check.TrackCheck
    cubic : axis_track.Cubic
        The track, on the turn that the mount uses.
    state : motion.AxisState
        Axis state, at rest.
    circles
        See `TrackCheck.check`.

    Returns
    -------
    list of (float, float) or None
        Angles, rad, without those of the track; None if no way was found.
    """
    seconds, begin = WINDOW if circles else math.inf, tuple(map(float, state.angles))

    def leaves(place, there):
        """Whether a move is allowed or does not begin at `begin`: from within a circle the move
        is compared with staying, which needs the circle at its present place.
        """
        return place != begin or not circles or _ok(check.way(place, there, circles, True))

    for _ in range(TRIES):
        # circles in the middle of this time, enlarged by their motion
        then = [circle.later(0.5 * seconds, 0.5 * seconds * TURN_RATE) for circle in circles]
        vias, clean = _free_of_all(check, cubic, state, then, leaves)
        if not clean:
            return None
        needed = _lead_time(check, state.angles, vias)
        if needed <= seconds:
            return vias
        seconds = 30.0 * math.ceil(1.1 * needed / 30.0)
    return None


def _free_of_all(check, cubic, state, circles, leaves):
    """The points of `around` for fixed circles; whether the track is clear of these, too."""
    own = check.sky.in_axes(circles, state)
    for step in GRIDS:
        path = _path(check, cubic, state, own, step, circles, leaves)
        vias = path and _shortened(check, tuple(map(float, state.angles)), path, cubic, circles,
                                   leaves)
        if vias:
            return vias, not check.sky.where_not(cubic.boxes(), own)
    return None, False


def _lead_time(check, here, vias):
    """Latest time at which the axes have passed all points, s."""
    timing = check.limits.timing
    if not timing:
        return 0.0  # unknown: each leg is checked again when it begins
    seconds = 0.0
    for via in vias:
        cubic = resting(via)
        seconds += SETTLED + max(
            plan_move(here[i], 0.0, cubic, i, timing * axis.rate, timing * axis.acceleration).end
            for i, axis in enumerate(check.limits.axes))
        here = via
    return seconds


class _Grid:
    """Points within the travel, and the steps between them that are free of the horizon.

    Parameters
    ----------
    check : TrackCheck
    ends : tuple of (int, int)
        Range of each axis, in steps.
    step : float
        rad.
    """

    def __init__(self, check, ends, step):
        self.nodes = [np.unique(np.clip(np.arange(low, high + 1) * step, axis.low + EDGE,
                                        axis.high - EDGE))
                      for (low, high), axis in zip(ends, check.limits.axes)]
        self.shape = tuple(map(len, self.nodes))
        self.size = self.shape[0] * self.shape[1]
        first, second = np.meshgrid(*self.nodes, indexing='ij')
        index = np.arange(self.size).reshape(self.shape)
        every, first_of, last_of = slice(None), slice(None, -1), slice(1, None)
        low, high, row, column, seconds = [], [], [], [], []
        for axis, a, b in ((0, (first_of, every), (last_of, every)),
                           (1, (every, first_of), (every, last_of))):
            low.append([first[a].ravel(), second[a].ravel()])
            high.append([first[b].ravel(), second[b].ravel()])
            row.append(index[a].ravel())
            column.append(index[b].ravel())
            seconds.append((high[-1][axis] - low[-1][axis]) / check.limits.axes[axis].rate)
        low, high = np.concatenate(low, 1), np.concatenate(high, 1)
        free = check.sky.free(Boxes(low, high, np.zeros(low.shape[1])), ())
        self.boxes = Boxes(low, high, np.zeros(low.shape[1])).of(free)
        self.row, self.column, self.seconds = (
            np.concatenate(v)[free] for v in (row, column, seconds))
        middle = 0.5 * (self.boxes.low + self.boxes.high)
        self.place = ALTAZ.direction(*middle)

    def graph(self, check, circles, step):
        """Sparse matrix with the duration (s) of each step that is also free of the circles."""
        free = np.ones(len(self.row), bool)
        for circle in circles:
            near = np.flatnonzero(circle.toward @ self.place
                                  > np.cos(min(circle.distance + step, np.pi)))
            free[near] &= check.sky.free(self.boxes.of(near), (circle,))
        from scipy.sparse import coo_matrix  # few nights need a detour
        return coo_matrix((self.seconds[free], (self.row[free], self.column[free])),
                          shape=(self.size, self.size)).tocsr()

    def node(self, k):
        """Angles of a grid point."""
        i, j = divmod(int(k), self.shape[1])
        return float(self.nodes[0][i]), float(self.nodes[1][j])

    def beside(self, place):
        """Grid points around a place, the closest first."""
        near = [np.argsort(np.abs(points - at))[:4] for points, at in zip(self.nodes, place)]
        return [int(near[0][i] * self.shape[1] + near[1][j]) for _, i, j in sorted(
            (i + j, i, j) for i in range(len(near[0])) for j in range(len(near[1])))]


@lru_cache(16)
def _grid(check, ends, step):
    return _Grid(check, ends, step)


def _path(check, cubic, state, own, step, circles, leaves):
    """Grid points from the start to one from which the track can be reached; None if none."""
    from scipy.sparse.csgraph import connected_components, dijkstra

    here, there = state.angles, cubic.angles[0].tolist()
    ends = tuple((math.floor(max(axis.low, min(a, b) - REACH) / step),
                  math.ceil(min(axis.high, max(a, b) + REACH) / step))
                 for axis, a, b in zip(check.limits.axes, here, there))
    grid = _grid(check, ends, step)
    graph = grid.graph(check, own, step)
    region = connected_components(graph, directed=False)[1]
    starts, goals = grid.beside(here), grid.beside(there)
    both = {region[k] for k in starts} & {region[k] for k in goals}
    both = [r for r in both if np.count_nonzero(region == r) > 1]
    reached = []
    for k in goals:
        if region[k] in both and _ok(check.onto(cubic, grid.node(k), circles, True)):
            reached.append(k)
            if len(reached) == 3:
                break
    for start in starts:
        good = [k for k in reached if region[k] == region[start]]
        if not good or not _ok(check.way(here, grid.node(start), circles, True)) or (
                not leaves(tuple(map(float, here)), grid.node(start))):
            continue
        distance, before = dijkstra(graph, directed=False, indices=start,
                                    return_predecessors=True)
        k = good[int(np.argmin(distance[good]))]
        path = []
        while k >= 0:
            path.append(grid.node(k))
            k = int(before[k])
        return path[::-1]
    return None


def _shortened(check, here, path, cubic, circles, leaves):
    """Fewer points of a path: always go on to the last one that can be reached straight."""
    vias, at, place = [], -1, here
    while at < len(path) - 1:
        if vias and _ok(check.onto(cubic, place, circles, True)):
            break
        near, far, at = at + 1, len(path), at + 1
        last = len(path) - 1
        while near < last:  # bisection: reachable points are mostly contiguous
            if _ok(check.way(place, path[last], circles, True)) and (
                    leaves(place, path[last])):
                at = near = last
            else:
                far = last
            last = (near + far) // 2
        place = path[at]
        vias.append(place)
    return vias


def _ok(found):
    return isinstance(found, Allowed)
