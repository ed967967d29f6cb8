"""The restricted likelihood (Patterson and Thompson 1971, Biometrika 58, 545) of whitened rows."""

import numpy as np

#: of a column that others do not explain, over its length: less is rounding
_LIVE = 1e-6


def restricted(columns, log_det, least=0.0, taken=0, size=None):
    """-2 ln L restricted, the variance by the rows themselves.

    Parameters
    ----------
    columns : ndarray, shape (n, k + 1)
        Whitened: the design, and behind it what it is fitted to.
    log_det : float
        Of the covariance they are whitened by, but for the variance.
    least : float
        1 sigma at least.
    taken : int
        Numbers that were fitted before.
    size : ndarray, shape (k,), optional
        Length of the design's columns before that.

    Returns
    -------
    value : float
        But for a constant.
    variance : float
    """
    design = columns[:, :-1]
    if size is None:
        size = np.sqrt(np.einsum('ij,ij->j', design, design))
    size = np.where(size > 0.0, size, 1.0)
    while True:
        q, r = np.linalg.qr(design / size)
        diagonal = np.abs(np.diag(r))
        live = diagonal > _LIVE
        if live.all():
            break
        # what rounding leaves of a column points anywhere, and would take its part of the others
        design, size = design[:, np.flatnonzero(live)], size[np.flatnonzero(live)]
    left = columns[:, -1] - q @ (q.T @ columns[:, -1])
    free = max(len(left) - taken - len(diagonal), 1)
    square = float(left @ left)
    variance = max(square / free, least**2, 1e-300)
    logs = np.log(diagonal) + np.log(size[:len(diagonal)])
    value = free * np.log(variance) + log_det + 2.0 * float(logs.sum())
    if variance > square / free:
        value += square / variance - free
    return value, variance
