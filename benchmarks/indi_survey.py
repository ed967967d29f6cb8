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

"""A pointing run of a simulator that reports its true pointing, without camera or graph."""

import threading
import time

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import is_beyond, through_pole
from pointing_model.runs.run import PointingRun
from pointing_model.sky.places import sidereal_time
from telescope_mount.bridges.axes_and_places import axes_at
from telescope_mount.bridges.indi.client import PATIENCE, IndiError

#: s in which a slew is over
SLOWEST = 90.0


def places(count, seed, latitude, hour_angles=(3.0 * DEG, 60.0 * DEG), south=-25.0 * DEG,
           lowest=20.0 * DEG):
    """Hour angles and declinations on both sides of the meridian.

    Parameters
    ----------
    count : int
        At least 2.
    seed : int
    latitude : float
        rad.
    hour_angles : tuple of float
        Smallest and largest, on either side, rad.
    south, lowest : float
        Smallest declination and elevation, rad.

    Returns
    -------
    ndarray, shape (count, 2)
        rad; half of them east of the meridian. Each is the one that the axes of a German mount
        reach soonest from the one before, and the first from the pole, where such mounts start.
    """
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        hour_angle = rng.uniform(*hour_angles) * (-1.0 if len(found) % 2 else 1.0)
        dec = np.arcsin(rng.uniform(np.sin(south), np.sin(75.0 * DEG)))
        height = np.arcsin(np.sin(latitude) * np.sin(dec)
                           + np.cos(latitude) * np.cos(dec) * np.cos(hour_angle))
        if height > lowest:
            found.append((hour_angle, dec))
    found = np.array(found)
    axes = np.array(through_pole(*found.T, found[:, 0] < 0.0)).T
    order, here, left = [], np.full(2, 90.0 * DEG), list(range(count))
    while left:
        # both axes turn at once
        nearest = min(left, key=lambda n: np.abs(axes[n] - here).max())
        left.remove(nearest)
        order.append(nearest)
        here = axes[nearest]
    return found[order]


class Survey:
    """Points a telescope and records axes and true pointing at the tick of its arrival.

    Parameters
    ----------
    mount : Mount
    site : Site
    """

    def __init__(self, mount, site):
        self.mount, self.site = mount, site
        self.telescope = None
        self._news, self._ticks = threading.Condition(), []

    def take(self, tick):
        """See `tick` of `indi_telescope.Ticks`."""
        with self._news:
            self._ticks.append(tick)
            self._news.notify_all()

    def observe(self, hour_angle, dec, ticks=4):
        """Point there and wait for the arrival.

        Parameters
        ----------
        hour_angle, dec : float
            rad.
        ticks : int
            Readings of which the one that was least under way is taken.

        Returns
        -------
        dict
            ``time``, ``az``, ``el`` (where it looks), ``az_enc``, ``el_enc`` (its axes).

        Raises
        ------
        IndiError
            It does not arrive.
        """
        with self._news:
            self._ticks.clear()
        self.telescope.goto(sidereal_time(time.time(), self.site) - hour_angle, dec)
        self._wait(lambda: self.telescope.slewing, PATIENCE, 'does not begin to slew')
        self._wait(lambda: not self.telescope.slewing, SLOWEST, 'does not arrive')
        first = self._wait(lambda: next((n for n, tick in enumerate(self._ticks)
                                         if tick.tracking and tick.place is not None), -1) + 1,
                           PATIENCE, 'does not say where it looks')
        self._wait(lambda: len(self._ticks) >= first + ticks, PATIENCE, 'does not track')
        with self._news:
            arrived, later = self._ticks[first - 1], self._ticks[first:]
        # a message that came late makes the sky turn on: of all ticks the quickest counts
        lst = sidereal_time(np.array([tick.stamp for tick in (arrived, *later)]) * 1e-9, self.site)
        ahead = wrap(lst - np.array([tick.axes[0] for tick in (arrived, *later)]))
        late = wrap(ahead[0] - ahead[np.argmin(wrap(ahead - ahead[0]))])
        beyond = bool(is_beyond(arrived.axes[1]))
        az, el = axes_at(self.mount, arrived.place[0] + late, arrived.place[1],
                         arrived.stamp * 1e-9, self.site, beyond)
        first_axis, second_axis = self.mount.on_travel(*arrived.axes)
        return {'time': arrived.stamp * 1e-9, 'az': float(az), 'el': float(el),
                'az_enc': float(first_axis), 'el_enc': float(second_axis)}

    def _wait(self, condition, seconds, what):
        end = time.monotonic() + seconds
        with self._news:
            while not (found := condition()):
                if time.monotonic() > end:
                    raise IndiError(f'{self.telescope.device} {what} within {seconds:g} s')
                self._news.wait(0.2)
        return found

    def run(self, wanted, progress=lambda done: None, ticks=4):
        """Observe all of `wanted`, shape (n, 2), as `observe` does; a `PointingRun`."""
        rows = []
        for hour_angle, dec in wanted:
            rows.append(self.observe(hour_angle, dec, ticks))
            progress(len(rows))
        return PointingRun({name: np.array([row[name] for row in rows]) for name in rows[0]},
                           {'mount': self.mount, 'source': self.telescope.device,
                            'site': self.site})
