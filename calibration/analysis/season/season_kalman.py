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

"""Terms from night to night: a random walk, scatter of single nights, and what moves them.

Each night's fit shows the level of every term, off by the error of the fit (its covariance as a
whole) and by what is of that night alone; the level walks from night to night and moves with
causes. Harvey 1989, Forecasting, structural time series models and the Kalman filter, chapters 3
and 4: local level with regressors. The filter is that of `estimation.kalman`.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from msg_tools.units import ARCSEC

from ...estimation.dynamics import RandomWalk
from ...estimation.estimate import Estimate
from ...estimation.kalman import (
    ForwardPass,
    Rows,
    forward,
    normalised_innovations,
    shown,
    smoothed,
)

#: bounds of both sigmas, rad and rad in the root of a day
_LEAST, _MOST = 1e-3 * ARCSEC, 1e4 * ARCSEC
#: step of the gradient in the logarithm
_STEP = 1e-4


class TermVariation(NamedTuple):
    """How k terms vary from night to night."""

    walk: np.ndarray  # (k,), of the random walk, rad in the root of a day
    scatter: np.ndarray  # (k,), 1 sigma of what is of one night alone, rad


class NightlyTerms(NamedTuple):
    """The k terms of n nights, and c columns of what moves them."""

    days: np.ndarray  # (n,), not falling
    values: np.ndarray  # (n, k), rad
    covariances: np.ndarray  # (n, k, k), rad^2
    columns: np.ndarray  # (n, k, c), of causes with unit coefficients

    def with_columns(self, more):
        """With more columns, a sequence of (n, k, m)."""
        return self._replace(columns=np.concatenate([self.columns, *more], axis=2))

    def forward(self, walk, scatter):
        """`ForwardPass` with variances of shape (k,), or (p, k) for p hypotheses at once."""
        n, k = self.values.shape
        one_each = np.eye(k)
        noise = (self.covariances.reshape((n,) + (1,) * (np.ndim(scatter) - 1) + (k, k))
                 + scatter[..., None] * one_each)
        return forward(Rows(self.days, [one_each] * n, self.values, noise, self.columns),
                       RandomWalk(walk[..., None] * one_each))


class SeasonPath(NamedTuple):
    """The terms of a season by all of its nights."""

    levels: np.ndarray  # (n, k), at each night with what moves them, rad
    covariances: np.ndarray  # (n, k, k), of them
    innovations: np.ndarray  # (n, k), each night less what those before say, in sigmas; or NaN
    estimate: Estimate  # of the levels at first and of the coefficients of the columns
    passed: ForwardPass


def fit_variation(terms, start=None, restricted=True, term=None):
    """The most likely `TermVariation`, and its log likelihood.

    Parameters
    ----------
    terms : NightlyTerms
    start : TermVariation, optional
        Of a season that is nearly the same.
    restricted : bool
        By REML, which the number of columns does not bend; else the plain one, by which models
        of other columns are compared.
    term : int, optional
        Of this one alone; the others stay as in `start`.
    """
    k = terms.values.shape[1]
    if start is None:
        change = np.median(np.abs(np.diff(terms.values, axis=0)), axis=0) + 0.1 * ARCSEC
        per_day = change / np.sqrt(max(float(np.median(np.diff(terms.days))), 0.1))
        start = TermVariation(0.3 * per_day, 0.5 * change)
    begin = np.clip(np.log(np.concatenate(start)), np.log(_LEAST), np.log(_MOST))
    free = np.arange(2 * k) if term is None else np.array([term, k + term])
    steps = np.vstack([np.zeros(2 * k), _STEP * np.eye(2 * k)[free]])

    def whole(theta):
        out = begin.copy()
        out[free] = theta
        return out

    def value_and_gradient(theta):
        variances = np.exp(2.0 * (whole(theta) + steps))
        value = -terms.forward(variances[:, :k], variances[:, k:]).log_likelihood(restricted)
        return value[0], (value[1:] - value[0]) / _STEP

    found = minimize(value_and_gradient, begin[free], jac=True, method='L-BFGS-B',
                     bounds=[(np.log(_LEAST), np.log(_MOST))] * len(free),
                     options={'maxiter': 200, 'ftol': 1e-9 if term is None else 1e-6})
    return TermVariation(*np.exp(whole(found.x).reshape(2, k))), -float(found.fun)


def season_path(terms, variation):
    """`SeasonPath` of `NightlyTerms` that vary so."""
    passed = terms.forward(*np.square(variation))
    found = passed.estimate()
    levels, covariances = zip(*(
        shown(mean, covariance, step.state, step.columns, found)
        for step, (mean, covariance) in zip(passed.steps, smoothed(passed))))
    return SeasonPath(np.array(levels), np.array(covariances), normalised_innovations(passed),
                      found, passed)


def forecast(path, variation, days_on, columns):
    """Terms of a night to come.

    Parameters
    ----------
    path : SeasonPath
    variation : TermVariation
    days_on : float
        Since the last night.
    columns : ndarray, shape (k, c)
        As of `NightlyTerms`, of that night.

    Returns
    -------
    mean : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
        With what is of one night alone.
    """
    k, last = len(variation.walk), path.passed.steps[-1].update
    mean, covariance = shown(last.mean, last.covariance, np.eye(k),
                             np.hstack([np.zeros((k, k)), columns]), path.estimate)
    return mean, covariance + np.diag(np.square(variation.walk) * max(days_on, 0.0)
                                      + np.square(variation.scatter))
