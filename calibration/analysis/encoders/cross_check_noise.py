"""Noise of a witness whose rows resemble their neighbours, made white; the scan for what moved.

Seeing wanders and readings may: the noise is taken as AR(1) in the order of the rows, its
correlation estimated from the night itself by restricted likelihood, beside all that is fitted and
the best candidate, for a step is correlation too. What cannot be told from white noise counts as
white.
"""

import math
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC

from ...estimation.correlated_noise import restricted
from ...estimation.group_columns import GroupColumns, Moves
from ...estimation.step_scan import clipped, robust_fit, scan

#: noise of a reading at least: a count of the incremental encoder (0.0686") / sqrt(12)
LEAST = 0.02 * ARCSEC
#: correlations of neighbours that are tried
_TRIED = np.arange(0.05, 0.96, 0.05)
#: numbers that are whitened at once, of all correlations that are tried
_AT_ONCE = 50_000
#: twice the logarithm of the likelihood ratio from which rows are correlated: 5 %, one-sided
_CLAIMED = 2.71
#: likewise: correlations within 90 % of the likeliest. The largest of them counts, for the
#: candidate beside which it is estimated was chosen because it takes some of it away
_SIGMA = 2.71


class Colour(NamedTuple):
    """Correlation of each row with the one before it, shape (..., n); 0 where there is none before.

    With leading dimensions: as many colours of the same rows.
    """

    rho: np.ndarray

    @property
    def most(self):
        """The largest; of one series, its correlation."""
        return float(self.rho.max(initial=0.0))

    def part(self, rows):
        """Of some rows, of which the first resembles none before it."""
        return Colour(self.rho[rows])

    def white(self, values):
        """Values (n,) or (n, k), a GroupColumns or Moves, whitened; white noise keeps its size.

        Of many colours (..., n) or (..., n, k).

        Rows of a constant variance stay at it: a noise that is estimated from whitened rows is
        that of a row.
        """
        if self.rho.ndim == 1 and not self.rho.any():
            return values
        if isinstance(values, GroupColumns | Moves):
            return values.white(self)
        rho = self.rho if values.ndim == 1 else self.rho[..., None]
        before = np.concatenate([np.zeros_like(values[:1]), values[:-1]])
        return (values - rho * before) / np.sqrt(1.0 - rho**2)


def inflation(rho, count):
    """Variance of the mean of `count` rows in a row, as their scatter gives it, is too small by.

    Of AR(1) rows, exactly (Priestley 1981, Spectral Analysis and Time Series, section 5.3.2).
    """
    if rho <= 0.0 or count < 2:
        return 1.0
    mean = (1.0 + rho) / (1.0 - rho) - 2.0 * rho * (1.0 - rho**count) / (count * (1.0 - rho) ** 2)
    return mean * (count - 1.0) / max(count - mean, 1.0)


def colour_of(design, y, sequence, series=None, most=1.0):
    """How much neighbours resemble each other.

    Parameters
    ----------
    design : ndarray, shape (n, k), or GroupColumns
        All that is fitted. Rows of a sequence are of one group.
    y : ndarray, shape (n,)
        Without outliers.
    sequence : ndarray, shape (n,)
        Number of the sequence of each row: the first row of one has no row before it.
    series : ndarray of int, shape (n,), optional
        Rows with the same number share a correlation; all by default.
    most : float
        Correlation at most.

    Returns
    -------
    Colour
    """
    follows = np.concatenate([[False], sequence[1:] == sequence[:-1]])
    series = np.zeros(len(y), int) if series is None else series
    rho = np.zeros(len(y))
    allowed = _TRIED[:np.searchsorted(_TRIED, most + 1e-9)]
    rest = design.rest if isinstance(design, GroupColumns) else design
    numbers = len(y) * (rest.shape[1] + 1)
    for number in np.unique(series):
        mine = follows & (series == number)
        tried = np.concatenate([[0.0], allowed])[:, None]
        parts = min(math.ceil(tried.size * numbers / _AT_ONCE), len(tried))
        all_ = np.concatenate([restricted_coloured(design, y, np.where(mine, part, rho))
                               for part in np.array_split(tried, parts)])
        if all_.min() < all_[0] - _CLAIMED:
            near = np.flatnonzero(all_[1:] < all_.min() + _SIGMA)
            rho = np.where(mine, allowed[near[-1]], rho)
    return Colour(rho)


def restricted_coloured(design, y, rho, least=LEAST):
    """`restricted` of rows with that correlation to the row before, (..., n): its value, (...)."""
    colour, log_det = Colour(rho), np.log1p(-rho**2).sum(-1)
    if not isinstance(design, GroupColumns):
        return restricted(colour.white(np.column_stack([design, y])), log_det, least)[0]
    white = colour.white(design.beside(y))
    size = np.sqrt(np.einsum('...ij,...ij->...j', white.rest[..., :-1], white.rest[..., :-1]))
    left = white.off(white.rest)
    return restricted(left, log_det + np.log(white.squares()).sum(-1), least, white.groups,
                      size)[0]


class Strongest(NamedTuple):
    """The candidate that chance explains least.

    Attributes
    ----------
    place : int
        Of its column.
    amount, sigma : float
        As robustly fitted, rad (a drift: rad/s).
    probability : float
        Of as much by chance, in any of the candidates.
    """

    place: int
    amount: float
    sigma: float
    probability: float


def strongest(design, y, candidates, limit, sequence, series=None):
    """Add each candidate column alone to a fit of rows that may resemble their neighbours.

    Parameters
    ----------
    design : ndarray, shape (n, k), or GroupColumns
    y : ndarray, shape (n,)
    candidates : ndarray, shape (n, m), or Moves
    limit : float
        Chance, of so many candidates, from which on nothing has moved.
    sequence, series
        As of `colour_of`.

    Returns
    -------
    Strongest or None
        None where nothing has moved.
    """
    moves = isinstance(candidates, Moves)
    count = len(candidates) if moves else candidates.shape[1]
    tame = clipped(design, y)
    p = scan(design, tame, candidates, LEAST).probability * count
    if p.min() >= limit:
        return None  # correlation only makes chance likelier

    def with_candidate(design, candidates, place):
        column = candidates.column(place) if moves else candidates[:, place]
        if isinstance(design, GroupColumns):
            return design.beside(column)
        return np.column_stack([design, column])

    full = with_candidate(design, candidates, int(np.argmin(p)))
    colour = colour_of(full, clipped(full, y), sequence, series)
    white = colour.white(design), colour.white(candidates)
    if colour.rho.any():
        p = scan(white[0], colour.white(tame), white[1], LEAST).probability * count
    best = int(np.argmin(p))
    if p[best] >= limit:
        return None
    fit = robust_fit(with_candidate(*white, best), colour.white(y))
    return Strongest(best, float(fit.coefficients[-1]), float(np.sqrt(fit.covariance[-1, -1])),
                     float(p[best]))
