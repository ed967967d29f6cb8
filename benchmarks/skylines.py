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

"""Targets near skylines with walls, steps and spikes, checked by an independent polygon test.

    python benchmarks/skylines.py [--targets N] [--seed N]

Random skylines: corners, walls, spikes without width, several corners at one azimuth, no gap wider
than 265 degrees. They are written as users do: starting at any corner, in either direction, with
azimuths of 360 for 0 or below 0, with the first corner repeated at the end. The guard checks a
mount at rest and one that tracks a star; the observer selects with the same limits. Both are
compared with a ray-crossing test of whether the target lies in the polygon of corners and ground.
Targets within 0.05 degrees of the polygon are redrawn.
"""

import argparse

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.skyline import Horizon, parse_horizon
from telescope_mount.guard.allowed_sky import NEAR, AllowedSky, rows_of
from telescope_mount.guard.limits import Axis, Limits
from telescope_mount.guard.motion import AxisState
from telescope_mount.guard.track_check import Allowed, TrackCheck

#: what the guard may refuse beside a limit, and what the observer keeps away, deg
OWN, AWAY = 0.05, NEAR / DEG
EACH = 100  # targets of a skyline


def drawn(rng):
    """Corners of a skyline, deg, along rising azimuths within one turn: (n, 2)."""
    count = int(rng.integers(3, 10))
    az = np.sort(np.round(rng.uniform(-180.0, 180.0, count), int(rng.integers(0, 3))))
    gaps = np.diff(az, append=az[0] + 360.0)
    az = az[gaps > 0.5]
    if len(az) < 3 or gaps.max() > 265.0:
        return drawn(rng)
    corners = []
    for at in az:
        low, high, third = np.round(rng.uniform(-5.0, 70.0, 3), 2)
        kind = rng.integers(0, 6)
        heights = ([low], [low, high], [low, low + 10.0, low], [low, low], [low, high, third],
                   [low, high, high, third])[kind]
        corners += [(at, el) for el in heights]
    return np.array(corners)


def written(rng, corners):
    """The same as the text that a user writes."""
    first = int(rng.integers(len(corners)))
    corners = np.roll(corners, -first, axis=0)
    if rng.random() < 0.5:
        corners = np.concatenate([corners, corners[:1]])
    if rng.random() < 0.5:
        corners = corners[::-1]
    az = np.mod(corners[:, 0], 360.0)
    if rng.random() < 0.3:
        az = np.where(az > 180.0, az - 360.0, az)
    az = np.where((az == 0.0) & (rng.random(len(az)) < 0.5), 360.0, az)
    return ', '.join(f'{a:.10g} {el:.10g}' for a, el in zip(az, corners[:, 1]))


def polygon(corners):
    """Closed polygon of a skyline and the ground, deg: (n, 2), azimuths over one turn."""
    first, end = corners[0], corners[0] + (360.0, 0.0)
    return np.concatenate([corners, [end, (end[0], -90.0), (first[0], -90.0), first]])


def inside(corners, az, el):
    """Whether targets (deg, (n,)) lie in the polygon of a skyline."""
    x0, y0 = polygon(corners)[:-1].T[:, :, None]
    x1, y1 = polygon(corners)[1:].T[:, :, None]
    az = corners[0, 0] + np.mod(az - corners[0, 0], 360.0)
    with np.errstate(divide='ignore', invalid='ignore'):
        crossing = x0 + (el - y0) * (x1 - x0) / (y1 - y0)
    return np.sum(((y0 > el) != (y1 > el)) & (crossing > az), axis=0) % 2 == 1


