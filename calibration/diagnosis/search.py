"""The search for effects that a fit lacks: forward, with a second look at each choice.

A candidate is added while the largest standardised score of all candidates is beyond chance
(family-wise, by sign flips of leverage-corrected residual pairs); of the candidates the one with
the largest penalised log-likelihood is taken. After each addition every earlier choice is
offered all candidates again, and what no longer pays is dropped. What the dictionary leaves is
then offered curves of each driver: their verdict is *unknown*.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from .against_wander import AgainstWander
from .chance import ChanceTest
from .constants import (
    ALIAS,
    CURVE_SHARE,
    DICTIONARY_SHARE,
    FAR,
    MOST_EFFECTS,
    NIGHTS,
    ROWS_PER_COLUMN,
    SET_WIDTH,
    SLOW,
    UNLIKE,
)
from .linear import Columns, fit_state, overlap, wandering, whitened
from .scores import Bank
from .wander import Sequence

_SWEEPS = 2  # second looks at all choices: the second sees what the first has changed


@dataclass
class Problem:
    """Offsets that the base leaves, the base's columns, and the candidates.

    Attributes
    ----------
    base : Columns
        First-order columns of everything that is fitted anyway.
    b : ndarray, shape (2n,)
        Offsets (after the exact rotations of the base), radians.
    inverse_sigma : ndarray, shape (2n,), or None
    dictionary, curves : Bank
    sequence : Sequence, optional
        Rows may resemble their neighbours in it; without it their noise has no memory.
    """

    base: Columns
    b: np.ndarray
    inverse_sigma: np.ndarray | None
    dictionary: Bank
    curves: Bank
    sequence: Sequence | None = None
    _wanders: dict = field(default_factory=dict, repr=False)
    _part: bool = False

    @property
    def plain(self):
        """The same, with noise that has no memory."""
        return replace(self, sequence=None)

    @property
    def n(self):
        """Rows."""
        return len(self.b) // 2

    def rows(self, rows):
        """The problem of some rows (indices); what wanders is known from all of them."""
        both = np.concatenate((rows, rows + self.n))
        return Problem(self.base.rows(both), self.b[both],
                       None if self.inverse_sigma is None else self.inverse_sigma[both],
                       self.dictionary.rows(rows), self.curves.rows(rows),
                       None if self.sequence is None else self.sequence.rows(rows),
                       self._wanders, True)

    def only(self, chosen):
        """The same with the columns of a choice in the base, and nothing to choose from."""
        none = Bank([], None, np.empty((0, 2 * self.n)))
        known = self._wanders.get(frozenset(chosen))
        return Problem(self.design(chosen), self.b, self.inverse_sigma, none, none, self.sequence,
                       {} if known is None else {frozenset(): known}, self._part)

    def state(self, chosen, weights=None, without=None, final=False, wander=None):
        """Fit of the base and the chosen groups.

        Parameters
        ----------
        chosen : list of Choice
        weights : ndarray, shape (n,), optional
            Of a fit of nearly the same.
        without : int, optional
            Of `chosen`, to be left out.
        final : bool
        wander : tuple of AxisWander, optional
            Known; else it is estimated from what this fit leaves.

        Returns
        -------
        State
        """
        design = self.design(chosen, without)
        state = fit_state(design, self.b, self.inverse_sigma, weights, final)
        if self.sequence is None:
            return state
        if wander is None:
            key = frozenset(c for i, c in enumerate(chosen) if i != without)
            wander = self._wanders.get(key)
            if wander is None:
                wander = wandering(state, design, self.b, self.sequence)
                if not self._part:
                    self._wanders[key] = wander
        if not any(one.variance > 0.0 for one in wander):
            return state
        return whitened(state, design, self.b, self.sequence, wander)

    def design(self, chosen, without=None):
        """Columns of the base and the chosen groups."""
        return self.base.added(
            [c.columns(self) for i, c in enumerate(chosen) if i != without])


@dataclass(frozen=True)
class Choice:
    """A group of the dictionary (or of the curves)."""

    group: int
    curve: bool = False

    def bank(self, problem):
        """Where it comes from."""
        return problem.curves if self.curve else problem.dictionary

    def columns(self, problem):
        """Shape (d, 2n)."""
        return self.bank(problem).of(self.group)

    def effect(self, problem):
        """The `Effect`."""
        return self.bank(problem).effects[self.group]


@dataclass
class Found:
    """What a search chose.

    Attributes
    ----------
    chosen : list of Choice
    state : State
        Of the base and the choice, if rows have no memory.
    dropped, dropped_by_cv, not_repeated : list of Choice
        Chosen once, and given up: it did not pay any more, or not on rows left out, or the search
        without some runs chose so differently that those were predicted worse.
    wandering : list of Choice
        Beyond chance if rows had no memory, but not beyond a zero that wanders.
    """

    chosen: list
    state: object
    dropped: list = field(default_factory=list)
    dropped_by_cv: list = field(default_factory=list)
    not_repeated: list = field(default_factory=list)
    wandering: list = field(default_factory=list)


class Chance:
    """Sign flips, drawn once and shared by all tests of a search.

    Parameters
    ----------
    n : int
        Rows.
    count : int
        Flips.
    rng : numpy.random.Generator
    """

    def __init__(self, n, count, rng):
        self.signs = rng.integers(0, 2, (count, n)).astype(np.float32) * 2.0 - 1.0
        self._rng, self._n = rng.spawn(1)[0], n
        self._against = {}

    @cached_property
    def _normal(self):
        return self._rng.standard_normal((NIGHTS, 2 * self._n))

    def p_beyond_wander(self, problem, chosen, bank, groups, g):
        """`AgainstWander.p` of a group, beside a choice of the same problem."""
        if bank is problem.curves:  # a curve without a cause says no more than a wander
            return 1.0
        key = frozenset(chosen)
        if key not in self._against:
            self._against[key] = AgainstWander(problem, chosen, bank, groups, self._normal)
        return self._against[key].p(g)

    def p(self, state, scores, group, alpha=None):
        """Family-wise p of a group: share of flips whose best score reaches its own.

        Parameters
        ----------
        state : State
            Without the group.
        scores : Scores
        group : int
        alpha : float, optional
            Stop when the share is certain to be above.
        """
        test = ChanceTest(state, scores, group)
        count = len(self.signs)
        limit = count if alpha is None else int(np.ceil(alpha * (count + 1)))
        hits, start = 0, 0
        for stop in (*range(200, count, 400), count):
            best = test.flipped_max(self.signs[start:stop])
            hits += int(np.sum(best >= test.z))
            start = stop
            if hits > limit:
                return max((hits + 1) / (stop + 1), 1.0001 * alpha)
            if test.z > best.max() + FAR:  # no flip will come near
                break
        return (hits + 1) / (count + 1)


    def p_of_all(self, state, scores):
        """Family-wise p of every group, with the residual that the best one leaves.

        Returns
        -------
        ndarray, shape (G,)
        """
        group, _ = _best(scores)
        if group < 0 or not np.isfinite(scores.delta_bic[group]):
            return np.ones(len(scores.dof))
        test = ChanceTest(state, scores, group)
        best = np.sort(test.flipped_max(self.signs))
        hits = len(best) - np.searchsorted(best, test.all, side='left')
        return (hits + 1.0) / (len(best) + 1.0)


def _affordable(problem, state, size):
    return 2 * problem.n - len(state.basis) - size >= ROWS_PER_COLUMN * size + 2


def _best(scores, excluded=()):
    dbic = scores.delta_bic.copy()
    dbic[list(excluded)] = -np.inf
    g = int(np.argmax(dbic)) if len(dbic) else -1
    return (g, float(dbic[g])) if g >= 0 else (-1, -np.inf)


def search(problem, alpha, chance, given_up=()):
    """Choose the effects.

    Parameters
    ----------
    problem : Problem
    alpha : float
        Family-wise error of the first choice of a clean run.
    chance : Chance
    given_up : sequence of Choice
        Not to be chosen again.

    Returns
    -------
    Found
    """
    plain = problem.plain
    found = Found([], plain.state([]))
    _forward(problem, plain, found, alpha * DICTIONARY_SHARE, chance, given_up)
    if len(problem.curves):
        for _ in range(MOST_EFFECTS - len(found.chosen)):
            if not _add_curve(problem, plain, found, alpha * CURVE_SHARE, chance, given_up):
                break
            _forward(problem, plain, found, alpha * DICTIONARY_SHARE, chance, given_up)
    return found


def _forward(problem, plain, found, alpha, chance, given_up):
    """Add groups of the dictionary while one that pays is beyond chance, and beyond a wander."""
    seen = {frozenset(found.chosen)}
    without = [c.group for c in given_up if not c.curve]
    blocked, found.wandering = [], [c for c in found.wandering if c.curve]
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
        _second_look(plain, found, without)
        blocked, found.wandering = [], []
        # an addition that the second look takes back would go on for ever
        if frozenset(found.chosen) in seen:
            found.chosen = list(dict.fromkeys(found.chosen))
            found.state = plain.state(found.chosen)
            break
        seen.add(frozenset(found.chosen))


def _blocked(problem, found, bank, g, alpha, chance):
    """Groups that a wander explains as well as chance does: `g` and all weaker ones, or none."""
    if not _follows(problem.sequence, bank, g, found.state):
        return ()
    state = problem.state(found.chosen, found.state.weights)
    if not state.wander:
        return ()
    slow = swollen(bank, found.state, state) > SLOW
    if not slow[g]:
        return ()
    scores = bank.score(state)
    if scores.dof[g] == 0:
        return (g,)
    if chance.p(state, scores, g, alpha) <= alpha or chance.p_beyond_wander(
            problem, found.chosen, bank, np.flatnonzero(slow), g) <= alpha:
        return ()
    z = ChanceTest(state, scores, g).all
    return np.flatnonzero(slow & (z <= z[g]))


def _follows(sequence, bank, g, state):
    """Whether a group goes with the order of the rows at all: cheaper than `swollen`."""
    columns = state.white(bank.of(g))
    columns = state.basis.off(columns)
    columns = columns.reshape(-1, sequence.order.size)[:, sequence.order]
    before = np.einsum('ij,ij->', columns[:, 1:], columns[:, :-1])
    return before > UNLIKE * np.einsum('ij,ij->', columns, columns)


def swollen(bank, white, wandering):
    """By how much a wander swells the variance of each group's score, if it is not reckoned with.

    Parameters
    ----------
    bank : Bank
    white, wandering : State
        Of the same choice, without and with a wander.

    Returns
    -------
    ndarray, shape (G,)
    """
    columns = white.white(bank.columns)
    columns = white.basis.off(columns)
    spread = wandering.white.spread(columns * white.white.root)
    both = [np.add.reduceat(np.square(c).sum(axis=1), bank.starts) for c in (spread, columns)]
    return both[0] / np.maximum(both[1], 1e-300)


def _beyond_chance(problem, state, alpha, chance, without):
    """The group with the largest gain that is beyond chance, or the one chance explains least."""
    scores = problem.dictionary.score(state)
    g, gain = _best(scores, without)
    if gain <= 0.0:
        return None
    if chance.p(state, scores, g, alpha) > alpha:
        z = ChanceTest(state, scores, g).all.copy()
        z[without] = -np.inf
        other = int(np.argmax(np.where(scores.delta_bic > 0.0, z, -np.inf)))
        if other == g or chance.p(state, scores, other, alpha) > alpha:
            return None
        g = other
    return g if _affordable(problem, state, len(problem.dictionary.of(g))) else None


def _second_look(problem, found, without=()):
    """Offer every choice all candidates again, with the others in; drop what does not pay."""
    for _ in range(_SWEEPS):
        changed = False
        i = 0
        while i < len(found.chosen) and len(found.chosen) > 1:
            choice = found.chosen[i]
            if choice.curve:
                i += 1
                continue
            state = problem.state(found.chosen, found.state.weights, without=i)
            scores = problem.dictionary.score(state)
            others = [*without, *(c.group for j, c in enumerate(found.chosen)
                                  if j != i and not c.curve)]
            g, gain = _best(scores, others)
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


def _add_curve(problem, plain, found, alpha, chance, given_up):
    """A curve beside the choice, or in place of the effects of the same driver."""
    without = [c.group for c in given_up if c.curve]
    while True:
        options = [*_curve_beside(plain, found, alpha, chance, without),
                   *_replacements(plain, found, without)]
        if not options:
            return False
        _, g, keep = max(options)
        beside = Found([found.chosen[i] for i in keep], found.state)
        beside.state = plain.state(beside.chosen)
        lost = _blocked(problem, beside, problem.curves, g, alpha, chance)
        if not len(lost):
            break
        found.wandering.append(Choice(g, True))
        without += list(lost)
    found.chosen = [*beside.chosen, Choice(g, True)]
    found.state = plain.state(found.chosen, found.state.weights)
    _second_look(plain, found, [c.group for c in given_up if not c.curve])
    return True


def _curve_beside(problem, found, alpha, chance, without):
    scores = problem.curves.score(found.state)
    scores.delta_bic[without] = -np.inf
    g, gain = _best(scores)
    if gain <= 0.0:
        return []
    # of curves, the one that chance explains least: BIC would rather have half of a shape
    z = ChanceTest(found.state, scores, g).all
    g = int(np.argmax(np.where(scores.delta_bic > 0.0, z, -np.inf)))
    if chance.p(found.state, scores, g, alpha) > alpha or not _affordable(
            problem, found.state, len(problem.curves.of(g))):
        return []
    return [(float(scores.delta_bic[g]), g, tuple(range(len(found.chosen))))]


def _replacements(problem, found, without):
    """Curves that beat all dictionary effects of one driver together by more than the set width."""
    out = []
    effects = [c.effect(problem) for c in found.chosen]
    drivers = {e.driver for c, e in zip(found.chosen, effects) if not c.curve}
    for driver in drivers:
        keep = tuple(i for i, (c, e) in enumerate(zip(found.chosen, effects))
                     if c.curve or e.driver != driver)
        if len(found.chosen) - len(keep) < 1:
            continue
        kept = [found.chosen[i] for i in keep]
        state = problem.state(kept, found.state.weights)
        scores = problem.curves.score(state)
        same = np.array([e.driver == driver for e in problem.curves.effects])
        if not same.any():
            continue
        same[without] = False
        g, gain = _best(scores, np.flatnonzero(~same))
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
    scores : Scores
    """

    p: float
    delta_bic: float
    alternatives: list
    same: list
    scores: object


