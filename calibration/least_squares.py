"""Weighted and robust least squares of two axes: the algebra behind `fit`.

The design has a row a coefficient: x of all stars, then y of all stars. A weight per value may be
None: all equal.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC

from .few_rows import are_few, kept_rows, satterthwaite
from .robust import (
    BISQUARE_INFLATION,
    BISQUARE_VARIANCE,
    bisquare,
    huber,
    reweighted,
    sigma_of,
)

TOLERANCE = 1e-9 * ARCSEC  # of an iteration, on the sky
# of the normal matrix, scaled to a unit diagonal:
_GRAM_LIMIT = 1e-10  # smallest ratio of eigenvalues that are accurate
_SAFE_CONDITION = 1e8  # up to here it may be inverted
_FINE_CONDITION = 1e5  # and up to here rounding stays below 1e-11 of the coefficients
#: of rcond, within the directions kept: their design changes with the weights, and what was chosen
#: once must not drop out for that
_INNER = 0.01


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
    scale = np.sqrt(normal.diagonal())
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(normal / (scale[:, None] * scale))
    if values[0] > _GRAM_LIMIT * values[-1]:
        return Spectrum(np.sqrt(values), vectors, scale)
    design = (rows if weights is None else rows * np.sqrt(weights)) / scale[:, None]
    _, s, v = np.linalg.svd(np.linalg.qr(design.T, mode='r'))
    return Spectrum(s[::-1], v[::-1].T, scale)


def normal_matrices(rows, weighted):
    """The x part of the normal matrix, and all of it.

    Parameters
    ----------
    rows, weighted : ndarray, shape (k, 2n)
        The design, and the design times the weights.

    Returns
    -------
    x_normal, normal : ndarray, shape (k, k)
    """
    n = rows.shape[1] // 2
    x_normal = weighted[:, :n] @ rows[:, :n].T
    return x_normal, x_normal + weighted[:, n:] @ rows[:, n:].T


def weighted_solve(rows, b, weights, rcond, normals=None):
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
    normals : tuple of ndarray, optional
        What `normal_matrices` gives, where it is known.

    Returns
    -------
    Solution
    """
    weighted = rows if weights is None else rows * weights
    x_normal, normal = normal_matrices(rows, weighted) if normals is None else normals
    try:
        inverse = np.linalg.inv(normal)
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
        half = spectrum.vectors[:, -rank:] / (spectrum.scale[:, None] * spectrum.s[-rank:])
        inverse = half @ half.T
        refinements = 3
    p = inverse @ (weighted @ b)
    residual = b - p @ rows
    for _ in range(refinements):
        p = p + inverse @ (weighted @ residual)
        residual = b - p @ rows
    return Solution(p, inverse, normal, x_normal, residual, rank)


def _distance(standard, n, scales):
    return np.hypot(standard[:n] / scales[0], standard[n:] / scales[1])


def robust_solve(rows, b, base, rcond, scales=None, row_weights=None):
    """Iteratively reweighted least squares: Huber with the scale, then bisquare at that scale.

    A row (both axes of an observation) has one weight.

    Parameters
    ----------
    rows, b, rcond
        As for `weighted_solve`.
    base : ndarray, shape (2n,), or None
        Weights by the given sigmas.
    scales, row_weights : optional
        Of an earlier iteration: go on with the bisquare.

    Returns
    -------
    solution : Solution
    scales : list of float
        Robust noise of each axis.
    row_weights : ndarray, shape (n,)
        0: rejected.
    """
    n = len(b) // 2
    # to standard deviations, where the sigmas were given
    root, floor = (1.0, TOLERANCE) if base is None else (np.sqrt(base), 1e-9)

    def solve(w):
        both = np.concatenate((w, w))
        return weighted_solve(rows, b, both if base is None else both * base, rcond)

    def noise(solution):
        standard = solution.residual * root
        return [max(float(sigma_of(part, dof_factor)), floor)
                for part in (standard[:n], standard[n:])]

    def weigh_at_its_noise(solution):
        nonlocal scales
        scales = noise(solution)
        return huber(_distance(solution.residual * root, n, scales))

    def weigh(solution):
        return bisquare(_distance(solution.residual * root, n, scales))

    if scales is None:
        solution = weighted_solve(rows, b, base, rcond)
        dof_factor = np.sqrt(2 * n / max(2 * n - solution.rank, 1))
        solution, _ = reweighted(
            solve, weigh_at_its_noise, solution, 30, lambda new, old: _distance(
                (new.residual - old.residual) * root, n, scales).max() < 0.01)
        scales = noise(solution)
        # the median is wasteful: take the bisquare's own variance of what it keeps
        standard = np.square(solution.residual * root)
        for _ in range(3):
            w = weigh(solution)
            total = max(float(w.sum()), 1e-9) * BISQUARE_VARIANCE
            scales = [max(dof_factor * float(np.sqrt(w @ part / total)), scale / 1.5)
                      for part, scale in zip((standard[:n], standard[n:]), scales)]
    else:
        solution = solve(row_weights)
    solution, row_weights = reweighted(
        solve, weigh, solution, 100,
        lambda new, old: np.abs(new.residual - old.residual).max() < TOLERANCE)
    return solution, scales, row_weights


