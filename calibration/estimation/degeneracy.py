"""Which coefficients the stars do not determine, decided once for all fits.

With columns of unit length the design has directions in which the coefficients leave no trace in
the rows: their singular values are nearly nothing. Along them a coefficient may have any value,
and one with a share in them cannot be told. As many coefficients as there are such directions are
held at zero, so that the others carry what the rows show; the smallest solution, of which a little
is in every coefficient, would put a part of unknown values into those that are well determined.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC

#: of a unit vector along the directions, from where a coefficient has a share in them
SHARE = 1e-3
#: as large a part as this of what another would tell, and a coefficient is held in its place
_INSTEAD = 0.1
#: in the place of a standard error
WORD = 'undetermined'


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


def undetermined_lines(result):
    """What people must know of terms that the stars do not determine; nothing of other fits.

    Parameters
    ----------
    result : FitResult

    Returns
    -------
    list of str
    """
    return said_of_open(result.undetermined, dict(zip(result.names, result.coefficients)))


def said_of_open(names, values):
    """The same of the names of the undetermined and the values of all."""
    if not names:
        return []
    held = [name for name in names if values[name] == 0.0]
    carry = [name for name in names if values[name] != 0.0]
    text = f'undetermined by these stars: {", ".join(names)}'
    if held and carry:
        text += (f'. {", ".join(held)} {_are(held)} held at zero, and {", ".join(carry)} '
                 f'{"stands" if len(carry) == 1 else "stand"} for the sum of all of them here')
    elif held:
        text += '; held at zero'
    return [text + '. The model holds near these stars alone: observe other parts of the sky']


def _are(names):
    return 'is' if len(names) == 1 else 'are'


def raised_lines(result, run=None):
    """What people must know of sigmas that were not taken as they are given.

    Parameters
    ----------
    result : FitResult
    run : PointingRun, optional
        With the lines of its file.
    """
    return [f'{_place(run, one["row"])}: sigma {one["axis"]} {one["given"] / ARCSEC:.3g}″ is far '
            f'below the others\'; taken as {one["taken"] / ARCSEC:.3g}″, a fifth of their median'
            for one in result.raised]


def _place(run, row):
    if run is None or run.meta.get('lines') is None:
        return f'row {row}'
    return f'line {run.lines[row]}'
