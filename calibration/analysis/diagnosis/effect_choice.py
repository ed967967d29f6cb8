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


"""Selection of the effects: search with clustered outliers, alternatives, refined scans."""

import numpy as np

from calibration.estimation.backward_elimination import eliminate
from calibration.estimation.select import choose
from pointing_model.rms import radial_arcsec

from ..finding import Finding
from .alternatives import compare_alternatives
from .period_scans import settle_periods
from .residual_patterns import ResidualRows, gathered


def choose_effects(run, alpha, chance, partitions, first_answer=None):
    """Search for effects, and compare them with alternatives.

    Parameters
    ----------
    run : RunProblem
    alpha, chance, partitions
        See `select.choose`.
    first_answer : callable, optional
        See `diagnose`.

    Returns
    -------
    ModelChoice
    """
    choice = _choose_beside_outliers(run, alpha, chance, partitions)
    settle_periods(run.problem, choice)
    if first_answer:
        first_answer(_first_answer(run.problem, choice))
    choice = compare_alternatives(run.problem, choice, alpha, chance, partitions)
    settle_periods(run.problem, choice)
    return choice


def _choose_beside_outliers(run, alpha, chance, partitions):
    """`choose`, with a cluster of outliers kept as good rows if an effect explains it.

    `run.problem` then keeps the weight of these rows. Clusters are tried one at a time: next to the
    outliers of another cluster no effect would be significant.
    """
    plain = run.problem
    groups = gathered(ResidualRows.from_observations(run.obs, plain.plain.fit([]).raw))
    trusted = np.zeros(plain.n, int)
    if groups:
        trusted[np.concatenate(groups)] = -1
    choice, first = None, ()
    for group in groups:
        more = trusted.copy()
        more[group] = 1
        problem = plain.trusting(more, first)
        found = choose(problem, alpha, chance, partitions)
        kept = plain.plain.fit(found.chosen, final=True).weights[group] > 0.0
        if np.mean(kept) > 0.5:
            choice, trusted, run.problem = found, more, problem
            first = tuple(c for c in found.chosen
                          if c.plain and c.effect(problem).share == 'scans')
    return choice or choose(plain, alpha, chance, partitions)


def _first_answer(problem, choice):
    """Finding: the effects of a search, and the fit RMS without and with them, arcsec."""
    before, after = (radial_arcsec(fit.raw.reshape(2, -1), fit.weights > 0.0)
                     for fit in (problem.plain.fit([]), choice.fit))
    return Finding('first answer', before=before, after=after, causes=tuple(
        dict.fromkeys(c.effect(problem).name for c in choice.chosen)))


def keep_repeated(problem, choice, count, alpha, chance, partitions):
    """Keep the first `count` effects of a choice: cross-validation does not confirm the others.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice
        Changed in place.
    count : int
    alpha, chance, partitions
        See `select.choose`.
    """
    choice.not_repeated = choice.chosen[count:]
    del choice.chosen[count:]
    choice.fit = problem.plain.fit(choice.chosen)
    eliminate(problem, choice, alpha, chance, partitions)
    compare_alternatives(problem, choice, alpha, chance, partitions, replacing=False)


def refine_scans(run, choice):
    """Refine the position of each effect found by a scan: the search tries a coarse grid only."""
    problem = run.problem
    for i, one in enumerate(choice.chosen):
        if not one.plain or not one.effect(problem).searched:
            continue
        near = problem.finer(one.group)
        # refit the weights: with the old ones, rows between the two positions look like outliers
        scores = near.score(problem.plain.fit(choice.chosen, without=i))
        best = int(np.argmax(scores.delta_bic))
        problem.replace(one.group, near.effects[best], near.of(best))
