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

"""A model for prediction only, without causes: several methods, and their weighted mixture.

Each method is cross-validated over blocks of time; the mixture has the weights that predict the
held-out blocks best (stacking). It replaces the plain terms only if it gains more than two standard
errors. The held-out rows also calibrate the standard error of a new star.
"""

from dataclasses import dataclass, field
from itertools import product

import numpy as np

from pointing_model.rms import rms, sigma_of

from .folds import contiguous_folds
from .robust import bisquare, huber
from .shrinkage import Beyond, chosen, shrunk, shrunk_beside_strong

#: kinds of columns other than the terms
DIRECT, DRIVEN, STEP, SLOW = range(4)
#: the methods, the plain terms first
WAYS = ('terms', 'choice', 'choice with steps', 'ridge', 'strong effects and ridge')
#: plain ridge, whose one prior suits no strong effects and extrapolates badly: in the mixture only
#: if better by a standard error (Breiman et al. 1984, Classification and Regression Trees)
_RIDGE, _STRONG_TOO = WAYS[3:]
BLOCKS = 10
#: standard errors of a gain above which the mixture replaces the plain terms
_CLEAR = 2.0
#: strong effects gain this many times their cost in BIC
_STRONG = 4.0
#: part of the best method's sum of squares added to each: gives similar methods similar weights
_ALIKE = 0.1
#: updates of prior variances, from scratch and from those of all rows
_ROUNDS, _AGAIN = 15, 3
#: weight below which a row is an outlier, not used to compare methods
LIVE = 0.05
#: factors of the noise that are tried
_NOISES = np.exp(np.linspace(np.log(0.7), np.log(2.5), 14))
#: least noise, arcsec or sigmas: less is rounding
_LEAST = 1e-6
#: Student's t for the likelihood of these factors: degrees of freedom, scale for normal noise
_TAILS, _OF_NORMAL = 10.0, 0.915
#: factors of the coefficients' errors that are tried
_ERRORS = np.exp(np.linspace(0.0, np.log(5.0), 9))


@dataclass
class PredictionProblem:
    """Values, columns of the terms, and other columns.

    Attributes
    ----------
    base : ndarray, shape (p, 2n)
        Columns of the terms.
    others : ndarray, shape (K, 2n)
        Other columns, each of size about 1.
    kind : ndarray of int, shape (K,)
        `DIRECT`, `DRIVEN`, `STEP`, `SLOW`.
    axis : ndarray of int, shape (K,)
        Axis of the `SLOW` ones, 0 or 1.
    b : ndarray, shape (2n,)
    inverse_sigma : ndarray, shape (2n,), or None
    order : ndarray of float, shape (n,)
        Sort key of the rows, such as time.
    group : ndarray of int, shape (n,)
        Rows with one number are held out together.
    """

    base: np.ndarray
    others: np.ndarray
    kind: np.ndarray
    axis: np.ndarray
    b: np.ndarray
    inverse_sigma: np.ndarray | None
    order: np.ndarray
    group: np.ndarray

    def __post_init__(self):
        self.given = np.ones(2 * self.n) if self.inverse_sigma is None else self.inverse_sigma
        # in sigmas, if these are given
        self.columns = np.vstack((self.base, self.others, self.b)) * self.given

    @property
    def n(self):
        """Number of rows."""
        return len(self.b) // 2

    @property
    def p(self):
        """Number of terms."""
        return len(self.base)

    def prior(self, slow=True):
        """Prior group of each column; -1: none."""
        out = np.where(self.kind <= DRIVEN, self.kind, -1)
        return np.where((self.kind == SLOW) & slow, 2 + self.axis, out)

    def blocks(self, rows):
        """Blocks of time of some rows (a mask)."""
        here = np.flatnonzero(rows)
        return [here[fold] for fold in contiguous_folds(self.order[here], min(BLOCKS, len(here)))]

    def left(self, coefficients, rows):
        """Residuals of rows (indices), shape (2, m), in the unit of `b`."""
        both = np.concatenate((rows, rows + self.n))
        return (self.b[both] - coefficients @ self.columns[:-1, both]
                / self.given[both]).reshape(2, -1)


