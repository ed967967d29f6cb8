"""Rows of one star within minutes: they are left out together."""

import numpy as np

from msg_tools.units import ARCSEC

#: rows of one star: so many rows, seconds and radians apart at most, beside the sky's own turning
_LAGS, _MINUTES, _PLACE, _SIDEREAL = 6, 900.0, 60.0 * ARCSEC, 7.3e-5


def repeats(context, position, run, timed):
    """Number of the star of each row; the same again within minutes."""
    order = np.lexsort((position, run))
    place = context.direction()[:, order]
    position, run = position[order], run[order]
    first = np.arange(len(order))
    for lag in range(1, min(_LAGS, len(order) - 1) + 1):
        passed = position[lag:] - position[:-lag] if timed else np.zeros(len(order) - lag)
        apart = np.linalg.norm(place[:, lag:] - place[:, :-lag], axis=0)
        same = (run[lag:] == run[:-lag]) & (passed < _MINUTES) & (
            apart < _PLACE + _SIDEREAL * passed)
        first[lag:] = np.where(same, np.minimum(first[lag:], first[:-lag]), first[lag:])
    out = np.empty(len(order), int)
    out[order] = first
    return out
