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

"""Is a group of columns beyond noise that remembers? Likelihood ratio, its chance by simulation.

The test with the noise as it is estimated without the group (`select`) loses most of what such
noise can imitate: the estimate has swallowed it. Here the noise is fitted anew on either side:
2 ln of the ratio of the largest likelihoods with and without the group, each over a grid of
memories and sizes. Its chance is that of as large a ratio for any group that such noise is mistaken
for, in runs simulated with the noise that was estimated (parametric bootstrap).
"""

from functools import cached_property

import numpy as np

from .candidates import largest

#: a group whose score memory inflates by more (variance) is one that such noise can be mistaken
#: for; with up to a fifth more a p of 0.01 is one of 0.02
_INFLATED = 1.2
#: correlation of neighbours below which a group's score is inflated by less than `_INFLATED`: by
#: less than 1 + 2 _UNLIKE (1 + r + r^2 ...) of rows that share r = 0.6, and of longer memories
#: those that pass the test are tested again
_UNLIKE = 0.05
#: runs simulated: their tail, as `tail_share` has it, tells a limit as well as 300 counted ones
SIMULATIONS = 99
#: times that the chance of what is not scanned is larger than its tail says
_SAFE = 1.5
#: share of these that is taken as the tail
TAIL = 0.2
#: mean excess of that tail in an endless run of rows, and how many runs beyond its start that is
#: worth: of 2000 simulated runs each of 11 runs of four telescopes, with and without what was
#: found, it was 2.0 to 2.8, mean 2.31, scatter 0.18, what the columns take off the rows reckoned
#: with; once that scatter on the safe side
_EXCESS, _WORTH = 2.5, 100
#: 2 ln of a likelihood ratio below which no group is beyond the noise at a p of 0.01: what the
#: largest passes in 1 of 100 simulated runs was 12.2 to 23.9 (71 nights of 30 to 200 rows)
_LEAST_RATIO = 12.0
#: groups whose ratio is asked for: the one with the largest was among the first 20 of 50 to 400 by
#: its score with the noise that was estimated, in 160 of 160 steps of two telescopes; of 148 steps
#: with what is scanned besides, of five, in 143: the others' largest was no evidence, or the 25th
_LIKELY = 25


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
    beside : WeightedFit, optional
        Of all of `chosen`.
    """

    def __init__(self, problem, chosen, bank, plain, without=None, beside=None):
        self._sequence, self._bank, self._plain = problem.sequence, bank, plain
        chosen = tuple(chosen)  # it is fitted when asked, and a search goes on changing its list
        self._make = lambda: problem.with_memory(plain, chosen, without, beside=beside)
        self._asked, self._covered = np.zeros((2, len(bank)), bool)

    @classmethod
    def of(cls, problem, chosen, bank, plain, without=None, beside=None):
        """The mask, made once for each fit and bank."""
        key = cls, bank
        if key not in plain.known:
            plain.known[key] = cls(problem, chosen, bank, plain, without, beside)
        return plain.known[key]

    def covers(self, g):
        """Whether a group is one of them."""
        # whether it goes with the order of the rows at all is cheaper to ask
        columns = self._plain.basis.off(self._plain.noise.whiten(self._bank.of(g)))
        ordered = columns.reshape(-1, self._sequence.order.size)[:, self._sequence.order]
        before = np.einsum('ij,ij->', ordered[:, 1:], ordered[:, :-1])
        return bool(before > _UNLIKE * np.einsum('ij,ij->', ordered, ordered)
                    and self._inflates(columns, [0])[0])

    @property
    def excess(self):
        """Mean excess of the tail of largest ratios beside the choice, see `tail_share`."""
        n = self._plain.n  # rows of an axis, which half of the columns are fitted to
        return _EXCESS * n / max(n - 0.5 * len(self._plain.basis), 1.0)

    @cached_property
    def fit(self):
        """The choice fitted with memory."""
        return self._make()

    @cached_property
    def scores(self):
        """Of all groups, beside that fit."""
        return self._bank.score(self.fit)

    def covered(self, groups):
        """Which of some groups (ascending) are of them, an ndarray.

        Memory, if it is not reckoned with, inflates the variance of their scores.
        """
        groups = np.asarray(groups, int)
        if not self.fit.memory or not len(groups):
            return groups[:0]
        new = groups[~self._asked[groups]]
        if len(new):
            sizes = np.diff(self._bank.starts, append=len(self._bank.columns))[new]
            starts = np.cumsum(sizes) - sizes
            columns = np.arange(sizes.sum()) + np.repeat(self._bank.starts[new] - starts, sizes)
            self._covered[new] = self._inflates(self._plain.basis.off(
                self._plain.noise.whiten(self._bank.columns[columns]), in_place=True), starts)
            self._asked[new] = True
        return groups[self._covered[groups]]

    def likely(self, groups, count):
        """Of some groups (ascending) that are of them the `count` with the largest gains beside the
        fit with memory, ascending.
        """
        order = groups[np.argsort(-self.scores.delta_bic[groups], kind='stable')]
        stop = count
        while True:  # few of them are asked
            stop *= 2
            covered = self.covered(np.sort(order[:stop]))
            if len(covered) >= count or stop >= len(order):
                return np.sort(order[np.isin(order, covered)][:count])

    def _inflates(self, columns, starts):
        """Of groups whose whitened columns, beyond the model, begin at `starts`."""
        if not self.fit.memory:
            return np.zeros(len(starts), bool)
        spread = self.fit.noise.spread(columns * self._plain.noise.root)
        both = [np.add.reduceat(np.square(c).sum(axis=1), starts) for c in (spread, columns)]
        return both[0] > _INFLATED * np.maximum(both[1], 1e-300)


class MemoryTest:
    """The test of the groups of the dictionary that have one share, beside one choice.

    Parameters
    ----------
    problem : SelectionProblem
    mask : MemoryMask
        Which of them such noise can be mistaken for.
    share : str
    normal : ndarray, shape (b, 2n) or (b,)
        Standard normal noise; or the largest ratios by chance, if they are known.
    likelihood : callable
        Gives the `ChoiceLikelihood`, which is too large to be kept of each choice.
    """

    def __init__(self, problem, mask, share, normal, likelihood):
        self._problem, self._mask, self._share = problem, mask, share
        self._normal, self._likelihood = normal, likelihood
        self._known = {}  # ratios of groups

    def p(self, g):
        """Chance that noise makes any of the groups look as `g` does."""
        scanned, ratio = self._problem.dictionary.effects[g].share == 'scans', self._known.get(g)
        if scanned or ratio is None:
            ratio = self._likelihood().ratios(self._problem.finer(g)).max()
            self._known[g] = ratio
        if ratio < _LEAST_RATIO:
            return 1.0
        share = tail_share(self.by_chance, ratio, self._mask.excess)
        if scanned:
            return share
        # what goes with the clock is what such noise looks like most: on the safe side
        return min(_SAFE * share, 1.0)

    def best(self, without=()):
        """Of the groups with the largest gains that with the largest ratio, and that; or None."""
        likely = self._mask.likely(
            np.setdiff1d(self._problem.dictionary.shares[self._share], without), _LIKELY)
        if not len(likely):
            return None, 0.0
        ratios = self._likelihood().ratios(self._problem.dictionary.only(likely))[0]
        self._known.update(zip(likely.tolist(), ratios))
        place = largest(ratios)
        return int(likely[place]), float(ratios[place])

    @property
    def has_simulated(self):
        """Whether `by_chance` is known."""
        return self._normal.ndim == 1 or 'by_chance' in self.__dict__

    @cached_property
    def by_chance(self):
        """Largest ratio of each simulated run, shape (b,)."""
        if self._normal.ndim == 1:
            return self._normal
        likelihood = self._likelihood()
        covered = self._mask.covered(self._problem.dictionary.shares[self._share])
        return likelihood.ratios(self._problem.dictionary.only(covered),
                                 likelihood.simulated(self._normal)).max(axis=1)


def tail_share(by_chance, ratio, typical):
    """Share of simulated runs whose ratio is as large, in their tail by its exponential.

    The largest of 99 alone would decide at a p of 0.01, and it hangs on the seed. The tail of a
    likelihood ratio is exponential, and nearly the same in every run of rows: that of the
    simulated runs is moderated toward it.

    Parameters
    ----------
    by_chance : ndarray, shape (b,)
        2 ln of the likelihood ratios.
    ratio : float
    typical : float
        Mean excess of the tail over its start, of runs like these.

    Returns
    -------
    float
    """
    start = np.quantile(by_chance, 1.0 - TAIL)
    if ratio <= start:
        return float(np.mean(by_chance >= ratio))
    beyond = by_chance[by_chance > start] - start
    excess = (beyond.sum() + _WORTH * typical) / (len(beyond) + _WORTH)
    return float(TAIL * np.exp(-(ratio - start) / excess))