@dataclass
class Predictor:
    """The fitted prediction model.

    Attributes
    ----------
    coefficients : ndarray, shape (p + K,)
        Coefficients of the terms and the other columns.
    shares : dict of str to float
        Weight of each of `WAYS` in the mixture; 1 for the terms if these are kept.
    gain, gain_sigma : float
        ln of the cross-validated RMS of the terms over that of the mixture, and its error.
    errors : dict of str to float
        Cross-validated RMS of each method, without outliers.
    covariance : ndarray, shape (p + K, p + K)
        Of all columns even if the terms are kept: away from the rows effects beyond the terms stay
        unknown.
    terms_covariance : ndarray, shape (p, p)
        Covariance if there are no effects beyond the terms.
    noise : ndarray, shape (2,)
        Standard deviation of a new star's two values (in sigmas, if these were given).
    weights : ndarray, shape (n,)
    blocks : ndarray, shape (2, 2, n)
        Residuals of held-out rows: by the terms, by the mixture.
    """

    coefficients: np.ndarray
    shares: dict
    gain: float
    gain_sigma: float
    errors: dict
    covariance: np.ndarray
    terms_covariance: np.ndarray
    noise: np.ndarray
    weights: np.ndarray
    blocks: np.ndarray = field(repr=False)

    @property
    def beyond(self):
        """Whether the mixture has replaced the plain terms."""
        return self.shares.get('terms', 0.0) < 1.0

    def variance(self, columns):
        """Variance of predictions with columns (p + K, 2m), without noise, shape (2m,)."""
        return np.maximum(np.einsum('ij,ij->j', columns, self.covariance @ columns), 0.0)


def predictor(problem, rows=None):
    """Fit each method to some rows, and weight them by cross-validation over blocks of time.

    Parameters
    ----------
    problem : PredictionProblem
    rows : ndarray of bool, shape (n,), optional
        By default all.

    Returns
    -------
    Predictor
    """
    rows = np.ones(problem.n, bool) if rows is None else rows
    blocks = problem.blocks(rows)
    terms, weights, scale = terms_alone(problem, rows)
    plain = Beyond.of(problem.columns[[*range(problem.p), -1]], problem.p,
                      _of_values(weights, scale), weights, blocks)
    for _ in range(2):
        weights, scale = _reweighted(problem, rows, weights, scale)
    beyond = Beyond.of(problem.columns, problem.p, _of_values(weights, scale), weights, blocks)
    ways, ridge = _ways(problem, beyond)
    ways['terms'] = np.hstack((plain.base[:, :, -1], np.zeros_like(beyond.right)))
    left = {way: np.full((2, problem.n), np.nan) for way in WAYS}
    for way in WAYS:
        for one, block in zip(ways[way][1:], blocks):
            left[way][:, block] = problem.left(one, block)
    live = [block[weights[block] > LIVE] for block in blocks]
    better, error = _gain(left[_STRONG_TOO], left[_RIDGE], live)
    mixed = [way for way in WAYS if way != _RIDGE or better > error]
    shares = _shares([left[way][:, np.concatenate(live)] for way in mixed])
    shares = np.array([shares[mixed.index(way)] if way in mixed else 0.0 for way in WAYS])
    mixture = sum(share * left[way] for share, way in zip(shares, WAYS))
    gain, gain_sigma = _gain(left['terms'], mixture, live)
    # weights are fitted to the same blocks: the gain expected from that alone (Akaike 1974)
    fitted = (len(WAYS) - 1) / (2.0 * sum(map(len, live)))
    if not gain - fitted > _CLEAR * gain_sigma:
        shares, mixture = np.eye(len(WAYS))[0], left['terms']
    coefficients = sum(share * ways[way][0] for share, way in zip(shares, WAYS))
    covariance = _of_all(problem, beyond, ridge) + _between(ways, shares)
    noise, size = _calibrated(problem, mixture, scale, covariance, live)
    return Predictor(coefficients, dict(zip(WAYS, map(float, shares))), gain, gain_sigma,
                     {way: rms(*one[:, np.concatenate(live)]) for way, one in left.items()},
                     size**2 * covariance[0], plain.inverse[0], noise, weights,
                     np.array((left['terms'], mixture)))


