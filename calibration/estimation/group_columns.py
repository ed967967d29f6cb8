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

"""Designs with group columns, zero outside one group: zeros of a power-on, terms of a night.

Group columns are fitted in closed form, whatever the weights: projecting them out of a vector takes
a few sums over the group (Frisch and Waugh 1933, Econometrica 1, 387). A further group costs a few
more sums, and no column of the normal matrix.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .correlated_noise import EIGEN, CorrelatedNoise, WhiteNoise
from .lapack import lapack

#: part of a unit row that the rows before it do not span: if larger for each, they are independent
_SURE = 1e-3
#: ... if larger than this for each, the normal matrix is precise enough
_APART = 0.1
#: ... if smaller than this it is rounding: the row depends on those before
_NOTHING = 1e-8
#: part of a common column that must remain beyond the group columns: less may be rounding
_LEAST = 1e-5
#: least eigenvalue of a normal matrix of unit columns for which Cholesky is precise enough
_CLEAR = 1e-8
#: up to this number of group columns, dense common columns with their zeros are faster
_FEW = 48


def orthonormal(rows):
    """Orthonormal basis of the span of `rows` (numerically dependent ones dropped).

    Parameters
    ----------
    rows : ndarray, shape (k, m)

    Returns
    -------
    ndarray, shape (rank, m)
    """
    for _ in range(2):  # twice is enough for orthogonality to rounding
        if not len(rows):
            break
        length = np.sqrt(np.einsum('ij,ij->i', rows, rows))
        rows = rows[length > 0.0] / length[length > 0.0, None]
        if 0 < len(rows) <= rows.shape[1]:
            # these take a twentieth and a tenth of the time of the eigenvalues
            basis = _orthonormal_by_cholesky(rows)
            basis = _orthonormal_by_qr(rows) if basis is None else basis
            if basis is not None:
                return basis
        values, vectors = np.linalg.eigh(rows @ rows.T)
        keep = values > EIGEN * values[-1:]
        rows = (vectors[:, keep] / np.sqrt(values[keep])).T @ rows
    return rows


def _orthonormal_by_cholesky(rows):
    """`orthonormal` of unit rows; None where rounding errors would matter."""
    factor, bad = lapack().dpotrf((rows @ rows.T).T)
    if bad or factor.diagonal().min() < _APART:
        return None
    inverse = triangular_inverse(factor)
    # as in `inverse_root`: this trace is never below 1 / the least eigenvalue
    return inverse.T @ rows if np.vdot(inverse, inverse) < 1.0 / _APART**2 else None


def triangular_inverse(factor):
    """Inverse of an upper triangular matrix, a fourth of the time of `numpy.linalg.inv`."""
    return lapack().dtrtri(factor)[0]


def _orthonormal_by_qr(rows):
    """`orthonormal` of unit rows; None where it is not clear which rows are dependent."""
    for _ in range(2):
        turned, tau, _, _ = lapack().dgeqrf(rows.T)
        beyond = np.abs(turned.diagonal())
        if beyond.min() > _SURE:
            return lapack().dorgqr(turned, tau, overwrite_a=1)[0].T
        if beyond.min() > _NOTHING:  # as in `inverse_root`
            inverse = triangular_inverse(np.triu(turned[:len(rows)]))
            clear = len(rows) * np.vdot(inverse, inverse) < 1.0 / EIGEN
            return lapack().dorgqr(turned, tau, overwrite_a=1)[0].T if clear else None
        rows = rows[beyond > _NOTHING]
    return None


def inverse_root(normal, least=EIGEN):
    """H with H H^T = N^-1, shape (..., j, j), and zero in directions that N does not determine.

    These have an eigenvalue, for unit columns, of less than `least` times the largest.
    """
    length = np.sqrt(np.diagonal(normal, axis1=-2, axis2=-1))
    length = np.where(length > 0.0, length, 1.0)
    unit = normal / (length[..., None] * length[..., None, :])
    try:
        lower = np.linalg.cholesky(unit)
        root = np.array([triangular_inverse(one.T) for one in lower.reshape(
            -1, *lower.shape[-2:])]).reshape(lower.shape)
        # trace of the inverse >= 1 / the least eigenvalue; the largest eigenvalue is at most k
        trace = np.square(root).sum(axis=(-2, -1)).max(initial=0.0)
        if unit.shape[-1] * trace < 1.0 / max(least, _CLEAR):
            return root / length[..., None]
    except np.linalg.LinAlgError:
        pass
    values, vectors = np.linalg.eigh(unit)
    keep = values > least * np.maximum(values[..., -1:], 1e-300)
    return vectors * np.where(keep, 1.0 / np.sqrt(np.where(keep, values, 1.0)), 0.0)[
        ..., None, :] / length[..., None]


@dataclass(frozen=True, eq=False)
class GroupColumns:
    """A design: common columns, then for each group the columns `own`, zero in other groups.

    For `least_squares` it behaves like an ndarray of shape (k + groups * j, n).

    Attributes
    ----------
    group : ndarray of int, shape (n,)
        Group of each row: 0, 1, ...
    own : ndarray, shape (j, n)
        Values of the group columns; a group where they are all zero has none.
    common : ndarray, shape (k, n)
        Columns over all rows.
    zeros : sequence of int
        Indices of the common columns that are the zeros of the axes.
    """

    __array_ufunc__ = None  # so that `ndarray @ this` calls `__rmatmul__`

    group: np.ndarray
    own: np.ndarray
    common: np.ndarray
    zeros: tuple = ()

    @classmethod
    def of(cls, label, own=None, common=None, zeros=()):
        """Design with a group for each value of `label`, shape (n,); `own` is 1 by default."""
        n = len(label)
        return cls(np.unique(label, return_inverse=True)[1].reshape(n),
                   np.ones((1, n)) if own is None else own,
                   np.empty((0, n)) if common is None else common, zeros)

    @classmethod
    def alone(cls, common, zeros=()):
        """Design without groups."""
        n = common.shape[1]
        return cls(np.zeros(n, int), np.empty((0, n)), common, zeros)

    @classmethod
    def of_runs(cls, terms, run, cos_el):
        """Design for two axes: columns of terms, then zero offsets of each run from the first run.

        Parameters
        ----------
        terms : ndarray, shape (k, 2n)
            x of all rows, then y.
        run : ndarray, shape (n,)
            Run numbers, at least two different ones.
        cos_el : ndarray, shape (n,)
        """
        place = np.unique(run, return_inverse=True)[1].reshape(len(run))
        group = 2 * np.maximum(place - 1, 0)
        own = np.concatenate((cos_el, np.ones(len(run)))) * np.tile(place > 0, 2)
        return cls(np.concatenate((group, group + 1)), own[None], terms)

    @cached_property
    def groups(self):
        """Number of groups."""
        return int(self.group.max(initial=-1)) + 1 if len(self.own) else 0

    @cached_property
    def _members(self):
        ends = np.cumsum(np.bincount(self.group, minlength=self.groups))[:-1]
        return np.split(np.argsort(self.group, kind='stable'), ends)

    @property
    def shape(self):
        """Shape of the equivalent ndarray."""
        return len(self.common) + self.groups * len(self.own), self.common.shape[1]

    def __len__(self):
        return self.shape[0]

    def beside(self, *columns):
        """The design with further common columns, shape (n,) or (j, n) each."""
        return self._with(common=np.vstack([self.common, *columns]))

    def rows(self, rows):
        """The design of some rows (indices of n); the groups keep their numbers."""
        return self._with(group=self.group[rows], own=self.own[:, rows],
                          common=self.common[:, rows])

    def without_common(self):
        """The groups' columns alone."""
        return self._with(common=self.common[:0], zeros=())

    def quickest(self):
        """A design of the same span: few group columns are turned into common ones."""
        if self.groups and self.groups * len(self.own) <= _FEW:
            return GroupColumns.alone(np.asarray(self))
        return self

    def whitened(self, noise):
        """The whitened design; the noise must not correlate rows of different groups."""
        own = noise.whiten(self.own) if self.groups else self.own
        return self._with(own=own, common=noise.whiten(self.common))

    def _with(self, **changed):
        out = replace(self, **changed)
        out.__dict__['groups'] = self.groups
        if 'group' not in changed and '_members' in self.__dict__:
            out.__dict__['_members'] = self._members
        return out

    def sums(self, values):
        """Products of the group columns with `values`, (m, n): shape (groups, j, m)."""
        if len(self.own) == 1:  # one pass, whatever the number of groups
            place = np.arange(len(values))[:, None] * self.groups + self.group
            return np.bincount(place.ravel(), (self.own * values).ravel(),
                               self.groups * len(values)).reshape(-1, 1, self.groups).T
        return np.array([self.own[:, at] @ values[:, at].T for at in self._members]).reshape(
            self.groups, len(self.own), len(values))

    def spread(self, coefficients):
        """Values, shape (m, n), from coefficients of the group columns, (groups, j, m)."""
        if len(self.own) == 1:
            return self.own * coefficients[self.group, 0].T
        out = np.zeros((coefficients.shape[2], self.shape[1]))
        for at, p in zip(self._members if self.groups else (), coefficients):
            out[:, at] = p.T @ self.own[:, at]
        return out

    def own_normal(self, weights=None):
        """Normal matrices of the group columns, shape (groups, j, j)."""
        return self.sums(self.own if weights is None else weights * self.own)

    def share(self, values, weights=None, root=None):
        """Weighted fit of the group columns alone: coefficients, shape (groups, j, m).

        Parameters
        ----------
        values : ndarray, shape (m, n)
        weights : ndarray, shape (n,), optional
        root : ndarray, shape (groups, j, j), optional
            `inverse_root` of `own_normal`, if known.
        """
        root = inverse_root(self.own_normal(weights)) if root is None else root
        sums = self.sums(values if weights is None else weights * values)
        return root @ (root.transpose(0, 2, 1) @ sums)

    def normal(self, weights):
        """The normal matrix."""
        k, j = len(self.common), len(self.own)
        across = self.sums(weights * self.common).reshape(-1, k)
        own = np.zeros((self.groups, j, self.groups, j))
        each = np.arange(self.groups)
        own[each, :, each] = self.own_normal(weights)
        return bordered((self.common * weights) @ self.common.T, across,
                        own.reshape(len(across), -1))

    def basis(self, noise=None):
        """`Basis` of the columns, optionally whitened (see `whitened`)."""
        white = self if noise is None else self.whitened(noise)
        if not self.groups:
            return Basis(orthonormal(white.common), white)
        groups = white.orthonormal_groups()
        left = groups.off(groups.off(white.common))
        length, after = (np.sqrt(np.square(of).sum(axis=1)) for of in (white.common, left))
        return Basis(orthonormal(left[after > _LEAST * length]), groups.groups)

    def orthonormal_groups(self):
        """`Basis` of the group columns alone."""
        out = self.without_common()
        for _ in range(2 if self.groups else 0):  # twice is enough for orthogonality to rounding
            out = out._with(own=out.spread(inverse_root(out.own_normal())))
        return Basis(out.common, out)

    def solver(self, noise, least=_LEAST):
        """`ColumnSolver` of these columns."""
        return ColumnSolver(self, noise, least)

    def left_of(self, b, noise):
        """Residuals of a least-squares fit, shape (n,), also of rows without weight.

        Parameters
        ----------
        b : ndarray, shape (n,)
        noise : WhiteNoise or CorrelatedNoise
        """
        return b - np.concatenate([of.ravel() for of in self.solver(noise)(b)]) @ self

    def __matmul__(self, values):
        """Product of the columns with values of the rows, shape (n,)."""
        return np.concatenate((self.common @ values, self.sums(values[None]).ravel()))

    def __rmatmul__(self, p):
        """Values of the rows from coefficients (of a matrix of these, by a dense copy)."""
        if p.ndim > 1:
            return p @ np.asarray(self)
        k = len(self.common)
        return p[:k] @ self.common + self.spread(
            p[k:].reshape(self.groups, len(self.own), 1))[0]

    def __array__(self, dtype=None, copy=None):
        members = self.group == np.arange(self.groups)[:, None, None]
        return np.concatenate((self.common, (members * self.own).reshape(
            -1, self.shape[1]))).astype(dtype or float, copy=False)


