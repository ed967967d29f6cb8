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

"""Evaluation of an absolute encoder's readings at standard angles, as in paper 001, section 3.

Eqs. 14 to 16 of the paper are those of JJG 100-2003, the Chinese verification regulation for total
stations. It works for the measured angles of any encoder; `TABLE_2_MEASURED` are the paper's.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC

_SECONDS = np.array([3600.0, 60.0, 1.0])
#: paper 001, table 2: standard angle, measured angle (degrees, minutes, seconds)
_TABLE_2 = np.array([
    [0, 0, 0.0, 0, 0, 0.64],
    [15, 39, 7.8, 15, 39, 0.53],
    [31, 18, 15.7, 31, 18, 8.11],
    [46, 57, 23.5, 46, 57, 29.78],
    [62, 36, 31.3, 62, 36, 35.18],
    [78, 15, 39.1, 78, 15, 39.77],
    [93, 54, 47.0, 93, 54, 46.73],
    [109, 33, 54.8, 109, 33, 48.39],
    [125, 13, 2.6, 125, 13, 8.91],
    [140, 52, 10.4, 140, 52, 18.11],
    [156, 31, 18.2, 156, 31, 19.96],
    [172, 10, 26.0, 172, 10, 29.92],
    [187, 49, 33.9, 187, 49, 40.70],
    [203, 28, 41.7, 203, 28, 45.45],
    [219, 7, 49.5, 219, 7, 49.73],
    [234, 46, 57.3, 234, 47, 0.01],
    [250, 26, 5.2, 250, 26, 4.86],
    [266, 5, 13.0, 266, 5, 8.11],
    [281, 44, 20.8, 281, 44, 19.02],
    [297, 23, 28.6, 297, 23, 35.99],
    [313, 2, 36.5, 313, 2, 36.07],
    [328, 41, 44.3, 328, 41, 42.74],
    [344, 20, 52.2, 344, 20, 55.19],
])
TABLE_2_STANDARD = _TABLE_2[:, :3] @ _SECONDS * ARCSEC
TABLE_2_MEASURED = _TABLE_2[:, 3:] @ _SECONDS * ARCSEC


@dataclass(frozen=True)
class Evaluation:
    """Evaluated readings at standard angles; rad.

    Attributes
    ----------
    graduation_errors : ndarray, shape (n,)
        Measured - standard (eq. 14).
    mean, std : float
        Mean of the graduation errors; standard deviation with n - 1 (eq. 16).
    largest, smallest : float
        Largest and smallest absolute graduation error.
    """

    graduation_errors: np.ndarray
    mean: float
    std: float
    largest: float
    smallest: float


def evaluate(measured, standard):
    """Evaluate readings at standard angles (paper 001, eqs. 14 to 16; JJG 100-2003).

    Parameters
    ----------
    measured, standard : array_like, shape (n,)
        rad, at least two; their differences are wrapped to half a turn.

    Returns
    -------
    Evaluation

    Raises
    ------
    ValueError
        Different lengths, fewer than two, or an angle that is not finite.
    """
    measured, standard = np.asarray(measured, dtype=float), np.asarray(standard, dtype=float)
    if measured.ndim != 1 or measured.shape != standard.shape or len(measured) < 2:
        raise ValueError(f'{measured.shape} measured and {standard.shape} standard angles: give '
                         'as many of the one as of the other, at least two')
    bad = ~(np.isfinite(measured) & np.isfinite(standard))
    if bad.any():
        raise ValueError(f'angle {int(np.flatnonzero(bad)[0]) + 1} is not a finite number; '
                         'leave rejected readings out')
    errors = (measured - standard + np.pi) % (2.0 * np.pi) - np.pi
    mean = float(errors.mean())
    directions = errors - mean  # eq. 15
    return Evaluation(
        errors, mean, float(np.sqrt(directions @ directions / (len(errors) - 1))),
        float(np.abs(errors).max()), float(np.abs(errors).min()))


@dataclass(frozen=True)
class HarmonicVerdict:
    """Whether errors at equidistant angles contain harmonics of the turn.

    Attributes
    ----------
    p_values, holm : ndarray, shape (orders,)
        p-values of each harmonic alone (F test), and with Holm's correction for all of them.
    std_without : float
        Standard deviation of the residuals from all harmonics (with n - 1), rad.
    left_out, left_out_without : float
        Leave-one-out RMS error of the mean, and of mean and harmonics, rad.
    """

    p_values: np.ndarray
    holm: np.ndarray
    std_without: float
    left_out: float
    left_out_without: float

    @property
    def found(self):
        """Whether any harmonic is significant at 5 %."""
        return bool(self.holm.min() < 0.05)


def harmonic_verdict(errors, orders=6):
    """Test errors at equidistant angles for harmonics 1 to `orders` of the turn.

    Parameters
    ----------
    errors : array_like, shape (n,)
        At angles i / n of a turn, rad; n > 2 orders + 1.

    Returns
    -------
    HarmonicVerdict

    Raises
    ------
    ValueError
        Too few errors for that many harmonics.
    """
    errors = np.asarray(errors, dtype=float)
    n = len(errors)
    if n <= 2 * orders + 1:
        raise ValueError(f'{n} errors cannot determine {orders} harmonics; give more than '
                         f'{2 * orders + 1}')
    angle = 2.0 * np.pi * np.arange(n) / n
    centred = errors - errors.mean()
    # equidistant angles: constant, cosines and sines are orthogonal
    pairs = np.stack([[np.cos(k * angle), np.sin(k * angle)] for k in range(1, orders + 1)])
    power = 2.0 / n * np.sum((pairs @ centred) ** 2, axis=1)
    total = centred @ centred
    # with two parameters the F test's tail has a closed form
    p_values = (1.0 - power / total) ** (0.5 * (n - 3))
    order = np.argsort(p_values)
    steps = np.minimum(1.0, p_values[order] * (orders - np.arange(orders)))
    holm = np.empty(orders)
    holm[order] = np.maximum.accumulate(steps)
    flat = pairs.reshape(-1, n)
    rest = centred - 2.0 / n * (flat @ centred) @ flat
    leverage = (2 * orders + 1) / n  # the same at every angle
    return HarmonicVerdict(
        p_values, holm, float(np.sqrt(rest @ rest / (n - 1))),
        float(np.sqrt(total / n) / (1.0 - 1.0 / n)),
        float(np.sqrt(rest @ rest / n) / (1.0 - leverage)))


def sigma_interval(std, n):
    """95 % confidence interval of sigma, given the `std` of `n` normally distributed readings."""
    from scipy.special import gammaincinv
    low, high = 2.0 * gammaincinv(0.5 * (n - 1), [0.025, 0.975])  # of chi-square
    return float(std * np.sqrt((n - 1) / high)), float(std * np.sqrt((n - 1) / low))