def rows_left_out(problem, folds):
    """Cross-validated residuals, with the whole `predictor` refitted for each fold.

    Parameters
    ----------
    problem : PredictionProblem
    folds : list of ndarray of int

    Returns
    -------
    residual : ndarray, shape (2, 2, n)
        By the terms alone, by the prediction model.
    sigma : ndarray, shape (2, n)
        Predicted standard error of a new star.
    """
    out, sigma = np.empty((2, 2, problem.n)), np.empty((2, problem.n))
    for fold in folds:
        rows = np.ones(problem.n, bool)
        rows[fold] = False
        both = np.concatenate((fold, fold + problem.n))
        found = predictor(problem, rows)
        terms = terms_alone(problem, rows)[0]
        out[0][:, fold] = problem.left(np.append(terms, np.zeros(len(problem.others))), fold)
        out[1][:, fold] = problem.left(found.coefficients, fold)
        columns = problem.columns[:-1, both] / problem.given[both]
        noise = np.repeat(found.noise, len(fold)) / problem.given[both]
        sigma[:, fold] = np.sqrt(found.variance(columns) + noise**2).reshape(2, -1)
    return out, sigma


def _of_values(weights, scale):
    return np.concatenate((weights / scale[0]**2, weights / scale[1]**2))


def _scale(residual, weights, free):
    """Noise of the two axes, with a floor."""
    least = 1e-9 * np.abs(residual).max() + _LEAST
    return np.sqrt((weights * residual**2).sum(axis=1) / np.maximum(free, 1e-9)) + least


def terms_alone(problem, rows):
    """Robust fit of the terms: coefficients, weights of the rows, noise of the axes."""
    n, p = problem.n, problem.p
    weights, scale = rows.astype(float), np.ones(2)
    part = np.sqrt(2.0 * rows.sum() / max(2.0 * rows.sum() - p, 1.0))
    columns = problem.columns[[*range(p), -1]]
    for loss in [huber] * 6 + [bisquare] * 6 + [None]:
        one = Beyond.of(columns, p, _of_values(weights, scale), weights)
        terms = one.base[0, :, -1]
        if loss is None:
            return terms, weights, scale
        residual = (columns[-1] - terms @ columns[:-1]).reshape(2, n)
        middle = part * sigma_of(residual[:, rows], axis=1)
        middle = np.maximum(middle, 1e-9 * np.abs(residual[:, rows]).max() + _LEAST)
        weights = loss(np.hypot(*(residual / middle[:, None]))) * rows
        scale = _scale(residual, weights, weights.sum() / part**2)


def _reweighted(problem, rows, weights, scale):
    """Robust weights from the leave-one-out residuals of a ridge fit."""
    n, p = problem.n, problem.p
    values = _of_values(weights, scale)
    beyond = Beyond.of(problem.columns, p, values, weights)
    found = shrunk(beyond, problem.prior(slow=False), 12)
    whole = beyond.whole(found.coefficients)[0]
    residual = (problem.columns[-1] - whole @ problem.columns[:-1]).reshape(2, n)
    leverage = _leverage(problem, beyond, found, values)
    alone = residual / (1.0 - leverage)
    middle = np.maximum(sigma_of(alone[:, rows], axis=1),
                        1e-9 * np.abs(alone[:, rows]).max() + _LEAST)
    weights = bisquare(np.hypot(*(alone / middle[:, None]))) * rows
    return weights, _scale(residual, weights, (weights * (1.0 - leverage)).sum(axis=1))


def _leverage(problem, beyond, found, values):
    """Leverage of each value, shape (2, n), at most 0.9."""
    base, used = problem.columns[:problem.p], problem.p + found.used
    of_base = np.einsum('ij,ij->j', base, beyond.inverse[0] @ base)
    rest = problem.columns[used] - beyond.base[0][:, found.used].T @ base
    of_rest = np.einsum('ij,ij->j', rest, found.covariance[0] @ rest) / found.noise[0]
    return np.clip(values * (of_base + of_rest), 0.0, 0.9).reshape(2, -1)


def _ways(problem, beyond):
    """Coefficients (sets, p + K) by each method but the terms, and the `Shrunk` of all columns."""
    kind, prior = problem.kind, problem.prior()
    ridge = shrunk(beyond.only(slice(0, 1)), prior, _ROUNDS)
    again = shrunk(beyond.only(slice(1, None)), prior, _AGAIN, ridge)
    for name in ('coefficients', 'variances', 'noise', 'covariance'):
        setattr(ridge, name, np.concatenate((getattr(ridge, name), getattr(again, name))))
    effects = kind <= DRIVEN
    found = {'choice': chosen(beyond, effects, 1.0),
             'choice with steps': chosen(beyond, kind <= STEP, 1.0, 1.0 * (kind == STEP)),
             'ridge': ridge.coefficients,
             'strong effects and ridge': shrunk_beside_strong(
                 beyond, prior, (_ROUNDS, _AGAIN), effects, _STRONG)}
    return {way: beyond.whole(one) for way, one in found.items()}, ridge


