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

"""Folds of the rows, and predicting rows that a fit has not seen."""

import numpy as np

from .linear_model import DISTINCT

#: part of a direction of the columns that rows beside a fold must determine, to be predicted by the
#: leverage of the fold's rows
_DETERMINED = 1e-4
#: folds of the cross-validation; of `LONG` rows on, where each takes long, at most `FEW_FOLDS`
FOLDS, FEW_FOLDS, LONG = 10, 5, 1500
#: runs from which on whole runs are left out: with fewer, a fold is a third of all there is
RUNS = 4


def random_folds(group, count, rng):
    """Row numbers of `count` folds, drawn at random; rows of one group stay together."""
    names = np.unique(group)
    return [np.flatnonzero(np.isin(group, part))
            for part in np.array_split(rng.permutation(names), min(count, len(names)))]


def contiguous_folds(order, count):
    """Row numbers of `count` folds that follow one another in `order` (time, or the rows)."""
    return [np.sort(f) for f in np.array_split(np.argsort(order, kind='stable'), count)]


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


def leaves_runs(problem):
    """Whether whole runs of a `SelectionProblem` are left out: from `RUNS` on."""
    return not problem.by_rows and effective_runs(problem.sequence.run) >= RUNS


def predicted(problem, part, chosen, noise, test):
    """Residuals of `test` rows by a fit to a part of the rows.

    What the part has chosen is predicted at the places and periods that the part has found.
    Columns that each run fits for itself come from the run's rows in the part. A run that has none
    is a new night: they are refitted on its `test` rows, robustly; nothing else of those is used.

    Parameters
    ----------
    problem, part : SelectionProblem
        The whole, and the part.
    chosen : list of CandidateGroup
    noise : WhiteNoise or CorrelatedNoise
        Of the part.
    test : ndarray of int

    Returns
    -------
    ndarray, shape (2, m)
        Radians.
    """
    design = part.design(chosen)
    # what these runs cannot tell from their own terms is not predicted
    p, own = design.solver(noise, DISTINCT)(part.b)
    other = problem.other_rows(test, part, chosen)
    other.b = other.b - p @ other.base.common
    if design.groups:
        other.b -= other.base.spread(own[:, :, None])[0]
        new = ~np.isin(other.base.group, design.group)
        if new.any():
            rows = other.rows(np.flatnonzero(new[:len(test)]))
            rows.base = rows.base.without_common()
            # zeros of a night are fitted as an observer would, not by its memory
            other.b[new] = rows.plain.fit([]).raw
    return other.b.reshape(2, len(test))


def cross_validate(problem, chosen, folds):
    """Residuals of every row predicted from the other folds, for a given choice.

    Returns
    -------
    ndarray, shape (2, n)
        Radians.
    """
    whole = problem.only(chosen)
    out, everything = np.empty((2, problem.n)), np.arange(problem.n)
    for fold in folds:
        part = whole.rows(np.setdiff1d(everything, fold))
        out[:, fold] = predicted(whole, part, [], part.fit([], final=True).noise, fold)
    return out


def cross_validate_quickly(problem, chosen, noise, partitions):
    """`cross_validate` with the weights and the noise of a fit to all rows, in several partitions.

    Parameters
    ----------
    problem : SelectionProblem
    chosen : list of CandidateGroup
    noise : WhiteNoise
    partitions : sequence of list of ndarray of int
        Folds.

    Returns
    -------
    list of ndarray, shape (2, n)
        Radians; of rows without weight they may be 0.
    """
    design = problem.design(chosen)
    basis = None if design.groups else design.basis(noise)
    return [_fold_by_fold(problem, chosen, noise, folds) if basis is None or (
        out := _without_each(basis, noise, problem.b, folds)) is None else out
        for folds in partitions]


def _fold_by_fold(problem, chosen, noise, folds):
    """`cross_validate_quickly` in one partition, each fold by a fit of its own."""
    whole = problem.only(chosen)
    design, everything = whole.base, np.arange(problem.n)
    out = np.empty((2, problem.n))
    for fold in folds:
        if not design.groups:
            p, _ = design.solver(noise.without(fold))(problem.b)
            both = np.concatenate((fold, fold + problem.n))
            out[:, fold] = (problem.b[both] - p @ design.common[:, both]).reshape(2, -1)
        else:
            train = np.setdiff1d(everything, fold)
            out[:, fold] = predicted(whole, whole.rows(train), [], noise.rows(train), fold)
    return out


def _without_each(basis, noise, b, folds):
    """Residuals of each fold by the fit without it, from one fit of all rows and the leverage of
    the fold's (Cook and Weisberg 1982, Residuals and Influence in Regression, section 3.2).

    Returns
    -------
    ndarray, shape (2, n), or None
        None where the other rows do not determine all columns.
    """
    n, rows = len(b) // 2, basis.common
    left = basis.off(noise.whiten(b))
    parts = [np.concatenate((fold, fold + n)) for fold in folds]
    kept = np.eye(len(rows)) - np.array([rows[:, part] @ rows[:, part].T for part in parts])
    if np.linalg.eigvalsh(kept)[:, :1].min(initial=1.0) < _DETERMINED:
        return None
    out = np.zeros(2 * n)
    for part, more in zip(parts, np.linalg.solve(kept, np.array(
            [rows[:, part] @ left[part] for part in parts])[..., None])):
        out[part] = left[part] + more[:, 0] @ rows[:, part]
    return (out / np.where(noise.root > 0.0, noise.root, np.inf)).reshape(2, n)


def partitions_of(problem, count, rng):
    """Folds by which a choice is judged: at random and in stretches; whole runs from 4 runs on.

    Parameters
    ----------
    problem : SelectionProblem
    count : int
    rng : numpy.random.Generator

    Returns
    -------
    list of list of ndarray of int
    """
    sequence = problem.sequence
    if problem.n > LONG:
        count = min(count, FEW_FOLDS)
    if leaves_runs(problem):
        return [random_folds(sequence.run, count, rng)]
    # neighbours in time (or in the order of the rows) may share their error
    return [random_folds(sequence.group, count, rng),
            contiguous_folds(np.argsort(sequence.order), count)]
