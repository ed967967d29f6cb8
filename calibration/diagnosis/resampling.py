"""Judging a choice of effects on rows that neither the fit nor the choice has seen."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import rms

from .constants import DISTINCT, LIVE, NESTED_FLIPS
from .linear import solve
from .search import Chance, search


def random_folds(n, count, rng):
    """Row numbers of `count` folds, drawn at random."""
    return [np.sort(f) for f in np.array_split(rng.permutation(n), count)]


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
    part = problem.rows(train)
    state = part.state(chosen, final=True)
    return _left(problem, part, chosen, state, test)


def _left(problem, part, chosen, state, test):
    design = part.design(chosen)
    common = design.common
    if design.own is None:
        p = solve(common, part.b, state.root)
    else:
        # the part of the common columns that no run can fit for itself
        own = design.added(())
        own.common = common[:0]
        basis = own.basis(state.root)
        white = common * state.root
        length = np.sqrt(np.square(white).sum(axis=1))
        white -= (white @ basis.T) @ basis
        # what these runs cannot tell from their own terms is not predicted
        white[np.sqrt(np.square(white).sum(axis=1)) < DISTINCT * length] = 0.0
        left = part.b * state.root
        left = left - (basis @ left) @ basis
        p = solve(white, left, np.ones_like(left)) if len(white) else np.empty(0)
    other = problem.rows(test)
    other.b = other.b - p @ other.design(chosen).common
    if design.own is not None and len(test):
        _own_terms(other, design, part.b - p @ common, state.root)
    return other.b.reshape(2, len(test))


def _own_terms(other, design, left, root):
    """Take off what each run fits for itself: from its rows in training, or else here."""
    new = np.ones(other.n, bool)
    for run in np.unique(other.base.run):
        here, there = other.base.run == run, np.tile(design.run == run, 2)
        if there.any():
            p = solve(design.own[:, there], left[there], root[there])
            both = np.tile(here, 2)
            other.b[both] -= p @ other.base.own[:, both]
            new &= ~here
    if new.any():
        rows = other.rows(np.flatnonzero(new))
        rows.base.common = rows.base.common[:0]
        other.b[np.tile(new, 2)] = rows.state([]).raw


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


def cv_gains(problem, found, folds):
    """What each choice takes off the cross-validated RMS, the others being in the model.

    Parameters
    ----------
    problem : Problem
    found : Found
    folds : list of ndarray of int

    Returns
    -------
    list of float
        Arcsec.
    """
    if not found.chosen:
        return []
    keep = found.state.weights > LIVE
    whole = radial_arcsec(cross_validate(problem, found.chosen, folds), keep)
    return [radial_arcsec(cross_validate(problem, [c for j, c in enumerate(found.chosen) if j != i],
                               folds), keep) - whole for i in range(len(found.chosen))]


def nested(problem, folds, alpha, rng, flips=NESTED_FLIPS):
    """As `cross_validate`, with the whole search repeated without each fold.

    Parameters
    ----------
    problem : Problem
    folds : list of ndarray of int
    alpha : float
    rng : numpy.random.Generator
    flips : int

    Returns
    -------
    residual : ndarray, shape (k + 1, 2, n)
        Radians: with the first 0, 1, ... k choices of each fold; k is the most that one has, and
        a fold that has fewer takes all of its own.
    choices : list of list of Choice
        Of each fold.
    """
    choices, parts = [], []
    everything = np.arange(problem.n)
    for fold in folds:
        train = np.setdiff1d(everything, fold)
        part = problem.rows(train)
        found = search(part, alpha, Chance(part.n, flips, rng))
        choices.append(found.chosen)
        left = []
        for k in range(len(found.chosen) + 1):
            state = part.state(found.chosen[:k], found.state.weights if k else None, final=True)
            left.append(_left(problem, part, found.chosen[:k], state, fold))
        parts.append(left)
    out = np.empty((max(map(len, parts)), 2, problem.n))
    for fold, left in zip(folds, parts):
        for k in range(len(out)):
            out[k][:, fold] = left[min(k, len(left) - 1)]
    return out, choices
