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

"""Which covariates a short series follows: exact tests by permutation of its epochs.

A few epochs, such as nights, are too few for the tables of a textbook, and a zero that walks from
night to night looks like a temperature that changes with the season. So every set of one or two
covariates is tried in three views, and what is claimed holds in each of them:

``levels``
    The series as it is. Exact where it scatters from epoch to epoch, and, whatever it does, where
    the covariate does.
``steady drift taken out``
    What both leave of a straight line in time. For a series that scatters about a drift.
``differences``
    From each epoch to the next, less their mean. Exact where the series walks: then these scatter.

In each view the epochs of the series are permuted, both axes together, and the best fit of any set
to any axis is what every fit is compared with (Westfall & Young 1993, the step-wise maximum of
p-values): a p holds for all covariates and both axes at once. Where epochs have errors of their
own, what is permuted and fitted are values in units of their scatter.
"""

from itertools import combinations, permutations
from math import factorial
from typing import NamedTuple

import numpy as np

from .extra_scatter import whitening
from .step_scan import two_sided

#: covariates that are tried at once: two, of a dozen epochs
MOST = 2
#: equal up to rounding counts as reached
_ROUNDING = 1e-9
#: length of a unit column beside others from where it depends on them
_DEPENDENT = 1e-6


class CovariateChoice(NamedTuple):
    """What the series of each axis follows.

    Attributes
    ----------
    causes : tuple of tuple of int
        Of each axis the covariates that are claimed, by their place; empty where none is.
    alike : tuple of tuple of int
        Covariates that do as well in their place: nothing is claimed, and these and the ones above
        are what cannot be distinguished.
    trend : tuple of tuple of int
        Covariates that the levels follow, but not the other views.
    p : ndarray, shape (2,)
        Of the best set of each axis over all views, covariates and both axes.
    p_levels : ndarray, shape (2,)
        The same of the levels alone.
    """

    causes: tuple
    alike: tuple
    trend: tuple
    p: np.ndarray
    p_levels: np.ndarray


def fewest_epochs(alpha):
    """From how many on a p of `alpha` can be reached at all, differences included."""
    n = 5  # a straight line, a covariate and two epochs more
    while factorial(n - 1) * alpha < 1.0:
        n += 1
    return n


def choose_covariates(series, covariates, when, alpha, count=999, seed=1, *, variances=None):
    """What the series of both axes follow.

    Parameters
    ----------
    series : ndarray, shape (n, 2)
        In order of time; in any unit.
    covariates : ndarray, shape (m, n, 2)
        Values of each, as each axis has it; finite. One that is constant explains nothing.
    when : ndarray, shape (n,)
        Times of the epochs, rising.
    alpha : float
        Chance that series which follow nothing are given a cause, in either axis.
    count : int
        Permutations beside the order as it was; all of them where there are no more.
    seed : int
        Of their choice.
    variances : ndarray, shape (n, 2), optional
        Of the errors of the series; by default all epochs weigh the same.

    Returns
    -------
    CovariateChoice
    """
    n, m = len(series), len(covariates)
    nothing = ((), ())
    if m == 0 or n < fewest_epochs(alpha):
        return CovariateChoice(nothing, nothing, nothing, np.ones(2), np.ones(2))
    sets = [s for k in range(1, min(MOST, m) + 1) for s in combinations(range(m), k)]
    if variances is None:
        variances = np.zeros((n, 2))
    views = [_View(series, covariates, None, sets, variances),
             _View(series, covariates, when, sets, variances),
             _View(np.diff(series, axis=0), np.diff(covariates, axis=1), None, sets, variances)]
    p_views = np.array([view.p_values(count, seed) for view in views])  # view, set, axis
    p_all = p_views.max(axis=0)
    best_first = np.argsort(views[0].log_p, axis=0, kind='stable')
    causes, alike, trend = [], [], []
    for axis in range(2):
        order = best_first[:, axis]
        chosen, others = _causes(views, sets, order, p_all[:, axis], axis, alpha)
        causes.append(() if others else chosen)
        alike.append((*chosen, *others) if others else ())
        seems = p_views[0, order[0], axis] <= alpha and not chosen
        trend.append(sets[order[0]] if seems else ())
    return CovariateChoice(tuple(causes), tuple(alike), tuple(trend), p_all.min(axis=0),
                           p_views[0].min(axis=0))


def _causes(views, sets, order, p_all, axis, alpha):
    """The covariates that an axis follows, and those that would do as well."""
    m = sets[-1][-1] + 1
    for s in order:
        if p_all[s] > alpha:
            continue
        chosen = sets[s]
        # each must be needed beside the other
        if len(chosen) > 1 and any(
                max(view.partial_p(one, chosen, axis) for view in views) > alpha / m
                for one in chosen):
            continue

        def as_well(one, other, chosen=chosen):
            """Whether `other` explains what `one` does, so that they cannot be distinguished."""
            swapped = tuple(sorted(other if c == one else c for c in chosen))
            return (p_all[sets.index(swapped)] <= alpha
                    and views[0].partial_p(one, (*chosen, other), axis) > alpha)
        return chosen, tuple(other for other in range(m) if other not in chosen
                             and any(as_well(one, other) for one in chosen))
    return (), ()


