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

"""How each of a choice stands with all others in the model, and what could stand in its place."""

from dataclasses import dataclass, field

import numpy as np

from .candidates import TIE
from .linear_model import DISTINCT, contained, overlap
from .memory_test import MemoryMask

#: candidates within this BIC of the best are one set: from 6 on the evidence for one of two is
#: "strong" (Kass and Raftery 1995, section 3.2)
SET_WIDTH = 6.0
#: below the set, in BIC, to where what is scanned is asked between the places that were tried: its
#: place is not where it fits best, as that of what was found
_NEARLY = 3.0
#: squared cosine from which two groups are the same curve: what they do not share is then below
#: SET_WIDTH, 0.02 lambda^2 < 6, up to an effect of lambda = 17 times its noise
ALIAS = 0.98


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
    equals : list of int
        Groups of other lines of the ranking within `SET_WIDTH` of the best.
    same : list of int
        Of these the ones that are the same curve in this run (aliases).
    every : ndarray, shape (G,)
        Gain of each candidate in its place.
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
        if chosen[i].plain:
            every = _refined(problem, g, scores)
        equals = _equals(problem, choice, i, bank, g, every)
    if equals:
        own = scores.basis(g)
        # what it shares nothing with, as one of the other axis, is no cause of the same
        equals = [k for k in equals if overlap(own, scores.basis(k))[1] > DISTINCT
                  # nor what holds it and more of the same driver, and fits no better; a scan has
                  # directions, too
                  and (every[k] > every[g] or bank.effects[k].driver != bank.effects[g].driver
                       or scores.dof[k] <= scores.dof[g] + bank.scan_cost[g]
                       or contained(own, scores.basis(k)) <= ALIAS)]
        same = [k for k in equals if overlap(own, scores.basis(k))[0] > ALIAS]
    if chosen[i].period:  # of each scan the best: they are thousands
        best = [*problem.periods.best_of_scans(scores, g), g]
        every = np.full(len(every), -np.inf)
        every[best] = scores.delta_bic[best]
    return Significance(p, float(scores.delta_bic[g]), equals, same, every)


def _refined(problem, g, scores):
    """Gains, (G,), with what is scanned and nearly in the set of `g` where it fits best."""
    bank, gains = scores.bank, scores.delta_bic
    out, limit = gains.copy(), gains.max() - SET_WIDTH
    # of a line in the set the best is there already
    lines = {int(bank.line[g]), *bank.line[gains >= limit].tolist()}
    near = np.flatnonzero((gains < limit) & (gains > max(limit - _NEARLY, 0.0)))
    for k in near[np.argsort(-gains[near], kind='stable')]:
        if bank.effects[k].scan is not None and int(bank.line[k]) not in lines:
            out[k] = max(gains[k], problem.finer(int(k)).score(scores.fit).delta_bic.max())
        lines.add(int(bank.line[k]))
    return out


def _equals(problem, choice, i, bank, g, gains):
    """Groups of other lines that gain as much in the place of one of a choice."""
    one = choice.chosen[i]
    others = {c.family(problem, choice.chosen)[1] for j, c in enumerate(choice.chosen)
              if j != i and (c.curve, c.period, c.of is None) == (
                  one.curve, one.period, one.of is None)}
    limit, lines, near = gains.max() - SET_WIDTH, {int(bank.line[g])}, []
    # of two names of one curve the first, whatever the rounding
    for other in np.argsort(-np.round(gains / TIE), kind='stable'):
        if gains[other] < max(limit, 0.0):
            break
        if other != g and other not in others and int(bank.line[other]) not in lines:
            lines.add(int(bank.line[other]))
            near.append(int(other))
    return near
