"""Commands through the guard, judged by an independent integration of the axes in small steps.

    python benchmarks/guard.py [--full]

Random mounts' limits, skylines, Suns, places and motions of the axes, and tracks: of stars, of
satellites, of nonsense, with numbers that cannot be. What the guard lets pass is carried out by
drives that are simulated step by step: each axis by a controller of its own with a speed and an
acceleration of its own within what the guard is told, no formula of the guard's. At each step both
axes or one of them are also stopped. A violation is a place beyond the travel, below the skyline or
nearer to the Sun than allowed, or than it was at the start. Where the straight way is refused the
way around is gone, point after point.

A refusal is a false one where no drive of those that are allowed (49: either axis from the slowest
to the fastest), stopped or not, comes nearer than 1 degree to anything, nor does the track itself,
the rates and accelerations of the track are below 90 % of the slowest drive's, and the travel has
room for the way in which a drive brakes from the speed of the target. Targets faster than
0.05 deg/s are counted by themselves: how a mount runs after them the guard leaves open.
"""

import argparse
import time

import numpy as np

from msg_tools.units import DEG
from pointing_model.guard.judging import Allowed, Judge
from pointing_model.guard.limits import TRAVEL_DEG, Axis, Horizon, Limits
from pointing_model.guard.motion import FAST, State
from pointing_model.guard.way import around
from pointing_model.mounts import ALTAZ, Mount

LATITUDE = 34.3 * DEG
MOUNTS = {'altaz': ALTAZ, 'equatorial': Mount.equatorial(LATITUDE),
          'german': Mount.equatorial(LATITUDE, 'german'), 'free': Mount.free(0.0, 0.0)}
POLE = np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
#: s; and of the sky, rad/s
STEP, TURNING = 0.05, 7.292e-5
#: by what a drive that is controlled in steps of 0.05 s itself goes too far, rad
ROUNDING = 0.1 * DEG
FALSE_WITHIN = 1.0 * DEG
#: of the range of a drive's speed and acceleration
SHARES = np.linspace(0.0, 1.0, 7)
#: commands are carried out for so long
SECONDS = 300.0
KINDS = ('star', 'satellite', 'nonsense', 'not a number')


def setting(rng, kind):
    """Limits, the Sun, and whether it is to be kept away from."""
    mount = MOUNTS[kind]
    rate = rng.uniform(1.0, 8.0, 2) * DEG
    acceleration = rate / rng.uniform(0.5, 3.0, 2)  # s in which it brakes
    axes = tuple(Axis(low * DEG, high * DEG, r, a) for (low, high), r, a in zip(
        TRAVEL_DEG[kind], rate, acceleration))
    points = []
    if rng.random() < 0.5:
        corners = np.sort(rng.uniform(0.0, 360.0, rng.integers(2, 12)))
        points = list(zip(corners * DEG, rng.uniform(0.0, 35.0, len(corners)) * DEG))
    limits = Limits(mount, axes, Horizon(rng.uniform(0.0, 20.0) * DEG, points),
                    sun=rng.uniform(10.0, 40.0) * DEG if rng.random() < 0.7 else 0.0,
                    timing=rng.uniform(0.3, 1.0))
    # the Sun at a declination and an hour angle that it has
    first, second = rng.uniform(-np.pi, np.pi), rng.uniform(-23.4, 23.4) * DEG
    return limits, MOUNTS['equatorial'].direction(first, second)


def clearances(limits, first, second, sun, beside=0.0):
    """Above the skyline, and from the Sun, rad: of arrays of angles. By the definition;

    the skyline is the highest within `beside` (rad) to either side.
    """
    east, north, up = limits.mount.direction(first, second)
    el = np.arctan2(up, np.hypot(east, north))
    az = np.mod(np.arctan2(east, north), 2.0 * np.pi)
    least = np.full(np.shape(az), limits.horizon.least)
    if limits.horizon.points:
        a, e = np.array(sorted(limits.horizon.points)).T
        for k in np.linspace(-1.0, 1.0, 9) if beside else (0.0,):
            least = np.maximum(least, np.interp(
                az + k * np.minimum(beside / np.maximum(np.cos(el), 1e-3), np.pi), a, e,
                period=2.0 * np.pi))
    place = np.stack([east, north, up], -1)
    # chords: an arc cosine near 0 is not needed
    apart = 2.0 * np.arcsin(np.clip(np.linalg.norm(place - sun, axis=-1) / 2.0, 0.0, 1.0))
    return el - least, apart


def turned(sun, seconds):
    """The Sun after a time, by rotating about the pole."""
    angle = -TURNING * seconds
    side = np.cross(POLE, sun, axisb=0, axisc=0)
    along = np.multiply.outer(POLE, POLE @ sun)
    return sun * np.cos(angle) + side * np.sin(angle) + along * (1.0 - np.cos(angle))


