"""A change that goes on slowly, told from a jump by likelihood.

Steps are tried against an error that stands still. Where the error goes on (a drift that bends, a
disc whose centre goes round) some step always takes up a part of it, and the chance of that step is
the chance of a model that is wrong: it says nothing. So both are compared.
"""

import numpy as np

from ...estimation.step_scan import clipped, robust_fit

#: BIC from which the evidence is strong (Kass and Raftery 1995)
_STRONG = 6.0
#: turns of a disc's centre in the night that are tried, of either sense; powers of time
_TURNS, _POWERS = np.arange(1, 13) / 4.0, (2, 3)


def is_slow(night, design, values, axis, column):
    """Whether a slow change of an axis explains the sky better than a step, by BIC.

    Parameters
    ----------
    night : CrossCheckNight
    design : GroupColumns
        Of the sky, with all that was found but the step.
    values : ndarray, shape (2n,)
        Encoder - sky, rad.
    axis : int
    column : ndarray, shape (n,)
        Of the step.

    Returns
    -------
    bool
    """
    n = len(values)
    tame = clipped(design.beside(night.on_sky(axis, column)), values)
    step = _bic(night, design, tame, axis, [column], 1, n)
    return any(_bic(night, design, tame, axis, columns, scanned, n) < step - _STRONG
               for columns, scanned in _slow(night, axis) if n > len(design) + len(columns) + 2)


def _bic(night, design, values, axis, columns, scanned, n):
    full = design.beside(*(night.on_sky(axis, one) for one in columns))
    left = robust_fit(full, values).residual
    return n * np.log(left @ left + 1e-300) + (len(columns) + scanned) * np.log(n)


def _slow(night, axis):
    """Columns of slow changes, and how many numbers of each are scanned."""
    time = np.asarray(night.rows['time'], float)
    u = 2.0 * (time - time.min()) / max(np.ptp(time), 1.0) - 1.0
    for power in _POWERS:
        yield [u**k for k in range(1, power + 1)], 0
    angle = np.asarray(night.rows[('az', 'el')[axis]], float)
    for turns in (*-_TURNS, *_TURNS):
        way = angle + np.pi * turns * u
        yield [np.cos(way), np.sin(way)], 1
