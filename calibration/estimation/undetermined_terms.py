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

"""Which coefficients, or directions of coefficients, the rows do not determine.

A direction is undetermined if its singular value (of columns of unit length) is nearly zero: the
coefficients may have any value along it. A coefficient with a component along such a direction is
undetermined. As many coefficients as there are such directions are held at zero, so that the others
carry the signal. The minimum-norm solution instead would spread it over all of them, and put a part
of unknown values into well-determined ones.

A direction along which noise alone changes the columns (`is_bent`) counts as undetermined too.
"""

from typing import NamedTuple

import numpy as np

from .least_squares import TOLERANCE, weighted_solve

#: component of a coefficient along undetermined unit directions from which it is undetermined
SHARE = 1e-3
#: factor that ranks coefficients in `last` lower when choosing which to hold at zero
_INSTEAD = 0.1
#: largest intrinsic nonlinearity: change of the residuals, over the noise of all, by one standard
#: error along the worst direction, that no coefficients can fit (Bates and Watts 1980, J. R. Stat.
#: Soc. B 42, 1: half the intrinsic curvature). Only tested if the relative singular value is below
#: `WEAK`
_BENT, WEAK = 0.3, 0.01
#: rad: standard error of a coefficient along the direction above which also nonlinearity that
#: others can fit matters: 2 of 1000 runs within 0.001 degrees of a circle had terms 5 to 7 sigmas
#: off. The second limit is for directions of only coefficients that are undetermined anyway
_WIDE, _WIDE_OPEN = 0.0175, 0.0044
#: factor on rcond within the kept directions: their design changes with the weights, but the rank
#: must not
INNER = 0.01


class Undetermined(NamedTuple):
    """Undetermined coefficients and directions of a fit.

    Attributes
    ----------
    terms : ndarray of int
        Indices of the undetermined coefficients, ascending.
    fitted : ndarray of int
        Indices of the coefficients not held at zero: the determined ones, and undetermined ones
        that are fitted in place of those held.
    directions : ndarray, shape (m, k)
        Undetermined directions of the coefficients; the largest component of each is 1.
    sizes : ndarray, shape (m,)
        Singular values of these directions, over the largest.
    moves : ndarray, shape (m,)
        Change of the weighted rows along each direction: root of the sum of squares.
    """

    terms: np.ndarray
    fitted: np.ndarray
    directions: np.ndarray
    sizes: np.ndarray
    moves: np.ndarray

    @classmethod
    def of(cls, spectrum, rank, last=None):
        """Undetermined coefficients of a design.

        Parameters
        ----------
        spectrum : least_squares.Spectrum
        rank : int
            Number of determined directions.
        last : sequence of int, optional
            Coefficients held only if no others can be: the zeros of the axes, which should absorb
            all constants. None: a series; none is held.
        """
        k = len(spectrum.s)
        s, vectors = spectrum.s[:k - rank], spectrum.vectors[:, :k - rank]
        directions = (vectors / spectrum.scale[:, None]).T
        largest = directions[np.arange(len(s)), np.abs(directions).argmax(axis=1)]
        facts = (directions / largest[:, None], s / (spectrum.s[-1] or 1.0), s / np.abs(largest))
        if last is None:
            return cls(np.arange(0), np.arange(k), *facts)
        # exactly zero columns are undetermined by themselves: they have length 0 and scale 1
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
        """Combine with an `Undetermined` of the coefficients that are not held.

        Parameters
        ----------
        inner : Undetermined
        basis : ndarray, shape (k, r)
            Directions of all coefficients that are the coefficients of `inner`.
        """
        directions = inner.directions @ basis.T
        largest = np.abs(directions).max(axis=1)
        return Undetermined(
            np.union1d(self.terms, self.fitted[inner.terms]), self.fitted[inner.fitted],
            np.vstack((self.directions, directions / largest[:, None])),
            np.append(self.sizes, inner.sizes), np.append(self.moves, inner.moves / largest))


def is_bent(problem, found, spectrum, by, rank):
    """Whether noise alone moves the coefficients beyond the linear range.

    Takes one standard error to either side along the worst-determined direction, from the point
    where the coefficients have no component along it: a solution that has run along it has other
    columns, which may seem to determine more. The part of the curvature that the columns can fit
    is projected out.

    Parameters
    ----------
    problem, by
        See `gauss_newton`; `by`: weights of the spectrum.
    found : estimate.Estimate
        Fit that includes this direction.
    spectrum : least_squares.Spectrum
    rank : int
        Number of directions fitted.
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
