"""Which drivers a short series of zeros follows: exact tests by permutation of the nights.

A few nights are too few for the tables of a textbook, and a zero that walks from night to night
looks like a temperature that changes with the season. So every set of one or two drivers is tried
in three views, and what is claimed holds in each of them:

``levels``
    The zeros as they are. Exact where the zeros scatter from night to night, and, whatever they
    do, where the driver does.
``steady drift taken out``
    What both leave of a straight line in time. For zeros that scatter about a drift.
``differences``
    From each night to the next, less their mean. Exact where the zeros walk: then these scatter.

In each view the nights of the zeros are permuted, both axes together, and the best fit of any set
to any axis is what every fit is compared with (Westfall & Young 1993, the step-wise maximum of
p-values): a p holds for all drivers and both axes at once.
"""

from functools import lru_cache
from itertools import combinations, permutations
from math import factorial
from typing import NamedTuple

import numpy as np
from scipy.special import betainc, stdtr

#: chance that zeros which follow nothing are given a cause
ALPHA = 0.02
VIEWS = ('levels', 'steady drift taken out', 'differences')
#: drivers that are tried at once: two, of a dozen nights
MOST = 2
#: ratios of what is left to what was there, between which p-values are interpolated
_GRID = np.concatenate(([0.0], np.geomspace(1e-12, 1.0, 4000)))
#: equal up to rounding counts as reached
_ROUNDING = 1e-9


class CovariateChoice(NamedTuple):
    """What the zeros of each axis follow.

    Attributes
    ----------
    causes : tuple of tuple of int
        Of each axis the drivers that are claimed, by their place; empty where none is.
    alike : tuple of tuple of int
        Drivers that do as well in their place: nothing is claimed, and these and the ones above
        are what is to be told apart.
    trend : tuple of tuple of int
        Drivers that the levels follow, but not the other views.
    p : ndarray, shape (2,)
        Of the best set of each axis over all views, drivers and both axes.
    p_levels : ndarray, shape (2,)
        The same of the levels alone.
    """

    causes: tuple
    alike: tuple
    trend: tuple
    p: np.ndarray
    p_levels: np.ndarray


def fewest_nights(alpha):
    """Nights from which on a p of `alpha` can be reached at all, differences included."""
    n = 5  # a straight line, a driver and two nights more
    while factorial(n - 1) * alpha < 1.0:
        n += 1
    return n


def choose(zeros, drivers, when, alpha=ALPHA, count=999, seed=1):
    """What the zeros of both axes follow.

    Parameters
    ----------
    zeros : ndarray, shape (n, 2)
        Of the nights in order of time; in any unit.
    drivers : ndarray, shape (m, n, 2)
        Value of each driver, as each axis has it; finite. One that is constant explains nothing.
    when : ndarray, shape (n,)
        Times of the nights, rising.
    alpha : float
        Chance that zeros which follow nothing are given a cause, in either axis.
    count : int
        Permutations beside the order as it was; all of them where there are no more.
    seed : int
        Of their choice.

    Returns
    -------
    CovariateChoice
    """
    n, m = len(zeros), len(drivers)
    nothing = ((), ())
    if m == 0 or n < fewest_nights(alpha):
        return CovariateChoice(nothing, nothing, nothing, np.ones(2), np.ones(2))
    subsets = _subsets(m)
    fits = [_View(*_in_view(view, zeros, drivers, when)) for view in VIEWS]
    p_views = np.array([fit.p_values(subsets, count, seed) for fit in fits])  # view, subset, axis
    p_all = p_views.max(axis=0)
    best_first = np.argsort(fits[0].log_p(subsets), axis=0, kind='stable')
    causes, alike, trend = [], [], []
    for axis in range(2):
        order = best_first[:, axis]
        chosen, others = _causes(fits, subsets, order, p_all[:, axis], axis, alpha)
        causes.append(() if others else chosen)
        alike.append((*chosen, *others) if others else ())
        first = order[0]
        seems = p_views[0, first, axis] <= alpha and not chosen
        trend.append(subsets[first] if seems else ())
    return CovariateChoice(tuple(causes), tuple(alike), tuple(trend), p_all.min(axis=0),
                  p_views[0].min(axis=0))


def _subsets(m):
    return [s for k in range(1, min(MOST, m) + 1) for s in combinations(range(m), k)]


def _causes(fits, subsets, order, p_all, axis, alpha):
    """The drivers that an axis follows, and those that would do as well."""
    for s in order:
        if p_all[s] > alpha:
            continue
        chosen = subsets[s]
        if len(chosen) > 1:  # each must be needed beside the other
            needed = [max(fit.partial_p(d, chosen, axis) for fit in fits) <= alpha / fits[0].m
                      for d in chosen]
            if not all(needed):
                continue
        rest = [d for d in range(fits[0].m) if d not in chosen]
        others = tuple(
            o for o in rest if any(
                _as_well(fits[0], subsets, p_all, chosen, d, o, axis, alpha) for d in chosen))
        return chosen, others
    return (), ()


def _as_well(fit, subsets, p_all, chosen, driver, other, axis, alpha):
    """Whether `other` explains what `driver` does, so that nobody can tell which it is."""
    swapped = tuple(sorted(other if d == driver else d for d in chosen))
    return (p_all[subsets.index(swapped)] <= alpha
            and fit.partial_p(driver, (*chosen, other), axis) > alpha)


