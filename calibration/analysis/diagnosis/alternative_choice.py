"""Rivals of a found effect, each with companions of its own.

What else is in the model was chosen with the found effect in, and makes up for what that one does
wrong. A rival that takes up nearly the same loses with these companions, though with others it may
explain the run as well, or better. So the search is done once more, from the rival on and without
the effect, and whole models are compared.
"""

from dataclasses import dataclass, replace

import numpy as np

from .choice_rules import choose, settled
from .constants import LARGE, LIVE, MOST_TRIED, NEAR, SET_WIDTH
from .correlated_noise import White
from .problem import Choice
from .search import search

#: BIC behind from where rows left out are not asked: what they take back beside a rival was worth
#: little, and may have cost more than that
_FAR = 4.0 * SET_WIDTH


@dataclass
class Rival:
    """An effect of the dictionary in the place of a found one, with companions of its own.

    Attributes
    ----------
    choice : Choice
    chosen : Chosen
        All of its model.
    behind : float
        BIC of its model less that of the found one's.
    """

    choice: Choice
    chosen: object
    behind: float


def choose_with_rivals(problem, alpha, chance, partitions=()):
    """`choose`, and `with_rivals` of it."""
    return with_rivals(problem, choose(problem, alpha, chance, partitions), alpha, chance,
                       partitions)


def with_rivals(problem, chosen, alpha, chance, partitions=(), replacing=True):
    """Try near rivals of what was found with companions of their own, and let the best model win.

    Parameters
    ----------
    problem : Problem
    chosen : Chosen
        Its standings are changed: a rival whose model is as good is one of the alternatives.
    alpha, chance, partitions
        As of `choose`.
    replacing : bool
        Whether a model that is better by more than `SET_WIDTH`, with no more effects, is taken
        instead.

    Returns
    -------
    Chosen
    """
    left = MOST_TRIED
    for i in sorted(range(len(chosen.stands)), key=lambda i: -chosen.stands[i].delta_bic):
        near = near_rivals(problem, chosen, i)[:left] if left else []
        left -= len(near)
        tried = [rival for g in near if (rival := _tried(
            problem, chosen, i, g, near, alpha, chance, partitions)) is not None]
        chosen.stands[i].tried = {one.choice.group: one.behind for one in tried}
        best = min(tried, key=lambda one: one.behind, default=None)
        if best is None:
            continue
        # what needs more effects for it is no better explanation: both are told
        more = len(best.chosen.found.chosen) > len(chosen.found.chosen)
        if best.behind >= -SET_WIDTH or more or not replacing:
            _take_in(chosen, i, tried)
            continue
        rest = [replace(one, behind=one.behind - best.behind) for one in tried if one is not best]
        found, chosen = chosen.found, best.chosen
        chosen.replaced = True
        chosen.found.dropped_by_cv = list(dict.fromkeys(
            found.dropped_by_cv + chosen.found.dropped_by_cv))
        _take_in(chosen, chosen.found.chosen.index(best.choice), rest)
        break
    return chosen


def near_rivals(problem, chosen, i):
    """Candidates that alone take up nearly what a found effect does, and are not in its set.

    Parameters
    ----------
    problem : Problem
    chosen : Chosen
    i : int
        Of what was found.

    Returns
    -------
    list of int
        Groups of the dictionary, of each cause as people are told it the one that fits best; the
        nearest first. None of an effect that is small beside the largest, and of one so small that
        a rival so near would be in its set with any companions.
    """
    found, stand = chosen.found, chosen.stands[i]
    choice = found.chosen[i]
    if (not choice.plain or choice.changes(found.chosen)
            or stand.delta_bic * (1.0 - NEAR) < SET_WIDTH
            or stand.delta_bic < LARGE * max(s.delta_bic for s in chosen.stands)):
        return []
    bank = problem.dictionary
    taken = {bank.effects[k].cause_told for k in (choice.group, *stand.alternatives)}
    taken |= {c.effect(problem).cause_told for c in found.chosen}
    shares = signal_shares(problem, found, i)
    out = {}
    for g in np.argsort(-shares, kind='stable'):
        if shares[g] < NEAR:
            break
        told = bank.effects[g].cause_told
        if told not in taken and np.isfinite(stand.every[g]):
            out.setdefault(told, int(g))
    return list(out.values())


