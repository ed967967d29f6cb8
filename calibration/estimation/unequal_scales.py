"""Do two values of each row scatter differently, and by which of several laws does one scatter?"""

import numpy as np
from scipy.special import ndtr

from .robust import sigma_of

_TINY = 1e-12  # of the scale, below which a value counts as so much


def scale_ratio(first, second, order=None):
    """How many times as much one of two values scatters, and the chance that both do alike.

    By the signed ranks of ln(|first| / |second|), row by row (Wilcoxon 1945, Biometrics 1, 80):
    outliers count no more than others, and what makes a row worse in both counts nothing. Rows that
    resemble their neighbours count as fewer.

    Parameters
    ----------
    first, second : ndarray, shape (n,)
    order : ndarray of int, shape (n,), optional
        Rows in their sequence.

    Returns
    -------
    ratio : float
        Of the robust scales.
    p : float
        Two-sided.
    """
    scales = [max(float(sigma_of(one)), 1e-300) for one in (first, second)]
    x, y = (np.log(np.maximum(np.abs(one), _TINY * scale))
            for one, scale in zip((first, second), scales))
    off = (x - y)[np.arange(len(x)) if order is None else order]
    rank = np.empty(len(off))
    rank[np.argsort(np.abs(off), kind='stable')] = np.arange(1.0, len(off) + 1.0)
    signed = rank * np.sign(off)
    left = signed - signed.mean()
    alike, n = float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-300), len(off)
    # of few rows it is estimated too small (Marriott and Pope 1954, Biometrika 41, 390)
    alike = min(max(alike + (1.0 + 3.0 * alike) / n, 0.0), 0.95)
    variance = float(np.square(rank).sum()) * (1.0 + alike) / (1.0 - alike)
    p = 2.0 * float(ndtr(-abs(signed.sum()) / np.sqrt(variance)))
    return scales[0] / scales[1], min(p, 1.0)


def scale_law(values, factors):
    """How much likelier values scatter with a factor than evenly, as ln of the likelihood ratio.

    Of Laplace's distribution, whose tails hold outliers.

    Parameters
    ----------
    values, factors : ndarray, shape (n,)
        Factors are positive.

    Returns
    -------
    float
        Below zero: evenly.
    """
    size = np.abs(values)
    even = -len(size) * np.log(max(float(np.mean(size)), 1e-300))
    scaled = -len(size) * np.log(max(float(np.mean(size / factors)), 1e-300))
    return float(scaled - np.log(factors).sum() - even)
