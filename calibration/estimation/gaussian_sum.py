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

"""A multiple-hypothesis Kalman filter: how fast coefficients drift, what may have jumped and when.

A Gaussian sum: one Kalman filter for each history (nothing happened, this jumped before that row,
that row was an outlier) and each drift rate of the coefficients, all at once, weighted by Bayes'
rule. No hypothesis is dropped before the rows decide; histories that differ only in the distant
past are merged.

Bar-Shalom, Li and Kirubarajan 2001, Estimation with applications to tracking and navigation,
chapters 5 and 11.
"""

from copy import copy
from typing import NamedTuple

import numpy as np

from .dynamics import ExponentialMemory, RandomWalk
from .kalman import innovation_of, log_det_of, predict, update, whitening_of

#: h, shortest interval for the probability of a jump: time stamps of one exposure may be equal
_SHORTEST = 1e-3
#: least weight with which a history is continued
_LEAST = 1e-5
#: least logarithm of a weight
_NOTHING = -700.0
#: cause of a change: the row itself is an outlier
OUTLIER = -1


class Change(NamedTuple):
    """An event: a jump before star `number` (from 0), or that star being an outlier."""

    number: int
    cause: int  # index of the jump, or `OUTLIER`


class PossibleJump(NamedTuple):
    """Coefficients that may jump together."""

    name: str  # of what moves
    shape: np.ndarray  # (n, m), change of the coefficients for m independent jumps of 1
    sigma: float  # standard deviation of its size
    per_hour: float  # rate

    @property
    def covariance(self):
        """Covariance that a jump adds to that of the coefficients, shape (n, n)."""
        return self.sigma**2 * (self.shape @ self.shape.T)


