"""What a search has to do with: the rows, the candidates, what was chosen of them."""

from dataclasses import dataclass, field, replace

import numpy as np

from pointing_model.effects import changes

from .correlated_noise import AxisWander, Sequence
from .linear_model import Columns, fit_state, wandering, whitened
from .noise_memory import likely
from .scores import Bank


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
    changes : Changes, optional
        Of the effects of the dictionary, offered once these are chosen.
    sequence : Sequence, optional
        Rows may resemble their neighbours in it; without it their noise has no memory.
    """

    base: Columns
    b: np.ndarray
    inverse_sigma: np.ndarray | None
    dictionary: Bank
    curves: Bank
    sequence: Sequence | None = None
    changes: object = None
    _wanders: dict = field(default_factory=dict, repr=False)
    _part: bool = False
    _here: dict = field(default_factory=dict, repr=False)  # as `_wanders`, of a part
    _last: dict = field(default_factory=dict, repr=False)

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
                       None if self.changes is None else self.changes.rows(rows),
                       self._wanders, True)

    def replace(self, group, effect, columns):
        """Put another effect in the place of a group of the dictionary, see `Bank.replace`."""
        self.dictionary.replace(group, effect, columns)
        self._last.clear()
        self._wanders.clear()  # they were estimated with the other one

    def once(self, key, make):
        """What `make` gives, kept until it is asked for with another choice, bank or state."""
        choice, *same = key
        known = self._last.get('key')
        if known is None or known[0] != choice or any(
                a is not b for a, b in zip(known[1:], same)):
            self._last.update(key=(list(choice), *same), made=make())
        return self._last['made']

    def only(self, chosen):
        """The same with the columns of a choice in the base, and nothing to choose from."""
        none = Bank([], None, np.empty((0, 2 * self.n)))
        known = self._wanders.get(frozenset(chosen))
        return Problem(self.design(chosen), self.b, self.inverse_sigma, none, none, self.sequence,
                       None, {} if known is None else {frozenset(): known}, self._part)

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
            wander = self._wanders.get(key) or self._here.get(key)
            if wander is None:
                wander = wandering(state, design, self.b, self.sequence)
                (self._here if self._part else self._wanders)[key] = wander
        if not any(one.variance > 0.0 for one in wander):
            return state
        return whitened(state, design, self.b, self.sequence, wander)

    def likely(self, chosen):
        """`wander.likely` with a choice in the model."""
        design, state = self.design(chosen), self.plain.state(chosen)
        return likely(self.sequence, state.white.root,
                      self.state(chosen).wander or (AxisWander(), AxisWander()), state.scale,
                      design.common, self.b, design.own)

    def design(self, chosen, without=None):
        """Columns of the base and the chosen groups."""
        return self.base.added(
            [c.columns(self) for i, c in enumerate(chosen) if i != without])


@dataclass(frozen=True)
class Choice:
    """A group of the dictionary, of the curves, or of the changes of a group of the dictionary."""

    group: int
    curve: bool = False
    of: int | None = None

    @property
    def plain(self):
        """Whether it is of the dictionary."""
        return not self.curve and self.of is None

    def changes(self, chosen):
        """Whether a change of it is among a choice."""
        return self.plain and any(c.of == self.group for c in chosen)

    def bank(self, problem):
        """Where it comes from."""
        if self.of is not None:
            return problem.changes.of(self.of)
        return problem.curves if self.curve else problem.dictionary

    def family(self, problem, chosen):
        """All that it is chosen from beside `chosen`, and its place there: Bank, int."""
        if self.of is None:
            return self.bank(problem), self.group
        bank, all_ = problem.changes.of_all(chosen)
        return bank, all_.index(self)

    def columns(self, problem):
        """Shape (d, 2n)."""
        return self.bank(problem).of(self.group)

    def effect(self, problem):
        """The `Effect`."""
        return self.bank(problem).effects[self.group]


class Changes:
    """How the effects of a dictionary may change, evaluated when it is asked for.

    Parameters
    ----------
    dictionary : Bank
    context : Context
        Of all rows.
    """

    def __init__(self, dictionary, context):
        self._dictionary, self._context = dictionary, context
        self._banks = {}

    def of(self, group):
        """`Bank` of the changes of a group; it may be empty."""
        known = self._dictionary.effects[group]
        if group not in self._banks or self._banks[group][0] is not known:
            self._banks[group] = known, self._made(group)
        return self._banks[group][1]

    def _made(self, group):
        return Bank(changes(self._dictionary.effects[group], self._context), self._context)

    def of_all(self, chosen):
        """`Bank` of the changes of all effects of a choice, and the `Choice` that each is."""
        banks = {c.group: self.of(c.group) for c in chosen if c.plain}
        choices = [Choice(k, of=g) for g, bank in banks.items() for k in range(len(bank))]
        return Bank([e for bank in banks.values() for e in bank.effects], None, np.vstack(
            [bank.columns for bank in banks.values()])), choices

    def rows(self, rows):
        """Those of some rows."""
        return _Part(self, rows)


class _Part(Changes):
    def __init__(self, whole, rows):
        super().__init__(whole._dictionary, None)
        self._whole, self._rows = whole, rows

    def _made(self, group):
        return self._whole.of(group).rows(self._rows)


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
    held : frozenset of Choice
        That a search may neither drop nor replace.
    """

    chosen: list
    state: object
    dropped: list = field(default_factory=list)
    dropped_by_cv: list = field(default_factory=list)
    not_repeated: list = field(default_factory=list)
    wandering: list = field(default_factory=list)
    held: frozenset = frozenset()

    def without(self, i):
        """The choice but for one, and but for the changes of that one."""
        one = self.chosen[i]
        return [c for c in self.chosen if c != one and not (one.plain and c.of == one.group)]