class _View:
    """Series (n, 2), covariates (m, n, 2) and a curve (n,) to be taken out of both, or None.

    All in units of the scatter of each epoch, by the variances of the errors of the epochs, (n, 2)
    or, of differences, (n + 1, 2).
    """

    def __init__(self, series, covariates, curve, sets, variances):
        n = len(series)
        taken_out = np.ones((n, 1))
        if curve is not None:
            curve = (curve - curve.mean()) / np.linalg.norm(curve - curve.mean())
            taken_out = np.column_stack([taken_out, curve])
        self._free = n - taken_out.shape[1]
        columns = np.moveaxis(covariates, 0, 1)  # n, m, axis
        self._taken_out = []  # of each axis, orthonormal, (n, 1 or 2)
        self._series, self._columns = np.empty((n, 2)), np.empty(columns.shape)
        for axis in range(2):
            own = columns[..., axis]
            alike = whitening(
                series[:, axis], np.column_stack([taken_out, own - own.mean(axis=0)]),
                variances[:, axis], differences=len(variances) > n)
            self._taken_out.append(np.linalg.qr(alike @ taken_out)[0])
            self._series[:, axis] = self._without(alike @ series[:, axis], axis)
            self._columns[..., axis] = self._without(alike @ own, axis)
        self._columns /= np.maximum(np.linalg.norm(self._columns, axis=0), 1e-300)
        self._sizes = np.array([len(s) for s in sets])
        #: of each axis and set orthonormal directions, none where one depends on others
        self._directions = [np.stack([_orthonormal(self._columns[:, s, axis]) for s in sets], 1)
                            for axis in range(2)]
        #: of the textbook's F test of each set and axis
        self.log_p = np.stack([self._log_p(self._shares(self._series[:, axis], axis), self._sizes)
                               for axis in range(2)], axis=-1)

    def _without(self, values, axis):
        out = self._taken_out[axis]
        return values - out @ (out.T @ values)

    def _shares(self, values, axis):
        """Of `values` (..., n) explained by each set, (..., sets)."""
        parts = np.square(np.tensordot(values, self._directions[axis], axes=1)).sum(axis=-1)
        total = np.sum(np.square(values), axis=-1) - np.square(
            values @ self._taken_out[axis]).sum(axis=-1)
        # what does not move follows nothing
        return parts / np.maximum(total, 1e-300)[..., None]

    def _log_p(self, shares, sizes):
        """Of F(size, free - size)."""
        from scipy.special import betainc
        dof = self._free - sizes
        with np.errstate(divide='ignore'):
            return np.maximum(np.log(betainc(
                0.5 * dof, 0.5 * sizes, np.clip(1.0 - shares, 0.0, 1.0))), -600.0)

    def p_values(self, count, seed):
        """Of each set and axis, against the best of all in permuted epochs: (sets, 2)."""
        rows, exact = _orders(len(self._series), count, seed)
        best = np.zeros(len(rows))
        for axis in range(2):
            shares = self._shares(self._series[:, axis][rows], axis)
            for size in np.unique(self._sizes):
                largest = shares[:, self._sizes == size].max(axis=1)
                best = np.minimum(best, self._log_p(largest, size))
        reached = np.searchsorted(np.sort(best), self.log_p * (1.0 - _ROUNDING), side='right')
        return reached / len(rows) if exact else (1.0 + reached) / (1.0 + len(rows))

    def partial_p(self, one, beside, axis):
        """Of Student's t of a covariate beside others (`beside` holds it too), two-sided."""
        dof = self._free - len(beside)
        if dof < 1:
            return 1.0
        others = _orthonormal(self._columns[:, [c for c in beside if c != one], axis])
        own, series = (v - others @ (others.T @ v) for v in (
            self._columns[:, one, axis], self._series[:, axis]))
        length = np.linalg.norm(own)
        if length < _DEPENDENT:
            return 1.0  # the same as the others
        part = own @ series / length
        rest = max(series @ series - part * part, 1e-300)
        return float(two_sided(part / np.sqrt(rest / dof), dof))


def _orthonormal(columns):
    """Of unit columns (n, k), to (n, `MOST`): zeros where one depends on those before it."""
    out = np.zeros((len(columns), MOST))
    for k, column in enumerate(columns.T):
        rest = column - out @ (out.T @ column)
        length = np.linalg.norm(rest)
        out[:, k] = rest / length if length > _DEPENDENT else 0.0
    return out


def _orders(n, count, seed):
    """Orders of n epochs, and whether these are all."""
    if n <= 8 and factorial(n) <= count + 1:
        return np.array(list(permutations(range(n)))), True
    rng = np.random.default_rng((seed, n))
    return rng.permuted(np.tile(np.arange(n), (count, 1)), axis=1), False
