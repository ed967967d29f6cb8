"""How badly terms fit a reading of the columns."""

import numpy as np

from calibration.estimation.robust import sigma_of
from msg_tools.units import ARCSEC

TAU = 3.0  # standard deviations, from where a residual counts no more


def scatter(values, dof):
    """Robust noise with little noise of its own: root mean square, of large ones 3 times the MAD
    (a tau scale, Yohai and Zamar 1988)."""
    if not len(values):
        return np.nan
    middle = max(float(sigma_of(values)), 1e-5 * ARCSEC)
    bounded = np.minimum(np.square(values / middle), TAU**2)
    return max(middle * dof * float(np.sqrt(np.mean(bounded))), 1e-4 * ARCSEC)


def misfit(sigma, gain):
    """Mean logarithm of the noise of both axes, in units of the columns as written."""
    return 0.5 * (np.log(sigma[0] * sigma[1]) - gain)
