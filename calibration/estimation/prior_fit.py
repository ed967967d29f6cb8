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

"""Least squares with Gaussian priors of some coefficients, and its marginal likelihood.

Coefficients are free, or have a prior mean and covariance (ridge regression; Robinson 1991,
Statistical Science 6, 15: mixed models). All results follow from one small matrix, the products of
the whitened columns with each other and with the values: another prior needs no pass over the rows.
"""

from functools import cached_property

import numpy as np

#: relative singular value (unit columns) below which a direction is undetermined
RCOND = 1e-5


class PriorFit:
    """The fit.

    Parameters
    ----------
    gram : ndarray, shape (k + 1, k + 1)
        Products of the whitened columns, the values being the last.
    count : int
        Number of values.
    precision : ndarray, shape (k, k)
        Inverse prior covariance; zero for free coefficients.
    mean : ndarray, shape (k,), optional
        Prior mean; zero if not given.
    """

    def __init__(self, gram, count, precision, mean=None):
        self.gram, self.count, self.precision = gram, count, precision
        self.mean = np.zeros(len(precision)) if mean is None else mean

    @cached_property
    def _spectrum(self):
        normal = self.gram[:-1, :-1] + self.precision
        length = np.sqrt(np.maximum(np.diag(normal), 0.0))
        length = np.where(length > 0.0, length, 1.0)
        values, vectors = np.linalg.eigh(normal / np.outer(length, length))
        return values, vectors, length

    @property
    def determined(self):
        """Whether rows and prior determine all coefficients."""
        values = self._spectrum[0]
        return bool(values[0] > RCOND**2 * values[-1])

    @cached_property
    def covariance(self):
        """Covariance of the coefficients, shape (k, k); huge along undetermined directions."""
        values, vectors, length = self._spectrum
        inverse = vectors / np.maximum(values, RCOND**2 * values[-1])
        return (inverse @ vectors.T) / np.outer(length, length)

    @cached_property
    def coefficients(self):
        """Shape (k,)."""
        return self.covariance @ (self.gram[:-1, -1] + self.precision @ self.mean)

    @property
    def sigma(self):
        """Standard errors, shape (k,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def alone(self):
        """Standard errors if all other coefficients were known, shape (k,)."""
        return 1.0 / np.sqrt(np.maximum(np.diag(self.gram[:-1, :-1] + self.precision), 1e-300))

    @property
    def square(self):
        """Residual sum of squares, of the values and of the prior."""
        off = self.gram[-1, -1] + self.mean @ self.precision @ self.mean
        right = self.gram[:-1, -1] + self.precision @ self.mean
        return float(off - right @ self.covariance @ right)

    @property
    def evidence(self):
        """ln of the marginal likelihood, but for the determinants of the noise and the prior."""
        values, _, length = self._spectrum
        log_det = float(np.sum(np.log(np.maximum(values, RCOND**2 * values[-1])))
                        + 2.0 * np.sum(np.log(length)))
        return -0.5 * (self.square + log_det)


def gram_of(columns, values):
    """`PriorFit.gram` of whitened columns, shape (k, m), and values, shape (m,)."""
    both = np.vstack((columns, values))
    return both @ both.T


class MixedFit:
    """Average over fits with given probabilities.

    Parameters
    ----------
    fits : list of PriorFit
        Fits of the same coefficients.
    chances : sequence of float
        Probabilities of the fits, with sum 1.

    Attributes
    ----------
    coefficients, covariance
        See `PriorFit`; the covariance includes the scatter between the fits.
    """

    def __init__(self, fits, chances):
        self.fits, self.chances = fits, np.asarray(chances, float)
        each = np.array([one.coefficients for one in fits])
        self.coefficients = self.chances @ each
        off = each - self.coefficients
        self.covariance = sum(c * one.covariance for c, one in zip(self.chances, fits)) + (
            off.T * self.chances) @ off

    @property
    def determined(self):
        """Whether all fits are determined."""
        return all(one.determined for one in self.fits)

    @property
    def sigma(self):
        """Standard errors, shape (k,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def alone(self):
        """Standard errors if all other coefficients were known, shape (k,)."""
        return np.sqrt(sum(c * one.alone**2 for c, one in zip(self.chances, self.fits)))