class GaussianSum:
    """Filters of all histories and drift rates, updated row by row.

    Parameters
    ----------
    mean : ndarray, shape (n,) or (r, n)
        Initial coefficients, of all rates or of each.
    covariance : ndarray, shape (n, n) or (r, n, n)
        Initial covariance.
    rates : ndarray, shape (r, n, n)
        Process noise of each hypothesis: covariance added per hour.
    weights : ndarray, shape (r,), optional
        Prior probabilities of the rates; equal by default.
    jumps : sequence of PossibleJump
    outliers : float
        Fraction of stars that are outliers.
    outlier_sigma : float
        Standard deviation of an outlier's error.
    memory_h : ndarray, shape (n,), optional
        Time in which a coefficient returns to `mean` by a factor e, h; inf: never.
    turn_h : float
        Mean time after which a rate changes to another one, h; inf: never.
    most : int
        Most histories kept.
    depth : int
        Histories that differ only more than this many stars ago are merged.

    Attributes
    ----------
    home : ndarray, shape (n,)
        Values that coefficients return to.
    means, covariances : ndarray, shapes (b, r, n) and (b, r, n, n)
        Coefficients and covariances of b histories.
    histories : list of tuple of Change
    count : int
        Number of stars observed.
    evidence : float
        Log likelihood of all rows, but for a constant of each.
    unseen : ndarray, shape (jumps,)
        Time since a row was last sensitive to each jump, h.
    """

    def __init__(self, mean, covariance, rates, weights=None, *, jumps=(), outliers=0.01,
                 outlier_sigma=1e-3, memory_h=None, turn_h=np.inf, most=12, depth=4):
        self.rates = np.array(rates, dtype=float)
        count, n = self.rates.shape[:2]
        mean = np.array(mean, dtype=float)
        self.home = mean if mean.ndim == 1 else mean.mean(axis=0)
        self.jumps = tuple(jumps)
        self._outliers, self._outlier_sigma = outliers, outlier_sigma
        self._most, self._depth, self._turn = most, depth, turn_h
        self._memory = None if memory_h is None or np.isinf(memory_h).all() else memory_h
        start = np.full(count, 1.0 / count) if weights is None else np.asarray(weights, float)
        self.prior = start / start.sum()
        self.means = np.array(np.broadcast_to(mean, (1, count, n)))
        self.covariances = np.array(np.broadcast_to(covariance, (1, count, n, n)), dtype=float)
        self.log_weights = _log(self.prior)[None, :]
        self.histories = [()]
        self.count, self.evidence = 0, 0.0
        self.unseen = np.zeros(len(self.jumps))

    def copy(self):
        """An independent copy of the state."""
        out = copy(self)
        out.unseen = self.unseen.copy()
        return out

    # --- what is known ------------------------------------------------------------------------

    @property
    def weights(self):
        """Probability of each history and rate, shape (b, r)."""
        return np.exp(self.log_weights)

    def estimate(self):
        """Mean and covariance of the coefficients, shapes (n,) and (n, n)."""
        n = len(self.home)
        return mixture(self.weights.reshape(-1), self.means.reshape(-1, n),
                       self.covariances.reshape(-1, n, n))

    def rate_weights(self):
        """Posterior probability of each rate, shape (r,)."""
        return self.weights.sum(axis=0)

    def chance(self, number):
        """Probability of each jump before star `number`, and of its being an outlier.

        Returns
        -------
        ndarray, shape (jumps + 1,)
            The last is that of an outlier.
        """
        out = np.zeros(len(self.jumps) + 1)
        for history, weight in zip(self.histories, self.weights.sum(axis=1)):
            for change in history:
                if change.number == number:
                    out[change.cause] += weight
        return out

    def dynamics(self, rates):
        """Dynamics of the coefficients relative to `home`, for one or several rates (..., n, n)."""
        return (RandomWalk(rates) if self._memory is None
                else ExponentialMemory(rates, self._memory))

    def ahead(self, hours):
        """Mean square deviation of the coefficients after `hours` from their present estimate.

        Returns
        -------
        ndarray, shape (n, n)
            With the drift until then, without jumps.
        """
        mean, covariance = self.estimate()
        away = (mean - self.home)[:, None]
        rate = np.tensordot(self.rate_weights(), self.rates, 1)
        later, covariance = predict(away, covariance, self.dynamics(rate).over(0.0, hours))
        return covariance + (later - away) @ (later - away).T

    def expected(self, columns, value, noise):
        """Innovation of a row: its value less the prediction.

        Parameters
        ----------
        columns, value, noise
            See `observe`.

        Returns
        -------
        innovation : ndarray, shape (m,)
        spread : ndarray, shape (m, m)
            Its covariance, without jumps or outliers.
        """
        mean, covariance = self.estimate()
        return innovation_of(mean, covariance, columns, value, np.diag(np.square(noise)))

    # --- what happens -------------------------------------------------------------------------

    def wait(self, hours):
        """Predict over a time in which coefficients drift."""
        if hours <= 0.0:
            return
        away, self.covariances = predict((self.means - self.home)[..., None], self.covariances,
                                         self.dynamics(self.rates).over(0.0, hours))
        if self._memory is not None:
            self.means = self.home + away[..., 0]
        if np.isfinite(self._turn):
            stays = np.exp(-hours / self._turn)
            weights = self.weights
            self.log_weights = _log(stays * weights + (1.0 - stays) * self.prior
                                    * weights.sum(axis=1, keepdims=True))
        self.unseen = self.unseen + hours

    def widen(self, covariance):
        """Add a covariance, (n, n), for a known event that may have changed the coefficients."""
        self.covariances = self.covariances + covariance

    def set(self, place, sigma):
        """Reset coefficient `place` to 0 with an independent error `sigma`."""
        self.means[..., place] = 0.0
        self.covariances[..., place, :] = 0.0
        self.covariances[..., :, place] = 0.0
        self.covariances[..., place, place] = sigma**2

    def shift(self, by):
        """Move the origin of the coefficients by `by`, shape (n,)."""
        self.home = self.home - by
        self.means = self.means - by

    def observe(self, columns, value, noise, is_star=True):
        """Update with a row.

        Parameters
        ----------
        columns : ndarray, shape (m, n)
            Design: each of its values for unit coefficients.
        value : ndarray, shape (m,)
        noise : ndarray, shape (m,)
            1 sigma.
        is_star : bool
            Whether it may be an outlier, and is counted as a star.
        """
        row = (np.asarray(columns, float), np.asarray(value, float)[:, None],
               np.diag(np.square(np.asarray(noise, float))))
        groups = self._branches(row, is_star)
        branches = [branch for group in groups.values() for branch in group]
        parents, causes, log_weights = zip(*branches)
        before, known = self.means[list(parents)], self.covariances[list(parents)]
        for covariance, cause in zip(known, causes):
            if cause is not None and cause != OUTLIER:
                covariance += self.jumps[cause].covariance
        new = update(before[..., None], known, *row)
        teaches = np.array([cause != OUTLIER for cause in causes])[:, None, None]
        means = np.where(teaches, new.mean[..., 0], before)
        covariances = np.where(teaches[..., None], new.covariance, known)
        ends = np.cumsum([0, *map(len, groups.values())])
        joined = [_joined(np.array(log_weights[low:high]), means[low:high], covariances[low:high])
                  for low, high in zip(ends[:-1], ends[1:])]
        self.histories = list(groups)
        log_weights, self.means, self.covariances = map(np.array, zip(*joined))
        peak = log_weights.max()
        total = peak + np.log(np.exp(log_weights - peak).sum())
        self.log_weights = np.maximum(log_weights - total, _NOTHING)
        self.count += is_star

    def _branches(self, row, is_star):
        """Branches of the histories by what may have happened just before a row.

        Returns
        -------
        dict of tuple of Change to list of (int, int or None, ndarray)
            For each new history the branches merged into it: index of the parent history, cause
            (None: nothing happened) and log weight (r,).
        """
        causes, priors, added = self._causes(row[0], is_star)
        innovation, spread = innovation_of(self.means[..., None], self.covariances, *row)
        wide = spread + added[:, None, None]
        likely = priors[:, None, None] + self.log_weights + _log_density(innovation, wide)
        if is_star:
            causes = [*causes, OUTLIER]
            squares = np.sum(np.square(innovation[..., 0]), axis=-1) / self._outlier_sigma**2
            far = (np.log(self._outliers) - len(row[0]) * np.log(self._outlier_sigma)
                   - 0.5 * squares)
            likely = np.concatenate((likely, (far + self.log_weights)[None]))
        peak = likely.max()
        each = np.exp(likely - peak)
        total = each.sum()
        self.evidence += float(peak + np.log(total))
        likely = likely - (peak + np.log(total))
        each = each.sum(axis=2) / total
        groups, shares = {}, {}
        for way, parent in zip(*np.nonzero(each > _LEAST)):
            history, cause = self.histories[parent], causes[way]
            if cause is not None:
                change = Change(self.count, cause)
                history = history if change in history else (*history, change)
            recent = tuple(c for c in history if c.number > self.count - self._depth)
            groups.setdefault(recent, []).append((parent, cause, likely[way, parent]))
            shares[recent] = shares.get(recent, 0.0) + each[way, parent]
        kept = sorted(groups, key=lambda recent: -shares[recent])[:self._most]
        return {recent: groups[recent] for recent in kept}

    def _causes(self, columns, is_star):
        """Possible causes (None: nothing happened), log priors, and covariance in the row."""
        causes, chances, added = [None], [], [np.zeros((len(columns),) * 2)]
        for number, jump in enumerate(self.jumps):
            side = columns @ jump.shape
            if np.abs(side).max() > 1e-9:
                causes.append(number)
                added.append(jump.sigma**2 * (side @ side.T))
                chances.append(-np.expm1(-jump.per_hour * max(self.unseen[number], _SHORTEST)))
                self.unseen[number] = 0.0
        nothing = 1.0 - sum(chances) - (self._outliers if is_star else 0.0)
        return causes, np.log([max(nothing, 1e-3), *chances]), np.array(added)


