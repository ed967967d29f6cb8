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

"""Which covariates a short series depends on: exact tests by permutation of its epochs.

A few epochs, such as nights, are too few for asymptotic tests, and a zero that follows a random
walk from night to night resembles a temperature that changes with the season. So every set of one
or two covariates is tested in three views, and a claimed cause must be significant in each:

``levels``
    The series itself. Exact where the series is independent from epoch to epoch, or, whatever the
    series, where the covariate is.
``steady drift taken out``
    Residuals of both from a straight line in time. For independent scatter about a drift.
``differences``
    From each epoch to the next, less their mean. Exact for a random walk: its steps are
    independent.

In each view the epochs of the series are permuted, both axes together, and every fit is compared
with the best fit of any set to any axis (Westfall & Young 1993, step-wise max-T): p is family-wise
over all covariates and both axes. Where epochs have errors of their own, values are permuted and
fitted in units of their scatter.
"""

from itertools import combinations, permutations
from math import factorial
from typing import NamedTuple

import numpy as np

from .extra_scatter import whitening
from .step_scan import two_sided

#: most covariates in a set: a dozen epochs allow two
MOST = 2
#: relative rounding error: a permutation this close counts as reaching the statistic
_ROUNDING = 1e-9
#: remaining length of a unit column, others projected out, below which it depends on them
_DEPENDENT = 1e-6


class CovariateChoice(NamedTuple):
    """The covariates that the series of each axis depends on.

    Attributes
    ----------
    causes : tuple of tuple of int
        Indices of the covariates claimed for each axis; empty where none is.
    alike : tuple of tuple of int
        Covariates that cannot be distinguished: the best set and those that fit as well in its
        place. Then none is claimed.
    trend : tuple of tuple of int
        Covariates significant in the levels, but not in the other views.
    p : ndarray, shape (2,)
        Family-wise p of the best set of each axis: the largest of the three views.
    p_levels : ndarray, shape (2,)
        The same of the levels alone.
    """

    causes: tuple
    alike: tuple
    trend: tuple
    p: np.ndarray
    p_levels: np.ndarray


def fewest_epochs(alpha):
    """Fewest epochs with which p can be as small as `alpha` in all views."""
    n = 5  # a straight line, a covariate and two epochs more
    while factorial(n - 1) * alpha < 1.0:
        n += 1
    return n


def choose_covariates(series, covariates, when, alpha, count=999, seed=1, *, variances=None):
    """Find the covariates that the series of both axes depend on.

    Parameters
    ----------
    series : ndarray, shape (n, 2)
        In order of time; in any unit.
    covariates : ndarray, shape (m, n, 2)
        Values of each covariate for each axis; finite. A constant one explains nothing.
    when : ndarray, shape (n,)
        Times of the epochs, ascending.
    alpha : float
        Family-wise error rate: probability of any cause, on either axis, if there is none.
    count : int
        Number of random permutations; all permutations if there are no more.
    seed : int
        Seed of the permutations.
    variances : ndarray, shape (n, 2), optional
        Variances of the errors of the series; by default all epochs have the same weight.

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
    """The covariates that an axis depends on, and those that would fit as well."""
    m = sets[-1][-1] + 1
    for s in order:
        if p_all[s] > alpha:
            continue
        chosen = sets[s]
        # each must be significant with the other in the model
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
    """Series (n, 2), covariates (m, n, 2) and a curve (n,) to project out of both, or None.

    All are whitened by the scatter of each epoch, from the variances of the errors: (n, 2), or
    (n + 1, 2) for differences.
    """

    def __init__(self, series, covariates, curve, sets, variances):
        n = len(series)
        taken_out = np.ones((n, 1))
        if curve is not None:
            curve = (curve - curve.mean()) / np.linalg.norm(curve - curve.mean())
            taken_out = np.column_stack([taken_out, curve])
        self._free = n - taken_out.shape[1]
        columns = np.moveaxis(covariates, 0, 1)  # n, m, axis
        self._taken_out = []  # orthonormal, (n, 1 or 2), for each axis
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
        #: orthonormal directions of each set, for each axis; zero where a column depends on others
        self._directions = [np.stack([_orthonormal(self._columns[:, s, axis]) for s in sets], 1)
                            for axis in range(2)]
        #: ln p of the ordinary F test of each set and axis
        self.log_p = np.stack([self._log_p(self._shares(self._series[:, axis], axis), self._sizes)
                               for axis in range(2)], axis=-1)

    def _without(self, values, axis):
        out = self._taken_out[axis]
        return values - out @ (out.T @ values)

    def _shares(self, values, axis):
        """Fraction of the variance of `values` (..., n) explained by each set, (..., sets)."""
        parts = np.square(np.tensordot(values, self._directions[axis], axes=1)).sum(axis=-1)
        total = np.sum(np.square(values), axis=-1) - np.square(
            values @ self._taken_out[axis]).sum(axis=-1)
        # constant values are explained by nothing
        return parts / np.maximum(total, 1e-300)[..., None]

    def _log_p(self, shares, sizes):
        """ln p of the F test with (size, free - size) degrees of freedom."""
        from scipy.special import betainc
        dof = self._free - sizes
        with np.errstate(divide='ignore'):
            return np.maximum(np.log(betainc(
                0.5 * dof, 0.5 * sizes, np.clip(1.0 - shares, 0.0, 1.0))), -600.0)

    def p_values(self, count, seed):
        """Family-wise p of each set and axis, (sets, 2), from the best of all in permutations."""
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
        """Two-sided p of a covariate with others in the model (`beside` contains it too)."""
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
    """Orthonormal columns (n, `MOST`) of unit columns (n, k); zero where one depends on others."""
    out = np.zeros((len(columns), MOST))
    for k, column in enumerate(columns.T):
        rest = column - out @ (out.T @ column)
        length = np.linalg.norm(rest)
        out[:, k] = rest / length if length > _DEPENDENT else 0.0
    return out


def _orders(n, count, seed):
    """Permutations of n epochs, and whether these are all."""
    if n <= 8 and factorial(n) <= count + 1:
        return np.array(list(permutations(range(n)))), True
    rng = np.random.default_rng((seed, n))
    return rng.permuted(np.tile(np.arange(n), (count, 1)), axis=1), False
