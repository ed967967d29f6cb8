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

"""Selection or shrinkage of hundreds of columns beside a fixed base, for all folds at once.

The rows of a held-out fold are subtracted from the normal matrix of all rows, so each fold costs no
more than its own rows. The base is projected out; the other columns are selected one by one, or
shrunk toward zero with prior variances estimated from the rows (generalised ridge: MacKay 1992,
Neural Computation 4, 415; Tipping 2001, J. Machine Learning Research 1, 211).
"""

from dataclasses import dataclass

import numpy as np

from .group_columns import inverse_root

#: squared part of a column that must remain beyond the base and selected columns: less is rounding
_DISTINCT = 1e-6
_MOST = 40  # most columns selected
#: least residual degrees of freedom: this number, and this part of all values
_FREE, _FREE_PART = 3, 0.25
#: least noise variance, over the mean square of the residuals of the base
_LEAST_NOISE = 1e-3
#: limits of the variance that a group adds to a value, over the residuals of the base
_BOUNDS = 1e-9, 1e7
#: least sum of squared residuals per row of unit noise: less is rounding
_ROUNDING = 1e-6


@dataclass
class Beyond:
    """Normal equations of columns with a base projected out, for F sets of rows.

    Attributes
    ----------
    normal : ndarray, shape (F, K, K)
    right : ndarray, shape (F, K)
        Right-hand sides.
    squares : ndarray, shape (F,)
        Sum of squared residuals of the base alone.
    base : ndarray, shape (F, p, K + 1)
        Coefficients of the base fitted to each column, and to the values.
    inverse : ndarray, shape (F, p, p)
        Inverse normal matrix of the base.
    own : ndarray, shape (F, K)
        Squared lengths of the columns before projection.
    rows : ndarray, shape (F,)
        Sum of the rows' robust weights.
    """

    normal: np.ndarray
    right: np.ndarray
    squares: np.ndarray
    base: np.ndarray
    inverse: np.ndarray
    own: np.ndarray
    rows: np.ndarray

    @classmethod
    def of(cls, columns, p, weights, rows, folds=()):
        """Normal equations of all rows, and without each of some folds.

        Parameters
        ----------
        columns : ndarray, shape (p + K + 1, 2n)
            The base, the other columns, the values.
        p : int
            Number of base columns.
        weights : ndarray, shape (2n,)
            Weights of the values.
        rows : ndarray, shape (n,)
            Robust weights of the rows, 0 for excluded ones.
        folds : sequence of ndarray of int

        Returns
        -------
        Beyond
        """
        n = columns.shape[1] // 2
        whole = (columns * weights) @ columns.T
        normal = np.repeat(whole[None], len(folds) + 1, axis=0)
        for one, fold in zip(normal[1:], folds):
            both = np.concatenate((fold, fold + n))
            some = columns[:, both]
            one -= (some * weights[both]) @ some.T
        known = normal[:, :p, :p]
        scale = np.sqrt(np.einsum('fii->fi', known))
        scale[scale <= 0.0] = 1.0
        scale = scale[:, :, None] * scale[:, None, :]
        inverse = np.linalg.pinv(known / scale, rcond=1e-9, hermitian=True) / scale
        base = inverse @ normal[:, :p, p:]
        left = normal[:, p:, p:] - np.swapaxes(normal[:, :p, p:], 1, 2) @ base
        count = rows.sum() - np.array([0.0, *(rows[fold].sum() for fold in folds)])
        least = _ROUNDING * np.maximum(count, 1.0)
        return cls(left[:, :-1, :-1], left[:, :-1, -1], np.maximum(left[:, -1, -1], least), base,
                   inverse, np.einsum('fii->fi', normal)[:, p:-1], count)

    def __len__(self):
        return len(self.squares)

    @property
    def free(self):
        """Residual degrees of freedom of the base, shape (F,)."""
        return np.maximum(2.0 * self.rows - self.base.shape[1], 1.0)

    def only(self, sets):
        """Some of the sets of rows (a slice)."""
        return Beyond(*(getattr(self, name)[sets] for name in self.__dataclass_fields__))

    def whole(self, coefficients):
        """All coefficients, shape (F, p + K), given those of the other columns."""
        base = self.base[:, :, -1] - np.einsum('fpk,fk->fp', self.base[:, :, :-1], coefficients)
        return np.hstack((base, coefficients))

    def without(self, taken):
        """Project out columns `taken` (indices) too, for one set of rows.

        Returns
        -------
        Beyond
            With zeros for these columns.
        of_taken : ndarray, shape (t, K + 1)
            Coefficients of these columns fitted to each column, and to the values.
        """
        inner, across = self.normal[0][np.ix_(taken, taken)], self.normal[0][taken]
        of_taken = np.linalg.solve(inner, np.column_stack((across, self.right[0, taken])))
        normal = self.normal[0] - across.T @ of_taken[:, :-1]
        right = self.right[0] - across.T @ of_taken[:, -1]
        squares = self.squares[0] - self.right[0, taken] @ of_taken[:, -1]
        normal[taken], normal[:, taken], right[taken] = 0.0, 0.0, 0.0
        base = np.zeros((1, self.base.shape[1] + len(taken), self.base.shape[2]))
        squares = np.maximum(squares, _ROUNDING * self.squares[0])
        return Beyond(normal[None], right[None], squares[None], base,
                      self.inverse, self.own, self.rows), of_taken


