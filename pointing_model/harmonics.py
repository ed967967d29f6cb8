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

"""The spherical harmonics of paper 000 (eq. 6-8): 13 coefficients per axis.

The functions of theta are cos^k(theta), k = 0..4, and cos(A) sin(theta) cos^k(theta) and
sin(A) sin(theta) cos^k(theta), k = 0..3, in the paper's order. They are spherical harmonics
(degree <= 4, order <= 1) only if theta is the zenith distance; the paper prints E. Both
interpretations are available:

- ``'zenith'``: theta = z, and the azimuth series gives f_A = delta-A sin z = delta-A cos E,
  which is the offset on the sky;
- ``'printed'``: theta = E, and f_A = delta-A sin E. It has no limit at the horizon.

The series for the elevation gives delta-E in both.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC

INTERPRETATIONS = ('zenith', 'printed')

#: Coefficients per axis. (Eq. 8 has 13 columns; the vectors printed there have 14 entries.)
COUNT = 13
#: degree of the paper's series
DEGREE = 4


def _check(interpretation):
    if interpretation not in INTERPRETATIONS:
        raise ValueError(
            f'unknown interpretation of the harmonics {interpretation!r}; take zenith or '
            'printed')


def count_of(degree):
    """Coefficients per axis of the series up to `degree`; ValueError outside 1 to 4."""
    if degree not in range(1, DEGREE + 1):
        raise ValueError(f'harmonics of degree {degree!r}; take 1 to {DEGREE}')
    return 3 * degree + 1


def names_of(degree=DEGREE):
    """The paper's names of the coefficients of both axes: A0, A1, ..., then B0, B1, ..."""
    return tuple(f'{series}{i}' for series in 'AB' for i in range(count_of(degree)))


def _places(degree):
    """Indices of the coefficients up to `degree` among all 26."""
    count = count_of(degree)
    return np.concatenate((np.arange(count), COUNT + np.arange(count)))


def basis(az, el, interpretation='zenith'):
    """The 13 functions of eq. 6 and 7 of paper 000.

    Parameters
    ----------
    az, el : float or ndarray, shape (n,)
        Catalogue place, radians.
    interpretation : {'zenith', 'printed'}
        Meaning of the paper's E: the zenith distance, or the elevation as printed.

    Returns
    -------
    ndarray, shape (n, 13)

    Raises
    ------
    ValueError
        Unknown interpretation.
    """
    _check(interpretation)
    az, el = np.broadcast_arrays(np.atleast_1d(az), np.atleast_1d(el))
    sin_el, cos_el = np.sin(el), np.cos(el)
    c, s = (sin_el, cos_el) if interpretation == 'zenith' else (cos_el, sin_el)
    out = np.ones((COUNT, len(az)))
    out[1:4] = c, np.cos(az) * s, np.sin(az) * s
    for i in range(4, COUNT):
        out[i] = out[i - 3] * c
    return out.T


def sky_factor(el, interpretation='zenith'):
    """Factor from f_A of eq. 6 to the offset on the sky delta-A cos E.

    Parameters
    ----------
    el : float or ndarray
        Catalogue elevation, radians.
    interpretation : {'zenith', 'printed'}

    Returns
    -------
    float or ndarray
        1 in the zenith interpretation, cot E in the printed one.
    """
    _check(interpretation)
    return np.ones_like(el, dtype=float) if interpretation == 'zenith' else 1.0 / np.tan(el)


def columns_of(degree, az, el, interpretation='zenith'):
    """On-sky offset of each coefficient.

    Parameters
    ----------
    degree : int
    az, el : ndarray, shape (n,)
        Catalogue place, radians.
    interpretation : {'zenith', 'printed'}

    Returns
    -------
    In the order of `names_of`: x and y for unit coefficients.
        In the order of `names_of`: x and y of unit coefficients.
    """
    count = count_of(degree)
    functions = basis(az, el, interpretation).T[:count]
    out = np.zeros((2 * count, 2, len(el)))
    out[:count, 0] = functions * sky_factor(el, interpretation)
    out[count:, 1] = functions
    return out


