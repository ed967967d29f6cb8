# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Chooses stars for a pointing model, orders them, and detects those with a neighbour."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from msg_tools.params import Param
from msg_tools.units import ARCSEC, DEG
from pointing_model import harmonics
from pointing_model.mounts import ALTAZ, through_pole
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE

from .star_order import observing_order

NEIGHBOUR_DISTANCE = 30.0 * 60.0 * ARCSEC  # a field of 30 arcmin to its corner, and a mount 8 off
NEIGHBOUR_CONTRAST = 2.0  # magnitudes; a fainter neighbour does not disturb
#: parameters of the observer for the choice of stars
CHOICE_PARAMS = (
    Param('star_seed', 1, 'seed of the choice of stars', 0, 2**31 - 1),
    Param('magnitude_limit', 6.0, 'faintest star, Hipparcos magnitude', -2.0, 15.0),
    Param('min_elevation_deg', 20.0, 'lowest star [deg]', 0.0, 89.0),
    Param('max_elevation_deg', 85.0, 'highest star [deg]', 1.0, 90.0),
    Param('meridian_limit_deg', 5.0, 'how far past the meridian a German mount turns before it '
          'takes the other side [deg]', 0.0, 90.0),
    Param('hour_angle_limit_deg', 165.0, 'largest hour angle of a star for a mount that does not '
          'go through the pole [deg]', 1.0, 180.0),
)


