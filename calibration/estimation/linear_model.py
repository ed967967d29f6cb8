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

"""Robust linear fits of stacked residuals: x of all rows, then y of all rows.

Both values of a row are always sign-flipped, weighted and held out together.
"""

from dataclasses import dataclass, field

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import sigma_of

from .correlated_noise import CorrelatedNoise, WhiteNoise
from .group_columns import Basis, GroupColumns, orthonormal
from .least_squares import reweighted, weighted_solve
from .memory_likelihood import noise_memory
from .robust import bisquare, hampel, huber

#: part of a (scaled) column that must remain orthogonal to the model: with less the coefficient's
#: sigma is 50 times that of the column alone, and second-order errors decide the result
DISTINCT = 0.02
_RCOND = 1e-5  # relative singular value below which columns are linearly dependent
#: weight above which a row counts: Hampel's is 0.05 at 20.5 standard deviations
LIVE = 0.05


@dataclass
class WeightedFit:
    """A robust weighted fit of some columns: its residuals, weights and noise.

    Attributes
    ----------
    basis : Basis
        Orthonormal basis of the whitened columns.
    noise : WhiteNoise or CorrelatedNoise
        Noise that whitens the rows.
    residual : ndarray, shape (2n,)
        Whitened residuals.
    left : ndarray, shape (2n,), or callable
        `raw`, or a function that returns it, for it is rarely needed.
    weights : ndarray, shape (n,)
        Robust weights, 0 to 1.
    scale : ndarray, shape (2,)
        Robust noise of x and y, radians (in sigmas, if these were given).
    memory : tuple of AxisNoise
        Correlated noise of x and y; empty: white.
    known : dict
        Cache of results computed from the fit, for a search returns to earlier fits.
    """

    basis: Basis
    noise: object
    residual: np.ndarray
    left: object
    weights: np.ndarray
    scale: np.ndarray
    memory: tuple = ()
    known: dict = field(default_factory=dict, init=False, repr=False)

    @property
    def n(self):
        """Number of rows."""
        return len(self.weights)

    @property
    def raw(self):
        """Residuals, radians, shape (2n,)."""
        if callable(self.left):
            self.left = self.left()
        return self.left


def weighted_fit(columns, b, inverse_sigma=None, weights=None, final=False, trusted=None):
    """Robust least squares of `b` on `columns`, with white noise.

    First Huber's, then Hampel's weights of the radial distance, scaled by the median absolute
    residual; then each axis gets its own variance. Hampel's weight is above zero up to 25 standard
    deviations: a few outliers close together may be the effect that is looked for.

    Parameters
    ----------
    columns : GroupColumns
    b : ndarray, shape (2n,)
        Radians.
    inverse_sigma : ndarray, shape (2n,), optional
    weights : ndarray, shape (n,), optional
        Starting weights, from a similar fit.
    final : bool
        Bisquare weights (zero from 7 standard deviations) in place of Hampel's, as in the direct
        solver: the search is over.
    trusted : ndarray of int, shape (n,), optional
        1: rows that keep full weight, however large their residual; -1: rows without weight.

    Returns
    -------
    WeightedFit
    """
    n = len(b) // 2
    given = np.ones(2 * n) if inverse_sigma is None else inverse_sigma
    least = ARCSEC if inverse_sigma is None else 1.0  # unit of the floors of the noise
    last = bisquare if final else hampel
    steps = [None] + [huber] * 6 + [last] * 5 if weights is None else [last] * 4
    # an orthonormal basis, so that no iteration has to handle nearly dependent columns again
    columns = columns.quickest()
    if not columns.groups:
        columns = GroupColumns.alone(orthonormal(columns.common))
    design, todo = columns if columns.groups else columns.common, iter(steps)
    w, scale = np.ones(n) if weights is None else weights, np.ones(2)

    def root():
        return given * (np.sqrt(w) / scale[:, None]).ravel()

    def solve(_):
        return weighted_solve(design, b, np.square(root()), _RCOND)

    def weigh(found):
        nonlocal w, scale
        step, standard = next(todo), (found.residual * given).reshape(2, n)
        dof = np.sqrt(2 * n / max(2 * n - found.rank, 1))
        if step is not None:
            middle = np.maximum(sigma_of(standard, dof, axis=1), 1e-6 * least)
            w = step(np.hypot(*(standard / middle[:, None])))
            if trusted is not None:
                w = np.where(trusted == 0, w, trusted > 0)
        total = max(float(w.sum()), 1.0)
        scale = np.maximum(np.sqrt((w * standard**2).sum(axis=1) / total) * dof, 1e-9 * least)
        return w

    found, _ = reweighted(solve, weigh, solve(w), len(steps))
    noise = WhiteNoise(root())
    return WeightedFit(columns.basis(noise), noise, noise.whiten(found.residual), found.residual,
                       w, scale)


def memory_of(fit, columns, sequence):
    """`noise_memory` of a white-noise fit of some columns."""
    # from the residuals: the same as from the data, for the columns are projected out anyway
    return noise_memory(sequence, fit.noise.root, fit.scale, columns, fit.raw)


def with_memory(fit, columns, b, sequence, memory):
    """A white-noise fit redone with correlated noise and the same weights.

    Parameters
    ----------
    fit : WeightedFit
        Fit with white noise.
    columns : GroupColumns
    b : ndarray, shape (2n,)
    sequence : Sequence
    memory : tuple of AxisNoise
        Noise of x and y.

    Returns
    -------
    WeightedFit
    """
    noise = CorrelatedNoise.beside(fit.noise, fit.scale, sequence, memory)
    basis = columns.quickest().basis(noise)
    return WeightedFit(basis, noise, basis.off(noise.whiten(b)),
                       lambda: columns.left_of(b, noise), fit.weights, fit.scale, memory)