@dataclass(frozen=True)
class Harmonics:
    """Fitted series of both axes.

    Parameters
    ----------
    interpretation : {'zenith', 'printed'}
    coef_x, coef_y : ndarray, shape (13,)
        A_0..A_12 of eq. 6 and B_0..B_12 of eq. 7, radians.
    covariance : ndarray, shape (26, 26)
        Covariance of A_0..A_12, B_0..B_12, radians^2.

    Raises
    ------
    ValueError
        Unknown interpretation, or a wrong number of coefficients.
    """

    interpretation: str
    coef_x: np.ndarray
    coef_y: np.ndarray
    covariance: np.ndarray

    def __post_init__(self):
        _check(self.interpretation)
        for name, shape, unit in (('coef_x', (COUNT,), ARCSEC), ('coef_y', (COUNT,), ARCSEC),
                                  ('covariance', (2 * COUNT,) * 2, ARCSEC**2)):
            value = np.asarray(getattr(self, name), float)
            if value.shape != shape:
                raise ValueError(f'harmonics need {name} of shape {shape}, not {value.shape}')
            # rounded as the document's decimal numbers are read back
            object.__setattr__(self, name, value / unit * unit)

    @classmethod
    def from_degree(cls, degree, interpretation, p, covariance):
        """The series up to `degree`; all higher coefficients are zero.

        Parameters
        ----------
        degree : int
            1 to 4.
        interpretation : {'zenith', 'printed'}
        p : ndarray, shape (k,)
            Coefficients in the order of `names_of`, radians.
        covariance : ndarray, shape (k, k)
            radians^2.

        Raises
        ------
        ValueError
            See `count_of`.
        """
        at = _places(degree)
        values, joint = np.zeros(2 * COUNT), np.zeros((2 * COUNT, 2 * COUNT))
        values[at], joint[np.ix_(at, at)] = p, covariance
        return cls(interpretation, values[:COUNT], values[COUNT:], joint)

    @property
    def degree(self):
        """Highest degree with a coefficient or variance other than zero, at least 1."""
        there = (self.coef_x != 0.0) | (self.coef_y != 0.0) | (
            np.diag(self.covariance).reshape(2, COUNT) != 0.0).any(axis=0)
        last = int(np.max(np.flatnonzero(there), initial=0))
        return max(1, -(-last // 3))

    @property
    def coefficients(self):
        """A0, ..., B0, ... up to the degree, with standard errors: dict of (value, sigma)."""
        at = _places(self.degree)
        values = np.concatenate((self.coef_x, self.coef_y))[at]
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))[at]
        return {name: (float(v), float(s))
                for name, v, s in zip(names_of(self.degree), values, sigma)}

    @property
    def covariance_of_coefficients(self):
        """Covariance in the order of `coefficients`, radians^2."""
        at = _places(self.degree)
        return self.covariance[np.ix_(at, at)]

    def columns(self, az, el):
        """`columns_of` of its `coefficients`."""
        return columns_of(self.degree, az, el, self.interpretation)

    def moved(self, change, covariance):
        """The series with `change`, shape (k,), rad, added, and with another covariance."""
        at = _places(self.degree)
        p = np.concatenate((self.coef_x, self.coef_y))[at] + change
        return Harmonics.from_degree(self.degree, self.interpretation, p, covariance)

    def offsets(self, az, el):
        """Encoder - catalogue on the sky.

        Parameters
        ----------
        az, el : float or ndarray, shape (n,)
            Catalogue place, radians.

        Returns
        -------
        x, y : ndarray, shape (n,)
            delta-A cos E and delta-E, radians.
        """
        functions = basis(az, el, self.interpretation)
        x = functions @ self.coef_x * sky_factor(np.atleast_1d(el), self.interpretation)
        return x, functions @ self.coef_y

    def variance(self, az, el):
        """Variance of `offsets`.

        Parameters
        ----------
        az, el : float or ndarray, shape (n,)
            Catalogue place, radians.

        Returns
        -------
        x, y : ndarray, shape (n,)
            radians^2.
        """
        functions = basis(az, el, self.interpretation)
        c = self.covariance
        factor = sky_factor(np.atleast_1d(el), self.interpretation)
        x = np.einsum('ni,ij,nj->n', functions, c[:COUNT, :COUNT], functions) * factor**2
        return x, np.einsum('ni,ij,nj->n', functions, c[COUNT:, COUNT:], functions)
