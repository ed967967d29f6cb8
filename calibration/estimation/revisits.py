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

"""Revisited places: the noise of one visit, and steps between visits, without a pointing model.

Errors that are the same at each visit of a place, above all those of the mount in that direction,
cancel in the differences between visits. Noise and changes with time remain. They decide whether
something moved; when it moved is fitted to all rows with a smooth model.

Whether anything moved is tested by permutation: if nothing did, the visits of a place are
exchangeable. Whether it moved at once is tested against correlated noise: runs with the most likely
such noise are simulated, and the step must explain the visits better than in any of these.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG, even_sample
from pointing_model.rms import sigma_of

from .robust import GROSS
from .step_scan import step_place, two_sided

#: rad, radius of a place: residuals of the terms change little within it
SAME_PLACE = 3.0 * DEG
#: fewest differences between visits: with fewer no permutation is significant
FEWEST = 6
#: family-wise significance levels of a step: by permutation, which assumes nothing about the noise
#: but cannot be small with few visits (0.8 % with eight pairs, twice that with one pair that shows
#: nothing); and by white normal noise. Both must pass. The third rejects early: p by Student's t
#: times the number of candidates (Bonferroni; they are correlated)
_BY_ORDER, _BY_NOISE, _NOT_NEAR = 0.05, 0.006, 0.1
#: robust sigmas at which single visits are clipped, so that one outlier is no step
_CLIP = 3.0
#: most visits used, in all and against correlated noise; most moments tried
_MOST, _LIKELY, _MOMENTS = 600, 160, 120
#: random permutations (all of them if there are no more), and runs of white noise
_ORDERS, _NOISES = 1999, 3999
#: simulated runs with correlated noise, in stages: none may look as much like a step
_RUNS = (10, 40, 350)
#: 2 ln(likelihood ratio) that one of these runs always reaches
_LEAST_RATIO = 10.0
#: part of the largest gain: a step is located between the moments around it with less
_NEAR = 0.5
#: visits of a place one after the other that go on in one direction are a track (2 in 5! by chance)
_TRACKED = 5
#: least contrast of a step within places, squared and summed over all of them
_STRADDLE = 2.0
#: variances of the process over that of the white noise of a visit; its correlation times as parts
#: of the span
_VARIANCES = np.concatenate(([0.0], np.geomspace(0.05, 2000.0, 12)))
_MEMORIES = (0.02, 0.06, 0.2)


class VisitMove(NamedTuple):
    """A step between visits.

    Attributes
    ----------
    axis : int
        0 or 1.
    amount, sigma : float
        Change of the zero of the axis, later minus earlier.
    before, after : int
        Last row before the step and first row after it.
    both : int
        Number of places visited both before and after.
    chance : float
        Upper limit of p under white noise.
    left : ndarray, shape (2, m)
        Deviations of the visits of `Revisits.again` without the step, on both axes.
    dofs : ndarray of int, shape (2,)
        Degrees of freedom of `left`.
    """

    axis: int
    amount: float
    sigma: float
    before: int
    after: int
    both: int
    chance: float
    left: np.ndarray
    dofs: np.ndarray


class Revisits:
    """Visits of places, with the differences between them.

    Parameters
    ----------
    direction : ndarray, shape (3, n)
        Unit vectors in the frame of the axes.
    position : ndarray, shape (n,)
        Time, or place in the order.
    value : ndarray, shape (2, n)
        Measured offsets, or their residuals from a smooth model.
    radius : float
        rad; visits within it of the first one are of one place.
    design : pair of ndarray, shape (k, n), optional
        Columns of the smooth model on each axis; used to locate a step and to test whether it
        came at once.
    factor : ndarray, shape (2, n), optional
        Effect of a unit shift of each axis on `value`, such as cos E for an azimuth.
    group : ndarray of int, shape (n,), optional
        Rows with one number are one visit: exposures of a star within minutes share their errors.
        So are all rows of a star that is tracked through a place.
    side : ndarray of int, shape (n,), optional
        Rows with different numbers, such as the side of the pier, are of different places.
    zero : ndarray of int, shape (n,), optional
        Rows with different numbers have different zeros, already removed from `value`.

    Attributes
    ----------
    place : ndarray of int, shape (m,)
        Place of each visit, in order of time.
    again : ndarray of bool, shape (m,)
        Visits of places with two or more.
    position : ndarray, shape (m,)
        Position of each visit.
    rows : list of ndarray
        Rows of each visit.
    zeros : int
        Number of different values of `zero`.
    """

    def __init__(self, direction, position, value, radius, design=None, factor=None, group=None,
                 side=None, zero=None):
        n = len(position)
        group = np.arange(n) if group is None else group
        factor = np.ones((2, n)) if factor is None else factor
        side = np.zeros(n, int) if side is None else side
        first, visit = np.unique(group, return_index=True, return_inverse=True)[1:]
        when = np.bincount(visit, position) / np.bincount(visit)
        order = np.argsort(when, kind='stable')
        direction = direction[:, first[order]]
        place = _places(direction, side[first[order]], radius)
        began = _begins(direction, place)
        visit = (np.cumsum(began) - 1)[np.argsort(order)][visit]
        self._visit, self.place = visit, place[began]
        self._zero = np.zeros(n, int) if zero is None else zero
        self.zeros = len(np.unique(self._zero))
        design = np.ones((2, 1, n)) if design is None else np.array(design)
        self._of_rows = position, design, factor, value
        self.rows = [np.flatnonzero(visit == k) for k in range(len(self.place))]
        self.position, self._design, self._factor, self._value = map(self._mean, self._of_rows)
        self.again = _thinned(self.place, np.bincount(self.place)[self.place] > 1)
        self._own = np.unique(self.place[self.again], return_inverse=True)[1]

    def _mean(self, values):
        """Mean over the rows of each visit, shape (..., m)."""
        flat = values.reshape(-1, values.shape[-1])
        count = np.bincount(self._visit)
        return np.array([np.bincount(self._visit, one) / count for one in flat]).reshape(
            *values.shape[:-1], -1)

    @property
    def places(self):
        """Number of places visited again."""
        return int(self._own.max(initial=-1)) + 1

    @property
    def differences(self):
        """Number of independent differences between visits."""
        return len(self._own) - self.places

    def _off(self, values):
        """Values of the visits of `again`, less the mean of each place."""
        sums = np.zeros((*values.shape[:-1], self.places))
        np.add.at(np.moveaxis(sums, -1, 0), self._own, np.moveaxis(values, -1, 0))
        return values - (sums / np.bincount(self._own))[..., self._own]

    def _later(self, axis, moments):
        """Effect of a unit step of an axis at each moment on all visits, (t, m)."""
        later = (self.position > np.reshape(moments, (-1, 1))).astype(float)
        return later * self._factor[axis]

    @cached_property
    def _tame(self):
        return self._tamed(self._value)

    def _tamed(self, value):
        """Deviations from the mean of the place, clipped, shape (2, m).

        Zero for places with a gross outlier, which would shift the mean.
        """
        off = self._off(value[:, self.again])
        sigma = np.array([[sigma_of(one)] for one in off])
        gross = np.array([np.bincount(self._own, one) for one in np.abs(off) > GROSS * sigma])
        off = np.where(gross[:, self._own] > 0, 0.0, off)
        return self._off(np.clip(off, -_CLIP * sigma, _CLIP * sigma))

    def _dof(self, tame):
        """Degrees of freedom of each axis beside a step, without places with gross outliers."""
        return [np.count_nonzero(sound) - len(np.unique(self._own[sound])) - 1
                for sound in tame != 0.0]

    @cached_property
    def _moments(self):
        """Positions at which a step is tested."""
        return even_sample(self._between, _MOMENTS)

    @cached_property
    def _between(self):
        """Positions between visits with enough places visited both before and after."""
        between = np.unique((0.5 * (self.position[1:] + self.position[:-1]))[
            np.diff(self.position) > 0.0])
        steps = self._off(self._later(1, between)[:, self.again])
        return between[np.square(steps).sum(axis=1) >= _STRADDLE]

    @cached_property
    def noise(self):
        """Robust 1 sigma of one visit on each axis, shape (2,); NaN without revisits."""
        if not self.differences:
            return np.full(2, np.nan)
        left, dofs = (self._tame, np.array(self._dof(self._tame)) + 1) if self.move is None else (
            self.move.left, self.move.dofs)
        return np.sqrt(np.square(left).sum(axis=1) / np.maximum(dofs, 1))

    @cached_property
    def move(self):
        """`VisitMove` of a significant step, located by all rows with both axes; or None."""
        if self._likely is None:
            return None
        axis, chance, near = self._likely
        position, design, factor, value = self._of_rows
        # zeros removed from `value` have absorbed part of the step: fit them again
        numbers = np.unique(self._zero[near])
        zeros = [factor * (self._zero == number) * one for number in numbers
                 for one in np.eye(2)[..., None]]
        unit = factor * np.isin(self._zero, numbers)
        found = step_place(np.concatenate((np.swapaxes(design, 0, 1), zeros)), unit, value,
                           position, near)
        step, later = self._mean(unit * found.later), self._mean(found.later)[self.again]
        left = self._tamed(self._value - found.amounts[:, None] * step)
        step = self._off(step[:, self.again]) * (left != 0.0)
        squares = np.maximum(np.square(step).sum(axis=1), 1e-12)
        more, place = (step * left).sum(axis=1) / squares, self.place[self.again]
        left, dofs = left - more[:, None] * step, np.array(self._dof(left))
        variances = np.square(left).sum(axis=1) / np.maximum(dofs, 1) / squares
        return VisitMove(axis, float((found.amounts + more)[axis]), float(np.sqrt(variances[axis])),
                         found.before, found.after,
                         len({*place[later < 1.0]} & {*place[later > 0.0]}), chance, left, dofs)

    @cached_property
    def _likely(self):
        """Axis, p, and rows between which a step lies, if one is significant; else None."""
        if self.differences < FEWEST:
            return None
        dofs = self._dof(self._tame)
        if min(dofs) < FEWEST - 1 or not len(self._moments):
            return None
        sound = self._tame != 0.0
        steps = [self._off(self._later(axis, self._moments)[:, self.again]) * sound[axis]
                 for axis in (0, 1)]
        each = [_squares(one, tame[None], dof)[0]
                for one, tame, dof in zip(steps, self._tame, dofs)]
        axis = int(np.argmax([one.max() for one in each]))
        best = float(each[axis].max())
        by_student = 2 * len(self._moments) * float(two_sided(np.sqrt(best), dofs[axis]))
        if by_student > _NOT_NEAR:
            return None
        rng = np.random.default_rng(0)  # the same rows give the same p
        orders = self._orders(rng)
        white = [self._off(rng.standard_normal((_NOISES, len(self._own)))) * one for one in sound]
        for runs, limit in (([tame[orders] for tame in self._tame], _BY_ORDER), (white, _BY_NOISE)):
            largest = np.max([_squares(*one).max(axis=1) for one in zip(steps, runs, dofs)],
                             axis=0)
            chance = np.mean(largest >= best * (1.0 - 1e-9))
            if chance > limit:
                return None
        gain = sum(dof * np.log1p(one / dof) for one, dof in zip(each, dofs))
        at = int(np.argmax(gain))
        far = np.flatnonzero(gain < _NEAR * gain[at])
        ends = [far[far < at].max(initial=0), far[far > at].min(initial=len(gain) - 1)]
        first, last = np.searchsorted(self.position, self._moments[ends])
        position = self._of_rows[0]
        near = (position >= position[self.rows[first - 1]].min()) & (
            position <= position[self.rows[last]].max())
        return axis, min(float(chance) + 1.0 / _NOISES, by_student), near

    def _orders(self, rng):
        """Permutations of the visits within their places, the first the identity, (b, m)."""
        m, pairs = len(self._own), self.places
        slots = np.argsort(self._own, kind='stable')
        if m == 2 * pairs and 2**pairs <= _ORDERS + 1:  # all permutations
            flips = (np.arange(2**pairs)[:, None] >> np.arange(pairs)) & 1
            partner = np.empty(m, int)
            partner[slots] = slots.reshape(-1, 2)[:, ::-1].ravel()
            return np.where(flips[:, self._own] == 1, partner, np.arange(m))
        out = np.empty((_ORDERS + 1, m), int)
        out[0] = np.arange(m)
        out[1:, slots] = np.argsort(self._own + rng.random((_ORDERS, m)), axis=1)
        return out

    @cached_property
    def at_once(self):
        """Whether the move was a step: significant against correlated noise, from all visits."""
        if self.move is None:
            return False
        axis, rng = self.move.axis, np.random.default_rng(0)
        some = even_sample(np.arange(len(self.place)), _LIKELY)
        value, place = self._value[axis], self.place[some]
        limit = _CLIP * sigma_of(value - np.median(value))
        value = np.clip(value - np.median(value), -limit, limit)[some]
        design = self._design[axis][:, some]
        design = design[np.abs(design).max(axis=1) > 1e-6]
        contrasts = np.linalg.qr(design.T, mode='complete')[0][:, len(design):]
        # errors of a direction beyond the smooth model are the same at each visit of a place
        same = max(np.var(value) / max(np.mean(self.move.left[axis]**2), 1e-300) - 1.0, 0.0)
        processes = _Processes(self.position[some], contrasts,
                               self._later(axis, self._moments)[:, some] @ contrasts,
                               self._factor[axis][some],
                               place[:, None] == place, (0.0, same) if same > 0.3 else (0.0,))
        ratio, likely = processes.ratios(value[None] @ contrasts)
        return bool(ratio[0] > _LEAST_RATIO) and all(
            (processes.ratios(processes.simulated(likely[0], count, rng))[0] < ratio[0]).all()
            for count in _RUNS)


class _Processes:
    """Likelihoods of white noise plus a correlated process, for contrasts between visits.

    Parameters
    ----------
    position : ndarray, shape (m,)
    contrasts : ndarray, shape (m, k)
        Orthonormal.
    steps : ndarray, shape (t, k)
        Candidate steps, in contrasts.
    factor : ndarray, shape (m,)
        Factor of the process in each visit.
    same : ndarray of bool, shape (m, m)
        Whether two visits are of one place.
    shares : sequence of float
        Variances to try for the common error of a place, over that of the noise.
    """

    def __init__(self, position, contrasts, steps, factor, same, shares):
        at = (position - position.min()) / max(np.ptp(position), 1e-300)
        early, late = np.minimum(at[:, None], at), np.maximum(at[:, None], at)
        kernels = [early, np.outer(at, at), early**2 * (3.0 * late - early) / 6.0,
                   *(np.exp((early - late) / memory) for memory in _MEMORIES)]
        self._each = []
        for share in shares:
            root = np.linalg.cholesky(contrasts.T @ (np.eye(len(at)) + share * same) @ contrasts)
            white = np.linalg.solve(root, contrasts.T)
            offset = -2.0 * np.log(np.diag(root)).sum()
            own = np.linalg.solve(root, steps.T).T
            for kernel in kernels:
                values, vectors = np.linalg.eigh(
                    white @ (kernel * np.outer(factor, factor)) @ white.T)
                values = np.maximum(values, 0.0)
                weight = 1.0 / (1.0 + _VARIANCES[:, None] * values / max(values.mean(), 1e-300))
                turned = own @ vectors
                self._each.append((np.linalg.solve(root.T, vectors), root @ vectors, weight,
                                   np.log(weight).sum(axis=1) + offset, turned,
                                   weight @ np.square(turned).T))

    def ratios(self, data):
        """2 ln of the likelihood ratio of the best step, and the most likely process without it.

        Parameters
        ----------
        data : ndarray, shape (b, k)

        Returns
        -------
        ratio : ndarray, shape (b,)
        likely : list of (int, int)
            Indices of the process and of its variance.
        """
        k = data.shape[1]
        alone, beside = [], []
        for into, _, weight, logs, steps, size in self._each:
            turned = data @ into
            squares = np.square(turned) @ weight.T  # (b, v)
            along = (weight * turned[:, None]) @ steps.T  # (b, v, t)
            left = squares - np.max(np.square(along) / np.maximum(size, 1e-12), axis=2)
            alone.append(logs - k * np.log(squares))
            beside.append(logs - k * np.log(np.maximum(left, 1e-300)))
        alone, beside = np.stack(alone, axis=1), np.stack(beside, axis=1)
        flat = alone.reshape(len(data), -1)
        likely = [divmod(int(one), len(_VARIANCES)) for one in flat.argmax(axis=1)]
        return beside.max(axis=(1, 2)) - flat.max(axis=1), likely

    def simulated(self, process, count, rng):
        """Simulated contrasts with a process of `ratios`, shape (count, k), of arbitrary scale."""
        out_of, weight = self._each[process[0]][1:3]
        noise = rng.standard_normal((count, weight.shape[1]))
        return noise / np.sqrt(weight[process[1]]) @ out_of.T


def _squares(steps, data, dof):
    """Student's t squared of each step in each set of data, (b, t)."""
    size = np.maximum(np.square(steps).sum(axis=1), 1e-12)
    gain = np.square(data @ steps.T) / size
    left = np.maximum(np.square(data).sum(axis=1)[:, None] - gain, 1e-300)
    return dof * gain / left


