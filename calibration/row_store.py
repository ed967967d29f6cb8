"""The rows of a night as they come, in columns that grow."""

import numpy as np

from pointing_model.row_retention import first_of_last
from pointing_model.runs.run import REQUIRED, PointingRun

#: rows for which there is room at first, and by what share it grows
_FIRST, _MORE = 64, 0.25


class RowStore:
    """Rows of one run after the other; of their columns those that all of them have.

    A row needs as many bytes as its numbers, and a quarter more at most.

    Parameters
    ----------
    power_ons : int
        So many are kept, by the column ``run``; 0: all.

    Attributes
    ----------
    forgotten : int
        Rows of earlier power-ons, which are here no more.
    """

    def __init__(self, power_ons=0):
        self._power_ons = power_ons
        self._columns, self._meta, self._count, self.forgotten = {}, {}, 0, 0
        self._since = {}  # number of the first row from which on each has the column
        self._stamps = np.empty(_FIRST, np.int64)  # with which each row came

    def __len__(self):
        return self._count

    @property
    def mount(self):
        """Of the first rows; None before them."""
        return self._run(slice(0)).mount if self._count else None

    def add(self, run, stamp):
        """Take rows.

        Parameters
        ----------
        run : PointingRun
            Its graduations hold for as long as all runs have the same.
        stamp : int
            Of the newest of them, ns, later than of those before.
        """
        count = self._count + len(run)
        if not self._count:
            self._meta = dict(run.meta)
            self._columns = {name: np.empty(max(_FIRST, count), values.dtype)
                             for name, values in run.columns.items()}
            self._since = dict.fromkeys(self._columns, 0)
        for name in [name for name in self._meta if name.startswith('graduation')]:
            if run.meta.get(name) != self._meta[name]:
                del self._meta[name]
        # one that rows before have not may be of all that are kept, later
        new = [name for name in run.columns if name not in self._columns] if self._power_ons else ()
        self._columns |= {name: np.full(len(self._stamps), np.nan) for name in new}
        self._since |= dict.fromkeys(new, self._count)
        self._columns = {name: self._with_more(values, run[name])
                         for name, values in self._columns.items() if name in run}
        self._stamps = self._with_more(self._stamps, np.full(len(run), stamp, np.int64))
        before, self._count = self._count, count
        if self._power_ons and count:
            runs = self._columns['run'][:count]
            if np.ptp(runs[max(before - 1, 0):]):
                self._forget(first_of_last(runs, self._power_ons))

    def _forget(self, rows):
        """The first so many. Who holds a run has the arrays of before: it stays as it is."""
        if not rows:
            return
        self._stamps = self._stamps[rows:].copy()
        self._columns = {name: values[rows:].copy() for name, values in self._columns.items()}
        self._since = {name: max(0, first - rows) for name, first in self._since.items()}
        self._count, self.forgotten = self._count - rows, self.forgotten + rows

    def drop(self, runs):
        """Rows of some power-ons, which will come again."""
        kept = ~np.isin(self._columns['run'][:self._count], runs)
        self._stamps = self._stamps[:self._count][kept]
        self._columns = {name: values[:self._count][kept]
                         for name, values in self._columns.items()}
        self._since = {name: int(np.count_nonzero(kept[:first]))
                       for name, first in self._since.items()}
        self._count = len(self._stamps)

    def _with_more(self, values, more):
        """A column with more values, in its place or in a larger one."""
        count, dtype = self._count + len(more), np.result_type(values, more)
        if count > len(values) or dtype != values.dtype:
            room = len(values) if count <= len(values) else int(count * (1.0 + _MORE))
            values, before = np.empty(room, dtype), values
            values[:self._count] = before[:self._count]
        values[self._count:count] = more
        return values

    def lacks(self, table):
        """Rows of a table that are not here; see `missing`."""
        here = None
        if self._count:
            here = self._run(np.isin(self._columns['run'][:self._count], table['run']))
        return missing(table, here)

    def all(self, until=0):
        """Rows so far (with `until`, those that had come by that stamp, if any), a PointingRun."""
        count = np.searchsorted(self._stamps[:self._count], until, 'right') if until else 0
        return self._run(slice(int(count) or self._count))

    def _run(self, rows):
        return PointingRun({name: values[:self._count][rows] for name, values in
                            self._columns.items() if not self._since[name]}, dict(self._meta))


def missing(table, here):
    """Rows of a table that somebody lacks.

    Parameters
    ----------
    table : PointingRun
        All rows of some power-ons.
    here : PointingRun or None
        Those of these power-ons that somebody has.

    Returns
    -------
    count : int
        How many are missing; 0 or less: none.
    rows : PointingRun or None
        They, where they come after those that are there; None where some in between are missing.
    """
    known = 0 if here is None else len(here)
    count = len(table) - known
    if count <= 0 or any(not np.array_equal(here[name], table[name][:known])
                         for name in REQUIRED if known):
        return count, None
    return count, table.select(slice(known, None))
