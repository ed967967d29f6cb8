"""The search for effects that a fit lacks: forward, with a second look at each choice.

A candidate is added while the largest standardised score of all candidates is beyond chance
(family-wise, by sign flips of leverage-corrected residual pairs); of the candidates the one with
the largest penalised log-likelihood is taken. After each addition every earlier choice is
offered all candidates again, and what no longer pays is dropped. What the dictionary leaves is
then offered changes of what was found (an effect that grows through the night), and curves of each
driver: their verdict is *unknown*.
"""

import numpy as np

from .chance import ChanceTest
from .constants import (
    CURVE_SHARE,
    DICTIONARY_SHARE,
    MOST_EFFECTS,
    ROWS_PER_COLUMN,
    SET_WIDTH,
    SLOW,
)
from .memory_test import follows, swollen
from .problem import Choice, Found
from .scores import best_of

_SWEEPS = 2  # second looks at all choices: the second sees what the first has changed


def affordable(problem, state, size):
    return 2 * problem.n - len(state.basis) - size >= ROWS_PER_COLUMN * size + 2


def search(problem, alpha, chance, given_up=(), first=()):
    """Choose the effects.

    Parameters
    ----------
    problem : Problem
    alpha : float
        Family-wise error of the first choice of a clean run.
    chance : Chance
    given_up : sequence of Choice
        Not to be chosen again.
    first : sequence of Choice
        To begin with; they stay, whatever they are worth.

    Returns
    -------
    Found
    """
    plain = problem.plain
    found = Found(list(first), plain.state(list(first)), held=frozenset(first))
    _forward(problem, plain, found, alpha * DICTIONARY_SHARE, chance, given_up)
    for add, share, offered in ((_add_change, DICTIONARY_SHARE, problem.changes is not None),
                                (_add_curve, CURVE_SHARE, len(problem.curves))):
        while offered and len(found.chosen) < MOST_EFFECTS and add(
                problem, plain, found, alpha * share, chance, given_up):
            _forward(problem, plain, found, alpha * DICTIONARY_SHARE, chance, given_up)
    return found


def _forward(problem, plain, found, alpha, chance, given_up):
    """Add groups of the dictionary while one that pays is beyond chance, and beyond a wander."""
    seen = {frozenset(found.chosen)}
    without = [c.group for c in given_up if c.plain]
    blocked, found.wandering = [], [c for c in found.wandering if not c.plain]
    while len(found.chosen) < MOST_EFFECTS:
        g = _beyond_chance(plain, found.state, alpha, chance, [*without, *blocked])
        if g is None:
            break
        lost = _blocked(problem, found, problem.dictionary, g, alpha, chance)
        if len(lost):
            found.wandering.append(Choice(g))
            blocked += list(lost)
            continue
        found.chosen.append(Choice(g))
        found.state = plain.state(found.chosen, found.state.weights)
        second_look(plain, found, without)
        blocked, found.wandering = [], []
        # an addition that the second look takes back would go on for ever
        if frozenset(found.chosen) in seen:
            found.chosen = list(dict.fromkeys(found.chosen))
            found.state = plain.state(found.chosen)
            break
        seen.add(frozenset(found.chosen))


def _blocked(problem, found, bank, g, alpha, chance):
    """Groups that a wander explains as well as chance does: `g` and all weaker ones, or none."""
    if not follows(problem.sequence, bank, g, found.state):
        return ()
    state, slow, scores = problem.once((found.chosen, bank, found.state), lambda: _wandering(
        problem, found, bank))
    if not state.wander or not slow[g]:
        return ()
    if scores.dof[g] == 0:
        return (g,)
    if chance.p(state, scores, g, alpha) <= alpha or chance.p_beyond_wander(
            problem, found.chosen, bank, np.flatnonzero(slow), g) <= alpha:
        return ()
    z = ChanceTest(state, scores, g).all
    return np.flatnonzero(slow & (z <= z[g]))


def _wandering(problem, found, bank):
    """The choice beside a wander: its state, the groups that are slow, the scores of all."""
    state = problem.state(found.chosen, found.state.weights)
    if not state.wander:
        return state, None, None
    slow = swollen(bank, found.state, state) > SLOW
    return state, slow, bank.score(state) if slow.any() else None


def _beyond_chance(problem, state, alpha, chance, without):
    """The group with the largest gain that is beyond chance, or the one chance explains least."""
    scores = problem.dictionary.score(state)
    g, gain = best_of(scores, without)
    if gain <= 0.0:
        return None
    if chance.p(state, scores, g, alpha) > alpha:
        z = ChanceTest(state, scores, g).all.copy()
        z[without] = -np.inf
        other = int(np.argmax(np.where(scores.delta_bic > 0.0, z, -np.inf)))
        if other == g or chance.p(state, scores, other, alpha) > alpha:
            return None
        g = other
    return g if affordable(problem, state, len(problem.dictionary.of(g))) else None