def chosen(beyond, allowed, cost, extra=0.0):
    """Forward selection by BIC, then backward elimination.

    Parameters
    ----------
    beyond : Beyond
    allowed : ndarray of bool, shape (K,)
        Columns that may be selected.
    cost : float
        BIC penalty of a column, in ln(rows).
    extra : float or ndarray, shape (K,)
        Additional penalty, for the scanned parameters of a column.

    Returns
    -------
    ndarray, shape (F, K)
        Coefficients; zero for columns not selected.
    """
    out = np.zeros_like(beyond.right)
    total, p = 2.0 * beyond.rows, beyond.base.shape[1]
    for f in range(len(beyond)):
        price = (cost + np.broadcast_to(extra, allowed.shape)) * np.log(max(beyond.rows[f], 2.0))
        some = np.flatnonzero(allowed)
        taken = _forward(beyond.normal[f][np.ix_(some, some)], beyond.right[f, some],
                         beyond.squares[f], _DISTINCT * beyond.own[f, some], price[some], total[f],
                         total[f] - p - max(_FREE, _FREE_PART * total[f]))
        taken = _backward(beyond, f, some[taken], price, total[f])
        if len(taken):
            out[f, taken] = np.linalg.solve(beyond.normal[f][np.ix_(taken, taken)],
                                            beyond.right[f, taken])
    return out


def _forward(normal, right, squares, least, price, total, most):
    """Indices of the columns selected; each is projected out of the others (pivoted Cholesky)."""
    taken, open_ = [], np.ones(len(right), bool)
    right, left, factors = right.copy(), normal.diagonal().copy(), np.empty((0, len(right)))
    while len(taken) < min(most, _MOST):
        ok = open_ & (left > least)
        gain = np.where(ok, -total * np.log(np.maximum(
            1.0 - right**2 / np.where(ok, left, 1.0) / squares, 1e-12)) - price, -np.inf)
        k = int(np.argmax(gain)) if len(gain) else -1
        if k < 0 or not gain[k] > 0.0:
            break
        # one step of Cholesky's factorisation, in the order of selection
        row = (normal[k] - factors[:, k] @ factors) / np.sqrt(left[k])
        share = right[k] / np.sqrt(left[k])
        squares = max(squares - share**2, _ROUNDING * squares)
        right -= row * share
        left -= row**2
        factors = np.vstack((factors, row))
        taken.append(k)
        open_[k] = False
    return np.array(taken, int)


def _backward(beyond, f, taken, price, total):
    """Backward elimination: drop columns of `taken` while that gains BIC."""
    while len(taken):
        inverse = np.linalg.inv(beyond.normal[f][np.ix_(taken, taken)])
        right = beyond.right[f, taken]
        values = inverse @ right
        left = max(beyond.squares[f] - values @ right, _ROUNDING * beyond.squares[f])
        loss = total * np.log1p(values**2 / inverse.diagonal() / left) - price[taken]
        worst = int(np.argmin(loss))
        if loss[worst] >= 0.0:
            break
        taken = np.delete(taken, worst)
    return taken


