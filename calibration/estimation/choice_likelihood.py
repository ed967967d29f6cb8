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

"""Maximum likelihood over a grid of correlated noises, for one selection and with each group added.

The rows are whitened by each noise of the grid once for all questions about a selection.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from .correlated_noise import AT_ONCE, AxisRows, CorrelatedNoise
from .group_columns import inverse_root
from .reduced_squares import reduced_squares, times_rows

#: variances tried, over that of the white noise; and the triple for white noise alone
_SIZES, _WHITE = (0.1, 0.4, 1.6, 6.4, 25.0), (1.0, 0.0, 1.0)


class ChoiceLikelihood:
    """Maximum likelihoods with one selection in the model, over a grid of noises.

    Parameters
    ----------
    problem : SelectionProblem
    chosen : list of CandidateGroup
        Groups that are always in the model.
    """

    def __init__(self, problem, chosen):
        self._problem, self.plain = problem, problem.plain.fit(chosen)
        self._memory = problem.with_memory(self.plain, chosen).memory
        self._noises, self._sets = _tried(problem.sequence, self.plain, self._memory)
        design, n = np.asarray(problem.design(chosen)), problem.n
        self._axes = []
        for axis, one in enumerate(self._memory):
            part = slice(axis * n, (axis + 1) * n)
            rows = AxisRows(self.plain.noise.root[part], problem.sequence, one.scaled)
            self._axes.append((rows, part, rows.scaled(design[:, part])))

    def simulated(self, normal):
        """Simulated runs with the estimated noise, from standard normal deviates, both (m, 2n)."""
        noise = CorrelatedNoise.beside(self.plain.noise, self.plain.scale, self._problem.sequence,
                                       self._memory)
        return noise.coloured(normal * (self.plain.noise.root > 0.0))

    def ratios(self, bank, values=None):
        """2 ln of the likelihood ratio of each group, shape (m, G).

        Both likelihoods are maxima over all tried pairs of noises.

        Parameters
        ----------
        bank : CandidateBank
            The groups.
        values : ndarray, shape (m, 2n), optional
            Data; by default those of the problem.
        """
        fits = self._problem_fits if values is None else self._design_fits(values)
        sums = [_group_sums(rows, bank, axis, part, sums, noises) for axis, (
            (rows, part, _), sums, noises) in enumerate(zip(self._axes, fits.axes, self._noises))]
        out = np.full((fits.values, len(bank)), -np.inf)
        step = max(1, AT_ONCE // max(len(bank.columns) * fits.values, 1))
        for i in range(0, len(self._sets), step):
            some = slice(i, i + step)
            pair = [[(which, *(of[self._sets[some, axis]] for of in each))
                     for which, *each in sums[axis]] for axis in (0, 1)]
            out = np.maximum(out, fits.some(some).with_groups(pair, out.shape))
        return out - fits.largest[:, None]

    @cached_property
    def _problem_fits(self):
        return self._design_fits(self._problem.b[None])

    def _design_fits(self, values):
        live = np.count_nonzero(self.plain.noise.root[:self.plain.n])
        return _DesignFits.of([
            _AxisSums.of(rows, np.concatenate((design, rows.scaled(values[:, part]))),
                         len(design), noises)
            for (rows, part, design), noises in zip(self._axes, self._noises)], self._sets, live)


def _tried(sequence, plain, memory):
    """Noises to try on each axis, and their combinations.

    Returns
    -------
    noises : list of ndarray, shape (t, 3)
        For x and y: correlation time, variance, and sigma of the white part in units of that of
        the white-noise fit. The first is the estimate, the second is white.
    sets : ndarray of int, shape (s, 2)
        Pairs of indices: the estimates of both axes; white noise on both; each noise of x with the
        estimate of y; each of y with the estimate of x.
    """
    root = plain.noise.root.reshape(2, plain.n)
    noises = []
    for axis, one in enumerate(memory):
        size = np.median(1.0 / np.square(root[axis][root[axis] > 0.0]))
        estimate = (one.memory, one.variance, one.scale / plain.scale[axis])
        noises.append(np.array([
            estimate if one.variance > 0.0 else _WHITE, _WHITE,
            *((tau, part * size, 1.0) for tau in sequence.memories[1:] for part in _SIZES)]))
    x, y = (np.arange(1, len(of)) for of in noises)
    return noises, np.concatenate(([(0, 0), (1, 1)], np.column_stack((x, 0 * x)),
                                   np.column_stack((0 * y, y))))


class _AxisSums(NamedTuple):
    """Design D and values V of an axis, whitened by each of t noises, and their products.

    Attributes
    ----------
    white : ndarray, shape (t, k + m, n)
        The design, then the values.
    log_det : ndarray, shape (t,)
        ln of the determinant of the covariance.
    design : ndarray, shape (t, k, k)
        D D'.
    design_values, values : ndarray, shape (t, k, m), (t, m)
        D V', and the squares of V.
    """

    white: np.ndarray
    log_det: np.ndarray
    design: np.ndarray
    design_values: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, rows, columns, k, noises):
        """From the scaled `columns` of the axis: `k` of the design, then the values."""
        white, log_det = zip(*(rows.whitened_by(columns, *noises[some].T)
                               for some in _at_once(noises, columns)))
        white = np.concatenate([of.transpose(1, 0, 2) for of in white])
        sums = white[:, :k] @ np.swapaxes(white, 1, 2)
        return cls(white, np.concatenate(log_det), sums[..., :k], sums[..., k:],
                   np.square(white[:, k:]).sum(axis=2))


def _at_once(noises, columns):
    """Slices of the noises, so that the whitened columns of each take limited memory."""
    step = max(1, AT_ONCE // max(columns.size, 1))
    return [slice(i, i + step) for i in range(0, len(noises), step)]


def _group_sums(rows, bank, axis, part, beside, noises):
    """Products of groups C with themselves and with the D and V of `_AxisSums`, on one axis.

    Returns
    -------
    list of tuple
        For each number of columns d: indices of the groups, (G,), then for each noise C C'
        (t, G, d, d) and C D', C V' (t, G, d, k + m).
    """
    some, kind = bank.on_axis(axis), _kind(beside.values.shape[1])
    columns, places = rows.scaled(bank.columns[some, part]), np.full(len(bank.columns), len(some))
    places[some] = np.arange(len(some))
    sizes = [(which, places[at], np.zeros((len(noises), *at.shape, at.shape[1])))
             for which, at in bank.by_size()]
    sums = np.zeros((len(noises), len(some) + 1, beside.white.shape[1]), kind)  # the last: none
    for few in _at_once(noises, columns):
        groups = rows.whitened_by(columns, *noises[few].T)[0].transpose(1, 0, 2)
        sums[few, :-1] = groups.astype(kind, copy=False) @ np.swapaxes(
            beside.white[few].astype(kind, copy=False), 1, 2)
        for _, at, own in sizes:
            there = np.flatnonzero(at[:, 0] < len(some))
            of = groups[:, at[there]]
            own[few, there] = of @ of.transpose(0, 1, 3, 2)
    return [(which, own, sums.take(at, axis=1)) for which, at, own in sizes]


def _kind(count):
    """Number type: single precision is enough for many (simulated) values."""
    return np.float32 if count > 1 else np.float64


class _DesignFits(NamedTuple):
    """Fits of the design without groups, for s pairs of noises of x and y.

    Attributes
    ----------
    axes : list of _AxisSums
    design : list of ndarray, shape (s, k, k)
        D D' of x and y.
    inverse : ndarray, shape (s, k, k)
        Inverse of the sum of both.
    p : ndarray, shape (s, k, m)
        Coefficients.
    left : list of ndarray, shape (s, k, m)
        Products of D with the residuals, of x and y.
    squares : list of ndarray, shape (s, m)
        Sums of squared residuals of x and y.
    det : ndarray, shape (s, 1)
        Factor from the determinants: 2 ln L = -live ln (x^2 y^2 det), so that the best pair has
        the least product and needs one logarithm.
    live : int
        Rows with weight.
    largest : ndarray, shape (m,)
        Largest 2 ln L, but for a constant.
    """

    axes: list
    design: list
    inverse: np.ndarray
    p: np.ndarray
    left: list
    squares: list
    det: np.ndarray
    live: int
    largest: np.ndarray

    @classmethod
    def of(cls, axes, sets, live):
        """From the `_AxisSums` of both axes and the pairs of noises, (s, 2)."""
        chosen = list(zip(axes, sets.T))
        design = [of.design[some] for of, some in chosen]
        onto = [of.design_values[some] for of, some in chosen]
        normal = sum(design)
        first = inverse_root(normal.mean(axis=0))  # scaled by it all matrices are well conditioned
        first = first[:, first.any(axis=0)]
        root = first @ inverse_root(first.T @ normal @ first)
        inverse = root @ root.transpose(0, 2, 1)
        p = inverse @ sum(onto)
        left = [one - of @ p for of, one in zip(design, onto)]
        squares = [of.values[some] - (p * (one + rest)).sum(axis=1)
                   for (of, some), one, rest in zip(chosen, onto, left)]
        log_det = sum(of.log_det[some] for of, some in chosen)
        det = np.exp((log_det - log_det[0]) / live)[:, None]
        return cls(axes, design, inverse, p, left, squares, det, live,
                   _log((squares[0] * squares[1] * det).min(axis=0), live))

    @property
    def values(self):
        """Number of data vectors, m."""
        return self.p.shape[2]

    def some(self, sets):
        """The fits of some pairs of noises (a slice)."""
        return self._replace(design=[of[sets] for of in self.design], inverse=self.inverse[sets],
                             p=self.p[sets], left=[of[sets] for of in self.left],
                             squares=[of[sets] for of in self.squares], det=self.det[sets])

    def with_groups(self, pair, shape):
        """Largest 2 ln L with each group, `shape` (m, G), from the `_group_sums` of both axes."""
        kind, k = _kind(self.values), self.p.shape[1]
        p, *left = (of.astype(kind, copy=False) for of in (self.p, *self.left))
        out = np.empty(shape)
        for (which, *gx), (_, *gy) in zip(*pair):
            sets, count, d, _ = gx[1].shape
            onto = (gx[1][..., :k] + gy[1][..., :k]).reshape(sets, -1, k) @ self.inverse
            across = []  # products of each group, orthogonal to the design: with itself, with r
            for of, (own, both), rest in zip(self.design, (gx, gy), left):
                design, values = both[..., :k].reshape(onto.shape), both[..., k:]
                half = (design - 0.5 * (onto @ of)).reshape(sets, count, d, k)
                shared = times_rows(half, onto.reshape(half.shape))
                fitted = design @ p + onto.astype(kind, copy=False) @ rest
                across.append((own - shared - np.swapaxes(shared, -1, -2),
                               values - fitted.reshape(values.shape)))
            length = np.sqrt(np.diagonal(gx[0] + gy[0], axis1=2, axis2=3))
            (reduced, other), _ = reduced_squares(self.squares, across, length)
            out[:, which] = (reduced * (other * self.det[..., None].astype(kind))).min(axis=0).T
        return _log(out, self.live)


def _log(least, live):
    """2 ln L from the least product of squares, but for a constant."""
    return -live * np.log(np.maximum(least, 1e-300))
