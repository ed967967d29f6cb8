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

"""Causes of zero changes between power-ons: detection, false detection, accuracy of predictions.

    python benchmarks/zero_causes.py [--seasons N] [--nights N] [--full] [--seed N]

Seasons of eleven nights, without ROS. The drivers are temperature and supply voltage, and two
decoys: the time since the last power-on and the side of the mark. All are measured with noise (0.1
degC, 5 mV, 0.3" for a zero). `--full`: 1000 seasons of each kind.
"""

import argparse

import numpy as np
from diagnosis import Table

from calibration.analysis.zero.zero_causes import ZERO_ALPHA, Season, zero_causes
from msg_tools.units import ARCSEC

NIGHTS = 11
#: of a zero that nothing explains, arcsec
UNEXPLAINED, SCATTER = 3.0, 9.0
#: of the cause, arcsec / degC and arcsec / V
SLOPE, VOLTS = 3.0, (120.0, 60.0)
#: temperatures of the nights: independent, or a trend through the season and so much scatter, degC
LOW, HIGH, DAILY = -4.0, 16.0, 3.0


def temperatures(rng, n, daily=None):
    """Independent ones, or (with `daily`) a seasonal trend over the same range."""
    if daily is None:
        return rng.uniform(LOW, HIGH, n)
    return np.linspace(LOW, HIGH, n)[::rng.choice([-1, 1])] + rng.normal(0.0, daily, n)


def zeros_of(kind, rng, n):
    """Zeros without any cause, arcsec, shape (n, 2)."""
    e = rng.normal(size=(n, 2))
    if kind == 'unexplained':
        return UNEXPLAINED * e
    if kind == 'scatter':
        return SCATTER * e
    if kind == 'walk':
        return np.cumsum(SCATTER * e, axis=0)
    if kind == 'walk and scatter':
        return np.cumsum(5.0 * e, axis=0) + 5.0 * rng.normal(size=(n, 2))
    if kind == 'drift and scatter':
        return np.linspace(0.0, 30.0, n)[:, np.newaxis] + 5.0 * e
    for i in range(1, n):  # each resembles the one before
        e[i] = 0.7 * e[i - 1] + np.sqrt(1.0 - 0.49) * e[i]
    return SCATTER * e


def make_season(rng, n, kind, daily=None, slopes=(0.0, 0.0)):
    """A season: `slopes` are arcsec / degC of azimuth and arcsec / V of elevation."""
    warmth, volts = temperatures(rng, n, daily), 5.0 + rng.normal(0.0, 0.1, (n, 2))
    side = rng.choice([-1.0, 1.0], (n, 2))
    side[:2] = [[1.0], [-1.0]]
    zeros = zeros_of(kind, rng, n)
    zeros[:, 0] += slopes[0] * warmth
    zeros[:, 1] += slopes[1] * (volts[:, 1] - 5.0)
    zeros += 0.3 * rng.normal(size=(n, 2))
    return Season(
        np.arange(n), 86400.0 * np.arange(n), zeros * ARCSEC, np.full((n, 2), 0.3 * ARCSEC), {
            'temperature': warmth[:, np.newaxis] + rng.normal(0.0, 0.1, (n, 2)),
            'supply': volts + rng.normal(0.0, 0.005, (n, 2)),
            'hours': np.tile(24.0 + rng.normal(0.0, 1.0, (n, 1)), 2), 'side': side})


def trial(rng, n, *kind, leave_out, **slopes):
    """A season of n nights and what is found in it, with the night after it: document, pulls."""
    season = make_season(rng, n + 1, *kind, **slopes)
    tonight = {name: values[-1] for name, values in season.covariates.items()}
    found = zero_causes(season.select(slice(0, n)), tonight, leave_out=leave_out)
    pulls = [(season.zeros[-1, axis] / ARCSEC - told['zero_arcsec']) / told['sigma_arcsec']
             for axis, told in enumerate(found['tonight'].values())]
    return found, pulls


def causes(found, axis):
    """Drivers found for an axis."""
    return [cause['driver'] for cause in found['axes'][axis]['causes']]