def bordered(corner, across, own):
    """Symmetric block matrix: common columns, common with group columns, group columns."""
    return np.concatenate((np.concatenate((corner, across.T), axis=1),
                           np.concatenate((across, own), axis=1)))


class Basis:
    """Orthonormal basis rows, those of groups stored without their zeros.

    With 119 runs of six terms each, 714 dense rows of 2n values would be nearly all zeros, and
    projecting them out of hundreds of candidates would take a hundred times as long.

    Parameters
    ----------
    common : ndarray, shape (k, n)
        Orthonormal, and orthogonal to the group columns.
    groups : GroupColumns
        Its own columns are orthonormal, or zero; by default no groups.
    """

    def __init__(self, common, groups=None):
        self.common = common
        self.groups = GroupColumns.alone(common[:0]) if groups is None else groups

    def __len__(self):
        return len(self.common) + round(np.square(self.groups.own).sum())

    def off(self, rows, in_place=False):
        """Rows, shape (..., n), with the basis projected out."""
        out = self.off_groups(rows if in_place else np.array(rows, dtype=float))
        out -= (out @ self.common.T) @ self.common
        return out

    def off_groups(self, rows):
        """Rows, shape (..., n), with the group columns projected out; changes `rows` in place."""
        if self.groups.groups:
            flat = rows.reshape(-1, rows.shape[-1])
            flat -= self.groups.spread(self.groups.sums(flat))
        return rows

    def blocks_of_rows(self, beside=None):
        """The 2 x 2 block of the projector for each row of two axes: xx, yy and xy, each (n,).

        Both values of a row must be of one group. `beside` : further orthonormal rows, (j, n).
        """
        return self._blocks if beside is None else self._blocks + _blocks(beside)

    @cached_property
    def _blocks(self):
        return _blocks(self.common) + _blocks(self.groups.own)


