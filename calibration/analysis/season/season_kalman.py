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

"""Terms from night to night: a random walk, scatter of single nights, and causes of changes.

Each night's fit measures the level of every term with the error of the fit (full covariance) and an
independent scatter of that night. The level is a random walk plus regressors for the causes: a
local level model with regressors (Harvey 1989, Forecasting, structural time series models and the
Kalman filter, chapters 3 and 4). The filter is that of `estimation.kalman`.
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

#: bounds of both sigmas, rad and rad/sqrt(day)
_LEAST, _MOST = 1e-3 * ARCSEC, 1e4 * ARCSEC
#: finite-difference step of the gradient, in the logarithm
_STEP = 1e-4


class TermVariation(NamedTuple):
    """Variation of k terms from night to night."""

    walk: np.ndarray  # (k,), random walk, rad/sqrt(day)
    scatter: np.ndarray  # (k,), 1 sigma of the independent scatter of each night, rad


class NightlyTerms(NamedTuple):
    """The k terms of n nights, and c columns of causes."""

    days: np.ndarray  # (n,), not decreasing
    values: np.ndarray  # (n, k), rad
    covariances: np.ndarray  # (n, k, k), rad^2
    columns: np.ndarray  # (n, k, c), changes by causes with unit coefficients

    def with_columns(self, more):
        """The same with more columns, a sequence of (n, k, m)."""
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
    """The smoothed terms of a season."""

    levels: np.ndarray  # (n, k), at each night, including causes, rad
    covariances: np.ndarray  # (n, k, k), of the levels
    innovations: np.ndarray  # (n, k), each night minus its prediction, in sigmas; or NaN
    estimate: Estimate  # of the initial levels and the coefficients of the columns
    passed: ForwardPass


def fit_variation(terms, start=None, restricted=True, term=None):
    """The maximum likelihood `TermVariation`, and its log-likelihood.

    Parameters
    ----------
    terms : NightlyTerms
    start : TermVariation, optional
        Initial values, from a similar problem.
    restricted : bool
        True: REML, which is not biased by the number of columns. False: plain maximum likelihood,
        with which models with different columns are compared.
    term : int, optional
        Fit this term only; the others stay as in `start`.
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
    """`SeasonPath` of `NightlyTerms` with a given variation."""
    passed = terms.forward(*np.square(variation))
    found = passed.estimate()
    levels, covariances = zip(*(
        shown(mean, covariance, step.state, step.columns, found)
        for step, (mean, covariance) in zip(passed.steps, smoothed(passed))))
    return SeasonPath(np.array(levels), np.array(covariances), normalised_innovations(passed),
                      found, passed)


def forecast(path, variation, days_on, columns):
    """Predict the terms of a future night.

    Parameters
    ----------
    path : SeasonPath
    variation : TermVariation
    days_on : float
        Days since the last night.
    columns : ndarray, shape (k, c)
        Columns of that night, as in `NightlyTerms`.

    Returns
    -------
    mean : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
        Including the scatter of a single night.
    """
    k, last = len(variation.walk), path.passed.steps[-1].update
    mean, covariance = shown(last.mean, last.covariance, np.eye(k),
                             np.hstack([np.zeros((k, k)), columns]), path.estimate)
    return mean, covariance + np.diag(np.square(variation.walk) * max(days_on, 0.0)
                                      + np.square(variation.scatter))