def _in_view(view, zeros, drivers, when):
    """Zeros, drivers and what is taken out of both, as a view has them."""
    if view == 'differences':
        return np.diff(zeros, axis=0), np.diff(drivers, axis=1), None
    return zeros, drivers, when if view == 'steady drift taken out' else None


class _View:
    """Zeros (n, 2), drivers (m, n, 2) and a curve (n,) to be taken out of both, or None."""

    def __init__(self, zeros, drivers, curve):
        self.n, self.m = len(zeros), len(drivers)
        self._curve = None
        self._free = self.n - 1
        if curve is not None:
            curve = curve - curve.mean()
            self._curve = curve / np.linalg.norm(curve)
            self._free -= 1
        self._zeros = self._without(zeros)
        self._drivers = self._without(np.moveaxis(drivers, 0, 1))  # n, m, axis
        norm = np.linalg.norm(self._drivers, axis=0)
        self._drivers = self._drivers / np.where(norm > 0.0, norm, 1.0)

    def _without(self, values):
        values = values - values.mean(axis=0)
        if self._curve is not None:
            values = values - np.multiply.outer(
                self._curve, np.tensordot(self._curve, values, axes=1))
        return values

    def _directions(self, subsets, axis):
        """Unit vectors: the drivers, then of each pair the second without the first."""
        d = self._drivers[..., axis]
        seconds = [d[:, j] - d[:, i] * (d[:, i] @ d[:, j])
                   for i, j in (s for s in subsets if len(s) == 2)]
        if not seconds:
            return d
        seconds = np.array(seconds).T
        length = np.linalg.norm(seconds, axis=0)
        # drivers that are the same leave no second direction
        seconds = seconds / np.where(length > 1e-6, length, np.inf)
        return np.concatenate((d, seconds), axis=1)

    def _explained(self, values, subsets, axis):
        """Share of `values` (k, n) by each driver (k, m) and by each pair (k, pairs)."""
        parts = (values @ self._directions(subsets, axis))**2
        total = np.einsum('ij,ij->i', values, values)
        if self._curve is not None:
            total -= (values @ self._curve)**2
        # zeros that do not move follow nothing
        parts /= np.maximum(total, 1e-300)[:, np.newaxis]
        firsts = [s[0] for s in subsets if len(s) == 2]
        return parts[:, :self.m], parts[:, self.m:] + parts[:, firsts]

    def log_p(self, subsets):
        """Of the textbook's F test of each subset and axis: shape (subsets, 2)."""
        return np.stack([np.concatenate(self._log_p(*self._explained(
            self._zeros[:, axis][np.newaxis], subsets, axis)), axis=1)[0]
            for axis in range(2)], axis=-1)

    def _log_p(self, one, two):
        return _log_p_one(self._free - 1, 1.0 - one), _log_p_two(self._free - 2, 1.0 - two)

    def p_values(self, subsets, count, seed):
        """Of each subset and axis, against the best of all in permuted nights: (subsets, 2)."""
        rows, exact = _permutations(self.n, count, seed)
        best = np.zeros(len(rows))
        for axis in range(2):
            one, two = self._explained(self._zeros[:, axis][rows], subsets, axis)
            best_two = two.max(axis=1) if two.shape[1] else np.zeros(len(rows))
            for log_p in self._log_p(one.max(axis=1), best_two):
                np.minimum(best, log_p, out=best)
        best = np.sort(best)
        reached = np.searchsorted(best, self.log_p(subsets) * (1.0 - _ROUNDING), side='right')
        return reached / len(rows) if exact else (1.0 + reached) / (1.0 + len(rows))

    def partial_p(self, driver, beside, axis):
        """Of Student's t of a driver beside others (`beside` holds it too), two-sided."""
        dof = self._free - len(beside)
        if dof < 1:
            return 1.0
        others = self._drivers[:, [d for d in beside if d != driver], axis]
        others = others[:, others.any(axis=0)]  # constant on this axis: nothing to take out
        basis = np.linalg.qr(others)[0]
        own, zeros = (v - basis @ (basis.T @ v) for v in (
            self._drivers[:, driver, axis], self._zeros[:, axis]))
        length = np.linalg.norm(own)
        if length < 1e-6:
            return 1.0  # the same as the others
        part = own @ zeros / length
        rest = max(zeros @ zeros - part * part, 1e-300)
        return float(2.0 * stdtr(dof, -abs(part) / np.sqrt(rest / dof)))


@lru_cache(maxsize=64)
def _log_p_table(dof):
    with np.errstate(divide='ignore'):
        return np.maximum(np.log(betainc(0.5 * dof, 0.5, _GRID)), -600.0)


def _log_p_one(dof, left):
    """log p of F(1, dof) that leaves this share."""
    return np.interp(left, _GRID, _log_p_table(dof))


def _log_p_two(dof, left):
    """log p of F(2, dof): exactly left^(dof / 2)."""
    return np.maximum(0.5 * dof * np.log(np.maximum(left, 1e-300)), -600.0)


@lru_cache(maxsize=256)
def _permutations(n, count, seed):
    """Orders of n nights, and whether these are all."""
    if n <= 8 and factorial(n) <= count + 1:
        return np.array(list(permutations(range(n)))), True
    rng = np.random.default_rng((seed, n))
    return rng.permuted(np.tile(np.arange(n), (count, 1)), axis=1), False
