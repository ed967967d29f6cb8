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

"""Many nights in the whole graph: accuracy of the zero, and RMS of held-out stars.

    python benchmarks/night_seeds.py --seeds 200

Each seed gives other stars, noise and power-on drift (20" per axis, scenario `default`; star noise
1" per axis). The true drift is read from the simulator's own bag after the night. Prints the median
held-out radial RMS of each kind of model, in units of sqrt(2)", and the pull (measured - true) /
sigma of the change of the zero.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np

from telescope_mount.nights.whole_night import run_night


def one_night(seed, stars):
    """Report of one night, and its duration, s."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        report = run_night(Path(folder) / 'night', seed=seed, stars=stars)
        return report, time.perf_counter() - began


def main():
    """Run the nights, then print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=200)
    parser.add_argument('--first', type=int, default=1)
    parser.add_argument('--stars', type=int, default=30)
    parser.add_argument('--keep', type=Path, help='file to which each report is appended (JSON)')
    args = parser.parse_args()
    reports, seconds = [], []
    for seed in range(args.first, args.first + args.seeds):
        report, took = one_night(seed, args.stars)
        reports.append(report)
        seconds.append(took)
        if args.keep:
            with open(args.keep, 'a', encoding='utf-8') as file:
                file.write(json.dumps({'seed': seed, 'seconds': took, **report}) + '\n')
    print_tables(reports, seconds)


def print_tables(reports, seconds):
    """Print the results of all nights."""
    print(f'{len(reports)} nights, {np.median(seconds):.1f} s each (median), '
          f'{max(seconds):.1f} s the longest')
    print(f'\n{"held-out radial RMS":42} {"median":>8} {"/ sqrt 2":>9} {"5 %":>7} {"95 %":>7}')
    for label in [step['step'] for step in reports[0]['steps']]:
        values = [step['held_out']['radial'] for r in reports for step in r['steps']
                  if step['step'] == label]
        low, middle, high = np.percentile(values, [5, 50, 95])
        print(f'{label:42} {middle:8.3f} {middle / np.sqrt(2):9.3f} {low:7.2f} {high:7.2f}')
    print(f'\n{"change of the zero":12} {"bias":>7} {"spread":>7} {"sigma":>7} {"sigma max":>9} '
          f'{"pull rms":>8} {"worst":>6}   arcsec')
    for axis in ('az', 'el'):
        changes = [r['changes'][0] for r in reports]
        key = f'{axis}_arcsec'
        error = np.array([c[key] - c['simulated'][key] for c in changes])
        sigma = np.array([c[f'sigma_{key}'] for c in changes])
        pull = error / sigma
        print(f'{axis:12} {error.mean():+7.3f} {error.std():7.3f} {np.median(sigma):7.3f} '
              f'{sigma.max():9.3f} {np.sqrt(np.mean(pull**2)):8.2f} {np.abs(pull).max():6.2f}')


if __name__ == '__main__':
    main()