def mixture(weights, means, covariances):
    """Mean (..., n) and covariance (..., n, n) of a sum of Gaussians along the first axis.

    Parameters
    ----------
    weights : ndarray, shape (k,) or (k, ...)
        Weights with sum 1.
    means, covariances : ndarray, shapes (k, ..., n) and (k, ..., n, n)
    """
    weights = weights.reshape(weights.shape + (1,) * (means.ndim - weights.ndim))
    mean = (weights * means).sum(axis=0)
    off = means - mean
    return mean, (weights[..., None]
                  * (covariances + off[..., :, None] * off[..., None, :])).sum(axis=0)


def _joined(log_weights, means, covariances):
    """Log weight (r,), mean and covariance of several branches (b, r, ...) merged into one."""
    if len(log_weights) == 1:
        return log_weights[0], means[0], covariances[0]
    peak = log_weights.max(axis=0)
    share = np.exp(log_weights - peak)
    total = share.sum(axis=0)
    return peak + np.log(total), *mixture(share / total, means, covariances)


def _log(weights):
    return np.log(np.maximum(weights, np.exp(_NOTHING)))


def _log_density(innovation, spread):
    """Log density of innovations (..., m, 1) of covariance (..., m, m), without its constant."""
    whitening = whitening_of(spread)
    squares = np.square(whitening @ innovation).sum(axis=(-2, -1))
    return -0.5 * (squares + log_det_of(whitening))
