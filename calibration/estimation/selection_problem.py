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

"""Input of the model selection (rows, base columns, candidates) and its result."""

from collections import ChainMap
from dataclasses import dataclass, field, replace

import numpy as np

from .candidate_scores import CandidateBank, CandidateGroup
from .correlated_noise import AxisNoise, Sequence
from .group_columns import GroupColumns
from .linear_model import memory_of, weighted_fit, with_memory
from .memory_likelihood import MemorySearch, likely_memories
from .periodogram import PeriodBank

#: cache of fits, for searches return to earlier ones: fewest fits kept, residual values kept
_KEPT, _KEPT_NUMBERS = 64, 200_000


@dataclass
class SelectionProblem:
    """Offsets, the base columns that are always fitted, and the candidates.

    Attributes
    ----------
    base : GroupColumns
        Columns that are always fitted.
    b : ndarray, shape (2n,)
        Offsets, radians.
    inverse_sigma : ndarray, shape (2n,), or None
    dictionary, curves : CandidateBank
        Named effects; smooth curves of a driver, whose causes are unknown.
    sequence : Sequence, optional
        Order of the rows, for noise correlated along it; without it the noise is white.
    variants : object, optional
        Variants of the dictionary's effects: ``changes(effect)``, a CandidateBank offered once
        the effect is selected; ``finer(effect, scan, level)``, a CandidateBank of members of its
        scan on a finer grid, or None; ``columns(effect)`` of any other effect, (d, 2n);
        ``rows(rows)``, the same for some rows.
    trusted : ndarray of int, shape (n,), optional
        1: rows that keep full weight, however large their residual; -1: excluded rows.
    first : tuple of CandidateGroup
        Where a search starts: the groups that explain the trusted rows.
    periods : PeriodBank
        Waves of unknown period.
    by_rows : bool
        Whether folds hold rows of many runs; otherwise, with enough runs, whole runs.
    """

    base: GroupColumns
    b: np.ndarray
    inverse_sigma: np.ndarray | None
    dictionary: CandidateBank
    curves: CandidateBank
    sequence: Sequence | None = None
    variants: object = None
    trusted: np.ndarray | None = None
    first: tuple = ()
    periods: PeriodBank = field(default_factory=lambda: PeriodBank([]))
    by_rows: bool = False
    _memories: dict = field(default_factory=dict, repr=False)
    _fits: dict = field(default_factory=dict, repr=False)

    @property
    def scale_unit(self):
        """Unit of the noise scales, shape (2,): RMS of the given sigmas of x and y, or 1."""
        if self.inverse_sigma is None:
            return np.ones(2)
        return np.sqrt(np.mean(1.0 / np.square(self.inverse_sigma.reshape(2, -1)), axis=1))

    @property
    def plain(self):
        """The same problem with white noise."""
        return replace(self, sequence=None)

    @property
    def n(self):
        """Number of rows."""
        return len(self.b) // 2

    def rows(self, rows):
        """The problem of some rows (indices), with the noise memory estimated from all rows."""
        both = np.concatenate((rows, rows + self.n))
        return SelectionProblem(self.base.rows(both), self.b[both],
                                None if self.inverse_sigma is None else self.inverse_sigma[both],
                                self.dictionary.rows(rows), self.curves.rows(rows),
                                None if self.sequence is None else self.sequence.rows(rows),
                                None if self.variants is None else self.variants.rows(rows),
                                None if self.trusted is None else self.trusted[rows], self.first,
                                self.periods.rows(rows), self.by_rows, ChainMap({}, self._memories))

    def part(self, rows):
        """The problem of some rows for a new search: places and periods are not those of all rows.

        Curves are offered only if the search of all rows has found one.
        """
        curves = self.curves if self.curves.by_chance else CandidateBank.empty(self.n)
        out = replace(self, curves=curves).rows(rows)
        return replace(out, dictionary=out.dictionary.as_offered(),
                       periods=out.periods.as_offered())

    def other_rows(self, rows, part, chosen):
        """The base, and what was selected on a part of the rows, for some other rows.

        Parameters
        ----------
        rows : ndarray of int
        part : SelectionProblem
        chosen : list of CandidateGroup
            Selected on the part, at the places and periods found there.

        Returns
        -------
        SelectionProblem
            With all columns in the base and no candidates.
        """
        periods = self.periods.tuned_as(part.periods.rate) if len(self.periods) else self.periods
        return replace(self, periods=periods).only(
            chosen, [self._columns_as_in(part, c, periods) for c in chosen]).rows(rows)

    def _columns_as_in(self, part, one, periods):
        """Columns, for all rows, of a group selected on a part."""
        if one.period:
            return periods.of(one.group)
        effect, own = one.effect(part), one.bank(self)
        if one.group < len(own) and own.effects[one.group] is effect:
            return own.of(one.group)
        return self.variants.columns(effect)

    def trusting(self, trusted, first):
        """The same problem with other values of `trusted` and `first`."""
        return replace(self, trusted=trusted, first=tuple(first), _memories={}, _fits={})

    def replace(self, group, effect, columns):
        """Replace a group of the dictionary by another effect."""
        self.dictionary.replace(group, effect, columns)
        self._memories.clear()  # estimated with the old effect
        self._fits.clear()

    def tune(self, group, rate):
        """Set the rate of a wave of unknown period."""
        self.periods.tune(group, rate)
        self._memories.clear()
        self._fits.clear()

    def only(self, chosen, columns=None):
        """The same with the columns of the selected groups in the base, and no candidates.

        `columns` : of each group, shape (d, 2n), if not those of the banks.
        """
        known, none = self._memories.get(frozenset(chosen)), CandidateBank.empty(self.n)
        design = self.design(chosen) if columns is None else self.base.beside(*columns)
        return SelectionProblem(design, self.b, self.inverse_sigma, none, none,
                                self.sequence, None, self.trusted,
                                _memories={} if known is None else {frozenset(): known})

    def fit(self, chosen, weights=None, without=None, final=False, memory=None):
        """Fit of the base and the selected groups.

        Parameters
        ----------
        chosen : list of CandidateGroup
        weights : ndarray, shape (n,), optional
            Starting weights, from a similar fit.
        without : int, optional
            Index in `chosen` of a group to omit.
        final : bool
            See `linear_model.weighted_fit`.
        memory : tuple of AxisNoise, optional
            Noise of x and y; by default it is estimated from the residuals of this fit.

        Returns
        -------
        WeightedFit
        """
        key = (frozenset(c for i, c in enumerate(chosen) if i != without),
               None if weights is None else weights.tobytes(), final)
        data = self.base, self.b, self.dictionary
        fit, of = self._fits.get(key, (None, data))
        if fit is None or any(a is not b for a, b in zip(of, data)):
            if len(self._fits) >= max(_KEPT, _KEPT_NUMBERS // len(self.b)):
                del self._fits[next(iter(self._fits))]
            fit = weighted_fit(self.design(chosen, without), self.b, self.inverse_sigma, weights,
                               final, None if final else self.trusted)
            self._fits[key] = fit, data
        return self.with_memory(fit, chosen, without, memory)

    def with_memory(self, fit, chosen, without=None, memory=None, beside=None):
        """The white-noise `fit`, refitted with correlated noise; for the parameters see `fit`.

        `beside` : fit of all of `chosen`; with it the noise is estimated at the weights of that.
        """
        if self.sequence is None:
            return fit
        if memory is None:
            key = frozenset(c for i, c in enumerate(chosen) if i != without)
            if key not in self._memories:
                self._memories[key] = (
                    memory_of(fit, self.design(chosen, without), self.sequence)
                    if beside is None else self._memory_without(chosen, without, beside))
            memory = self._memories[key]
        if not any(one.variance > 0.0 for one in memory):
            return fit
        if memory not in fit.known:
            fit.known[memory] = with_memory(fit, self.design(chosen, without), self.b,
                                            self.sequence, memory)
        return fit.known[memory]

    def _memory_without(self, chosen, without, beside):
        """`noise_memory` without one selected group, given the fit `beside` with all of them."""
        if MemorySearch not in beside.known:
            beside.known[MemorySearch] = MemorySearch(
                self.sequence, beside.noise.root, beside.scale, self.design(chosen), self.b)
        sizes = [len(self.base.common), *(len(c.columns(self)) for c in chosen)]
        start = sum(sizes[:without + 1])
        return beside.known[MemorySearch].noise(np.arange(start, start + sizes[without + 1]))

    def likely_memories(self, chosen):
        """`memory_likelihood.likely_memories` with the selected groups in the model."""
        design, fit = self.design(chosen), self.plain.fit(chosen)
        return likely_memories(self.sequence, fit.noise.root,
                               self.fit(chosen).memory or (AxisNoise(), AxisNoise()), fit.scale,
                               design, self.b)

    def design(self, chosen, without=None):
        """Columns of the base and the selected groups, but for `chosen[without]`."""
        return self.base.beside(
            *(c.columns(self) for i, c in enumerate(chosen) if i != without))

    def changes(self, group):
        """`CandidateBank` of the changes (with time, say) of a group of the dictionary."""
        return self.variants.changes(self.dictionary.effects[group])

    def changes_of(self, chosen):
        """`CandidateBank` of the changes of all selected groups, and their `CandidateGroup`s."""
        banks = {c.group: self.changes(c.group) for c in chosen if c.plain}
        groups = [CandidateGroup(k, of=g) for g, bank in banks.items() for k in range(len(bank))]
        return CandidateBank.joined(banks.values()), groups

    def finer(self, group, level=0):
        """Bank of a group of the dictionary; for a member of a scan, of a finer grid about it.

        Each `level` makes the grid four times narrower.
        """
        bank = self.dictionary
        finer = None if self.variants is None else self.variants.finer(
            bank.effects[group],
            [bank.effects[g] for g in np.flatnonzero(bank.line == bank.line[group])], level)
        return bank.only([group]) if finer is None else finer


@dataclass
class ModelChoice:
    """The selected groups and their tests.

    Attributes
    ----------
    chosen : list of CandidateGroup
        The selected groups.
    fit : WeightedFit
        Fit of the base and the selected groups with white noise.
    dropped, dropped_by_cv, not_repeated : list of CandidateGroup
        Selected, then removed: no longer significant; no cross-validated improvement; or
        searches without some runs selected so differently that those runs were predicted worse.
    masked : list of CandidateGroup
        Significant against white noise, but not against correlated noise.
    held : frozenset of CandidateGroup
        Groups that a search may neither drop nor replace.
    against_memory : set of CandidateGroup
        Selected because they exceed correlated noise; against white noise others gain more.
    significances : list of Significance
        One for each selected group.
    gains : list of float
        Cross-validated improvement (RMS removed) by each, arcsec; the least of all partitions.
    replaced : tuple of CandidateGroup
        The effect first found and the alternative with the better model that replaced it.
    """

    chosen: list
    fit: object
    dropped: list = field(default_factory=list)
    dropped_by_cv: list = field(default_factory=list)
    not_repeated: list = field(default_factory=list)
    masked: list = field(default_factory=list)
    held: frozenset = frozenset()
    against_memory: set = field(default_factory=set)
    significances: list = field(default_factory=list)
    gains: list = field(default_factory=list)
    replaced: tuple = ()

    def without(self, i):
        """The selected groups but for the i-th and its changes."""
        one = self.chosen[i]
        return [c for c in self.chosen if c != one and not (one.plain and c.of == one.group)]
