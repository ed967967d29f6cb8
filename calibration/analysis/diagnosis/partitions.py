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


"""Folds into which the rows are divided, to leave one out after the other."""

import numpy as np

from calibration.estimation.folds import contiguous_folds, effective_runs, random_folds, run_folds

#: folds of the cross-validation; of `LONG` rows on, where each takes long, at most `FEW_FOLDS`
FOLDS, FEW_FOLDS, LONG = 10, 5, 1500
#: runs from which on whole runs are left out: with fewer, a fold is a third of all there is
RUNS = 4


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
    if effective_runs(sequence.run) >= RUNS:
        return [run_folds(sequence.run, min(count, len(np.unique(sequence.run))), rng)]
    return [random_folds(sequence.group, count, rng), _stretches(problem, count)]


def _stretches(problem, count):
    """Folds of neighbours in time (or in the order of the rows), who may share their error."""
    return contiguous_folds(np.argsort(problem.sequence.order), count)
