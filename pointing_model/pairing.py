"""One observation from what the instruments sent: encoder readings and a miss distance."""

import numpy as np

from .units import wrap


def interpolate(stamps, angles, stamp):
    """The angles at `stamp`, between the readings beside it.

    Parameters
    ----------
    stamps : array_like of int, shape (n,)
        Nanoseconds, increasing.
    angles : array_like, shape (n, 2)
        Azimuth and elevation, rad.
    stamp : int
        Within the range of `stamps`.

    Returns
    -------
    angles : ndarray, shape (2,)
        Radians.
    rates : ndarray, shape (2,)
        rad/s.

    Raises
    ------
    ValueError
        No reading on one side of `stamp`, or none that is finite.
    """
    stamps = np.asarray(stamps, dtype=np.int64)
    angles = np.asarray(angles, dtype=float).reshape(-1, 2)
    i = int(np.searchsorted(stamps, stamp, side='left'))
    if i < len(stamps) and stamps[i] == stamp and i == 0:
        i = 1
    if i == 0 or i >= len(stamps):
        raise ValueError('no encoder readings on both sides of the exposure')
    low, high = angles[i - 1], angles[i]
    if not np.isfinite([low, high]).all():
        raise ValueError('encoder reading is not a number: home the encoder')
    span = float(stamps[i] - stamps[i - 1])
    step = np.array([wrap(high[0] - low[0]), high[1] - low[1]])
    return low + step * (float(stamp - stamps[i - 1]) / span), step / (span * 1e-9)


def centred(az, el, miss_x, miss_y):
    """The encoder reading that would have put the star on the boresight.

    The miss distance is a point in the tangent plane about the pointing; taking it back to the
    sphere exactly keeps stars near the zenith right.

    Parameters
    ----------
    az, el : float or ndarray
        Encoder reading, rad.
    miss_x, miss_y : float or ndarray
        Star minus boresight toward +A and +E, rad.

    Returns
    -------
    az, el : float or ndarray
        Radians.
    """
    up = np.cos(el) - miss_y * np.sin(el)
    new_az = az + np.arctan2(miss_x, up)
    return new_az, np.arctan2(np.sin(el) + miss_y * np.cos(el), np.hypot(miss_x, up))
