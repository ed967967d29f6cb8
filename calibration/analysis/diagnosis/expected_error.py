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

"""The error to be expected on fresh stars, as an interval that can be wrong in the open."""

import numpy as np

from calibration.estimation.candidates import CandidateBank
from calibration.estimation.chance import normal_score
from calibration.estimation.folds import FOLDS, cross_validate, partitions_of
from calibration.estimation.selection_problem import SelectionProblem
from msg_tools.units import ARCSEC

from ..term_fit import rotation_start
from .base_terms import Base
from .observations import observations

#: the chance with which the interval holds the RMS of many fresh stars of the same night
CONFIDENCE = 0.9
#: stretches that stand for the night: rows of one share what rows close in time share
_BLOCKS = 10
_FARTHEST = 300.0  # of a logarithm
_FRESH = 100  # stars that it is the RMS of
_BEYOND = 1.645  # normal standard deviations that chance passes in 1 of 20
_NORMAL = 60.0  # rows that normal noise counts as, where its scatter is estimated
#: largest growth or decay of the noise along a night (ln of its root), and values that are tried
_GROWTH, _RATIOS = np.log(6.0), 20
_SIMULATED = 1000  # nights
_STANDS = np.zeros(_SIMULATED)  # draws of a night whose zero stays
_AHEAD, _POINTS = 1800.0, 12  # s after the last row, and places in them
_SOME = 100  # rows that stand for a run


def expected_error_of_terms(run, base='physical', seed=0):
    """As `Diagnosis.expected`, for a model without effects.

    Parameters
    ----------
    run : PointingRun
    base : str
        See `Base.parse`.
    seed : int

    Returns
    -------
    dict or None
        None where the rows do not determine the terms and a residual.
    """
    rng, base = np.random.default_rng(seed), Base.parse(base, (), run.mount)
    try:
        obs = observations(run)
    except ValueError:  # too few rows, or what is in them
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
    """RMS of fresh stars, from rows that neither the fit nor the choice has seen.

    The squares of rows left out are averaged; the error of their mean is that of their scatter, or
    of the jackknife over stretches of the night where that is larger (`_error_of_mean`). Where they
    grow or fade along the night it is what they are at its end, as far as they show it. Where the
    zero wanders its part is what simulated nights have after their last row.

    Parameters
    ----------
    residual : ndarray, shape (2, n)
        Of rows left out, the choice repeated, radians.
    keep : ndarray of bool, shape (n,)
        Without the outliers.
    order : ndarray of int, shape (n,)
        Rows as they were observed.
    rng : numpy.random.Generator
    ahead, still : ndarray, shape (b,)
        As of `ahead`; by default nothing wanders.

    Returns
    -------
    dict
        ``rms_arcsec`` (the median), ``low_arcsec``, ``high_arcsec`` and ``confidence``.
    """
    squares = np.square(residual).sum(axis=0)[order[keep[order]]]
    level, chance = _along(squares)
    means = (squares / level).mean(axis=1)
    sigma, free = _error_of_mean(squares / level[np.argmax(chance)])
    # where the zero wanders, that is why the rows scatter differently along the night
    still = np.where(np.isnan(still), rng.choice(means, len(ahead), p=chance), still)
    # of few rows hardly anything is known: what is far beyond every quantile must stay a number
    off = np.clip(sigma * rng.standard_t(free, len(ahead)), -_FARTHEST, _FARTHEST)
    drawn = still * np.exp(off + _FRESH**-0.5 * rng.standard_normal(len(ahead))) + ahead
    tail = 0.5 - 0.5 * CONFIDENCE
    low, middle, high = np.sqrt(np.quantile(drawn, (tail, 0.5, 1.0 - tail))) / ARCSEC
    return {'rms_arcsec': float(middle), 'low_arcsec': float(low), 'high_arcsec': float(high),
            'confidence': CONFIDENCE}


def _error_of_mean(squares):
    """Error of the logarithm of a mean of squares, and its degrees of freedom.

    From row to row; from stretch to stretch, if these differ by more than rows do: jackknife
    (Efron 1982, The Jackknife, the Bootstrap and Other Resampling Plans, chapter 3).
    """
    n = len(squares)
    # of normal noise the squares of two axes scatter by their mean
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
    """Levels (k, n) of the noise along the night, squared, 1 at its end, and their chances (k,).

    Its root goes along a straight line from one end to the other: half of the prior is that it
    stays, the other half is even in the logarithm of the ratio.
    """
    start = np.exp(np.linspace(-_GROWTH, _GROWTH, 2 * _RATIOS + 1))
    level = np.square(start[:, None] + (1.0 - start[:, None]) * np.linspace(0.0, 1.0, len(squares)))
    each = squares / level
    mean = each.mean(axis=1)
    log_l = -np.log(level).sum(axis=1) - len(squares) * np.log(np.maximum(mean, 1e-300))
    # rows that scatter more than normal noise say less
    best = np.argmax(log_l)
    log_l /= max(np.var(each[best] / max(mean[best], 1e-300)), 1.0)
    prior = np.where(start == 1.0, 0.5, 0.25 / _RATIOS)
    chance = prior * np.exp(log_l - log_l.max())
    return level, chance / chance.sum()


def ahead(problem, chosen, rng):
    """What a wandering zero does to fresh stars in the half hour (or ten rows) after the last row.

    Nights are simulated that have left these residuals (simple kriging; Cressie 1993, Statistics
    for Spatial Data, section 3.2), each with a memory that is likely: where the zero is after the
    last row is known in part.

    Parameters
    ----------
    problem : SelectionProblem
    chosen : list of CandidateGroup
    rng : numpy.random.Generator

    Returns
    -------
    squares : ndarray, shape (b,)
        Of each night: mean square of the zero then, of both axes on the sky, rad^2; zero where
        nothing wanders.
    still : ndarray, shape (b,)
        Mean square of fresh stars without it, rad^2; NaN where nothing wanders.
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
    fitted = 1.0 + len(plain.basis) / (2.0 * problem.n)  # the error of the terms
    return squares, np.where(squares > 0.0, fitted * noise.sum(axis=0), np.nan)


def _after(sequence, one, root, raw, count, rng):
    """Mean square of a process after the last row, shape (count,), by what it left in the rows."""
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
