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

"""Checks small moves of each axis: does the mount follow, and does the camera see them?"""

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.rms import rms
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import air_at
from pointing_model.sky.star_catalogue import StarTarget, load_catalogue
from telescope_mount.observing.star_choice import has_neighbour

from ..observing.axis_demand import Pointing
from ..observing.star_choice import AxisLimits, axes_at
from .samples import OK, WRONG, Remark, Remarks, wrong_unit

#: largest rotation (rad) and relative scale error of a camera
TURNED, SCALED = 2.0 * DEG, 0.05
#: default size of a nudge
STEP_DEG = 0.05
#: largest final error of a nudge, rad
FOLLOWED = 30.0 * ARCSEC
#: a stopped mount farther than this from its start has gone astray, rad
FAR = 0.2 * DEG


def check_nudge(samples, rests, star=False):
    """Remarks on small moves of each axis.

    Parameters
    ----------
    samples : DriverSamples
        Recorded during the moves.
    rests : list of Rest
        Five: at the start, with the first axis moved, back, with the second one moved, back.
    star : bool
        Whether a bright star must be in the field.

    Returns
    -------
    list of Remark
    """
    out = Remarks('command')
    stamps, values, _ = samples.incremental.arrays()
    names = samples.mount.names.axes
    means = []
    for rest in rests:
        here = values[(stamps >= rest.begin) & (stamps <= rest.end)]
        here = here[np.isfinite(here).all(axis=1)]
        if not len(here):
            return [Remark(WRONG, samples.incremental.topic, 'no reading while it was nudged')]
        means.append(rest.demand + np.column_stack(
            [wrap(here[:, 0] - rest.demand[0]), here[:, 1] - rest.demand[1]]).mean(axis=0))
    for axis, moved in ((0, 1), (1, 3)):
        step = rests[moved].demand - rests[moved - 1].demand
        went = (means[moved] - means[moved - 1]) / step[axis]
        off = float(np.abs(means[moved] - rests[moved].demand).max())
        if abs(went[axis]) < 0.2 and abs(went[1 - axis]) > 0.5:
            out.wrong(f'axes exchanged: {names[1 - axis]} moved for {names[axis]}')
        elif went[axis] < -0.2:
            out.wrong(f'{names[axis]} went the other way')
        elif abs(went[axis]) < 0.2:
            out.wrong(f'{names[axis]} did not move for a command of '
                      f'{abs(step[axis]) / DEG:.3g} deg')
        elif abs(went[axis] - 1.0) > 0.1:
            out.wrong(f'{names[axis]} moved {went[axis]:.3g} times as far as commanded')
        elif off > FOLLOWED:
            out.wrong(f'{names[axis]} ended {off / ARCSEC:.0f} arcsec from the demand')
        else:
            out.ok(f'{names[axis]} follows, to {off / ARCSEC:.1f} arcsec')
    if any(remark.level == WRONG for remark in out):
        return out
    return [*out, *_nudged_camera(samples, rests, star)]


def _nudged_camera(samples, rests, star):
    """Check sign, rotation and scale by the star's motion, with a linear drift fitted."""
    out = Remarks(samples.camera.topic)
    stamps, values, _ = samples.camera.arrays()
    rows, misses = [], []
    home = rests[0].demand
    for rest in rests:
        inside = (stamps >= rest.begin) & (stamps <= rest.end) & np.isfinite(values).all(axis=1)
        away = (rest.demand - home) * (np.cos(home[1]), 1.0)
        rows += [(1.0, stamp - rests[0].begin, *away) for stamp in stamps[inside]]
        misses += list(values[inside])
        if not inside.any() and star:
            out.wrong('the star is not in the field: check the site, the clock, the pointing, the '
                      'order of the axes in both drivers, and the camera')
            return out
        if not inside.any():
            out.note('no star in the field at each step: camera not judged; point at a bright '
                     'star first (--star)')
            return out
    rows, misses = np.array(rows), np.array(misses)
    if len(rows) < 6:
        out.note(f'{len(rows)} exposures: too few to judge the camera')
        return out
    size = np.abs(rows).max(axis=0)
    answer = np.linalg.lstsq(rows / size, misses, rcond=None)[0] / size[:, None]
    moves = answer[2:].T  # column k: for axis k
    left = rms(misses - rows @ answer)
    scale = float(np.sqrt(abs(np.linalg.det(moves))))
    if left > 0.2 * float(size[2:].max()) * max(scale, 0.1):
        out.note(f'the star does not move evenly ({left / ARCSEC:.0f} arcsec left): another star, '
                 'or the mount does not rest; camera not judged')
    elif scale < 0.1:
        out.wrong('the star does not move with the mount')
    else:
        _check_turn(out, -moves / scale)
        _check_scale(out, scale)
    return out


