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

"""How each of a choice stands with all others in the model."""

from dataclasses import dataclass, field

import numpy as np

from .equal_causes import equal_causes
from .false_alarms import SHARES
from .memory_test import MemoryMask


def beyond_chance(chance, fit, scores, g, alpha):
    """Whether a group is beyond chance, in its share of the false alarms."""
    # of few flips none may reach it
    alpha = max(alpha * SHARES[scores.bank.effects[g].share], chance.least)
    return chance.p(fit, scores, g, alpha) <= alpha


def beside_memory(problem, chosen, i, plain):
    """The fit without a wave, if noise that remembers may be mistaken for it; else None.

    The memory is that which the noise seems to have without the wave: of noise alone the best of
    hundreds of slow waves takes so much that what is left remembers too little.
    """
    others = chosen[:i] + chosen[i + 1:]
    if problem.sequence is None:
        return None
    mask = MemoryMask.of(problem, others, problem.periods, plain)
    return mask.fit if mask.covers(chosen[i].group) else None


@dataclass
class Significance:
    """How one chosen group stands with all others in the model.

    Attributes
    ----------
    p : float
        Family-wise, that chance gives any candidate a score like this.
    delta_bic : float
        Gain of the group.
    equals, same : list of int
    every : ndarray, shape (G,)
        What could stand in its place: see `equal_causes.equal_causes`.
    others : dict of int to list of CandidateGroup
        Of equals that are as good only with other groups beside them (`alternatives`): these.
    larger : dict of int to tuple of (int, float)
        Of equals whose model has more groups: so many more, and by how much (BIC) it is better all
        the same, or 0.
    behind : dict of int to float
        Of alternatives that were tried with groups of their own: how far behind (BIC) they are.
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
    """`Significance` of each of a choice; parameters as of `significance`."""
    return [significance(problem, choice, i, chance, alpha)
            for i in range(len(choice.chosen))]


def significance(problem, choice, i, chance, alpha, alone=False, below=0.0):
    """Test one of a choice with the others in the model, and find what could stand in its place.

    What noise with memory can be mistaken for is tested against such noise.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice
    i : int
        Of `choice.chosen`.
    chance : Chance
    alpha : float
        A p that is certain to be above need not be known.
    alone : bool
        Whether it is not asked what could stand in its place.
    below : float
        A p that is certain to be no larger need not be known.

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
        # what memory is left is known with the group in the model
        scores = bank.score(problem.fit(chosen, weights, without=i,
                                        memory=problem.fit(chosen).memory), groups)
    every, equals, same = scores.delta_bic, [], []
    if not (chosen[i].curve or alone):
        every, equals, same = equal_causes(problem, choice, i, scores)
    if chosen[i].period:  # of each scan the best: they are thousands
        best = [*problem.periods.best_of_scans(scores, g), g]
        every = np.full(len(every), -np.inf)
        every[best] = scores.delta_bic[best]
    return Significance(p, float(scores.delta_bic[g]), equals, same, every)
