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

"""Weighted least squares of one or two axes, plain and robust: the algebra behind every fit.

A design has one row for each coefficient: x of all observations, then y. It is an ndarray or a
`group_columns.GroupColumns`.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import sigma_of

from .group_columns import GroupColumns, bordered, inverse_root
from .lapack import lapack
from .robust import LOSS, huber

# for the normal matrix scaled to a unit diagonal:
_GRAM_LIMIT = 1e-10  # smallest ratio of eigenvalues that is still accurate
_SAFE_CONDITION = 1e8  # largest condition number for inversion
_FINE_CONDITION = 1e5  # largest condition number with rounding below 1e-11 of the coefficients
#: part of a column that must remain beyond the group columns: less is rounding
_EXPLAINED = 1e-7

#: change of the residuals at which robust weights have converged; also the least noise
TOLERANCE = 1e-9 * ARCSEC
#: most iterations of each stage of weights
_MOST = 100
#: change of the residuals, over the noise, at which the noise estimate has converged
_NOISE_SETTLED = 1e-3


class Spectrum(NamedTuple):
    """Singular values of the weighted design with columns of unit length, ascending."""

    s: np.ndarray
    vectors: np.ndarray  # (k, k), right singular vectors in its columns, in that order
    scale: np.ndarray  # length of the columns

    def rank(self, rcond):
        """Number of singular values above `rcond` times the largest."""
        return len(self.s) - int(self.s.searchsorted(rcond * self.s[-1], 'right'))


class Solution(NamedTuple):
    """Solution of a weighted least-squares problem, in the units of the data."""

    p: np.ndarray  # (k,), the coefficients
    inverse: np.ndarray  # (k, k), (pseudo-)inverse of the normal matrix
    residual: np.ndarray  # (n,), x of all rows, then y
    rank: int


def inverse_of(matrix):
    """Inverse of one small matrix; LinAlgError where it is singular."""
    factors, order, bad = lapack().dgetrf(matrix)
    if bad:
        raise np.linalg.LinAlgError('singular matrix')
    return lapack().dgetri(factors, order)[0]


def normal_matrix(design, weights):
    """Normal matrix with weights of values (None: all equal), shape (k, k)."""
    if isinstance(design, GroupColumns):
        return design.normal(np.ones(design.shape[1]) if weights is None else weights)
    return (design if weights is None else design * weights) @ design.T


def spectrum_of(design, weights, rcond=0.0):
    """Singular values of a design: from its normal matrix if accurate enough, else by QR.

    Those below `rcond` times the largest need not be accurate.

    Parameters
    ----------
    design : ndarray, shape (k, n), or GroupColumns
    weights : ndarray, shape (n,), or None

    Returns
    -------
    Spectrum
    """
    normal = normal_matrix(design, weights)
    scale = np.sqrt(normal.diagonal())
    scale[scale <= 0.0] = 1.0
    values, vectors, bad = lapack().dsyevd(normal / (scale[:, None] * scale))
    if bad:
        raise np.linalg.LinAlgError('the normal matrix of a fit is not finite')
    if values[0] > _GRAM_LIMIT * values[-1] or rcond**2 >= _GRAM_LIMIT:
        return Spectrum(np.sqrt(np.maximum(values, 0.0)), vectors, scale)
    rows = np.asarray(design)
    rows = (rows if weights is None else rows * np.sqrt(weights)) / scale[:, None]
    _, s, v = np.linalg.svd(np.linalg.qr(rows.T, mode='r'))
    s = np.append(s, np.zeros(len(v) - len(s)))  # with fewer rows than columns
    return Spectrum(s[::-1], v[::-1].T, scale)


def weighted_solve(design, b, weights, rcond):
    """Weighted least squares of b = p @ design, without singular directions.

    By the inverse normal matrix where accurate, with a step of iterative refinement (which makes it
    as precise as QR) if needed; else by the SVD.

    Parameters
    ----------
    design : ndarray, shape (k, n), or GroupColumns
    b : ndarray, shape (n,)
    weights : ndarray, shape (n,), or None
    rcond : float
        Relative singular value below which a direction is dropped.

    Returns
    -------
    Solution
    """
    if isinstance(design, GroupColumns):
        return _solve_beside_groups(design, b, weights, rcond)
    if not len(design):
        return Solution(np.empty(0), np.empty((0, 0)), b, 0)
    normal = normal_matrix(design, weights)
    try:
        inverse = inverse_of(normal)
        # traces of the scaled matrix and its inverse: their product bounds the condition number
        condition = len(normal) * float(normal.diagonal() @ inverse.diagonal())
    except np.linalg.LinAlgError:
        condition = np.inf
    if 0.0 < condition < min(_SAFE_CONDITION, 1.0 / rcond**2):
        rank = len(normal)
        refinements = 1 if condition > _FINE_CONDITION else 0
    else:
        spectrum = spectrum_of(design, weights, rcond)
        rank = spectrum.rank(rcond)
        kept = slice(len(spectrum.s) - rank, None)  # empty if no row has weight
        half = spectrum.vectors[:, kept] / (spectrum.scale[:, None] * spectrum.s[kept])
        inverse = half @ half.T
        refinements = 3
    p = inverse @ (design @ (b if weights is None else weights * b))
    residual = b - p @ design
    for _ in range(refinements):
        p = p + inverse @ (design @ (residual if weights is None else weights * residual))
        residual = b - p @ design
    return Solution(p, inverse, residual, rank)


def _solve_beside_groups(design, b, weights, rcond):
    """`weighted_solve` with group columns: these are projected out, then fitted to the rest."""
    root = inverse_root(design.own_normal(weights))
    both = np.vstack((design.common, b))
    share = design.share(both, weights, root)
    left = both - design.spread(share)
    before, after = (np.sqrt((np.square(of) if weights is None else weights * np.square(of))[:-1]
                             .sum(axis=1)) for of in (both, left))
    inner = weighted_solve(left[:-1] * (after > _EXPLAINED * before)[:, None], left[-1], weights,
                           rcond)
    onto_common, onto_b = np.split(share.reshape(-1, len(both)), [-1], axis=1)
    onto = onto_common @ inner.inverse
    own, each = onto @ onto_common.T, np.arange(len(root))
    own.reshape(*root.shape[:2], *root.shape[:2])[each, :, each] += root @ root.transpose(0, 2, 1)
    return Solution(np.concatenate((inner.p, onto_b[:, 0] - onto_common @ inner.p)),
                    bordered(inner.inverse, -onto, own), inner.residual,
                    inner.rank + int(np.count_nonzero(root.any(axis=1))))


def reweighted(solve, weigh, fit, most, settled=None):
    """Iteratively reweighted least squares with any solver.

    For several stages (Huber's weights, then redescending ones) call it repeatedly, each time from
    the last fit; `weigh` may keep a noise estimate meanwhile.

    Parameters
    ----------
    solve : callable
        ``solve(weights) -> fit``, least squares with a weight for each row.
    weigh : callable
        ``weigh(fit) -> weights`` from the residuals of a fit; None: stop.
    fit
        Initial fit.
    most : int
        Most iterations.
    settled : callable, optional
        ``settled(fit, before)``: whether the last two fits agree, which stops the iteration too.

    Returns
    -------
    fit
        The last fit.
    weights : ndarray or None
        Weights of the last fit; None if that is the initial one.
    """
    weights = None
    for _ in range(most):
        new = weigh(fit)
        if new is None:
            break
        weights, before = new, fit
        fit = solve(weights)
        if settled is not None and settled(fit, before):
            break
    return fit, weights


class System:
    """Rows b = p @ design of one or two axes, solved with weights of values and of rows.

    Parameters
    ----------
    design : ndarray, shape (k, axes * n), or GroupColumns
    b : ndarray, shape (axes * n,)
    weights : ndarray, shape (axes * n,), or None
        Weights of values, 1 / sigma^2: residuals are then measured in sigmas.
    rcond : float
        See `weighted_solve`.
    axes : int
    prior : ndarray, shape (k,), optional
        Prior of coefficients about zero: 1 / variance, in the unit of the weights. The design must
        be an ndarray then.
    """

    def __init__(self, design, b, weights, rcond, axes=2, prior=None):
        self.design, self.b, self.weights, self.rcond, self.axes = design, b, weights, rcond, axes
        self._prior, self._least = prior, TOLERANCE if weights is None else 1e-9

    def all_weights(self, row_weights):
        """Weights of values, including those of rows, shape (n,); None: 1."""
        return weights_together(self.weights, row_weights, self.axes)

    def solve(self, row_weights=None):
        """`Solution` with optional weights of rows, shape (n,)."""
        weights = self.all_weights(row_weights)
        if self._prior is None:
            return weighted_solve(self.design, self.b, weights, self.rcond)
        n, k = len(self.b), len(self._prior)
        known = weighted_solve(np.column_stack((self.design, np.eye(k))),
                               np.append(self.b, np.zeros(k)),
                               np.append(np.ones(n) if weights is None else weights, self._prior),
                               self.rcond)
        return known._replace(residual=known.residual[:n])

    def normal(self, row_weights, axis):
        """Contribution of one axis to the normal matrix, shape (k, k)."""
        weights = np.zeros((self.axes, len(self.b) // self.axes))
        weights[axis] = 1.0 if row_weights is None else row_weights
        return normal_matrix(self.design, weights.ravel() if self.weights is None
                             else weights.ravel() * self.weights)

    def squares(self, residual):
        """Squared residuals, in sigmas if given, shape (axes, n)."""
        squares = np.square(residual)
        if self.weights is not None:
            squares *= self.weights
        return squares.reshape(self.axes, -1)

    def distance(self, residual, scales):
        """Radial distance of each row from the fit, in standard deviations, shape (n,)."""
        return np.sqrt(np.dot([1.0 / scale**2 for scale in scales], self.squares(residual)))

    def least(self, scales):
        """The smallest noise of a residual."""
        return min(scales) if self.weights is None else (
            min(scales) / float(self.weights.max()) ** 0.5)

    def median_noise(self, residual, rank):
        """Noise of each axis from the median absolute residual, shape (axes,)."""
        return np.maximum(sigma_of(np.sqrt(self.squares(residual)), self._spread(rank), axis=1),
                          self._least)

    def _spread(self, rank):
        return (len(self.b) / max(len(self.b) - rank, 1)) ** 0.5

    def solve_huber(self, rank, change=_NOISE_SETTLED):
        """Solution with Huber's weights, scaled by the median noise.

        Parameters
        ----------
        rank : int
            Rank of the fit.
        change : float
            Change of the residuals, over the noise, at convergence.

        Returns
        -------
        solution : Solution
        row_weights : ndarray, shape (n,)
        """
        def distance(residual, noise_of):
            return self.distance(residual, self.median_noise(noise_of, rank))

        def settled(fit, last):
            return distance(fit.residual - last.residual, fit.residual).max() < change
        return reweighted(self.solve, lambda fit: huber(distance(fit.residual, fit.residual)),
                          self.solve(), _MOST, settled)

    def noise(self, rank):
        """The noise of each axis: median noise of a Huber fit, refined with the weights of `LOSS`.

        Returns
        -------
        scales : list of float
            Noise of x and y, in units of the sigmas if given.
        residual : ndarray
            Residuals of the Huber fit.
        """
        residual = self.solve_huber(rank)[0].residual
        scales, squares = self.median_noise(residual, rank), self.squares(residual)
        # the median is inefficient: use the weighted variance of the rows that `LOSS` keeps
        for _ in range(3):
            kept = LOSS.weights(self.distance(residual, scales))
            variance = squares @ kept / (max(kept.sum(), 1e-9) * LOSS.variance)
            scales = np.maximum(self._spread(rank) * np.sqrt(variance), scales / 1.5)
        return scales.tolist(), residual

    def solve_robust(self, loss, scales, residual, tolerance=TOLERANCE):
        """Minimise a loss at the noise `scales`, starting from the residuals.

        Returns
        -------
        solution : Solution
        row_weights : ndarray, shape (n,)
        """
        return reweighted(
            self.solve, lambda fit: loss.weights(self.distance(fit.residual, scales)),
            Solution(None, None, residual, 0), _MOST,
            lambda fit, last: np.abs(fit.residual - last.residual).max() < tolerance)


def weights_together(weights, row_weights, axes=2):
    """Product of weights of values, shape (axes * n,), and of rows, shape (n,); None: 1."""
    if row_weights is None:
        return weights
    each = np.concatenate((row_weights,) * axes)
    return each if weights is None else weights * each


class Uncertainty(NamedTuple):
    """Result of `uncertainty_of`."""

    covariance: np.ndarray  # (k, k), of the coefficients
    scatter: tuple  # standard deviation of x and y, in the unit of the residual, or in sigmas
    freedom: np.ndarray  # (k,), degrees of freedom of each standard error
    scatter_freedom: tuple  # degrees of freedom of the scatter of x and y; one: of both


def uncertainty_of(system, solution, row_weights, loss, known, basis):
    """Covariance of the coefficients, scatter of each axis, and their degrees of freedom.

    The covariance is the inverse normal matrix if the sigmas are known; else a sandwich with the
    measured variance of each axis, so that the axes may have different noise. It includes the loss
    of efficiency of a robust loss.

    If the scatter is estimated, standard errors have degrees of freedom. Each axis has its own (its
    rows less what the coefficients use of them); a coefficient determined by both axes has a value
    in between, see `satterthwaite`.

    Parameters
    ----------
    system : System
        System of two axes; rows without weight are not counted.
    solution : Solution
        Its solution with `row_weights`.
    row_weights : ndarray, shape (n,), or None
    loss : robust.Loss, or None
    known : sequence of bool
        Whether the sigmas of x, and of y, are known.
    basis : ndarray, shape (m, k)
        Transformation to the m coefficients whose covariance is returned.

    Returns
    -------
    Uncertainty
    """
    inverse, x_normal = solution.inverse, system.normal(row_weights, 0)
    variances, free = _noises(system, solution, row_weights, loss, inverse @ x_normal)
    if all(known):
        covariance, freedom = basis @ inverse @ basis.T, np.full(len(basis), np.inf)
    else:
        # H^-1 (vx Gx + vy Gy) H^-1 with Gy = H - Gx
        by_x = inverse @ x_normal @ inverse
        by_axis = [(1.0 if exact else variance) * (basis @ of @ basis.T)
                   for exact, variance, of in zip(known, variances, (by_x, inverse - by_x))]
        covariance = by_axis[0] + by_axis[1]
        each = np.maximum([of.diagonal() for of in by_axis], 0.0)
        freedom = (np.full(len(basis), free[0]) if len(free) == 1
                   else satterthwaite(each.T, np.where(known, np.inf, free)))
    inflation = 1.0 if row_weights is None else loss.inflation
    return Uncertainty(covariance * inflation, tuple(np.sqrt(variances).tolist()), freedom,
                       tuple(free))


def _noises(system, solution, row_weights, loss, hat):
    """Variance of each axis, and its degrees of freedom (one value: of both axes pooled)."""
    rank, squares = solution.rank, system.squares(solution.residual)
    if row_weights is None:
        consistency, squares = 1.0, squares.sum(axis=1)
        n = len(system.b) // 2
        total = float(n if system.weights is None else np.count_nonzero(system.weights[:n]))
    else:
        consistency, squares, total = loss.variance, squares @ row_weights, float(row_weights.sum())
    used, squared = float(np.trace(hat)), float(np.vdot(hat.T, hat))  # traces of H and of H H
    pooled = squares.sum() / max(2 * total - rank, 1e-9)
    free = total - used, total - rank + used
    if min(free) <= 0.5:  # an axis without freedom gets the pooled variance
        return [pooled / consistency] * 2, (max(2 * total - rank, 1.0),)
    # the sum of squares of an axis is a sum of chi-squares with factors from 0 to 1 (eigenvalues of
    # I - H): approximately one with these degrees of freedom (Satterthwaite 1946)
    factors = total - 2.0 * used + squared, total - rank + squared
    return squares / free / consistency, [
        dof**2 / max(of, 1e-9) if of < dof else dof for dof, of in zip(free, factors)]


def satterthwaite(parts, freedom):
    """Effective degrees of freedom of a sum of independently estimated variances.

    Parameters
    ----------
    parts, freedom : ndarray, shape (..., m)
        The variances, and the degrees of freedom of each.

    Returns
    -------
    ndarray, shape (...)
        At least 1.
    """
    wide = np.sum(np.square(parts) / freedom, axis=-1)
    return np.maximum(np.square(parts.sum(axis=-1)) / np.maximum(wide, 1e-300), 1.0)
