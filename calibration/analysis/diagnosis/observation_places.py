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


"""Positions and dark hours at which a mount may observe, with the drivers of effects there."""

from datetime import datetime, timezone

import numpy as np

from msg_tools.units import DEG, covered, wrap
from pointing_model.context import Context
from pointing_model.mounts import is_beyond
from pointing_model.sky.places import sun_place
from pointing_model.sky.site import Site
from pointing_model.sky.skyline import Horizon

#: elevation of the Sun below which stars are observed: the end of civil twilight, rad
DARK = -6.0 * DEG
_ROWS, _STEP, _LONGEST = 9, 0.25, 48.0  # sampled rows; time step and longest time ahead, h
#: how far the first axis may go beyond the range that it has used (not on an alt-azimuth mount)
BEYOND = 5.0 * DEG
CLEAR = 3.0 * DEG  # tolerance: the star observed is near the position, not at it
SHORT = 2.0 * DEG  # a last move too short to complete a hysteresis


def on_turn(seen, angles):
    """Unwrap angles to the turn that an axis has used, and check that they are in its range.

    Parameters
    ----------
    seen : ndarray, shape (n,)
        Angles that the axis has been at, rad. The largest gap between two of them is assumed
        unused.
    angles : ndarray
        rad.

    Returns
    -------
    angles : ndarray
        Unwrapped, rad: linear functions of them have no jump in the used range.
    near : ndarray of bool
        Within the used range, extended by `BEYOND`.
    """
    first, span = covered(seen)
    middle = 0.5 * (seen.min() + seen.max())
    return (middle + wrap(angles - middle),
            np.mod(angles - first + BEYOND, 2.0 * np.pi) <= span + 2.0 * BEYOND)


def places_under(known, low, high, *conditions):
    """Grid of positions on the sky, combined with all conditions.

    Except on an alt-azimuth mount, the first axis stays in the range used by the rows: beyond it
    the counterweight may be up. Positions behind a known skyline are excluded.

    Parameters
    ----------
    known : Context
        Context of the rows.
    low, high : float
        Elevation limits, rad.
    *conditions : sequence
        Values of each condition.

    Returns
    -------
    az, el : ndarray, shape (m,)
        Angles of the axes, rad; the conditions change fastest.
    *values : ndarray, shape (m,)
        Values of each condition.
    """
    mount = known.mount
    beyond = np.unique(is_beyond(known.el)) if not mount.vertical else [False]
    side, az, el = (v.ravel() for v in np.meshgrid(
        beyond, np.arange(0.0, 360.0, 15.0) * DEG, np.linspace(low, high, 9), indexing='ij'))
    if not mount.vertical:
        az, el = mount.axes_of(az, el, side)
        az, seen = on_turn(known.az, az)
        az, el = (az[seen], el[seen]) if seen.any() else (known.az, known.el)
    if known.skyline:
        azimuth, elevation = mount.horizon_of(az, el)
        beside = CLEAR / np.maximum(np.cos(elevation), CLEAR / np.pi)
        skyline = Horizon(-0.5 * np.pi, known.skyline)
        free = elevation > skyline.highest(azimuth, beside) + CLEAR
        az, el = (az[free], el[free]) if free.any() else (known.az, known.el)
    values = [v.ravel() for v in np.meshgrid(*conditions, indexing='ij')]
    each = len(values[0])
    return np.repeat(az, each), np.repeat(el, each), *(np.tile(v, len(az)) for v in values)


def forecast(time, temperature, then, n):
    """Temperature extrapolated linearly from the night, at most 5 K beyond its range."""
    good = np.isfinite(temperature)
    if time is None or good.sum() < 5:
        return np.full(n, np.nanmean(temperature))
    slope, level = np.polyfit((time[good] - time[good].mean()) / 3600.0, temperature[good], 1)
    guess = level + slope * (then - time[good].mean()) / 3600.0
    return np.clip(guess, temperature[good].min() - 5.0, temperature[good].max() + 5.0)


