"""Predicting rows that a fit has not seen."""

from types import SimpleNamespace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import rms

from .constants import DISTINCT
from .correlated_noise import White
from .subspaces import inverse_normal


def random_folds(group, count, rng):
    """Row numbers of `count` folds, drawn at random; rows of one group stay together."""
    names = np.unique(group)
    return [np.flatnonzero(np.isin(group, part))
            for part in np.array_split(rng.permutation(names), min(count, len(names)))]


def contiguous_folds(order, count):
    """Row numbers of `count` folds that follow one another in `order` (time, or the rows)."""
    return [np.sort(f) for f in np.array_split(np.argsort(order, kind='stable'), count)]


def run_folds(label, count, rng):
    """Row numbers of `count` folds of whole runs."""
    runs = rng.permutation(np.unique(label))
    return [np.flatnonzero(np.isin(label, part)) for part in np.array_split(runs, count)]


def effective_runs(label):
    """How many equal runs these runs are worth: n^2 / sum of n_i^2.

    Of seven rows and 49 the long run left out takes with it all that there is to fit.

    Parameters
    ----------
    label : ndarray of int, shape (n,)
        Run of each row.
    """
    counts = np.unique(label, return_counts=True)[1].astype(float)
    return float(counts.sum()**2 / np.square(counts).sum())


def predict(problem, chosen, train, test):
    """Residuals of `test` rows with everything fitted to `train` rows.

    Columns that each run fits for itself come from the run's `train` rows. A run that has none is
    a new night: they are refitted on its `test` rows, robustly; nothing else of those is used.

    Parameters
    ----------
    problem : Problem
    chosen : list of Choice
    train, test : ndarray of int

    Returns
    -------
    ndarray, shape (2, m)
        Radians.
    """
    whole = problem.only(chosen)
    part = whole.rows(train)
    return predicted(whole, part, [], part.state([], final=True), test)


def predicted(problem, part, chosen, state, test):
    """Residuals of `test` rows, shape (2, m), by the fit `state` of `chosen` to `part`, radians."""
    design = part.design(chosen)
    common = design.common
    if design.own is None:
        p = design.solved(part.b, state.white)
    else:
        # the part of the common columns that no run can fit for itself
        own = design.added(())
        own.common = common[:0]
        basis = own.basis(state.white)
        white = state.white(common)
        length = np.sqrt(np.square(white).sum(axis=1))
        white = basis.off(white)
        # what these runs cannot tell from their own terms is not predicted
        white[np.sqrt(np.square(white).sum(axis=1)) < DISTINCT * length] = 0.0
        left = state.white(part.b)
        left = basis.off(left)
        p = inverse_normal(white.copy()) @ (white @ left) if len(white) else np.empty(0)
    other = problem.rows(test)
    other.b = other.b - p @ other.design(chosen).common
    if design.own is not None and len(test):
        _own_terms(other, design, part.b - p @ common, state.white)
    return other.b.reshape(2, len(test))


def _own_terms(other, design, left, white):
    """Take off what each run fits for itself: from its rows in training, or else here."""
    new = np.ones(other.n, bool)
    each = White(white.root)  # as `linear.Solver`
    own, left = each(design.own), each(left)
    for run in np.unique(other.base.run):
        here, there = other.base.run == run, np.tile(design.run == run, 2)
        if there.any():
            p = inverse_normal(own[:, there]) @ (own[:, there] @ left[there])
            both = np.tile(here, 2)
            other.b[both] -= p @ other.base.own[:, both]
            new &= ~here
    if new.any():
        rows = other.rows(np.flatnonzero(new))
        rows.base.common = rows.base.common[:0]
        # zeros of a night are fitted as an observer would, not by its memory
        other.b[np.tile(new, 2)] = rows.plain.state([]).raw


def radial_arcsec(residual, keep):
    """Radial RMS in arcsec of the rows `keep` of residuals of shape (2, n), radians."""
    return rms(*residual[:, keep]) / ARCSEC


def cross_validate(problem, chosen, folds):
    """Residuals of every row predicted from the other folds, for a given choice.

    Returns
    -------
    ndarray, shape (2, n)
        Radians.
    """
    out = np.empty((2, problem.n))
    everything = np.arange(problem.n)
    for fold in folds:
        out[:, fold] = predict(problem, chosen, np.setdiff1d(everything, fold), fold)
    return out


def left_out(problem, chosen, state, folds):
    """`cross_validate` with the weights (and the wander) of a fit to all rows: faster.

    Parameters
    ----------
    problem : Problem
    chosen : list of Choice
    state : State
        Of a choice that these are of.
    folds : list of ndarray of int

    Returns
    -------
    ndarray, shape (2, n)
        Radians.
    """
    whole = problem.only(chosen)
    design, everything = whole.base, np.arange(problem.n)
    out = np.empty((2, problem.n))
    for fold in folds:
        if design.own is None:
            p = design.solved(problem.b, state.white.without(fold))
            both = np.concatenate((fold, fold + problem.n))
            out[:, fold] = (problem.b[both] - p @ design.common[:, both]).reshape(2, -1)
        else:
            train = np.setdiff1d(everything, fold)
            out[:, fold] = predicted(whole, whole.rows(train), [],
                                     SimpleNamespace(white=state.white.rows(train)), fold)
    return out
