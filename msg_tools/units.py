"""Conversions that every module shares. Angles in memory are radians."""

import numpy as np

ARCSEC = np.pi / 648000.0  # one arcsecond in radians
DEG = np.pi / 180.0  # one degree in radians


def wrap(angle):
    """Wrap an angle to [-pi, pi).

    Parameters
    ----------
    angle : float or ndarray
        Radians.

    Returns
    -------
    float or ndarray
        The same direction, radians in [-pi, pi).
    """
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
