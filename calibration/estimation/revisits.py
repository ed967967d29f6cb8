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

"""Places visited again: the noise of one visit, and what moved between, without a model.

What is the same at each visit of a place, the errors of the mount in that direction above all, is
gone from the differences between visits. What is left is noise, and what changed with time.

Whether anything moved is asked by permutation: if nothing did, the visits of a place could have
come in any order. Whether it moved at once is asked beside noise that remembers: runs of the
likeliest such noise are simulated, and a step must explain the visits better than it does in all
but a few of these.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from pointing_model.rms import sigma_of

from .robust import GROSS
from .step_scan import two_sided

#: differences between visits, at least: of fewer no order is rare
FEWEST = 6
#: chance of as much, in any of the candidates, by any order of the visits, which asks nothing of
#: the noise but is never small of few visits (0.8 % of eight pairs, twice that with one pair that
#: tells nothing), and by white normal noise: both are asked. Ten times the latter, Student's t with
#: the number of the candidates, which are alike, is beyond it by far
_BY_ORDER, _BY_NOISE, _NOT_NEAR = 0.05, 0.006, 0.1
#: robust sigmas to which single visits are brought, so that one wild row moves nothing
_CLIP = 3.0
#: visits that are looked at, also for noise that remembers, and moments that are tried, at most
_MOST, _LIKELY, _MOMENTS = 600, 160, 120
#: orders that are drawn (all of them, where there are no more), and runs of white noise
_ORDERS, _NOISES = 1999, 3999
#: runs with noise that remembers that are simulated, in parts: none may look as much like a step
_RUNS = (10, 40, 350)
#: 2 ln(likelihood ratio) that one of these always reaches
_LEAST_RATIO = 10.0
#: 2 ln(likelihood ratio) within which moments are as likely
_AS_LIKELY = 4.0
#: part of the contrast of a place that a step must have in so many places, summed
_STRADDLE = 2.0
#: variances of a process over that of the white noise of a visit; parts of the span that it
#: remembers
_VARIANCES = np.concatenate(([0.0], np.geomspace(0.05, 2000.0, 12)))
_MEMORIES = (0.02, 0.06, 0.2)


class VisitMove(NamedTuple):
    """What moved between visits.

    Attributes
    ----------
    axis : int
        0 or 1.
    amount, sigma : float
        Of the zero of the axis, later less earlier.
    position : float
        Between the last visit before it and the first after it.
    chance : float
        Of as much by noise without memory, at most.
    """

    axis: int
    amount: float
    sigma: float
    position: float
    chance: float


class Revisits:
    """Visits of places, with the differences between them.

    Parameters
    ----------
    direction : ndarray, shape (3, n)
        Unit vectors in the frame of the axes.
    position : ndarray, shape (n,)
        Time, or place in the order.
    value : ndarray, shape (2, n)
        What is measured there: offsets, or what a smooth model leaves of them.
    radius : float
        rad; visits within it of the first one are of one place.
    design : pair of ndarray, shape (k, n), optional
        Columns of the smooth model on each axis; only whether something moved at once asks for
        them.
    factor : ndarray, shape (2, n), optional
        What a shift of each axis makes in `value`, as cos E of an azimuth.
    group : ndarray of int, shape (n,), optional
        Rows that are one visit: exposures of a star within minutes share their errors.
    side : ndarray of int, shape (n,), optional
        Rows with another number are of another place, as the other side of the pier.

    Attributes
    ----------
    place : ndarray of int, shape (m,)
        Of each visit, in order of time.
    again : ndarray of bool, shape (m,)
        Visits of places that have two or more.
    position : ndarray, shape (m,)
        Of each visit.
    rows : list of ndarray
        Rows of each visit.
    """

    def __init__(self, direction, position, value, radius, design=None, factor=None, group=None,
                 side=None):
        n = len(position)
        group = np.arange(n) if group is None else group
        factor = np.ones((2, n)) if factor is None else factor
        side = np.zeros(n, int) if side is None else side
        first, visit = np.unique(group, return_index=True, return_inverse=True)[1:]
        when = np.bincount(visit, position) / np.bincount(visit)
        order = np.argsort(when, kind='stable')
        count = np.bincount(visit)

        def mean(values):
            return np.array([np.bincount(visit, one) / count for one in values])[:, order]
        self.rows = [np.flatnonzero(visit == k) for k in order]
        self.position, self._factor, self._value = when[order], mean(factor), mean(value)
        self._design = [np.ones((1, len(order))) if design is None else mean(design[axis])
                        for axis in (0, 1)]
        self.place = _places(direction[:, first[order]], side[first[order]], radius)
        self.again = _thinned(self.place, np.bincount(self.place)[self.place] > 1)
        self._own = np.unique(self.place[self.again], return_inverse=True)[1]

    @property
    def places(self):
        """How many places were visited again."""
        return int(self._own.max(initial=-1)) + 1

    @property
    def differences(self):
        """How many independent differences there are: visits again."""
        return len(self._own) - self.places

    def _off(self, values):
        """Without the mean of each place, of visits of `again`."""
        sums = np.zeros((*values.shape[:-1], self.places))
        np.add.at(np.moveaxis(sums, -1, 0), self._own, np.moveaxis(values, -1, 0))
        return values - (sums / np.bincount(self._own))[..., self._own]

    def _later(self, axis, moments):
        """A step of one unit of an axis, in all visits, at each moment, (t, m)."""
        later = (self.position > np.reshape(moments, (-1, 1))).astype(float)
        return later * self._factor[axis]

    @cached_property
    def _tame(self):
        """Deviations from the mean of the place, large ones brought near, shape (2, m).

        Of a place with a gross one nothing, for it says nothing of the others.
        """
        off = self._off(self._value[:, self.again])
        sigma = np.array([[sigma_of(one)] for one in off])
        gross = np.array([np.bincount(self._own, one) for one in np.abs(off) > GROSS * sigma])
        off = np.where(gross[:, self._own] > 0, 0.0, off)
        return self._off(np.clip(off, -_CLIP * sigma, _CLIP * sigma))

    @cached_property
    def _dof(self):
        """Of what is left of a step in each axis, by the places that are not gross."""
        return [np.count_nonzero(sound) - len(np.unique(self._own[sound])) - 1
                for sound in self._tame != 0.0]

    @cached_property
    def _moments(self):
        """Positions at which a step is tried."""
        count = len(self._between)
        return self._between if count <= _MOMENTS else self._between[
            np.linspace(0, count - 1, _MOMENTS).round().astype(int)]

    @cached_property
    def _between(self):
        """Positions between visits that enough places were visited before and after."""
        between = np.unique((0.5 * (self.position[1:] + self.position[:-1]))[
            np.diff(self.position) > 0.0])
        steps = self._off(self._later(1, between)[:, self.again])
        return between[np.square(steps).sum(axis=1) >= _STRADDLE]

    @cached_property
    def noise(self):
        """1 sigma of one visit, each axis, shape (2,), robust; NaN where none differ."""
        if not self.differences:
            return np.full(2, np.nan)
        off, dofs, move = np.array(self._tame), np.array(self._dof) + 1.0, self.move
        if move is not None:
            step = self._off(self._later(move.axis, move.position)[0, self.again])
            off[move.axis] -= move.amount * step * (off[move.axis] != 0.0)
            dofs[move.axis] -= 1.0
        return np.sqrt(np.square(off).sum(axis=1) / np.maximum(dofs, 1.0))

    @cached_property
    def move(self):
        """What moved, by one step at the moment that explains most: `VisitMove`, or None."""
        if self.differences < FEWEST or min(self._dof) < FEWEST - 1 or not len(self._moments):
            return None
        dofs = self._dof
        sound = self._tame != 0.0
        steps = [self._off(self._later(axis, self._moments)[:, self.again]) * sound[axis]
                 for axis in (0, 1)]
        each = [_squares(one, tame[None], dof)[0]
                for one, tame, dof in zip(steps, self._tame, dofs)]
        axis = int(np.argmax([one.max() for one in each]))
        best, at = float(each[axis].max()), int(np.argmax(each[axis]))
        dof = dofs[axis]
        by_student = 2 * len(self._moments) * float(two_sided(np.sqrt(best), dof))
        if by_student > _NOT_NEAR:
            return None
        rng = np.random.default_rng(0)  # the same rows give the same chance
        orders = self._orders(rng)
        white = [self._off(rng.standard_normal((_NOISES, len(self._own)))) * one for one in sound]
        for runs, limit in (([tame[orders] for tame in self._tame], _BY_ORDER), (white, _BY_NOISE)):
            largest = np.max([_squares(*one).max(axis=1) for one in zip(steps, runs, dofs)],
                             axis=0)
            chance = np.mean(largest >= best * (1.0 - 1e-9))
            if chance > limit:
                return None
        moment, step = self._placed(axis, at, dof)
        tame = self._tame[axis]
        amount = step @ tame / (step @ step)
        left = tame - amount * step
        sigma = np.sqrt(left @ left / dof / (step @ step))
        return VisitMove(axis, float(amount), float(sigma), moment,
                         min(float(chance) + 1.0 / _NOISES, by_student))

    def _placed(self, axis, at, dof):
        """The likeliest moment about one of those tried, and a unit step there.

        Of moments that the places cannot distinguish it is the one that suits all visits.
        """
        ends = self._moments[[max(at - 1, 0), min(at + 1, len(self._moments) - 1)]]
        near = self._between[(self._between >= ends[0]) & (self._between <= ends[1])]
        tame = self._tame[axis]
        steps = self._off(self._later(axis, near)[:, self.again]) * (tame != 0.0)
        gain = dof * np.log1p(_squares(steps, tame[None], dof)[0] / dof)
        some = np.flatnonzero(gain > gain.max() - _AS_LIKELY)
        amounts = steps[some] @ tame / np.square(steps[some]).sum(axis=1)
        left = self._value[axis] - amounts[:, None] * self._later(axis, near[some])
        best = some[np.argmin(np.abs(left - np.median(left, axis=1)[:, None]).sum(axis=1))]
        return float(near[best]), steps[best]

    def _orders(self, rng):
        """Orders of the visits within their places, the first one as it was, (b, m)."""
        m, pairs = len(self._own), self.places
        slots = np.argsort(self._own, kind='stable')
        if m == 2 * pairs and 2**pairs <= _ORDERS + 1:  # all that there are
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
        """Whether the move was a step: told from noise that remembers, by all visits."""
        if self.move is None:
            return False
        axis, rng = self.move.axis, np.random.default_rng(0)
        left = self._tame[axis] - self._off(self.move.amount * self._later(
            axis, self.move.position)[0, self.again])
        some = np.unique(np.linspace(0, len(self.place) - 1, _LIKELY).round().astype(int))
        value, place = self._value[axis], self.place[some]
        limit = _CLIP * sigma_of(value - np.median(value))
        value = np.clip(value - np.median(value), -limit, limit)[some]
        design = self._design[axis][:, some]
        design = design[np.abs(design).max(axis=1) > 1e-6]
        contrasts = np.linalg.qr(design.T, mode='complete')[0][:, len(design):]
        # what the directions do beyond the smooth model is the same at each visit of a place
        same = max(np.var(value) / max(np.mean(left**2), 1e-300) - 1.0, 0.0)
        processes = _Processes(self.position[some], contrasts,
                               self._later(axis, self._moments)[:, some] @ contrasts,
                               self._factor[axis][some],
                               place[:, None] == place, (0.0, same) if same > 0.3 else (0.0,))
        ratio, likely = processes.ratios(value[None] @ contrasts)
        return bool(ratio[0] > _LEAST_RATIO) and all(
            (processes.ratios(processes.simulated(likely[0], count, rng))[0] < ratio[0]).all()
            for count in _RUNS)


class _Processes:
    """White noise, and beside it a process along the position, of contrasts between visits.

    Parameters
    ----------
    position : ndarray, shape (m,)
    contrasts : ndarray, shape (m, k)
        Orthonormal.
    steps : ndarray, shape (t, k)
        Candidates, in contrasts.
    factor : ndarray, shape (m,)
        Of the process in each visit.
    same : ndarray of bool, shape (m, m)
        Visits of one place.
    shares : sequence of float
        Variances of what such visits have in common, over that of the noise, that are tried.
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
        """2 ln(likelihood) with the best step less without, and the likeliest process without it.

        Parameters
        ----------
        data : ndarray, shape (b, k)

        Returns
        -------
        ratio : ndarray, shape (b,)
        likely : list of (int, int)
            Process and variance.
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
        """Contrasts of runs with a process of `ratios`, shape (count, k); the scale is any."""
        out_of, weight = self._each[process[0]][1:3]
        noise = rng.standard_normal((count, weight.shape[1]))
        return noise / np.sqrt(weight[process[1]]) @ out_of.T


def _squares(steps, data, dof):
    """Student's t squared of each step beside each of the data, (b, t)."""
    size = np.maximum(np.square(steps).sum(axis=1), 1e-12)
    gain = np.square(data @ steps.T) / size
    left = np.maximum(np.square(data).sum(axis=1)[:, None] - gain, 1e-300)
    return dof * gain / left


def _places(direction, side, radius):
    """Number of the place of each visit: of the nearest first visit within the radius."""
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


def _thinned(place, again):
    """Visits of every so-manieth place, where they are too many."""
    step = -(-np.count_nonzero(again) // _MOST)
    return again if step < 2 else again & np.isin(place, np.unique(place[again])[::step])