def observation_context(known, az, el, approach, later, short, warmer=0.0, **more):
    """`Context` of observations after those of a run.

    Parameters
    ----------
    known : Context
        Context of the rows.
    az, el : ndarray, shape (m,)
        Angles of the axes, rad.
    approach : (ndarray, ndarray), shape (m,)
        Approach of both axes, -1 or 1.
    later : ndarray, shape (m,)
        Hours after the last row.
    short : ndarray of bool, shape (m,)
        Whether reached by a reversed move of only `SHORT`.
    warmer : float
        Kelvin above the forecast.
    **more : ndarray, shape (m,)
        Other columns.
    """
    columns = {'az_enc': az, 'el_enc': el, **more}
    time, temperature = known.get('time'), known.get('temperature')
    if time is not None:
        columns['time'] = np.nanmax(time) + 3600.0 * later
        hours = known.get('run_hours')
        if hours is not None:
            columns['run_hours'] = hours[np.nanargmax(time)] + later
    if known.get('order') is not None:
        columns['order'] = np.ones_like(az)
    if temperature is not None:
        columns['temperature'] = warmer + forecast(time, temperature, columns.get('time'), len(az))
    if 'run' in known.columns:
        columns['run'] = np.full(len(az), known.columns['run'][-1])
    for axis, side in zip(('az', 'el'), approach):
        columns[f'approach_{axis}'], columns[f'before_{axis}'] = side, -side
        columns[f'travel_{axis}'] = np.where(short, SHORT, np.inf)
    out = Context(az, el, columns, known.latitude, known.longitude, known.mount)
    out.raw_reading = known.raw_reading
    return out


def place_of(context, j):
    """Position of a proposal: horizontal ``az_deg``, ``el_deg``, and axis angles if different."""
    place = [round(float(context.get(name)[j] / DEG), 6) % 360.0
             for name in ('azimuth', 'elevation')]
    return {'az_deg': place[0], 'el_deg': place[1], **_side(context, j)}


def _side(context, j):
    """Axis angles and whether it is through the pole; empty for an alt-azimuth mount."""
    mount = context.mount
    if mount.vertical:
        return {}
    angles = mount.on_travel(context.az[j], context.el[j])
    return {**{f'{name}_deg': round(float(angle / DEG), 6)
               for name, angle in zip(mount.names.columns, angles)},
            'through_pole': bool(is_beyond(context.el[j]))}


def dark_hours(context, hours):
    """Select the hours after the last row at which it is dark.

    Parameters
    ----------
    context : Context
        Context of the rows.
    hours : sequence of float

    Returns
    -------
    list of float
        All of `hours` if site or time are unknown, or if most rows were observed by day.
    """
    sun = _sun(context)
    return list(hours) if sun is None else [h for h in hours if sun(h) < DARK]


def next_night(context, hours):
    """Dark hours after the last row, with `hours` counted from the next dusk.

    If it does not get dark within two days, the hour of the lowest Sun.
    """
    sun = _sun(context)
    if sun is None:
        return list(hours)
    grid = np.arange(_STEP, _LONGEST, _STEP)
    up = np.array([sun(h) for h in grid])
    if up.min() >= DARK:
        return [float(grid[up.argmin()])]
    day = int(np.argmax(up >= DARK))  # skip the rest of the current night
    dusk = float(grid[day + int(np.argmax(up[day:] < DARK))])
    return [dusk, *(dusk + h for h in hours if sun(dusk + h) < DARK)]


def utc_of(context, hours):
    """UTC of `hours` after the last row, as ``2026-01-15 21:26``; None if unknown."""
    if _site(context) is None:
        return None
    last = float(np.nanmax(context.get('time')))
    return datetime.fromtimestamp(last + 3600.0 * hours, timezone.utc).strftime('%Y-%m-%d %H:%M')


def _sun(context):
    """Function of hours after the last row: elevation of the Sun, rad; None if irrelevant."""
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
