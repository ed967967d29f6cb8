"""Which witness moved in a jump: incremental, absolute encoder, both, or all of it the mount.

Two differences are seen (`witnesses`): incremental - absolute, I - B, and absolute - sky, B + S.
A jump of one of the three is one unknown for two equations, and is told apart; both encoders
unlike are two unknowns, which fit whatever is left, so they have to pay for it (Occam factor of
the Bayesian evidence; MacKay 2003, Information Theory, Inference, and Learning Algorithms, ch. 28).
Both encoders alike and a turn of the mount about the axis are the same in both equations.
"""

import numpy as np

from msg_tools.units import ARCSEC

from ...estimation.step_scan import probabilities

_LEAST = (0.02 * ARCSEC) ** 2  # of a count: the noise is never less

INCREMENTAL, ABSOLUTE, MOUNT = 'incremental encoder', 'absolute encoder', 'mount or sky'
NOTHING, BOTH = 'nothing', 'both encoders'
#: they moved alike, as a turn of the mount about this axis would look too
ALIKE = 'both or mount'


def causes(apart, apart_variance, second, second_variance, size, quiet=0.0):
    """How likely each cause of a jump is, all of them equally likely before.

    Parameters
    ----------
    apart, apart_variance : float
        Change of incremental - absolute (rad) and its variance (rad^2).
    second, second_variance : float
        Change of absolute - sky.
    size : float
        1 sigma of what has moved, rad: a jump far above the noise is named whatever it is.
    quiet : float
        1 sigma of what is usual for an encoder that has not moved, rad.

    Returns
    -------
    dict of str to float
        Posterior probability of `NOTHING`, `INCREMENTAL`, `ABSOLUTE`, `BOTH` and `ALIKE`.
    """
    moved = {NOTHING: (quiet, quiet, 0.0), INCREMENTAL: (size, quiet, 0.0),
             ABSOLUTE: (quiet, size, 0.0), BOTH: (size, size, 0.0), ALIKE: (quiet, quiet, size)}
    value = np.array([apart, second])
    apart_variance, second_variance = apart_variance + _LEAST, second_variance + _LEAST
    logs = {}
    for name, (first, other, mount) in moved.items():
        covariance = np.array([
            [first**2 + other**2 + apart_variance, -other**2],
            [-other**2, other**2 + mount**2 + second_variance]])
        logs[name] = float(-0.5 * (value @ np.linalg.solve(covariance, value)
                                   + np.linalg.slogdet(2.0 * np.pi * covariance)[1]))
    return probabilities(logs)


def likeliest(found, among):
    """The likeliest cause `among` some, and how likely it is of these alone."""
    name = max(among, key=found.get)
    total = sum(found[one] for one in among)
    return name, found[name] / total if total > 0.0 else 1.0 / len(among)