def signal_shares(problem, found, i):
    """Part of the signal of a choice, beyond the base, that each candidate takes up alone."""
    white, bank = found.state.white, problem.dictionary
    own = found.chosen[i].columns(problem)
    p, _ = problem.design([*found.without(i), found.chosen[i]]).solver(white)(problem.b)
    alone = replace(found.state, basis=problem.base.basis(white))
    signal = alone.basis.off(white(p[-len(own):] @ own))
    out = np.zeros(len(bank))
    for groups, basis, _ in bank.bases(alone):
        out[groups] = np.square(basis @ signal).sum(axis=1) / (signal @ signal)
    return out


def _tried(problem, chosen, i, g, near, alpha, chance, partitions):
    """`Rival` of a found effect with companions of its own; None where it does not hold so."""
    bank, found = problem.dictionary, chosen.found
    own, rival = found.chosen[i], Choice(g)
    # the found one and its other rivals would only share the lead
    told = {bank.effects[k].cause_told for k in (own.group, *near) if k != g}
    out = [*(Choice(k) for k, e in enumerate(bank.effects) if e.cause_told in told),
           *found.dropped_by_cv]
    if rival in out:
        return None
    other = search(problem, alpha, chance, out, first=(rival,))
    for folds in ((), partitions) if partitions else ((),):  # rows left out take the longest
        settled_so = settled(problem, other, alpha, chance, folds)
        other = settled_so.found
        if rival not in other.chosen:
            return None
        distance = behind(problem, found, other)
        if distance >= _FAR:
            break
    return Rival(rival, settled_so, distance)


def behind(problem, first, second):
    """BIC of one model less that of another, if rows have no memory.

    Parameters
    ----------
    problem : Problem
    first, second : Found
        The other, the one. Rows count as much as the worse of both fits lets them.

    Returns
    -------
    float
    """
    plain = problem.plain
    misfit, (size, other), live = less_likely(
        problem.b, [problem.design(f.chosen) for f in (first, second)],
        [plain.state(f.chosen, f.state.weights) for f in (first, second)])
    scanned, others = (sum(int(c.bank(problem).scan_cost[c.group]) for c in f.chosen)
                       for f in (first, second))
    return misfit + (other + others - size - scanned) * float(np.log(live))


def less_likely(b, designs, states):
    """2 ln(likelihood ratio) of a first model to a second, which need not be nested.

    Parameters
    ----------
    b : ndarray, shape (2n,)
    designs : sequence of Columns
        Of both.
    states : sequence of State
        Fits of them, without memory.

    Returns
    -------
    misfit : float
    sizes : list of int
        Columns of each that are not those of others.
    live : int
        Rows that count.
    """
    weights = np.minimum(*(state.weights for state in states))
    kept = np.where(states[0].weights > 0.0, states[0].weights, 1.0)
    white = White(states[0].white.root * np.tile(np.sqrt(weights / kept), 2))
    live = max(np.count_nonzero(weights > LIVE), 2)
    values = white(b)
    bases = [design.basis(white) for design in designs]
    left = [np.square(basis.off(values)).reshape(2, -1).sum(axis=1) + 1e-30 for basis in bases]
    return float(live * np.log(left[1] / left[0]).sum()), [len(basis) for basis in bases], live


def _take_in(chosen, i, rivals):
    """Let rivals whose models are as good be alternatives of a choice."""
    stand = chosen.stands[i]
    if not rivals:
        return
    stand.every = stand.every.copy()
    # what is better only with more effects stands beside it, no more
    more = [len(one.chosen.found.chosen) - len(chosen.found.chosen) for one in rivals]
    behind = [max(one.behind, 0.0) if n > 0 else one.behind for one, n in zip(rivals, more)]
    best = min(0.0, *behind)
    for one, n, distance in zip(rivals, more, behind):
        group = one.choice.group
        stand.every[group] = stand.delta_bic - distance
        if distance - best < SET_WIDTH:
            stand.alternatives.append(group)
            stand.companions[group] = [c for c in one.chosen.found.chosen if c != one.choice]
            if n > 0:
                stand.larger[group] = n, max(-one.behind, 0.0)
    stand.alternatives.sort(key=lambda k: -stand.every[k])
