"""Weighted least squares of two axes: the algebra behind `fit`; its iteration: `gauss_newton`.

The design has a row a coefficient: x of all stars, then y of all stars. In the place of an ndarray
it may be `run_columns.RunColumns`. A weight per value may be None: all equal.
"""

import functools
from typing import NamedTuple

import numpy as np

from .few_rows import satterthwaite
from .robust import BISQUARE_INFLATION, BISQUARE_VARIANCE

# of the normal matrix, scaled to a unit diagonal:
_GRAM_LIMIT = 1e-10  # smallest ratio of eigenvalues that are accurate
_SAFE_CONDITION = 1e8  # up to here it may be inverted
_FINE_CONDITION = 1e5  # and up to here rounding stays below 1e-11 of the coefficients


class Spectrum(NamedTuple):
    """Singular values of the weighted design with columns of unit length, ascending."""

    s: np.ndarray
    vectors: np.ndarray  # (k, k), right singular vectors in its columns, in that order
    scale: np.ndarray  # length of the columns

    def rank(self, rcond):
        """How many are above `rcond` times the largest."""
        return len(self.s) - int(self.s.searchsorted(rcond * self.s[-1], 'right'))


class Solution(NamedTuple):
    """Of `weighted_solve`, in the units of the data."""

    p: np.ndarray  # (k,), the coefficients
    inverse: np.ndarray  # of the normal matrix, in the directions kept
    normal: np.ndarray
    x_normal: np.ndarray  # the part of the normal matrix that the x rows make
    residual: np.ndarray  # (2n,), x of all stars, then y
    rank: int


@functools.cache
def _lapack():
    from scipy.linalg import lapack  # slow to import; its calls cost a quarter of numpy.linalg's
    return lapack


def inverse_of(matrix):
    """As `numpy.linalg.inv` of one small matrix, LinAlgError where it is singular."""
    factors, order, bad = _lapack().dgetrf(matrix)
    if bad:
        raise np.linalg.LinAlgError('singular matrix')
    return _lapack().dgetri(factors, order)[0]


def spectrum_of(rows, weights, normal):
    """Singular values of a design: from its normal matrix where those are accurate, else by QR.

    Parameters
    ----------
    rows : ndarray, shape (k, 2n)
    weights : ndarray, shape (2n,), or None
    normal : ndarray, shape (k, k)
        Of both, from `normal_matrices`.

    Returns
    -------
    Spectrum
    """
    found = None if isinstance(rows, np.ndarray) else rows.spectrum(normal)
    if found is None:
        scale = np.sqrt(normal.diagonal())
        scale[scale <= 0.0] = 1.0
        values, vectors, bad = _lapack().dsyevd(normal / (scale[:, None] * scale))
        if bad:
            raise np.linalg.LinAlgError('the normal matrix of a fit is not finite')
    else:
        values, vectors, scale = found
    if values[0] > _GRAM_LIMIT * values[-1]:
        return Spectrum(np.sqrt(values), vectors, scale)
    rows = np.asarray(rows)
    design = (rows if weights is None else rows * np.sqrt(weights)) / scale[:, None]
    _, s, v = np.linalg.svd(np.linalg.qr(design.T, mode='r'))
    return Spectrum(s[::-1], v[::-1].T, scale)


def normal_matrices(rows, weights=None):
    """The x part of the normal matrix, and all of it.

    Parameters
    ----------
    rows : ndarray, shape (k, 2n)
        The design.
    weights : ndarray, shape (2n,), or None

    Returns
    -------
    x_normal, normal : ndarray, shape (k, k)
    """
    if not isinstance(rows, np.ndarray):
        return rows.normals(weights)
    n = rows.shape[1] // 2
    weighted = rows if weights is None else rows * weights
    x_normal = weighted[:, :n] @ rows[:, :n].T
    return x_normal, x_normal + weighted[:, n:] @ rows[:, n:].T


def weighted_solve(rows, b, weights, rcond):
    """Weighted least squares of b = p @ rows, with singular directions left out.

    The inverse normal matrix where that is accurate, with a step of iterative refinement (which
    makes it as good as QR) unless it needs none; else the SVD.

    Parameters
    ----------
    rows : ndarray, shape (k, 2n)
    b : ndarray, shape (2n,)
    weights : ndarray, shape (2n,), or None
    rcond : float
        Relative singular value below which a direction is left out.

    Returns
    -------
    Solution
    """
    x_normal, normal = normal_matrices(rows, weights)
    try:
        inverse = (inverse_of(normal) if isinstance(rows, np.ndarray)
                   else rows.inverse(normal))
        # trace x trace of the scaled matrix and its inverse: never below the condition number
        condition = len(normal) * float(normal.diagonal() @ inverse.diagonal())
    except np.linalg.LinAlgError:
        condition = np.inf
    if 0.0 < condition < min(_SAFE_CONDITION, 1.0 / rcond**2):
        rank = len(normal)
        refinements = 1 if condition > _FINE_CONDITION else 0
    else:
        spectrum = spectrum_of(rows, weights, normal)
        rank = spectrum.rank(rcond)
        kept = slice(len(spectrum.s) - rank, None)  # none, where no row has a weight
        half = spectrum.vectors[:, kept] / (spectrum.scale[:, None] * spectrum.s[kept])
        inverse = half @ half.T
        refinements = 3
    p = inverse @ (rows @ (b if weights is None else weights * b))
    residual = b - p @ rows
    for _ in range(refinements):
        p = p + inverse @ (rows @ (residual if weights is None else weights * residual))
        residual = b - p @ rows
    return Solution(p, inverse, normal, x_normal, residual, rank)


