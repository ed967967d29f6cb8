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

"""The direct solver: robust nonlinear least squares by Gauss-Newton iteration.

Each iteration takes the exact residuals and the derivatives at the current coefficients, weights
the rows (Huber's weights to find the noise of each axis, then the loss of the radial distance at
that noise) and solves. It has converged when the exact residuals equal those predicted by the last
linear solution.

Undetermined coefficients are held at zero (`undetermined_terms.Undetermined`). So are those
determined so badly that noise moves them beyond the linear range (`is_bent`): there the iteration
runs along a curved valley, and a standard error means nothing.
"""

import numpy as np

from msg_tools.units import ARCSEC

from .estimate import Estimate
from .few_rows import are_few, kept_rows
from .least_squares import TOLERANCE, System, spectrum_of, uncertainty_of, weights_together
from .undetermined_terms import INNER, WEAK, Undetermined, is_bent

#: largest difference between exact residuals and those of the linearisation at convergence
EXACT = 1e-7 * ARCSEC
#: most iterations of a fit
_MOST = 30
#: error of the linearisation, over the noise, above which the noise is estimated again
_WRONG = 1e-3
#: p below which the scatter of an axis disagrees with the given sigmas (this rejects right sigmas
#: in 5 of 1000 runs; with 8 rows in 8); ratio of scatter to sigmas that counts as far too small
_BY_CHANCE, _FAR_LESS = 0.002, 1.0 / 1.5


class LinearProblem:
    """A linear problem for `gauss_newton`: constant columns.

    Parameters
    ----------
    observed : ndarray, shape (2n,)
    design : ndarray, shape (k, 2n), or GroupColumns
    """

    linear = True

    def __init__(self, observed, design):
        self.observed, self.first_order = observed, design

    def residual(self, p):
        """Exact residuals, shape (2n,), at coefficients p; NaN where the model is undefined."""
        return self.observed - p @ self.first_order if p.any() else self.observed

    def columns(self):
        """Derivatives at the coefficients of the last call of `residual`, shape (k, 2n)."""
        return self.first_order