def _places(direction, side, radius):
    """Place of each visit: that of the nearest first visit within the radius, or a new one."""
    n, count, nearest = len(side), 0, np.cos(radius)
    centres, sides, out = np.zeros((n, 3)), np.zeros(n), np.empty(n, int)
    for i, one in enumerate(direction.T):
        along = np.where(sides[:count] == side[i], centres[:count] @ one, -2.0)
        if along.max(initial=-2.0) >= nearest:
            out[i] = int(np.argmax(along))
        else:
            out[i], centres[count], sides[count] = count, one, side[i]
            count += 1
    return out


def _begins(direction, place):
    """Whether a visit is no continuation of that before, of a star tracked through a place.

    There direction and time go together: neither a drift nor a worm is a step between visits.
    """
    out = np.ones(len(place), bool)
    for stay in np.split(np.arange(len(place)), np.flatnonzero(np.diff(place)) + 1):
        way = direction[:, stay]
        if len(stay) >= _TRACKED and ((way[:, -1] - way[:, 0]) @ np.diff(way) > 0.0).all():
            out[stay[1:]] = False
    return out


def _thinned(place, again):
    """Visits of evenly thinned places, if there are more than `_MOST`."""
    step = -(-np.count_nonzero(again) // _MOST)
    return again if step < 2 else again & np.isin(place, np.unique(place[again])[::step])