def share(count, of):
    """As text, with the count."""
    return f'{100.0 * count / of:.1f} % of {of}'


def found_rows(table, args, rng):
    """Detection for zeros that depend on temperature, or on temperature and supply."""
    for what, daily, slopes, limit in (
            ('independent nights', None, (SLOPE, 0.0), 98.0),
            (f'seasonal trend, {DAILY:g} degC from night to night', DAILY, (SLOPE, 0.0), 70.0),
            ('seasonal trend, 2 degC from night to night', 2.0, (SLOPE, 0.0), None),
            *((f'independent nights, elevation with {volts:g}"/V', None, (SLOPE, volts), None)
              for volts in VOLTS)):
        trials = [trial(rng, args.nights, 'unexplained', daily, slopes=slopes,
                        leave_out=daily is None) for _ in range(args.seasons)]
        documents = [found for found, _ in trials]
        right = sum('temperature' in causes(d, 'azimuth') for d in documents)
        more = sum(causes(d, 'azimuth') not in ([], ['temperature'])
                   or (not slopes[1] and causes(d, 'elevation') != []) for d in documents)
        undecided = sum(d['axes']['azimuth']['verdict'] == 'undecided' for d in documents)
        supply = sum(causes(d, 'elevation') == ['supply'] for d in documents)
        supply = f'; supply in elevation {share(supply, args.seasons)}' if slopes[1] else ''
        table.row(f'{what}: temperature found', share(right, args.seasons),
                  '' if limit is None else f'>= {limit:g} %',
                  f'undecided {undecided}; a wrong cause beside or instead {more}{supply}',
                  None if limit is None else right >= limit / 100.0 * args.seasons)
        if daily is not None:
            continue
        for axis in ('azimuth', *(['elevation'] if slopes[1] else [])):
            before, after = (np.sqrt(np.mean([
                d['axes'][axis][f'left_out_{part}_arcsec']**2 for d in documents]))
                for part in ('before', 'after'))
            ratio = after / np.hypot(UNEXPLAINED, 0.3)
            table.row(f'{what}: {axis}, night left out, error / unexplained', f'{ratio:.2f}',
                      '' if slopes[1] else '<= 1.3',
                      f'{before:.1f}" before, {after:.2f}" after',
                      None if slopes[1] else ratio <= 1.3)
        pulls = np.array([p for _, p in trials])[:, 0]
        table.row(f'{what}: tonight within 1 sigma',
                  share(int(np.sum(abs(pulls) < 1)), len(pulls)), '68 %',
                  f'rms of error / sigma {np.sqrt(np.mean(pulls**2)):.2f}; '
                  f'beyond 3 sigma {int(np.sum(abs(pulls) > 3))}')


def false_rows(table, args, rng):
    """False detections for zeros without any cause."""
    for kind in ('scatter', 'walk', 'walk and scatter', 'drift and scatter', 'resembling nights'):
        for what, daily in (('independent nights', None), ('seasonal trend', DAILY),
                            ('seasonal trend, 1 degC', 1.0)):
            documents = [trial(rng, args.nights, kind, daily, leave_out=False)[0]
                         for _ in range(args.seasons)]
            false = sum(d['verdict'] == 'cause' for d in documents)
            levels = sum(min(axis['p_levels'] for axis in d['axes'].values()) <= ZERO_ALPHA
                         for d in documents)
            undecided = sum(d['verdict'] == 'undecided' for d in documents)
            table.row(f'{kind}, {what}: a cause', share(false, args.seasons), '<= 2 %',
                      f'the levels alone {100.0 * levels / args.seasons:.1f} %; '
                      f'undecided {share(undecided, args.seasons)}',
                      false <= 0.02 * args.seasons)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('--seasons', type=int, default=100)
    parser.add_argument('--nights', type=int, default=NIGHTS)
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    if args.full:
        args.seasons = 1000
    rng = np.random.default_rng(args.seed)
    table = Table()
    found_rows(table, args, rng)
    false_rows(table, args, rng)


if __name__ == '__main__':
    main()
