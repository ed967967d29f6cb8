"""The restricted likelihood (Patterson and Thompson 1971, Biometrika 58, 545) of whitened rows."""

import numpy as np

#: of a column that others do not explain, over its length: less is rounding
_LIVE = 1e-6


def restricted(columns, log_det, least=0.0, taken=0, size=None):
    """-2 ln L restricted, the variance by the rows themselves.

    Parameters
    ----------
    columns : ndarray, shape (..., n, k + 1)
        Whitened: the design, and behind it what it is fitted to.
    log_det : float or ndarray, shape (...)
        Of the covariance they are whitened by, but for the variance.
    least : float
        1 sigma at least.
    taken : int or ndarray, shape (...)
        Numbers that were fitted before.
    size : ndarray, shape (k,), optional
        Length of the design's columns before that.

    Returns
    -------
    value : ndarray, shape (...)
        But for a constant.
    variance : ndarray, shape (...)
    """
    n, k = columns.shape[-2], columns.shape[-1] - 1
    design = columns[..., :-1]
    if size is None:
        size = np.sqrt(np.einsum('...ij,...ij->...j', design, design))
    size = np.where(size > 0.0, size, 1.0)
    # of fewer rows than columns R would not be square
    scaled = np.zeros((*columns.shape[:-2], max(n, k + 1), k + 1))
    np.divide(design, size[..., None, :], out=scaled[..., :n, :-1])
    scaled[..., :n, -1] = columns[..., -1]
    lengths = np.concatenate((np.broadcast_to(size, (*columns.shape[:-2], k)),
                              np.ones((*columns.shape[:-2], 1))), axis=-1)
    kept, place = np.ones(lengths.shape, bool), np.arange(k + 1)
    while True:
        count = kept.sum(-1) - 1
        diagonal = np.abs(np.diagonal(np.linalg.qr(scaled, mode='r'), axis1=-2, axis2=-1))
        live = (diagonal > _LIVE) & (place < count[..., None])
        if (live.sum(-1) == count).all():
            break
        # what rounding leaves of a column points anywhere, and would take its part of the others:
        # it goes behind the column that is fitted
        order = np.argsort(np.where(live, 0, np.where(place == count[..., None], 1, 2)), -1,
                           kind='stable')
        kept = place <= live.sum(-1)[..., None]
        scaled = np.take_along_axis(scaled, order[..., None, :], -1)
        lengths = np.take_along_axis(lengths, order, -1)
    square = np.square(np.take_along_axis(diagonal, count[..., None], -1)[..., 0])
    free = np.maximum(n - taken - count, 1)
    variance = np.maximum(np.maximum(square / free, least**2), 1e-300)
    logs = np.log(np.where(live, diagonal * lengths, 1.0)).sum(-1)
    value = free * np.log(variance) + log_det + 2.0 * logs
    return value + np.where(variance > square / free, square / variance - free, 0.0), variance
