"""Rows of one star within minutes: they are left out together."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.effects.base import arcsec
from pointing_model.rms import rms

#: rows of one star: so many rows, seconds and radians apart at most, beside the sky's own turning
_LAGS, _MINUTES, _PLACE, _SIDEREAL = 6, 900.0, 60.0 * ARCSEC, 7.3e-5
#: s between two rows of one star, at most, where rows have no times
_SOON = 60.0
_NAMED = 4  # stars that stand twice, that are named


def repeats(context, position, run, timed):
    """Number of the star of each row; the same again within minutes."""
    order = np.lexsort((position, run))
    place = context.direction()[:, order]
    position, run = position[order], run[order]
    first = np.arange(len(order))
    for lag in range(1, min(_LAGS, len(order) - 1) + 1):
        passed = position[lag:] - position[:-lag] if timed else np.full(len(order) - lag, _SOON)
        apart = np.linalg.norm(place[:, lag:] - place[:, :-lag], axis=0)
        same = (run[lag:] == run[:-lag]) & (passed < _MINUTES) & (
            apart < _PLACE + _SIDEREAL * passed)
        first[lag:] = np.where(same, np.minimum(first[lag:], first[:-lag]), first[lag:])
    out = np.empty(len(order), int)
    out[order] = first
    return out


def repeats_sentence(group, lines, residual, word='row'):
    """Which rows are of one place, and by how much they differ; '' where there are none, or many.

    Parameters
    ----------
    group : ndarray of int, shape (n,)
        As `repeats` gives it.
    lines : ndarray, shape (n,)
        What the rows are called by.
    residual : ndarray, shape (2, n)
        What is left, radians.
    word : {'row', 'line'}

    Returns
    -------
    str
    """
    pairs = [np.flatnonzero(group == g) for g, count in zip(*np.unique(
        group, return_counts=True)) if count > 1]
    if not 0 < len(pairs) <= _NAMED:
        return ''
    said = '; '.join(' and '.join(str(lines[i]) for i in rows) for rows in pairs)
    off = np.concatenate([residual[:, rows[1:]] - residual[:, rows[:-1]] for rows in pairs], axis=1)
    return (f'{word}s {said} are of one place, a star measured again: they are left out together, '
            'and what is left of them differs by '
            f'{arcsec(float(np.hypot(*(rms(one) for one in off))) / ARCSEC)}, which tells how well '
            'a star is centred')
