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

"""Commands through the guard, checked by an independent integration of the axes in small steps.

    python benchmarks/guard.py [--full]

Random mounts at random sites and times, with random limits, skylines, positions and motions of the
axes, and tracks: of stars, of satellites, nonsense, and with impossible numbers. Commands that the
guard passes are executed by drives simulated step by step (`guard_drives.py`, which uses no code of
the guard). Each axis has a controller with its own speed and acceleration, within the values given
to the guard; if their relative timing is not given, one axis moves after the other. At each step
both axes or one of them are also stopped. A violation is a position beyond the travel, below the
skyline or nearer to the Sun than allowed and than at the start. If the direct way is refused, the
mount stops, if it moves, and takes the way around, point by point.

A command should be allowed if a way to it exists: the axes, stopped, and the whole track are in one
connected region of axis angles that keeps 2.5 degrees from horizon, Sun and ends of travel for ten
minutes (on a grid of 1 degree), and the rates and accelerations of the track are below 90 % of the
slowest drive's. Refusals of such commands are counted. Targets faster than 0.05 deg/s are counted
separately: the guard does not specify how a mount catches up with them.
"""

import argparse
import time

import numpy as np
from guard_drives import CORNERS, KNOTS, Many, Setting, carry_out, hermite

from msg_tools.units import DEG
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.sky.site import Site
from pointing_model.sky.skyline import Horizon
from telescope_mount.guard.detour import lead
from telescope_mount.guard.limits import Axis, Limits, travel_of
from telescope_mount.guard.motion import AxisState
from telescope_mount.guard.sky_limits import SUN, SkyCircles
from telescope_mount.guard.track_check import Allowed, TrackCheck

#: by what a drive that is controlled in steps of 0.05 s itself goes too far, rad
ROUNDING = 0.05 * DEG
#: allowed commands keep so far from everything, rad
MARGIN = 2.5 * DEG
#: targets that are faster are counted by themselves, rad/s
FAST = 0.05 * DEG
KINDS = ('star', 'satellite', 'nonsense', 'not a number')
OF_A_SETTING = 200


def setting(rng, number):
    """A `Setting`, the guard's `TrackCheck` of it, and the circles that it keeps out of."""
    kind = ('altaz', 'equatorial', 'german', 'free')[number % 4]
    latitude, longitude = rng.uniform(-65.0, 65.0) * DEG, rng.uniform(-np.pi, np.pi)
    site = Site(latitude, longitude, rng.uniform(0.0, 3000.0))
    sun = SkyCircles([(SUN, 0.0)], site)
    for _ in range(20):
        seconds = rng.uniform(1.58e9, 1.89e9)
        if sun.at(seconds)[0].toward[2] > -0.3 or number % 5 == 0:
            break
    sun.at(seconds - rng.uniform(0.0, 590.0))
    rate = rng.uniform(1.0, 8.0, 2) * DEG
    acceleration = rate / rng.uniform(0.5, 3.0, 2)  # s in which it brakes
    pole, mount = None, ALTAZ
    if kind == 'free':
        pole = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-80.0, 80.0) * DEG
        mount = Mount.free(*pole)
    elif kind != 'altaz':
        pole, mount = (0.0, latitude), Mount.equatorial(latitude, kind)
    travel = np.array(travel_of(mount)) * DEG
    if rng.random() < 0.3:
        travel = travel + rng.uniform(0.0, 60.0, (2, 2)) * [1.0, -1.0] * DEG * (0.5, 0.3)
    corners = np.zeros((0, 2))
    if rng.random() < 0.5:
        corners = skyline(rng)
    least = rng.uniform(0.0, 20.0) * DEG
    away = rng.uniform(10.0, 40.0) * DEG if rng.random() < 0.7 else 0.0
    timing = rng.uniform(0.3, 1.0) if rng.random() < 0.9 else 0.0
    keep_out = ((SUN, away),) if away else ()
    limits = Limits(mount, tuple(Axis(*ends, r, a) for ends, r, a in zip(
        travel.tolist(), rate.tolist(), acceleration.tolist())),
        Horizon(least, [tuple(c) for c in corners.tolist()]), keep_out, timing)
    own = Setting(kind, pole, latitude, longitude, seconds, travel, rate, acceleration, least,
                  corners, away, timing)
    own.check, own.over = TrackCheck(limits), site
    own.sky = [circle._replace(distance=away) for circle in sun.at(seconds)] if away else []
    own.found = None
    return own


