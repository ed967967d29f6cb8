"""What rows of numbers span: orthonormal bases, inverse normal matrices, angles between two."""

import numpy as np

from .constants import EIGEN

#: of a row of unit length that those before it do not explain: with more of each none depends on
#: others
_SURE = 1e-3


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
            from scipy.linalg.lapack import dgeqrf, dorgqr  # slow to import
            turned, tau, _, _ = dgeqrf(rows.T)  # a tenth of the time of the eigenvalues
            if np.abs(turned.diagonal()).min() > _SURE:
                return dorgqr(turned, tau, overwrite_a=1)[0].T
        values, vectors = np.linalg.eigh(rows @ rows.T)
        keep = values > EIGEN * values[-1:]
        rows = (vectors[:, keep] / np.sqrt(values[keep])).T @ rows
    return rows


def orthonormal_each(rows, blocks):
    """`orthonormal` of the same rows in each block of columns, all blocks at once."""
    parts = [rows[:, where] for where in blocks]
    for _ in range(2):
        gram = np.array([part @ part.T for part in parts])
        length = np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
        length = np.where(length > 0.0, length, 1.0)
        values, vectors = np.linalg.eigh(gram / (length[:, :, None] * length[:, None, :]))
        keep = values > EIGEN * np.maximum(values[:, -1:], EIGEN)
        factor = np.where(keep, 1.0 / np.sqrt(np.where(keep, values, 1.0)), 0.0)
        turn = (vectors * factor[:, None, :]).transpose(0, 2, 1) / length[:, None, :]
        parts = [t @ part for t, part in zip(turn, parts)]
    return [part[kept] for part, kept in zip(parts, keep)]


def inverse_normal(a):
    """Inverse of the normal matrix of whitened rows, in the directions that they determine.

    Parameters
    ----------
    a : ndarray, shape (k, 2n)
        Is changed.
    """
    length = np.sqrt(np.einsum('ij,ij->i', a, a))
    length = np.where(length > 0.0, length, 1.0)
    a /= length[:, None]
    values, vectors = np.linalg.eigh(a @ a.T)
    keep = values > EIGEN * values[-1:]
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
