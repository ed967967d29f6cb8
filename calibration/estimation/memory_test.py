"""Is a group of columns beyond noise that remembers? Likelihood ratio, its chance by simulation.

The test with the noise as it is estimated without the group (`select`) loses most of what such
noise can imitate: the estimate has swallowed it. Here the noise is fitted anew on either side:
2 ln of the ratio of the largest likelihoods with and without the group, each over a grid of
memories and sizes. Its chance is that of as large a ratio for any group that such noise is mistaken
for, in runs simulated with the noise that was estimated (parametric bootstrap).
"""

from functools import cached_property
from types import SimpleNamespace

import numpy as np

from .correlated_noise import AxisNoise, CorrelatedNoise

#: a group whose score memory inflates by more (variance) is one that such noise can be mistaken
#: for; with up to a fifth more a p of 0.01 is one of 0.02
_INFLATED = 1.2
#: correlation of neighbours below which a group's score is inflated by less than `_INFLATED`: by
#: less than 1 + 2 _UNLIKE (1 + r + r^2 ...) of rows that share r = 0.6, and of longer memories
#: those that pass the test are tested again
_UNLIKE = 0.05
#: runs simulated, of which 1 in 100 is as extreme as a p of 0.01
SIMULATIONS = 199
#: share of these that is taken as the tail
TAIL = 0.2
#: 2 ln of a likelihood ratio below which no group is beyond the noise at a p of 0.01: what the
#: largest passes in 1 of 100 simulated runs was 12.2 to 23.9 (71 nights of 30 to 200 rows)
_LEAST_RATIO = 12.0
_KEPT = 1000  # rows up to which the fits of all noises are kept: of more they take much memory
_SIZES = (0.1, 0.4, 1.6, 6.4, 25.0)


class MemoryMask:
    """Which groups of a bank noise with memory may be mistaken for, beside a choice.

    Parameters
    ----------
    problem : SelectionProblem
    chosen : list of CandidateGroup
    bank : CandidateBank
    plain : WeightedFit
        Of the choice, without memory.
    without : int, optional
        Of `chosen`, that is left out.
    """

    def __init__(self, problem, chosen, bank, plain, without=None):
        self._sequence, self._bank, self._plain = problem.sequence, bank, plain
        self._make = lambda: problem.with_memory(plain, chosen, without)

    def covers(self, g):
        """Whether a group is one of them."""
        # whether it goes with the order of the rows at all is cheaper to ask
        columns = self._plain.basis.off(self._plain.noise.whiten(self._bank.of(g)))
        columns = columns.reshape(-1, self._sequence.order.size)[:, self._sequence.order]
        before = np.einsum('ij,ij->', columns[:, 1:], columns[:, :-1])
        return before > _UNLIKE * np.einsum('ij,ij->', columns, columns) and self.groups[g]

    @cached_property
    def fit(self):
        """The choice fitted with memory."""
        return self._make()

    @cached_property
    def scores(self):
        """Of all groups, beside that fit."""
        return self._bank.score(self.fit)

    @cached_property
    def groups(self):
        """Whether memory, if it is not reckoned with, inflates the variance of each score, (G,)."""
        if not self.fit.memory:
            return np.zeros(len(self._bank), bool)
        plain = self._plain
        columns = plain.basis.off(plain.noise.whiten(self._bank.columns))
        spread = self.fit.noise.spread(columns * plain.noise.root)
        both = [np.add.reduceat(np.square(c).sum(axis=1), self._bank.starts)
                for c in (spread, columns)]
        return both[0] > _INFLATED * np.maximum(both[1], 1e-300)


class MemoryTest:
    """The test of the groups of a bank beside one choice.

    Parameters
    ----------
    problem : SelectionProblem
    chosen : list of CandidateGroup
        In the model anyway.
    bank : CandidateBank
        The dictionary.
    groups : ndarray of int
        That such noise can be mistaken for.
    normal : ndarray, shape (b, 2n) or (b,)
        Standard normal noise; or the largest ratios by chance, if they are known.
    """

    def __init__(self, problem, chosen, bank, groups, normal):
        self._problem, self._bank, self._groups, self._normal = problem, bank, groups, normal
        self._plain = problem.plain.fit(chosen)
        self._design = problem.design(chosen)
        self._known = None
        self._noises = _noises(problem.sequence, self._plain, problem.fit(chosen).memory)

    def p(self, g):
        """Chance that noise makes any of the groups look as `g` does."""
        ratio = _ratios(self._observed(), self._problem.finer(g)).max()
        if ratio < _LEAST_RATIO:
            return 1.0
        return (SIMULATIONS * tail_share(self.by_chance, ratio) + 1.0) / (SIMULATIONS + 1)

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
        """Largest ratio of each simulated run, shape (b,)."""
        if self._normal.ndim == 1:
            return self._normal
        runs = self._noises[0].coloured(self._normal * (self._plain.noise.root > 0.0))
        return _ratios(_beyond(self._noises, self._design, runs),
                       self._bank.only(self._groups)).max(axis=1)


def tail_share(by_chance, ratio):
    """Share of simulated runs whose ratio is as large, in their tail by its exponential.

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


def _noises(sequence, plain, memory):
    """Noises of a grid of one axis, the other as estimated; first the estimate."""
    typical = [float(np.median(1.0 / np.square(r[r > 0.0])))
               for r in plain.noise.root.reshape(2, plain.n)]
    white = [AxisNoise(scale=s) for s in plain.scale]
    sets = [tuple(memory), tuple(white)]
    for axis in (0, 1):
        tried = [white[axis], *(
            AxisNoise(size * typical[axis], tau, memory[axis].scaled, plain.scale[axis])
            for tau in sequence.memories()[1:] for size in _SIZES)]
        sets += [tuple(t if k == axis else memory[k] for k in (0, 1)) for t in tried]
    return [CorrelatedNoise.beside(plain.noise, plain.scale, sequence, both) for both in sets]


def _beyond(noises, design, values):
    """Of each noise in turn: the fit's basis, what is left of the values, its squares, -2 ln L
    without."""
    n = values.shape[1] // 2
    for noise in noises:
        basis = design.basis(noise)
        left = basis.off(noise.whiten(values))
        live = np.count_nonzero(noise.root[:n])
        squares = np.square(left).reshape(-1, 2, n).sum(axis=2)
        none = -live * np.log(np.maximum(squares, 1e-300)).sum(axis=1) - noise.log_det
        yield noise, basis, left, squares, live, none


def _ratios(beyond, bank):
    """2 ln of the likelihood ratio of each group, shape (rows of values, G)."""
    without, with_it = -np.inf, -np.inf
    for noise, basis, left, squares, live, none in beyond:
        out = np.empty((len(left), len(bank)))
        for groups, q, _ in bank.bases(SimpleNamespace(noise=noise, basis=basis)):
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
