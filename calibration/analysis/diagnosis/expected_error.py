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

"""Expected RMS error on new stars, as a prediction interval that can be tested."""

import numpy as np

from calibration.estimation.candidate_scores import CandidateBank
from calibration.estimation.chance import normal_score
from calibration.estimation.folds import FOLDS, cross_validate, partitions_of
from calibration.estimation.selection_problem import SelectionProblem
from msg_tools.units import ARCSEC

from ..term_fit import rotation_start
from .base_terms import Base
from .observations import observations

#: probability that the interval contains the RMS of many new stars of the same night
CONFIDENCE = 0.9
#: largest number of blocks for the jackknife: rows close in time share errors
_BLOCKS = 10
_FARTHEST = 300.0  # bound of a drawn logarithm
_FRESH = 100  # number of new stars in the predicted RMS
_BEYOND = 1.645  # normal quantile of a one-sided 5 % test
_NORMAL = 60.0  # prior weight, in rows, of normal kurtosis in the scatter of squares
#: largest growth or decay of the noise along a night (ln of the sigma ratio), and grid size
_GROWTH, _RATIOS = np.log(6.0), 20
_SIMULATED = 1000  # nights
_STANDS = np.zeros(_SIMULATED)  # mean squares of a zero without drift
_AHEAD, _POINTS = 1800.0, 12  # s after the last row, and number of points in them
_SOME = 100  # last rows of a run used to predict its zero


def expected_error_of_terms(run, base='physical', seed=0):
    """Expected error of a model without effects, like `Diagnosis.expected`.

    Parameters
    ----------
    run : PointingRun
    base : str
        See `Base.parse`.
    seed : int

    Returns
    -------
    dict or None
        None if there are too few rows for the terms and a residual.
    """
    rng, base = np.random.default_rng(seed), Base.parse(base, (), run.mount)
    try:
        obs = observations(run)
    except ValueError:  # too few rows, or unusable values
        return None
    columns = base.columns(obs.context, obs.label)
    if 2 * len(obs) < len(columns) + 4:
        return None
    _, left, _ = rotation_start(obs, base.terms)
    none = CandidateBank.empty(len(obs))
    problem = SelectionProblem(columns, left, obs.inverse_sigma, none, none,
                               obs.sequence)
    keep = problem.plain.fit([], final=True).weights > 0.0
    residual = cross_validate(problem.plain, [], partitions_of(problem, FOLDS, rng)[0])
    return expected_error(residual, keep, problem.sequence.order, rng, *ahead(problem, [], rng))


def expected_error(residual, keep, order, rng, ahead=_STANDS, still=np.nan):
    """RMS of new stars, from cross-validated residuals.

    It is the root of the mean square of these residuals. The standard error of the mean square
    comes from the scatter of the squares, or from a jackknife over blocks of the night if that is
    significantly larger (`_error_of_mean`). If the squares grow or decay along the night, the
    estimated level at its end is used. If the zero drifts, its contribution comes from simulated
    nights after their last row.

    Parameters
    ----------
    residual : ndarray, shape (2, n)
        Cross-validated residuals, effects re-selected per fold, radians.
    keep : ndarray of bool, shape (n,)
        Rows that are not outliers.
    order : ndarray of int, shape (n,)
        Rows in the order of observation.
    rng : numpy.random.Generator
    ahead, still : ndarray, shape (b,)
        Results of `ahead`; by default no drift.

    Returns
    -------
    dict
        ``rms_arcsec`` (the median), ``low_arcsec``, ``high_arcsec`` and ``confidence``.
    """
    squares = np.square(residual).sum(axis=0)[order[keep[order]]]
    level, chance = _along(squares)
    means = (squares / level).mean(axis=1)
    sigma, free = _error_of_mean(squares / level[np.argmax(chance)])
    # with a drifting zero use its noise: the drift explains a scatter that varies along the night
    still = np.where(np.isnan(still), rng.choice(means, len(ahead), p=chance), still)
    # with few rows the distribution is very wide: clip it far beyond the quantiles, to stay finite
    off = np.clip(sigma * rng.standard_t(free, len(ahead)), -_FARTHEST, _FARTHEST)
    drawn = still * np.exp(off + _FRESH**-0.5 * rng.standard_normal(len(ahead))) + ahead
    tail = 0.5 - 0.5 * CONFIDENCE
    low, middle, high = np.sqrt(np.quantile(drawn, (tail, 0.5, 1.0 - tail))) / ARCSEC
    return {'rms_arcsec': float(middle), 'low_arcsec': float(low), 'high_arcsec': float(high),
            'confidence': CONFIDENCE}


