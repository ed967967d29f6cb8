"""Is an effect beyond a zero that wanders? Likelihood ratio, with its chance by simulation.

The test with the wander as it is estimated without the effect (`search`) loses most of what a
wander can imitate: the estimate has swallowed it. Here the wander is fitted anew on either side:
2 ln of the ratio of the largest likelihoods with and without the effect, each over a grid of
wanders. Its chance is that of as large a ratio for any effect that a wander is mistaken for, in
nights simulated with the wander that was estimated (parametric bootstrap).
"""

from functools import cached_property
from types import SimpleNamespace

import numpy as np

from .constants import NIGHTS, RATIO_WORTH_IT, TAIL, UNLIKE
from .correlated_noise import AxisWander, Whitened
from .scores import Bank

_KEPT = 1000  # rows up to which the fits of all wanders are kept: of more they take much memory
_SIZES = (0.1, 0.4, 1.6, 6.4, 25.0)


def follows(sequence, bank, g, state):
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


class AgainstWander:
    """The test of the groups of a bank beside one choice.

    Parameters
    ----------
    problem : Problem
    chosen : list of Choice
        In the model anyway.
    bank : Bank
    groups : ndarray of int
        That a wander can be mistaken for.
    normal : ndarray, shape (b, 2n) or (b,)
        Standard normal noise; or the largest ratios by chance, if they are known.
    """

    def __init__(self, problem, chosen, bank, groups, normal):
        self._problem, self._bank = problem, bank
        self._groups, self._normal = groups, normal
        self._plain = problem.plain.state(chosen)
        self._design = problem.design(chosen)
        self._known = None
        self._noises = _noises(problem.sequence, self._plain, problem.state(chosen).wander)

    def p(self, g):
        """Chance that a wandering zero makes any of the groups look as `g` does."""
        ratio = _ratios(self._observed(), _finer(self._problem, self._bank, g)).max()
        if ratio < RATIO_WORTH_IT:
            return 1.0
        return (NIGHTS * share_beyond(self.by_chance, ratio) + 1.0) / (NIGHTS + 1)

    def _observed(self):
        made = _beyond(self._noises, self._design, self._problem.b[None])
        if self._problem.n > _KEPT:
            return made
        if self._known is None:
            self._known = list(made)
        return self._known

    @property
    def has_simulated(self):
        """Whether `by_chance` is known."""
        return 'by_chance' in self.__dict__

    @cached_property
    def by_chance(self):
        """Largest ratio of each simulated night, shape (b,)."""
        if self._normal.ndim == 1:
            return self._normal
        nights = self._noises[0].coloured(self._normal * (self._plain.white.root > 0.0))
        return _ratios(_beyond(self._noises, self._design, nights),
                       self._bank.only(self._groups)).max(axis=1)


def share_beyond(by_chance, ratio):
    """Share of simulated nights whose ratio is as large, in their tail by its exponential.

    The largest of 199 alone would decide at a p of 0.01, and it hangs on the seed: of one run it
    was 17 to 33. The tail of a likelihood ratio is exponential; fitted to the upper fifth its
    quantile of 0.005 is known twice as well as by counting.

    Parameters
    ----------
    by_chance : ndarray, shape (b,)
        2 ln of the likelihood ratios.
    ratio : float

    Returns
    -------
    float
    """
    start = np.quantile(by_chance, 1.0 - TAIL)
    if ratio <= start:
        return float(np.mean(by_chance >= ratio))
    beyond = by_chance[by_chance > start]
    excess = max(beyond.mean() - start, 1e-9) if len(beyond) else 1e-9
    return float(TAIL * np.exp(-(ratio - start) / excess))


def _finer(problem, bank, g):
    """The group; a step at all rows about the place where it was tried, of which there are few."""
    e = bank.effects[g]
    if e.form != 'step':
        return bank.only([g])
    n, axis = problem.n, e.parameters['axis']
    part = slice(0, n) if axis == 'az' else slice(n, 2 * n)
    scan = [k for k, other in enumerate(bank.effects) if other.line == e.line]
    places = sorted({np.count_nonzero(bank.of(k)[0, part] == 0.0) for k in scan})
    here = places.index(np.count_nonzero(bank.of(g)[0, part] == 0.0))
    first, last = places[max(here - 1, 0)], places[min(here + 1, len(places) - 1)]
    order = np.argsort(problem.sequence.position, kind='stable')
    columns = np.zeros((last - first + 1, 2 * n))
    for row, place in zip(columns, range(first, last + 1)):
        row[part][order[place:]] = 1.0
    if axis == 'az':
        columns[:, part] *= problem.sequence.cos_el
    return Bank([e] * len(columns), None, columns)


def _noises(sequence, plain, wander):
    """Whitenings of a grid of wanders of one axis, the other as estimated; first the estimate."""
    n = plain.n
    typical = [float(np.median(1.0 / np.square(r[r > 0.0])))
               for r in plain.white.root.reshape(2, n)]
    still = [AxisWander(scale=s) for s in plain.scale]
    sets = [tuple(wander), tuple(still)]
    for axis in (0, 1):
        tried = [still[axis], *(
            AxisWander(size * typical[axis], memory, wander[axis].angle, plain.scale[axis])
            for memory in sequence.memories()[1:] for size in _SIZES)]
        sets += [tuple(t if k == axis else wander[k] for k in (0, 1)) for t in tried]
    out = []
    for both in sets:
        noise = [one.scale / s for one, s in zip(both, plain.scale)]
        out.append(Whitened(plain.white.root / np.repeat(noise, n), sequence, both))
    return out


def _beyond(noises, design, values):
    """Of each noise in turn: the fit's basis, what is left of the values, its squares, -2 ln L
    without."""
    n = values.shape[1] // 2
    for noise in noises:
        basis = design.basis(noise)
        left = basis.off(noise(values))
        live = np.count_nonzero(noise.root[:n])
        squares = np.square(left).reshape(-1, 2, n).sum(axis=2)
        none = -live * np.log(np.maximum(squares, 1e-300)).sum(axis=1) - noise.log_det
        yield noise, basis, left, squares, live, none


def _ratios(beyond, bank):
    """2 ln of the likelihood ratio of each group, shape (rows of values, G)."""
    without, with_it = -np.inf, -np.inf
    for noise, basis, left, squares, live, none in beyond:
        out = np.empty((len(left), len(bank)))
        for groups, q, _ in bank.bases(SimpleNamespace(white=noise, basis=basis)):
            reduced = _reduced(q, left, squares)
            out[:, groups] = -live * np.log(np.maximum(reduced, 1e-300)).sum(axis=0)
        without = np.maximum(without, none)
        with_it = np.maximum(with_it, out - noise.log_det)
    return with_it - without[:, None]


def _reduced(q, left, squares):
    """Sums of squares of either axis with each group taken out, shape (2, rows, G)."""
    n = left.shape[1] // 2
    share = np.tensordot(q, left, (2, 1))
    out = np.empty((2, len(left), len(q)))
    for axis, part in enumerate((slice(0, n), slice(n, 2 * n))):
        gram = q[:, :, part] @ q[:, :, part].transpose(0, 2, 1)
        cross = np.tensordot(q[:, :, part], left[:, part], (2, 1))
        taken = (2.0 * share * cross - share * (gram @ share)).sum(axis=1)
        out[axis] = squares[:, axis, None] - taken.T
    return out
