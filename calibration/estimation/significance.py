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

"""Significance of each selected group with all others in the model."""

from dataclasses import dataclass, field

import numpy as np

from .equal_causes import equal_causes
from .false_alarms import SHARES
from .memory_test import MemoryMask


def beyond_chance(chance, fit, scores, g, alpha):
    """Whether a group is significant at its share of the family-wise error `alpha`."""
    # p cannot be smaller than the number of flips allows
    alpha = max(alpha * SHARES[scores.bank.effects[g].share], chance.least)
    return chance.p(fit, scores, g, alpha) <= alpha


def beside_memory(problem, chosen, i, plain):
    """The correlated-noise fit without a wave, if such noise can imitate the wave; else None.

    The noise is estimated without the wave: if there is only noise, the best of hundreds of slow
    waves absorbs so much of it that the rest seems too little correlated.
    """
    others = chosen[:i] + chosen[i + 1:]
    if problem.sequence is None:
        return None
    mask = MemoryMask.of(problem, others, problem.periods, plain)
    return mask.fit if mask.covers(chosen[i].group) else None


@dataclass
class Significance:
    """Test result of one selected group with all others in the model.

    Attributes
    ----------
    p : float
        Family-wise p: probability that noise gives any candidate so large a score.
    delta_bic : float
        Gain of the group in BIC.
    equals, same : list of int
    every : ndarray, shape (G,)
        Alternatives to the group, see `equal_causes.equal_causes`.
    others : dict of int to list of CandidateGroup
        For equals that are as good only with other groups added (`alternatives`): these groups.
    larger : dict of int to tuple of (int, float)
        For equals whose model has more groups: how many more, and by how much BIC it is better
        nevertheless, or 0.
    behind : dict of int to float
        For alternatives searched with groups of their own: how much worse (BIC) they are.
    """

    p: float
    delta_bic: float
    equals: list
    same: list
    every: np.ndarray
    others: dict = field(default_factory=dict)
    larger: dict = field(default_factory=dict)
    behind: dict = field(default_factory=dict)


def significances(problem, choice, alpha, chance):
    """`Significance` of each selected group; for the parameters see `significance`."""
    return [significance(problem, choice, i, chance, alpha)
            for i in range(len(choice.chosen))]


def significance(problem, choice, i, chance, alpha, alone=False, below=0.0):
    """Test one selected group with the others in the model, and find its alternatives.

    A group that correlated noise can imitate is tested against such noise.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice
    i : int
        Index in `choice.chosen`.
    chance : Chance
    alpha : float
        A p certainly above it need not be exact.
    alone : bool
        Skip the alternatives.
    below : float
        A p certainly not above it need not be exact.

    Returns
    -------
    Significance
    """
    chosen, weights = choice.chosen, choice.fit.weights
    bank, g = chosen[i].family(problem, chosen)
    fit = problem.plain.fit(chosen, weights, without=i)
    mask = MemoryMask.of(problem, chosen, bank, fit, i, choice.fit)
    masked = not chosen[i].period and mask.covers(g)
    if chosen[i].period:
        fit = beside_memory(problem, chosen, i, fit) or fit
    if masked:
        fit = mask.fit
    groups = [g] if alone else bank.same_share(g) if chosen[i].period else None
    scores = bank.score(fit, groups)
    p = chance.p(fit, scores, g, alpha) if scores.dof[g] else 1.0
    if masked and p > max(alpha, below) and scores.dof[g]:
        others = [c for j, c in enumerate(chosen) if j != i]
        p = min(p, chance.p_beyond_memory(problem, others, bank, mask, g))
        # the noise estimated with the group in the model
        scores = bank.score(problem.fit(chosen, weights, without=i,
                                        memory=problem.fit(chosen).memory), groups)
    every, equals, same = scores.delta_bic, [], []
    if not (chosen[i].curve or alone):
        every, equals, same = equal_causes(problem, choice, i, scores)
    if chosen[i].period:  # only the best of each scan: there are thousands of waves
        best = [*problem.periods.best_of_scans(scores, g), g]
        every = np.full(len(every), -np.inf)
        every[best] = scores.delta_bic[best]
    return Significance(p, float(scores.delta_bic[g]), equals, same, every)