def second_look(problem, found, without=()):
    """Offer every choice all candidates again, with the others in; drop what does not pay."""
    for _ in range(_SWEEPS):
        changed = False
        i = 0
        while i < len(found.chosen) and len(found.chosen) > 1:
            choice = found.chosen[i]
            if not choice.plain or choice.changes(found.chosen) or choice in found.held:
                i += 1
                continue
            state = problem.state(found.chosen, found.state.weights, without=i)
            scores = problem.dictionary.score(state)
            others = [*without, *(c.group for j, c in enumerate(found.chosen)
                                  if j != i and c.plain)]
            g, gain = best_of(scores, others)
            if gain <= 0.0:
                found.dropped.append(found.chosen.pop(i))
                found.state = state
                changed = True
                continue
            if g != choice.group and gain > scores.delta_bic[choice.group] + 0.01:
                found.chosen[i] = Choice(g)
                changed = True
            i += 1
        if not changed:
            break
        found.state = problem.state(found.chosen, found.state.weights)


def _add_change(problem, plain, found, alpha, chance, given_up):
    """That an effect which was found grows or fades."""
    if not any(c.plain for c in found.chosen):
        return False
    bank, choices = plain.changes.of_all(found.chosen)
    without = [i for i, c in enumerate(choices) if c in found.chosen or c in given_up]
    # of one effect one change
    without += [i for i, c in enumerate(choices) if any(c.of == k.of for k in found.chosen)]
    scores = bank.score(found.state)
    while len(without) < len(bank):
        g, gain = best_of(scores, without)
        if gain <= 0.0 or chance.p(found.state, scores, g, alpha) > alpha or not affordable(
                problem, found.state, len(bank.of(g))):
            return False
        lost = _blocked(problem, found, bank, g, alpha, chance)
        if not len(lost):
            found.chosen.append(choices[g])
            found.state = plain.state(found.chosen, found.state.weights)
            return True
        found.wandering.append(choices[g])
        without += list(lost)
    return False


def _add_curve(problem, plain, found, alpha, chance, given_up):
    """A curve beside the choice, or in place of the effects of the same driver."""
    without = [c.group for c in given_up if c.curve]
    while True:
        options = [*_curve_beside(plain, found, alpha, chance, without),
                   *_replacements(plain, found, without)]
        if not options:
            return False
        _, g, keep = max(options)
        beside = Found([found.chosen[i] for i in keep], found.state, held=found.held)
        beside.state = plain.state(beside.chosen)
        lost = _blocked(problem, beside, problem.curves, g, alpha, chance)
        if not len(lost):
            break
        found.wandering.append(Choice(g, True))
        without += list(lost)
    found.chosen = [*beside.chosen, Choice(g, True)]
    found.state = plain.state(found.chosen, found.state.weights)
    second_look(plain, found, [c.group for c in given_up if c.plain])
    return True


def _curve_beside(problem, found, alpha, chance, without):
    scores = problem.curves.score(found.state)
    scores.delta_bic[without] = -np.inf
    g, gain = best_of(scores)
    if gain <= 0.0:
        return []
    # of curves, the one that chance explains least: BIC would rather have half of a shape
    z = ChanceTest(found.state, scores, g).all
    g = int(np.argmax(np.where(scores.delta_bic > 0.0, z, -np.inf)))
    if chance.p(found.state, scores, g, alpha) > alpha or not affordable(
            problem, found.state, len(problem.curves.of(g))):
        return []
    return [(float(scores.delta_bic[g]), g, tuple(range(len(found.chosen))))]


def _replacements(problem, found, without):
    """Curves that beat all dictionary effects of one driver together by more than the set width."""
    out = []
    effects = [c.effect(problem) for c in found.chosen]
    kept_anyway = [not c.plain or c.changes(found.chosen) or c in found.held
                   for c in found.chosen]
    drivers = {e.driver for keep, e in zip(kept_anyway, effects) if not keep}
    for driver in drivers:
        keep = tuple(i for i, (anyway, e) in enumerate(zip(kept_anyway, effects))
                     if anyway or e.driver != driver)
        if len(found.chosen) - len(keep) < 1:
            continue
        kept = [found.chosen[i] for i in keep]
        state = problem.state(kept, found.state.weights)
        scores = problem.curves.score(state, gains_only=True)
        same = np.array([e.driver == driver for e in problem.curves.effects])
        if not same.any():
            continue
        same[without] = False
        g, gain = best_of(scores, np.flatnonzero(~same))
        lost = _bic_between(state, found.state) - sum(
            len(problem.dictionary.of(c.group)) * np.log(problem.n)
            for i, c in enumerate(found.chosen) if i not in keep)
        if gain > lost + SET_WIDTH:
            out.append((gain - lost, g, keep))
    return out


def _bic_between(small, large):
    """2 ln(likelihood ratio) of nested fits, at the weights of the larger."""
    n = small.n
    w = np.concatenate((large.weights, large.weights))
    rss = [(w * s.raw**2).reshape(2, n).sum(axis=1) + 1e-60 for s in (small, large)]
    return float(n * np.log(rss[0] / rss[1]).sum())
