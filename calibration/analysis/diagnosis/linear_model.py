"""Linear algebra on stacked residuals: x of all rows, then y of all rows.

Both values of a row belong together: they are flipped together, weighted together and left out
together.
"""

from dataclasses import dataclass

import numpy as np

from calibration.estimation.robust import bisquare, hampel, huber, reweighted, sigma_of
from msg_tools.units import ARCSEC

from .correlated_noise import White, Whitened
from .noise_memory import estimate
from .subspaces import inverse_normal, orthonormal, orthonormal_each


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

    def basis(self, white):
        """`Basis` of the whitened columns.

        Parameters
        ----------
        white : callable
            As `State.white`; no row of one run has to do with those of another.
        """
        common = white(self.common)
        if self.own is None:
            return Basis(orthonormal(common))
        out = self.own_basis(white(self.own))
        left = out.off(out.off(common))
        length = np.sqrt(np.square(common).sum(axis=1))
        kept = np.sqrt(np.square(left).sum(axis=1)) > 1e-5 * length
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

    def solver(self, white):
        """`Solver` of least squares by these columns, whitened.

        Parameters
        ----------
        white : callable
        """
        return Solver(self, white)

    def left_of(self, b, white):
        """What a least-squares fit leaves of all rows, those without weight too, shape (2n,).

        Parameters
        ----------
        b : ndarray, shape (2n,)
        white : callable
        """
        if self.own is None:
            return b - self.solved(b, white) @ self.common
        return self.left_by(*self.solver(white)(b), b)

    def solved(self, b, white):
        """Coefficients of the common columns, where no run has its own, shape (k,)."""
        return self.settled(solve(self.common, b, white), b, white)

    def settled(self, p, b, white):
        """Coefficients with the zeros where the rows were, not where their memory would take them.

        Where the noise wanders through the whole run its mean is hardly known, and generalised
        least squares may put it far beside all rows (a run of 1.4 h that wanders by 140": 60").
        """
        if not self.zeros or not isinstance(white, Whitened):
            return p
        p, each = p.copy(), White(white.root)
        p[self.zeros] += solve(self.common[self.zeros], b - p @ self.common, each)
        return p

    def left_by(self, p, own, b):
        """What coefficients, of the common columns (k,) and of each run's own, leave of `b`."""
        out = b - p @ self.common
        for where, q in zip(self._blocks or (), own):
            out[where] -= q @ self.own[:, where]
        return out


class Solver:
    """Least squares by `Columns`, run by run: the normal matrix of all would be mostly zeros.

    Parameters
    ----------
    columns : Columns
    white : callable
        As `State.white`.

    Attributes
    ----------
    inverse : ndarray, shape (k, k)
        Covariance of the coefficients of the common columns, whatever the runs' own are.
    """

    def __init__(self, columns, white):
        self._columns, self._white = columns, white
        self._common, self._own = white(columns.common), None
        beyond = self._common
        self._basis = None
        if columns.own is not None:
            self._own = white(columns.own)
            self._basis = columns.own_basis(self._own)
            beyond = self._basis.off(self._common)
            length = np.sqrt(np.square(self._common).sum(axis=1))
            beyond[np.sqrt(np.square(beyond).sum(axis=1)) <= 1e-5 * length] = 0.0
        self._beyond, self.inverse = beyond, inverse_normal(beyond.copy())

    def inverse_under(self, noise):
        """Covariance of the same coefficients, if the noise is as `noise` (`Whitened`) has it."""
        factor = noise.spread((self.inverse @ self._beyond) * self._white.root)
        return factor @ factor.T

    def __call__(self, b):
        """Coefficients of the common columns, (k,), and of each run's own, (runs, j)."""
        values = self._white(b)
        columns = self._columns
        if self._own is None:
            p = columns.settled(self.inverse @ (self._beyond @ values), b, self._white)
            return p, np.empty((0, 0))
        p = self.inverse @ (self._beyond @ self._basis.off(values))
        # the zero of a run is where its rows were, not where their memory would take it
        each = White(self._white.root)
        own, values = each(columns.own), each(b - p @ columns.common)
        return p, np.array([inverse_normal(own[:, where]) @ (own[:, where] @ values[where])
                            for where in columns._blocks])


