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

"""Nights with correlated noise: false effects, detected effects, and the expected error.

    python benchmarks/wandering_nights.py [--nights N] [--trials N] [--full] [--seed N]
                                          [--only PART ...]

Noise correlated from row to row (AR(1), rho), a random walk of 0.3" per row plus white noise of 1",
each star measured twice within seconds, noise that grows fourfold during the night, four gross
outliers. Each figure is compared with the same search assuming white noise. `--full` runs the sizes
for which the targets are stated (hours of CPU).
"""

import argparse
from unittest.mock import patch

import numpy as np
from diagnosis import Table, _explained, _shown
from diagnosis_nights import EFFECTS, OF_TIME, alike, make_run, scaled, sky

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.estimation.selection_problem import SelectionProblem
from msg_tools.units import ARCSEC

#: kind of noise -> limit of false effects, % of nights
LIMITS = {'white': 1.5, 'rho 0.3': 1.5, 'rho 0.6': 2.5, 'rho 0.9': 4.0, 'walk': 4.0,
          'twice': 2.5, 'growing': 2.5, 'outliers': 2.5}


def noise_of(kind, rng, n):
    """Noise of both axes, arcsec; all rows of `growing` after one another."""
    e = rng.normal(size=(2, n))
    if kind.startswith('rho'):
        rho = float(kind[4:])
        for i in range(1, n):
            e[:, i] = rho * e[:, i - 1] + np.sqrt(1.0 - rho * rho) * e[:, i]
    elif kind == 'walk':
        e += np.cumsum(0.3 * rng.normal(size=(2, n)), axis=1)
    elif kind == 'growing':
        e *= np.linspace(1.0, 4.0, n)
    elif kind == 'outliers':
        rows = rng.choice(n, 4, replace=False)
        e[:, rows] += rng.uniform(10.0, 60.0, (2, 4)) * rng.choice([-1, 1], (2, 4))
    return e


def night(kind, rng, n):
    """A night without any effect."""
    if kind != 'twice':
        c = sky(rng, n)
        return make_run(c, *noise_of(kind, rng, n))
    half = n // 2
    two = np.repeat(np.arange(half), 2)
    c = {name: values[two] for name, values in sky(rng, half).items()}
    c['time'] = c['time'] + np.tile([0.0, 8.0], half)
    c['miss_x'], c['miss_y'] = 8.0 * ARCSEC * rng.normal(size=(2, n))
    return make_run(c, *(0.95 * rng.normal(size=(2, half))[:, two]
                         + 0.3 * rng.normal(size=(2, n))))


def without_memory():
    """The search assuming white noise."""
    fit = SelectionProblem.fit

    def plain(self, chosen, weights=None, without=None, final=False, memory=None):
        return fit(self, chosen, weights, without, final, ())
    return patch.object(SelectionProblem, 'fit', plain)


