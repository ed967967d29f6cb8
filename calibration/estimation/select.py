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

"""Forward selection of groups of columns that a fit lacks, then backward elimination.

A candidate is added while the largest standardised score of all candidates is significant
(family-wise, by sign flips of leverage-corrected residual pairs). The candidate added is the one
with the largest penalised log-likelihood. After each addition every earlier group is compared
with all candidates again, and dropped or replaced if it no longer pays. Once the dictionary is
exhausted the search tries changes of the selected effects (one that grows through the night, say),
waves of unknown period, and smooth curves of each driver, whose causes are unknown. Each selected
group must stay significant with all others in the model, and improve the cross-validated RMS.
The same rules apply to a whole run and to each fold of its cross-validation, but folds try waves
and curves only where the whole run has found one.
"""

from dataclasses import replace

import numpy as np

from .backward_elimination import eliminate
from .candidate_scores import CandidateGroup, best_of, largest
from .chance import ChanceTest
from .equal_causes import SET_WIDTH
from .false_alarms import MEMORY_SHARE
from .group_columns import orthonormal
from .linear_model import DISTINCT
from .memory_test import MemoryMask
from .selection_problem import ModelChoice
from .significance import beside_memory, beyond_chance

#: residual degrees of freedom that must remain, for each coefficient of a new effect
ROWS_PER_COLUMN = 1.5
#: most effects that a search adds
MOST_EFFECTS = 20
#: most searches, each without the groups that cross-validation has rejected before
ROUNDS = 4
#: refinements of a place, each on a grid four times finer; BIC that a refinement must gain
_LEVELS, _WORTH = 3, 0.5
#: squared cosine, beyond the base, above which a second bump of a scan would only correct the
#: place or width of the first: that of two bumps nearly two widths apart
_TWINS = 0.15
_SWEEPS = 2  # passes over all selected groups: the second sees what the first has changed


def choose(problem, alpha, chance, partitions=()):
    """Search by forward selection, then eliminate what does not hold.

    Each group must be significant with all others in the model, and improve the cross-validated
    RMS in every partition (random folds, stretches of time, or whole runs). A group that fails
    the cross-validation is excluded, and the search is repeated without it.

    Parameters
    ----------
    problem : SelectionProblem
    alpha : float
        Family-wise error rate of the first selection, in a run with nothing wrong.
    chance : Chance
    partitions : sequence of list of ndarray of int
        Folds.

    Returns
    -------
    ModelChoice
    """
    given_up = []
    for _ in range(ROUNDS):
        choice = eliminate(problem, search(problem, alpha, chance, given_up), alpha, chance,
                           partitions)
        lost = [c for c in choice.dropped_by_cv if c not in given_up]
        if not lost:
            break
        given_up += lost
    choice.dropped_by_cv = list(dict.fromkeys([*given_up, *choice.dropped_by_cv]))
    return choice


def search(problem, alpha, chance, given_up=(), first=()):
    """Select groups without cross-validation.

    Parameters
    ----------
    problem, alpha, chance
        See `choose`.
    given_up : sequence of CandidateGroup
        Groups not to be selected.
    first : sequence of CandidateGroup
        Groups to start with; they are never dropped.

    Returns
    -------
    ModelChoice
    """
    plain = problem.plain
    first = list(dict.fromkeys([*first, *(c for c in problem.first if c not in given_up)]))
    choice = ModelChoice(first, plain.fit(first), held=frozenset(first))
    _forward(problem, plain, choice, alpha, chance, given_up)
    for add, offered in ((_add_change, problem.variants is not None),
                         (_add_period, _offered(problem.periods, chance)),
                         (_add_curve, _offered(problem.curves, chance))):
        while offered and len(choice.chosen) < MOST_EFFECTS and add(
                problem, plain, choice, alpha, chance, given_up):
            _forward(problem, plain, choice, alpha, chance, given_up)
    return choice


def _offered(bank, chance):
    """Whether waves or curves are tried: in a repeated search only if the first has found some.

    A fold that selected a curve would otherwise test something that the model does not contain.
    """
    return len(bank) > 0 and (not chance.searched_before or bool(bank.by_chance))


def affordable(problem, fit, size):
    """Whether there are enough rows for `size` more columns."""
    return 2 * problem.n - len(fit.basis) - size >= ROWS_PER_COLUMN * size + 2


