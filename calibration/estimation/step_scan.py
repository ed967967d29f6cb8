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

"""Detection of a step and its time: robust regression, a scan of candidates, Gaussian evidence.

The candidates are columns added to a design one at a time, such as a step at each moment. Rows
may be correlated with their neighbours (`neighbour_noise`, estimated with the best candidate in
the model, for a step looks like correlation too). `step_place` only locates a step; it does not
test for one.
"""

from typing import NamedTuple

import numpy as np

from pointing_model.rms import sigma_of

from .correlated_noise import AxisNoise, CorrelatedNoise, Sequence
from .estimate import Estimate
from .group_columns import GroupColumns, orthonormal
from .least_squares import System
from .memory_likelihood import AxisLikelihood
from .robust import bisquare, huber

#: robust sigmas at which outliers are clipped. Tried on nights of 40 rows with two spikes of 20
#: sigma: no false step up to 4, 0.7 % at 6, 1.3 % unclipped; false steps on clean nights and the
#: power to detect a step of 1.7 sigma (67 %) are the same from 2 on
_CLIP = 3.0
_STILL = 1e-6  # change of the residuals, in units of the noise, at which the iteration stops
_RCOND = 1e-7  # relative singular value below which columns are linearly dependent
#: weight functions of the successive iterations that locate a step
_WEIGHTS = (huber,) * 6 + (bisquare,) * 4
#: least part of a step that must remain beyond the design; least weight of a value
_APART, _LEAST = 1e-6, 1e-8


class LocalColumns:
    """Candidate columns that are zero outside a few rows each.

    Parameters
    ----------
    n : int
        Number of all rows.
    blocks : list of (ndarray of int, ndarray)
        Rows (r,), all rows of their group, and the columns there (r, m).
    labels : list
        Label of each column, m for each block.
    """

    def __init__(self, n, blocks, labels):
        self._n, self.blocks, self.labels = n, blocks, labels
        self._first = np.cumsum([0, *(columns.shape[1] for _, columns in blocks)])

    def __len__(self):
        return len(self.labels)

    def column(self, place):
        """One column, shape (n,)."""
        block = int(np.searchsorted(self._first, place, 'right')) - 1
        rows, columns = self.blocks[block]
        out = np.zeros(self._n)
        out[rows] = columns[:, place - self._first[block]]
        return out

    def on_axis(self, axis, cos_el):
        """Columns of encoder angles as on the sky: rows of x, then of y."""
        n = self._n
        blocks = [(rows, columns * cos_el[rows, None]) if axis == 0 else (rows + n, columns)
                  for rows, columns in self.blocks]
        return LocalColumns(2 * n, blocks, self.labels)

    def whitened(self, noise):
        """See `GroupColumns.whitened`."""
        return LocalColumns(self._n, [(rows, noise.values(rows).whiten(columns.T).T)
                                      for rows, columns in self.blocks], self.labels)

    def dense(self):
        """All columns, shape (n, m)."""
        out = np.zeros((self._n, len(self)))
        for (rows, columns), first in zip(self.blocks, self._first):
            out[rows, first:first + columns.shape[1]] = columns
        return out


def shares(basis, candidates, rest):
    """Squared length of each candidate, that after projection, and its product with `rest`, (m,).

    Parameters
    ----------
    basis : Basis
        Basis that is projected out of the candidates.
    candidates : LocalColumns
    rest : ndarray, shape (n,)
        Residuals.
    """
    out = []
    for rows, columns in candidates.blocks:
        own = basis.groups.own[:, rows]
        left = columns - own.T @ (own @ columns)
        along = basis.common[:, rows] @ left
        out.append((np.sum(columns**2, axis=0), np.sum(left**2, axis=0)
                    - np.sum(along**2, axis=0), rest[rows] @ left))
    return np.concatenate(out, axis=1)


def robust_fit(design, y):
    """Least squares with Huber's weights.

    Parameters
    ----------
    design : ndarray, shape (n, k), or GroupColumns
        Of a GroupColumns only the coefficients of the common columns are returned.
    y : ndarray, shape (n,)

    Returns
    -------
    Estimate
        The minimum-norm solution where columns are linearly dependent.

    Raises
    ------
    ValueError
        No more rows than independent columns.
    """
    groups = isinstance(design, GroupColumns)
    k = len(design.common) if groups else design.shape[1]
    system = System(design if groups else design.T, y, None, _RCOND, axes=1)
    plain = system.solve()
    rank, dof = plain.rank, len(y) - plain.rank
    if dof <= 0:
        raise ValueError(f'{len(y)} rows do not determine {len(system.design)} numbers; '
                         'observe more')
    solution, weights = system.solve_huber(rank, _STILL)
    # Huber (1981), eq. 7.6.6: mean square of the clipped residuals over (unclipped fraction)^2
    variance = np.sum((weights * solution.residual) ** 2) / dof / np.mean(weights == 1.0) ** 2
    return Estimate(solution.p[:k], variance * plain.inverse[:k, :k], np.full(k, dof),
                    (float(system.median_noise(solution.residual, rank)[0]),),
                    solution.residual, weights, rank, True)