class Uncertainty(NamedTuple):
    """Of `uncertainty_of`."""

    covariance: np.ndarray  # (k, k), of the coefficients
    scatter: tuple  # standard deviation of x and y, in the unit of the residual, or in sigmas
    freedom: np.ndarray  # (k,) or with a basis as many as it gives: of each standard error


def uncertainty_of(solution, base, row_weights, given, basis=None, lost=0):
    """Covariance of the coefficients, the scatter of each axis, and how well they are known.

    The inverse normal matrix if the sigmas were given; else sandwiched with the measured
    variance of each axis, so that axes of different noise keep their own. The bisquare's loss
    of efficiency is in it. `lost` rows have no weight in `base`.

    Degrees of freedom have the standard errors that the scatter gives. Each axis has its own (the
    rows less what the coefficients took of them), and a coefficient that both determine one
    between them: `few_rows.satterthwaite`.

    Parameters
    ----------
    solution : Solution
    base, row_weights : ndarray, shapes (2n,) and (n,), or None
    given : bool
        Whether the sigmas were.
    basis : ndarray, shape (m, k), optional
        Of m coefficients in which the covariance and the freedom are to be.
    lost : int

    Returns
    -------
    Uncertainty
    """
    inverse, m = solution.inverse, len(solution.p if basis is None else basis)
    inflation, variances, free = _noises(solution, base, row_weights, lost)
    if given:
        covariance, freedom = inverse, np.full(m, np.inf)
        if basis is not None:
            covariance = basis @ covariance @ basis.T
    else:
        # H^-1 (vx Gx + vy Gy) H^-1 with Gy = H - Gx
        by_x = inverse @ solution.x_normal @ inverse
        by_y = inverse - by_x
        by_x *= variances[0]
        by_y *= variances[1]
        if basis is not None:
            by_x, by_y = basis @ by_x @ basis.T, basis @ by_y @ basis.T
        covariance = by_x + by_y
        if len(free) == 1:
            freedom = np.full(m, free[0])
        else:
            by_axis = np.array((by_x.diagonal(), by_y.diagonal()))
            np.maximum(by_axis, 0.0, out=by_axis)
            freedom = satterthwaite(by_axis.T, free)
    covariance = covariance * inflation
    return Uncertainty(covariance, (variances[0] ** 0.5, variances[1] ** 0.5), freedom)


def _noises(solution, base, row_weights, lost):
    """Inflation by robust weights, variance of each axis, its degrees of freedom; one: of both."""
    inverse, rank = solution.inverse, solution.rank
    r = solution.residual if base is None else solution.residual * np.sqrt(base)
    n = len(r) // 2
    rx, ry = r[:n], r[n:]
    if row_weights is None:
        inflation, consistency, total = 1.0, 1.0, float(n - lost)
        squares = float(rx @ rx), float(ry @ ry)
    else:
        inflation, consistency = BISQUARE_INFLATION, BISQUARE_VARIANCE
        total = float(row_weights.sum())
        squares = [float(row_weights @ np.square(of)) for of in (rx, ry)]
    hat = inverse @ solution.x_normal
    used, squared = float(np.trace(hat)), float(np.vdot(hat.T, hat))  # traces of H and of H H
    pooled = (squares[0] + squares[1]) / max(2 * total - rank, 1e-9)
    free = total - used, total - rank + used
    if min(free) <= 0.5:  # an axis that tells nothing of its noise has that of both
        return inflation, [pooled / consistency] * 2, (max(2 * total - rank, 1.0),)
    variances = [square / dof / consistency for square, dof in zip(squares, free)]
    # the squares of an axis are a sum of chi-squares with factors from 0 to 1, those of I - H:
    # it scatters as one with that many degrees of freedom (Satterthwaite 1946)
    factors = total - 2.0 * used + squared, total - rank + squared
    return inflation, variances, [dof**2 / max(of, 1e-9) if of < dof else dof
                                  for dof, of in zip(free, factors)]


def need_rows(n, k, given):
    """ValueError where `n` rows do not determine `k` coefficients; `given`: with sigmas."""
    # with given sigmas the covariance needs no redundancy
    if 2 * n < k or (2 * n == k and not given) or n == 0:
        raise ValueError(
            f'{n} usable observations do not determine {k} coefficients; observe at least '
            f'{k // 2 + 1} stars or fit fewer terms')
