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

"""The step ``pass`` of a plan: wait for a satellite and follow it, with the least time lost."""

import numpy as np

from msg_tools.steps import CallRefused
from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.star_catalogue import satellite_target

from ..guard.limits import Axis
from .axis_demand import KNOT, AxesAtRest, Pointing
from .keyhole import STEP, across
from .pass_forecast import pass_forecasts, pass_track

#: h within which a pass must begin
SOON = 24.0
#: s before its begin at which the axes go there
_EARLY = 60.0
#: largest sky distance between two knots of a track that is cubic in between, arcsec
_STRETCH = 2000.0 * ARCSEC
_LEAST_KNOT = 0.5
#: s from a command to the end of an exposure on its track
_EXPOSED = 3.0
#: margin of a track to the ends of the axis' travel, rad
_EDGE = 1.0 * DEG


class PassPointing(Pointing):
    """A satellite that the mount follows; across a keyhole the axes take the shortest way.

    Parameters
    ----------
    target, active, aim, mount, meridian_limit
        See `Pointing`.
    forecast : PassForecast
    way : callable
        Time (UTC s), shape (n,) -> angles of the axes across its keyholes, shape (n, 2), rad.
    """

    def __init__(self, target, active, aim, mount, meridian_limit, forecast, way):
        super().__init__(target, active, aim, mount, meridian_limit)
        self._forecast, self._way, self.until = forecast, way, forecast.end
        self.knot = float(np.clip(_STRETCH / forecast.fastest, _LEAST_KNOT, KNOT))

    def place(self, stamps, site, air):
        """See `Pointing`; across a keyhole the intended place of the axes."""
        first, second = super().place(stamps, site, air)
        angles, time = np.stack((first, second), axis=-1), stamps * 1e-9
        for hole in self._forecast.keyholes:
            inside = (time > hole.begin) & (time < hole.end)
            if inside.any():
                way = self._way(time[inside])[:, hole.axis]
                turns = np.round((angles[inside, hole.axis] - way) / (2.0 * np.pi))
                angles[inside, hole.axis] = way + 2.0 * np.pi * turns
        return angles[:, 0], angles[:, 1]

    def keep_within(self, travel, start, site, air):
        """End its tracks before an axis leaves its travel; the next track is on the other side.

        Parameters
        ----------
        travel : sequence of (float, float)
            Ends of both axes, rad.
        start : int
            Begin of the first track, ns.
        site : Site
        air : Weather
        """
        seconds = np.arange(0.0, self._forecast.end - start * 1e-9, self.knot)
        places = self.place(start + (seconds * 1e9).astype(np.int64), site, air)
        inside = np.all([(angle > low + _EDGE) & (angle < high - _EDGE)
                         for angle, (low, high) in zip(places, travel)], axis=0)
        if inside[:1].any() and not inside.all():
            self.until = start * 1e-9 + float(seconds[np.argmin(inside)])


def next_pass(orbit, now, site, mount, axes, low):
    """The present or next pass, a `PassForecast`.

    Raises
    ------
    CallRefused
        There is none soon.
    """
    found = pass_forecasts(orbit, now, SOON, site, mount=mount, axes=axes, low=low, dark=False)
    if not found:
        raise CallRefused(f'satellite {orbit.name} is not up within {SOON:.0f} h, or its orbit '
                          'ends before')
    return found[0]


def way_through(orbit, forecast, site, weather, mount, axes):
    """Axis angles through a pass and across its keyholes, for `PassPointing`."""
    from scipy.interpolate import CubicHermiteSpline
    time, angles = pass_track(orbit, forecast, site, weather, mount)
    rates = np.gradient(angles, STEP, axis=0)
    for hole in forecast.keyholes:
        k = hole.axis
        angles[:, k], rates[:, k] = across(time, angles[:, k], rates[:, k], hole, axes[k])
    return CubicHermiteSpline(time, angles, rates)


def observe_pass(night, step):
    """Steps that observe a satellite through its next pass; the outcome in words.

    Parameters
    ----------
    night : NightSteps
    step : PlanStep

    Raises
    ------
    CallRefused
        The file of its orbit cannot be read, or there is no pass soon.
    """
    value, exposer, guard = night.out.value, night.exposer, night.out.guard
    try:
        target = satellite_target(step.what)
    except OSError as err:  # an error of a plan ends the plan, not the node
        raise CallRefused(f'{step}: {err.filename}: {err.strerror}') from None
    mount, orbit, (site, weather) = night.out.mount(), target.orbit, night.out.sky()
    axes = _axes(night)
    forecast = next_pass(orbit, exposer.now() * 1e-9, site, mount, axes,
                         value('min_elevation_deg') * DEG)
    way = way_through(orbit, forecast, site, weather, mount, axes)
    lost = ''.join(f'; {hole.lost:.0f} s are lost in the keyhole of the '
                   f'{mount.names.axes[hole.axis]}' for hole in forecast.keyholes)
    night.announce(f'{target.name}: a pass of {(forecast.end - forecast.start) / 60.0:.1f} min up '
                   f'to {forecast.top_el / DEG:.0f} deg{lost}')
    begin = round(forecast.start * 1e9)
    if exposer.now() < begin - round(_EARLY * 1e9):
        yield from _wait_for(night, begin - round(_EARLY * 1e9), target.name)
        if not _goes_on(night):
            yield from exposer.expose(AxesAtRest(night.instruments.here, mount))
    yield from _wait_for(night, max(begin, exposer.now()), target.name)
    rows = 0
    while True:
        pointing = PassPointing(target, night.active, np.zeros(2), mount,
                                value('meridian_limit_deg') * DEG, forecast, way)
        if max(exposer.now(), exposer.earliest) * 1e-9 > forecast.end - 3.0 * pointing.knot - 1.0:
            break
        if not mount.vertical and guard.allowed is not None and guard.allowed.travel:
            pointing.keep_within(guard.allowed.travel, max(exposer.now(), exposer.earliest), site,
                                 weather)
        rows += yield from night.observe(target, pointing=pointing)
        yield from _wait_for(night, _beside(forecast.keyholes, max(
            exposer.commanded + round(value('satellite_interval_s') * 1e9), exposer.now())),
            target.name)
    return f'{target.name}: {rows} rows of its pass{lost}'


def _wait_for(night, stamp, name):
    """Command nothing before a stamp, ns; wait if the clock runs by itself."""
    night.exposer.earliest = stamp
    if _goes_on(night):
        yield from night.until(lambda: night.out.now() >= stamp, name)


def _goes_on(night):
    """Whether time runs by itself: without repeated requests it waits for events."""
    return night.instruments.live or night.out.value('renew_request_s') > 0.0


def _beside(keyholes, stamp):
    """The stamp, ns, or the end of the keyhole in which nothing could be observed then."""
    for hole in keyholes:
        if hole.begin - _EXPOSED < stamp * 1e-9 < hole.end:
            return round(hole.end * 1e9)
    return stamp


def _axes(night):
    """Limits of the axes for a track: those of the guard if known, else of the observer."""
    allowed = night.out.guard.allowed
    rate = night.out.value('slew_rate_deg_s') * DEG
    motion = allowed.motion if allowed is not None and len(allowed.motion) == 2 else (
        (rate, rate), (0.5 * rate, 0.5 * rate))
    return [Axis(-np.inf, np.inf, *of) for of in zip(*motion)]
