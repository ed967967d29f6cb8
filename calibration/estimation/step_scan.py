"""Did something move, and when: robust regression, a scan over candidates, Gaussian evidence."""

from typing import NamedTuple

import numpy as np

from .estimate import Estimate
from .group_columns import GroupColumns, Moves
from .least_squares import System
from .robust import sigma_of

#: robust sigmas to which outliers are brought. Tried on nights of 40 rows with two spikes of 20
#: sigma: no step by chance up to 4, 0.7 % at 6, 1.3 % unclipped; clean nights and the power to see
#: a step of 1.7 sigma (67 %) are the same from 2 on
_CLIP = 3.0
_STILL = 1e-6  # of the noise, change of the residuals that ends it
_RCOND = 1e-7  # relative singular value of columns that depend on others but for rounding


class Scan(NamedTuple):
    """Of each candidate (m,): amount in the fit, 1 sigma, and two-sided probability by chance.

    A candidate that the rows do not determine has the probability 1.
    """

    amount: np.ndarray
    sigma: np.ndarray
    probability: np.ndarray


class Free(NamedTuple):
    """What a design leaves of anything.

    Attributes
    ----------
    groups : GroupColumns or None
        Columns that are taken off first.
    basis : ndarray, shape (n, r)
        Orthonormal, of the others; those that depend on others left out.
    """

    groups: GroupColumns | None
    basis: np.ndarray

    @classmethod
    def of(cls, design):
        """Of an ndarray, shape (n, k), or a GroupColumns."""
        groups = design if isinstance(design, GroupColumns) else None
        columns = design if groups is None else design.rest
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        if groups is not None:
            columns = groups.off(columns)
        u, s, _ = np.linalg.svd(columns, full_matrices=False)
        largest = max(0.0 if groups is None else 1.0, *s[:1], 0.0)
        return cls(groups, u[:, s > _RCOND * largest])

    @property
    def rank(self):
        """Numbers that the design determines."""
        return self.basis.shape[1] + (0 if self.groups is None else self.groups.groups)

    def off(self, values):
        """What is left of `values`, shape (n,) or (n, k)."""
        values = values if self.groups is None else self.groups.off(values)
        return values - self.basis @ (self.basis.T @ values)

    def off_moves(self, moves, rest):
        """Square of what is left of each column of `Moves`, and its product with `rest`, (m,).

        `rest`, shape (n,), is what is left of something.
        """
        sizes, products = [], []
        for rows, columns in moves.blocks:
            own = self.groups.own[rows]
            columns = columns - np.outer(own, own @ columns / (own @ own))
            along = self.basis[rows].T @ columns
            sizes.append(np.sum(columns**2, axis=0) - np.sum(along**2, axis=0))
            products.append(rest[rows] @ columns)
        return np.concatenate(sizes), np.concatenate(products)


def robust_fit(design, y):
    """Least squares with Huber's weights.

    Parameters
    ----------
    design : ndarray, shape (n, k), or GroupColumns
        Of the latter coefficients and covariance are those of its other columns.
    y : ndarray, shape (n,)

    Returns
    -------
    Estimate
        The shortest solution where columns depend on each other.

    Raises
    ------
    ValueError
        No more rows than columns.
    """
    groups = isinstance(design, GroupColumns)
    k = (design.rest if groups else design).shape[1]
    system = System(design if groups else design.T, y, None, _RCOND, axes=1)
    plain = system.solve()
    rank, dof = plain.rank, len(y) - plain.rank
    if dof <= 0:
        raise ValueError(f'{len(y)} rows do not determine {len(system.design)} numbers; '
                         'observe more')
    solution, weights = system.solve_huber(rank, _STILL)
    # Huber (1981), eq. 7.6.6: the mean square of the clipped residuals over the part not clipped
    variance = np.sum((weights * solution.residual) ** 2) / dof / np.mean(weights == 1.0) ** 2
    return Estimate(solution.p[:k], variance * plain.inverse[:k, :k], np.full(k, dof),
                    (float(system.median_noise(solution.residual, rank)[0]),),
                    solution.residual, weights, rank, True)


def clipped(design, y):
    """`y` with outliers of the robust fit brought to three sigmas, so that none alone is a step."""
    fit = robust_fit(design, y)
    limit = _CLIP * max(float(sigma_of(fit.residual)), 1e-300)
    return y - fit.residual + np.clip(fit.residual, -limit, limit)


def scan(design, y, candidates, least=0.0):
    """Add each candidate column alone to the design.

    Parameters
    ----------
    design : ndarray, shape (n, k), or GroupColumns
        What is there anyway.
    y : ndarray, shape (n,)
    candidates : ndarray, shape (n, m), or Moves
        The latter beside a GroupColumns.
    least : float
        Noise of a row, at least: the resolution, where rounding is all the noise there is.

    Returns
    -------
    Scan
        By Student's t.
    """
    free = Free.of(design)
    rest = free.off(y)
    if isinstance(candidates, Moves):
        size, amount = free.off_moves(candidates, rest)
        squares = np.concatenate([np.sum(columns**2, axis=0) for _, columns in candidates.blocks])
    else:
        left = free.off(candidates)
        size, amount = np.sum(left**2, axis=0), left.T @ rest
        squares = np.sum(candidates**2, axis=0)
    known = size > 1e-6 * squares
    size = np.where(known, size, 1.0)
    amount = np.where(known, amount, 0.0) / size
    dof = max(len(y) - free.rank - 1, 1)
    left = np.maximum(rest @ rest - amount**2 * size, max(least**2 * dof, 1e-300))
    sigma = np.sqrt(left / dof / size)
    p = two_sided(amount / sigma, dof)
    return Scan(amount, sigma, np.where(known, p, 1.0))


def two_sided(t, dof):
    """Probability that Student's t is farther from 0 than `t`."""
    from scipy.special import stdtr
    return 2.0 * stdtr(dof, -np.abs(t))


def evidence(design, y, noise, prior):
    """Log marginal likelihood of linear coefficients with normal priors about zero.

    Parameters
    ----------
    design : ndarray, shape (n, k)
    y : ndarray, shape (n,)
    noise : float
        1 sigma of a row.
    prior : array_like, shape (k,)
        1 sigma of each coefficient.

    Returns
    -------
    float
        Up to a constant that depends on `y` and `noise` alone.
    """
    scaled = design * np.asarray(prior) / noise
    gain = np.eye(scaled.shape[1]) + scaled.T @ scaled
    b = scaled.T @ (y / noise)
    return 0.5 * float(b @ np.linalg.solve(gain, b) - np.linalg.slogdet(gain)[1])


def log_normal(value, variance):
    """Log density of a normal deviate about zero."""
    return -0.5 * (value**2 / variance + np.log(2.0 * np.pi * variance))


def probabilities(logs):
    """Posterior probabilities of hypotheses that are equally likely before, by name."""
    names = list(logs)
    values = np.array([logs[name] for name in names])
    weights = np.exp(values - values.max())
    return dict(zip(names, (weights / weights.sum()).tolist()))