def gauss_newton(problem, sigmas, loss, rcond, mild=None, last=None, most_iterations=_MOST):
    """Iterate to the (robust) least-squares solution.

    The first-order design decides which coefficients are determined: to second order aliases
    differ a little, and the iteration would diverge along them.

    Parameters
    ----------
    problem : LinearProblem, or fit.RotationProblem
    sigmas : ndarray, shape (2n,), or None
    loss : robust.Loss, or None
        None: least squares.
    rcond : float
    mild : ndarray, shape (2n,), optional
        Sigmas used to decide which coefficients are determined; by default `sigmas`.
    last : sequence of int, optional
        Coefficients that are held at zero only if no others can be. Without it none is held, and
        the minimum-norm solution is taken: for a series, whose single coefficients mean nothing.
    most_iterations : int
        Most iterations.

    Returns
    -------
    Estimate

    Raises
    ------
    ValueError
        Too few rows, or no convergence.
    """
    known, ratios = np.full(2, sigmas is not None), None
    while True:
        found = _determined(problem, sigmas, mild, known, loss, rcond, last, most_iterations)
        if sigmas is None:
            return found
        if ratios is None:
            ratios = _ratios(found)
        if (known == (ratios <= 1.0)).all():
            return found._replace(ratios=tuple(ratios.tolist()))
        problem.residual(np.zeros(len(found.coefficients)))
        problem.columns()  # restores the first-order design
        times = np.repeat(np.maximum(ratios, 1.0), len(sigmas) // 2)
        sigmas, mild, known = sigmas * times, None if mild is None else mild * times, ratios <= 1.0


def _need_rows(n, k, given):
    """Raise ValueError if `n` rows cannot determine `k` coefficients; `given`: with sigmas."""
    # with given sigmas the covariance needs no redundancy
    if 2 * n < k or (2 * n == k and not given) or n == 0:
        raise ValueError(
            f'{n} usable observations do not determine {k} coefficients; observe at least '
            f'{k // 2 + 1} stars or fit fewer terms')


def _ratios(found):
    """Scatter of each axis over the given sigmas; 1 if not significantly different."""
    from scipy.special import chdtr, chdtrc  # slow to import
    if not 2.0 * found.weights.sum() - found.rank > 0.5:
        return np.ones(2)
    scatter, dof = np.array(found.scatter), np.array(found.scatter_freedom)
    square = dof * np.square(scatter)
    far = (chdtrc(dof, square) < _BY_CHANCE) | (
        (chdtr(dof, square) < _BY_CHANCE) & (scatter < _FAR_LESS))
    return np.where(far, scatter, 1.0)


def _determined(problem, sigmas, mild, known, loss, rcond, last, most_iterations):
    """`gauss_newton` with sigmas that are `known` for each axis, or known but for a factor."""
    k, values = problem.first_order.shape
    _need_rows(values // 2, k, sigmas is not None)
    weights, by = (None if of is None else 1.0 / np.square(of)
                   for of in (sigmas, sigmas if mild is None else mild))
    spectrum = spectrum_of(problem.first_order, by)
    if not spectrum.s[-1] > 0.0:
        raise ValueError('the rows do not determine what is to be fitted: its columns are zero in '
                         'all of them; fit other terms')
    rank = spectrum.rank(rcond)
    while True:
        weak = rank > 1 and spectrum.s[k - rank] < WEAK * spectrum.s[-1]
        try:
            found = _iterate(problem, weights, loss, rcond, spectrum, rank, last, most_iterations,
                             known)
            if not weak or problem.linear or not is_bent(problem, found, spectrum, by, rank):
                return found
        except ValueError:
            if not weak:
                raise
        rank -= 1


def _iterate(problem, weights, loss, rcond, spectrum, rank, last, most, known):
    """`gauss_newton` limited to the `rank` best determined directions."""
    k, n = len(spectrum.s), problem.first_order.shape[1] // 2
    if 4 * n < 3 * k:
        loss = None
    few = are_few(2 * n - rank, rank)
    left_open = Undetermined.of(spectrum, rank, last)
    # basis of the coefficients that are not held at zero
    basis = (np.eye(k)[:, left_open.fitted] if last is not None or rank == k
             else spectrum.vectors[:, k - rank:] / spectrum.scale[:, None])
    p, scales, row_weights, feasible, expected = np.zeros(k), None, None, None, None
    settled = False
    for iteration in range(1, most + 1):
        residual = problem.residual(p)
        before, feasible = feasible, np.isfinite(residual).reshape(2, n).all(axis=0)
        if not feasible.any():
            raise ValueError(
                'the fit runs to a mount that can point nowhere; look for rows with degrees of '
                'error or fit fewer terms')
        design, present = problem.columns(), weights
        if rank < k:
            design = basis.T @ design
        if not feasible.all():
            both = np.tile(feasible, 2)
            residual, design = np.where(both, residual, 0.0), np.where(both, design, 0.0)
            present = weights_together(weights, feasible)
        same = expected is not None and np.array_equal(feasible, before)
        wrong = float(np.abs(residual - expected).max()) if same else np.inf
        if settled and wrong < EXACT:
            break
        system, settled = System(design, residual, present, INNER * rcond), True
        if loss and few:
            if iteration <= 3:  # later the rows stay fixed, so that the iteration ends
                keep = kept_rows(np.asarray(design), residual, present,
                                 TOLERANCE if weights is None else 1.0)
                row_weights = None if keep is None else keep.astype(float)
                settled = iteration == 3
            solution = system.solve(row_weights)
        elif loss:
            near = residual
            if scales is None or wrong > _WRONG * system.least(scales):
                scales, near = system.noise(rank)
            # weights of the first linearisations need not converge
            enough = 0.0 if problem.linear else min(1e-3 * wrong, 0.1 * system.least(scales))
            solution, row_weights = system.solve_robust(loss, scales, near,
                                                        max(TOLERANCE, enough))
        else:
            solution = system.solve()
        p = p + (basis @ solution.p if rank < k else solution.p)
        residual = expected = solution.residual
        if problem.linear:
            break
    else:
        raise ValueError(
            'the fit does not converge; look for rows with degrees of error or fit fewer terms')
    if solution.rank < len(solution.p):  # robust weights removed the rows that determine some
        left_open = left_open.more(Undetermined.of(spectrum_of(
            design, system.all_weights(row_weights)), solution.rank, last and ()), basis)
    if row_weights is not None:
        row_weights = row_weights * feasible
    if few and row_weights is not None:  # rows are kept in full or rejected
        system, noise = System(design, residual, system.all_weights(row_weights), rcond), None
    else:
        noise = row_weights
    of_result = uncertainty_of(
        system, solution._replace(residual=residual), noise, loss, known, basis)
    if not feasible.all():
        residual = np.where(np.tile(feasible, 2), residual, np.nan)
    return Estimate(p, of_result.covariance, of_result.freedom, of_result.scatter, residual,
                    feasible.astype(float) if row_weights is None else row_weights, solution.rank,
                    row_weights is not None, left_open, spectrum.s[::-1], design=design,
                    scatter_freedom=of_result.scatter_freedom)
