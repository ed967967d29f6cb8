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

"""Are residuals of a fit correlated with those of the row before? The Durbin-Watson test.

Durbin and Watson 1950, Biometrika 37, 409: with the mean and variance of the lag-1 correlation of
residuals if the noise is white, which depend on the fitted columns.
"""

import math

import numpy as np


def lag_correlation(residual, columns, follows):
    """Lag-1 correlation of the residuals of each axis, and its p under white noise.

    Parameters
    ----------
    residual : ndarray, shape (2, n)
        Residuals over their noise, in the order of the rows.
    columns : ndarray, shape (k, 2, n)
        Fitted columns, weighted as in the fit.
    follows : ndarray of bool, shape (n - 1,)
        Whether a row and the next are of one run.

    Returns
    -------
    list of tuple of float
        For each axis the correlation less its mean under white noise, and the one-sided p.
    """
    k, _, n = columns.shape
    basis, s, _ = np.linalg.svd((columns / np.maximum(
        np.linalg.norm(columns, axis=(1, 2)), 1e-300)[:, None, None]).reshape(k, -1).T,
        full_matrices=False)
    basis = basis[:, s > 1e-6 * s.max(initial=0.0)].reshape(2, n, -1)

    def beside(values):
        """Half the sum of the rows before and after, where these are of the same run."""
        out = np.zeros_like(values)
        out[1:] += 0.5 * (values[:-1].T * follows).T
        out[:-1] += 0.5 * (values[1:].T * follows).T
        return out

    found = []
    for values, own in zip(residual, basis):
        free = n - np.square(own).sum()
        if free < 3.0 or not values.any():
            found.append((0.0, 1.0))
            continue
        mean = -np.sum(own * beside(own)) / free
        across = beside(own) - mean * own
        spread = 0.5 * follows.sum() + mean**2 * n - 2.0 * np.square(across).sum() + np.square(
            own.T @ across).sum()
        beyond = float(values @ beside(values) / (values @ values) - mean)
        deviation = math.sqrt(max(2.0 * spread, 1e-300)) / free
        found.append((beyond, 0.5 * math.erfc(beyond / deviation / math.sqrt(2.0))))
    return found
