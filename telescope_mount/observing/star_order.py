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

"""Order of the observation of stars."""

import numpy as np

from pointing_model.mounts import ALTAZ

_TRIALS, _STEPS = 48, 300  # orders tried per step, steps


def observing_order(az, el, rng, start=None, way=ALTAZ.way, slews=1.0):
    """Order directions for short slews with approaches from all sides.

    Parameters
    ----------
    az, el : ndarray, shape (n,)
        Radians.
    rng : numpy.random.Generator
    start : (float, float), optional
        Present position of the mount, radians.
    way : callable
        ``way(here, there)``: signed turn of the first axis.
    slews : float
        Weight of the slew length; see `weight_of_slews`.

    Returns
    -------
    ndarray of int, shape (n,)

    Notes
    -----
    The shortest tour goes once around in azimuth: time, azimuth and direction of approach would
    be fully correlated, and so would a drift, an encoder error and backlash. So simulated
    annealing minimises the mean slew *and* the correlations of time and of the sign of approach
    of each axis with each other and with sin A, cos A and sin E, with both signs equally
    frequent. A slew turns the azimuth the shorter way (cable wrap is handled by the mount) and
    both axes move at once.
    """
    n = len(az)
    if n < 3:
        return np.arange(n)
    place = _unit(np.stack([np.sin(az), np.cos(az), np.sin(el)], axis=1)).T.copy()
    line = np.linspace(-1.0, 1.0, n)
    clock = _unit(np.stack([line, line**2], axis=1))
    # for a move from one star (row) to another: signs of both axes, and length; row n is the
    # move from the start
    from_az = np.append(az, az[0] if start is None else start[0])[:, None]
    from_el = np.append(el, el[0] if start is None else start[1])[:, None]
    move = np.stack([way(from_az, az), el - from_el])
    length = np.abs(move).max(axis=0)
    length *= slews * (n - 1) / length[:n].sum()
    sign = np.sign(move) / np.sqrt(n)
    if start is None:
        length[n], sign[:, n] = 0.0, 0.0
    moves = np.concatenate([sign, length[np.newaxis]]).reshape(3, -1)
    # projections of signs and places: their squares are correlation and imbalance
    along = np.concatenate([np.full((n, 1), 1.0 / np.sqrt(n)), clock], axis=1)

    def cost(order):
        before = np.concatenate([np.full((len(order), 1), n), order[:, :-1]], axis=1)
        *approach, lengths = moves.take(before * n + order, axis=1)
        where = place.take(order, axis=1)
        both = np.einsum('tn,tn->t', *approach)
        pairs = np.einsum('atn,wtn->awt', approach, where).reshape(6, -1)
        sums = (np.concatenate([approach, where]).reshape(-1, n) @ along).reshape(
            5, len(order), 3)
        return (lengths.sum(axis=1) + both * both + np.einsum('pt,pt->t', pairs, pairs)
                + np.einsum('atc,atc->t', sums, sums))

    trials = np.argsort(rng.random((_TRIALS, n)), axis=1)
    value = cost(trials)
    order, now = trials[np.argmin(value)], value.min()
    best, best_value = order, now
    index, each = np.arange(n), np.arange(_TRIALS)
    before = index - 1
    for temperature in np.geomspace(0.1, 0.001, _STEPS):
        ends = rng.integers(0, n, 2 * _TRIALS).reshape(2, _TRIALS, 1)
        i, j = np.minimum(*ends), np.maximum(*ends)
        # reverse a part of the order, or move its last star to the front
        turned = rng.random((_TRIALS, 1)) < 0.5
        changed = np.where(turned, i + j - index, before)
        changed[each, i[:, 0]] = j[:, 0]
        trials = order.take(np.where((index >= i) & (index <= j), changed, index))
        value = cost(trials)
        k = np.argmin(value)
        if value[k] < now or rng.random() < np.exp((now - value[k]) / temperature):
            order, now = trials[k], value[k]
            if now < best_value:
                best, best_value = order, now
    return best


def _unit(columns):
    columns = columns - columns.mean(axis=0)
    return columns / (np.linalg.norm(columns, axis=0) + 1e-12)


#: settling, exposure and centring, s
ON_A_STAR = 25.0
#: typical slew between two stars of `observing_order`, including acceleration, deg
BETWEEN_STARS = 60.0
#: larger weights make time and place of the stars nearly degenerate
_MOST = 3.0


def seconds_a_star(rate):
    """Time per star, s, for a mount that slews at `rate` deg/s.

    The chosen stars stay within the limits for this time.
    """
    return ON_A_STAR + BETWEEN_STARS / rate


def weight_of_slews(rate):
    """Weight of the slew length in `observing_order`, for a mount that slews at `rate` deg/s.

    1 if exposures take longer than slews, else the ratio of slew to exposure time, at most 3. For
    30 stars (twelve draws) weights 1, 2 and 3 give mean slews of 47, 42 and 37 deg, and mean
    correlations of time or approach with place of 0.18, 0.23 and 0.23; 5 gives 32 deg and 0.33.
    """
    return min(max(BETWEEN_STARS / rate / ON_A_STAR, 1.0), _MOST)
