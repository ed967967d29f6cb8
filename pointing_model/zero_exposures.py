"""Exposures from which a zero is set: of Polaris, or of stars that were chosen for it."""

import numpy as np

from .sky.star_catalogue import POLARIS_HIP

#: column of a run: 1 where the observer took the row for a zero, of stars other than Polaris
MARK = 'for_zero'
#: the way of a zero, in words
BY_POLARIS, BY_STARS = 'Polaris', 'stars'


def is_of_polaris(rows):
    """Which rows are exposures of Polaris, ndarray of bool, shape (n,)."""
    return np.asarray(rows['star'] == POLARIS_HIP)


def is_marked(rows):
    """Which rows the observer marked as exposures of stars for a zero.

    Parameters
    ----------
    rows : PointingRun
        Logs from before there was the column `MARK` have none.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return np.nan_to_num(np.asarray(rows.get(MARK, 0.0), dtype=float)) != 0.0


def is_for_zero(rows):
    """Which rows are exposures for a zero: of Polaris, which needs no mark, or marked ones.

    They count in the fit of terms and zeros, and are no stars to split, to leave out or to judge
    by.

    Parameters
    ----------
    rows : PointingRun
        With the column ``star``.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return is_of_polaris(rows) | is_marked(rows)


def way_of(rows):
    """By which way a zero from these exposures is got, in words.

    Parameters
    ----------
    rows : PointingRun
        Exposures for a zero.

    Returns
    -------
    str
        ``Polaris``, ``stars (5)`` with how many different ones, or ``Polaris and stars (5)``.
    """
    polaris = is_of_polaris(rows)
    others = len(np.unique(rows['star'][~polaris]))
    stars = f'{BY_STARS} ({others})' if others else ''
    return ' and '.join(filter(None, [BY_POLARIS if polaris.any() else '', stars]))