def _forward(problem, plain, choice, alpha, chance, given_up):
    """Add dictionary groups while one gains BIC and exceeds white and correlated noise."""
    bank, seen = problem.dictionary, {frozenset(choice.chosen)}
    without = [c.group for c in given_up if c.plain]
    blocked, choice.masked = [], [c for c in choice.masked if not c.plain]
    mask = _mask(problem, choice, bank)
    while len(choice.chosen) < MOST_EFFECTS:
        g = _beyond_chance(plain, choice.fit, alpha, chance,
                           [*without, *blocked, *_twins(plain, choice)])
        if g is None:
            break
        lost = _masked(problem, choice, bank, mask, g, alpha, chance)
        if len(lost):
            # another group that correlated noise can imitate may yet exceed that noise
            other, p = (None, 1.0) if blocked else chance.beyond_memory(
                problem, choice.chosen, bank, mask, without)
            choice.masked += [CandidateGroup(k) for k in dict.fromkeys((other, g))
                              if k is not None]
            blocked += list(lost)
            if p > alpha * MEMORY_SHARE or not affordable(
                    problem, choice.fit, len(bank.of(other))):
                continue
            g = other
            choice.against_memory.add(CandidateGroup(g))
        choice.chosen.append(CandidateGroup(g))
        choice.fit = plain.fit(choice.chosen, choice.fit.weights)
        refine(plain, choice)
        second_look(plain, choice, without)
        blocked, choice.masked = [], []
        # an addition that the second look undoes would be repeated for ever
        if frozenset(choice.chosen) in seen:
            choice.chosen = list(dict.fromkeys(choice.chosen))
            choice.fit = plain.fit(choice.chosen)
            break
        seen.add(frozenset(choice.chosen))
        mask = _mask(problem, choice, bank)


def _mask(problem, choice, bank):
    return MemoryMask.of(problem, choice.chosen, bank, choice.fit)


def _masked(problem, choice, bank, mask, g, alpha, chance):
    """`g` and all weaker groups with a gain, if correlated noise explains `g`; else none."""
    if not mask.covers(g):
        return ()
    scores = bank.score(mask.fit, [g])
    if scores.dof[g] == 0:
        return (g,)
    if beyond_chance(chance, mask.fit, scores, g, alpha) or chance.p_beyond_memory(
            problem, choice.chosen, bank, mask, g) <= alpha * MEMORY_SHARE:
        return ()
    some = mask.covered(np.flatnonzero(bank.score(choice.fit).delta_bic > 0.0))
    z = ChanceTest(mask.fit, scores, g, np.union1d(some, [g])).all
    return np.union1d(some[z[some] <= z[g]], [g])


def _beyond_chance(problem, fit, alpha, chance, without):
    """Group with the largest gain if significant, else a significant best-scored one of a share.

    None where none is significant, or where there are too few rows for it.
    """
    scores = problem.dictionary.score(fit)
    g, gain = best_of(scores, without)
    if gain <= 0.0:
        return None
    if not beyond_chance(chance, fit, scores, g, alpha):
        pays = np.setdiff1d(np.flatnonzero(scores.delta_bic > 0.0), without)
        z = ChanceTest(fit, scores, g, pays).all
        # best score of each share
        others = [int(some[np.argmax(z[some])]) for groups in scores.bank.shares.values()
                  if len(some := np.intersect1d(groups, pays))]
        others = [k for k in others if k != g and beyond_chance(chance, fit, scores, k, alpha)]
        if not others:
            return None
        g = max(others, key=lambda k: scores.delta_bic[k])
    return g if affordable(problem, fit, len(problem.dictionary.of(g))) else None


def refine(problem, choice):
    """Move each selected member of a scan to its best place between the neighbours on the grid.

    Otherwise the residual of a large effect at a slightly wrong place looks like another effect.
    """
    for i, one in enumerate(choice.chosen):
        if not one.plain or one.effect(problem).share == 'dictionary':
            continue
        fit = problem.fit(choice.chosen, choice.fit.weights, without=i)
        gain = problem.dictionary.score(fit, [one.group]).delta_bic[one.group]
        for level in range(_LEVELS):
            near = problem.finer(one.group, level)
            best, better = best_of(near.score(fit), _twins(problem, choice, one, near))
            if better <= gain + _WORTH:
                break
            problem.replace(one.group, near.effects[best], near.of(best))
            gain = better
            choice.fit = problem.fit(choice.chosen, choice.fit.weights)


