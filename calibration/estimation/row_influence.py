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

"""The influence of rows on a fit: its linearisation, for refits without some rows."""

from typing import NamedTuple

import numpy as np

from .robust import LOSS


class Linearisation(NamedTuple):
    """Columns, residuals and weights of a converged fit, for refits without some rows.

    Without rows S the coefficients move by -N^-1 sum_S J_i' W_i r_i, where N is the normal matrix
    of the rows that stay (Cook and Weisberg 1982, Residuals and Influence in Regression, section
    2.2): exact for a linear fit with given weights.

    Attributes
    ----------
    names : sequence, length k
        Names of the coefficients.
    coefficients : ndarray, shape (k,)
    columns : ndarray, shape (k, 2, n)
    residual : ndarray, shape (2, n)
    weights : ndarray, shape (2, n)
        Weights of values; 0: an excluded row.
    given : bool
        Sigmas are given: the covariance is the inverse normal matrix. Otherwise the variance of
        each axis is estimated.
    consistency, inflation : float
        Corrections for a robust loss, see `least_squares.uncertainty_of`.
    scales : tuple of float
        Scales of x and y by which the loss weights the radial distance of each row; empty: it does
        not.
    """

    names: tuple
    coefficients: np.ndarray
    columns: np.ndarray
    residual: np.ndarray
    weights: np.ndarray
    given: bool = False
    consistency: float = 1.0
    inflation: float = 1.0
    scales: tuple = ()

    @classmethod
    def of(cls, names, found, rows, n, sigmas=None):
        """The linearisation of a fit to two axes.

        Parameters
        ----------
        names : sequence
            Names of all its coefficients, including those held at zero.
        found : estimate.Estimate
        rows : ndarray of int, shape (m,)
            Indices of its rows among all n.
        n : int
        sigmas : ndarray, shape (2m,), optional
            Sigmas given to the fit.

        Returns
        -------
        Linearisation or None
            None if the fit kept no design.
        """
        if found.design is None:
            return None
        fitted, columns = found.undetermined.fitted, np.asarray(found.design)
        if len(columns) != len(fitted):
            return None
        each = found.weights if sigmas is None else (
            found.weights / np.square(sigmas.reshape(2, -1)))
        out = [np.zeros((*shape, 2, n)) for shape in ((len(columns),), (), ())]
        for to, values in zip(out, (columns, found.residual, np.broadcast_to(
                each, (2, len(rows))))):
            to[..., rows] = np.nan_to_num(values).reshape(*to.shape[:-1], len(rows))
        # few rows are tested and kept or rejected, not down-weighted
        weighed = found.robust and not np.isin(found.weights, (0.0, 1.0)).all()
        return cls(tuple(names[i] for i in fitted), found.coefficients[fitted], *out,
                   sigmas is not None, *((LOSS.variance, LOSS.inflation, () if sigmas is not None
                                          else _scales(found)) if weighed else ()))


def _scales(found):
    """Scales of x and y recovered from the weights of an `Estimate`: (r_x / s_x)^2 + ... = u^2."""
    rows = (found.weights > 0.0) & np.isfinite(found.residual).reshape(2, -1).all(axis=0)
    squares = np.square(found.residual.reshape(2, -1)[:, rows])
    size = squares.max(axis=1, initial=1e-300)
    inverse = np.linalg.lstsq((squares / size[:, None]).T,
                              LOSS.squared_distance(found.weights[rows]), rcond=None)[0] / size
    return tuple((1.0 / np.sqrt(inverse)).tolist()) if (inverse > 0.0).all() else ()