def clipped(design, y):
    """`y` with residuals of the robust fit clipped at 3 sigma: no single outlier is then a step."""
    fit = robust_fit(design, y)
    limit = _CLIP * max(float(sigma_of(fit.residual)), 1e-300)
    return y - fit.residual + np.clip(fit.residual, -limit, limit)


def probabilities_by_chance(design, y, candidates, least):
    """Two-sided p of each candidate, each added alone to the design, (m,).

    By Student's t; 1 where the rows do not determine its amount.
    """
    basis = design.basis()
    rest = basis.off(y)
    squares, size, along = shares(basis, candidates, rest)
    known = size > 1e-6 * squares
    size = np.where(known, size, 1.0)
    dof = max(len(y) - len(basis) - 1, 1)
    left = np.maximum(rest @ rest - along**2 / size, max(least**2 * dof, 1e-300))
    return np.where(known, two_sided(along / np.sqrt(size * left / dof), dof), 1.0)


def noise_beside(design, y, run):
    """`neighbour_noise` beside a design, with outliers clipped; white with too few rows."""
    return neighbour_noise(design, clipped(design, y) if len(y) > len(design) + 2 else y, run)


class Detection(NamedTuple):
    """The most significant candidate.

    Attributes
    ----------
    place : int
        Index of its column.
    amount, sigma : float
        Robust estimate and its standard error.
    probability : float
        Family-wise p over all candidates (Bonferroni).
    """

    place: int
    amount: float
    sigma: float
    probability: float


def detect(design, y, candidates, limit, run, least):
    """Test each candidate column alone, allowing for correlation of neighbouring rows.

    Parameters
    ----------
    design : GroupColumns
    y : ndarray, shape (axes * n,)
    candidates : LocalColumns
    limit : float
        Family-wise significance level.
    run : ndarray, shape (n,)
        See `neighbour_noise`.
    least : float
        Least noise of a row: the resolution, where rounding is the only noise.

    Returns
    -------
    Detection or None
        None where no candidate is significant.
    """
    tame = clipped(design, y)
    p = probabilities_by_chance(design, tame, candidates, least) * len(candidates)
    if p.min() >= limit:
        return None  # correlation only makes p larger
    noise = noise_beside(design.beside(candidates.column(int(np.argmin(p)))), y, run)
    design, candidates = design.whitened(noise), candidates.whitened(noise)
    p = probabilities_by_chance(design, noise.whiten(tame), candidates, least) * len(candidates)
    best = int(np.argmin(p))
    if p[best] >= limit:
        return None
    fit = robust_fit(design.beside(candidates.column(best)), noise.whiten(y))
    return Detection(best, float(fit.coefficients[-1]), float(np.sqrt(fit.covariance[-1, -1])),
                     float(p[best]))


class StepPlace(NamedTuple):
    """A step of both axes.

    Attributes
    ----------
    before, after : int
        Last row before the step and first row after it.
    later : ndarray, shape (n,)
        1 in rows after the step, else 0.
    amounts : ndarray, shape (2,)
        Size of the step on each axis, later minus earlier.
    """

    before: int
    after: int
    later: np.ndarray
    amounts: np.ndarray


def step_place(design, unit, value, position, near):
    """Maximum-likelihood place of a step of both axes, with robust weights.

    The weight of a row near the step comes from the smaller of its residuals with the step before
    it and after it, so that a row on the wrong side of a trial place is no outlier.

    Parameters
    ----------
    design : ndarray, shape (k, 2, n)
        The other fitted columns.
    unit : ndarray, shape (2, n)
        Effect of a step of 1 in each row after it.
    value : ndarray, shape (2, n)
    position : ndarray, shape (n,)
        Time, or place in the order.
    near : ndarray of bool, shape (n,)
        Rows between which the step is sought, with at least two different positions.

    Returns
    -------
    StepPlace
    """
    order = np.argsort(position, kind='stable')
    design, unit, value, near = (one[..., order] for one in (design, unit, value, near))
    places = np.flatnonzero(near)
    tried = np.arange(places[0] + 1, places[-1] + 1)
    tried = tried[np.diff(position[order])[tried - 1] > 0.0]
    rows, least = np.arange(len(order)), max(1e-9 * float(np.abs(value).max()), 1e-300)
    weight, scale = np.ones(unit.shape), np.ones((2, 1))
    for weigh in _WEIGHTS:
        root = np.sqrt(weight) / scale
        basis = orthonormal((design * root).reshape(len(design), -1)).reshape(-1, *unit.shape)
        step, rest = unit * root, _off(basis, value * root)
        best, amounts = _best_place(basis, step, rest, tried)
        later = rows >= best
        left = (rest - _off(basis, amounts[:, None] * step * later)) / root
        # residual with the step on the other side of the row
        other = left + amounts[:, None] * unit * np.where(later, 1.0, -1.0)
        scale = np.maximum(sigma_of(left, axis=1), least)[:, None]
        off, beyond = np.abs(left) / scale, np.abs(other) / scale
        weight = np.maximum(weigh(np.where(near, np.minimum(off, beyond), off)), _LEAST)
    return StepPlace(int(order[best - 1]), int(order[best]),
                     np.where(np.argsort(order) >= best, 1.0, 0.0), amounts)


