"""Terms from night to night as a state that wanders: likelihood, smoothing, forecast.

Each night's fit sees the level of every term, off by the error of the fit (its covariance as a
whole) and by what is of that night alone; the level walks from night to night and moves with
causes. Harvey 1989, Forecasting, structural time series models and the Kalman filter, chapters 3
and 4: local level with regressors, REML by a diffuse start.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from msg_tools.units import ARCSEC

#: sigma of what is not known at first, rad
_WIDE = 1e5 * ARCSEC
#: bounds of both sigmas, rad and rad in the root of a day
_LEAST, _MOST = 1e-3 * ARCSEC, 1e4 * ARCSEC
#: information on a step, of that which a night has, below which other columns hold it
_HELD = 1e-6
#: step of the gradient in the logarithm
_STEP = 1e-4


class Wander(NamedTuple):
    """How the terms go from night to night.

    Attributes
    ----------
    walk : ndarray, shape (k,)
        rad in the root of a day.
    scatter : ndarray, shape (k,)
        1 sigma of what is of one night alone, rad.
    """

    walk: np.ndarray
    scatter: np.ndarray


class Told(NamedTuple):
    """The measurements of a season.

    Attributes
    ----------
    days : ndarray, shape (n,)
        Not falling.
    values : ndarray, shape (n, k)
    covariances : ndarray, shape (n, k, k)
    columns : ndarray, shape (n, k, c)
        What moves the terms, for unit coefficients: the level at first, and causes.
    """

    days: np.ndarray
    values: np.ndarray
    covariances: np.ndarray
    columns: np.ndarray


def levels(count, k):
    """Columns of the level of each term, shape (n, k, k)."""
    return np.broadcast_to(np.eye(k), (count, k, k))


def normal_equations(told, walk, scatter):
    """Products of measurements and columns, each whitened by the filter.

    Parameters
    ----------
    told : Told
    walk, scatter : ndarray, shape (p, k)
        Variances, rad^2 a day and rad^2; p hypotheses at once.

    Returns
    -------
    gram : ndarray, shape (p, 1 + c, 1 + c)
        The first row and column are of the measurements.
    log_det : ndarray, shape (p,)
    """
    n, k = told.values.shape
    data = np.concatenate([told.values[:, :, None], told.columns], axis=2)
    count, index = len(walk), np.arange(k)
    mean = np.zeros((count, k, data.shape[2]))
    cov = np.zeros((count, k, k))
    gram = np.zeros((count, data.shape[2], data.shape[2]))
    log_det = np.zeros(count)
    steps = np.diff(told.days, prepend=told.days[0])
    for i in range(n):
        cov[:, index, index] += walk * steps[i]
        spread = cov + told.covariances[i]
        spread[:, index, index] += scatter
        off = data[i] - mean
        solved = np.linalg.solve(spread, np.concatenate([off, cov], axis=2))
        gram += np.swapaxes(off, 1, 2) @ solved[:, :, :off.shape[2]]
        log_det += np.linalg.slogdet(spread)[1]
        mean = mean + cov @ solved[:, :, :off.shape[2]]
        cov = cov - cov @ solved[:, :, off.shape[2]:]
        cov = 0.5 * (cov + np.swapaxes(cov, 1, 2))
    return gram, log_det


def log_likelihood(gram, log_det, restricted):
    """Of measurements whose columns have any coefficients; by REML or by the best ones.

    Parameters
    ----------
    gram, log_det
        Of `normal_equations`.
    restricted : bool

    Returns
    -------
    ndarray, shape (p,)
    """
    of_columns, across = gram[:, 1:, 1:], gram[:, 1:, :1]
    best = np.linalg.solve(of_columns, across)
    rest = gram[:, 0, 0] - (np.swapaxes(across, 1, 2) @ best)[:, 0, 0]
    out = -0.5 * (log_det + rest)
    return out - 0.5 * np.linalg.slogdet(of_columns)[1] if restricted else out


def step_gains(told, wander):
    """What a step of one term at one night would gain, of all nights and terms at once.

    A step is an impulse on the level that walks: its score and information are those of the
    backward pass of the smoother (de Jong and Penzer 1998, J. Am. Stat. Assoc. 93, 796, section
    3), so that all together cost as much as one filter.

    Parameters
    ----------
    told : Told
        Its columns have any coefficients.
    wander : Wander

    Returns
    -------
    ndarray, shape (n, k)
        Twice the difference of the log likelihoods; 0 where the columns hold the step already.
    """
    n, k = told.values.shape
    size = k + told.columns.shape[2]
    walk, scatter = np.square(wander.walk), np.diag(np.square(wander.scatter))
    mean, cov = np.zeros(size), np.zeros((size, size))
    cov[np.arange(k, size), np.arange(k, size)] = _WIDE**2
    steps, index = np.diff(told.days, prepend=told.days[0]), np.arange(k)
    passed = []
    for i in range(n):
        cov[index, index] += walk * steps[i]
        sees = np.hstack([np.eye(k), told.columns[i]])
        noise = told.covariances[i] + scatter
        inverse = np.linalg.inv(sees @ cov @ sees.T + noise)
        off = told.values[i] - sees @ mean
        gain = cov @ sees.T @ inverse
        keep = np.eye(size) - gain @ sees
        passed.append((sees.T @ inverse @ off, sees.T @ inverse @ sees, keep))
        mean = mean + gain @ off
        cov = keep @ cov @ keep.T + gain @ noise @ gain.T
    score, information = np.zeros(size), np.zeros((size, size))
    out = np.zeros((n, k))
    for i in range(n - 1, -1, -1):
        own, sure, keep = passed[i]
        score = own + keep.T @ score
        information = sure + keep.T @ information @ keep
        alone = 1.0 / np.diag(told.covariances[i] + scatter)  # of one night, had it all of it
        there = np.diag(information)[:k]
        out[i] = np.where(there > _HELD * alone, np.square(score[:k])
                          / np.where(there > 0.0, there, 1.0), 0.0)
    return out


def find_wander(told, start=None, restricted=True, term=None):
    """The most likely `Wander`, and its log likelihood.

    Parameters
    ----------
    told : Told
    start : Wander, optional
        Of a season that is nearly the same.
    restricted : bool
        By REML, which the number of columns does not bend; else the plain one, by which models
        of other columns are compared.
    term : int, optional
        Of this one alone; the others stay as in `start`.
    """
    k = told.values.shape[1]
    if start is None:
        change = np.median(np.abs(np.diff(told.values, axis=0)), axis=0) + 0.1 * ARCSEC
        per_day = change / np.sqrt(max(float(np.median(np.diff(told.days))), 0.1))
        start = Wander(0.3 * per_day, 0.5 * change)
    begin = np.clip(np.log(np.concatenate(start)), np.log(_LEAST), np.log(_MOST))
    free = np.arange(2 * k) if term is None else np.array([term, k + term])
    steps = np.vstack([np.zeros(2 * k), _STEP * np.eye(2 * k)[free]])

    def whole(theta):
        out = begin.copy()
        out[free] = theta
        return out

    def both(theta):
        variances = np.exp(2.0 * (whole(theta) + steps))
        value = -log_likelihood(*normal_equations(told, variances[:, :k], variances[:, k:]),
                                restricted)
        return value[0], (value[1:] - value[0]) / _STEP

    found = minimize(both, begin[free], jac=True, method='L-BFGS-B',
                     bounds=[(np.log(_LEAST), np.log(_MOST))] * len(free),
                     options={'maxiter': 200, 'ftol': 1e-9 if term is None else 1e-6})
    return Wander(*np.exp(whole(found.x).reshape(2, k))), -float(found.fun)


class Smoothed(NamedTuple):
    """A season in hindsight.

    Attributes
    ----------
    levels : ndarray, shape (n, k)
        Of the terms at each night, all nights known, with what moves them; rad.
    covariances : ndarray, shape (n, k, k)
        Of them.
    coefficients, coefficient_covariance : ndarray, shapes (c,), (c, c)
        Of the columns behind the levels.
    innovations : ndarray, shape (n, k)
        Each night less what the nights before say, in sigmas, each term by itself; NaN at first.
    last : ndarray
        Mean of levels and coefficients after the last night.
    last_covariance : ndarray
    """

    levels: np.ndarray
    covariances: np.ndarray
    coefficients: np.ndarray
    coefficient_covariance: np.ndarray
    innovations: np.ndarray
    last: np.ndarray
    last_covariance: np.ndarray


def smoothed(told, wander):
    """Levels and coefficients by a Kalman filter and its smoother (Rauch, Tung and Striebel).

    Parameters
    ----------
    told : Told
        Without the columns of the levels.
    wander : Wander

    Returns
    -------
    Smoothed
    """
    n, k = told.values.shape
    c = told.columns.shape[2]
    size = k + c
    mean, cov = np.zeros(size), np.eye(size) * _WIDE**2
    walk, scatter = np.square(wander.walk), np.diag(np.square(wander.scatter))
    steps = np.diff(told.days, prepend=told.days[0])
    before, after = [], []
    innovations = np.full((n, k), np.nan)
    for i in range(n):
        cov = cov.copy()
        cov[np.arange(k), np.arange(k)] += walk * steps[i]
        before.append((mean, cov))
        sees = np.hstack([np.eye(k), told.columns[i]])
        spread = sees @ cov @ sees.T + told.covariances[i] + scatter
        off = told.values[i] - sees @ mean
        own = np.sqrt(np.diag(spread))
        innovations[i] = np.where(own < 0.1 * _WIDE, off / own, np.nan)
        gain = np.linalg.solve(spread, sees @ cov).T
        mean = mean + gain @ off
        keep = np.eye(size) - gain @ sees
        cov = keep @ cov @ keep.T + gain @ (told.covariances[i] + scatter) @ gain.T
        after.append((mean, cov))
    out_mean, out_cov = [mean], [cov]
    for i in range(n - 2, -1, -1):
        back = np.linalg.solve(before[i + 1][1], after[i][1]).T
        mean = after[i][0] + back @ (mean - before[i + 1][0])
        cov = after[i][1] + back @ (cov - before[i + 1][1]) @ back.T
        out_mean.insert(0, mean)
        out_cov.insert(0, cov)
    sees = [np.hstack([np.eye(k), column]) for column in told.columns]
    return Smoothed(
        np.array([h @ m for h, m in zip(sees, out_mean)]),
        np.array([h @ p @ h.T for h, p in zip(sees, out_cov)]),
        after[-1][0][k:], after[-1][1][k:, k:], innovations, *after[-1])


def forecast(found, wander, days_on, columns):
    """Terms of a night to come.

    Parameters
    ----------
    found : Smoothed
    wander : Wander
    days_on : float
        Since the last night.
    columns : ndarray, shape (k, c)
        As of `Told`, of that night.

    Returns
    -------
    mean : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
        With what is of one night alone.
    """
    k = len(wander.walk)
    sees = np.hstack([np.eye(k), columns])
    cov = sees @ found.last_covariance @ sees.T + np.diag(
        np.square(wander.walk) * max(days_on, 0.0) + np.square(wander.scatter))
    return sees @ found.last, 0.5 * (cov + cov.T)