def _shares(left):
    """Stacking weights: nonnegative with sum 1, for the least sum of squares of the mixture.

    See Breiman 1996, Machine Learning 24, 49.
    """
    left = np.array([one.ravel() for one in left])
    squares = left @ left.T
    squares[np.diag_indices(len(left))] += _ALIKE * squares.diagonal().min()
    squares = squares / max(float(np.trace(squares)), 1e-300) + 1e-9 * np.eye(len(left))
    shares, most = np.zeros(len(left)), 0.0
    # methods are few: try all subsets, and keep the best with nonnegative weights
    for some in map(np.flatnonzero, product((False, True), repeat=len(left))):
        found = np.linalg.solve(squares[np.ix_(some, some)], np.ones(len(some)))
        if len(some) and found.min() >= 0.0 and found.sum() > most:
            shares, most = np.zeros(len(left)), found.sum()
            shares[some] = found / most
    shares[shares < 0.02] = 0.0  # negligible
    return shares / shares.sum()


def _gain(before, after, blocks):
    """ln of a ratio of RMS, and its error by a jackknife over the blocks."""
    sums = np.array([[np.square(one[:, block]).sum() for block in blocks]
                     for one in (before, after)]) + 1e-300
    logs = 0.5 * np.log(sums.sum(axis=1))
    without = 0.5 * np.log(sums.sum(axis=1)[:, None] - sums)
    ratio = without[0] - without[1]
    k = len(blocks)
    return float(logs[0] - logs[1]), float(
        np.sqrt((k - 1) / k * np.square(ratio - ratio.mean()).sum()))


def _of_all(problem, beyond, ridge):
    """Posterior covariance of all coefficients, from all rows and without each block."""
    p, used = problem.p, ridge.used
    across = beyond.base[:, :, used]
    inner = -across @ ridge.covariance
    out = np.zeros((len(beyond), p + len(problem.kind), p + len(problem.kind)))
    out[:, :p, :p] = ridge.noise[:, None, None] * beyond.inverse - inner @ np.swapaxes(across, 1, 2)
    out[:, :p, p + used], out[:, p + used, :p] = inner, np.swapaxes(inner, 1, 2)
    out[np.ix_(np.arange(len(beyond)), p + used, p + used)] = ridge.covariance
    return out


def _between(ways, shares):
    """Covariance between the methods, a part of the error (Draper 1995, JRSS B 57, 45).

    Each counts half by its weight, and half equally with all other methods beyond the terms.
    """
    each = np.array([ways[way] for way in WAYS])
    spread = each - np.tensordot(shares, each, axes=1)
    weight = 0.5 * shares + 0.5 * np.append(0.0, np.full(len(WAYS) - 1, 1.0 / (len(WAYS) - 1)))
    return np.einsum('w,wfi,wfj->fij', weight, spread, spread, optimize=True)


def _calibrated(problem, left, scale, covariance, blocks):
    """Noise of a new star, and factor of the coefficients' errors, by maximum likelihood.

    From the held-out residuals.
    """
    squares, known = [], []
    for one, block in zip(covariance[1:], blocks):
        both = np.concatenate((block, block + problem.n))
        columns = problem.columns[:-1, both]
        squares.append((left[:, block] * problem.given[both].reshape(2, -1))**2)
        known.append(np.maximum(np.einsum('ij,ij->j', columns, one @ columns), 0.0).reshape(2, -1))
    squares, known = np.hstack(squares), np.hstack(known)
    best = -np.inf, 1.0, 1.0
    for a in _NOISES:
        for c in _ERRORS:
            variance = (a * scale[:, None])**2 + c**2 * known
            ratio = squares / variance
            # Student's t, so that long tails hardly affect the fit of the core
            likely = -0.5 * np.sum(np.log(variance) + (_TAILS + 1.0) * np.log1p(
                ratio / (_TAILS * _OF_NORMAL**2)) + 2.0 * np.log(_OF_NORMAL))
            best = max(best, (likely, a, c))
    return best[1] * scale, best[2]