@dataclass
class State:
    """A robust weighted fit of some columns: what is left, and how it was weighted.

    Attributes
    ----------
    basis : Basis
        Of the whitened columns.
    white : callable
        Values of shape (..., 2n) -> whitened: times the weights, and without what a row has from
        those before it.
    residual : ndarray, shape (2n,)
        Whitened.
    raw : ndarray, shape (2n,)
        Radians.
    weights : ndarray, shape (n,)
        Robust, 0 to 1.
    scale : ndarray, shape (2,)
        Robust noise of x and y, radians (in sigmas, if these were given).
    wander : tuple of AxisWander
        Of x and y, that `white` takes out; empty: noise without memory.
    """

    basis: Basis
    white: object
    residual: np.ndarray
    raw: np.ndarray
    weights: np.ndarray
    scale: np.ndarray
    wander: tuple = ()

    @property
    def n(self):
        """Rows."""
        return len(self.weights)


def fit_state(rows, b, inverse_sigma=None, weights=None, final=False):
    """Robust least squares of `b` by `rows`.

    Huber, then Hampel's weights of the radial distance at the scale of the median absolute
    residual; the axes then get their own variance. Hampel's leave a row some weight up to 25
    standard deviations: a few rows that lie off together may be what is looked for.

    Parameters
    ----------
    rows : Columns
    b : ndarray, shape (2n,)
        Radians.
    inverse_sigma : ndarray, shape (2n,), optional
    weights : ndarray, shape (n,), optional
        Of a fit of nearly the same, to start from.
    final : bool
        Bisquare weights (zero from 7 standard deviations) in place of Hampel's, as
        `calibration.analysis.fit`: nothing more is looked for.

    Returns
    -------
    State
    """
    n = len(b) // 2
    given = np.ones(2 * n) if inverse_sigma is None else inverse_sigma
    least = ARCSEC if inverse_sigma is None else 1.0  # the unit of the noise that is not zero
    last = bisquare if final else hampel
    steps = [None] + [huber] * 6 + [last] * 5 if weights is None else [last] * 4
    scale, todo = np.ones(2), iter(steps)

    def solution(w):
        root = given * np.concatenate((np.sqrt(w) / scale[0], np.sqrt(w) / scale[1]))
        white = White(root)
        basis = rows.basis(white)
        values = white(b)
        residual = basis.off(values)
        raw = residual / np.where(root > 0.0, root, np.inf)
        if (w == 0.0).any():
            raw = _fill(rows, b, white, raw, w)
        return State(basis, white, residual, raw, w, scale)

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


def wandering(state, rows, b, sequence):
    """`estimate` for a fit whose noise was taken as white."""
    return estimate(sequence, state.white.root, state.scale, rows.common, b, rows.own)


def whitened(state, rows, b, sequence, wander):
    """The fit of the same rows with the same weights, if they wander.

    Parameters
    ----------
    state : State
        Without memory.
    rows : Columns
    b : ndarray, shape (2n,)
    sequence : Sequence
    wander : tuple of AxisWander
        Of x and y.

    Returns
    -------
    State
    """
    n = state.n
    noise = np.array([one.scale / s if one.variance > 0.0 else 1.0
                      for one, s in zip(wander, state.scale)])
    white = Whitened(state.white.root / np.repeat(noise, n), sequence, wander)
    basis, values = rows.basis(white), white(b)
    return State(basis, white, basis.off(values),
                 rows.left_of(b, white), state.weights, state.scale, wander)


def _fill(rows, b, white, raw, w):
    """Residuals of the rows without weight, from coefficients of the others."""
    out = np.concatenate((w == 0.0, w == 0.0))
    raw = raw.copy()
    raw[out] = rows.left_of(b, white)[out]
    return raw


def solve(rows, b, white):
    """Least squares of b = p @ rows, both whitened (smallest norm where it is not determined).

    Parameters
    ----------
    rows : ndarray, shape (k, 2n)
    b : ndarray, shape (2n,)
    white : callable
        As `State.white`.
    """
    a = white(rows)
    return inverse_normal(a.copy()) @ (a @ white(b))
