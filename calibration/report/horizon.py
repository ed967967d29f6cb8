"""Where the rows of a run stand on the sky that one sees, whatever the mount."""

import numpy as np

from pointing_model.mounts import ALTAZ, is_beyond


def on_horizon(run):
    """Places and the way of residuals on the horizon.

    Parameters
    ----------
    run : PointingRun

    Returns
    -------
    az, el : ndarray, shape (n,)
        Radians.
    turned : ndarray, shape (2, 2, n), or None
        Components toward azimuth and elevation of x and y; None: they are the same.
    """
    mount = run.mount
    if not len(run) or (mount.vertical and not is_beyond(run['el']).any()):
        return run['az'], run['el'], None
    az, el = mount.horizon_of(run['az'], run['el'])
    own, horizon = mount.tangents(run['az'], run['el']), ALTAZ.tangents(az, el)
    return az, el, np.array([[np.sum(one * toward, axis=0) for one in own] for toward in horizon])


def of_mount(mount):
    """A mount, and what x and y, and its axes, are called: keywords of `residuals.Residuals`."""
    first, second = mount.names.axes
    return {'mount': mount, 'axes': (f'{first} × cos {mount.names.letters[1]}', second),
            'place_words': (first, second)}
