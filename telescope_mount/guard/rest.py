"""Tracks that end at rest."""

import numpy as np

from ..observing.axis_demand import Track

#: shortest braking, s
SOONEST = 0.1
#: braking at the end of a track takes so much more time than it might
GENTLE = 1.25
#: no axis has such a rate, rad/s
NO_RATE = 1e3


def braked(times, angles, rates, axes):
    """A track with each axis braked at its end, in its own time: none goes farther than it must.

    Parameters
    ----------
    times : ndarray, shape (n,)
        s.
    angles, rates : ndarray, shape (n, 2)
        rad, rad/s.
    axes : sequence of limits.Axis, length 2

    Returns
    -------
    times, angles, rates : ndarray
        One or two knots more.
    """
    angle, rate = angles[-1], rates[-1]
    own = np.array([max(SOONEST, abs(v) / axis.acceleration)
                    for v, axis in zip(rate.tolist(), axes)])
    if np.ptp(own) < 0.05:
        own[:] = own.max()
    after = np.unique(own)[:, None]
    passed = np.minimum(after, own)
    return (np.concatenate([times, times[-1] + after[:, 0]]),
            np.concatenate([angles, angle + rate * passed * (1.0 - 0.5 * passed / own)]),
            np.concatenate([rates, rate * (1.0 - passed / own)]))


def ended(track, axes):
    """A `Track` that ends at rest: with a knot more, where its last one has a rate."""
    rate = track.rates[-1]
    if not (np.abs(track.rates).max() < NO_RATE and rate.any()):
        return track  # one that is no number too: it will be refused
    brake = max(SOONEST, GENTLE * max(abs(v) / axis.acceleration
                                      for v, axis in zip(rate.tolist(), axes)))
    return Track(track.start, np.append(track.times, track.times[-1] + brake),
                 np.vstack([track.angles, track.angles[-1] + 0.5 * brake * rate]),
                 np.vstack([track.rates, np.zeros(2)]))