def away(corners, az, el):
    """How far targets are from the skyline, deg; azimuths count by the cosine at the target."""
    along = np.concatenate([corners, corners[:1] + (360.0, 0.0)])
    nearest, scale = np.full(len(az), np.inf), np.cos(el * DEG)
    for (x0, y0), (x1, y1) in zip(along[:-1], along[1:]):
        for turn in (-360.0, 0.0, 360.0):
            dx, dy = (x1 - x0) * scale, y1 - y0
            px = (np.mod(az - corners[0, 0], 360.0) + corners[0, 0] + turn - x0) * scale
            py = el - y0
            square = dx * dx + dy * dy
            t = np.clip((px * dx + py * dy) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
            nearest = np.minimum(nearest, np.hypot(px - t * dx, py - t * dy))
    return nearest


def targets(rng, corners, count):
    """Targets, deg, many of them beside corners; none nearer than `OWN` to the skyline."""
    beside = corners[rng.integers(0, len(corners), 4 * count)].T
    anywhere = np.array([rng.uniform(-180.0, 180.0, 4 * count), rng.uniform(-5.0, 80.0, 4 * count)])
    near = beside + rng.normal(0.0, 1.0, (2, 4 * count)) * rng.choice([0.2, 2.0, 10.0], 4 * count)
    az, el = np.where(rng.random(4 * count) < 0.5, near, anywhere)
    good = (np.abs(el) < 85.0) & (away(corners, az, el) > OWN)
    return az[good][:count], el[good][:count]


def judged(rng, corners, text, count):
    """Of targets by one skyline: how many are judged wrong, by what; and how many there are."""
    axis = Axis(-400.0 * DEG, 400.0 * DEG, 4.0 * DEG, 2.0 * DEG)
    limits = Limits(axes=(axis, axis), horizon=Horizon(-90.0 * DEG, parse_horizon(text)),
                    keep_out=())
    track_check, az_el = TrackCheck(limits), targets(rng, corners, count)
    az, el = az_el
    building = inside(corners, az, el)
    wrong = dict.fromkeys(('let into it', 'refused beside it', 'let into it on a track',
                           'refused on a track', 'chosen in it', 'not chosen beside it'), 0)
    rates = rng.uniform(-15.0, 15.0, (len(az), 2)) * ARCSEC
    far = away(corners, az, el)
    for place, rate, hit, off in zip(np.array(az_el).T * DEG, rates, building, far):
        state = AxisState(tuple(place.tolist()))
        for name, times in (('', np.zeros(1)), (' on a track', np.array([-1.0, 1.0]))):
            moving = rate if name else 0.0 * rate
            track = times, place + times[:, None] * moving, np.tile(moving, (len(times), 1))
            passes = isinstance(track_check.check(*track, state), Allowed)
            wrong['let into it' + name] += passes and hit
            wrong['refused' + (name or ' beside it')] += not passes and not hit and (
                off > OWN + np.abs(moving).max() / DEG)
    sky = AllowedSky.from_rows(rows_of(limits), DEFAULT_SITE)
    chosen = sky(0.0, az * DEG, el * DEG)
    wrong['chosen in it'] = int(np.sum(chosen & (building | (far < 0.9 * AWAY))))
    wrong['not chosen beside it'] = int(np.sum(~chosen & ~building & far_off(corners, az, el)))
    return wrong, len(az), int(building.sum())


def far_off(corners, az, el):
    """Whether all of the sky 2.5 times as far as the observer keeps away is free."""
    free = np.ones(len(az), bool)
    for k in np.linspace(-2.5, 2.5, 26):
        for below in np.linspace(0.0, 2.5, 6):
            free &= ~inside(corners, az + k * AWAY / np.cos(el * DEG), el - below * AWAY)
    return free & (away(corners, az, el) > 2.5 * AWAY)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--targets', type=int, default=100_000)
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    count, buildings, skylines, wrong = 0, 0, 0, {}
    while count < args.targets:
        corners = drawn(rng)
        text = written(rng, corners)
        found, more, hit = judged(rng, corners, text, EACH)
        for name, cases in found.items():
            if cases and not wrong.get(name):
                print(f'# {name}: {text}')
            wrong[name] = wrong.get(name, 0) + cases
        count, buildings, skylines = count + more, buildings + hit, skylines + 1
    print('| targets | ' + ' | '.join(wrong) + ' |')
    print('| --- |' + ' --- |' * len(wrong))
    print(f'| {count}, {buildings} of them in the building, beside {skylines} skylines | '
          + ' | '.join(map(str, wrong.values())) + ' |')


if __name__ == '__main__':
    main()