def _off(basis, values):
    """Values, shape (2, n), with orthonormal rows, (r, 2, n), projected out."""
    return values - np.tensordot(np.tensordot(basis, values, 2), basis, 1)


def _best_place(basis, step, rest, tried):
    """The trial place whose step explains most of the residuals `rest`, and its amounts."""
    def later(values):
        return np.cumsum(values[..., ::-1], axis=-1)[..., ::-1][..., tried]
    along, shared, square = later(step * rest), later(step * basis), later(step**2)
    normal = -np.einsum('ram,rbm->abm', shared, shared)
    normal[[0, 1], [0, 1]] += square
    (xx, xy), (_, yy) = normal
    size = xx * yy - xy**2
    known = size > _APART * square[0] * square[1]
    amounts = np.array([yy * along[0] - xy * along[1],
                        xx * along[1] - xy * along[0]]) / np.where(known, size, np.inf)
    best = int(np.argmax((along * amounts).sum(axis=0)))
    return tried[best], amounts[:, best]


def two_sided(t, dof):
    """Probability that Student's t is farther from 0 than `t`."""
    from scipy.special import stdtr
    return 2.0 * stdtr(dof, -np.abs(t))


def student_factor(dof):
    """Factor for a 1-sigma interval whose sigma is estimated with `dof` degrees of freedom.

    The 84.13 % point of Student's t: 1.84 for one degree of freedom, 1 for many.
    """
    from scipy.special import ndtr, stdtrit
    return stdtrit(dof, ndtr(1.0))


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
    """Posterior probabilities of hypotheses with equal priors, by name, from log evidences."""
    names = list(logs)
    values = np.array([logs[name] for name in names])
    weights = np.exp(values - values.max())
    return dict(zip(names, (weights / weights.sum()).tolist()))


#: lag-1 correlations that `neighbour_noise` tries
_CORRELATIONS = np.arange(0.05, 0.96, 0.05)
#: 2 ln of the likelihood ratio above which rows are correlated (5 %, one-sided); also the drop that
#: bounds the 90 % confidence interval of the correlation
_CLAIMED = 2.71
#: correlation time of a random walk, in lengths of the run; variances that the walk adds for each
#: row that are tried, over that of the white noise
_ENDLESS, _WALKS = 1e4, np.geomspace(1e-4, 1e3, 57)
#: sigma of a negligible white part, where the process is all the noise
_NO_WHITE = 1e-5


def neighbour_noise(design, y, run, most=1.0):
    """First-order autoregressive noise, AR(1), in the order of the rows whatever the time between.

    The correlation is the upper end of its 90 % confidence interval, for the candidate in the
    design was selected because it absorbs some of it. If not significant, the noise is white.

    Parameters
    ----------
    design : GroupColumns
        All fitted columns. Rows of one run must be of one group.
    y : ndarray, shape (axes * n,)
        Values without outliers.
    run : ndarray, shape (n,)
        Run of each row, the rows in order. Rows of different runs are uncorrelated.
    most : float
        Largest correlation allowed.

    Returns
    -------
    CorrelatedNoise
        Of variance 1, estimated for each axis by itself.
    """
    n, axes = len(run), max(len(y) // max(len(run), 1), 1)
    sequence = Sequence(np.arange(float(n)), run, np.ones(n))
    memories, out = -1.0 / np.log(_CORRELATIONS[most + 1e-9 > _CORRELATIONS]), []
    for axis in range(axes):
        likelihood = AxisLikelihood(sequence, axis, False, np.ones(len(y)), np.ones(axes),
                                     design, y)
        gain = np.zeros(1) if likelihood.few else np.array([one.gain for one in likelihood.at(
            memories, np.full(len(memories), _NO_WHITE**-2))])
        best = float(gain.max())
        likely = memories[np.flatnonzero(gain > best - _CLAIMED)[-1]]
        out.append(AxisNoise(1.0, float(likely), gain=best) if best > _CLAIMED else AxisNoise())
    white = [_NO_WHITE if one.variance > 0.0 else 1.0 for one in out]
    return CorrelatedNoise(np.repeat(1.0 / np.array(white), n), sequence, tuple(out))


def random_walk(design, y, position, run):
    """White noise plus a random walk along the position, by restricted likelihood.

    Parameters
    ----------
    design, y, run
        See `neighbour_noise`; one axis.
    position : ndarray, shape (n,)
        Ascending, in units of the usual gap between rows.

    Returns
    -------
    CorrelatedNoise
        White where a random walk does not raise the likelihood.
    """
    n = len(y)
    sequence = Sequence(position, run, np.ones(n))
    likelihood = AxisLikelihood(sequence, 0, False, np.ones(n), np.ones(1), design, y)
    memory, best = _ENDLESS * max(sequence.span, 1.0), AxisNoise()
    if not likelihood.few:
        best = max([best, *likelihood.at(np.full(len(_WALKS), memory), _WALKS * memory / 2.0)],
                   key=lambda one: one.gain)
    return CorrelatedNoise(np.full(n, 1.0 / best.scale), sequence, (best,))