@dataclass
class Shrunk:
    """Coefficients shrunk with one prior variance for each group.

    Attributes
    ----------
    coefficients : ndarray, shape (F, K)
    variances : ndarray, shape (F, G)
        Prior variance of each group's coefficients.
    noise : ndarray, shape (F,)
        Variance of a value of unit weight.
    covariance : ndarray, shape (F, k, k)
        Posterior covariance of the coefficients of the columns `used`.
    used : ndarray of int, shape (k,)
        Columns that belong to a group.
    """

    coefficients: np.ndarray
    variances: np.ndarray
    noise: np.ndarray
    covariance: np.ndarray
    used: np.ndarray


def shrunk(beyond, group, rounds, start=None):
    """Ridge regression with one prior variance for each group, estimated from the rows.

    Parameters
    ----------
    beyond : Beyond
    group : ndarray of int, shape (K,)
        Group of each column; -1: not used.
    rounds : int
        Number of MacKay's updates.
    start : Shrunk, optional
        Result for all rows (its first set), whose variances are the initial ones.

    Returns
    -------
    Shrunk
    """
    used = np.flatnonzero(group >= 0)
    _, group = np.unique(group[used], return_inverse=True)
    count, k, sets = (group.max() + 1 if len(used) else 0), len(used), len(beyond)
    normal = beyond.normal[:, used][:, :, used]
    right, squares, free = beyond.right[:, used], beyond.squares, beyond.free
    of_group = np.zeros((k, count))
    of_group[np.arange(k), group] = 1.0
    mean, size = squares / free, np.einsum('fii->fi', normal) @ of_group
    if start is None or start.variances.shape[1] != count:
        variances = 0.5 * squares[:, None] / np.maximum(size * count, 1e-12 * squares[:, None])
        noise = 0.5 * mean
    else:
        variances, noise = (np.repeat(of[:1], sets, axis=0)
                            for of in (start.variances, start.noise))
    each = size / np.maximum(of_group.sum(axis=0), 1.0)
    bounds = np.array(_BOUNDS)[:, None, None] * squares[:, None] / np.maximum(
        each, 1e-12 * squares[:, None])
    diagonal = np.arange(k)
    values, inverse = np.zeros((sets, k)), np.zeros((sets, k, k))
    for _ in range(rounds if k else 0):
        root = np.sqrt(variances)[:, group]
        matrix = normal * (root[:, :, None] * root[:, None, :]) / noise[:, None, None]
        matrix[:, diagonal, diagonal] += 1.0
        inverse = inverse_root(matrix)
        inverse = inverse @ inverse.transpose(0, 2, 1)
        values = root * np.einsum('fij,fj->fi', inverse, root * right) / noise[:, None]
        known = np.clip(1.0 - np.einsum('fii->fi', inverse), 0.0, 1.0) @ of_group
        used_variances = variances
        variances = np.clip(values**2 @ of_group / np.maximum(known, 1e-9), *bounds)
        left = squares - 2.0 * np.einsum('fi,fi->f', values, right) + np.einsum(
            'fi,fij,fj->f', values, normal, values)
        noise = np.maximum(left / np.maximum(free - known.sum(axis=1), 0.1 * free),
                           _LEAST_NOISE * mean)
    if k:
        root = np.sqrt(used_variances)[:, group]
        inverse = inverse * (root[:, :, None] * root[:, None, :])
    out = np.zeros_like(beyond.right)
    out[:, used] = values
    return Shrunk(out, variances, noise, inverse, used)


def shrunk_beside_strong(beyond, group, rounds, allowed, cost):
    """`shrunk`, but effects that gain `cost` times their BIC penalty are not shrunk.

    Returns
    -------
    ndarray, shape (F, K)
        Coefficients.
    """
    strong, out, start = chosen(beyond, allowed, cost), np.zeros_like(beyond.right), None
    for f in range(len(beyond)):
        taken = np.flatnonzero(strong[f])
        one, of_taken = beyond.only(slice(f, f + 1)).without(taken)
        own = group.copy()
        own[taken] = -1
        own[one.normal[0].diagonal() < _DISTINCT * one.own[0]] = -1
        if (own >= 0).any():
            found = shrunk(one, own, rounds[0] if start is None else rounds[1], start)
            start = found if start is None else start
            out[f] = found.coefficients[0]
        out[f, taken] = of_taken[:, -1] - of_taken[:, :-1] @ out[f]
    return out
