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

"""Sessions, outliers and cost of the diagnosis on runs that resemble measured ones.

    python benchmarks/sessions_and_outliers.py [--full] [--only PART ...] [--seed N]

outliers  nights without effects but with four gross outliers of 20 to 800 arcsec: false effects and
          false slips, with and without a declared graduation
slips     nights with three slips of whole lines and one outlier: slips reported, with correct rows
sessions  nights with constant zeros, jumping zeros, or zeros and tilt that jump: classified as such
cost      119 runs of 50 rows (ARC 3.5 m), 1108 rows in 29 sessions (IRAM 30 m), by the command in a
          separate process: CPU seconds, MB, and claimed effects

`--full` runs the sizes for which the limits are stated.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.sessions import arrange
from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun

TRUTH = dict(zip(PHYSICAL, np.array([20.0, -35.0, 25.0, -18.0, 30.0, -22.0, 15.0]) * ARCSEC))
LINE = 2.0 * np.pi / 47200


def night(rng, n, start=0.0, hours=5.0, noise=1.0, **moved):
    """Stars above 20 degrees; terms of `moved` are so many arcsec off."""
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(20.0 * DEG), np.sin(85.0 * DEG), n))
    terms = {t: v + moved.get(t, 0.0) * ARCSEC for t, v in TRUTH.items()}
    az_enc, el_enc = geometry.sky_to_encoder(az, el, terms)
    x, y = noise * ARCSEC * rng.normal(size=(2, n))
    return PointingRun({
        'time': 1.7e9 + 3600.0 * (start + np.sort(rng.uniform(0.0, hours, n))), 'az': az, 'el': el,
        'az_enc': az_enc + x / np.cos(el), 'el_enc': el_enc + y,
        'approach_az': np.sign(np.append(1.0, np.diff(az))),
        'approach_el': np.sign(np.append(1.0, np.diff(el))),
        'temperature': rng.normal(8.0, 2.0) + np.cumsum(rng.normal(0.0, 0.2, n))})


def row(what, figure, limit='', good=None):
    """A line of the table."""
    mark = '' if good is None else 'ok' if good else 'MISSED'
    print(f'{what:68s} {figure:>26s}  {limit:>10s}  {mark}', flush=True)


def outliers(args, rng):
    """False effects and slips."""
    count = args.nights
    for label, graduation in (('none', None), ('grating=47200', {'grating': 47200}),
                              ('grating=47200, bars=1080', {'grating': 47200, 'bars': 1080})):
        false = slips = 0
        for _ in range(count):
            run = night(rng, 60)
            for k in rng.choice(60, 4, replace=False):
                run.columns[rng.choice(['az_enc', 'el_enc'])][k] += rng.choice([-1, 1]) \
                    * rng.uniform(20.0, 800.0) * ARCSEC
            if graduation:
                run.meta['graduation'] = graduation
            result = diagnose(run, cross_validation=False, seed=int(rng.integers(2**31)))
            false += bool(result.effects)
            slips += any(e.fitted.effect.form == 'decode_slip' for e in result.effects)
        row(f'four gross outliers, graduation {label}: false effects, of them slips',
            f'{false}, {slips} of {count}', '2.5 %', false <= max(0.025 * count, 2))


def slips(args, rng):
    """What is left of the power."""
    count = args.nights // 2
    told = right = 0
    for _ in range(count):
        run = night(rng, 60)
        rows = np.sort(rng.choice(60, 4, replace=False))
        axis = rng.choice(['az', 'el'])
        run.columns[f'{axis}_enc'][rows[:3]] += LINE * rng.choice([-2, -1, 1, 2], 3)
        run.columns[f'{axis}_enc'][rows[3]] += rng.uniform(20.0, 800.0) * ARCSEC
        run.meta['graduation'] = {axis: {'grating': 47200}}
        found = [e.fitted.effect.parameters['rows'] for e in diagnose(
            run, cross_validation=False, flips=199).effects
            if e.fitted.effect.form == 'decode_slip']
        told += bool(found)
        right += bool(found) and set(rows[:3].tolist()) <= set(found[0])
    row('three slips by a line of 27.46" and an outlier: told, the rows named',
        f'{told}, {right} of {count}')


def sessions(args, rng):
    """Whether sessions are classified correctly."""
    count = args.nights // 2
    kinds = {'one mount': {}, 'zeros jump by 5"': {'IA': 5.0, 'IE': 5.0},
             'zeros and tilt jump by 5"': {'IA': 5.0, 'IE': 5.0, 'AN': 5.0, 'AW': 5.0}}
    for kind, sizes in kinds.items():
        apart = tilted = 0
        for _ in range(count):
            parts = [night(rng, int(rng.integers(15, 45)), 24.0 * i, **{
                t: s * rng.normal() for t, s in sizes.items()}) for i in range(4)]
            found = arrange(PointingRun.concatenate(parts))
            apart += found.hours is not None
            tilted += 'AN' in found.own_terms
        row(f'four nights in a file, {kind}: sessions, with a tilt of their own',
            f'{apart}, {tilted} of {count}')


def cost(args, rng):
    """By the command, as a user would."""
    whole = 1.0 if args.full else 0.2
    with tempfile.TemporaryDirectory() as folder:
        runs, names = int(119 * whole), []
        for i in range(runs):
            part = night(rng, 50, 24.0 * i, noise=3.0, **{t: 6.0 * rng.normal() for t in (
                'IA', 'IE', 'CA', 'AN', 'AW', 'TF')})
            part.columns['el_enc'] += 4.0 * ARCSEC * np.sin(2.0 * part['el'] + 0.4)
            part.columns['az_enc'] += 2.0 * ARCSEC * part['approach_az']
            part.columns.pop('time')
            names.append(f'{folder}/{i:03d}.csv')
            write_csv(part, names[-1])
        _command(f'{runs} runs of 50 rows', names, folder, 90.0 * whole, 600.0)
        parts = [night(rng, int(rng.integers(8, 70)), 24.0 * i, noise=2.5, IA=6.0 * rng.normal(),
                       IE=6.0 * rng.normal()) for i in range(max(int(29 * whole), 5))]
        rows = int(1108 * whole) if args.full else sum(map(len, parts))
        joined = PointingRun.concatenate(parts)
        joined = joined.select(np.arange(min(rows, len(joined))))
        write_csv(joined, f'{folder}/days.csv')
        _command(f'{len(joined)} rows in {len(parts)} sessions', [f'{folder}/days.csv'], folder,
                 45.0, 600.0)


def _command(what, names, folder, seconds, megabytes):
    code = ('import sys; from telescope_mount.cli import main; main(sys.argv[1:]); import resource;'
            'u = resource.getrusage(resource.RUSAGE_SELF); print(u.ru_utime + u.ru_stime, '
            'u.ru_maxrss / 1024.0)')
    out = subprocess.run([sys.executable, '-c', code, 'diagnose', *names, '--json',
                          f'{folder}/found.json'], capture_output=True, text=True, check=True)
    spent, used = (float(v) for v in out.stdout.split()[-2:])
    found = json.loads(Path(folder, 'found.json').read_text(encoding='utf-8'))
    row(f'{what}: CPU, memory', f'{spent:.0f} s, {used:.0f} MB',
        f'{seconds:.0f} s, {megabytes:.0f} MB', spent <= seconds and used <= megabytes)
    row(f'... {found["verdict"]}: ' + ', '.join(e['name'] for e in found['effects']),
        f'{found["before"]["cv_rms_arcsec"]:.2f} -> {found["after"]["cv_rms_arcsec"]:.2f}"')


PARTS = {'outliers': outliers, 'slips': slips, 'sessions': sessions, 'cost': cost}


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--full', action='store_true', help='the sizes of the limits: 400 nights')
    parser.add_argument('--nights', type=int, default=40, help='of each kind; half as many of some')
    parser.add_argument('--only', nargs='+', choices=PARTS, default=list(PARTS))
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    args.nights = 400 if args.full else args.nights
    print(f'{"what":68s} {"figure":>26s}  {"limit":>10s}')
    for name in args.only:
        PARTS[name](args, np.random.default_rng(args.seed))


if __name__ == '__main__':
    main()
