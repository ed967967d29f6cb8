"""The design of a fit with a zero for each of many runs, without the columns of the zeros.

The zero of a run has a column in x and one in y, both zero in other runs: no two of them share a
row. Products with them are sums over the run, the normal matrix has a diagonal block for them
whatever the weights, and its inverse is that of a matrix as small as the terms are (the Schur
complement). So time and memory grow with the rows alone.
"""

import numpy as np

from .least_squares import normal_matrices

#: runs from which on it is worth it: below, the columns themselves are as fast
MANY = 16


class RunColumns:
    """As an ndarray of shape (k + 2 m, 2n) where `gauss_newton` has a design.

    Parameters
    ----------
    terms : ndarray, shape (k, 2n)
        Columns of the terms, x of all rows, then y.
    run : ndarray of int, shape (n,)
        0: the first run, which has no zero of its own; 1 ... m.
    cos_el : ndarray, shape (n,)
    """

    __array_ufunc__ = None  # so that an ndarray leaves products to this

    def __init__(self, terms, run, cos_el):
        self.terms, self._run, self._cos_el = terms, run, cos_el
        self._runs = int(run.max()) + 1

    @classmethod
    def of(cls, terms, labels, el):
        """Of rows with those runs, at those elevations (rad)."""
        return cls(terms, np.unique(labels, return_inverse=True)[1].reshape(len(el)), np.cos(el))

    def __len__(self):
        return len(self.terms) + 2 * (self._runs - 1)

    @property
    def shape(self):
        """Of the ndarray in whose place it is."""
        return len(self), self.terms.shape[1]

    def __getitem__(self, row):
        """The column of a term, shape (2n,)."""
        return self.terms[row]

    def __array__(self, dtype=None, copy=None):
        out = np.zeros(self.shape)
        k, n = len(self.terms), len(self._run)
        out[:k] = self.terms
        at = np.flatnonzero(self._run)
        place = k + 2 * (self._run[at] - 1)
        out[place, at] = self._cos_el[at]
        out[place + 1, n + at] = 1.0
        return out if dtype is None else out.astype(dtype)

    def _sums(self, x, y):
        """Over each run but the first, x and y in turns: shape (2m,)."""
        out = np.empty((self._runs, 2))
        out[:, 0] = np.bincount(self._run, x, self._runs)
        out[:, 1] = np.bincount(self._run, y, self._runs)
        return out[1:].ravel()

    def __matmul__(self, values):
        """With values of the rows, shape (2n,)."""
        n = len(self._run)
        return np.concatenate((self.terms @ values,
                               self._sums(self._cos_el * values[:n], values[n:])))

    def __rmatmul__(self, p):
        """Coefficients, shape (k + 2 m,), as values of the rows; of a matrix of them, dense."""
        if p.ndim > 1:
            return p @ np.asarray(self)
        k, n = len(self.terms), len(self._run)
        zeros = np.vstack((np.zeros(2), p[k:].reshape(-1, 2)))[self._run]
        out = p[:k] @ self.terms
        out[:n] += self._cos_el * zeros[:, 0]
        out[n:] += zeros[:, 1]
        return out

    def part(self, rows):
        """Of some rows, an ndarray of int; runs without any of them have columns of zeros."""
        n = len(self._run)
        out = RunColumns(np.concatenate((self.terms[:, :n][:, rows], self.terms[:, n:][:, rows]),
                                        axis=1), self._run[rows], self._cos_el[rows])
        out._runs = self._runs
        return out

    def normals(self, weights):
        """As `least_squares.normal_matrices`."""
        k, n = len(self.terms), len(self._run)
        x_normal, normal = np.zeros((2, len(self), len(self)))
        x_normal[:k, :k], normal[:k, :k] = normal_matrices(self.terms, weights)
        wx, wy = (np.ones(2 * n) if weights is None else weights).reshape(2, n)
        wx = wx * self._cos_el
        for row, term in enumerate(self.terms):
            both = self._sums(wx * term[:n], wy * term[n:])
            normal[row, k:] = normal[k:, row] = both
            x_normal[row, k::2] = x_normal[k::2, row] = both[::2]
        at = np.arange(k, len(self))
        normal[at, at] = squares = self._sums(wx * self._cos_el, wy)
        x_normal[at[::2], at[::2]] = squares[::2]
        return x_normal, normal

    def inverse(self, normal):
        """That of a normal matrix of this design.

        Raises
        ------
        LinAlgError
            There is none.
        """
        k, size = len(self.terms), normal.diagonal()[len(self.terms):]
        if not (size > 0.0).all():
            raise np.linalg.LinAlgError('a run without any weight')
        across = normal[:k, k:] / size
        small = np.linalg.inv(normal[:k, :k] - across @ normal[k:, :k])
        out = np.empty_like(normal)
        out[:k, :k] = small
        out[:k, k:] = -small @ across
        out[k:, :k] = out[:k, k:].T
        out[k:, k:] = -across.T @ out[:k, k:]
        at = np.arange(k, len(out))
        out[at, at] += 1.0 / size
        return out

    def spectrum(self, normal):
        """Eigenvalues (ascending) and vectors of the scaled normal matrix, and lengths of columns.

        Scaled to columns of unit length it is [[A, B], [B', 1]]: what is at right angles to the
        rows of B has the eigenvalue 1, the rest is a matrix twice as large as the terms are. None
        where the terms have as many columns as the zeros.
        """
        k, m = len(self.terms), len(self) - len(self.terms)
        if m <= k:
            return None
        scale = np.sqrt(normal.diagonal())
        scale = np.where(scale > 0.0, scale, 1.0)
        small = normal[:k] / (scale[:k, None] * scale)
        q, r = np.linalg.qr(small[:, k:].T, mode='complete')
        joint = np.eye(2 * k)
        joint[:k, :k], joint[:k, k:], joint[k:, :k] = small[:, :k], r[:k].T, r[:k]
        values, vectors = np.linalg.eigh(joint)
        both = np.zeros((len(self), len(self)))
        both[:k, :2 * k] = vectors[:k]
        both[k:, :2 * k] = q[:, :k] @ vectors[k:]
        both[k:, 2 * k:] = q[:, k:]
        values = np.concatenate((values, np.ones(m - k)))
        order = np.argsort(values, kind='stable')
        return values[order], both[:, order], scale