def _blocks(rows):
    x, y = np.split(rows, 2, axis=1)
    return np.array([np.einsum('ij,ij->j', a, b) for a, b in ((x, x), (y, y), (x, y))])


class ColumnSolver:
    """Least squares with `GroupColumns`, group by group.

    Parameters
    ----------
    columns : GroupColumns
    noise : WhiteNoise or CorrelatedNoise
    least : float
        Part of a common column that must remain beyond the group columns; with less its
        coefficient is zero.

    Attributes
    ----------
    inverse : ndarray, shape (k, k)
        Covariance of the coefficients of the common columns, marginal over those of the groups.
    """

    def __init__(self, columns, noise, least):
        self._columns, self._noise = columns, noise
        white = columns.whitened(noise)
        self._groups, beyond = white.orthonormal_groups(), white.common
        if columns.groups:
            length = np.sqrt(np.square(beyond).sum(axis=1))
            beyond = self._groups.off(beyond)
            beyond[np.sqrt(np.square(beyond).sum(axis=1)) <= least * length] = 0.0
        root = inverse_root(beyond @ beyond.T)
        self._beyond, self.inverse = beyond, root @ root.T

    def inverse_under(self, noise):
        """Covariance of the same estimator under another `CorrelatedNoise`."""
        factor = noise.spread((self.inverse @ self._beyond) * self._noise.root)
        return factor @ factor.T

    def __call__(self, b):
        """Coefficients of the common columns, (k,), and of each group's own, (groups, j).

        Zeros of the axes are weighted means of the rows, not generalised least squares: if the
        correlation time is as long as the run, the latter hardly determines the mean and may put
        it far from all rows (by 60" in a run of 1.4 h with noise of 140").
        """
        columns, root = self._columns, self._noise.root
        p = self.inverse @ (self._beyond @ self._groups.off(self._noise.whiten(b)))
        if columns.groups:
            return p, columns.share((b - p @ columns.common)[None], np.square(root))[:, :, 0]
        if len(columns.zeros) and isinstance(self._noise, CorrelatedNoise):
            zeros = GroupColumns.alone(columns.common[list(columns.zeros)])
            p[list(columns.zeros)] += zeros.solver(WhiteNoise(root))(b - p @ columns.common)[0]
        return p, np.empty((0, 0))
