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

"""During a night: by which method to set the zero, and with which stars."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import ALTAZ
from pointing_model.sky.places import observed_place
from pointing_model.sky.star_catalogue import POLARIS_HIP, StarTarget, load_catalogue
from pointing_model.zero import BY_STARS, MARK
from pointing_model.zero_held_terms import BROAD, is_a_model

from .star_choice import ANYWHERE, axes_at
from .zero_stars import Before, zero_sigma, zero_stars

#: without a model the same stars are needed in the next power-on: they stay up this long, s
_AGAIN = 1800.0
#: Polaris is usable if the sigma of its zero is at most this multiple of that from stars, on both
#: axes
WELL_UP = 2.0


class ZeroMethod(NamedTuple):
    """Method to set a zero, and the reason in words."""

    polaris: bool
    why: str


def way_to_zero(polaris, stars, *, lowest, highest):
    """Choose between Polaris and stars.

    Parameters
    ----------
    polaris : tuple
        Elevation of Polaris from begin to end, ndarray, radians; and the sigma of its zeros,
        shape (2,), radians.
    stars : ndarray, shape (2,), or None
        The same for chosen stars; None if there are none.
    lowest, highest : float
        Limits of elevation, radians.

    Returns
    -------
    ZeroMethod
    """
    heights, own = polaris
    low, high = heights.min(), heights.max()
    if low < lowest or high > highest:
        outside = (low if low < lowest else high) / DEG
        return ZeroMethod(False, f'Polaris stands at {outside:.1f} deg, outside the limits of '
                          'elevation')
    if stars is None:
        return ZeroMethod(True, 'no star is within the limits')
    ratio = own / stars
    words = (f'expected sigma {own[0] / ARCSEC:.2f}, {own[1] / ARCSEC:.2f} arcsec, with stars '
             f'{stars[0] / ARCSEC:.2f}, {stars[1] / ARCSEC:.2f}')
    if np.all(ratio <= WELL_UP):
        return ZeroMethod(True, f'Polaris is well up: {words}')
    return ZeroMethod(False, f'Polaris is of little use here: {words}')


class ZeroExposures(NamedTuple):
    """Exposures to set a zero.

    Attributes
    ----------
    targets : list of StarTarget
        One per exposure, in order.
    by, words : str
        The method, and the choice with its reason, for people.
    """

    targets: list
    by: str
    words: str

    def expose(self, observe, table):
        """Steps that expose them; exposures of a star not found go to the other stars.

        Parameters
        ----------
        observe : callable
            Returns the steps of one exposure of a target.
        table : NightMemory
            It gets another row if the star was found.
        """
        left = list(self.targets)
        while left:
            target, rows = left.pop(0), len(table)
            yield from observe(target)
            others = [other for other in left if other.number != target.number]
            if len(table) == rows and others:
                left = sorted((others * len(left))[:len(left)], key=others.index)


class ZeroChoice:
    """Conditions for setting a zero.

    Parameters
    ----------
    stars : Stars
        The catalogue, see `zero_stars.zero_stars`.
    table : NightMemory
        Rows of the night so far.
    time : float
        Present time, UTC s.
    site, weather : Site, Weather
    mount : Mount
    axes : star_choice.AxisLimits
        Limits of its axes.
    model : PointingModel or None
        Active model.
    run : int
        Number of the power-on.
    evening : int
        Begin of the night, ns.
    here : ndarray, shape (2,)
        Present encoder angles, radians.
    limits : sequence of float
        Lowest and highest elevation, deg, and faintest magnitude.
    a_star : float
        Largest time per exposure, s.
    """

    def __init__(self, stars, table, time, site, weather, *, mount=ALTAZ, axes=ANYWHERE,
                 model=None, run=1, evening=0, here=(0.0, 0.0), limits=(20.0, 85.0, 6.0),
                 a_star=40.0):
        self._stars, self._time, self._site, self._weather = stars, time, site, weather
        self._mount, self._reach, self._model, self._run = mount, axes, model, run
        self._here, self._a_star = here, a_star
        self._low, self._high, self._faintest = limits[0] * DEG, limits[1] * DEG, limits[2]
        self._tonight = [row for row in table.rows if row['stamp'] >= evening]
        exposed = [row for row in self._tonight if row.get(MARK) or row['star'] == POLARIS_HIP]
        self._now = [row for row in exposed if row['run'] == run]
        others = [row for row in exposed if row['run'] != run]
        newest = max((row['run'] for row in others), default=None)
        self._earlier = [row for row in others if row['run'] == newest]

    # --- which way ----------------------------------------------------------------------------

    def way(self, n):
        """Polaris or stars, a `ZeroMethod`; for `n` exposures."""
        star = load_catalogue(hip=[POLARIS_HIP])
        place = observed_place(star, self._time, self._site, self._weather)
        if not np.all(self._reach.permitted(self._mount, *place, self._time, star.hip)):
            return ZeroMethod(False, 'the guard does not allow pointing at Polaris')
        heights, first, second = self._polaris(star, n)
        for rows, why in ((self._now, 'like the earlier exposures of this power-on'),
                          ([] if is_a_model(self._model) else self._earlier,
                           'like the power-on before, to measure the change since then')):
            if not rows:
                continue
            polaris = not any(row.get(MARK) for row in rows)
            if not polaris or self._low <= heights.min() <= heights.max() <= self._high:
                return ZeroMethod(polaris, why)
        # without a model the held terms cancel in the change if they are the same
        held = {'model': self._model, 'mount': self._mount, 'held': is_a_model(self._model)}
        own = zero_sigma(first, second, **held)
        return way_to_zero((heights, own), self._star_sigma(n, held), lowest=self._low,
                           highest=self._high)

    def _star_sigma(self, n, held):
        try:
            chosen = self._chosen(n)
        except ValueError:
            return None
        return zero_sigma(*self._axes(np.repeat(chosen.rows, chosen.counts), self._stars), **held)

    def _polaris(self, star, n):
        """Elevations from begin to end, and axis angles of `n` exposures."""
        times = self._time + np.array([0.0, 0.5, 1.0]) * n * self._a_star
        heights = np.array([observed_place(star, t, self._site, self._weather)[1][0]
                            for t in times])
        return heights, *self._axes(np.zeros(n, int), star)

    def _axes(self, rows, stars):
        az, el = observed_place(stars.select(rows), self._time, self._site, self._weather)
        return axes_at(self._mount, az, el, self._reach, stars.hip[rows])

    # --- which stars --------------------------------------------------------------------------

    def _chosen(self, n):
        without = not is_a_model(self._model)
        rows = [*self._now, *(self._earlier if without else ())]
        before = Before(*(np.array([row[name] for row in rows], float) for name in ('az', 'el')),
                        np.array([row['run'] == self._run for row in rows], bool)) if rows else None
        marked = [row for row in self._tonight if row.get(MARK)]
        checked = {int(row['star']) for row in self._tonight} - {int(row['star']) for row in marked}
        prefer = dict.fromkeys(int(row['star']) for row in rows if row.get(MARK) and without)
        return zero_stars(
            self._stars, self._time, n, site=self._site, weather=self._weather,
            mount=self._mount, limits=self._reach, model=self._model, before=before,
            prefer=list(prefer),
            exclude=sorted(checked), min_el=self._low, max_el=self._high,
            mag_limit=self._faintest, duration=n * self._a_star + _AGAIN * (
                without and not self._earlier), start=self._here)

    def stars(self, n):
        """The stars to expose, `ZeroExposures`.

        Parameters
        ----------
        n : int
            Number of exposures.

        Raises
        ------
        ValueError
            No star within the limits.
        """
        chosen = self._chosen(n)
        targets = [StarTarget(self._stars.select([row]))
                   for row in np.repeat(chosen.rows, chosen.counts)]
        by = f'{BY_STARS} ({len(chosen.rows)})'
        given = ('the active model and its covariance held' if is_a_model(self._model) else
                 f'without a model: other terms within {BROAD / ARCSEC:.0f} arcsec')
        again = ', of the change since the power-on before' if self._earlier and not is_a_model(
            self._model) else ''
        first, second = chosen.sigma / ARCSEC
        names = ', '.join(f'{self._stars.hip[row]} x {count}'
                          for row, count in zip(chosen.rows, chosen.counts))
        return ZeroExposures(targets, by, f'zero by {by}: HIP {names}; {given}; '
                             f'expected sigma {first:.2f}, {second:.2f} arcsec{again}')
