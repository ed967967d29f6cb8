"""The iteration of a fit, robust or not, in the directions that the stars determine."""

from typing import NamedTuple

import numpy as np

from .least_squares import (
    TOLERANCE,
    Solution,
    Spectrum,
    normal_matrices,
    robust_solve,
    spectrum_of,
    weighted_solve,
)

#: of rcond, within the directions kept: their design changes with the weights, and what was chosen
#: once must not drop out for that
_INNER = 0.01


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
    row_weights: np.ndarray | None
    feasible: np.ndarray
    iterations: int


def gauss_newton(start, first_order, base, robust, rcond, linear):
    """Iterate `start(p) -> (residual, rows, feasible)` to the (robust) least-squares solution.

    What the stars determine is decided once, by the first-order design: in the second order
    aliases differ a little, and the iteration would run away along them.
    """
    normals = normal_matrices(first_order, first_order if base is None else first_order * base)
    spectrum = spectrum_of(first_order, base, normals[1])
    rank = spectrum.rank(rcond)
    k = len(first_order)
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
        if robust:
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
                not robust or iteration > 2):
            break
    else:
        raise ValueError(
            'the fit does not converge; look for rows with degrees of error or fit fewer terms')
    return Solved(p, solution, rows, basis, spectrum, weights, row_weights, feasible, iteration)
