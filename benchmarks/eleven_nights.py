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

"""Paper 000's eleven nights for many seeds, without ROS: errors after the zero calibration.

    python benchmarks/eleven_nights.py --seeds 100

Thirteen nights per seed, simulated as in `zero_drift` (mount, incremental encoder, homing, star
noise of 1") and evaluated as in `telescope-mount experiment`: the model of two nights before,
before and after the zero calibration. The paper's table is printed for comparison.
"""

import argparse
import json

import numpy as np
from zero_drift import Night

from calibration.night_series import NightSeries
from encoder_sim.scenario_file import load_scenario
from telescope_mount.papers.table_1 import PAPER_TABLE_1, compare_with_paper, statistics

NIGHTS = 11
COLUMNS = ('before_az', 'before_el', 'after_az', 'after_el')
#: largest night mean and RMS over the nights after calibration, azimuth and elevation
TARGETS = {'max': (2.6, 0.8), 'rms': (1.37, 0.56)}


def one(scenario, seed):
    """Statistics of table 1, and errors after calibration in predicted sigmas."""
    series = NightSeries(2, split_seed=seed)
    for number in range(NIGHTS + 2):
        rows = Night(scenario, seed, number).observe()
        rows.columns['run'] = np.full(len(rows), float(number - 1))
        series.add(rows, number + 1)
        series.calibrate_zero()
        _, report = series.fit()
    out = compare_with_paper(report['nights'], NIGHTS)
    return out['statistics'], [out['budget'][f'{axis}_chi'] for axis in ('az', 'el')]


def main():
    """Simulate, print; 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=100)
    parser.add_argument('--scenario', default='eleven_random_nights')
    parser.add_argument('--json', help='write the figures')
    args = parser.parse_args()
    scenario = load_scenario(args.scenario)
    results, chi = zip(*(one(scenario, seed) for seed in range(1, args.seeds + 1)))
    paper = statistics(PAPER_TABLE_1)
    figures = {f'{name} {key}': np.array([r[f'{name}_arcsec'][key] for r in results])
               for name in COLUMNS for key in ('mean', 'std', 'rms', 'max')}
    print(f'{args.seeds} seeds, scenario {args.scenario}; arcsec, azimuth as coordinate\n')
    print(f'{"":16} {"median":>8} {"5 %":>8} {"95 %":>8} {"paper":>8} {"target":>8}')
    missed = 0
    for name, values in figures.items():
        column, key = name.rsplit(' ', 1)
        target = TARGETS.get(key, (None, None))[column.endswith('el')]
        target = target if column.startswith('after') else None
        low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
        verdict = ''
        if target is not None:
            verdict = f'{target:8.2f} {"reached" if middle <= target else "MISSED"}'
            missed += middle > target
        print(f'{name:16} {middle:8.2f} {low:8.2f} {high:8.2f} '
              f'{paper[f"{column}_arcsec"][key]:8.2f} {verdict}')
    chi = np.array(chi)  # (seed, axis, night)
    print('\nmeans after calibration / predicted sigma')
    for axis, values in zip(('azimuth', 'elevation'), np.moveaxis(chi, 1, 0)):
        rms = float(np.sqrt(np.mean(values**2)))
        beyond = float(np.mean(np.abs(values) > 3.0))
        print(f'{axis:16} RMS {rms:.3f}, mean {values.mean():+.3f}, beyond 3 sigma {beyond:.2%} of '
              f'{values.size} nights')
    if args.json:
        with open(args.json, 'w', encoding='utf-8') as file:
            json.dump({name: values.tolist() for name, values in figures.items()}, file)
    return int(missed > 0)


if __name__ == '__main__':
    raise SystemExit(main())
