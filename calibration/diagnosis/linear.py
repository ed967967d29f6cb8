"""Linear algebra on stacked residuals: x of all rows, then y of all rows.

Both values of a row belong together: they are flipped together, weighted together and left out
together.
"""

from dataclasses import dataclass

import numpy as np

from calibration.robust import bisquare, hampel, huber, reweighted, sigma_of
from msg_tools.units import ARCSEC

from .constants import EIGEN


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
        keep = values > EIGEN * values[-1:]
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


def fit_state(rows, b, inverse_sigma=None, weights=None, final=False):
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
    final : bool
        Bisquare weights (zero from 7 standard deviations) in place of Hampel's, as
        `calibration.fit`: nothing more is looked for.

    Returns
    -------
    State
    """
    n = len(b) // 2
    given = np.ones(2 * n) if inverse_sigma is None else inverse_sigma
    least = ARCSEC if inverse_sigma is None else 1.0  # the unit of the noise that is not zero
    last = bisquare if final else hampel
    steps = [None] + [huber] * 6 + [last] * 5 if weights is None else [last] * 4
    scale, todo = np.ones(2), iter(steps)

    def solve(w):
        root = given * np.concatenate((np.sqrt(w) / scale[0], np.sqrt(w) / scale[1]))
        basis = rows.basis(root)
        whitened = b * root
        residual = whitened - (basis @ whitened) @ basis
        raw = residual / np.where(root > 0.0, root, np.inf)
        if (w == 0.0).any():
            raw = _fill(rows, b, root, raw, w)
        return State(basis, root, residual, raw, w, scale)

    def weigh(fit):
        nonlocal scale
        step = next(todo)
        w, standard = fit.weights, (fit.raw * given).reshape(2, n)
        dof = np.sqrt(2 * n / max(2 * n - len(fit.basis), 1))
        if step is not None:
            middle = np.maximum(sigma_of(standard, dof, axis=1), 1e-6 * least)
            w = step(np.hypot(*(standard / middle[:, None])))
        total = max(float(w.sum()), 1.0)
        scale = np.maximum(np.sqrt((w * standard**2).sum(axis=1) / total) * dof, 1e-9 * least)
        return w

    start = solve(np.ones(n) if weights is None else weights)
    return reweighted(solve, weigh, start, len(steps))[0]


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
    keep = values > EIGEN * values[-1]
    half = vectors[:, keep] / (np.sqrt(values[keep]) * length[:, None])
    return half @ half.T


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
