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
from typing import NamedTuple

import numpy as np

from .candidates import largest
from .correlated_noise import AT_ONCE, AxisRows, CorrelatedNoise
from .group_columns import inverse_root
from .reduced_squares import reduced_squares, times_rows

#: a group whose score memory inflates by more (variance) is one that such noise can be mistaken
#: for; with up to a fifth more a p of 0.01 is one of 0.02
_INFLATED = 1.2
#: correlation of neighbours below which a group's score is inflated by less than `_INFLATED`: by
#: less than 1 + 2 _UNLIKE (1 + r + r^2 ...) of rows that share r = 0.6, and of longer memories
#: those that pass the test are tested again
_UNLIKE = 0.05
#: runs simulated, of which 1 in 100 is as extreme as a p of 0.01
SIMULATIONS = 199
#: times that the chance of what is not scanned is larger than its tail says
_SAFE = 1.5
#: share of these that is taken as the tail
TAIL = 0.2
#: 2 ln of a likelihood ratio below which no group is beyond the noise at a p of 0.01: what the
#: largest passes in 1 of 100 simulated runs was 12.2 to 23.9 (71 nights of 30 to 200 rows)
_LEAST_RATIO = 12.0
#: sizes that are tried (variance over that of the white noise); and no process
_SIZES, _WHITE = (0.1, 0.4, 1.6, 6.4, 25.0), (1.0, 0.0, 1.0)
#: groups whose ratio is asked for: the one with the largest was among the first 20 of 50 to 400 by
#: its score with the noise that was estimated, in 160 of 160 steps of two telescopes; of 148 steps
#: with what is scanned besides, of five, in 143: the others' largest was no evidence, or the 25th
_LIKELY = 40


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

    def _inflates(self, columns, starts):
        """Of groups whose whitened columns, beyond the model, begin at `starts`."""
        if not self.fit.memory:
            return np.zeros(len(starts), bool)
        spread = self.fit.noise.spread(columns * self._plain.noise.root)
        both = [np.add.reduceat(np.square(c).sum(axis=1), starts) for c in (spread, columns)]
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
        self._memory = problem.with_memory(self._plain, chosen).memory
        self._design = np.asarray(problem.design(chosen))
        self._noises, self._sets = _tried(problem.sequence, self._plain, self._memory)
        self._known = {}  # ratios of groups

    def p(self, g):
        """Chance that noise makes any of the groups look as `g` does."""
        scanned, ratio = self._bank.effects[g].share == 'scans', self._known.get(g)
        if scanned or ratio is None:
            ratio = self._ratios(self._problem.finer(g), self._problem.b[None]).max()
            self._known[g] = ratio
        if ratio < _LEAST_RATIO:
            return 1.0
        share = tail_share(self.by_chance, ratio)
        if scanned:
            return share
        # what goes with the clock is what such noise looks like most: on the safe side
        return min(_SAFE * share, 1.0)

    def best(self, gains, without=()):
        """Of the groups with the largest `gains` (G,) that with the largest ratio, and that."""
        some = np.setdiff1d(self._groups, without)
        likely = np.sort(some[np.argsort(-gains[some], kind='stable')[:_LIKELY]])
        ratios = self._ratios(self._bank.only(likely), self._problem.b[None])[0]
        self._known.update(zip(likely.tolist(), ratios))
        place = largest(ratios)
        return int(likely[place]), float(ratios[place])

    @property
    def has_simulated(self):
        """Whether `by_chance` is known."""
        return 'by_chance' in self.__dict__

    @cached_property
    def by_chance(self):
        """Largest ratio of each simulated run, shape (b,)."""
        if self._normal.ndim == 1:
            return self._normal
        plain = self._plain
        noise = CorrelatedNoise.beside(plain.noise, plain.scale, self._problem.sequence,
                                       self._memory)
        runs = noise.coloured(self._normal * (plain.noise.root > 0.0))
        return self._ratios(self._bank.only(self._groups), runs).max(axis=1)

    def _ratios(self, bank, values):
        """2 ln of the likelihood ratio of each group, shape (m, G), for values of shape (m, 2n).

        Either likelihood is the largest of all pairs of noises that are tried.
        """
        columns, n = np.vstack((self._design, bank.columns, values)), self._plain.n
        axes = []
        for axis, noises in enumerate(self._noises):
            part = slice(axis * n, (axis + 1) * n)
            rows = AxisRows(self._plain.noise.root[part], self._problem.sequence,
                            self._memory[axis].scaled)
            axes.append(_products(rows, rows.scaled(columns[:, part]), noises, bank, axis,
                                  len(self._design)))
        live = np.count_nonzero(self._plain.noise.root[:n])
        without, with_it = -np.inf, -np.inf
        step = max(1, AT_ONCE // max(len(bank.columns) * len(values), 1))
        for i in range(0, len(self._sets), step):
            pair = [of.of(self._sets[i:i + step, axis]) for axis, of in enumerate(axes)]
            plain, each = _likelihoods(pair, live)
            without, with_it = np.maximum(without, plain), np.maximum(with_it, each)
        return with_it - without[:, None]


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


def _tried(sequence, plain, memory):
    """Noises of each axis, and which are tried together.

    Returns
    -------
    noises : list of ndarray, shape (t, 3)
        Of x and y: memory, variance, and sigma of the white part in that of the plain fit; the
        first is the estimate, the second white.
    sets : ndarray of int, shape (s, 2)
        The estimate of both, white noise of both, each of x with the estimate of y, and so on.
    """
    root = plain.noise.root.reshape(2, plain.n)
    noises = []
    for axis, one in enumerate(memory):
        size = np.median(1.0 / np.square(root[axis][root[axis] > 0.0]))
        estimate = (one.memory, one.variance, one.scale / plain.scale[axis])
        noises.append(np.array([
            estimate if one.variance > 0.0 else _WHITE, _WHITE,
            *((tau, part * size, 1.0) for tau in sequence.memories[1:] for part in _SIZES)]))
    x, y = (np.arange(1, len(of)) for of in noises)
    return noises, np.concatenate(([(0, 0), (1, 1)], np.column_stack((x, 0 * x)),
                                   np.column_stack((0 * y, y))))


class _Products(NamedTuple):
    """Sums over the rows of an axis, whitened by each of t noises: design D, groups C, values V.

    Attributes
    ----------
    log_det : ndarray, shape (t,)
    design : ndarray, shape (t, k, k)
        D D.
    design_values, values : ndarray, shape (t, k, m), (t, m)
        D V, V V.
    groups : list of tuple
        Of each number of columns d: which groups, (G,), then for each noise C C (t, G, d, d),
        C D (t, G, d, k) and C V (t, G, d, m).
    """

    log_det: np.ndarray
    design: np.ndarray
    design_values: np.ndarray
    values: np.ndarray
    groups: list

    def of(self, noises):
        """Of some noises (indices)."""
        return _Products(*(of[noises] for of in self[:4]),
                         [(which, *(of[noises] for of in some)) for which, *some in self.groups])


def _products(rows, columns, noises, bank, axis, k):
    """`_Products` of columns (k + ... + m, n), scaled rows of an axis."""
    parts, count = [], len(bank.columns)
    some, here = bank.on_axis(axis), np.flatnonzero(columns[:k].any(axis=1))
    places = np.full(count, -1)
    places[some] = np.arange(len(some))
    columns = np.concatenate((columns[here], columns[k:k + count][some], columns[k + count:]))
    onto = np.append(here, np.arange(k, k + len(columns) - len(here) - len(some)))
    step = max(1, AT_ONCE // max(columns.size, 1))
    for i in range(0, len(noises), step):
        white, log_det = rows.whitened_by(columns, *noises[i:i + step].T)
        white = white.transpose(1, 0, 2)
        design, groups, values = np.split(white, [len(here), len(here) + len(some)], axis=1)
        both = np.concatenate((design, values), axis=1).transpose(0, 2, 1)
        across = np.zeros((len(white), count, k + values.shape[1]))
        across[:, some[:, None], onto] = groups @ both
        of_design = np.zeros((len(white), k, k + values.shape[1]))
        of_design[:, here[:, None], onto] = design @ both
        parts.append([log_det, of_design[..., :k], of_design[..., k:],
                      np.square(values).sum(axis=2)])
        for _, at in bank.by_size():
            own = np.zeros((len(white), *at.shape, at.shape[1]))
            there = np.flatnonzero(places[at[:, 0]] >= 0)
            of = groups[:, places[at[there]]]
            own[:, there] = of @ of.transpose(0, 1, 3, 2)
            parts[-1] += [own, across[:, at, :k], across[:, at, k:]]
    parts = [np.concatenate(part) for part in zip(*parts)]
    return _Products(*parts[:4], [(which, *parts[4 + 3 * j:7 + 3 * j])
                                  for j, (which, _) in enumerate(bank.by_size())])


def _likelihoods(pair, live):
    """Largest 2 ln L of sets of noises without, (m,), and with each group, (m, G).

    Parameters
    ----------
    pair : sequence of _Products, length 2
        Of x and y.
    live : int
        Rows with weight.
    """
    x, y = pair
    normal = x.design + y.design
    first = inverse_root(normal.mean(axis=0))  # beside it all are clear, and need no eigenvalues
    first = first[:, first.any(axis=0)]
    root = first @ inverse_root(first.T @ normal @ first)
    inverse = root @ root.transpose(0, 2, 1)
    p = inverse @ (x.design_values + y.design_values)
    left = [of.design_values - of.design @ p for of in pair]  # D r
    squares = [of.values - (p * (of.design_values + rest)).sum(axis=1)
               for of, rest in zip(pair, left)]
    # L = (x^2 y^2)^-live / det, so that the least of one product needs no logarithm of each
    log_det = x.log_det + y.log_det
    det = np.exp((log_det - log_det[0]) / live)[:, None]
    # of many values at a time six digits do
    kind = np.float32 if p.shape[2] > 1 else np.float64
    out = np.empty((p.shape[2], sum(len(which) for which, *_ in x.groups)))
    for (which, *gx), (_, *gy) in zip(x.groups, y.groups):
        sets, count, d, k = gx[1].shape
        onto = (gx[1] + gy[1]).reshape(sets, -1, k) @ inverse
        across = []  # of what the design leaves of each group: with itself, and with r
        for of, (own, design, values), rest in zip(pair, (gx, gy), left):
            design = design.reshape(onto.shape)
            half = (design - 0.5 * (onto @ of.design)).reshape(sets, count, d, k)
            shared = times_rows(half, onto.reshape(half.shape))
            across.append((own - shared - np.swapaxes(shared, -1, -2), (
                values - (design @ p + onto @ rest).reshape(values.shape)).astype(kind)))
        length = np.sqrt(np.diagonal(gx[0] + gy[0], axis1=2, axis2=3))
        (reduced, other), _ = reduced_squares(squares, across, length)
        out[:, which] = (reduced * (other * det[..., None].astype(kind))).min(axis=0).T
    plain = (squares[0] * squares[1] * det).min(axis=0)
    return (-live * np.log(np.maximum(of, 1e-300)) - log_det[0] for of in (plain, out))
