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

"""What a solver gives, and which coefficients the rows do not determine.

With columns of unit length the design has directions in which the coefficients leave no trace in
the rows: their singular values are nearly nothing. Along them a coefficient may have any value,
and one with a share in them cannot be told. As many coefficients as there are such directions are
held at zero, so that the others carry what the rows show; the smallest solution, of which a little
is in every coefficient, would put a part of unknown values into those that are well determined.
"""

from typing import NamedTuple

import numpy as np

from .robust import LOSS

#: of a unit vector along the directions, from where a coefficient has a share in them
SHARE = 1e-3
#: as large a part as this of what another would tell, and a coefficient is held in its place
_INSTEAD = 0.1


class Undetermined(NamedTuple):
    """What a fit leaves open.

    Attributes
    ----------
    terms : ndarray of int
        Places of the coefficients that are undetermined, ascending.
    fitted : ndarray of int
        Places of those that are not held at zero: what is determined, and those undetermined ones
        that carry the rest of them.
    directions : ndarray, shape (m, k)
        Of the coefficients, in which the rows tell nothing; the largest number of each is 1.
    sizes : ndarray, shape (m,)
        Singular values of these directions, over the largest.
    moves : ndarray, shape (m,)
        By how much a direction moves the weighted rows: the root of the sum of squares.
    """

    terms: np.ndarray
    fitted: np.ndarray
    directions: np.ndarray
    sizes: np.ndarray
    moves: np.ndarray

    @classmethod
    def of(cls, spectrum, rank, last=None):
        """Of a design.

        Parameters
        ----------
        spectrum : least_squares.Spectrum
        rank : int
            Directions that are determined.
        last : sequence of int, optional
            Coefficients that are held only where no others can be: the zeros of the axes, in which
            all that is constant belongs. None: a series, of which none is held.
        """
        k = len(spectrum.s)
        s, vectors = spectrum.s[:k - rank], spectrum.vectors[:, :k - rank]
        directions = (vectors / spectrum.scale[:, None]).T
        largest = directions[np.arange(len(s)), np.abs(directions).argmax(axis=1)]
        facts = (directions / largest[:, None], s / (spectrum.s[-1] or 1.0), s / np.abs(largest))
        if last is None:
            return cls(np.arange(0), np.arange(k), *facts)
        # exactly zero columns are nobody's: they have the length 0, and the scale 1
        terms = np.flatnonzero(np.sum(np.square(vectors), axis=1) > SHARE**2)
        held, left = [], vectors.copy()
        likes = np.ones(k)
        likes[list(last)] = _INSTEAD
        for _ in range(k - rank):  # a QR decomposition with pivots
            lengths = np.linalg.norm(left, axis=1)
            at = int(np.argmax(lengths * likes))
            held.append(at)
            way = left[at] / lengths[at]
            left = left - np.outer(left @ way, way)
        return cls(terms, np.setdiff1d(np.arange(k), held), *facts)

    def more(self, inner, basis):
        """With what is undetermined of the coefficients that are not held, an `Undetermined`.

        Parameters
        ----------
        inner : Undetermined
        basis : ndarray, shape (k, r)
            Of the coefficients, those of `inner`.
        """
        directions = inner.directions @ basis.T
        largest = np.abs(directions).max(axis=1)
        return Undetermined(
            np.union1d(self.terms, self.fitted[inner.terms]), self.fitted[inner.fitted],
            np.vstack((self.directions, directions / largest[:, None])),
            np.append(self.sizes, inner.sizes), np.append(self.moves, inner.moves / largest))


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
