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

"""Undeclared periods of worms and gears: detection, accuracy of the period, false detections.

    python benchmarks/periods.py [--nights N] [--on-sky] [--full] [--verbose]

Nights of a German and an alt-azimuth mount in random order above 20 degrees. One axis has a worm or
gear with a whole number of periods per turn, uniform from 10 to 1000 and unknown to the search,
which tests both axes. The amplitude is that of the axis angle, so on the sky an error of the first
axis is multiplied by the cosine of the second angle. `--on-sky` compensates this: the RMS on the
sky is that of the amplitude. `found`: a periodic error of that axis is added. `exact`: its period
is correct to half of the resolution (1 / turns of travel). `to the tooth`: rounded, it is the true
number. `other`: nights with any other effect. `clean`: nights without it, in white noise and in
correlated noise (correlation 0.9 from row to row, half of the variance).
"""

import argparse
import time

import numpy as np
from equatorial_runs import LATITUDE, make_run, sky

from calibration.analysis.diagnosis.diagnosis import diagnose
from pointing_model.mounts import Mount

#: rows and amplitude, in units of the noise of a row in an axis
SIZES = ((60, 1.9), (120, 1.2))
KINDS = ('german', 'altaz')
CLEAN = (30, 60, 200)
_ALIKE = 0.9


def night(kind, rows, amplitude, rng, memory=False, on_sky=False):
    """A run, its axis and its periods a turn."""
    mount = Mount() if kind == 'altaz' else Mount.equatorial(LATITUDE, kind)
    columns = sky(rng, rows, mount)
    columns = {name: columns[name] for name in ('az', 'el', 'time', 'approach_az', 'approach_el')}
    axis, turns = ('az', 'el')[rng.integers(2)], int(rng.integers(10, 1001))
    error = rng.normal(size=(2, rows))
    if memory:
        slow = error.copy()
        for i in range(1, rows):
            slow[:, i] = _ALIKE * slow[:, i - 1] + np.sqrt(1.0 - _ALIKE**2) * slow[:, i]
        error = np.sqrt(0.5) * (slow + rng.normal(size=(2, rows)))
    wave = amplitude * np.cos(turns * columns[axis] + rng.uniform(0.0, 2.0 * np.pi))
    seen = np.cos(columns['el']) if axis == 'az' else np.ones(rows)
    error[int(axis == 'el')] += wave * seen / (np.sqrt(np.mean(seen**2)) if on_sky else 1.0)
    return make_run(columns, *error, mount), axis, turns


def periods_of(result):
    """Periodic errors found: axis and periods per turn of each."""
    effects = [one.fitted.effect for one in result.effects]
    return [(e.axes, e.parameters['turns']) for e in effects if e.form == 'periodic']


def measure(kind, rows, amplitude, args):
    """A line of the table: nights with a worm."""
    rng, start = np.random.default_rng(args.seed), time.process_time()
    counts = np.zeros((2, 5), int)
    for i in range(args.nights):
        run, axis, turns = night(kind, rows, amplitude, rng, on_sky=args.on_sky)
        result = diagnose(run, cross_validation=False, seed=i)
        mine = [found for of, found in periods_of(result) if of == axis]
        half = np.pi / np.ptp(run[axis])
        exact = any(abs(found - turns) < half for found in mine)
        tooth = any(round(found) == turns for found in mine)
        counts[int(axis == 'el')] += (
            1, bool(mine), exact, tooth, len(result.effects) > bool(mine))
        if args.verbose and not exact:
            print('    ', axis, turns, [e.fitted.effect.name for e in result.effects])
    seconds = (time.process_time() - start) / args.nights
    for axis, (nights, found, exact, tooth, other) in zip(('first', 'second'), counts):
        print(f'{kind:8s} {rows:4d} {amplitude:5.1f}  {axis:7s} found {found} of {nights}, exact '
              f'{exact} of {found}, to the tooth {tooth}, other {other}; {seconds:.2f} s of CPU',
              flush=True)


def clean(kind, rows, memory, args):
    """A line of the table: nights without one."""
    rng, found, other = np.random.default_rng(args.seed + 1), 0, 0
    for i in range(args.nights):
        run, _, _ = night(kind, rows, 0.0, rng, memory)
        result = diagnose(run, cross_validation=False, seed=i)
        found += bool(periods_of(result))
        other += len(result.effects) > len(periods_of(result))
    print(f'{kind:8s} {rows:4d} {"memory" if memory else "white":8s} periods in {found} of '
          f'{args.nights} clean nights, other effects in {other}', flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--nights', type=int, default=20)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--only', choices=('worm', 'clean'))
    parser.add_argument('--on-sky', action='store_true', help='amplitude as seen on the sky')
    parser.add_argument('--full', action='store_true', help='200 nights')
    parser.add_argument('--verbose', action='store_true', help='list what was missed')
    args = parser.parse_args()
    if args.full:
        args.nights = 200
    for kind in KINDS:
        for rows, amplitude in SIZES if args.only != 'clean' else ():
            measure(kind, rows, amplitude, args)
        for rows in CLEAN if args.only != 'worm' else ():
            for memory in (False, True):
                clean(kind, rows, memory, args)


if __name__ == '__main__':
    main()
