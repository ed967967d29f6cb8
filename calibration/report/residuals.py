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

"""Residuals of the stars of a run, before and after, for all pages."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone

import numpy as np

from pointing_model.mounts import ALTAZ, is_beyond
from pointing_model.rms import rms

from .sky_map import grid_of


@dataclass
class Residuals:
    """Rows of a run with their residuals before and after.

    Attributes
    ----------
    names : sequence of str
        Name of each row.
    az, el : ndarray, shape (n,)
        Horizontal coordinates, rad.
    before, after : ndarray, shape (2, n)
        x and y on the sky, arcsec; NaN: unknown.
    used : ndarray of bool, shape (n,)
        Rows included in the RMS; the others are drawn as crosses.
    words : sequence of str
        Whether each row was used, or why not.
    axes : tuple of str
        Names of x and y.
    time : ndarray, shape (n,), optional
        UTC, s; None or NaN: unknown.
    groups : ndarray, shape (n,), optional
        Power-on, night or run of each row.
    group_word : str
        Which of these.
    noise : tuple of float, optional
        1 sigma of x and y, arcsec.
    before_text, after_text : str
        The corrections applied.
    turned : ndarray, shape (2, 2, n), optional
        Components toward azimuth and elevation of x and y; None: the same.
    places : tuple of ndarray, optional
        Angles of the two axes, rad; by default azimuth and elevation.
    place_words : tuple of str
        Names of these angles.
    utc : bool
        Whether times are UTC rather than since an arbitrary start.
    noise_text : str
        Label of `noise`, which may include more than noise.
    grid : tuple, optional
        Coordinate grid of the mount on the sky, see `sky_map.grid_of`; None: that of the map.
    """

    names: Sequence
    az: np.ndarray
    el: np.ndarray
    before: np.ndarray
    after: np.ndarray
    used: np.ndarray
    words: Sequence = ()
    axes: tuple = ('azimuth × cos E', 'elevation')
    time: np.ndarray | None = None
    groups: np.ndarray | None = None
    group_word: str = 'run'
    noise: tuple | None = None
    before_text: str = 'before'
    after_text: str = 'after'
    turned: np.ndarray | None = None
    places: tuple | None = None
    place_words: tuple = ('azimuth', 'elevation')
    utc: bool = True
    noise_text: str = 'noise of the fit'
    grid: tuple | None = None

    def __post_init__(self):
        self.known = np.isfinite(self.before).all(axis=0) & np.isfinite(self.after).all(axis=0)
        self.used = np.asarray(self.used, bool) & self.known
        if self.noise is not None and not np.hypot(*self.noise) > 0.0:
            self.noise = None
        if self.time is None or not np.isfinite(self.time).any():
            self.time = None
        if not len(self.words):
            self.words = ['used' if used else 'left out' for used in self.used]
        self.keys = _keys(self.time, len(self.used))

    def __len__(self):
        return len(self.used)

    def of(self, when):
        """`before` or `after`."""
        return self.before if when == 'before' else self.after

    def text_of(self, when):
        """The corrections applied."""
        return self.before_text if when == 'before' else self.after_text

    def radial(self, when, rows=slice(None)):
        """Radial RMS of the used rows, arcsec; None if there are none."""
        some = np.zeros(len(self), bool)
        some[rows] = True
        some &= self.used
        return float(rms(*self.of(when)[:, some])) if some.any() else None

    @property
    def order(self):
        """Time or row number for the x axis of plots: values and label."""
        if self.time is None:
            return np.arange(1.0, len(self) + 1.0), 'row'
        begin = float(np.nanmin(self.time))
        hours = (self.time - begin) / 3600.0
        when = (f'since {datetime.fromtimestamp(begin, timezone.utc):%Y-%m-%d %H:%M} UTC'
                if self.utc else 'since the first row')
        return (hours / 24.0, f'days {when}') if np.nanmax(hours) > 96.0 else (
            hours, f'hours {when}')


def run_residuals(run, names, before, after, used, words=(), **more):
    """`Residuals` of a run.

    Parameters
    ----------
    run : PointingRun
    names, before, after, used, words, **more
        See `Residuals`.
    """
    mount, places = run.mount, (run['az'], run['el'])
    az, el = places
    if len(run) and not (mount.vertical and not is_beyond(el).any()):
        az, el = mount.horizon_of(*places)
        more['turned'] = turned(mount.tangents(*places), az, el)
    first, second = mount.names.axes
    return Residuals(
        names, az, el, before, after, used, words, time=run.columns.get('time'),
        grid=grid_of(mount),
        axes=(f'{first} × cos {mount.names.letters[1]}', second), place_words=(first, second),
        places=None if mount.vertical else places, groups=run.columns.get('run'),
        utc=run.meta.get('time_is_utc', True), **more)


def turned(own, az, el):
    """Components toward azimuth and elevation of `own` directions, shape (2, 2, n)."""
    return np.array([[np.sum(one * toward, axis=0) for one in own]
                     for toward in ALTAZ.tangents(az, el)])


def _keys(time, n):
    """A short key for each row, the same in all plots of a page."""
    if time is not None and np.isfinite(time).all():
        short = np.round(np.asarray(time) * 10.0).astype(np.int64) % 36**5
        if len(np.unique(short)) == n:
            return [np.base_repr(int(v), 36).lower() for v in short]
    return [f'r{np.base_repr(i, 36).lower()}' for i in range(n)]
