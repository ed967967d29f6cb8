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


"""Hours after the last row of a run: which of them are dark, and what time it is then."""

from datetime import datetime, timezone

import numpy as np

from msg_tools.units import DEG
from pointing_model.sky.places import sun_place
from pointing_model.sky.site import Site

#: elevation of the Sun below which stars are observed: the end of civil twilight, rad
DARK = -6.0 * DEG
_ROWS, _STEP, _LONGEST = 9, 0.25, 48.0  # rows looked at; h


def dark_hours(context, hours):
    """Those of some hours after the last row at which it is dark.

    Parameters
    ----------
    context : Context
        Of the rows.
    hours : sequence of float

    Returns
    -------
    list of float
        All of `hours` where site or time are not known, or most of the rows are of the day.
    """
    sun = _sun(context)
    return list(hours) if sun is None else [h for h in hours if sun(h) < DARK]


def next_night(context, hours):
    """The same hours counted from the next dusk, after the last row.

    Where the Sun does not go so low within two days, it is where it is lowest.
    """
    sun = _sun(context)
    if sun is None:
        return list(hours)
    grid = np.arange(_STEP, _LONGEST, _STEP)
    up = np.array([sun(h) for h in grid])
    if up.min() >= DARK:
        return [float(grid[up.argmin()])]
    day = int(np.argmax(up >= DARK))  # it is still night before
    dusk = float(grid[day + int(np.argmax(up[day:] < DARK))])
    return [dusk, *(dusk + h for h in hours if sun(dusk + h) < DARK)]


def utc_of(context, hours):
    """UTC of hours after the last row, as ``2026-01-15 21:26``; None where it is not known."""
    if _site(context) is None:
        return None
    last = float(np.nanmax(context.get('time')))
    return datetime.fromtimestamp(last + 3600.0 * hours, timezone.utc).strftime('%Y-%m-%d %H:%M')


def _sun(context):
    """Elevation of the Sun by hours after the last row, rad; None where that is no matter."""
    site = _site(context)
    if site is None:
        return None
    time = np.sort(context.get('time'))
    time = time[np.isfinite(time)]
    seen = time[np.linspace(0, len(time) - 1, _ROWS).astype(int)]
    if np.median([sun_place(float(t), site)[1] for t in seen]) > 0.0:
        return None
    return lambda hours: sun_place(float(time[-1]) + 3600.0 * hours, site)[1]


def _site(context):
    if (context.get('time') is None or not context.time_is_utc
            or context.latitude is None or context.longitude is None):
        return None
    return Site(context.latitude, context.longitude, 0.0)
