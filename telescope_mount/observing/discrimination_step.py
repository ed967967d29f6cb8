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

"""The step `tell_apart`: stars requested by the calibration, one after the other."""

import numpy as np

from msg_tools.units import DEG
from pointing_model.sky.star_catalogue import POLARIS_HIP, StarTarget

from .axis_demand import AxesAtRest
from .star_choice import axes_at, nearest_star

#: overshoot for an axis that must approach a star from the other side, deg: more than the backlash
#: of a gear
BEYOND = 5.0
_HOUR = 3600e9  # ns


def distinguish_causes(night, step):
    """Steps that observe the requested stars until nothing more is requested.

    Parameters
    ----------
    night : NightSteps
    step : plan.PlanStep

    Returns
    -------
    str
        The outcome.
    """
    taken, hours, tried = 0, step.hours, set()
    yield from night.calibration_has_all()
    if night.wanted is None or night.wanted.stamp < night.table.newest:
        yield from night.new_model('diagnose')
    while True:
        yield from night.calibration_has_all()
        yield from night.until(
            lambda: night.wanted is None or night.wanted.stamp >= night.table.newest,
            'the calibration to say what it asks for')
        if night.wanted is None:  # the calibration was restarted
            yield from night.new_model('diagnose')
            continue
        state, request = night.wanted.sentence, night.wanted.request or {}
        wait = request.get('after_hours') or 0.0
        pair = bool(request.get('before'))
        if not request or taken + pair >= step.count or wait > hours:
            break
        hours -= wait
        if wait:
            night.exposer.earliest = night.table.newest + round(wait * _HOUR)
        for one in filter(None, (request.get('before'), request)):
            rows = len(night.table)
            star, words = yield from _come_to(night, one, request, tried)
            tried.add(star.number)
            night.announce(words)
            taken += yield from night.observe(star, fresh=True)
            if len(night.table) == rows:
                break  # it will be requested again, with another star
    if taken:
        yield from night.new_model('diagnose')
    if wait > hours:
        return f'{state}; needs a star {wait:g} h later, but the plan waits {hours:g} h'
    return state + (f'; stopped after the planned {taken} stars' if request else '')


def _come_to(night, request, whole, tried):
    """Move the axes so that they approach the star from the requested side; return the star."""
    value, mount = night.out.value, night.out.mount()
    stars, limits = night.targets.stars, night.targets.limits()
    now = max(night.exposer.now(), night.exposer.earliest)
    place = request['az_deg'] * DEG, request['el_deg'] * DEG
    sides = int(request.get('approach_az') or 0), int(request.get('approach_el') or 0)
    here = np.array(night.instruments.here)
    short = request is whole and bool(whole.get('before'))
    row, off = nearest_star(
        stars, now * 1e-9, *place, *night.out.sky(),
        min_el=value('min_elevation_deg') * DEG, max_el=value('max_elevation_deg') * DEG,
        mag_limit=value('magnitude_limit'), magnitude=request.get('magnitude'),
        exclude=[*tried, *night.refused, POLARIS_HIP], mount=mount, limits=limits,
        # after a short move, so nothing may come in between
        **({'start': here, 'sides': sides} if short else {}))
    star = StarTarget(stars.select([row]))
    words = f'{star.name}, {off / DEG:.1f} deg from the requested place, ' + (
        whole['why'] if request is whole else 'the one before ' + whole['why'])
    if not short and any(sides):
        az, el = star.place(np.array([now * 1e-9]), *night.out.sky())
        there = np.array([v[0] for v in axes_at(mount, az, el, limits, np.array([star.number]))])
        move = np.array([mount.way(here[0], there[0]), there[1] - here[1]])
        if np.any(np.array(sides) * move < 0.0):
            yield from _go_beyond(night, here + move, np.where(sides, sides, np.sign(move)))
    return star, words


def _go_beyond(night, there, sides):
    """Send the axes to the start of the requested approach, and wait there for an exposure."""
    mount, value = night.out.mount(), night.out.value
    place = there - sides * BEYOND * DEG
    if mount.vertical:
        place[1] = np.clip(place[1], value('min_elevation_deg') * DEG,
                           value('max_elevation_deg') * DEG)
    # if the guard refuses it, observe the star anyway: its row has the approach
    yield from night.exposer.expose(AxesAtRest(place, mount))
