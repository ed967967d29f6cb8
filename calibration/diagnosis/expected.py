"""The error to be expected on fresh stars, as an interval that can be wrong in the open."""

import numpy as np

from msg_tools.units import ARCSEC

#: the chance with which the interval holds the RMS of many fresh stars of the same night
CONFIDENCE = 0.9
#: stretches that stand for the night: rows of one share what rows close in time share
_BLOCKS = 10
_FRESH = 100  # stars that it is the RMS of
#: part of the mean square of rows left out that is white at least, however much wanders
_STILL = 0.1
_STANDS = np.zeros(1000)  # draws of a night in which nothing wanders


def expected_error(residual, keep, order, rng, ahead=_STANDS, among=0.0):
    """RMS of fresh stars, from rows that neither the fit nor the choice has seen.

    The squares of rows left out are averaged over stretches of the night; the error of their mean
    is that of the jackknife over the stretches, on a logarithmic scale (Efron 1982, The Jackknife,
    the Bootstrap and Other Resampling Plans, chapter 3), with Student's t. Where the zero wanders
    its part is what simulated nights have after their last row.

    Parameters
    ----------
    residual : ndarray, shape (2, n)
        Of rows left out, the choice repeated, radians.
    keep : ndarray of bool, shape (n,)
        Without the outliers.
    order : ndarray of int, shape (n,)
        Rows as they were observed.
    rng : numpy.random.Generator
    ahead, among : ndarray, shape (b,), and float
        As of `unexplained.ahead`; by default nothing wanders.

    Returns
    -------
    dict
        ``rms_arcsec`` (the median), ``low_arcsec``, ``high_arcsec`` and ``confidence``.
    """
    squares = np.square(residual).sum(axis=0)
    rows = order[keep[order]]
    blocks = np.array_split(squares[rows], min(_BLOCKS, max(len(rows) // 3, 2)))
    sums, counts = np.array([b.sum() for b in blocks]), np.array([len(b) for b in blocks])
    mean = sums.sum() / counts.sum()
    without = np.log((sums.sum() - sums) / (counts.sum() - counts))
    k = len(blocks)
    sigma = np.sqrt((k - 1) / k * np.square(without - without.mean()).sum())
    # of normal noise the squares scatter at least so much, here and there
    sigma = np.hypot(max(sigma, np.sqrt(1.0 / counts.sum())), np.sqrt(1.0 / _FRESH))
    still = max(mean - among, _STILL * mean)
    drawn = still * np.exp(sigma * rng.standard_t(k - 1, len(ahead))) + ahead
    tail = 0.5 - 0.5 * CONFIDENCE
    low, middle, high = np.sqrt(np.quantile(drawn, (tail, 0.5, 1.0 - tail))) / ARCSEC
    return {'rms_arcsec': float(middle), 'low_arcsec': float(low), 'high_arcsec': float(high),
            'confidence': CONFIDENCE}
