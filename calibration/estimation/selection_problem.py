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

"""What a choice is made from, the rows and the candidates, and what it comes to."""

from collections import ChainMap
from dataclasses import dataclass, field, replace

import numpy as np

from .candidates import CandidateBank, CandidateGroup
from .correlated_noise import AxisNoise, Sequence
from .group_columns import GroupColumns
from .linear_model import memory_of, weighted_fit, with_memory
from .memory_likelihood import MemorySearch, likely_memories
from .periodogram import PeriodBank

#: fits that are kept, at least, and numbers in their residuals: searches come back to those before
_KEPT, _KEPT_NUMBERS = 64, 200_000


@dataclass
class SelectionProblem:
    """Offsets, the columns that are fitted to them anyway, and the candidates.

    Attributes
    ----------
    base : GroupColumns
        Of everything that is fitted anyway.
    b : ndarray, shape (2n,)
        Offsets, radians.
    inverse_sigma : ndarray, shape (2n,), or None
    dictionary, curves : CandidateBank
    sequence : Sequence, optional
        Rows may resemble their neighbours in it; without it their noise has no memory.
    variants : object, optional
        Of effects of the dictionary: ``changes(effect)``, offered once it is chosen, a
        CandidateBank; ``finer(effect, scan, level)``, members between those of its scan that are
        tried next to it, a CandidateBank or None; ``columns(effect)`` of any other, (d, 2n);
        ``rows(rows)``, the same of some rows.
    trusted : ndarray of int, shape (n,), optional
        1: rows that a search takes for no accidents, however far they are off; -1: that it leaves
        out.
    first : tuple of CandidateGroup
        That a search begins with: what these rows are trusted for.
    periods : PeriodBank
        Waves of unknown period.
    by_rows : bool
        Whether rows are left out of each of many runs, where otherwise whole runs are.
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
        """What scales of the noise are in, shape (2,): RMS of the given sigmas of x and y, or 1."""
        if self.inverse_sigma is None:
            return np.ones(2)
        return np.sqrt(np.mean(1.0 / np.square(self.inverse_sigma.reshape(2, -1)), axis=1))

    @property
    def plain(self):
        """The same, with noise that has no memory."""
        return replace(self, sequence=None)

    @property
    def n(self):
        """Rows."""
        return len(self.b) // 2

    def rows(self, rows):
        """The problem of some rows (indices); the memory of noise is known from all of them."""
        both = np.concatenate((rows, rows + self.n))
        return SelectionProblem(self.base.rows(both), self.b[both],
                                None if self.inverse_sigma is None else self.inverse_sigma[both],
                                self.dictionary.rows(rows), self.curves.rows(rows),
                                None if self.sequence is None else self.sequence.rows(rows),
                                None if self.variants is None else self.variants.rows(rows),
                                None if self.trusted is None else self.trusted[rows], self.first,
                                self.periods.rows(rows), self.by_rows, ChainMap({}, self._memories))

    def part(self, rows):
        """The problem of some rows, to be searched anew: no place is known from all of them.

        Curves are there if all rows have one.
        """
        curves = self.curves if self.curves.by_chance else CandidateBank.empty(self.n)
        out = replace(self, curves=curves).rows(rows)
        return replace(out, dictionary=out.dictionary.as_offered(),
                       periods=out.periods.as_offered())

    def other_rows(self, rows, part, chosen):
        """The base, and what a part of the rows has chosen, for some other rows.

        Parameters
        ----------
        rows : ndarray of int
        part : SelectionProblem
        chosen : list of CandidateGroup
            Of the part, at the places and periods that it has found.

        Returns
        -------
        SelectionProblem
            With all columns in the base, and nothing to choose from.
        """
        periods = self.periods.tuned_as(part.periods.rate) if len(self.periods) else self.periods
        return replace(self, periods=periods).only(
            chosen, [self._columns_as_in(part, c, periods) for c in chosen]).rows(rows)

    def _columns_as_in(self, part, one, periods):
        """Columns of one that a part has chosen, for all rows."""
        if one.period:
            return periods.of(one.group)
        effect, own = one.effect(part), one.bank(self)
        if one.group < len(own) and own.effects[one.group] is effect:
            return own.of(one.group)
        return self.variants.columns(effect)

    def trusting(self, trusted, first):
        """The same, trusting some rows (as `trusted`), with some `CandidateGroup` to begin with."""
        return replace(self, trusted=trusted, first=tuple(first), _memories={}, _fits={})

    def replace(self, group, effect, columns):
        """Put another effect in the place of a group of the dictionary."""
        self.dictionary.replace(group, effect, columns)
        self._memories.clear()  # they were estimated with the other one
        self._fits.clear()

    def tune(self, group, rate):
        """Let a wave of unknown period have another rate."""
        self.periods.tune(group, rate)
        self._memories.clear()
        self._fits.clear()

    def only(self, chosen, columns=None):
        """The same with the columns of a choice in the base, and nothing to choose from.

        `columns`: of each, shape (d, 2n), if they are not those of the banks.
        """
        known, none = self._memories.get(frozenset(chosen)), CandidateBank.empty(self.n)
        design = self.design(chosen) if columns is None else self.base.beside(*columns)
        return SelectionProblem(design, self.b, self.inverse_sigma, none, none,
                                self.sequence, None, self.trusted,
                                _memories={} if known is None else {frozenset(): known})

    def fit(self, chosen, weights=None, without=None, final=False, memory=None):
        """Fit of the base and the chosen groups.

        Parameters
        ----------
        chosen : list of CandidateGroup
        weights : ndarray, shape (n,), optional
            Of a fit of nearly the same.
        without : int, optional
            Of `chosen`, to be left out.
        final : bool
        memory : tuple of AxisNoise, optional
            Known; else it is estimated from what this fit leaves.

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
        """A fit without memory, with the memory that its noise has; parameters as of `fit`.

        `beside` is the fit of all of `chosen`, at whose weights that memory may be sought.
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
        """`noise_memory` without one of a choice, of which a fit with all is there."""
        if MemorySearch not in beside.known:
            beside.known[MemorySearch] = MemorySearch(
                self.sequence, beside.noise.root, beside.scale, self.design(chosen), self.b)
        sizes = [len(self.base.common), *(len(c.columns(self)) for c in chosen)]
        start = sum(sizes[:without + 1])
        return beside.known[MemorySearch].noise(np.arange(start, start + sizes[without + 1]))

    def likely_memories(self, chosen):
        """`memory_likelihood.likely_memories` with a choice in the model."""
        design, fit = self.design(chosen), self.plain.fit(chosen)
        return likely_memories(self.sequence, fit.noise.root,
                               self.fit(chosen).memory or (AxisNoise(), AxisNoise()), fit.scale,
                               design, self.b)

    def design(self, chosen, without=None):
        """Columns of the base and the chosen groups."""
        return self.base.beside(
            *(c.columns(self) for i, c in enumerate(chosen) if i != without))

    def changes(self, group):
        """`CandidateBank` of the changes of a group of the dictionary."""
        return self.variants.changes(self.dictionary.effects[group])

    def changes_of(self, chosen):
        """`CandidateBank` of the changes of all of a choice, the `CandidateGroup` that each is."""
        banks = {c.group: self.changes(c.group) for c in chosen if c.plain}
        groups = [CandidateGroup(k, of=g) for g, bank in banks.items() for k in range(len(bank))]
        return CandidateBank.joined(banks.values()), groups

    def finer(self, group, level=0):
        """A group of the dictionary; of a scan those about it, of which few are tried.

        At each `level` four times as near to it.
        """
        bank = self.dictionary
        finer = None if self.variants is None else self.variants.finer(
            bank.effects[group],
            [bank.effects[g] for g in np.flatnonzero(bank.line == bank.line[group])], level)
        return bank.only([group]) if finer is None else finer


@dataclass
class ModelChoice:
    """What was chosen, and how it stands.

    Attributes
    ----------
    chosen : list of CandidateGroup
    fit : WeightedFit
        Of the base and the choice, if rows have no memory.
    dropped, dropped_by_cv, not_repeated : list of CandidateGroup
        Chosen once, and given up: it did not pay any more, or not on rows left out, or the search
        without some runs chose so differently that those were predicted worse.
    masked : list of CandidateGroup
        Beyond chance if rows had no memory, but not beyond noise that has one.
    held : frozenset of CandidateGroup
        That a search may neither drop nor replace.
    against_memory : set of CandidateGroup
        Chosen because they stand out from noise with memory: without one others gain more.
    significances : list of Significance
        Of each that was chosen.
    gains : list of float
        What each takes off the RMS of rows left out, arcsec: the least of all partitions.
    replaced : tuple of CandidateGroup
        Of an alternative whose model was better: the effect that was found, and the alternative.
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
        """The choice but for one, and but for the changes of that one."""
        one = self.chosen[i]
        return [c for c in self.chosen if c != one and not (one.plain and c.of == one.group)]