def _check_turn(out, unit):
    """Check whether a camera's axes are those of the mount, by the star's moves of unit length."""
    if np.linalg.det(unit) < 0.0:
        flips = ((np.diag([-1.0, 1.0]), 'x has the other sign'),
                 (np.diag([1.0, -1.0]), 'y has the other sign'),
                 (np.array([[0.0, 1.0], [1.0, 0.0]]), 'x and y are exchanged'))
        gap, text = min((float(np.abs(unit - flip).max()), text) for flip, text in flips)
        out.wrong(text if gap < 0.3 else 'mirrored and turned: one of x and y has the other sign')
        return
    turn = float(np.arctan2(unit[1, 0] - unit[0, 1], unit[0, 0] + unit[1, 1]))
    if abs(abs(turn) - np.pi) < 10.0 * DEG:
        out.wrong('both signs are reversed: it must be star - boresight')
    else:
        out.add(WRONG if abs(turn) > TURNED else OK,
                f'turned by {turn / DEG:.1f} deg against the axes')


def _check_scale(out, scale):
    if abs(scale - 1.0) > SCALED:
        out.wrong(f'scale {scale:.4g}, 1 would be right{wrong_unit(scale, ": {} for radians?")}')
    else:
        out.ok(f'scale right to {abs(scale - 1.0):.1%}')


def went_elsewhere(before, after, mount):
    """Where the axes went before they were stopped in a nudge, '' if they hardly moved.

    Parameters
    ----------
    before, after : ndarray, shape (2,)
        rad; `after` is None if unknown.
    mount : Mount

    Returns
    -------
    str
    """
    if after is None or np.abs(after - before).max() < FAR:
        return ''
    first, second = mount.names.axes
    moved, exchanged = after - before, before[::-1] - before
    text = (f' (it had moved {first} by {moved[0] / DEG:+.1f}, {second} by '
            f'{moved[1] / DEG:+.1f} deg')
    if moved @ exchanged > 0.9 * np.linalg.norm(moved) * np.linalg.norm(exchanged):
        text += ': toward where it is with the axes exchanged; look at what follows command'
    return text + ')'


#: limits for a bright star: Hipparcos magnitude, and elevation, rad
BRIGHT, LOW, HIGH = 3.0, 30.0 * DEG, 75.0 * DEG


def fixed_place(here):
    """Place of a mount at rest, in the form of `place_of`: ``place(times)``, rad, (n, 2)."""
    return lambda times: np.tile(here, (len(times), 1))


def place_of(target, mount, site, here):
    """Readings of a perfect mount that follows a star, on the turn nearest to `here`.

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
        first, second = pointing.place(np.asarray(times) * 1e9, site, air_at(site.height))
        turns = np.round((here[0] - first[0]) / (2.0 * np.pi)) if mount.vertical else 0.0
        return np.column_stack([first + 2.0 * np.pi * turns, second])
    return angles


def bright_star(mount, site, time, here, allowed=None):
    """The bright star without neighbours that the axes reach soonest.

    Parameters
    ----------
    mount : Mount
    site : Site
    time : float
        UTC, s.
    here : ndarray, shape (2,)
        Readings, rad.
    allowed : AllowedSky, optional
        Region in which the guard allows the tube to point.

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
    az, el = observed_place(stars.select(rows), time, site, air_at(site.height))
    good = (el > LOW) & (el < HIGH) & ~has_neighbour(stars, rows) & limits.reached(
        mount, az, el, HIGH if mount.vertical else 80.0 * DEG, time, stars.hip[rows])
    if not good.any():
        raise ValueError(f'no star brighter than {BRIGHT:g} between {LOW / DEG:.0f} and '
                         f'{HIGH / DEG:.0f} deg where the guard lets the tube look: look at site '
                         'and clock, or wait')
    first, second = axes_at(mount, az[good], el[good], limits, stars.hip[rows[good]])
    way = np.maximum(np.abs(mount.way(here[0], first)), np.abs(second - here[1]))
    return StarTarget(stars.select([rows[good][np.argmin(way)]]))
