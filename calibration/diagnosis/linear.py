"""Scores of candidate effects on what a fit leaves, and their chance level by sign flips.

Everything here is linear algebra on stacked residuals: x of all rows, then y of all rows. Both
values of a row belong together: they are flipped together, weighted together and left out
together.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC

#: part of a (scaled) column that must remain beyond the model for it to be told from the model
DISTINCT = 0.02
_EIGEN = 1e-10
_BISQUARE = 7.0
_HUBER = 1.5
_HAMPEL = (3.0, 12.0, 25.0)


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
        values, vectors = np.linalg.eigh(rows @ rows.T)
        keep = values > _EIGEN * values[-1:]
        rows = (vectors[:, keep] / np.sqrt(values[keep])).T @ rows
    return rows


class Columns:
    """Rows of a design, some of which live in one run only.

    Parameters
    ----------
    common : ndarray, shape (k, 2n)
        Columns of all runs.
    own : ndarray, shape (j, 2n), optional
        Columns that each run fits for itself.
    run : ndarray of int, shape (n,), optional
        Which run a row belongs to, for `own`.
    """

    def __init__(self, common, own=None, run=None):
        self.common, self.own, self.run = common, own, run
        self._blocks = None
        if own is not None:
            n = len(run)
            where = [np.flatnonzero(run == r) for r in np.unique(run)]
            self._blocks = [np.concatenate((i, i + n)) for i in where]

    def __len__(self):
        return len(self.common) + (0 if self.own is None else len(self.own) * len(self._blocks))

    def added(self, parts):
        """With more common columns."""
        out = Columns(np.vstack([self.common, *parts]))
        out.own, out.run, out._blocks = self.own, self.run, self._blocks
        return out

    def rows(self, both):
        """Of some rows (indices into 2n)."""
        if self.own is None:
            return Columns(self.common[:, both])
        return Columns(self.common[:, both], self.own[:, both], self.run[both[:len(both) // 2]])

    def basis(self, root):
        """Orthonormal basis of the weighted columns, shape (rank, 2n)."""
        if self.own is None:
            return orthonormal(self.common * root)
        out = []
        for block in self._blocks:
            part = orthonormal(self.own[:, block] * root[block])
            full = np.zeros((len(part), len(root)))
            full[:, block] = part
            out.append(full)
        out = np.vstack(out)
        white = self.common * root
        for _ in range(2):
            white = white - (white @ out.T) @ out
        length = np.sqrt(np.square(self.common * root).sum(axis=1))
        left = np.sqrt(np.square(white).sum(axis=1))
        return np.vstack((out, orthonormal(white[left > 1e-5 * length])))

    def dense(self):
        """All columns, those of each run one by one, shape (k, 2n)."""
        if self.own is None:
            return self.common
        out = np.zeros((len(self.own) * len(self._blocks), self.own.shape[1]))
        for i, block in enumerate(self._blocks):
            out[i * len(self.own):(i + 1) * len(self.own), block] = self.own[:, block]
        return np.vstack((self.common, out))


@dataclass
class State:
    """A robust weighted fit of some columns: what is left, and how it was weighted.

    Attributes
    ----------
    basis : ndarray, shape (rank, 2n)
        Orthonormal, of the weighted columns.
    root : ndarray, shape (2n,)
        Weights: whitened = root x value.
    residual : ndarray, shape (2n,)
        Whitened.
    raw : ndarray, shape (2n,)
        Radians.
    weights : ndarray, shape (n,)
        Robust, 0 to 1.
    scale : ndarray, shape (2,)
        Robust noise of x and y, radians (in sigmas, if these were given).
    """

    basis: np.ndarray
    root: np.ndarray
    residual: np.ndarray
    raw: np.ndarray
    weights: np.ndarray
    scale: np.ndarray

    @property
    def n(self):
        """Rows."""
        return len(self.weights)


def fit_state(rows, b, inverse_sigma=None, weights=None, robust=True, final=False):
    """Robust least squares of `b` by `rows`.

    Huber, then Hampel's weights of the radial distance at the scale of the median absolute
    residual; the axes then get their own variance. Hampel's leave a row some weight up to 25
    standard deviations: a few rows that lie off together may be what is looked for.

    Parameters
    ----------
    rows : Columns
    b : ndarray, shape (2n,)
        Radians.
    inverse_sigma : ndarray, shape (2n,), optional
    weights : ndarray, shape (n,), optional
        Of a fit of nearly the same, to start from.
    robust : bool
    final : bool
        Bisquare weights (zero from 7 standard deviations) in place of Hampel's, as
        `calibration.fit`: nothing more is looked for.

    Returns
    -------
    State
    """
    n = len(b) // 2
    given = np.ones(2 * n) if inverse_sigma is None else inverse_sigma
    warm = weights is not None
    w = np.ones(n) if weights is None else weights
    scale = np.ones(2)
    last = _bisquare if final else _hampel
    steps = [last] * 4 if warm else [None] + [_huber] * 6 + [last] * 5
    if not robust:
        steps, w = [None, None], np.ones(n)
    for step in steps:
        root = given * np.concatenate((np.sqrt(w) / scale[0], np.sqrt(w) / scale[1]))
        basis = rows.basis(root)
        whitened = b * root
        residual = whitened - (basis @ whitened) @ basis
        safe = np.where(root > 0.0, root, np.inf)
        raw = residual / safe
        if (w == 0.0).any():
            raw = _fill(rows, b, root, raw, w)
        standard = (raw * given).reshape(2, n)
        dof = np.sqrt(2 * n / max(2 * n - len(basis), 1))
        if step is not None:
            middle = np.maximum(1.4826 * dof * np.median(np.abs(standard), axis=1),
                                1e-6 * ARCSEC if inverse_sigma is None else 1e-6)
            w = step(np.hypot(*(standard / middle[:, None])))
        total = max(float(w.sum()), 1.0)
        scale = np.maximum(np.sqrt((w * standard**2).sum(axis=1) / total) * dof,
                           1e-9 * ARCSEC if inverse_sigma is None else 1e-9)
    root = given * np.concatenate((np.sqrt(w) / scale[0], np.sqrt(w) / scale[1]))
    basis = rows.basis(root)
    whitened = b * root
    residual = whitened - (basis @ whitened) @ basis
    raw = residual / np.where(root > 0.0, root, np.inf)
    if (w == 0.0).any():
        raw = _fill(rows, b, root, raw, w)
    return State(basis, root, residual, raw, w, scale)


def _fill(rows, b, root, raw, w):
    """Residuals of the rows without weight, from coefficients of the others."""
    design = rows.dense()
    p = solve(design, b, root)
    out = np.concatenate((w == 0.0, w == 0.0))
    raw = raw.copy()
    raw[out] = b[out] - p @ design[:, out]
    return raw


def solve(rows, b, root):
    """Weighted least squares of b = p @ rows (smallest norm where it is not determined).

    Parameters
    ----------
    rows : ndarray, shape (k, 2n)
    b, root : ndarray, shape (2n,)
    """
    return inverse_normal(rows, root) @ (rows @ (root * root * b))


def inverse_normal(rows, root):
    """Inverse of the weighted normal matrix, in the directions that the rows determine."""
    a = rows * root
    length = np.sqrt(np.einsum('ij,ij->i', a, a))
    length = np.where(length > 0.0, length, 1.0)
    a /= length[:, None]
    values, vectors = np.linalg.eigh(a @ a.T)
    keep = values > _EIGEN * values[-1]
    half = vectors[:, keep] / (np.sqrt(values[keep]) * length[:, None])
    return half @ half.T


def _huber(u):
    return _HUBER / np.maximum(u, _HUBER)


def _hampel(u):
    a, b, c = _HAMPEL
    return np.minimum(1.0, a / np.maximum(u, a)) * np.clip((c - u) / (c - b), 0.0, 1.0)


def _bisquare(u):
    return np.square(np.maximum(1.0 - np.square(u / _BISQUARE), 0.0))


@dataclass
class Scores:
    """Of every candidate group on one residual.

    Attributes
    ----------
    dof : ndarray of int, shape (G,)
        Columns that the model does not have; 0: none, it cannot be told from the model.
    delta_bic : ndarray, shape (G,)
        Gain of adding the group; -inf where dof is 0.
    bases : list of (ndarray of int, ndarray of shape (G_d, d, 2n), ndarray of int)
        Groups of equal size, their orthonormal bases beyond the model, and their dof.
    """

    dof: np.ndarray
    delta_bic: np.ndarray
    bases: list

    def basis(self, group):
        """Orthonormal basis of one group, shape (d, 2n)."""
        for groups, basis, _ in self.bases:
            where = np.flatnonzero(groups == group)
            if len(where):
                return basis[where[0]]
        raise ValueError(f'no candidate group {group}')


class Bank:
    """Candidate groups with their columns, evaluated once.

    Parameters
    ----------
    effects : list of Effect
    context : Context
        Of the rows.
    """

    def __init__(self, effects, context=None, _columns=None):
        self.effects = list(effects)
        sizes = np.array([len(e.coefficient_names) for e in self.effects], int)
        self._start = np.concatenate(([0], np.cumsum(sizes)))
        if _columns is None:
            n = len(context)
            _columns = np.empty((self._start[-1], 2 * n))
            for e, i, j in zip(self.effects, self._start[:-1], self._start[1:]):
                _columns[i:j] = e.columns(context).reshape(j - i, 2 * n)
        self.columns = _columns
        self._by_size = [(int(d), np.flatnonzero(sizes == d)) for d in np.unique(sizes)]
        # what was scanned, in parameters
        self.scan_cost = np.array([0 if e.scan is None else e.scanned for e in self.effects], int)
        names = {}
        self.line = np.array([names.setdefault(e.line, len(names)) for e in self.effects], int)

    def __len__(self):
        return len(self.effects)

    def of(self, g):
        """Columns of group `g`, shape (d, 2n)."""
        return self.columns[self._start[g]:self._start[g + 1]]

    def replace(self, g, effect, columns):
        """Put another effect with as many columns, shape (d, 2n), in the place of group `g`."""
        self.effects = [*self.effects[:g], effect, *self.effects[g + 1:]]
        self.of(g)[:] = columns

    def rows(self, rows):
        """The bank of some rows (indices or a mask of n)."""
        n = self.columns.shape[1] // 2
        index = np.arange(n)[rows]
        return Bank(self.effects, None, self.columns[:, np.concatenate((index, index + n))])

    def bases(self, state):
        """Orthonormal bases of the groups beyond the model.

        Yields
        ------
        groups : ndarray of int, shape (G_d,)
        basis : ndarray, shape (G_d, d, 2n)
            A row is zero where the group has fewer directions of its own.
        dof : ndarray of int, shape (G_d,)
        """
        white = self.columns * state.root
        length = np.sqrt(np.einsum('ij,ij->i', white, white))
        white /= np.where(length > 0.0, length, 1.0)[:, None]
        white -= (white @ state.basis.T) @ state.basis
        for d, groups in self._by_size:
            part = white[self._start[groups][:, None] + np.arange(d)]
            if d == 1:
                norm2 = np.einsum('gdi,gdi->gd', part, part)
                keep = norm2 > DISTINCT**2
                factor = np.where(keep, 1.0 / np.sqrt(np.where(keep, norm2, 1.0)), 0.0)
                yield groups, part * factor[:, :, None], keep.sum(axis=1)
                continue
            values, vectors = np.linalg.eigh(part @ part.transpose(0, 2, 1))
            keep = values > DISTINCT**2
            factor = np.where(keep, 1.0 / np.sqrt(np.where(keep, values, 1.0)), 0.0)
            yield (groups, (vectors * factor[:, None, :]).transpose(0, 2, 1) @ part,
                   keep.sum(axis=1))

    def score(self, state):
        """Score all groups on what a state leaves.

        Parameters
        ----------
        state : State

        Returns
        -------
        Scores
        """
        n, size = state.n, len(self.effects)
        dof, dbic = np.zeros(size, int), np.full(size, -np.inf)
        r = state.residual
        live = max(np.count_nonzero(state.weights > 0.05), 2)
        rss = np.array([r[:n] @ r[:n], r[n:] @ r[n:]]) + 1e-30
        bases = list(self.bases(state))
        for groups, basis, k in bases:
            left = np.square(r - np.einsum('gd,gdi->gi', basis @ r, basis))
            ratio = np.stack([left[:, :n].sum(axis=1), left[:, n:].sum(axis=1)], axis=1) / rss
            cost = (k + self.scan_cost[groups]) * np.log(live)
            gain = -live * np.log(np.maximum(ratio, 1e-12)).sum(axis=1) - cost
            dof[groups] = k
            dbic[groups[k > 0]] = gain[k > 0]
        return Scores(dof, dbic, bases)


def overlap(a, b):
    """How much two spans are one: smallest and largest squared cosine between them.

    Parameters
    ----------
    a, b : ndarray, shape (d, 2n)
        Orthonormal rows (zero rows are ignored).
    """
    a = a[np.einsum('ij,ij->i', a, a) > 0.5]
    b = b[np.einsum('ij,ij->i', b, b) > 0.5]
    if not len(a) or not len(b):
        return 0.0, 0.0
    values = np.linalg.svd(a @ b.T, compute_uv=False)
    smallest = values[-1] if len(a) == len(b) else 0.0
    return float(smallest**2), float(values[0] ** 2)