def _twins(problem, choice, one=None, near=None):
    """Groups (of the dictionary, or of the bank `near` to `one`) too close to a selected bump.

    Two bumps of one scan at one place imitate one of another width, with heights that cancel.
    """
    bank, line, out = near or problem.dictionary, problem.dictionary.line, []
    for other in choice.chosen:
        if other == one or not other.plain or not other.effect(problem).is_bump:
            continue
        if near is None:
            groups = np.flatnonzero(line == line[other.group])
        elif line[one.group] != line[other.group]:
            continue
        else:
            groups = np.arange(len(near))
        base = replace(choice.fit, basis=problem.base.basis(choice.fit.noise))
        own = next(problem.dictionary.bases(base, [other.group]))[1][0]
        for some, basis, _ in bank.bases(base, groups):
            out += some[np.square(basis[:, 0] @ own[0]) > _TWINS].tolist()
    return out


def second_look(problem, choice, without=()):
    """Compare each selected group with all candidates, the others fixed; replace or drop it."""
    for _ in range(_SWEEPS):
        changed, i, gains = False, 0, None
        while i < len(choice.chosen):
            one = choice.chosen[i]
            if not _may_go(choice, one) or one in choice.against_memory:
                i += 1
                continue
            if gains is None:
                gains = _in_place(problem, choice)
            mine = gains[one].copy()
            mine[[*without, *_twins(problem, choice, one),
                  *(c.group for c in choice.chosen if c.plain and c != one)]] = -np.inf
            g = largest(mine)
            if mine[g] <= 0.0:
                choice.dropped.append(choice.chosen.pop(i))
            elif g != one.group and mine[g] > gains[one][one.group] + 0.01:
                choice.chosen[i] = CandidateGroup(g)
                i += 1
            else:
                i += 1
                continue
            changed, gains = True, None
            choice.fit = problem.fit(choice.chosen, choice.fit.weights)
        if not changed:
            break


def _may_go(choice, one):
    """Whether a selected group may be dropped or replaced by another of the dictionary."""
    return one.plain and not one.changes(choice.chosen) and one not in choice.held


def _in_place(problem, choice):
    """Gains of all dictionary groups in place of each replaceable one, at the fit's weights.

    Returns
    -------
    dict of CandidateGroup to ndarray of shape (G,)
    """
    fit, key = choice.fit, (_in_place, tuple(choice.chosen), choice.held)
    if key not in fit.known:  # the next search, without rejected groups, starts the same way
        fit.known[key] = _gains_in_place(problem, choice, fit)
    return fit.known[key]


def _gains_in_place(problem, choice, fit):
    design, parts = problem.design(choice.chosen).common, {}
    white = fit.noise.whiten(design)
    length, white = np.sqrt(np.square(white).sum(axis=1)), white @ fit.basis.common.T
    stop = len(design)
    for one in reversed(choice.chosen):
        own = slice(stop - len(one.columns(problem)), stop)
        stop = own.start
        if _may_go(choice, one):
            others = orthonormal(np.delete(white, own, axis=0))
            beyond = white[own] - (white[own] @ others.T) @ others
            parts[one] = orthonormal(beyond[
                np.sqrt(np.square(beyond).sum(axis=1)) > DISTINCT * length[own]])
    return dict(zip(parts, problem.dictionary.gains_without(fit, problem.b, list(parts.values()))))


def _add_change(problem, plain, choice, alpha, chance, given_up):
    """Try to add a change (growth or decay, say) of a selected effect; whether one was added."""
    if not any(c.plain for c in choice.chosen):
        return False
    bank, groups = plain.changes_of(choice.chosen)
    without = [i for i, c in enumerate(groups) if c in choice.chosen or c in given_up]
    # one change for each effect
    without += [i for i, c in enumerate(groups) if any(c.of == k.of for k in choice.chosen)]
    scores, mask = bank.score(choice.fit), _mask(problem, choice, bank)
    while len(without) < len(bank):
        g, gain = best_of(scores, without)
        if gain <= 0.0 or not beyond_chance(chance, choice.fit, scores, g, alpha) or not affordable(
                problem, choice.fit, len(bank.of(g))):
            return False
        lost = _masked(problem, choice, bank, mask, g, alpha, chance)
        if not len(lost):
            choice.chosen.append(groups[g])
            choice.fit = plain.fit(choice.chosen, choice.fit.weights)
            return True
        choice.masked.append(groups[g])
        without += list(lost)
    return False


