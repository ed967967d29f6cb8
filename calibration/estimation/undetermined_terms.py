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

"""When a coefficient, or a direction of coefficients, counts as undetermined by the rows.

With columns of unit length the design has directions in which the coefficients leave no trace in
the rows: their singular values are nearly nothing. Along them a coefficient may have any value,
and one with a share in them is undetermined. As many coefficients as there are such directions are
held at zero, so that the others carry what the rows show; the smallest solution, of which a little
is in every coefficient, would put a part of unknown values into those that are well determined.

A direction along which noise alone leads to other columns (`is_bent`) counts as one of them.
"""

from typing import NamedTuple

import numpy as np

from .least_squares import TOLERANCE, weighted_solve

#: of a unit vector along the directions, from where a coefficient has a share in them
SHARE = 1e-3
#: as large a part as this of what another would determine, and a coefficient is held in its place
_INSTEAD = 0.1
#: of the noise of all residuals, what one standard error along the worst direction bends them by,
#: in ways that no coefficient follows (Bates and Watts 1980, J. R. Stat. Soc. B 42, 1: half the
#: intrinsic curvature); and of the largest singular value, that of a direction which may be so
_BENT, WEAK = 0.3, 0.01
#: rad: a standard error of a coefficient along it from where bends that the others follow matter
#: too: 2 of 1000 runs within 0.001 degrees of a circle had terms 5 to 7 sigmas off; and where it is
#: of none but coefficients that another direction leaves open anyway
_WIDE, _WIDE_OPEN = 0.0175, 0.0044
#: of rcond, within the directions kept: their design changes with the weights, and what was chosen
#: once must not drop out for that
INNER = 0.01


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
        Of the coefficients, that the rows do not determine; the largest number of each is 1.
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


def is_bent(problem, found, spectrum, by, rank):
    """Whether noise alone moves the coefficients to where the columns are others.

    One standard error to either side along the direction that is determined worst, from where
    nothing of it is in the coefficients: what has gone along it has other columns, and may have
    come to where these seem to determine more. What the columns follow of the bend is taken off.

    Parameters
    ----------
    problem, by
        As of `gauss_newton`; weights of that spectrum.
    found : estimate.Estimate
        With this direction.
    spectrum : least_squares.Spectrum
    rank : int
    """
    way, noise = spectrum.vectors[:, -rank], 1.0
    if by is None:
        squares = np.nansum(np.tile(found.weights, 2) * np.square(found.residual))
        noise = float(squares / max(2.0 * found.weights.sum() - rank, 1.0)) ** 0.5
    step = noise / spectrum.s[-rank] * way / spectrum.scale
    open_anyway = np.isin(np.flatnonzero(np.abs(way) > SHARE), found.undetermined.terms).all()
    if np.abs(step).max() > (_WIDE_OPEN if open_anyway else _WIDE):
        return True
    root = 1.0 if by is None else np.sqrt(by)
    p = found.coefficients - way @ (found.coefficients * spectrum.scale) * way / spectrum.scale
    at = [problem.residual(p + side * step) for side in (1.0, -1.0, 0.0)]
    columns = np.nan_to_num(problem.columns()) * root
    bend = np.nan_to_num(0.5 * (at[0] + at[1]) - at[2]) * root
    bend -= weighted_solve(columns, bend, None, INNER * spectrum.s[-rank]
                           / spectrum.s[-1]).p @ columns
    return not float(np.dot(bend, bend)) ** 0.5 < _BENT * max(noise, TOLERANCE)