class AxisLimits(NamedTuple):
    """Limits of the axes, radians.

    Attributes
    ----------
    meridian : float
        Past the meridian, for a German mount.
    hour_angle : float
        On either side, for the first axis of a mount that does not go through the pole.
    allowed : telescope_mount.guard.allowed_sky.AllowedSky, optional
        Where the guard lets tube and axes be.
    """

    meridian: float = 5.0 * DEG
    hour_angle: float = np.pi
    allowed: object = None

    @classmethod
    def of(cls, value, allowed):
        """From the observer's parameters, which `value` returns by name."""
        return cls(value('meridian_limit_deg') * DEG, value('hour_angle_limit_deg') * DEG, allowed)

    def permitted(self, mount, az, el, time, numbers):
        """Whether the guard lets the tube point at stars, with the axes as they would observe them.

        Parameters
        ----------
        mount, az, el, time, numbers
            See `reached`.

        Returns
        -------
        bool or ndarray of bool, shape (n,)
        """
        if self.allowed is None:
            return True
        return self.allowed(time, az, el) & self.allowed.within(
            *axes_at(mount, az, el, self, numbers))

    def reached(self, mount, az, el, most, time, numbers):
        """Whether the axes can reach stars, no closer to the pole than `most`.

        Parameters
        ----------
        mount : Mount
        az, el : ndarray, shape (n,)
            Places on the horizon, radians.
        most : float
            Largest angle from the equator of the axis frame, radians.
        time : float
            UTC, s.
        numbers : ndarray of int, shape (n,)
            Numbers of the stars.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        allowed = self.permitted(mount, az, el, time, numbers)
        if mount.vertical:
            return allowed & (el <= most)
        first, second = mount.axes_of(az, el)
        free = mount.two_sided  # reachable on one side or the other
        return allowed & (np.abs(second) <= most) & (free | (np.abs(first) <= self.hour_angle))


ANYWHERE = AxisLimits()


def choose_stars(stars, time, site=DEFAULT_SITE, weather=DEFAULT_WEATHER, n=30, seed=0,
                 min_el=20.0 * DEG, max_el=85.0 * DEG, mag_limit=6.0, exclude=(), duration=0.0,
                 start=None, mount=ALTAZ, limits=ANYWHERE, slews=1.0):
    """Choose stars all over the sky and put them in observing order.

    Parameters
    ----------
    stars : Stars
        The catalogue. Load it two magnitudes deeper than `mag_limit`, to include disturbing
        neighbours.
    time : float
        Begin of the observations, UTC seconds since 1970-01-01.
    site, weather : Site, Weather
    n : int
        Number of stars.
    seed : int
        The same seed gives the same stars in the same order.
    min_el, max_el : float
        Limits of observed elevation, radians.
    mag_limit : float
        Faintest magnitude Hp.
    exclude : sequence of int
        Hipparcos numbers to exclude (already observed, or held out).
    duration : float
        Duration of the observations, s: a chosen star stays within the limits for this time.
    start : (float, float), optional
        Present axis angles of the mount, radians.
    mount : Mount, optional
        For mounts other than alt-azimuth ones `max_el` is the largest angle from the equator of
        the axes: closer to the pole the first axis is too fast.
    limits : AxisLimits
        Limits of the axes.
    slews : float
        See `observing_order`.

    Returns
    -------
    ndarray of int, shape (n,)
        Rows of `stars`, each once, in observing order.

    Raises
    ------
    ValueError
        Fewer than `n` stars meet the conditions.

    Notes
    -----
    The sky between the limits is divided into `n` cells of equal area. In each cell the star is
    taken that adds most to the determinant of the normal matrix of paper 000's 13 harmonics
    (D-optimal design). Stars with a neighbour (`has_neighbour`) are not taken. The order is that
    of `observing_order`.
    """
    if not (0 <= min_el < max_el <= np.pi / 2.0):
        raise ValueError(f'elevation limits {min_el / DEG:g} to {max_el / DEG:g} degrees: '
                         'give 0 <= lower < upper <= 90')
    if n < 1:
        raise ValueError(f'{n} stars asked for: give at least 1')
    rng = np.random.default_rng(seed)
    moments = [time] if duration == 0.0 else [time, time + duration / 2.0, time + duration]
    bright, places, up, known, lonely = observable(
        stars, moments, site, weather, min_el, max_el, mag_limit, exclude, mount, limits)
    highest = max_el if mount.vertical else np.pi / 2.0
    good = up & ~known & lonely
    if np.count_nonzero(good) < n:
        if not np.any(up):
            raise ValueError(
                f'no star visible to Hp {mag_limit:g} between {min_el / DEG:g} and '
                f'{max_el / DEG:g} degrees of elevation'
                f'{", where the guard lets the tube look" * bool(limits.allowed)}: widen the '
                'limits')
        raise ValueError(
            f'{n} stars requested, {np.count_nonzero(good)} available of {np.count_nonzero(up)} '
            f'to Hp {mag_limit:g} between {min_el / DEG:g} and {max_el / DEG:g} degrees of '
            f'elevation: {np.count_nonzero(up & known)} are excluded, '
            f'{np.count_nonzero(up & ~known & ~lonely)} have a bright neighbour. '
            'Request fewer or raise the magnitude limit')
    az, el = (angle[good] for angle in places[len(places) // 2])
    chosen = _stratified(az, el, n, min_el, highest, rng)
    first, second = axes_at(mount, az[chosen], el[chosen], limits,
                            stars.hip[bright[good][chosen]])
    order = observing_order(first, second, rng, start, mount.way, slews)
    return bright[good][chosen[order]]


def observable(stars, moments, site, weather, min_el, max_el, mag_limit, exclude, mount, limits):
    """Rows of bright stars, their places at each time, and which are up at all times, excluded,
    and without a neighbour; for parameters see `choose_stars`.
    """
    bright, there, lonely = bright_stars(stars, float(mag_limit))
    places = [observed_place(there, t, site, weather) for t in moments]
    up = np.all([(el >= min_el) & limits.reached(mount, az, el, max_el, t, there.hip)
                 for t, (az, el) in zip(moments, places)], axis=0)
    return bright, places, up, np.isin(there.hip, np.fromiter(exclude, int)), lonely


def nearest_star(stars, time, az, el, site=DEFAULT_SITE, weather=DEFAULT_WEATHER, *,
                 min_el=20.0 * DEG, max_el=85.0 * DEG, mag_limit=6.0, magnitude=None, exclude=(),
                 mount=ALTAZ, limits=ANYWHERE, start=None, sides=(0, 0)):
    """The star closest to a place on the horizon.

    Parameters
    ----------
    stars, time, site, weather, min_el, max_el, mag_limit, exclude, mount, limits
        See `choose_stars`.
    az, el : float
        Radians.
    magnitude : float, optional
        Prefer a star within one magnitude of it (or of the limit, if that is brighter).
    start : (float, float), optional
        Present axis angles of the mount, radians.
    sides : (int, int)
        Sign of the preferred approach of each axis from `start`, 0 for either.

    Returns
    -------
    row : int
        Row of `stars`.
    off : float
        Its distance from the place, radians.

    Raises
    ------
    ValueError
        No star is observable.
    """
    bright, (places,), up, known, lonely = observable(
        stars, [time], site, weather, min_el, max_el, mag_limit, exclude, mount, limits)
    good = np.flatnonzero(up & ~known & lonely)
    if not len(good):
        raise ValueError(f'no star to Hp {mag_limit:g} that was not observed is left within the '
                         'limits: raise the magnitude limit')
    places = np.array(places)[:, good]
    off = np.arccos(np.clip(ALTAZ.direction(az, el) @ ALTAZ.direction(*places), -1.0, 1.0))
    wanted = np.zeros(len(good))
    if magnitude is not None:
        wanted += np.abs(stars.mag[bright[good]] - min(magnitude, mag_limit)) > 1.0
    if start is not None and any(sides):
        there = axes_at(mount, *places, limits, stars.hip[bright[good]])
        moves = mount.way(start[0], there[0]), there[1] - start[1]
        for side, move in zip(sides, moves):
            wanted += side * move < 0.0
    k = np.lexsort((off, wanted))[0]
    return int(bright[good[k]]), float(off[k])


def axes_at(mount, az, el, limits, numbers):
    """Axis angles at places on the horizon, on the side on which stars there are observed.

    Parameters
    ----------
    mount : Mount
    az, el : ndarray, shape (n,)
        Radians.
    limits : AxisLimits
    numbers : ndarray of int, shape (n,)
        Numbers of the stars.

    Returns
    -------
    first, second : ndarray, shape (n,)
        Radians.
    """
    if mount.vertical:
        return az, el
    first, second = mount.axes_of(az, el)
    beyond = mount.side_for(first, second, limits.meridian, numbers % 2 == 1)
    return mount.on_travel(*through_pole(first, second, beyond))


def _stratified(az, el, n, min_el, max_el, rng):
    """Rows of n stars, one in each of n equal-area cells of azimuth and sin(elevation)."""
    bands = max(1, round(np.sqrt(n / 2.0)))
    count = np.full(bands, n // bands)
    count[rng.permutation(bands)[: n % bands]] += 1
    low, high = np.sin(min_el), np.sin(max_el)
    edges = low + (high - low) * np.cumsum(count)[:-1] / n
    band = np.searchsorted(edges, np.sin(el), side='right')
    turn = az / (2.0 * np.pi) + rng.random(bands)[band]
    column = np.minimum((turn % 1.0 * count[band]).astype(int), count[band] - 1)
    cell = np.concatenate([[0], np.cumsum(count)])[band] + column

    basis = harmonics.basis(az, el)
    # orthonormal over the sky, so 1e-6 is small in every direction; einsum, since threads of
    # a BLAS would block a core needed by other nodes
    gram = np.einsum('ij,ik->jk', basis, basis) / len(az) + 1e-9 * np.eye(basis.shape[1])
    basis = np.einsum('ij,kj->ik', basis, np.linalg.inv(np.linalg.cholesky(gram)))
    members = [np.flatnonzero(cell == k) for k in range(n)]
    chosen = np.array([rng.choice(m) if len(m) else -1 for m in members])
    _fill(chosen, az, el)
    normal = basis[chosen].T @ basis[chosen] + 1e-6 * np.eye(basis.shape[1])
    taken = np.zeros(len(az), bool)
    taken[chosen] = True
    for _ in range(2):
        for k, member in enumerate(members):
            if len(member) < 2:
                continue
            normal -= np.outer(basis[chosen[k]], basis[chosen[k]])
            candidate = basis[member]
            gain = np.einsum('ij,ij->i', candidate @ np.linalg.inv(normal), candidate)
            taken[chosen[k]] = False
            gain[taken[member]] = -np.inf
            chosen[k] = member[np.argmax(gain)]
            taken[chosen[k]] = True
            normal += np.outer(basis[chosen[k]], basis[chosen[k]])
    return chosen


def _fill(chosen, az, el):
    """Give each cell without a star the star farthest from all chosen ones, in place."""
    places = ALTAZ.direction(az, el).T
    have = chosen[chosen >= 0]
    nearness = (places @ places[have].T).max(axis=1) if len(have) else places @ places[0]
    nearness[have] = np.inf
    for k in np.flatnonzero(chosen < 0):
        chosen[k] = np.argmin(nearness)
        nearness = np.maximum(nearness, places @ places[chosen[k]])
        nearness[chosen[k]] = np.inf


@lru_cache(maxsize=8)
def bright_stars(stars, mag_limit):
    """Stars that are bright enough; cached, since a night requests the same ones many times.

    Parameters
    ----------
    stars : Stars
    mag_limit : float
        Faintest magnitude Hp.

    Returns
    -------
    rows : ndarray of int, shape (n,)
        Rows of `stars`.
    bright : Stars
        These stars only.
    lonely : ndarray of bool, shape (n,)
        Which of them have no neighbour that a camera could confuse with them.
    """
    rows = np.flatnonzero(stars.mag <= mag_limit)
    lonely = ~has_neighbour(stars, rows)
    rows.flags.writeable = lonely.flags.writeable = False
    return rows, stars.select(rows), lonely


def has_neighbour(stars, rows):
    """Which stars have a neighbour that a camera could confuse with them.

    Parameters
    ----------
    stars : Stars
        All of these are possible neighbours.
    rows : ndarray of int, shape (n,)
        The stars in question.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    deep = np.flatnonzero(stars.mag < stars.mag[rows].max(initial=-9.0) + NEIGHBOUR_CONTRAST)
    deep = deep[np.argsort(stars.dec[deep])]
    place = ALTAZ.direction(stars.ra, stars.dec)
    out, least = np.zeros(len(rows), bool), np.cos(NEIGHBOUR_DISTANCE)
    if not len(rows):
        return out
    # process many stars of similar declination together, with all their possible neighbours
    for part in np.array_split(np.argsort(stars.dec[rows]), len(rows) // 64 + 1):
        row = rows[part]
        beside = stars.dec[row[[0, -1]]] + [-NEIGHBOUR_DISTANCE, NEIGHBOUR_DISTANCE]
        other = deep[slice(*np.searchsorted(stars.dec[deep], beside))]
        near = place[:, row].T @ place[:, other] >= least
        near &= stars.mag[other] < stars.mag[row, np.newaxis] + NEIGHBOUR_CONTRAST
        out[part] = np.any(near & (other != row[:, np.newaxis]), axis=1)
    return out