def place_of(rng, limits, sun, free=True):
    """Random angles within the travel, where nothing is in the way if `free`."""
    while True:
        angles = np.array([rng.uniform(axis.low, axis.high) for axis in limits.axes])
        above, apart = clearances(limits, *angles, sun)
        if not free or (above > 2.0 * DEG and apart > limits.sun + 2.0 * DEG):
            return angles


def track_of(rng, kind, limits, sun):
    """Knots of a track."""
    if kind == 'star':
        times = np.arange(0.0, rng.integers(2, 9)) * 20.0
        rates = np.tile(rng.uniform(-20.0, 20.0, 2) * DEG / 3600.0, (len(times), 1))
        return times, place_of(rng, limits, sun, rng.random() < 0.9) + times[:, None] * rates, rates
    times = np.cumsum(rng.uniform(0.2, 30.0, rng.integers(1, 12)))
    times -= times[0]
    size = (0.3 if kind == 'satellite' else 3.0) * np.array([a.rate for a in limits.axes])
    rates = rng.uniform(-1.0, 1.0, (1, 2)) * size
    rates = rates + 0.1 * size * rng.standard_normal((len(times), 2)) * (len(times) > 1)
    steps = np.diff(times)[:, None] * (rates[1:] + rates[:-1]) / 2.0
    angles = place_of(rng, limits, sun, False) + np.concatenate([np.zeros((1, 2)),
                                                                np.cumsum(steps, 0)])
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


def dense(times, angles, rates, steps):
    """Angles and rates of a track at each step; before and after it, its ends at rest."""
    t = np.arange(steps) * STEP
    if len(times) == 1:
        return np.repeat(angles, steps, 0), np.zeros((steps, 2))
    i = np.clip(np.searchsorted(times, t, 'right') - 1, 0, len(times) - 2)
    h = np.diff(times)[i]
    s = np.clip((t - times[i]) / h, 0.0, 1.0)
    out = (np.stack([2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, 3 * s**2 - 2 * s**3,
                     s**3 - s**2]),
           np.stack([6 * s**2 - 6 * s, 3 * s**2 - 4 * s + 1, 6 * s - 6 * s**2,
                     3 * s**2 - 2 * s]) / h)
    knots = np.stack([angles[i], h[:, None] * rates[i], angles[i + 1], h[:, None] * rates[i + 1]])
    place, speed = (np.einsum('kn,knj->nj', b, knots) for b in out)
    speed[t > times[-1]] = 0.0
    return place, speed


def drive(rng, cases, shares, seconds):
    """Carry commands out, all at once.

    Yields
    ------
    angles, stops : ndarray, shape (n, 2)
        After each step, and where the axes would come to rest.
    """
    n, steps = len(cases), int(seconds / STEP)
    tracks = [dense(*case['track'], steps) for case in cases]
    place, speed = (np.array([t[k] for t in tracks]) for k in (0, 1))
    most = max(len(case['vias']) for case in cases)
    vias = np.zeros((n, most + 1, 2))
    for k, case in enumerate(cases):
        vias[k, :len(case['vias'])] = np.reshape(case['vias'], (-1, 2))
    count = np.array([len(case['vias']) for case in cases])
    angle = np.array([case['state'].angles for case in cases], float)
    rate = np.array([case['state'].rates for case in cases], float)
    bounds = np.array([[axis[2:] for axis in case['limits'].axes] for case in cases])
    top, most_a = (bounds * shares).transpose(2, 0, 1)
    leg, since, rows = np.zeros(n, int), np.zeros(n, int), np.arange(n)
    for _ in range(steps):
        via = leg < count
        since = np.where(via, 0, np.minimum(since + 1, steps - 1))
        target = np.where(via[:, None], vias[rows, np.minimum(leg, most)], place[rows, since])
        frame = np.where(via[:, None], 0.0, speed[rows, since])
        error = target - angle
        # as fast as can still be braked, within a step and in relation to the target
        way = np.sqrt(2.0 * most_a * np.abs(error) + (most_a * STEP)**2 / 4.0) - most_a * STEP / 2.0
        wanted = np.clip(frame + np.sign(error) * np.minimum(way, np.abs(error) / STEP), -top, top)
        before = rate
        rate = rate + np.clip(wanted - rate, -most_a * STEP, most_a * STEP)
        angle = angle + 0.5 * (before + rate) * STEP
        there = (np.abs(error).max(1) < 0.05 * DEG) & (np.abs(rate).max(1) < 0.05 * DEG)
        leg = leg + (via & there)
        # where each axis comes to rest if it is stopped now
        yield angle, angle + rate * np.abs(rate) / (2.0 * most_a)


