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

"""The direct solver: robust least squares of what is curved, by Gauss and Newton's iteration.

Each round takes the exact residuals and the columns where the coefficients are, weighs the rows
(Huber's weights to find the noise of each axis, the loss of the radial distance at that noise)
and solves. It ends where the exact residuals are those that the last solution told.

What the rows do not determine is held at zero (`undetermined_terms.Undetermined`), and what they
determine so badly that the noise takes it beyond the range in which anything is linear (`is_bent`):
there the iteration runs along a curved valley, and a standard error means nothing.
"""

import numpy as np

from msg_tools.units import ARCSEC

from .estimate import Estimate
from .few_rows import are_few, kept_rows
from .least_squares import TOLERANCE, System, spectrum_of, uncertainty_of, weights_together
from .undetermined_terms import INNER, WEAK, Undetermined, is_bent

#: between the exact residuals of the result and those of its linearisation
EXACT = 1e-7 * ARCSEC
#: rounds of a fit
_MOST = 30
#: of the noise: a linearisation that is wrong by more gives no noise to weigh by
_WRONG = 1e-3
#: chance that noise of the given sigmas makes an axis scatter more, or less (of 1000 runs with
#: right sigmas 5 are found wrong; of 8 rows 8); and part of the sigmas that is far less
_BY_CHANCE, _FAR_LESS = 0.002, 1.0 / 1.5


class LinearProblem:
    """What `gauss_newton` iterates where the columns are the same everywhere.

    Parameters
    ----------
    observed : ndarray, shape (2n,)
    design : ndarray, shape (k, 2n), or GroupColumns
    """

    linear = True

    def __init__(self, observed, design):
        self.observed, self.first_order = observed, design

    def residual(self, p):
        """Exact residual, shape (2n,), at coefficients p; NaN where the model has none."""
        return self.observed - p @ self.first_order if p.any() else self.observed

    def columns(self):
        """Derivatives where `residual` was last asked for, shape (k, 2n)."""
        return self.first_order


def gauss_newton(problem, sigmas, loss, rcond, mild=None, last=None, most_iterations=_MOST):
    """Iterate to the (robust) least-squares solution.

    What the stars determine is decided by the first-order design: in the second order aliases
    differ a little, and the iteration would run away along them.

    Parameters
    ----------
    problem : LinearProblem, or fit.RotationProblem
    sigmas : ndarray, shape (2n,), or None
    loss : robust.Loss, or None
        None: least squares.
    rcond : float
    mild : ndarray, shape (2n,), optional
        The sigmas to decide by what is determined; by default `sigmas`.
    last : sequence of int, optional
        Coefficients that are held only where no others can be. Without it none is held: of a
        series, whose coefficients mean nothing one by one, the smallest solution is taken.
    most_iterations : int
        Before it is given up.

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
        problem.columns()  # those of the first order again
        times = np.repeat(np.maximum(ratios, 1.0), len(sigmas) // 2)
        sigmas, mild, known = sigmas * times, None if mild is None else mild * times, ratios <= 1.0


def _need_rows(n, k, given):
    """ValueError where `n` rows do not determine `k` coefficients; `given`: with sigmas."""
    # with given sigmas the covariance needs no redundancy
    if 2 * n < k or (2 * n == k and not given) or n == 0:
        raise ValueError(
            f'{n} usable observations do not determine {k} coefficients; observe at least '
            f'{k // 2 + 1} stars or fit fewer terms')


def _ratios(found):
    """Scatter of each axis in sigmas, 1 where chance explains that it is another."""
    from scipy.special import chdtr, chdtrc  # slow to import
    if not 2.0 * found.weights.sum() - found.rank > 0.5:
        return np.ones(2)
    scatter, dof = np.array(found.scatter), np.array(found.scatter_freedom)
    square = dof * np.square(scatter)
    far = (chdtrc(dof, square) < _BY_CHANCE) | (
        (chdtr(dof, square) < _BY_CHANCE) & (scatter < _FAR_LESS))
    return np.where(far, scatter, 1.0)


def _determined(problem, sigmas, mild, known, loss, rcond, last, most_iterations):
    """`gauss_newton` with sigmas that are `known` of each axis, or but for a factor."""
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
    """`gauss_newton` of the best determined directions, `rank` of them."""
    k, n = len(spectrum.s), problem.first_order.shape[1] // 2
    if 4 * n < 3 * k:
        loss = None
    few = are_few(2 * n - rank, rank)
    left_open = Undetermined.of(spectrum, rank, last)
    # of the coefficients that are not held
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
            if iteration <= 3:  # then it is settled, or the iteration need not end
                keep = kept_rows(np.asarray(design), residual, present,
                                 TOLERANCE if weights is None else 1.0)
                row_weights = None if keep is None else keep.astype(float)
                settled = iteration == 3
            solution = system.solve(row_weights)
        elif loss:
            near = residual
            if scales is None or wrong > _WRONG * system.least(scales):
                scales, near = system.noise(rank)
            # the first linearisations will be left: their weights need not have settled
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
    if solution.rank < len(solution.p):  # the robust weights took the rows that determine it
        left_open = left_open.more(Undetermined.of(spectrum_of(
            design, system.all_weights(row_weights)), solution.rank, last and ()), basis)
    if row_weights is not None:
        row_weights = row_weights * feasible
    if few and row_weights is not None:  # rows count in full or are lost
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
