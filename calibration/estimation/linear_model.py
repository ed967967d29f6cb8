"""Linear algebra on stacked residuals: x of all rows, then y of all rows.

Both values of a row belong together: they are flipped together, weighted together and left out
together.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC

from .correlated_noise import EIGEN, CorrelatedNoise, WhiteNoise, noise_memory
from .robust import bisquare, hampel, huber, reweighted, sigma_of

#: of a row of unit length that those before it do not explain: with more of each none depends on
#: others
_SURE = 1e-3
#: part of a (scaled) column that must remain beyond the model: below it the coefficient's sigma is
#: 50 times that of the column alone, and what is found rests on the second order
DISTINCT = 0.02
#: the same, where it may be rounding
_LEAST = 1e-5
#: weight above which a row counts: Hampel's is 0.05 at 20.5 standard deviations
LIVE = 0.05


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


class Basis:
    """Orthonormal rows, of which those of single runs are zero elsewhere and kept so.

    Of 119 runs with six terms each 714 rows of 2n would be nearly all zeros; to take them off
    hundreds of candidates would cost a hundred times as much.

    Parameters
    ----------
    common : ndarray, shape (k, 2n)
        Orthonormal, beyond the parts.
    blocks : list of ndarray of int
        Where each run is in 2n.
    parts : list of ndarray, shape (j, len(block))
        Orthonormal, of each run.
    """

    def __init__(self, common, blocks=(), parts=()):
        self.common, self.blocks, self.parts = common, blocks, parts

    def __len__(self):
        return len(self.common) + sum(map(len, self.parts))

    def off(self, rows, in_place=False):
        """Rows, shape (..., 2n), without what the basis spans."""
        out = rows if in_place else np.array(rows, dtype=float)
        for where, part in zip(self.blocks, self.parts):
            here = out[..., where]
            out[..., where] = here - (here @ part.T) @ part
        out -= (out @ self.common.T) @ self.common
        return out

    def with_common(self, rows):
        """With orthonormal rows, shape (j, 2n), that are beyond it."""
        return Basis(np.vstack((self.common, rows)), self.blocks, self.parts)

    def blocks_of_rows(self):
        """Entries of the projector that belong to one row: xx, yy and xy, each shape (n,)."""
        n = self.common.shape[1] // 2
        x, y = self.common[:, :n], self.common[:, n:]
        out = np.array([np.einsum('ij,ij->j', a, b) for a, b in ((x, x), (y, y), (x, y))])
        for where, part in zip(self.blocks, self.parts):
            m = len(where) // 2
            x, y = part[:, :m], part[:, m:]
            out[:, where[:m]] += [np.einsum('ij,ij->j', a, b)
                                  for a, b in ((x, x), (y, y), (x, y))]
        return out


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
    zeros : sequence of int
        Which of the common columns are the zeros of the axes.
    """

    def __init__(self, common, own=None, run=None, zeros=()):
        self.common, self.own, self.run, self.zeros = common, own, run, list(zeros)
        self._blocks = None
        if own is not None:
            n = len(run)
            where = [np.flatnonzero(run == r) for r in np.unique(run)]
            self._blocks = [np.concatenate((i, i + n)) for i in where]

    def __len__(self):
        return len(self.common) + (0 if self.own is None else len(self.own) * len(self._blocks))

    def added(self, parts):
        """With more common columns."""
        out = Columns(np.vstack([self.common, *parts]), zeros=self.zeros)
        out.own, out.run, out._blocks = self.own, self.run, self._blocks
        return out

    def rows(self, both):
        """Of some rows (indices into 2n)."""
        if self.own is None:
            return Columns(self.common[:, both], zeros=self.zeros)
        return Columns(self.common[:, both], self.own[:, both], self.run[both[:len(both) // 2]],
                       self.zeros)

    def basis(self, noise):
        """`Basis` of the whitened columns.

        Parameters
        ----------
        noise : WhiteNoise or CorrelatedNoise
            No row of one run has to do with those of another.
        """
        common = noise.whiten(self.common)
        if self.own is None:
            return Basis(orthonormal(common))
        out = self.own_basis(noise.whiten(self.own))
        left = out.off(out.off(common))
        length = np.sqrt(np.square(common).sum(axis=1))
        kept = np.sqrt(np.square(left).sum(axis=1)) > _LEAST * length
        return Basis(orthonormal(left[kept]), self._blocks, out.parts)

    def own_basis(self, white_own, but=None):
        """`Basis` of what the runs fit for themselves.

        Parameters
        ----------
        white_own : ndarray, shape (j, 2n)
        but : int, optional
            Run that is left out, counted from 0.
        """
        blocks = [where for i, where in enumerate(self._blocks) if i != but]
        return Basis(white_own[:0], blocks, orthonormal_each(white_own, blocks) if blocks else [])

    def own_of(self, i):
        """Columns of the `i`-th run's own, zero elsewhere, shape (j, 2n)."""
        out = np.zeros_like(self.own)
        out[:, self._blocks[i]] = self.own[:, self._blocks[i]]
        return out

    def solver(self, noise, least=_LEAST):
        """`ColumnSolver` of these columns."""
        return ColumnSolver(self, noise, least)

    def left_of(self, b, noise):
        """What a least-squares fit leaves of all rows, those without weight too, shape (2n,).

        Parameters
        ----------
        b : ndarray, shape (2n,)
        noise : WhiteNoise or CorrelatedNoise
        """
        return self.left_by(*self.solver(noise)(b), b)

    def left_by(self, p, own, b):
        """What coefficients, of the common columns (k,) and of each run's own, leave of `b`."""
        out = b - p @ self.common
        for where, q in zip(self._blocks or (), own):
            out[where] -= q @ self.own[:, where]
        return out


class ColumnSolver:
    """Least squares by `Columns`, run by run: the normal matrix of all would be mostly zeros.

    Parameters
    ----------
    columns : Columns
    noise : WhiteNoise or CorrelatedNoise
    least : float
        Part of a common column that the runs cannot fit for themselves: below it its coefficient is
        zero.

    Attributes
    ----------
    inverse : ndarray, shape (k, k)
        Covariance of the coefficients of the common columns, whatever the runs' own are.
    """

    def __init__(self, columns, noise, least):
        self._columns, self._noise, self._basis = columns, noise, None
        beyond = noise.whiten(columns.common)
        if columns.own is not None:
            length = np.sqrt(np.square(beyond).sum(axis=1))
            self._basis = columns.own_basis(noise.whiten(columns.own))
            beyond = self._basis.off(beyond)
            beyond[np.sqrt(np.square(beyond).sum(axis=1)) <= least * length] = 0.0
        self._beyond, self.inverse = beyond, inverse_normal(beyond.copy())

    def inverse_under(self, noise):
        """Covariance of the same coefficients, if the noise is another `CorrelatedNoise`."""
        factor = noise.spread((self.inverse @ self._beyond) * self._noise.root)
        return factor @ factor.T

    def __call__(self, b):
        """Coefficients of the common columns, (k,), and of each run's own, (runs, j).

        Zeros are where the rows were, not where their memory would take them: where correlated
        noise goes through the whole run its mean is hardly known, and generalised least squares
        may put it far beside all rows (a run of 1.4 h with noise of 140": 60").
        """
        values, columns = self._noise.whiten(b), self._columns
        white = WhiteNoise(self._noise.root)
        if self._basis is None:
            p = self.inverse @ (self._beyond @ values)
            if columns.zeros and isinstance(self._noise, CorrelatedNoise):
                p[columns.zeros] += Columns(columns.common[columns.zeros]).solver(white)(
                    b - p @ columns.common)[0]
            return p, np.empty((0, 0))
        p = self.inverse @ (self._beyond @ self._basis.off(values))
        own = white.whiten(columns.own)
        values = white.whiten(b - p @ columns.common)
        return p, np.array([inverse_normal(own[:, where]) @ (own[:, where] @ values[where])
                            for where in columns._blocks])


@dataclass
class WeightedFit:
    """A robust weighted fit of some columns: what is left, and how it was weighted.

    Attributes
    ----------
    basis : Basis
        Of the whitened columns.
    noise : WhiteNoise or CorrelatedNoise
        By which the rows are whitened.
    residual : ndarray, shape (2n,)
        Whitened.
    raw : ndarray, shape (2n,)
        Radians.
    weights : ndarray, shape (n,)
        Robust, 0 to 1.
    scale : ndarray, shape (2,)
        Robust noise of x and y, radians (in sigmas, if these were given).
    memory : tuple of AxisNoise
        Of x and y, that the noise has; empty: none.
    """

    basis: Basis
    noise: object
    residual: np.ndarray
    raw: np.ndarray
    weights: np.ndarray
    scale: np.ndarray
    memory: tuple = ()

    @property
    def n(self):
        """Rows."""
        return len(self.weights)


def weighted_fit(columns, b, inverse_sigma=None, weights=None, final=False):
    """Robust least squares of `b` by `columns`, without memory.

    Huber, then Hampel's weights of the radial distance at the scale of the median absolute
    residual; the axes then get their own variance. Hampel's leave a row some weight up to 25
    standard deviations: a few rows that lie off together may be what is looked for.

    Parameters
    ----------
    columns : Columns
    b : ndarray, shape (2n,)
        Radians.
    inverse_sigma : ndarray, shape (2n,), optional
    weights : ndarray, shape (n,), optional
        Of a fit of nearly the same, to start from.
    final : bool
        Bisquare weights (zero from 7 standard deviations) in place of Hampel's, as the direct
        solver: nothing more is looked for.

    Returns
    -------
    WeightedFit
    """
    n = len(b) // 2
    given = np.ones(2 * n) if inverse_sigma is None else inverse_sigma
    least = ARCSEC if inverse_sigma is None else 1.0  # the unit of the noise that is not zero
    last = bisquare if final else hampel
    steps = [None] + [huber] * 6 + [last] * 5 if weights is None else [last] * 4
    scale, todo = np.ones(2), iter(steps)

    def solution(w):
        root = given * np.concatenate((np.sqrt(w) / scale[0], np.sqrt(w) / scale[1]))
        noise = WhiteNoise(root)
        basis = columns.basis(noise)
        residual = basis.off(noise.whiten(b))
        raw = residual / np.where(root > 0.0, root, np.inf)
        if (w == 0.0).any():  # by the coefficients of the others
            out = np.tile(w == 0.0, 2)
            raw[out] = columns.left_of(b, noise)[out]
        return WeightedFit(basis, noise, residual, raw, w, scale)

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

    start = solution(np.ones(n) if weights is None else weights)
    return reweighted(solution, weigh, start, len(steps))[0]


def memory_of(fit, columns, b, sequence):
    """`noise_memory` of a fit whose noise was taken as white."""
    return noise_memory(sequence, fit.noise.root, fit.scale, columns.common, b, columns.own)


def with_memory(fit, columns, b, sequence, memory):
    """The fit of the same rows with the same weights, if their noise has a memory.

    Parameters
    ----------
    fit : WeightedFit
        Without memory.
    columns : Columns
    b : ndarray, shape (2n,)
    sequence : Sequence
    memory : tuple of AxisNoise
        Of x and y.

    Returns
    -------
    WeightedFit
    """
    noise = CorrelatedNoise.beside(fit.noise, fit.scale, sequence, memory)
    basis = columns.basis(noise)
    return WeightedFit(basis, noise, basis.off(noise.whiten(b)), columns.left_of(b, noise),
                       fit.weights, fit.scale, memory)
