"""A bright star beside which a mount is nudged, so that its camera shows what it does."""

import numpy as np

from msg_tools.units import DEG
from pointing_model.sky.places import DEFAULT_WEATHER, observed_place
from pointing_model.sky.star_catalogue import load_catalogue
from pointing_model.sky.target import StarTarget
from telescope_mount.observing.axis_demand import Pointing
from telescope_mount.observing.bright_stars import has_neighbour
from telescope_mount.observing.star_choice import AxisLimits, axes_at

#: faintest of them, Hipparcos magnitude, and how high they stand, rad
BRIGHT, LOW, HIGH = 3.0, 30.0 * DEG, 75.0 * DEG


def standing(here):
    """The place of a mount that stays, as `place_of` a star: ``place(times)``, rad, (n, 2)."""
    return lambda times: np.tile(here, (len(times), 1))


def place_of(target, mount, site, here):
    """Where a perfect mount reads while it follows a star, on the turn nearest to `here`.

    Parameters
    ----------
    target : StarTarget
    mount : Mount
    site : Site
    here : ndarray, shape (2,)
        rad.

    Returns
    -------
    callable
        ``place(times)``: angles (n, 2), rad, at times (n,), UTC s.
    """
    pointing = Pointing(target, None, np.zeros(2), mount, AxisLimits().meridian)

    def angles(times):
        first, second = pointing.place(np.asarray(times) * 1e9, site, DEFAULT_WEATHER)
        turns = np.round((here[0] - first[0]) / (2.0 * np.pi)) if mount.vertical else 0.0
        return np.column_stack([first + 2.0 * np.pi * turns, second])
    return angles


def bright_star(mount, site, time, here, allowed=None):
    """The bright star without a neighbour that the axes reach soonest.

    Parameters
    ----------
    mount : Mount
    site : Site
    time : float
        UTC, s.
    here : ndarray, shape (2,)
        Readings, rad.
    allowed : AllowedSky, optional
        Where the guard lets the tube look.

    Returns
    -------
    StarTarget

    Raises
    ------
    ValueError
        There is none.
    """
    stars, limits = load_catalogue(mag_limit=BRIGHT + 2.0), AxisLimits(allowed=allowed)
    rows = np.flatnonzero(stars.mag <= BRIGHT)
    az, el = observed_place(stars.select(rows), time, site, DEFAULT_WEATHER)
    good = (el > LOW) & (el < HIGH) & ~has_neighbour(stars, rows) & limits.reached(
        mount, az, el, HIGH if mount.vertical else 80.0 * DEG, time, stars.hip[rows])
    if not good.any():
        raise ValueError(f'no star brighter than {BRIGHT:g} between {LOW / DEG:.0f} and '
                         f'{HIGH / DEG:.0f} deg where the guard lets the tube look: look at site '
                         'and clock, or wait')
    first, second = axes_at(mount, az[good], el[good], limits, stars.hip[rows[good]])
    way = np.maximum(np.abs(mount.way(here[0], first)), np.abs(second - here[1]))
    return StarTarget(stars.select([rows[good][np.argmin(way)]]))