def _error_of_mean(squares):
    """Standard error of the logarithm of a mean of squares, and its degrees of freedom.

    From the scatter of rows, or, if blocks differ significantly more than that, from the jackknife
    over blocks (Efron 1982, The Jackknife, the Bootstrap and Other Resampling Plans, chapter 3).
    """
    n = len(squares)
    # for normal noise the sum of squares of two axes has a standard deviation equal to its mean
    scatter = (n * squares.var() / squares.mean()**2 + _NORMAL) / (n + _NORMAL)
    blocks = np.array_split(squares, min(_BLOCKS, max(n // 3, 2)))
    sums, counts = np.array([b.sum() for b in blocks]), np.array([len(b) for b in blocks])
    without = np.log((sums.sum() - sums) / (n - counts))
    k = len(blocks)
    between = (k - 1) / k * np.square(without - without.mean()).sum()
    if normal_score((k - 1) * between * n / scatter, k - 1, n) > _BEYOND:
        return np.sqrt(between), k - 1
    return np.sqrt(scatter / n), n - 1


def _along(squares):
    """Relative noise variance along the night (k, n), 1 at its end, and posterior weights (k,).

    Sigma changes linearly along the night. Half of the prior is on constant noise, the other half
    is uniform in the logarithm of the ratio of sigma at start and end.
    """
    start = np.exp(np.linspace(-_GROWTH, _GROWTH, 2 * _RATIOS + 1))
    level = np.square(start[:, None] + (1.0 - start[:, None]) * np.linspace(0.0, 1.0, len(squares)))
    each = squares / level
    mean = each.mean(axis=1)
    log_l = -np.log(level).sum(axis=1) - len(squares) * np.log(np.maximum(mean, 1e-300))
    # temper the likelihood if squares scatter more than those of normal noise
    best = np.argmax(log_l)
    log_l /= max(np.var(each[best] / max(mean[best], 1e-300)), 1.0)
    prior = np.where(start == 1.0, 0.5, 0.25 / _RATIOS)
    chance = prior * np.exp(log_l - log_l.max())
    return level, chance / chance.sum()


def ahead(problem, chosen, rng):
    """Effect of a drifting zero on new stars in the half hour (or ten rows) after the last row.

    Simulates nights conditional on the residuals (simple kriging; Cressie 1993, Statistics for
    Spatial Data, section 3.2), each with noise parameters drawn from their posterior. The zero
    after the last row is partly known.

    Parameters
    ----------
    problem : SelectionProblem
    chosen : list of CandidateGroup
    rng : numpy.random.Generator

    Returns
    -------
    squares : ndarray, shape (b,)
        Mean square of the zero after the last row of each night, both axes on the sky, rad^2; 0
        without drift.
    still : ndarray, shape (b,)
        Mean square of new stars without the zero's part, rad^2; NaN without drift.
    """
    plain = problem.plain.fit(chosen)
    raw, root = (v.reshape(2, -1) for v in (plain.raw, plain.noise.root))
    unit = problem.scale_unit
    noise = np.repeat(np.square(unit * plain.scale)[:, None], _SIMULATED, axis=1)
    squares = np.zeros(_SIMULATED)
    for axis, (every, chance) in enumerate(problem.likely_memories(chosen)):
        which = rng.choice(len(every), _SIMULATED, p=chance)
        for k in np.unique(which[which > 0]):
            nights = np.flatnonzero(which == k)
            squares[nights] += _after(problem.sequence, every[k], root[axis] * plain.scale[axis]
                                      / every[k].scale, raw[axis], len(nights), rng)
            noise[axis, nights] = (unit[axis] * every[k].scale)**2
    fitted = 1.0 + len(plain.basis) / (2.0 * problem.n)  # adds the error of the terms
    return squares, np.where(squares > 0.0, fitted * noise.sum(axis=0), np.nan)


def _after(sequence, one, root, raw, count, rng):
    """Mean square of a process after the last row, given the residuals; shape (count,)."""
    last = sequence.order[sequence.run[sequence.order] == sequence.run[sequence.order[-1]]]
    rows = last[root[last] > 0.0][-_SOME:]
    n = len(rows)
    on_sky = sequence.factor[rows] if one.scaled else np.ones(n)
    at = np.concatenate((sequence.position[rows], sequence.position[last[-1]] + np.linspace(
        0.0, _AHEAD if sequence.timed else 10.0, _POINTS + 1)[1:]))
    z = one.variance * np.exp(-np.abs(at[:, None] - at) / one.memory)
    noise = np.diag(1.0 / np.square(root[rows] * on_sky))
    known = np.linalg.solve(z[:n, :n] + noise, z[:n, n:]).T
    values, vectors = np.linalg.eigh(z[n:, n:] - known @ z[:n, n:])
    drawn = known @ (raw[rows] / on_sky) + rng.standard_normal((count, _POINTS)) @ (
        vectors * np.sqrt(np.maximum(values, 0.0))).T
    return np.square(drawn).mean(axis=1) * np.mean(np.square(on_sky))
