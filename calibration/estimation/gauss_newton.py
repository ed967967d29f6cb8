"""The iteration of a fit: linearised, weighed, solved, until it is the exact (robust) minimum.

What the stars do not determine is held at zero (`undetermined`), and so is what they determine so
badly that the noise takes it beyond the range in which anything is linear: there the iteration runs
along a curved valley, and a standard error means nothing.

The expensive parts are done once where they hardly change: the columns about a point so near that
their change is below `NEAR`, the normal matrix for many rounds of the weights, of which each costs
two products of the design with a vector. Many rows begin at the fit of a small part of them. What
is exact is what ends it: the residuals of the rotations themselves, or a step from them so short
that nothing of its second order is in them.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC

from .degeneracy import SHARE, Undetermined
from .few_rows import are_few, kept_rows
from .in_cache import apart
from .least_squares import (
    Solution,
    Spectrum,
    need_rows,
    normal_matrices,
    spectrum_of,
    weighted_solve,
)
from .robust_rounds import Rounds
from .robust_weights import TOLERANCE, Room
from .rounds_of_many import RoundsOfMany, Sight, are_many

#: between the exact residuals of the result and those of its linearisation
EXACT = 1e-7 * ARCSEC
#: way from the point of linearisation, rad, times the error that the noise leaves in a mean: so far
#: off are coefficients that the columns there give, but for some tens by the stars' places
NEAR = 1e-8 * ARCSEC
#: of the noise: a linearisation that is wrong by more gives no noise to weigh by
_WRONG = 1e-3
#: rows from which a fit begins at that of some of them: so many, or that part if it is more
_MANY, _FIRST, _PART = 6000, 1500, 64
#: multiples of it, less their whole parts, are spread evenly and never in step with anything
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
#: of the smallest singular value that is kept, relative: a change of the columns that leaves what
#: the stars say of that direction as it is; and an iteration from which on that is not asked
_ALIKE, _LATE = 0.1, 25
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


class Solved(NamedTuple):
    """Result of `gauss_newton`."""

    p: np.ndarray
    solution: Solution  # in the coordinates of `basis`
    rows: np.ndarray  # or RunColumns
    basis: np.ndarray | None  # of the coefficients that are not held, (k, r); None if none is
    undetermined: Undetermined
    spectrum: Spectrum  # of the first-order design
    base: np.ndarray | None
    row_weights: np.ndarray | None  # 0 or 1 where the rows are few
    few: bool  # whether they are, so that rows are rejected by a test and not weighed
    feasible: np.ndarray
    iterations: int
    huber: np.ndarray | None  # coefficients where the noise was found; None of some directions
    scales: list | None  # the noise of x and y that the rows were weighed by


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

    def part(self, rows):
        """The same of some rows, an ndarray of int."""
        return Linear(part_of(self.observed, rows), part_of(self.first_order, rows))


def part_of(v, rows):
    """Some rows of an array of x and y of all rows, shape (..., 2n), or of a RunColumns."""
    if not isinstance(v, np.ndarray):
        return v.part(rows)
    n = v.shape[-1] // 2
    return np.concatenate([v[..., :n][..., rows], v[..., n:][..., rows]], axis=-1)


def gauss_newton(start, sigmas, robust, rcond, mild=None, last=None):
    """Iterate to the (robust) least-squares solution.

    What the stars determine is decided by the first-order design: in the second order aliases
    differ a little, and the iteration would run away along them.

    Parameters
    ----------
    start : Linear, or rotating.Rotating
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
    Solved

    Raises
    ------
    ValueError
        Too few rows, or no convergence.
    """
    first_order = start.first_order
    k, n = len(first_order), first_order.shape[1] // 2
    need_rows(n, k, sigmas is not None)
    base, by = (None if of is None else 1.0 / np.square(of)
                for of in (sigmas, sigmas if mild is None else mild))
    normals = normal_matrices(first_order, base)
    spectrum = spectrum_of(first_order, by, normals[1] if mild is None else
                           normal_matrices(first_order, by)[1])
    if not spectrum.s[-1] > 0.0:
        raise ValueError('the rows tell nothing of what is to be fitted: its columns are zero in '
                         'all of them; fit other terms')
    rank = spectrum.rank(rcond)
    while True:
        weak = rank > 1 and spectrum.s[len(spectrum.s) - rank] < _WEAK * spectrum.s[-1]
        try:
            solved = _iterate(start, sigmas, base, robust, rcond, normals, spectrum, rank, last)
            if not weak or start.linear or not _is_bent(start, solved, by, rank):
                return solved
        except ValueError:
            if not weak:
                raise
        rank -= 1


def _iterate(start, sigmas, base, robust, rcond, normals, spectrum, rank, last):
    """`gauss_newton` of the best determined directions, `rank` of them."""
    first_order = start.first_order
    k, n = len(first_order), first_order.shape[1] // 2
    robust = robust and 4 * n >= 3 * k
    firm = _ALIKE * spectrum.s[k - rank] / spectrum.s[-1]
    few = are_few(2 * n - rank, rank)
    left_out = Undetermined.of(spectrum, k if last is None else rank, last or ())
    basis = None
    if rank < k:
        basis = (spectrum.vectors[:, k - rank:] / spectrum.scale[:, None] if last is None
                 else np.eye(k)[:, left_out.fitted])
    p, begun = np.zeros(k), None
    if n >= _MANY and basis is None and (robust or not start.linear):
        begun = _of_some(start, sigmas, robust, rcond, last)
        p = p if begun is None else begun.p
    weighing = _Weighing(start, basis, rank, rcond, normals, begun) if robust and not few else None
    solution = row_weights = rows = known = moved = None
    settled, near = False, False
    for iteration in range(1, 31):
        sight = None
        if weighing is not None and not (near and settled):
            sight = weighing.sight(p, base)
        residual, feasible = (start.residual(p, not near) if sight is None
                              else start.residual(p, not near, sight))
        if feasible is not None and not feasible.any():
            raise ValueError(
                'the fit runs to a mount that can point nowhere; look for rows with degrees of '
                'error or fit fewer terms')
        same, before = solution is not None and _same(feasible, known), p
        wrong = (apart(residual, solution.residual)
                 if same and (settled or weighing is not None and weighing.scales) else np.inf)
        if wrong < EXACT and near and settled:
            solution = solution._replace(residual=residual)
            break
        if not (same and near):
            there = p
            rows = start.columns() if basis is None else basis.T @ start.columns()
            if feasible is not None:
                rows = np.array(rows)  # in another place they may be feasible
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
            solution, settled = weighing.solve(p, rows, residual, weights, wrong, iteration == 1,
                                               sight if feasible is None else None)
            row_weights, moved = weighing.row_weights, weighing.rounds.moved
        else:
            known_normals = rows is first_order and weights is base and not start.moved
            solution = weighted_solve(rows, residual, weights, _INNER * rcond,
                                      normals if known_normals else None)
        p = p + (solution.p if basis is None else basis @ solution.p)
        if start.linear:
            break
        mean = float(np.dot(solution.residual, solution.residual) / (2 * n * n)) ** 0.5
        moved = apart(residual, solution.residual) if moved is None else moved
        near, moved = moved * mean < NEAR, None
        way, since = (float(np.add.reduce(np.abs(p - then))) for then in (before, there))
        near = near and (since * start.steep <= firm or iteration >= _LATE)
        if settled and near and feasible is None and start.beyond(way, since) < EXACT:
            break
    else:
        raise ValueError(
            'the fit does not converge; look for rows with degrees of error or fit fewer terms')
    return Solved(p, solution, rows, basis, left_out, spectrum, weights, row_weights, few,
                  np.ones(n, bool) if known is None else known, iteration,
                  *(None, None) if weighing is None else (weighing.huber, weighing.scales))


def _is_bent(start, solved, by, rank):
    """Whether noise alone moves the coefficients to where the columns are others.

    One standard error to either side along the direction that is determined worst, from where
    nothing of it is in the coefficients: what has gone along it has other columns, and may have
    come to where these seem to tell more. What the columns follow of the bend is taken off.

    Parameters
    ----------
    start, by
        As of `gauss_newton`; weights of that spectrum.
    solved : Solved
        With this direction.
    rank : int
    """
    spectrum, weights = solved.spectrum, solved.row_weights
    way, noise = spectrum.vectors[:, -rank], 1.0
    if by is None:
        squares = np.square(solved.solution.residual)
        if weights is not None:
            squares *= np.concatenate((weights, weights))
        count = 2.0 * (len(solved.feasible) if weights is None else weights.sum())
        noise = float(squares.sum() / max(count - rank, 1.0)) ** 0.5
    step = noise / spectrum.s[-rank] * way / spectrum.scale
    open_anyway = np.isin(np.flatnonzero(np.abs(way) > SHARE), solved.undetermined.terms).all()
    if np.abs(step).max() > (_WIDE_OPEN if open_anyway else _WIDE):
        return True
    most = _BENT * max(noise, TOLERANCE)
    root = 1.0 if by is None else np.sqrt(by)
    if start.steep * float(np.abs(step).sum())**2 * float(np.linalg.norm(
            np.broadcast_to(root, solved.solution.residual.shape))) < most:
        return False
    p = solved.p - way @ (solved.p * spectrum.scale) * way / spectrum.scale
    start.residual(p, True)
    columns = np.asarray(start.columns()) * root
    at = [np.array(start.residual(p + side * step, False)[0]) for side in (0.0, 1.0, -1.0)]
    start.residual(solved.p, True)  # as it was: the result has these
    start.columns()
    bend = (0.5 * (at[1] + at[2]) - at[0]) * root
    bend -= weighted_solve(columns, bend, None, _INNER * spectrum.s[-rank]
                           / spectrum.s[-1]).p @ columns
    return not float(np.dot(bend, bend)) ** 0.5 < most


class _Weighing:
    """The noise and the weights of the rows, from one linearisation to the next.

    Parameters
    ----------
    start, rcond
        As of `gauss_newton`.
    basis : ndarray, or None
    rank : int
    normals : tuple of ndarray
        Of the first-order design.
    begun : Solved, or None
        Of some of the rows.

    Attributes
    ----------
    scales : list or None
        The noise of x and y, once it is found.
    huber : ndarray or None
        Coefficients where it was.
    row_weights : ndarray, shape (n,), or None
        Of the last solution that is settled.
    """

    def __init__(self, start, basis, rank, rcond, normals, begun):
        self.start, self.basis, self.rank, self.rcond = start, basis, rank, rcond
        self._normals, self._room = normals, Room()
        self.scales = self.huber = self.row_weights = self.rounds = None
        #: that the noise is to be found where that of some rows was; and what that is
        self._begun = begun is not None and begun.huber is not None
        self._roughly = None
        #: of the normal matrix, while no better is known; plain least squares
        self._inverse = self._plain = None
        self._before = None  # rounds with matrices at the weights
        if begun is not None:
            self.huber, self._roughly = begun.huber, begun.scales
            self._inverse = np.linalg.inv(normals[1])

    def sight(self, p, base):
        """What is to be seen of the exact residuals at `p` while they are made: a `Sight`, None."""
        scales = self.scales or (self._roughly if self._begun else None)
        if not scales or self.start.linear or self.basis is not None or not are_many(
                self.start.first_order):
            return None
        return Sight(self.start.first_order, base, scales, self._room,
                     self.huber - p if self._begun else None)

    def solve(self, p, rows, residual, base, wrong, first, sight):
        """The bisquare's solution of one linearisation, or a step towards it.

        Parameters
        ----------
        p : ndarray, shape (k,)
            Where it is.
        rows, residual, base
            As of `robust_rounds.Rounds`.
        wrong : float
            By how much the residuals differ from what was expected of them.
        first : bool
            Whether it is the first.
        sight : Sight or None
            Of `residual`.

        Returns
        -------
        solution : Solution
        settled : bool
            Whether it is the bisquare's, and no step towards it.
        """
        start = self.start
        rough = first and self._inverse is None and not start.linear
        rounds = self.rounds = (RoundsOfMany if are_many(rows) else Rounds)(
            rows, residual, base, _INNER * self.rcond, self._inverse, self._before,
            self._normals if rough and rows is start.first_order and not start.moved else None,
            self._plain, self._room)
        lost = self.scales is None or wrong > _WRONG * rounds.weigher.least(self.scales)
        if sight is not None and (self._begun or not lost):
            rounds.see(sight)
        if lost and self._begun:
            self.scales = rounds.noise_at(self.huber - p, self.rank)
        elif lost:
            self.scales = rounds.find_noise(self.rank, rough)
            self.huber = p + rounds.p if self.basis is None else None
        if rough:  # the linearisation can be seconds of arc off
            self._plain = rounds.plain - rounds.p
            return rounds.solution._replace(p=rounds.p, residual=rounds.residual), False
        if self._begun and not start.linear:
            self._begun = False
            return rounds.approach(self.scales), False
        self.row_weights = rounds.bisquare(self.scales)
        self._before, self._inverse, self._plain = rounds, None, None
        return rounds.solution, True


def _of_some(start, sigmas, robust, rcond, last):
    """The fit of a part of many rows, where to begin; None: there is none.

    One row of every so many, each time another of them, so that nothing which comes again and again
    in the run (a field that is shared, two instruments in turns) is in it more or less than in all.
    """
    n = start.first_order.shape[1] // 2
    step = n // max(_FIRST, n // _PART)
    at = np.arange(n // step)
    rows = step * at + (step * (_GOLDEN * at % 1.0)).astype(int)
    try:
        return gauss_newton(start.part(rows), None if sigmas is None else part_of(sigmas, rows),
                            robust, rcond, last=last)
    except ValueError:
        return None


def _same(mask, other):
    return mask is other or (mask is not None and other is not None
                             and np.array_equal(mask, other))


def _present(base, feasible):
    """Weights of the rows that a mount can look at."""
    if feasible is None:
        return base
    both = np.concatenate((feasible, feasible)).astype(float)
    return both if base is None else base * both
