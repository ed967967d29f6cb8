"""Designs in which each row has a column of its group: the zeros of many power-ons.

A column that is zero outside its group is fitted in closed form, whatever the weights: what the
group's column takes of a vector is one sum over the group (Frisch and Waugh 1933, Econometrica 1,
387). So a zero more costs a sum more, and not a column of the design.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class GroupColumns:
    """A design: the columns of `rest`, then of each group a column `own`, zero in other groups.

    To `least_squares` it is as an ndarray of shape (k + groups, n).

    Attributes
    ----------
    group : ndarray of int, shape (n,)
        0, 1, ...; none is empty.
    own : ndarray, shape (n,)
        Of a group in which it is zero there is no column.
    rest : ndarray, shape (n, k)
    """

    __array_ufunc__ = None  # so that an ndarray leaves products to this

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

    @classmethod
    def of_runs(cls, terms, run, cos_el):
        """Of two axes: columns of terms, then how far the zeros of each run are from the first's.

        Parameters
        ----------
        terms : ndarray, shape (k, 2n)
            x of all rows, then y.
        run : ndarray, shape (n,)
            Numbers; at least two differ.
        cos_el : ndarray, shape (n,)
        """
        place = np.unique(run, return_inverse=True)[1].reshape(len(run))
        group = 2 * np.maximum(place - 1, 0)
        return cls(np.concatenate((group, group + 1)),
                   np.concatenate((cos_el, np.ones(len(run)))) * np.tile(place > 0, 2), terms.T)

    @cached_property
    def groups(self):
        """How many."""
        return int(self.group.max(initial=-1)) + 1

    @property
    def shape(self):
        """Of the ndarray in whose place it is."""
        return self.rest.shape[1] + self.groups, len(self.group)

    def __len__(self):
        return self.shape[0]

    def beside(self, *columns):
        """With further columns, shape (n,) or (n, j) each."""
        return self._with(rest=np.column_stack([self.rest, *columns]))

    def whitened(self, noise):
        """By a noise such as `CorrelatedNoise` in which no row resembles one of another group."""
        return self._with(own=noise.whiten(self.own), rest=noise.whiten(self.rest.T).T)

    def _with(self, **changed):
        out = replace(self, **changed)
        out.__dict__['groups'] = self.groups
        return out

    def squares(self, weights=None):
        """Square of the length of the group's columns, shape (groups,)."""
        own = np.square(self.own)
        return self._sums((own if weights is None else weights * own)[:, None])[:, 0]

    def share(self, values, weights=None):
        """Coefficients of the groups' columns alone, with those weights, shape (groups, k).

        Parameters
        ----------
        values : ndarray, shape (n, k)
        weights : ndarray, shape (n,), optional
        """
        own = self.own if weights is None else weights * self.own
        size = self.squares(weights)[:, None]
        return self._sums(own[:, None] * values) / np.where(size > 0.0, size, 1.0)

    def off(self, values, weights=None):
        """What the groups' columns leave of `values`, shape (n,) or (n, k)."""
        if values.ndim == 1:
            return self.off(values[:, None], weights)[:, 0]
        return values - self.own[:, None] * self.share(values, weights)[self.group]

    def _sums(self, values):
        """Sum over each group, shape (groups, k), of `values`, shape (n, k)."""
        k = values.shape[1]
        # a bin for each group and column: one pass, in the order of the rows
        place = self.group[:, None] * k + np.arange(k)
        return np.bincount(place.ravel(), values.ravel(), self.groups * k).reshape(
            self.groups, k)

    def normal(self, weights):
        """The normal matrix."""
        across = self._sums((weights * self.own)[:, None] * self.rest)
        return bordered((self.rest.T * weights) @ self.rest, across,
                        np.diag(self.squares(weights)))

    def __matmul__(self, values):
        """With values of the rows, shape (n,)."""
        sums = self._sums((self.own * values)[:, None])
        return np.concatenate((self.rest.T @ values, sums[:, 0]))

    def __rmatmul__(self, p):
        """Coefficients as values of the rows; of a matrix of them, dense."""
        if p.ndim > 1:
            return p @ np.asarray(self)
        k = self.rest.shape[1]
        return self.rest @ p[:k] + self.own * p[k:][self.group]

    def __array__(self, dtype=None, copy=None):
        members = (self.group == np.arange(self.groups)[:, None]) * self.own
        return np.concatenate((self.rest.T, members)).astype(dtype or float, copy=False)


def bordered(corner, across, own):
    """Symmetric, of the columns of `rest`, between these and those of the groups, of the latter."""
    return np.concatenate((np.concatenate((corner, across.T), axis=1),
                           np.concatenate((across, own), axis=1)))
