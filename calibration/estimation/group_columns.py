"""Designs in which each row has a column of its group: the zeros of many power-ons.

A column that is zero outside its group is fitted in closed form, whatever the weights: what the
group's column takes of a vector is one sum over the group (Frisch and Waugh 1933, Econometrica 1,
387). So a zero more costs a sum more, and not a column of the design.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class ByGroup:
    """A design: of each group a column `own`, zero in other groups, then the columns of `rest`.

    Attributes
    ----------
    group : ndarray of int, shape (n,)
        0, 1, ...; none is empty.
    own : ndarray, shape (..., n)
        Nonzero somewhere in each group. Leading dimensions: as many designs of the same groups.
    rest : ndarray, shape (..., n, k)
    """

    group: np.ndarray
    own: np.ndarray
    rest: np.ndarray

    @classmethod
    def of(cls, label, own=None, rest=None):
        """With the groups that share a value of `label`, shape (n,); `own` is 1 by default."""
        n = len(label)
        return cls(np.unique(label, return_inverse=True)[1].reshape(n),
                   np.ones(n) if own is None else own,
                   np.empty((n, 0)) if rest is None else rest)

    @cached_property
    def groups(self):
        """How many."""
        return int(self.group.max(initial=-1)) + 1

    @property
    def width(self):
        """Columns in all."""
        return self.groups + self.rest.shape[1]

    def beside(self, *columns):
        """With further columns, shape (n,) or (n, j) each."""
        return self._with(rest=np.column_stack([self.rest, *columns]))

    def white(self, colour):
        """Whitened rows, see `witness_noise.Colour`: no row resembles one of another group."""
        return self._with(own=colour.white(self.own), rest=colour.white(self.rest))

    def _with(self, **changed):
        out = replace(self, **changed)
        out.__dict__['groups'] = self.groups
        return out

    def squares(self, weights=None):
        """Square of the length of the group's columns, shape (..., groups)."""
        own = np.square(self.own)
        return self._sums((own if weights is None else weights * own)[..., None])[..., 0]

    def off(self, values, weights=None):
        """What the groups' columns leave of `values`, with those weights.

        Parameters
        ----------
        values : ndarray, shape (n,) or (..., n, k)
            With leading dimensions where `own` has them: as many designs of the same groups.
        weights : ndarray, shape (n,), optional
        """
        if values.ndim == 1:
            return self.off(values[:, None], weights)[:, 0]
        own = (self.own if weights is None else weights * self.own)[..., None]
        size = self.squares(weights)[..., None]
        share = self._sums(own * values) / size
        return values - self.own[..., None] * share[..., self.group, :]

    def _sums(self, values):
        """Sum over each group, shape (..., groups, k), of `values`, shape (..., n, k)."""
        *leading, n, k = values.shape
        if k == 1 and not leading:
            return np.bincount(self.group, values[:, 0])[:, None]
        designs = int(np.prod(leading))
        # a bin for each design, group and column: one pass, in the order of the rows
        first = np.arange(designs)[:, None] * self.groups + self.group
        place = first[..., None] * k + np.arange(k)
        return np.bincount(place.ravel(), values.ravel(), designs * self.groups * k).reshape(
            *leading, self.groups, k)

    def dense(self):
        """All columns, shape (n, width): those of the groups first."""
        members = (self.group[:, None] == np.arange(self.groups)) * self.own[:, None]
        return np.column_stack([members, self.rest])


class Moves:
    """Candidate columns that are zero outside a few rows each.

    Parameters
    ----------
    n : int
        Rows in all.
    blocks : list of (ndarray of int, ndarray)
        Rows (r,) that no other row of their group is missing from, and columns there (r, m).
    about : list
        What each column is, m of each block.
    """

    def __init__(self, n, blocks, about):
        self._n, self.blocks, self.about = n, blocks, about
        self._first = np.cumsum([0, *(columns.shape[1] for _, columns in blocks)])

    def __len__(self):
        return len(self.about)

    def column(self, place):
        """One of them, shape (n,)."""
        block = int(np.searchsorted(self._first, place, 'right')) - 1
        rows, columns = self.blocks[block]
        out = np.zeros(self._n)
        out[rows] = columns[:, place - self._first[block]]
        return out

    def only(self, wanted):
        """Those for which ``wanted(about)`` holds."""
        keep = np.array([wanted(one) for one in self.about], bool)
        blocks = [(rows, columns[:, keep[first:first + columns.shape[1]]])
                  for (rows, columns), first in zip(self.blocks, self._first)]
        return Moves(self._n, blocks, [one for one, kept in zip(self.about, keep) if kept])

    def on(self, axis, cos_el):
        """What columns of coordinate angles make on the sky: rows of x, then of y."""
        n = self._n
        blocks = [(rows, columns * cos_el[rows, None]) if axis == 0 else (rows + n, columns)
                  for rows, columns in self.blocks]
        return Moves(2 * n, blocks, self.about)

    def white(self, colour):
        """Whitened rows, see `witness_noise.Colour`."""
        return Moves(self._n, [(rows, colour.part(rows).white(columns))
                               for rows, columns in self.blocks], self.about)

    def dense(self):
        """All columns, shape (n, m)."""
        out = np.zeros((self._n, len(self)))
        for (rows, columns), first in zip(self.blocks, self._first):
            out[rows, first:first + columns.shape[1]] = columns
        return out
