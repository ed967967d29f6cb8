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

"""Passes of a satellite over a site during which it can be tracked."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import DEG

from .places import sun_place
from .satellite_place import in_sunlight, satellite_place
from .site import DEFAULT_SITE


@dataclass(frozen=True)
class Pass:
    """One visible pass.

    Attributes
    ----------
    start, end, top : float
        Begin, end and culmination: UTC, seconds since 1970-01-01.
    top_el : float
        Radians.
    """

    start: float
    end: float
    top: float
    top_el: float


def passes(satellite, start, hours, site=DEFAULT_SITE, min_el=20.0 * DEG, *, dark=False,
           step=60.0):
    """Passes of a satellite over a site.

    Parameters
    ----------
    satellite : elements.Satellite, or orbits.ephemeris.Orbit
    start : float
        UTC, seconds since 1970-01-01.
    hours : float
        Length of the search; it stops where the orbit ends.
    site : Site
    min_el : float
        Observed elevation (ordinary air), radians.
    dark : bool
        Only while the Sun is 12 degrees below the horizon and illuminates the satellite.
    step : float
        Seconds. Parts of a pass between sunlight and shadow that are shorter may be missed.

    Returns
    -------
    list of Pass
        Begin and end to a millisecond; cut at the ends of the search.

    Raises
    ------
    ValueError
        `hours` or `step` is not positive; or see `satellite_place`.
    """
    if not (hours > 0.0 and step > 0.0):
        raise ValueError(f'hours {hours:g} and step {step:g} of a search for passes must be > 0')

    def elevation(time):
        return satellite_place(satellite, time, site)[1]

    def seen(time, el=None):
        up = (elevation(time) if el is None else el) >= min_el
        if dark:
            late = time[up]
            up[up] = (sun_place(late, site)[1] < -12.0 * DEG) & in_sunlight(satellite, late)
        return up

    end = min(start + 3600.0 * hours, satellite.end)
    start = max(start, satellite.begin + 1.0)  # margin for the light time
    if start >= end:
        return []
    time = np.append(np.arange(start, end, step), end)
    el = elevation(time)
    tops = _tops(elevation, time, el, min_el)
    order = np.argsort(np.append(time, tops[0]), kind='stable')
    time, el = (np.append(*pair)[order] for pair in ((time, tops[0]), (el, tops[1])))
    up = seen(time, el)
    turns = np.flatnonzero(up[1:] != up[:-1])
    low, high, there = time[turns], time[turns + 1], up[turns]
    while turns.size and np.max(high - low) > 1e-3:
        middle = 0.5 * (low + high)
        same = seen(middle) == there
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    edges = [*([time[0]] if up[0] else []), *(0.5 * (low + high)), *([time[-1]] if up[-1] else [])]
    out = []
    for first, last in zip(edges[::2], edges[1::2]):
        grid = np.linspace(first, last, 101)
        for _ in range(3):  # culmination: 100 steps, then 50 within two of them, twice
            el = elevation(grid)
            i = int(np.argmax(el))
            top, top_el = grid[i], el[i]
            grid = np.linspace(grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)], 51)
        out.append(Pass(float(first), float(last), float(top), float(top_el)))
    return out


def _tops(elevation, time, el, low):
    """Times and elevations of culminations above `low` between grid times that are below it."""
    beside = np.pad(el, 1, constant_values=-np.inf)
    i = np.flatnonzero((el >= beside[:-2]) & (el >= beside[2:]) & (el < low))
    first, last = time[np.maximum(i - 1, 0)], time[np.minimum(i + 1, len(time) - 1)]
    top, top_el = time[i], el[i]
    for _ in range(3 if i.size else 0):  # from 60 s to 0.01 s
        grid = np.linspace(first, last, 21)
        found = elevation(grid.ravel()).reshape(grid.shape)
        best, row = found.argmax(axis=0), np.arange(i.size)
        top, top_el = grid[best, row], found[best, row]
        first, last = (grid[np.clip(best + to, 0, 20), row] for to in (-1, 1))
    return top[top_el >= low], top_el[top_el >= low]
