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

"""Is a group of columns significant against correlated noise? A likelihood-ratio test.

`select` tests with the noise estimated without the group. That has little power for effects
that correlated noise can imitate, for the estimate absorbs them. Here the noise is fitted with
and without the group: the statistic is 2 ln of the ratio of the maximum likelihoods, each over a
grid of correlation times and variances. Its p is the probability of so large a ratio for any
group that such noise can imitate, from runs simulated with the estimated noise (parametric
bootstrap).
"""

from functools import cached_property

import numpy as np

from .candidate_scores import largest

#: correlated noise can imitate a group if it inflates the variance of its score by more than this;
#: at a factor of 1.2 a p of 0.01 is really 0.02
_INFLATED = 1.2
#: `MemoryMask.covers` is False, without computing the inflation, if the lag-1 autocorrelation of a
#: group's columns is not above this. If it is no larger at longer lags, noise of correlation r^k at
#: lag k inflates the score by at most 1 + 2 _UNLIKE (r + r^2 ...): 1.15 at r = 0.6, and more than
#: `_INFLATED` only above r = 2/3. `MemoryMask.covered` always computes it
_UNLIKE = 0.05
#: simulated runs: with the tail of `tail_share` they set a limit as precisely as 300 counted ones
SIMULATIONS = 99
#: safety factor on the tail probability of groups that are not scanned
_SAFE = 1.5
#: fraction of the simulated runs that is taken as the tail
TAIL = 0.2
#: prior mean excess of that tail for infinitely many rows, and the weight of this prior in runs: in
#: 2000 simulations of each of 11 runs of four telescopes, with and without the found effects, it
#: was 2.0 to 2.8, mean 2.31, scatter 0.18, corrected for the degrees of freedom of the columns;
#: taken one scatter larger, on the safe side
_EXCESS, _WORTH = 2.5, 100
#: 2 ln of the likelihood ratio below which no group is significant at p = 0.01: the largest ratio
#: exceeded by 1 of 100 simulated runs was 12.2 to 23.9 (71 nights of 30 to 200 rows)
_LEAST_RATIO = 12.0
#: groups for which the ratio is computed, best scores (with the estimated noise) first: the group
#: with the largest ratio was among the first 20 of 50 to 400 in 160 of 160 steps of two telescopes;
#: with scans too, in 143 of 148 steps of five: otherwise it was no evidence, or the 25th
_LIKELY = 25


class MemoryMask:
    """Which groups of a bank correlated noise can imitate, with `chosen` in the model.

    Parameters
    ----------
    problem : SelectionProblem
    chosen : list of CandidateGroup
    bank : CandidateBank
    plain : WeightedFit
        Fit of `chosen` with white noise.
    without : int, optional
        Index in `chosen` of a group to omit.
    beside : WeightedFit, optional
        Fit of all of `chosen`.
    """

    def __init__(self, problem, chosen, bank, plain, without=None, beside=None):
        self._sequence, self._bank, self._plain = problem.sequence, bank, plain
        chosen = tuple(chosen)  # a copy: the fit comes later, when the search has changed its list
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
        """Whether correlated noise can imitate a group."""
        # first a cheaper test, see `_UNLIKE`: are its columns correlated from row to row?
        columns = self._plain.basis.off(self._plain.noise.whiten(self._bank.of(g)))
        ordered = columns.reshape(-1, self._sequence.order.size)[:, self._sequence.order]
        before = np.einsum('ij,ij->', ordered[:, 1:], ordered[:, :-1])
        return bool(before > _UNLIKE * np.einsum('ij,ij->', ordered, ordered)
                    and self._inflates(columns, [0])[0])

    @property
    def excess(self):
        """Typical mean excess of the tail of largest ratios, see `tail_share`."""
        n = self._plain.n  # rows of one axis, which fit half of the columns
        return _EXCESS * n / max(n - 0.5 * len(self._plain.basis), 1.0)

    @cached_property
    def fit(self):
        """Fit of `chosen` with correlated noise."""
        return self._make()

    @cached_property
    def scores(self):
        """Scores of all groups on that fit."""
        return self._bank.score(self.fit)

    def covered(self, groups):
        """Those of some groups (ascending) that correlated noise can imitate, an ndarray.

        Ignoring the correlation would inflate the variance of their scores.
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
        """The `count` covered groups of `groups` with the largest gains on `fit`, ascending."""
        order = groups[np.argsort(-self.scores.delta_bic[groups], kind='stable')]
        stop = count
        while True:  # so that few groups are tested
            stop *= 2
            covered = self.covered(np.sort(order[:stop]))
            if len(covered) >= count or stop >= len(order):
                return np.sort(order[np.isin(order, covered)][:count])

    def _inflates(self, columns, starts):
        """Whether the correlation inflates the score of each group.

        `columns` : whitened columns, orthogonal to the model; each group begins at a `starts`.
        """
        if not self.fit.memory:
            return np.zeros(len(starts), bool)
        spread = self.fit.noise.spread(columns * self._plain.noise.root)
        both = [np.add.reduceat(np.square(c).sum(axis=1), starts) for c in (spread, columns)]
        return both[0] > _INFLATED * np.maximum(both[1], 1e-300)


class MemoryTest:
    """Likelihood-ratio test of the dictionary groups of one share, with given groups in the model.

    Parameters
    ----------
    problem : SelectionProblem
    mask : MemoryMask
        Groups that correlated noise can imitate.
    share : str
        Share of the family-wise error.
    normal : ndarray, shape (b, 2n) or (b,)
        Standard normal deviates; or the simulated largest ratios, if known.
    likelihood : callable
        Returns the `ChoiceLikelihood`, which is too large to keep for each selection.
    """

    def __init__(self, problem, mask, share, normal, likelihood):
        self._problem, self._mask, self._share = problem, mask, share
        self._normal, self._likelihood = normal, likelihood
        self._known = {}  # ratios of groups

    def p(self, g):
        """Family-wise p of group `g`: probability that noise gives any group so large a ratio."""
        scanned, ratio = self._problem.dictionary.effects[g].share == 'scans', self._known.get(g)
        if scanned or ratio is None:
            ratio = self._likelihood().ratios(self._problem.finer(g)).max()
            self._known[g] = ratio
        if ratio < _LEAST_RATIO:
            return 1.0
        share = tail_share(self.by_chance, ratio, self._mask.excess)
        if scanned:
            return share
        # such noise resembles effects that depend on time most: a safety factor
        return min(_SAFE * share, 1.0)

    def best(self, without=()):
        """Group with the largest ratio of those with the largest gains, or None; and its ratio."""
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
        """Null distribution: the largest ratio of each simulated run, shape (b,)."""
        if self._normal.ndim == 1:
            return self._normal
        likelihood = self._likelihood()
        covered = self._mask.covered(self._problem.dictionary.shares[self._share])
        return likelihood.ratios(self._problem.dictionary.only(covered),
                                 likelihood.simulated(self._normal)).max(axis=1)


def tail_share(by_chance, ratio, typical):
    """Fraction of simulated runs with so large a ratio; in the tail from a fitted exponential.

    At p = 0.01 the largest of 99 runs alone would decide, and it depends on the seed. The tail of
    a likelihood ratio is exponential with nearly the same mean excess in every run: that of the
    simulated runs is shrunk toward this typical value.

    Parameters
    ----------
    by_chance : ndarray, shape (b,)
        Simulated 2 ln of the likelihood ratios.
    ratio : float
    typical : float
        Typical mean excess of the tail over its start.

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