def depths(rng, cases, shares, seconds, beside=0.0):
    """By how much commands keep within their limits at the worst, rad: travel, skyline, Sun.

    Relative to the limit or, where they began beyond it, to their begin.
    """
    groups = {}
    for k, case in enumerate(cases):
        groups.setdefault(id(case['limits']), []).append(k)
    history = [both for i, both in enumerate(drive(rng, cases, shares, seconds)) if i % 4 == 0]
    angles, stops = (np.array([h[k] for h in history]) for k in (0, 1))
    seconds = np.arange(len(history)) * 4 * STEP
    worst = np.full((len(cases), 3), np.inf)
    for rows in groups.values():
        limits, sun = cases[rows[0]]['limits'], cases[rows[0]]['sun']
        now = turned(sun[:, None], seconds).T[:, None]
        # stopped at any moment, one axis before the other
        for first, second in ((angles, angles), (stops, stops), (stops, angles), (angles, stops)):
            both = first[:, rows, 0], second[:, rows, 1]
            above, apart = clearances(limits, *both, now, beside)
            apart = apart - limits.sun if limits.sun else np.full(above.shape, np.inf)
            inside = np.min([np.minimum(x - axis.low, axis.high - x)
                             for x, axis in zip(both, limits.axes)], 0)
            worst[rows] = np.minimum(worst[rows], np.stack([inside, above, apart], -1).min(0))
    start = np.empty_like(worst)
    for rows in groups.values():
        limits, sun = cases[rows[0]]['limits'], cases[rows[0]]['sun']
        first = np.array([cases[k]['state'].angles for k in rows])
        above, apart = clearances(limits, *first.T, sun)
        inside = np.min([np.minimum(first[:, j] - axis.low, axis.high - first[:, j])
                         for j, axis in enumerate(limits.axes)], 0)
        start[rows] = np.stack([inside, above, apart - limits.sun if limits.sun
                                else np.full(len(rows), np.inf)], 1)
    return worst - np.minimum(start, 0.0), start


def commands(rng, count):
    """Commands of a few settings."""
    out = []
    limits = sun = judge = None
    for number in range(count):
        if number % 40 == 0:
            limits, sun = setting(rng, rng.choice(list(MOUNTS)))
            judge = Judge(limits)
        kind = str(rng.choice(KINDS, p=(0.5, 0.2, 0.2, 0.1)))
        times, angles, rates = track_of(rng, kind, limits, sun)
        moving = rng.random() < 0.3
        state = State(tuple(place_of(rng, limits, sun, rng.random() < 0.95)), tuple(
            rng.uniform(-0.5, 0.5) * axis.rate * moving for axis in limits.axes))
        out.append({'limits': limits, 'sun': sun, 'judge': judge, 'kind': kind, 'state': state,
                    'track': (times, angles, rates), 'vias': ()})
    return out


def judged(case, spent):
    """Ask the guard; whether it lets the command pass, and its words."""
    judge, limits = case['judge'], case['limits']
    sun = (case['sun'], POLE) if limits.sun else (None, None)
    begin = time.perf_counter()
    found = judge.judge(*case['track'], case['state'], *sun)
    spent.append(time.perf_counter() - begin)
    case['plans'] = False
    if not isinstance(found, Allowed) and found.cubic is not None and not any(
            case['state'].rates):
        begin = time.perf_counter()
        vias = around(judge, found.cubic, case['state'], *sun)
        spent_on_plans.append(time.perf_counter() - begin)
        if vias is not None:
            case['plans'], case['vias'] = True, tuple(vias)
            case['track'] = found.cubic.times, found.cubic.angles, found.cubic.rates
            return True, ''
    if isinstance(found, Allowed):
        case['track'] = found.cubic.times, found.cubic.angles, found.cubic.rates
        return True, ''
    return False, found.reason


def harmless(cases):
    """Of refused commands, whether no drive comes near anything with them."""
    fine = np.array([is_one(case) for case in cases], bool)
    rows = np.flatnonzero(fine)
    if not len(rows):
        return fine
    some = [cases[k] for k in rows]
    share = np.array(np.meshgrid(SHARES, SHARES)).reshape(2, -1).T
    low = np.array([case['limits'].timing for case in some])[:, None, None]
    shares = low + (1.0 - low) * share[None]
    depth, start = depths(None, [case for case in some for _ in share],
                          np.repeat(shares.reshape(-1, 2, 1), 2, 2), SECONDS,
                          FALSE_WITHIN)
    room = np.repeat([overshoot(case) for case in some], len(share))
    good = ((np.minimum(depth, 9.0).min(1) > FALSE_WITHIN) & (start.min(1) > 0.0)
            & (depth[:, 0] > FALSE_WITHIN + room))
    fine[rows] = good.reshape(len(some), -1).all(1)
    return fine


