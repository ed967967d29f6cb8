"""A way around what the straight slew would pass: points to come to one after the other."""

import math
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from msg_tools.units import DEG

from .judging import MARGIN_SUN, Allowed, Judge
from .motion import Boxes

#: between points of the grid on which a way is looked for, rad
GRID = 5.0 * DEG
#: an axis goes so far beyond both ends at most where its travel has no end, rad
REACH = 2.0 * math.pi
#: points in between keep so far from the ends of the travel, rad
EDGE = 0.5 * DEG


def around(judge, cubic, state, sun=None, pole=None):
    """Points that lead to a track whose straight slew is refused.

    Between points of a grid the axes go one at a time, so that nothing depends on their timing;
    then points are left out wherever the judge allows the straight slew.

    Parameters
    ----------
    judge : judging.Judge
    cubic : motion.Cubic
        The track, on the turn that the mount takes.
    state : motion.State
        At rest.
    sun, pole
        As of `judging.Judge.judge`.

    Returns
    -------
    list of (float, float) or None
        Angles, rad, without those of the track; None where no way was found.
    """
    here, there = np.array(state.angles, float), cubic.angles[0]
    if sun is not None and judge.limits.sun:
        # it moves while the axes are under way
        judge = Judge(replace(judge.limits, sun=judge.limits.sun + MARGIN_SUN))
    nodes = [_points(axis, a, b) for axis, a, b in zip(judge.limits.axes, here, there)]
    shape = tuple(map(len, nodes))
    own = judge.in_axes(sun, pole, state)
    # a step along either axis, as the box between its ends
    rows, columns, lengths = [], [], []
    index = np.arange(shape[0] * shape[1]).reshape(shape)
    for axis in (0, 1):
        a = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
        b = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
        first, second = np.meshgrid(*nodes, indexing='ij')
        low = np.array([first[a].ravel(), second[a].ravel()])
        high = np.array([first[b].ravel(), second[b].ravel()])
        free = judge.free(Boxes(low, high, np.zeros(low.shape[1])), own)
        rows.append(index[a].ravel()[free])
        columns.append(index[b].ravel()[free])
        seconds = (high - low)[axis] / judge.limits.axes[axis].rate
        lengths.append(seconds[free])
    graph = coo_matrix((np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))),
                       shape=(index.size, index.size)).tocsr()
    starts, ends = (_beside(nodes, index, place) for place in (here, there))
    starts = [k for k in starts if _ok(judge.way(here, _node(nodes, k), sun, pole))]
    ends = [k for k in ends if _reaches(judge, _node(nodes, k), cubic, sun, pole)]
    if not (starts and ends):
        return None
    distance, before = dijkstra(graph, directed=False, indices=starts, return_predecessors=True)
    i, j = np.unravel_index(np.argmin(distance[:, ends]), (len(starts), len(ends)))
    if not np.isfinite(distance[i, ends[j]]):
        return None
    path, k = [], ends[j]
    while k >= 0:
        path.append(_node(nodes, k))
        k = int(before[i, k])
    return _shortened(judge, tuple(here), path[::-1], cubic, sun, pole)


def _shortened(judge, here, path, cubic, sun, pole):
    """Fewer points of a path: each time the last that is reached straight."""
    vias, at, place = [], -1, here
    while at < len(path) - 1:
        if vias and _reaches(judge, place, cubic, sun, pole):
            break
        ahead = [len(path) - 1, *(k for k in range(len(path) - 2, at + 1, -max(
            1, (len(path) - at) // 8)))]
        at = next((k for k in ahead if k > at and _ok(judge.way(place, path[k], sun, pole))),
                  at + 1)
        if not _ok(judge.way(place, path[at], sun, pole)):
            return None
        place = path[at]
        vias.append(place)
    return vias


def _points(axis, here, there):
    low = max(axis.low + EDGE, min(here, there) - REACH)
    high = min(axis.high - EDGE, max(here, there) + REACH)
    low, high = min(low, here), max(high, here)
    return np.linspace(low, high, max(2, math.ceil((high - low) / GRID) + 1))


def _beside(nodes, index, place):
    """Points of the grid about a place, the nearer ones first."""
    near = [np.argsort(np.abs(points - at))[:4] for points, at in zip(nodes, place)]
    return [int(index[i, j]) for i in near[0] for j in near[1]]


def _node(nodes, k):
    i, j = divmod(int(k), len(nodes[1]))
    return float(nodes[0][i]), float(nodes[1][j])


def _ok(found):
    return isinstance(found, Allowed)


def _reaches(judge, place, cubic, sun, pole):
    return _ok(judge.onto(cubic, place, sun, pole))