def skyline(rng):
    """Corners, rad, (n, 2): some straight between them, some with walls, some in steps."""
    az = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(2, 12)))
    kind = rng.integers(0, 3)
    if kind:  # at each wall one corner on either side of it
        az = np.repeat(az[np.append(np.diff(az) > 2.0 * DEG, True)][:CORNERS // 2], 2)
    el = rng.uniform(0.0, 35.0, len(az)) * DEG
    if kind == 2:
        el[1::2] = np.roll(el[::2], -1)  # level between walls
    return np.column_stack([az, el])


def places(rng, own, count, margin):
    """Random angles within the travel, `margin` from all limits; None if there are too few."""
    low, high = own.travel[:, 0], own.travel[:, 1]
    angles = rng.uniform(low, high, (40 * count, 2))
    one = Many([own], np.zeros(len(angles), int))
    above, apart = one.clearances(angles.T, 0.0)
    angles = angles[(above > margin) & (apart > margin)]
    return angles if len(angles) >= count else None


def track_of(rng, own, kind, place):
    """Knots of a track."""
    if kind == 'star':
        times = np.arange(0.0, rng.integers(2, 9)) * 20.0 - rng.uniform(0.0, 15.0)
        rates = np.tile(rng.uniform(-20.0, 20.0, 2) * DEG / 3600.0, (len(times), 1))
        return times, place + times[:, None] * rates, rates
    times = np.cumsum(rng.uniform(0.2, 30.0, rng.integers(1, KNOTS - 1)))
    times -= times[0]
    size = (0.3 if kind == 'satellite' else 3.0) * own.rate
    rates = rng.uniform(-1.0, 1.0, (1, 2)) * size
    rates = rates + 0.1 * size * rng.standard_normal((len(times), 2)) * (len(times) > 1)
    steps = np.diff(times)[:, None] * (rates[1:] + rates[:-1]) / 2.0
    angles = place + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, 0)])
    if kind == 'not a number':
        wrong = rng.integers(0, 7)
        at = rng.integers(0, len(times))
        if wrong == 0:
            angles[at, rng.integers(2)] = rng.choice([np.nan, np.inf, -np.inf])
        elif wrong == 1:
            angles *= 180.0 / np.pi
        elif wrong == 2:
            times = times[::-1].copy()
        elif wrong == 3:
            rates[at] = rng.choice([np.nan, 1e300])
        elif wrong == 4:
            angles *= 3600.0 / DEG
        elif wrong == 5:
            times = times + rng.choice([-1e6, 1e6])
        else:
            angles[at] += rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 400.0)
    return times, angles, rates


