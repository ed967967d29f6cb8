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

"""Cross-validation: folds of the rows, and residuals of held-out rows."""

import numpy as np

from .linear_model import DISTINCT

#: least eigenvalue of I - H of a fold for which leverages give its held-out residuals
_DETERMINED = 1e-4
#: folds of the cross-validation; with more than `LONG` rows, where each is slow, `FEW_FOLDS`
FOLDS, FEW_FOLDS, LONG = 10, 5, 1500
#: from this number of runs on a fold holds whole runs: with fewer it would be a third of the data
RUNS = 4


def random_folds(group, count, rng):
    """Row indices of `count` random folds; rows of one group stay together."""
    names = np.unique(group)
    return [np.flatnonzero(np.isin(group, part))
            for part in np.array_split(rng.permutation(names), min(count, len(names)))]


def contiguous_folds(order, count):
    """Row indices of `count` contiguous folds in `order` (of time, or of the rows)."""
    return [np.sort(f) for f in np.array_split(np.argsort(order, kind='stable'), count)]


def effective_runs(label):
    """Effective number of runs of equal length: n^2 / sum of n_i^2.

    With runs of 7 and 49 rows, holding out the long run would leave almost nothing to fit.

    Parameters
    ----------
    label : ndarray of int, shape (n,)
        Run of each row.
    """
    counts = np.unique(label, return_counts=True)[1].astype(float)
    return float(counts.sum()**2 / np.square(counts).sum())


def leaves_runs(problem):
    """Whether folds of a `SelectionProblem` hold whole runs: from `RUNS` effective runs on."""
    return not problem.by_rows and effective_runs(problem.sequence.run) >= RUNS


def predicted(problem, part, chosen, noise, test):
    """Residuals of `test` rows, predicted by a fit to a part of the rows.

    Effects are predicted with the places and periods found on the part. Columns that each run
    fits for itself are fitted to the run's rows in the part. A run without rows there is a new
    night: these columns are refitted robustly to its `test` rows; nothing else of those is used.

    Parameters
    ----------
    problem, part : SelectionProblem
        All rows, and the part.
    chosen : list of CandidateGroup
        Groups selected on the part.
    noise : WhiteNoise or CorrelatedNoise
        Noise of the part.
    test : ndarray of int
        Indices of the held-out rows.

    Returns
    -------
    ndarray, shape (2, m)
        Radians.
    """
    design = part.design(chosen)
    # columns degenerate with the runs' own columns are not predicted
    p, own = design.solver(noise, DISTINCT)(part.b)
    other = problem.other_rows(test, part, chosen)
    other.b = other.b - p @ other.base.common
    if design.groups:
        other.b -= other.base.spread(own[:, :, None])[0]
        new = ~np.isin(other.base.group, design.group)
        if new.any():
            rows = other.rows(np.flatnonzero(new[:len(test)]))
            rows.base = rows.base.without_common()
            # zeros of a night are fitted with white noise, as an observer would
            other.b[new] = rows.plain.fit([]).raw
    return other.b.reshape(2, len(test))


def cross_validate(problem, chosen, folds):
    """Cross-validated residuals of every row, for given groups.

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
    """`cross_validate` in several partitions, with the weights and noise of a fit to all rows.

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
        Radians; may be 0 in rows without weight.
    """
    design = problem.design(chosen)
    basis = None if design.groups else design.basis(noise)
    return [_fold_by_fold(problem, chosen, noise, folds) if basis is None or (
        out := _without_each(basis, noise, problem.b, folds)) is None else out
        for folds in partitions]


def _fold_by_fold(problem, chosen, noise, folds):
    """`cross_validate_quickly` in one partition, with a separate fit for each fold."""
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
    """Residuals of each fold by the fit without it, from one fit to all rows and the leverages.

    See Cook and Weisberg 1982, Residuals and Influence in Regression, section 3.2.

    Returns
    -------
    ndarray, shape (2, n), or None
        None where the other rows of a fold do not determine all columns.
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
    """Partitions for the cross-validation: random and contiguous folds; whole runs from 4 runs on.

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
    # neighbours in time (or in the order of the rows) may be correlated
    return [random_folds(sequence.group, count, rng),
            contiguous_folds(np.argsort(sequence.order), count)]
