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

"""Root mean squares, and robust estimates of scatter."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, all_finite

#: 1 / 0.6745: converts a median absolute residual to 1 sigma of Gaussian noise
MAD = 1.4826


class Rms(NamedTuple):
    """Root mean squares on the sky, arcsec, and the number of rows used."""

    x: float
    y: float
    radial: float
    n: int


def rms(*axes):
    """Root mean square of values, or of the length of vectors, in the same unit.

    Parameters
    ----------
    *axes : array_like, shape (n,)
        One array: its RMS. Several: RMS of the root of the sum of their squares.

    Returns
    -------
    float
        NaN without values.
    """
    squares = sum(np.square(values) for values in axes)
    return float(np.sqrt(np.mean(squares))) if np.size(squares) else np.nan


def radial_arcsec(residual, keep):
    """Radial RMS in arcsec of the rows `keep` of residuals of shape (2, n), radians."""
    return rms(*residual[:, keep]) / ARCSEC


def rms_arcsec(x, y):
    """RMS per axis and radial of on-sky offsets.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Radians; rows that are not finite are excluded.

    Returns
    -------
    Rms
        arcsec.
    """
    if not (all_finite(x) and all_finite(y)):
        good = np.isfinite(x) & np.isfinite(y)
        x, y = x[good], y[good]
    n = len(x)
    if n == 0:
        return Rms(np.nan, np.nan, np.nan, 0)
    xx = float(np.dot(x, x)) / n / ARCSEC**2
    yy = float(np.dot(y, y)) / n / ARCSEC**2
    return Rms(xx**0.5, yy**0.5, (xx + yy) ** 0.5, n)


def sigma_of(residual, dof_factor=1.0, axis=None):
    """1-sigma noise from the median absolute residual.

    Parameters
    ----------
    residual : ndarray
    dof_factor : float
        Correction for the degrees of freedom of a fit: sqrt(n / (n - k)).
    axis : int, optional
        As for `numpy.median`.
    """
    size = np.abs(residual)
    size = size.ravel() if axis is None else size.swapaxes(axis, -1)
    first, second = (size.shape[-1] - 1) // 2, size.shape[-1] // 2
    # for two axes of a hundred rows this takes a third of the time of `numpy.median`
    size = np.partition(size, [first, second])
    return MAD * dof_factor * 0.5 * (size[..., first] + size[..., second])