def commands(rng, first, count):
    """Commands of some settings."""
    out = []
    for number in range(first, first + count // OF_A_SETTING):
        while (free := places(rng, own := setting(rng, number), 2 * OF_A_SETTING,
                              2.0 * DEG)) is None:
            pass
        anywhere = rng.uniform(own.travel[:, 0], own.travel[:, 1], (2 * OF_A_SETTING, 2))
        slow = own.acceleration * (own.timing or 1.0)
        for k in range(OF_A_SETTING):
            kind = KINDS[int(np.searchsorted((0.5, 0.7, 0.9, 1.0), rng.random()))]
            known = rng.random() < (0.9 if kind == 'star' else 0.3)
            track = track_of(rng, own, kind, (free if known else anywhere)[2 * k])
            angles = (free if rng.random() < 0.95 else anywhere)[2 * k + 1]
            rates = np.zeros(2)
            if rng.random() < 0.3:
                rates = rng.uniform(-0.5, 0.5, 2) * own.rate
                stop = angles + rates * np.abs(rates) / (2.0 * slow)
                both = np.array([angles, stop, (stop[0], angles[1]), (angles[0], stop[1])]).T
                one = Many([own], np.zeros(4, int))
                # whoever cannot stop any more is lost already
                if min(one.inside(both).min(), *map(np.min, one.clearances(both, 0.0))) < DEG:
                    rates = np.zeros(2)
            out.append({'setting': own, 'kind': kind, 'angles': angles, 'rates': rates,
                        'asked': track, 'track': track, 'vias': (), 'plans': False})
    return out


def judged(case, spent, spent_on_plans):
    """Check a command with the guard; whether it is allowed, and the reason."""
    own = case['setting']
    check, sky = own.check, own.sky
    state = AxisState(tuple(case['angles'].tolist()), tuple(case['rates'].tolist()))
    begin, steady = time.thread_time(), time.perf_counter()
    found = check.check(*case['track'], state, sky)
    spent.append((time.thread_time() - begin, time.perf_counter() - steady,
                  not isinstance(found, Allowed) and found.cubic is not None))
    if not isinstance(found, Allowed) and found.cubic is not None:
        begin, steady = time.thread_time(), time.perf_counter()
        rest = AxisState(tuple(  # where they stand after they have braked as they can
            angle + rate * abs(rate) / (2.0 * axis.acceleration)
            for angle, rate, axis in zip(*state, check.limits.axes)))
        led = lead(check, found.cubic, rest, sky)
        spent_on_plans.append((time.thread_time() - begin, time.perf_counter() - steady))
        if led is not None:
            vias, cubic = led
            case['plans'] = True
            case['vias'] = (*([rest.angles] if any(state.rates) else []), *vias)
            case['track'] = cubic.times, cubic.angles, cubic.rates
            return True, ''
    if isinstance(found, Allowed):
        case['track'] = found.cubic.times, found.cubic.angles, found.cubic.rates
        return True, ''
    return False, found.reason


def drives(rng, cases):
    """Fractions of speed and acceleration that each axis uses, and its delay."""
    timing = np.array([c['setting'].timing for c in cases])
    low = np.where(timing, timing, 1.0)[:, None, None]
    shares = low + (1.0 - low) * rng.random((len(cases), 2, 2))
    shares = np.where(rng.random((len(cases), 1, 1)) < 0.3, np.where(
        rng.random(shares.shape) < 0.5, low, 1.0), shares)  # the extremes
    waits = rng.uniform(0.0, 60.0, (len(cases), 2)) * (timing == 0.0)[:, None]
    return shares, waits * (rng.random(waits.shape) < 0.5)


def allowed(case):
    """Whether a way to the requested track exists, far from all limits, on some turn."""
    own, (times, angles, rates) = case['setting'], case['asked']
    if not (np.isfinite(angles).all() and np.isfinite(rates).all()) or np.any(
            np.diff(times) <= 0) or times[0] > 0.0 or not 0.0 <= times[-1] <= 3600.0 or np.abs(
            angles).max() > 100.0 or (len(times) == 1 and rates.any()):
        return False
    slow = own.timing or 1.0
    t = np.arange(times[0], times[-1] + 1.0, 0.2)
    place, speed = hermite(times, angles, rates, np.minimum(t, times[-1]))
    case['fast'] = bool(np.abs(speed).max() > FAST)
    bend = np.abs(np.diff(speed, axis=0)) / 0.2
    if np.any(np.abs(speed) > 0.9 * slow * own.rate) or (
            len(bend) and np.any(bend > 0.9 * slow * own.acceleration)):
        return False
    if not own.timing:  # in any order: where one axis was and the other will be
        ends = [np.arange(low, high + 0.2 * DEG, 0.2 * DEG) for low, high in
                zip(place.min(0), place.max(0))]
        place = np.stack(np.meshgrid(*ends), -1).reshape(-1, 2)
    # and braked from it by the slowest drive
    over = np.abs(speed).max(0)**2 / (2.0 * slow * own.acceleration)
    if own.found is None:
        own.found = own.regions(MARGIN)
    stop = case['angles'] + case['rates'] * np.abs(case['rates']) / (
        2.0 * slow * own.acceleration)
    begins = [_region(own.found, np.array([a, b])) for a in (case['angles'][0], stop[0])
              for b in (case['angles'][1], stop[1])]
    if len(set(begins)) > 1 or not begins[0]:
        return False
    for turn in np.arange(-3, 4) * 2.0 * np.pi if own.kind == 'altaz' else (0.0,):
        there = [_region(own.found, place + (turn, 0.0) + side * over) for side in (
            (0.0, 0.0), (1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))]
        if all(np.all(r == begins[0]) for r in there):
            return True
    return False


def _region(found, places):
    """Number of the region in which all corners of the grid about places are, else 0."""
    a, b, regions = found
    first = (places[..., 0] - a[0]) / (a[1] - a[0])
    second = (places[..., 1] - b[0]) / (b[1] - b[0])
    inside = (first >= 0.0) & (first <= len(a) - 1) & (second >= 0.0) & (second <= len(b) - 1)
    i = np.clip(first.astype(int), 0, len(a) - 2)
    j = np.clip(second.astype(int), 0, len(b) - 2)
    of = np.array([regions[i, j], regions[i + 1, j], regions[i, j + 1], regions[i + 1, j + 1]])
    same = inside & (of == of[0]).all(0)
    out = np.where(same, of[0], 0)
    return int(out) if out.ndim == 0 else out


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--full', action='store_true', help='1 000 000 commands instead of 4000')
    parser.add_argument('--commands', type=int)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--show', type=int, default=5, help='failures to print')
    args = parser.parse_args()
    total = args.commands or (1_000_000 if args.full else 4000)
    spent, on_plans, violations, false, chased = [], [], [], [], []
    done = passed = planned = refused = told = fine = fine_fast = 0
    began = time.perf_counter()
    while done < total:
        count = min(10000, total - done)
        rng = np.random.default_rng([args.seed, done])
        cases = commands(rng, done // OF_A_SETTING, count)
        found = [judged(case, spent, on_plans) for case in cases]
        go = [case for case, (ok, _) in zip(cases, found) if ok]
        depth = carry_out(go, *drives(rng, go))[0]
        for case, row in zip(go, depth):
            if row.min() < -ROUNDING:
                violations.append((case, row / DEG))
                if len(violations) <= args.show:
                    print('violation', said(case), row / DEG, flush=True)
        for case, (ok, why) in zip(cases, found):
            may = allowed(case)
            fine += may and not case['fast']
            fine_fast += may and case['fast']
            if may and not ok:
                (chased if case['fast'] else false).append((why, case))
                if len(chased if case['fast'] else false) <= args.show:
                    print('refused', why, said(case), flush=True)
            refused += not ok
            told += not ok and bool(why)
        done, passed = done + len(cases), passed + len(go)
        planned += sum(case['plans'] for case in go)
        if total > 10000:
            print(f'# {done}: {len(violations)} violations of {passed}, {len(false)} of {fine} and '
                  f'{len(chased)} of {fine_fast} refused, {time.perf_counter() - began:.0f} s',
                  flush=True)
    cpu, wall, ways = 1e3 * np.array(spent).T
    plan, plan_wall = 1e3 * np.array(on_plans).T
    rows = [
        ('commands', f'{done}', '10^6 with --full'),
        ('passed, of them on a way around', f'{passed}, {planned}', ''),
        ('violations', f'{len(violations)} of {passed}', '0'),
        ('refused, each with a reason', f'{refused}, {told}', 'all'),
        ('allowed commands refused', f'{len(false)} of {fine}', '0 of 10^5'),
        ('the same, targets faster than 0.05 deg/s', f'{len(chased)} of {fine_fast}', '0'),
        ('a judgement, processor time: median, mean, p99', _times(cpu), '0.2 ms'),
        ('the same by the clock', _times(wall), ''),
        ('the same where no way around is looked for', _times(cpu[ways == 0.0]), ''),
        ('a way around, processor time: median, mean, p99', _times(plan), ''),
    ]
    for what, figure, target in rows:
        print(f'{what:50} {figure:28} {target}')
    return bool(violations or false)


def _times(ms):
    if not len(ms):
        return '-'
    return f'{np.median(ms):.3f}, {ms.mean():.3f}, {np.percentile(ms, 99):.3f} ms'


def said(case):
    """A case in a line."""
    own = case['setting']
    return (f'{case["kind"]} {own.kind} from {np.round(case["angles"] / DEG, 2)} at '
            f'{np.round(case["rates"] / DEG, 2)} to {np.round(case["asked"][1][0] / DEG, 2)} '
            f'sun {own.sun / DEG:.1f} timing {own.timing:.2f} plans {case["plans"]}')


if __name__ == '__main__':
    raise SystemExit(main())
