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

"""What a solver gives, and the linear problem of its rows that a refit takes."""

from typing import NamedTuple

import numpy as np

from .robust import LOSS
from .undetermined_terms import Undetermined


class Estimate(NamedTuple):
    """What a solver gives: k coefficients of n rows."""

    coefficients: np.ndarray
    covariance: np.ndarray  # (k, k)
    freedom: np.ndarray  # (k,), degrees of freedom of each standard error
    scatter: tuple  # standard deviation of each axis, in the unit of the residual, or in sigmas
    residual: np.ndarray  # (axes * n,), x of all rows, then y; NaN where there is none
    weights: np.ndarray  # (n,), of the rows: 0 to 1
    rank: int
    robust: bool = False  # whether rows were weighed, or where they are few judged
    undetermined: Undetermined | None = None
    singular_values: np.ndarray | None = None  # of the first-order design, descending
    log_likelihood: float | None = None  # restricted, but for a constant
    design: object = None  # (k, axes * n), where it ended, of the coefficients that are not held
    scatter_freedom: tuple = ()  # degrees of freedom of the scatter of each axis; one: of both
    #: of each axis the scatter in sigmas as given, 1 where chance explains that it is another; by
    #: what is above 1 the sigmas were multiplied
    ratios: tuple = (1.0, 1.0)


class Linearisation(NamedTuple):
    """Columns, residuals and weights of a fit where it ended: what a refit without rows takes.

    Without rows S the coefficients move by -N^-1 sum_S J_i' W_i r_i, where N is the normal matrix
    of the rows that stay (Cook and Weisberg 1982, Residuals and Influence in Regression, section
    2.2): exact for a linear fit with given weights.

    Attributes
    ----------
    names : sequence, length k
        Of the coefficients.
    coefficients : ndarray, shape (k,)
    columns : ndarray, shape (k, 2, n)
    residual : ndarray, shape (2, n)
    weights : ndarray, shape (2, n)
        Of values; 0: a row that does not count.
    given : bool
        The covariance is the inverse normal matrix; else the variance of each axis is measured.
    consistency, inflation : float
        Of a robust loss, as in `least_squares.uncertainty_of`.
    scales : tuple of float
        Of x and y, at which the loss weighs the radial distance of each row; none: it does not.
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
        """Of a fit to two axes.

        Parameters
        ----------
        names : sequence
            Of all its coefficients, those that are held too.
        found : estimate.Estimate
            With its design.
        rows : ndarray of int, shape (m,)
            Places of its rows among all n.
        n : int
        sigmas : ndarray, shape (2m,), optional
            As given to it.

        Returns
        -------
        Linearisation or None
            None of a fit that kept no design.
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
        # few rows are judged, and not weighed
        weighed = found.robust and not np.isin(found.weights, (0.0, 1.0)).all()
        return cls(tuple(names[i] for i in fitted), found.coefficients[fitted], *out,
                   sigmas is not None, *((LOSS.variance, LOSS.inflation, () if sigmas is not None
                                          else _scales(found)) if weighed else ()))


def _scales(found):
    """Scales by which the rows of an `Estimate` have their weights: (r_x / s_x)^2 + ... = u^2."""
    rows = (found.weights > 0.0) & np.isfinite(found.residual).reshape(2, -1).all(axis=0)
    squares = np.square(found.residual.reshape(2, -1)[:, rows])
    size = squares.max(axis=1, initial=1e-300)
    inverse = np.linalg.lstsq((squares / size[:, None]).T,
                              LOSS.squared_distance(found.weights[rows]), rcond=None)[0] / size
    return tuple((1.0 / np.sqrt(inverse)).tolist()) if (inverse > 0.0).all() else ()
