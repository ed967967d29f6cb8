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

"""Robust losses, and robust comparison of the scatter of two values of a row.

A loss weights a row by its distance from the fit, in standard deviations: of one residual, or of
both axes together (the radial distance; for Gaussian noise the fraction exp(-u^2 / 2) is beyond
u). A new loss is a weight function here; fits use `LOSS`.
"""

from math import erfc
from typing import NamedTuple

import numpy as np

from pointing_model.rms import sigma_of

#: distance from which Huber's weights decrease (Huber 1964). For the radial distance its efficiency
#: at Gaussian noise is 95.0 % of least squares (96.4 % on one axis), as that of 1.345 on one axis.
HUBER = 1.5
#: distance from which the bisquare weight is zero. 95 % efficiency would be 4.685 on one axis and
#: 5.12 for the radial distance; 7 has 98.6 %. Tried on the 80 directions of calibration/data/mmt
#: (error of the fitted model in 1-sigma noise, 5.12 -> 7 -> 9): clean 0.292 -> 0.288 -> 0.287,
#: Student's t of 3 degrees 0.359 -> 0.368 -> 0.384, a fifth of the rows 42 sigma off together 0.33
#: each, a tenth 8 sigma off 0.33 -> 0.33 -> 0.52; three tenths 42 sigma off break it, but not
#: 5.12. So 7 is the mildest that still resists a tenth of small outliers.
BISQUARE = 7.0
#: corners of Hampel's three-part weights (Hampel et al. 1986, section 2.6). The usual corners, near
#: 2, 4 and 8, reject the very rows that show an effect of few rows; with these a row has weight up
#: to 25 sigma (99.9 % efficiency), and one with an error of degrees has none.
HAMPEL = (3.0, 12.0, 25.0)
#: radial distance of a gross outlier: where its bisquare weight is zero
GROSS = BISQUARE
#: largest distance in a table of weights, and its number of steps
_FARTHEST, _STEPS = 14.0, 28_000
_TINY = 1e-12  # least absolute value, over the scale, before the logarithm


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


class Loss(NamedTuple):
    """A robust loss of the radial distance.

    Attributes
    ----------
    weights : callable
        Weights of distances u. They fall faster than 1 / u^2, so that outliers do not inflate the
        noise either.
    variance : float
        Variance of the weighted residuals for unit Gaussian noise: E[w r^2] / E[w].
    inflation : float
        Covariance of the estimate over the inverse of the weighted normal matrix.
    """

    weights: object
    variance: float
    inflation: float

    @classmethod
    def of(cls, weights):
        """Loss of a weight function, with its constants for Gaussian noise on two axes."""
        u = np.arange(5e-4, 9.0, 1e-3)
        w, chance = weights(u), u * np.exp(-0.5 * u**2) * 1e-3
        square = 0.5 * u**2  # mean square of one axis
        # E[w r^2] is the mean slope of w r too (Stein's identity)
        total, slope = chance @ w, chance @ (w * square)
        return cls(weights, float(slope / total),
                   float(chance @ (w**2 * square) / slope**2 * total))

    def table(self, count):
        """The distance at which weights vanish (or `_FARTHEST`), and a table of weights up to it.

        Returns
        -------
        reach : float
        weights : ndarray, shape (count,)
            At even steps from 0 to `reach`.
        """
        far = np.linspace(0.0, _FARTHEST, _STEPS + 1)
        gone = self.weights(far) <= 0.0
        reach = float(far[int(np.argmax(gone))]) if gone.any() else _FARTHEST
        return reach, self.weights(np.linspace(0.0, reach, count))

    def squared_distance(self, weights):
        """u^2 from weights above 0, same shape."""
        reach, table = self.table(_STEPS)
        u = np.linspace(0.0, reach, _STEPS)
        return np.interp(weights, table[::-1], np.square(u[::-1]))


#: the loss of fits
LOSS = Loss.of(bisquare)


def scale_ratio(first, second, order=None):
    """Ratio of the scatter of two values, and p for equal scatter.

    By a signed-rank test of ln(|first| / |second|), row by row (Wilcoxon 1945, Biometrics 1, 80):
    outliers have no more influence than other rows, and errors common to both cancel. Correlated
    neighbours count as fewer rows.

    Parameters
    ----------
    first, second : ndarray, shape (n,)
    order : ndarray of int, shape (n,), optional
        Row indices in order of time.

    Returns
    -------
    ratio : float
        Ratio of the robust scales.
    p : float
        Two-sided.
    """
    scales = [max(float(sigma_of(one)), 1e-300) for one in (first, second)]
    x, y = (np.log(np.maximum(np.abs(one), _TINY * scale))
            for one, scale in zip((first, second), scales))
    off = (x - y)[np.arange(len(x)) if order is None else order]
    rank = np.empty(len(off))
    rank[np.argsort(np.abs(off), kind='stable')] = np.arange(1.0, len(off) + 1.0)
    signed = rank * np.sign(off)
    left = signed - signed.mean()
    alike, n = float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-300), len(off)
    # corrects the bias with few rows (Marriott and Pope 1954, Biometrika 41, 390)
    alike = min(max(alike + (1.0 + 3.0 * alike) / n, 0.0), 0.95)
    variance = float(np.square(rank).sum()) * (1.0 + alike) / (1.0 - alike)
    return scales[0] / scales[1], erfc(abs(signed.sum()) / np.sqrt(2.0 * variance))


def scale_law(values, factors):
    """ln of the likelihood ratio of scatter proportional to a factor over constant scatter.

    For the Laplace distribution, whose tails allow outliers.

    Parameters
    ----------
    values, factors : ndarray, shape (n,)
        Factors are positive.

    Returns
    -------
    float
        Below zero: constant scatter is more likely.
    """
    size = np.abs(values)
    even = -len(size) * np.log(max(float(np.mean(size)), 1e-300))
    scaled = -len(size) * np.log(max(float(np.mean(size / factors)), 1e-300))
    return float(scaled - np.log(factors).sum() - even)
