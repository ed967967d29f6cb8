"""Robust least squares: the weights, the noise they rest on, and the iteration that all share.

A distance is in standard deviations: of one residual, or of both axes of a row together (the
radial distance, of which the Gaussian share beyond u is exp(-u^2 / 2)).
"""

from math import exp

import numpy as np

#: 1 / 0.6745: from the median of the absolute residuals to 1 sigma of Gaussian noise
MAD = 1.4826
#: where Huber's weights set in (Huber 1964). Of the radial distance it has 95.0 % of the
#: efficiency of least squares at Gaussian noise (96.4 % on one axis), as 1.345 has on one axis.
HUBER = 1.5
#: from where the bisquare gives no weight. 95 % efficiency would be 4.685 on one axis and 5.12 of
#: the radial distance; 7 has 98.6 %. Tried on the 80 directions of calibration/data/mmt (error of
#: the fitted model in 1-sigma noise, 5.12 -> 7 -> 9): clean 0.292 -> 0.288 -> 0.287, Student's t
#: of 3 degrees 0.359 -> 0.368 -> 0.384, a fifth of the rows 42 sigma off together 0.33 each, a
#: tenth 8 sigma off 0.33 -> 0.33 -> 0.52; three tenths 42 sigma off break it, 5.12 not. So 7 is
#: the mildest that still holds against a tenth of small outliers.
BISQUARE = 7.0
#: bends of Hampel's three-part weights (Hampel et al. 1986, section 2.6). The bends usual there,
#: near 2, 4 and 8, reject the very rows that an effect of few rows is made of; with these a row
#: counts up to 25 sigma (99.9 % efficiency), and one of degrees of error does not.
HAMPEL = (3.0, 12.0, 25.0)
#: radial distance from which a row is gross: where the bisquare gives none of it any weight
GROSS = BISQUARE


def sigma_of(residual, dof_factor=1.0, axis=None):
    """1-sigma noise from the median of the absolute residuals.

    Parameters
    ----------
    residual : ndarray
    dof_factor : float
        For the freedom that a fit took: sqrt(n / (n - k)).
    axis : int, optional
        As for `numpy.median`.
    """
    return MAD * dof_factor * np.median(np.abs(residual), axis=axis)


def huber(u):
    """Huber's weights of the distances `u`."""
    return HUBER / np.maximum(u, HUBER)


def hampel(u):
    """Hampel's three-part weights of the distances `u`."""
    a, b, c = HAMPEL
    return np.minimum(1.0, a / np.maximum(u, a)) * np.clip((c - u) / (c - b), 0.0, 1.0)


def bisquare(u):
    """Tukey's bisquare (biweight) of the distances `u`."""
    return np.square(np.maximum(1.0 - np.square(u / BISQUARE), 0.0))


def _bisquare_constants(c):
    """What the bisquare does to Gaussian noise on two axes.

    With u^2 = (r_x/s_x)^2 + (r_y/s_y)^2 = 2t, t is exponential, and w = (1 - t/T)^2, T = c^2/2.

    Returns
    -------
    variance : float
        E[w r^2] / E[w] for unit noise.
    inflation : float
        covariance of the estimate = inflation x inverse of the weighted normal matrix.
    """
    top = c * c / 2.0
    moments = [1.0 - exp(-top)]
    for k in range(1, 6):
        moments.append(k * moments[-1] - top**k * exp(-top))

    def mean(*polynomial):  # of a polynomial in q = t / T, times t^0
        return sum(a * moments[k] / top**k for k, a in enumerate(polynomial))

    w = mean(1, -2, 1)
    wt = top * mean(0, 1, -2, 1)
    wwt = top * mean(0, 1, -4, 6, -4, 1)
    slope = mean(1, -4, 3)  # w - 2 q (1 - q)
    return wt / w, wwt / slope**2 * w


#: of `bisquare` of the radial distance at Gaussian noise, see `_bisquare_constants`
BISQUARE_VARIANCE, BISQUARE_INFLATION = _bisquare_constants(BISQUARE)


def reweighted(solve, weigh, fit, most, settled=None):
    """Iteratively reweighted least squares, whatever the solver.

    Stages (Huber's weights, then some that reject) are calls in a row, each from the fit of the
    one before; a noise that is estimated on the way is kept by `weigh`.

    Parameters
    ----------
    solve : callable
        ``solve(weights) -> fit``, least squares with a weight for each row.
    weigh : callable
        ``weigh(fit) -> weights`` by what a fit leaves; None: go no further.
    fit
        To start from.
    most : int
        Solutions, at most.
    settled : callable, optional
        ``settled(fit, before)``: whether the last two agree, which ends it too.

    Returns
    -------
    fit
        The last.
    weights : ndarray or None
        That it was solved with; None if that is `fit` as given.
    """
    weights = None
    for _ in range(most):
        new = weigh(fit)
        if new is None:
            break
        weights, before = new, fit
        fit = solve(weights)
        if settled is not None and settled(fit, before):
            break
    return fit, weights
