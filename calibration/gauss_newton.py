"""The iteration of a fit: linearised, weighed, solved, until it is the exact (robust) minimum.

The expensive parts are done once where they hardly change: the columns about a point so near that
their change is below `NEAR`, the normal matrix for many rounds of the weights, of which each costs
two products of the design with a vector. Many rows begin at the fit of a small part of them. What
is exact is what ends it: the residuals of the rotations themselves.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC

from .few_rows import are_few, kept_rows
from .least_squares import (
    Solution,
    Spectrum,
    need_rows,
    normal_matrices,
    spectrum_of,
    weighted_solve,
)
from .robust import BISQUARE, BISQUARE_VARIANCE, HUBER, sigma_of

TOLERANCE = 1e-9 * ARCSEC  # of the rounds of the weights, on the sky
#: between the exact residuals of the result and those of its linearisation
EXACT = 1e-7 * ARCSEC
#: way from the point of linearisation, rad, times the error that the noise leaves in a mean: so far
#: off are coefficients that the columns there give, but for some tens by the stars' places
NEAR = 1e-8 * ARCSEC
#: of the noise: a linearisation that is wrong by more gives no noise to weigh by
_WRONG = 1e-3
#: rows from which a fit begins at that of some of them: so many, or that part if it is more
_MANY, _FIRST, _PART = 6000, 1500, 64
#: of rcond, within the directions kept: their design changes with the weights, and what was chosen
#: once must not drop out for that
_INNER = 0.01
#: of the change in a round, that of the next: from it on the normal matrix is formed again
_SLOW = 0.2
#: of the noise: a change of residuals that changes no weight by more
_LITTLE = 1e-6
#: of the noise: a change of residuals that ends the search for it
_SETTLED = 0.01
#: as that, of a linearisation that will be left
_ROUGHLY = 0.1


class Solved(NamedTuple):
    """Result of `gauss_newton`."""

    p: np.ndarray
    solution: Solution  # in the coordinates of `basis`
    rows: np.ndarray  # or RunColumns
    basis: np.ndarray | None  # directions kept, (k, r); None if all are
    spectrum: Spectrum  # of the first-order design
    base: np.ndarray | None
    row_weights: np.ndarray | None  # 0 or 1 where the rows are few
    few: bool  # whether they are, so that rows are rejected by a test and not weighed
    feasible: np.ndarray
    iterations: int


class Linear:
    """What `gauss_newton` iterates where the columns are the same everywhere.

    Parameters
    ----------
    observed : ndarray, shape (2n,)
    rows : ndarray, shape (k, 2n), or RunColumns
    """

    linear, moved = True, False

    def __init__(self, observed, rows):
        self.observed, self.first_order = observed, rows

    def residual(self, p, columns):
        """Exact residual, shape (2n,), at coefficients p, and which rows have one (None: all).

        `columns` tells whether those will be asked for too.
        """
        return (self.observed - p @ self.first_order if p.any() else self.observed), None

    def columns(self):
        """Derivatives where `residual` was last asked for, shape (k, 2n)."""
        return self.first_order

    def part(self, step):
        """The same of every row in `step`."""
        return Linear(every(step, self.observed), every(step, self.first_order))


def every(step, v):
    """Every row in `step` of an array of x and y of all rows, shape (..., 2n), or a RunColumns."""
    if not isinstance(v, np.ndarray):
        return v.every(step)
    n = v.shape[-1] // 2
    return np.concatenate([v[..., :n][..., ::step], v[..., n:][..., ::step]], axis=-1)


class _Weigher:
    """Robust weights of rows by their residuals, at the noise `scales` of each axis.

    Parameters
    ----------
    base : ndarray, shape (2n,), or None
        Weights by the given sigmas; then the scales are in sigmas.
    n : int
    """

    def __init__(self, base, n):
        self.base, self.n = base, n
        self.root = None if base is None else np.sqrt(base)
        self.floor = TOLERANCE if base is None else 1e-9

    def squares(self, residual):
        """Of both axes, in sigmas where they were given; shape (n,) each."""
        squares = np.square(residual)
        if self.base is not None:
            squares *= self.base
        return squares[:self.n], squares[self.n:]

    def noise(self, residual, dof_factor):
        """Of each axis, from the medians."""
        standard = residual if self.root is None else residual * self.root
        both = sigma_of(standard.reshape(2, self.n), dof_factor, axis=1)
        return [max(one, self.floor) for one in both.tolist()]

    def huber(self, residual, scales):
        """Weights, shape (n,), and by what a step at a fixed normal matrix is too short."""
        u = self.distance(residual, scales)
        np.sqrt(u, out=u)
        np.maximum(u, HUBER, out=u)
        far = np.count_nonzero(u > HUBER)
        weights = np.divide(HUBER, u, out=u)
        total = float(np.add.reduce(weights))
        return weights, total / (0.5 * (total + len(u) - far))

    def bisquare(self, residual, scales):
        """As `huber`."""
        kept = self.distance(residual, scales)
        kept *= -1.0 / BISQUARE**2
        kept += 1.0
        np.maximum(kept, 0.0, out=kept)
        weights = np.square(kept)
        total = float(np.add.reduce(weights))
        slope = 3.0 * total - 2.0 * float(np.add.reduce(kept))
        return weights, min(total / slope, 1.9) if slope > 0.0 else 1.0

    def distance(self, residual, scales):
        """Square of the radial distance in standard deviations, shape (n,)."""
        x, y = self.squares(residual)
        x *= 1.0 / scales[0] ** 2
        y *= 1.0 / scales[1] ** 2
        x += y
        return x

    def least(self, scales):
        """The smaller noise of a residual, radians."""
        return min(scales) if self.root is None else min(scales) / float(self.root.max())

    def both(self, weights):
        """For x and y of all rows, with the given sigmas."""
        out = np.concatenate((weights, weights))
        if self.base is not None:
            out *= self.base
        return out


class _Rounds:
    """Robust least squares of one linearisation.

    Parameters
    ----------
    rows : ndarray, shape (k, 2n), or RunColumns
    b : ndarray, shape (2n,)
    base : ndarray, shape (2n,), or None
    rcond : float
    inverse : ndarray, shape (k, k), or None
        About that of the normal matrix: the rounds begin where b is, and not at plain least
        squares.
    solution : Solution, optional
        Of an earlier linearisation at the same noise: its normal matrix is that of the weights.
    normals : tuple of ndarray, optional
        Of the design without robust weights, where they are known: a rough beginning.
    plain : ndarray, shape (k,), optional
        Plain least squares, where it is known but for the second order.
    """

    def __init__(self, rows, b, base, rcond, inverse=None, solution=None, normals=None,
                 plain=None):
        self.rows, self.b, self.base, self.rcond = rows, b, base, rcond
        self.weigher = _Weigher(base, len(b) // 2)
        self.solution, self.p, self.residual = solution, np.zeros(len(rows)), b
        self.inverse = inverse if solution is None else solution.inverse
        self.unweighted = solution is None
        self.begun = self.inverse is not None
        if not self.begun and plain is not None:
            self.residual = b - plain @ rows
        elif not self.begun:
            self.solve(None, normals)
            self.plain = self.p
            self.begun = self.unweighted = normals is not None

    def solve(self, weights, normals=None):
        """Exactly, with these weights of the rows (None: 1); how far it moves a residual."""
        before = self.residual
        self.solution = weighted_solve(
            self.rows, self.b, self.base if weights is None else self.weigher.both(weights),
            self.rcond, normals)
        self.p, self.residual = self.solution.p, self.solution.residual
        self.inverse, self.unweighted = self.solution.inverse, False
        return self.residual - before

    def step(self, weights, longer):
        """One with the normal matrix that is there; how far it moves a residual at most."""
        n, base = len(weights), self.base
        weighted = np.empty_like(self.residual)
        np.multiply(weights, self.residual[:n], out=weighted[:n])
        np.multiply(weights, self.residual[n:], out=weighted[n:])
        if base is not None:
            weighted *= base
        force = self.rows @ weighted
        if self.unweighted:
            longer *= len(weights) / float(np.add.reduce(weights))
        step = longer * (self.inverse @ force)
        moved = (np.matmul(step, self.rows, out=weighted) if isinstance(self.rows, np.ndarray)
                 else step @ self.rows)
        self.p = self.p + step
        most = _largest(moved)
        self.residual = np.subtract(self.residual, moved, out=moved)
        return most

    def far(self, weights):
        """Whether steps with the normal matrix that is there could go too far."""
        return self.unweighted and np.add.reduce(weights) < 0.5 * len(weights)

    def find_noise(self, rank, rough=False):
        """Huber's weights, with the noise by the medians; then that of what the bisquare keeps.

        `rough`: only the weights.
        """
        weigher, n = self.weigher, len(self.b) // 2
        dof_factor = np.sqrt(2 * n / max(2 * n - rank, 1))
        exactly, last = not self.begun, np.inf
        for _ in range(30):
            scales = weigher.noise(self.residual, dof_factor)
            weights, longer = weigher.huber(self.residual, scales)
            if exactly or self.far(weights):
                moved = _largest(weigher.distance(self.solve(weights), scales)) ** 0.5
            else:
                moved = self.step(weights, longer) / weigher.least(scales)
                exactly, last = moved > 0.5 * last, moved
            if moved < (_ROUGHLY if rough else _SETTLED):
                break
        if rough:
            return None
        scales = weigher.noise(self.residual, dof_factor)
        # the median is wasteful: take the bisquare's own variance of what it keeps
        squares = weigher.squares(self.residual)
        for _ in range(3):
            w, _ = weigher.bisquare(self.residual, scales)
            total = max(float(np.add.reduce(w)), 1e-9) * BISQUARE_VARIANCE
            scales = [max(dof_factor * float(np.sqrt(w @ part / total)), scale / 1.5)
                      for part, scale in zip(squares, scales)]
        return scales

    def bisquare(self, scales):
        """Down to the minimum at this noise; the weights there, shape (n,)."""
        weigh, last, way = self.weigher.bisquare, np.inf, 0.0
        little = _LITTLE * self.weigher.least(scales) if self.solution is not None else 0.0
        weights, _ = weigh(self.residual, scales)
        if not self.begun or self.far(weights):
            self.solve(weights)
        for _ in range(100):
            moved = self.step(*weigh(self.residual, scales))
            way += moved
            if 0.1 * TOLERANCE * min(last / max(moved, 1e-300), 1e3) <= moved <= _SLOW * last:
                last = moved
                continue
            weights, _ = weigh(self.residual, scales)
            if moved <= _SLOW * last and way < little:  # the matrix is as good as that of before
                self.solution = self.solution._replace(p=self.p, residual=self.residual)
                break
            last, moved = np.inf, _largest(self.solve(weights))
            if moved < TOLERANCE:
                break
        return weights


def gauss_newton(start, sigmas, robust, rcond):
    """Iterate to the (robust) least-squares solution.

    What the stars determine is decided once, by the first-order design: in the second order
    aliases differ a little, and the iteration would run away along them.

    Parameters
    ----------
    start : Linear, or what has its methods
    sigmas : ndarray, shape (2n,), or None
    robust : bool
    rcond : float

    Returns
    -------
    Solved

    Raises
    ------
    ValueError
        Too few rows, or no convergence.
    """
    first_order = start.first_order
    k, n = len(first_order), first_order.shape[1] // 2
    need_rows(n, k, sigmas is not None)
    base = None if sigmas is None else 1.0 / np.square(sigmas)
    robust = robust and 4 * n >= 3 * k
    normals = normal_matrices(first_order, base)
    spectrum = spectrum_of(first_order, base, normals[1])
    rank = spectrum.rank(rcond)
    few = are_few(2 * n - rank, rank)
    basis = None if rank == k else spectrum.vectors[:, -rank:] / spectrum.scale[:, None]
    p, inverse = np.zeros(k), None
    if n >= _MANY and basis is None and (robust or not start.linear):
        p, inverse = _of_some(start, sigmas, robust, rcond), np.linalg.inv(normals[1])
    solution = scales = row_weights = rows = known = None
    plain, settled, near = None, False, False
    for iteration in range(1, 31):
        residual, feasible = start.residual(p, columns=not near)
        if feasible is not None and not feasible.any():
            raise ValueError(
                'the fit runs to a mount that can point nowhere; look for rows with degrees of '
                'error or fit fewer terms')
        same = solution is not None and _same(feasible, known)
        wrong = _largest(residual - solution.residual) if same else np.inf
        if wrong < EXACT and near and settled:
            solution = solution._replace(residual=residual)
            break
        if not (same and near):
            rows = start.columns() if basis is None else basis.T @ start.columns()
            if feasible is not None:
                rows = np.asarray(rows)
                rows[:, np.concatenate((~feasible, ~feasible))] = 0.0
        known, weights, settled = feasible, _present(base, feasible), True
        if robust and few:
            if iteration <= 3:  # then it is settled, or the iteration need not end
                keep = kept_rows(np.asarray(rows), residual, weights,
                                 TOLERANCE if base is None else 1.0)
                row_weights = None if keep is None else keep.astype(float)
                settled = iteration == 3
            if row_weights is not None:
                both = np.concatenate((row_weights, row_weights))
                weights = both if weights is None else weights * both
            solution = weighted_solve(rows, residual, weights, _INNER * rcond)
        elif robust:
            rough = iteration == 1 and inverse is None and not start.linear
            rounds = _Rounds(rows, residual, weights, _INNER * rcond, inverse,
                             solution if scales else None,
                             normals if rough and rows is first_order and not start.moved else None,
                             plain)
            if scales is None or wrong > _WRONG * rounds.weigher.least(scales):
                scales = rounds.find_noise(rank, rough)
            if rough:  # the linearisation can be seconds of arc off
                settled, plain = False, rounds.plain - rounds.p
                solution = rounds.solution._replace(p=rounds.p, residual=rounds.residual)
            else:
                row_weights = rounds.bisquare(scales)
                solution, inverse, plain = rounds.solution, None, None
        else:
            known_normals = rows is first_order and weights is base and not start.moved
            solution = weighted_solve(rows, residual, weights, _INNER * rcond,
                                      normals if known_normals else None)
        p = p + (solution.p if basis is None else basis @ solution.p)
        if start.linear:
            break
        mean = float(np.sqrt(np.mean(np.square(solution.residual)) / n))
        near = _largest(residual - solution.residual) * mean < NEAR
    else:
        raise ValueError(
            'the fit does not converge; look for rows with degrees of error or fit fewer terms')
    return Solved(p, solution, rows, basis, spectrum, weights, row_weights, few,
                  np.ones(n, bool) if known is None else known, iteration)


def _of_some(start, sigmas, robust, rcond):
    """Coefficients of a part of many rows: where to begin."""
    n = start.first_order.shape[1] // 2
    step = n // max(_FIRST, n // _PART)
    try:
        return gauss_newton(start.part(step), None if sigmas is None else every(step, sigmas),
                            robust, rcond).p
    except ValueError:
        return np.zeros(len(start.first_order))


def _largest(values):
    if len(values) < 20_000:  # one pass of numpy costs more than the values
        return float(np.maximum.reduce(np.abs(values)))
    return max(float(values.max()), -float(values.min()))


def _same(mask, other):
    return mask is other or (mask is not None and other is not None
                             and np.array_equal(mask, other))


def _present(base, feasible):
    """Weights of the rows that a mount can look at."""
    if feasible is None:
        return base
    both = np.concatenate((feasible, feasible)).astype(float)
    return both if base is None else base * both