def _add_period(problem, plain, choice, alpha, chance, given_up):
    """Try to add a wave of unknown period; whether one was added."""
    bank = problem.periods
    lost = [c.group for c in given_up if c.period]
    while len(lost) < len(bank.scans) + len(given_up):
        scores = bank.score(choice.fit)
        g = bank.offer(scores, lost)
        if g < 0 or not beyond_chance(chance, choice.fit, scores, g, alpha) or not affordable(
                problem, choice.fit, len(bank.of(g))):
            return False
        if len(problem.curves) and best_of(problem.curves.score(choice.fit))[1] > \
                scores.delta_bic[g]:
            return False  # a bump has power at many periods, too
        group, rate = bank.shaped(choice.fit, g)
        one = CandidateGroup(group, period=True)
        if one in choice.chosen:
            return False
        problem.tune(group, rate)
        chosen = [*choice.chosen, one]
        fit = beside_memory(problem, chosen, len(chosen) - 1, choice.fit)
        if fit is None or beyond_chance(chance, fit, bank.score(fit), g, alpha):
            choice.chosen, choice.fit = chosen, plain.fit(chosen, choice.fit.weights)
            second_look(plain, choice, [c.group for c in given_up if c.plain])
            return True
        choice.masked.append(one)
        lost.append(g)
    return False


def _add_curve(problem, plain, choice, alpha, chance, given_up):
    """Try to add a curve, or replace all effects of one driver by it; whether one was added."""
    without = [c.group for c in given_up if c.curve]
    while True:
        options = [*_curve_beside(plain, choice, alpha, chance, without),
                   *_replacements(plain, choice, without)]
        if not options:
            return False
        _, g, keep = max(options)
        kept = [choice.chosen[i] for i in keep]
        beside = choice if kept == choice.chosen else ModelChoice(kept, plain.fit(kept))
        lost = _masked(problem, beside, problem.curves, _mask(problem, beside, problem.curves), g,
                       alpha, chance)
        if not len(lost):
            break
        choice.masked.append(CandidateGroup(g, True))
        without += list(lost)
    choice.chosen = [*kept, CandidateGroup(g, True)]
    choice.fit = plain.fit(choice.chosen, choice.fit.weights)
    second_look(plain, choice, [c.group for c in given_up if c.plain])
    return True


def _curve_beside(problem, choice, alpha, chance, without):
    scores = problem.curves.score(choice.fit)
    g, gain = best_of(scores, without)
    if gain <= 0.0:
        return []
    # the most significant curve: BIC prefers one with fewer columns that fits half of the shape
    pays = np.setdiff1d(np.flatnonzero(scores.delta_bic > 0.0), without)
    g = int(np.argmax(ChanceTest(choice.fit, scores, g, pays).all))
    if not beyond_chance(chance, choice.fit, scores, g, alpha) or not affordable(
            problem, choice.fit, len(problem.curves.of(g))):
        return []
    return [(float(scores.delta_bic[g]), g, tuple(range(len(choice.chosen))))]


def _replacements(problem, choice, without):
    """Curves that beat all dictionary effects of one driver together by more than `SET_WIDTH`."""
    out, bank = [], problem.dictionary
    drivers = [c.effect(problem).driver for c in choice.chosen]
    free = [_may_go(choice, c) for c in choice.chosen]
    for driver in {d for d, of in zip(drivers, free) if of}:
        keep = tuple(i for i, of in enumerate(free) if not of or drivers[i] != driver)
        fit = problem.fit([choice.chosen[i] for i in keep], choice.fit.weights)
        same = np.array([e.driver == driver for e in problem.curves.effects])
        if not same.any():
            continue
        scores = problem.curves.score(fit, np.flatnonzero(same))
        same[without] = False
        g, gain = best_of(scores, np.flatnonzero(~same))
        lost = _bic_between(fit, choice.fit) - sum(
            (len(bank.of(c.group)) + bank.scan_cost[c.group]) * np.log(problem.n)
            for i, c in enumerate(choice.chosen) if i not in keep)
        if gain > lost + SET_WIDTH:
            out.append((gain - lost, g, keep))
    return out


def _bic_between(small, large):
    """2 ln(likelihood ratio) of nested fits, at the weights and given sigmas of the larger."""
    n, root = small.n, large.noise.root
    rss = [np.square(root * s.raw).reshape(2, n).sum(axis=1) + 1e-60 for s in (small, large)]
    return float(n * np.log(rss[0] / rss[1]).sum())