def standing(problem, found, i, chance, enough=None):
    """Test one choice with the others in the model, and find what could stand in its place.

    What a wander can be mistaken for is tested against a wander.

    Parameters
    ----------
    problem : Problem
    found : Found
    i : int
        Of `found.chosen`.
    chance : Chance
    enough : float, optional
        A p that is certain to be above need not be known.

    Returns
    -------
    Standing
    """
    choice = found.chosen[i]
    bank = choice.bank(problem)
    g = choice.group
    state = problem.plain.state(found.chosen, found.state.weights, without=i)
    if _follows(problem.sequence, bank, g, state):
        whole = problem.state(found.chosen, found.state.weights, without=i)
        slow = swollen(bank, state, whole) > SLOW if whole.wander else np.zeros(len(bank), bool)
        if slow[g]:
            return _beside_wander(problem, found, i, chance, enough, whole, np.flatnonzero(slow))
    scores = bank.score(state)
    return _standing(problem, found, i, scores, chance.p(state, scores, g, enough))


def _beside_wander(problem, found, i, chance, enough, state, slow):
    choice = found.chosen[i]
    bank, g = choice.bank(problem), choice.group
    scores = bank.score(state)
    p = chance.p(state, scores, g, enough)
    if p > (enough or 0.01):
        others = [c for j, c in enumerate(found.chosen) if j != i]
        p = min(p, chance.p_beyond_wander(problem, others, bank, slow, g))
        # what is left to wander is known with the effect in the model
        scores = bank.score(problem.state(found.chosen, found.state.weights, without=i,
                                          wander=problem.state(found.chosen).wander))
    return _standing(problem, found, i, scores, p)


def _standing(problem, found, i, scores, p):
    choice = found.chosen[i]
    bank, g = choice.bank(problem), choice.group
    others = {c.group for j, c in enumerate(found.chosen) if j != i and c.curve == choice.curve}
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
        same = [k for k in near if overlap(own, scores.basis(k))[0] > ALIAS]
    return Standing(p, float(scores.delta_bic[g]), near, same, scores)