def false_effects(table, args, rng):
    """Effects on nights without any."""
    for kind, limit in LIMITS.items():
        for n in (60,) if kind in ('twice', 'growing', 'outliers') else (30, 60, 200):
            false = wander = peer = 0
            peers = max(args.nights // 5, 1)
            for i in range(args.nights):
                run, seed = night(kind, rng, n), int(rng.integers(2**31))
                options = {'cross_validation': False, 'flips': args.flips, 'seed': seed}
                result = diagnose(run, **options)
                false += bool(result.effects)
                wander += result.verdict == 'wanders'
                if i < peers:
                    with without_memory():
                        peer += bool(diagnose(run, **options).effects)
            table.row(f'{kind}, N = {n}: false effect', _share(false, args.nights),
                      f'<= {limit} %', f'no memory: {_share(peer, peers)}; '
                      f'wanders: {_share(wander, args.nights)}',
                      false <= limit / 100.0 * args.nights)


def of_time(table, args, rng):
    """Effects of time, temperature and order on white nights."""
    for size in (7.0, 14.0):
        count = detected = identified = in_set = 0
        for i in range(args.trials):
            name = OF_TIME[i % len(OF_TIME)]
            c = sky(rng, 60)
            s = scaled(c, EFFECTS[name](c, rng), size)
            result = diagnose(make_run(c, *(rng.normal(size=(2, 60)) + s)),
                              cross_validation=False, flips=args.flips,
                              seed=int(rng.integers(2**31)))
            count += 1
            detected += result.verdict != 'none'
            identified += bool(result.effects)
            in_set += any(name in _shown(e) or alike(name, e.fitted.effect.name)
                          for e in result.effects)
        table.row(f'effects of time, lambda = {size:g}: detected', _share(detected, count), '',
                  f'as an effect: {_share(identified, count)}; right: {_share(in_set, count)}')


def beside(table, args, rng):
    """Effects not of time, beside correlated noise."""
    names = [name for name in EFFECTS if name not in OF_TIME]
    count = found = near = 0
    for i in range(args.trials):
        name = names[i % len(names)]
        c = sky(rng, 60)
        s = scaled(c, EFFECTS[name](c, rng), 9.0)
        if s is None:
            continue
        count += 1
        result = diagnose(make_run(c, *(noise_of('rho 0.6', rng, 60) + s)),
                          cross_validation=False, flips=args.flips, seed=int(rng.integers(2**31)))
        found += any(name in _shown(e) or e.fitted.effect.name.startswith(name)
                     for e in result.effects)
        near += any(alike(name, e.fitted.effect.name)
                    or 81.0 * (1.0 - _explained(result, e, s)) < 6.0 for e in result.effects)
    table.row('effects not of time, rho 0.6, lambda = 9: in the set', _share(found, count),
              '>= 90 %', f'classes as one: {_share(near, count)}', found >= 0.9 * count)


def headline(table, args, rng):
    """The cross-validated figure after, over seeds of the diagnosis."""
    c = sky(rng, 120)
    s = sum(scaled(c, EFFECTS[name](c, rng), 25.0) for name in (
        'azimuth_encoder_2', 'elevation_nod_3', 'azimuth_hysteresis_cosE', 'camera_scale'))
    run = make_run(c, *(rng.normal(size=(2, 120)) + s))
    seeds = max(args.nights // 20, 3)
    after = np.array([diagnose(run, seed=i).after['cv_rms_arcsec'] for i in range(seeds)])
    spread = np.ptp(after) / after.mean()
    table.row('four effects, 120 rows: (max - min) / mean of the figure after',
              f'{100.0 * spread:.1f} % of {seeds} seeds', '<= 5 %', f'{after.mean():.2f}"',
              spread <= 0.05)


def expected(table, args, rng):
    """How often the interval of the expected error holds the RMS of 100 fresh stars."""
    every, wide = [], []
    for kind in ('white', 'rho 0.3', 'rho 0.6', 'rho 0.9', 'walk', 'growing', 'an effect'):
        inside, width, found = [], [], []
        for _ in range(max(args.nights // 10, 5)):
            seen, fresh = _with_fresh(kind, rng)
            result = diagnose(seen, flips=args.flips, seed=int(rng.integers(2**31)))
            x, y = result.model.residuals(fresh)
            rms = np.sqrt(np.nanmean(x * x + y * y)) / ARCSEC
            told = result.expected
            inside.append(told['low_arcsec'] <= rms <= told['high_arcsec'])
            width.append(told['high_arcsec'] - told['low_arcsec'])
            found.append(rms)
        every += inside
        # who knew the noise, and not how this night came out, would say so much
        knew = float(np.diff(np.quantile(found, (0.05, 0.95)))[0])
        wide.append(np.median(width) / knew)
        share = 100.0 * np.mean(inside)
        table.row(f'expected error, 90 %: {kind}: holds fresh stars',
                  _share(sum(inside), len(inside)), '83 ... 97 %',
                  f'median width {np.median(width):.2f}", {wide[-1]:.2f} of who knew',
                  83.0 <= share <= 97.0)
    share = 100.0 * np.mean(every)
    table.row('expected error, 90 %: overall', _share(sum(every), len(every)), '86 ... 94 %', '',
              86.0 <= share <= 94.0)
    table.row('expected error, 90 %: width / that of who knew the noise, median',
              f'{np.median(wide):.2f}', '<= 2', '', np.median(wide) <= 2.0)


def _with_fresh(kind, rng, n=60, m=100):
    """A night, and fresh stars of the half hour after it, whose noise goes on."""
    c = sky(rng, n + m)
    c['time'][n:] = c['time'][n - 1] + np.sort(rng.uniform(30.0, 1800.0, m))
    gap = np.append(90.0, np.diff(c['time'])) / 90.0
    e = rng.normal(size=(2, n + m))
    if kind.startswith('rho'):
        keep = float(kind[4:]) ** gap
        for i in range(1, n + m):
            e[:, i] = keep[i] * e[:, i - 1] + np.sqrt(1.0 - keep[i]**2) * e[:, i]
    elif kind == 'walk':
        e += np.cumsum(0.3 * np.sqrt(gap) * rng.normal(size=(2, n + m)), axis=1)
    elif kind == 'growing':
        e *= np.append(np.linspace(1.0, 4.0, n), np.full(m, 4.0))
    elif kind == 'an effect':
        name = list(EFFECTS)[rng.integers(len(EFFECTS))]
        size = 1.0 if name.startswith('camera') else rng.uniform(1.0, 2.0)
        if name.endswith('_step'):  # while it is observed: after it nobody knows
            at = np.arange(n + m) >= rng.integers(n // 4, 3 * n // 4)
            e['elev' in name] += 5.0 * size * at * (1.0 if 'elev' in name else np.cos(c['el']))
        else:
            e += EFFECTS[name](c, rng) / ARCSEC * size
    run = make_run(c, *e)
    return run.select(np.arange(n)), run.select(np.arange(n, n + m))


def _share(k, n):
    return f'{100.0 * k / n:.1f} % of {n}'


PARTS = {'false': false_effects, 'time': of_time, 'beside': beside, 'headline': headline,
         'expected': expected}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--nights', type=int, default=50, help='without any effect, of each kind')
    parser.add_argument('--trials', type=int, default=60, help='nights with an effect')
    parser.add_argument('--flips', type=int, default=999)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--only', nargs='+', choices=PARTS, default=list(PARTS))
    parser.add_argument('--full', action='store_true', help='2000 nights, 600 trials')
    args = parser.parse_args()
    if args.full:
        args.nights, args.trials = 2000, 600
    print(f'{"what":66s} {"figure":>22s}  {"target":>14s}')
    for name in args.only:
        PARTS[name](Table(), args, np.random.default_rng(args.seed))


if __name__ == '__main__':
    main()
