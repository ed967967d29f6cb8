"""The direct solver: robust least squares of what is curved, by Gauss and Newton's iteration.

Each round takes the exact residuals and the columns where the coefficients are, weighs the rows
(Huber's weights to find the noise of each axis, the bisquare of the radial distance at that noise)
and solves. It ends where the exact residuals are those that the last solution told.

What the rows do not determine is held at zero (`degeneracy`), and so is what they determine so
badly that the noise takes it beyond the range in which anything is linear: there the iteration runs
along a curved valley, and a standard error means nothing.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC

from .degeneracy import SHARE, Undetermined
from .few_rows import are_few, kept_rows
from .least_squares import (
    Solution,
    Spectrum,
    need_rows,
    normal_matrices,
    spectrum_of,
    uncertainty_of,
    weighted_solve,
)
from .robust import (
    BISQUARE_VARIANCE,
    bisquare,
    huber,
    reweighted,
    sigma_of,
)

#: between the exact residuals of the result and those of its linearisation
EXACT = 1e-7 * ARCSEC
#: of residuals from one solution to the next, where the weights have settled
TOLERANCE = 1e-9 * ARCSEC
#: rounds of a fit; solutions for the weights of each
_MOST, _MOST_WEIGHTS = 30, 100
#: of the noise: a linearisation that is wrong by more gives no noise to weigh by; a change of
#: residuals that ends the search for it
_WRONG, _NOISE_SETTLED = 1e-3, 1e-3
#: of the noise of all residuals, what one standard error along the worst direction bends them by,
#: in ways that no coefficient follows (Bates and Watts 1980, J. R. Stat. Soc. B 42, 1: half the
#: intrinsic curvature); and of the largest singular value, that of a direction which may be so
_BENT, _WEAK = 0.3, 0.01
#: rad: a standard error of a coefficient along it from where bends that the others follow matter
#: too: 2 of 1000 runs within 0.001 degrees of a circle had terms 5 to 7 sigmas off; and where it is
#: of none but coefficients that another direction leaves open anyway
_WIDE, _WIDE_OPEN = 0.0175, 0.0044
#: of rcond, within the directions kept: their design changes with the weights, and what was chosen
#: once must not drop out for that
_INNER = 0.01


class Estimate(NamedTuple):
    """Result of `gauss_newton`: k coefficients of n rows."""

    coefficients: np.ndarray
    covariance: np.ndarray  # (k, k)
    freedom: np.ndarray  # (k,), degrees of freedom of each standard error
    scatter: tuple  # standard deviation of x and y, in the unit of the residual, or in sigmas
    residual: np.ndarray  # (2n,), x of all rows, then y
    row_weights: np.ndarray | None  # (n,), of the robust fit; 0 or 1 where rows are few
    feasible: np.ndarray  # (n,), whether a row has a residual
    undetermined: Undetermined
    spectrum: Spectrum  # of the first-order design
    basis: np.ndarray | None  # of the coefficients that are not held, (k, r); None if none is
    rows: np.ndarray  # (r, 2n), or RunColumns: the design in these
    solution: Solution  # in these
    weights: np.ndarray | None  # (2n,), by the given sigmas
    iterations: int

    @property
    def all_weights(self):
        """By the sigmas and the robust fit, shape (2n,); None where all are 1."""
        return _together(self.weights, self.row_weights)

    def response(self, columns):
        """Coefficients that a fit with these weights would give of `columns`, (2n, m) -> (k, m)."""
        rows, weights = np.asarray(self.rows), self.all_weights
        taken = self.solution.inverse @ ((rows if weights is None else rows * weights) @ columns)
        return taken if self.basis is None else self.basis @ taken


class Linear:
    """What `gauss_newton` iterates where the columns are the same everywhere.

    Parameters
    ----------
    observed : ndarray, shape (2n,)
    rows : ndarray, shape (k, 2n), or RunColumns
    """

    linear = True

    def __init__(self, observed, rows):
        self.observed, self.first_order = observed, rows

    def residual(self, p):
        """Exact residual, shape (2n,), at coefficients p, and which rows have one (None: all)."""
        return (self.observed - p @ self.first_order if p.any() else self.observed), None

    def columns(self):
        """Derivatives where `residual` was last asked for, shape (k, 2n)."""
        return self.first_order


def gauss_newton(problem, sigmas, robust, rcond, mild=None, last=None):
    """Iterate to the (robust) least-squares solution.

    What the stars determine is decided by the first-order design: in the second order aliases
    differ a little, and the iteration would run away along them.

    Parameters
    ----------
    problem : Linear, or rotation_offsets.Rotating
    sigmas : ndarray, shape (2n,), or None
    robust : bool
    rcond : float
    mild : ndarray, shape (2n,), optional
        The sigmas to decide by what is determined; by default `sigmas`.
    last : sequence of int, optional
        Coefficients that are held only where no others can be. Without it none is held: of a
        series, whose coefficients mean nothing one by one, the smallest solution is taken.

    Returns
    -------
    Estimate

    Raises
    ------
    ValueError
        Too few rows, or no convergence.
    """
    first_order = problem.first_order
    k, n = len(first_order), first_order.shape[1] // 2
    need_rows(n, k, sigmas is not None)
    weights, by = (None if of is None else 1.0 / np.square(of)
                   for of in (sigmas, sigmas if mild is None else mild))
    spectrum = spectrum_of(first_order, by, normal_matrices(first_order, by)[1])
    if not spectrum.s[-1] > 0.0:
        raise ValueError('the rows tell nothing of what is to be fitted: its columns are zero in '
                         'all of them; fit other terms')
    rank = spectrum.rank(rcond)
    while True:
        weak = rank > 1 and spectrum.s[len(spectrum.s) - rank] < _WEAK * spectrum.s[-1]
        try:
            found = _iterate(problem, weights, robust, rcond, spectrum, rank, last)
            if not weak or problem.linear or not _is_bent(problem, found, by, rank):
                return found
        except ValueError:
            if not weak:
                raise
        rank -= 1


def _iterate(problem, weights, robust, rcond, spectrum, rank, last):
    """`gauss_newton` of the best determined directions, `rank` of them."""
    k, n = len(problem.first_order), problem.first_order.shape[1] // 2
    robust, few = robust and 4 * n >= 3 * k, are_few(2 * n - rank, rank)
    left_out = Undetermined.of(spectrum, k if last is None else rank, last or ())
    basis = None
    if rank < k:
        basis = (spectrum.vectors[:, k - rank:] / spectrum.scale[:, None] if last is None
                 else np.eye(k)[:, left_out.fitted])
    p, scales, row_weights, known, expected = np.zeros(k), None, None, None, None
    inner, settled = _INNER * rcond, False
    for iteration in range(1, _MOST + 1):
        residual, feasible = problem.residual(p)
        if feasible is not None and not feasible.any():
            raise ValueError(
                'the fit runs to a mount that can point nowhere; look for rows with degrees of '
                'error or fit fewer terms')
        same = expected is not None and np.array_equal(feasible, known)
        wrong = float(np.abs(residual - expected).max()) if same else np.inf
        if settled and wrong < EXACT:
            break
        known = feasible
        rows = problem.columns() if basis is None else basis.T @ problem.columns()
        if feasible is not None:
            rows = np.where(np.concatenate((feasible, feasible)), rows, 0.0)
        present = weights if feasible is None else _together(weights, feasible)
        settled = True
        if robust and few:
            if iteration <= 3:  # then it is settled, or the iteration need not end
                keep = kept_rows(np.asarray(rows), residual, present,
                                 TOLERANCE if weights is None else 1.0)
                row_weights = None if keep is None else keep.astype(float)
                settled = iteration == 3
            solution = weighted_solve(rows, residual, _together(present, row_weights), inner)
        elif robust:
            near = residual
            if scales is None or wrong > _WRONG * _least(scales, weights):
                scales, near = noise_of(rows, residual, present, rank, inner)
            # the first linearisations will be left: their weights need not have settled
            enough = 0.0 if problem.linear else min(1e-3 * wrong, 0.1 * _least(scales, weights))
            solution, row_weights = settle(rows, residual, present, scales, inner, near,
                                           max(TOLERANCE, enough))
        else:
            solution = weighted_solve(rows, residual, present, inner)
        p = p + (solution.p if basis is None else basis @ solution.p)
        residual = expected = solution.residual
        if problem.linear:
            break
    else:
        raise ValueError(
            'the fit does not converge; look for rows with degrees of error or fit fewer terms')
    feasible = np.ones(n, bool) if known is None else known
    if row_weights is not None and known is not None:
        row_weights = row_weights * known
    solution = solution._replace(residual=residual)
    of_rows, noise = present, row_weights
    if few:  # rows count in full or are lost
        of_rows, noise = _together(present, row_weights), None
    lost = int(np.count_nonzero((feasible if noise is row_weights or row_weights is None
                                 else row_weights) == 0.0))
    covariance, scatter, freedom = uncertainty_of(
        solution, of_rows, noise, weights is not None, basis, lost)
    return Estimate(p, covariance, freedom, scatter, residual, row_weights, feasible, left_out,
                    spectrum, basis, rows, solution, present, iteration)


def _together(weights, row_weights):
    """Weights of values, shape (2n,), and of rows, shape (n,); None: 1."""
    if row_weights is None:
        return weights
    both = np.concatenate((row_weights, row_weights))
    return both if weights is None else weights * both


def _squares(residual, weights):
    """Of x and y, in sigmas where they were given, shape (2, n)."""
    squares = np.square(residual)
    if weights is not None:
        squares *= weights
    return squares.reshape(2, -1)


def _distance(residual, weights, scales):
    """Radial, in standard deviations, shape (n,)."""
    return np.sqrt(np.dot([1.0 / scale**2 for scale in scales], _squares(residual, weights)))


def _least(scales, weights):
    """The smaller noise of a residual."""
    return min(scales) if weights is None else min(scales) / float(weights.max()) ** 0.5


def noise_of(rows, b, weights, rank, rcond):
    """The noise of x and y: Huber's weights with medians, then what the bisquare keeps.

    Parameters
    ----------
    rows : ndarray, shape (k, 2n), or RunColumns
    b : ndarray, shape (2n,)
    weights : ndarray, shape (2n,), or None
    rank : int
    rcond : float

    Returns
    -------
    scales : list of float
        Of x and y; of given sigmas.
    residual : ndarray, shape (2n,)
        With Huber's weights.
    """
    factor = (len(b) / max(len(b) - rank, 1)) ** 0.5
    floor = TOLERANCE if weights is None else 1e-9

    def noise(residual):
        return np.maximum(sigma_of(np.sqrt(_squares(residual, weights)), factor, axis=1), floor)

    def solve(row_weights):
        return weighted_solve(rows, b, _together(weights, row_weights), rcond).residual

    def settled(residual, before):
        return _distance(residual - before, weights, noise(residual)).max() < _NOISE_SETTLED

    residual, _ = reweighted(
        solve, lambda residual: huber(_distance(residual, weights, noise(residual))),
        weighted_solve(rows, b, weights, rcond).residual, _MOST, settled)
    scales, squares = noise(residual), _squares(residual, weights)
    # the median is wasteful: take the bisquare's own variance of what it keeps
    for _ in range(3):
        kept = bisquare(_distance(residual, weights, scales))
        variance = squares @ kept / (max(kept.sum(), 1e-9) * BISQUARE_VARIANCE)
        scales = np.maximum(factor * np.sqrt(variance), scales / 1.5)
    return scales.tolist(), residual


def settle(rows, b, weights, scales, rcond, residual, tolerance):
    """Weights by the bisquare at that noise, until the solution does not move any more.

    Parameters
    ----------
    rows, b, weights, rcond
        As of `noise_of`.
    scales : sequence of float
    residual : ndarray, shape (2n,)
        To begin with.
    tolerance : float
        Of residuals.

    Returns
    -------
    solution : Solution
    row_weights : ndarray, shape (n,)
    """
    return reweighted(
        lambda row_weights: weighted_solve(rows, b, _together(weights, row_weights), rcond),
        lambda fit: bisquare(_distance(fit.residual, weights, scales)),
        Solution(None, None, None, None, residual, 0), _MOST_WEIGHTS,
        lambda fit, before: np.abs(fit.residual - before.residual).max() < tolerance)


def _is_bent(problem, found, by, rank):
    """Whether noise alone moves the coefficients to where the columns are others.

    One standard error to either side along the direction that is determined worst, from where
    nothing of it is in the coefficients: what has gone along it has other columns, and may have
    come to where these seem to tell more. What the columns follow of the bend is taken off.

    Parameters
    ----------
    problem, by
        As of `gauss_newton`; weights of that spectrum.
    found : Estimate
        With this direction.
    rank : int
    """
    spectrum, weights = found.spectrum, found.row_weights
    way, noise = spectrum.vectors[:, -rank], 1.0
    if by is None:
        squares = _squares(found.residual, _together(None, weights))
        count = 2.0 * (len(found.feasible) if weights is None else weights.sum())
        noise = float(squares.sum() / max(count - rank, 1.0)) ** 0.5
    step = noise / spectrum.s[-rank] * way / spectrum.scale
    open_anyway = np.isin(np.flatnonzero(np.abs(way) > SHARE), found.undetermined.terms).all()
    if np.abs(step).max() > (_WIDE_OPEN if open_anyway else _WIDE):
        return True
    root = 1.0 if by is None else np.sqrt(by)
    p = found.coefficients - way @ (found.coefficients * spectrum.scale) * way / spectrum.scale
    problem.residual(p)
    columns = np.array(problem.columns()) * root
    at = [np.array(problem.residual(p + side * step)[0]) for side in (0.0, 1.0, -1.0)]
    bend = (0.5 * (at[1] + at[2]) - at[0]) * root
    bend -= weighted_solve(columns, bend, None, _INNER * spectrum.s[-rank]
                           / spectrum.s[-1]).p @ columns
    return not float(np.dot(bend, bend)) ** 0.5 < _BENT * max(noise, TOLERANCE)