def covariance_of(solution, base, row_weights, given, lost=0):
    """Covariance of the coefficients, and the scatter of each axis.

    The inverse normal matrix if the sigmas were given; else sandwiched with the measured
    variance of each axis, so that axes of different noise keep their own. The bisquare's loss
    of efficiency is in it. `lost` rows have no weight in `base`.

    Returns
    -------
    covariance : ndarray, shape (k, k)
    scatter : tuple of float
        Standard deviation of x and y, in the unit of the residual (sigmas if they were given).
    """
    inverse = solution.inverse
    inflation, variances, _ = _noises(solution, base, row_weights, lost)
    scatter = variances[0] ** 0.5, variances[1] ** 0.5
    if given:
        return inflation * inverse, scatter
    # H^-1 (vx Gx + vy Gy) H^-1 with Gy = H - Gx
    covariance = inverse @ solution.x_normal @ inverse
    covariance *= inflation * (variances[0] - variances[1])
    covariance += (inflation * variances[1]) * inverse
    return covariance, scatter


def freedom_of(solution, base, row_weights, basis=None, lost=0):
    """Degrees of freedom of the standard error of each coefficient, if the scatter gives it.

    Each axis has its own (the rows less what the coefficients took of them), and a coefficient
    that both determine one between them: `few_rows.satterthwaite`. Parameters as of
    `covariance_of`.

    Returns
    -------
    ndarray, shape (k,)
    """
    _, variances, free = _noises(solution, base, row_weights, lost)
    if len(free) == 1:
        return np.full(len(solution.p if basis is None else basis), free[0])
    by_x = solution.inverse @ solution.x_normal @ solution.inverse
    parts = [by_x * variances[0], (solution.inverse - by_x) * variances[1]]
    if basis is not None:
        parts = [basis @ part @ basis.T for part in parts]
    return satterthwaite(np.stack([np.maximum(part.diagonal(), 0.0) for part in parts], axis=1),
                         np.array(free))


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
        squares = float(row_weights @ np.square(rx)), float(row_weights @ np.square(ry))
    used = float(np.vdot(inverse, solution.x_normal))  # trace of the product
    pooled = (squares[0] + squares[1]) / max(2 * total - rank, 1e-9)
    free = total - used, total - rank + used
    if min(free) <= 0.5:  # an axis that tells nothing of its noise has that of both
        return inflation, [pooled / consistency] * 2, (max(2 * total - rank, 1.0),)
    variances = [square / dof / consistency for square, dof in zip(squares, free)]
    return inflation, variances, free


def need_rows(n, k, given):
    """ValueError where `n` rows do not determine `k` coefficients; `given`: with sigmas."""
    # with given sigmas the covariance needs no redundancy
    if 2 * n < k or (2 * n == k and not given) or n == 0:
        raise ValueError(
            f'{n} usable observations do not determine {k} coefficients; observe at least '
            f'{k // 2 + 1} stars or fit fewer terms')


class Solved(NamedTuple):
    """Result of `gauss_newton`."""

    p: np.ndarray
    solution: Solution  # in the coordinates of `basis`
    rows: np.ndarray
    basis: np.ndarray | None  # directions kept, (k, r); None if all are
    spectrum: Spectrum  # of the first-order design
    base: np.ndarray | None
    row_weights: np.ndarray | None  # 0 or 1 where the rows are few
    few: bool  # whether they are, so that rows are rejected by a test and not weighed
    feasible: np.ndarray
    iterations: int


def gauss_newton(start, first_order, sigmas, robust, rcond, linear):
    """Iterate `start(p) -> (residual, rows, feasible)` to the (robust) least-squares solution.

    What the stars determine is decided once, by the first-order design: in the second order
    aliases differ a little, and the iteration would run away along them.
    """
    k, n = len(first_order), first_order.shape[1] // 2
    need_rows(n, k, sigmas is not None)
    base = None if sigmas is None else 1.0 / np.square(sigmas)
    robust = robust and 4 * n >= 3 * k
    normals = normal_matrices(first_order, first_order if base is None else first_order * base)
    spectrum = spectrum_of(first_order, base, normals[1])
    rank = spectrum.rank(rcond)
    few = are_few(2 * n - rank, rank)
    basis = None if rank == k else spectrum.vectors[:, -rank:] / spectrum.scale[:, None]
    p = np.zeros(k)
    scales = row_weights = None
    for iteration in range(1, 31):
        residual, rows, feasible = start(p)
        if basis is not None:
            rows = basis.T @ rows
        weights = base
        if not feasible.any():
            raise ValueError(
                'the fit runs to a mount that can point nowhere; look for rows with degrees of '
                'error or fit fewer terms')
        if not feasible.all():
            both = np.concatenate((feasible, feasible)).astype(float)
            weights = both if base is None else base * both
        if robust and few:
            if iteration <= 3:  # as below; then it is settled, or the iteration need not end
                keep = kept_rows(rows, residual, weights, TOLERANCE if base is None else 1.0)
                row_weights = None if keep is None else keep.astype(float)
            if row_weights is not None:
                both = np.concatenate((row_weights, row_weights))
                weights = both if weights is None else weights * both
            solution = weighted_solve(rows, residual, weights, _INNER * rcond)
        elif robust:
            if iteration <= 2:
                scales = None  # the linearisation at zero can be seconds of arc off
            solution, scales, row_weights = robust_solve(
                rows, residual, weights, _INNER * rcond, scales, row_weights)
        else:
            known = rows is first_order and weights is base
            solution = weighted_solve(
                rows, residual, weights, _INNER * rcond, normals if known else None)
        p = p + (solution.p if basis is None else basis @ solution.p)
        if linear:
            break
        if np.abs(solution.residual - residual).max() < TOLERANCE and (
                not robust or iteration > (3 if few else 2)):
            break
    else:
        raise ValueError(
            'the fit does not converge; look for rows with degrees of error or fit fewer terms')
    return Solved(p, solution, rows, basis, spectrum, weights, row_weights, few, feasible,
                  iteration)