def overshoot(case):
    """In which the slowest drive brakes from the fastest of the track, rad."""
    speed = np.abs(dense(*case['track'], int(case['track'][0][-1] / STEP) + 1)[1]).max(0)
    slowest = np.array([axis.acceleration for axis in case['limits'].axes])
    return float((speed**2 / (2.0 * slowest * case['limits'].timing)).max())


def is_one(case):
    """Whether the numbers are those of a track that a drive can follow."""
    times, angles, rates = case['track']
    if not (np.isfinite(angles).all() and np.isfinite(rates).all()) or np.any(np.diff(times) <= 0) \
            or times[0] or times[-1] > 3600.0 or np.abs(angles).max() > 100.0:
        return False
    if len(times) == 1:
        return not rates.any()
    axes = np.array([axis[2:] for axis in case['limits'].axes]) * 0.9 * case['limits'].timing
    place, speed = dense(times, angles, rates, int(times[-1] / STEP) + 1)
    limits = case['limits']
    above, apart = clearances(limits, *place.T, case['sun'], FALSE_WITHIN)
    case['fast'] = np.abs(speed).max() > FAST
    return bool(np.all(np.abs(speed) < axes[:, 0]) and np.all(np.abs(rates) < axes[:, 0])
                and np.all(np.abs(np.diff(speed, axis=0)) / STEP < axes[:, 1])
                and above.min() > FALSE_WITHIN
                and (not limits.sun or apart.min() > limits.sun + 2.0 * FALSE_WITHIN))


spent_on_plans = []


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--full', action='store_true', help='1 000 000 commands instead of 4000')
    parser.add_argument('--commands', type=int)
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    total = args.commands or (1_000_000 if args.full else 4000)
    rng, spent, passed, planned, violations, false, told = (
        np.random.default_rng(args.seed), [], 0, 0, [], [], 0)
    refused_all, clean, chased = 0, [0, 0], []
    for begin in range(0, total, 400):
        cases = commands(rng, min(400, total - begin))
        found = [judged(case, spent) for case in cases]
        go = [case for case, (ok, _) in zip(cases, found) if ok]
        stay = [(case, why) for case, (ok, why) in zip(cases, found) if not ok]
        told += sum(bool(why) for _, why in stay)
        if go:
            low = np.array([case['limits'].timing for case in go])[:, None, None]
            shares = low + (1.0 - low) * rng.random((len(go), 2, 2))
            depth = depths(rng, go, shares, SECONDS)[0]
            for case, row in zip(go, depth):
                if row.min() < -ROUNDING:
                    violations.append((case, row / DEG))
        passed += len(go)
        planned += sum(case['plans'] for case in go)
        refused_all += len(stay)
        fine = harmless([case for case, _ in stay]) if stay else np.zeros(0, bool)
        for (case, why), ok in zip(stay, fine):
            if ok:
                (chased if case['fast'] else false).append((why, case))
        for case in go:
            clean[int(np.abs(case['track'][2]).max() > FAST)] += not case['plans']
    spent = np.array(spent) * 1e3
    rows = [
        ('commands', f'{total}', '10^6 with --full'),
        ('passed, of them on a way around', f'{passed}, {planned}', ''),
        ('violations', f'{len(violations)} of {passed}', '0'),
        ('refused, each with a reason', f'{refused_all}, {told}', 'all'),
        ('allowed commands refused', f'{len(false)} of {clean[0] + len(false)}', '0 of 10^5'),
        ('the same, targets faster than 0.05 deg/s',
         f'{len(chased)} of {clean[1] + len(chased)}', ''),
        ('a judgement, median, mean, p99', f'{np.median(spent):.3f}, {spent.mean():.3f}, '
         f'{np.percentile(spent, 99):.3f} ms', '0.2 ms'),
        ('a way around, median, p99', '-' if not spent_on_plans else
         f'{np.median(spent_on_plans) * 1e3:.0f}, {np.percentile(spent_on_plans, 99) * 1e3:.0f} ms',
         ''),
    ]
    for what, figure, target in rows:
        print(f'{what:40} {figure:28} {target}')
    for case, depth in violations[:5]:
        print('violation', case['kind'], case['limits'].mount.kind, depth, case['plans'])
    for why, case in false[:5]:
        print('refused', why, case['kind'], case['limits'].mount.kind)
    return bool(violations or false)


if __name__ == '__main__':
    raise SystemExit(main())
