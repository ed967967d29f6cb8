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

"""Likelihood of rows beside one choice, over a grid of noises with memory; with each group, too.

What the rows leave is whitened by each noise that is tried, once for all that is asked of a choice.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from .correlated_noise import AT_ONCE, AxisRows, CorrelatedNoise
from .group_columns import inverse_root
from .reduced_squares import reduced_squares, times_rows

#: sizes that are tried (variance over that of the white noise); and no process
_SIZES, _WHITE = (0.1, 0.4, 1.6, 6.4, 25.0), (1.0, 0.0, 1.0)


class ChoiceLikelihood:
    """Likelihoods beside one choice, over a grid of noises.

    Parameters
    ----------
    problem : SelectionProblem
    chosen : list of CandidateGroup
        In the model anyway.
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
        """Runs with the noise that was estimated, from standard normal noise, (m, 2n) both."""
        noise = CorrelatedNoise.beside(self.plain.noise, self.plain.scale, self._problem.sequence,
                                       self._memory)
        return noise.coloured(normal * (self.plain.noise.root > 0.0))

    def ratios(self, bank, values=None):
        """2 ln of the likelihood ratio of each group, shape (m, G).

        Either likelihood is the largest of all pairs of noises that are tried.

        Parameters
        ----------
        bank : CandidateBank
            The groups.
        values : ndarray, shape (m, 2n), optional
            By default those of the problem.
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
    """Noises of each axis, and which are tried together.

    Returns
    -------
    noises : list of ndarray, shape (t, 3)
        Of x and y: memory, variance, and sigma of the white part in that of the plain fit; the
        first is the estimate, the second white.
    sets : ndarray of int, shape (s, 2)
        The estimate of both, white noise of both, each of x with the estimate of y, and so on.
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
    """Design D and values V on an axis, whitened by each of t noises, and their sums over rows.

    Attributes
    ----------
    white : ndarray, shape (t, k + m, n)
        The design, then the values.
    log_det : ndarray, shape (t,)
    design : ndarray, shape (t, k, k)
        D D.
    design_values, values : ndarray, shape (t, k, m), (t, m)
        D V, V V.
    """

    white: np.ndarray
    log_det: np.ndarray
    design: np.ndarray
    design_values: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, rows, columns, k, noises):
        """Of scaled rows of the axis: `k` of the design, then the values."""
        white, log_det = zip(*(rows.whitened_by(columns, *noises[some].T)
                               for some in _at_once(noises, columns)))
        white = np.concatenate([of.transpose(1, 0, 2) for of in white])
        sums = white[:, :k] @ np.swapaxes(white, 1, 2)
        return cls(white, np.concatenate(log_det), sums[..., :k], sums[..., k:],
                   np.square(white[:, k:]).sum(axis=2))


def _at_once(noises, columns):
    """So many of the noises at a time that the columns whitened by them are not too many."""
    step = max(1, AT_ONCE // max(columns.size, 1))
    return [slice(i, i + step) for i in range(0, len(noises), step)]


def _group_sums(rows, bank, axis, part, beside, noises):
    """Sums over the rows of an axis of groups C, with `_AxisSums` beside them.

    Returns
    -------
    list of tuple
        Of each number of columns d: which groups, (G,), then for each noise C C (t, G, d, d) and
        C D, C V (t, G, d, k + m).
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
    """Of many values at a time six digits do."""
    return np.float32 if count > 1 else np.float64


class _DesignFits(NamedTuple):
    """Fits of the design alone, by s sets of noises of both axes.

    Attributes
    ----------
    axes : list of _AxisSums
    design : list of ndarray, shape (s, k, k)
        Of x and y, D D.
    inverse : ndarray, shape (s, k, k)
        Of the sum of both.
    p : ndarray, shape (s, k, m)
        Coefficients.
    left : list of ndarray, shape (s, k, m)
        Of x and y, D with what is left.
    squares : list of ndarray, shape (s, m)
        Of x and y, what is left with itself.
    det : ndarray, shape (s, 1)
        L = (x^2 y^2)^-live / det, so that the least of one product needs no logarithm of each.
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
        """Of `_AxisSums` of both axes, and which noises are tried together, (s, 2)."""
        chosen = list(zip(axes, sets.T))
        design = [of.design[some] for of, some in chosen]
        onto = [of.design_values[some] for of, some in chosen]
        normal = sum(design)
        first = inverse_root(normal.mean(axis=0))  # beside it all are clear: no eigenvalues
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
        """How many values there are, m."""
        return self.p.shape[2]

    def some(self, sets):
        """Of some sets (a slice)."""
        return self._replace(design=[of[sets] for of in self.design], inverse=self.inverse[sets],
                             p=self.p[sets], left=[of[sets] for of in self.left],
                             squares=[of[sets] for of in self.squares], det=self.det[sets])

    def with_groups(self, pair, shape):
        """Largest 2 ln L with each group, `shape` (m, G), of `_group_sums` of both axes."""
        kind, k = _kind(self.values), self.p.shape[1]
        p, *left = (of.astype(kind, copy=False) for of in (self.p, *self.left))
        out = np.empty(shape)
        for (which, *gx), (_, *gy) in zip(*pair):
            sets, count, d, _ = gx[1].shape
            onto = (gx[1][..., :k] + gy[1][..., :k]).reshape(sets, -1, k) @ self.inverse
            across = []  # of what the design leaves of each group: with itself, and with r
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
    """2 ln L of the least product of squares, but for a constant."""
    return -live * np.log(np.maximum(least, 1e-300))
