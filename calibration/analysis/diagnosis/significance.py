"""How each chosen effect stands with all others in the model."""

from dataclasses import dataclass, field

import numpy as np

from .constants import ALIAS, DISTINCT, SET_WIDTH, SLOW
from .memory_test import follows, swollen
from .subspaces import overlap


@dataclass
class Standing:
    """How one chosen effect stands with all others in the model.

    Attributes
    ----------
    p : float
        Family-wise, that chance gives any candidate a score like this.
    delta_bic : float
        Gain of the effect.
    alternatives : list of int
        Groups of other lines of the ranking within `SET_WIDTH` of the best.
    same : list of int
        Of these the ones that are the same curve in this run (aliases).
    every : ndarray, shape (G,)
        Gain of each candidate in its place.
    companions : dict of int to list of Choice
        Of alternatives that are as good only with other companions, see `rechosen`: these.
    larger : dict of int to tuple of (int, float)
        Of alternatives whose model has more effects: so many more, and by how much (BIC) it is
        better all the same, or 0.
    tried : dict of int to float
        Of rivals that were tried with companions of their own: how far behind (BIC) they are.
    """

    p: float
    delta_bic: float
    alternatives: list
    same: list
    every: np.ndarray
    companions: dict = field(default_factory=dict)
    larger: dict = field(default_factory=dict)
    tried: dict = field(default_factory=dict)


def standing(problem, found, i, chance, alpha):
    """Test one choice with the others in the model, and find what could stand in its place.

    What a wander can be mistaken for is tested against a wander.

    Parameters
    ----------
    problem : Problem
    found : Found
    i : int
        Of `found.chosen`.
    chance : Chance
    alpha : float
        A p that is certain to be above need not be known.

    Returns
    -------
    Standing
    """
    bank, g = found.chosen[i].family(problem, found.chosen)
    state = problem.plain.state(found.chosen, found.state.weights, without=i)
    if follows(problem.sequence, bank, g, state):
        whole = problem.state(found.chosen, found.state.weights, without=i)
        slow = swollen(bank, state, whole) > SLOW if whole.wander else np.zeros(len(bank), bool)
        if slow[g]:
            return _beside_wander(problem, found, i, chance, alpha, whole, np.flatnonzero(slow))
    scores = bank.score(state)
    return _standing(problem, found, i, scores, _p(chance, state, scores, g, alpha))


def _p(chance, state, scores, g, alpha):
    """Of a choice; 1 where the others in the model leave nothing of it."""
    return chance.p(state, scores, g, alpha) if scores.dof[g] else 1.0


def _beside_wander(problem, found, i, chance, alpha, state, slow):
    bank, g = found.chosen[i].family(problem, found.chosen)
    scores = bank.score(state)
    p = _p(chance, state, scores, g, alpha)
    if p > alpha and scores.dof[g]:
        others = [c for j, c in enumerate(found.chosen) if j != i]
        p = min(p, chance.p_beyond_wander(problem, others, bank, slow, g))
        # what is left to wander is known with the effect in the model
        scores = bank.score(problem.state(found.chosen, found.state.weights, without=i,
                                          wander=problem.state(found.chosen).wander))
    return _standing(problem, found, i, scores, p)


def _standing(problem, found, i, scores, p):
    choice = found.chosen[i]
    bank, g = choice.family(problem, found.chosen)
    others = {c.family(problem, found.chosen)[1] for j, c in enumerate(found.chosen)
              if j != i and (c.curve, c.of is None) == (choice.curve, choice.of is None)}
    limit = scores.delta_bic.max() - SET_WIDTH
    lines = {int(bank.line[g])}
    near = []
    if not choice.curve:
        for other in np.argsort(-scores.delta_bic):
            if scores.delta_bic[other] < max(limit, 0.0):
                break
            if other != g and other not in others and int(bank.line[other]) not in lines:
                lines.add(int(bank.line[other]))
                near.append(int(other))
    same = []
    if near:
        own = scores.basis(g)
        # what it shares nothing with, as one of the other axis, is no cause of the same
        near = [k for k in near if overlap(own, scores.basis(k))[1] > DISTINCT]
        same = [k for k in near if overlap(own, scores.basis(k))[0] > ALIAS]
    return Standing(p, float(scores.delta_bic[g]), near, same, scores.delta_bic)
