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

"""Diagnosis of the residual: false alarms, identification, held-out gain, measured runs, speed.

    python benchmarks/diagnosis.py [--nights N] [--trials N] [--data FOLDER] [--full] [--seed N]
                                   [--only PART ...]

Simulated mounts are exact rotations (`pointing_model.geometry`). Their effects use formulas
independent of the dictionary (an eccentric disc by arctan, refraction by Bennett's formula, gear
backlash, an axis that tilts during the night, ...), scaled to a given lambda = |(1 - P) s| / sigma:
the signal that the seven terms cannot absorb, in units of the noise. Each figure is compared with a
peer in the same run: plain selection by BIC, a fit that knows the effect, the six-term model.

Near aliases count as one class: those expected on any night (`CLASSES`), and in each run those that
the true signal separates by less than the set width of 6 in 2 ln L. `--full` runs the sizes for
which the targets are stated (an hour of CPU). FOLDER holds spk8m/ and arc35m/ (skipped if absent).
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from diagnosis_nights import (
    EFFECTS,
    OF_FIXED_SIZE,
    OF_TIME,
    OUTSIDE,
    alike,
    grating,
    make_run,
    noise,
    on_az,
    on_el,
    scaled,
    sky,
)

from calibration.analysis.diagnosis.base_terms import Base
from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.exact_models import exact_fit, exact_model
from calibration.analysis.diagnosis.observations import observations
from calibration.analysis.diagnosis.run_problem import RunProblem
from calibration.estimation.candidate_scores import CandidateGroup
from calibration.estimation.false_alarms import ALPHA
from calibration.estimation.group_columns import orthonormal
from msg_tools.units import ARCSEC
from pointing_model.pointing_terms import PHYSICAL, STANDARD6, stacked_design
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run

# ---------------------------------------------------------------------------------------- parts


class Table:
    """Rows: what, figure, target, peer."""

    def row(self, what, figure, target, peer='', good=None):
        mark = '' if good is None else ('ok' if good else 'MISSED')
        print(f'{what:66s} {figure:>22s}  {target:>14s}  {mark:6s} {peer}', flush=True)


def _share(k, n):
    return f'{100.0 * k / n:.2f} % of {n}'


def clean_nights(table, args, rng):
    """False alarms."""
    for kind, target in (('gauss', 1.5), ('t4', 2.5), ('1/sin E', 2.5)):
        for n in (30, 60, 200):
            alarms = plain = 0
            for _ in range(args.nights):
                c = sky(rng, n)
                run = make_run(c, *noise(rng, kind, c['el']))
                result = diagnose(run, cross_validation=False, flips=args.flips,
                                  seed=int(rng.integers(2**31)))
                alarms += bool(result.effects)
                plain += result.ranking[0]['delta_bic'] > 0.0
            table.row(f'clean nights, {kind} noise, N = {n}: false effect',
                      _share(alarms, args.nights), f'<= {target} %',
                      f'plain delta BIC > 0: {100.0 * plain / args.nights:.0f} %',
                      100.0 * alarms / args.nights <= target)


def _explained(result, entry, s):
    """Fraction of the true signal, orthogonal to the base, that an effect can represent."""
    c = result.observations.context
    base = orthonormal(stacked_design(PHYSICAL, c.az, c.el))
    s = np.asarray(s).ravel()
    s = s - (base @ s) @ base
    columns = entry.columns.reshape(len(entry.columns), -1)
    columns = columns - (columns @ base.T) @ base
    q = orthonormal(columns)
    return float(np.square(q @ s).sum() / (s @ s))


def _shown(entry):
    return {entry.fitted.effect.name, *entry.alternatives, *entry.aliases}


def one_effect(table, args, rng):
    """Identification of one undeclared effect: at the edge, and above it."""
    others = [*(name for name in EFFECTS if name not in OF_TIME), 'azimuth_subdivision_grating_1']
    for kind, names in (('', others), (' of time', OF_TIME)):
        for what, low, high in (('lambda = 7', 7.0, 7.0), ('lambda 7 to 14', 7.0, 14.0)):
            _one_effect(table, args, rng, kind, names, what, (low, high))


def _one_effect(table, args, rng, kind, names, what, sizes):
    told = count = found = top = class_top = in_set = drift = 0
    missed = []
    for i in range(args.trials):
        name, size = names[i % len(names)], rng.uniform(*sizes)
        c = sky(rng, 60)
        e = noise(rng, 'gauss', c['el'])
        if name in EFFECTS:
            s = scaled(c, EFFECTS[name](c, rng), size)
        else:
            angle = grating(c, *e, 2.0 * ARCSEC)
            s = scaled(c, on_az(c, angle), size)
        if s is None:
            continue
        seed = int(rng.integers(2**31))
        if name in OF_FIXED_SIZE:
            continue
        count += 1
        result = diagnose(make_run(c, *(e + s)), cross_validation=False, flips=args.flips,
                          seed=seed)
        found += bool(result.effects)
        told += result.verdict != 'none'
        ok = any(name in _shown(x) or x.fitted.effect.name.startswith(name)
                 for x in result.effects)
        best = any(name in {x.fitted.effect.name, *x.aliases} for x in result.effects)
        near = any(alike(name, x.fitted.effect.name)
                   or size**2 * (1.0 - _explained(result, x, s)) < 6.0 for x in result.effects)
        in_set, top, class_top = in_set + ok, top + best, class_top + (best or near)
        drift += ok or any(one == name or one.startswith(name) or alike(name, one)
                           for one in (result.noise_memory or {}).get('like', ()))
        if not ok:
            missed.append(f'{name} -> {[x.fitted.effect.name for x in result.effects]}')
    label = f'one effect{kind}, {what}, 60 stars: '
    table.row(label + 'detected', _share(told, count), '',
              f'as an effect, not as a wander: {100.0 * found / count:.1f} %')
    # a small drift and a wandering zero are not told apart by one night
    table.row(label + 'true one in the set', _share(in_set, count), '' if kind else '>= 98 %',
              good=None if kind else in_set >= 0.98 * count)
    if kind:
        table.row(label + 'in it, or named beside a drift', _share(drift, count), '')
    table.row(label + 'top of the ranking, classes as one', _share(class_top, count),
              '' if kind else '>= 95 %', f'by name alone {100.0 * top / count:.1f} %',
              None if kind else class_top >= 0.95 * count)
    if args.verbose:
        print('\n'.join('    ' + m for m in missed))


def two_effects(table, args, rng, size=10.0):
    """Identification of two undeclared effects at once, not of time."""
    names, count, both = [name for name in EFFECTS if name not in OF_TIME], 0, 0
    missed = []
    for _ in range(args.trials // 2):
        first, second = rng.choice(len(names), 2, replace=False)
        c = sky(rng, 60)
        e = noise(rng, 'gauss', c['el'])
        parts = [scaled(c, EFFECTS[names[k]](c, rng), size) for k in (first, second)]
        if any(p is None for p in parts):
            continue
        # two of one class are one effect
        base = orthonormal(stacked_design(PHYSICAL, c['az'], c['el']))
        a, b = (p.ravel() - (base @ p.ravel()) @ base for p in parts)
        if size**2 * (1.0 - (a @ b)**2 / (a @ a) / (b @ b)) < 36.0:
            continue
        seed = int(rng.integers(2**31))
        if {names[first], names[second]} & OF_FIXED_SIZE:
            continue
        count += 1
        result = diagnose(make_run(c, *(e + parts[0] + parts[1])), cross_validation=False,
                          flips=args.flips, seed=seed)
        shown = set().union(*(_shown(x) for x in result.effects)) if result.effects else set()
        good = names[first] in shown and names[second] in shown
        both += good
        if not good:
            missed.append(f'{names[first]} + {names[second]} -> '
                          f'{[x.fitted.effect.name for x in result.effects]}')
    table.row(f'two effects, lambda = {size:g} each, 60 stars: both in the sets',
              _share(both, count), '>= 90 %', good=both >= 0.9 * count)
    if args.verbose:
        print('\n'.join('    ' + m for m in missed))


def held_out(table, args, rng):
    """Fresh stars of the same mount, against the noise floor and a fit that knew the effect."""
    for kind, names in (('', [name for name in EFFECTS if name not in OF_TIME]),
                        (' of time', OF_TIME)):
        _held_out(table, args, rng, kind, names)


def _held_out(table, args, rng, kind, names):
    ours, known, before = [], [], []
    for i in range(args.trials // 2):
        name = names[i % len(names)]
        both = sky(rng, 460)
        # one night of an hour and a half: nothing is extrapolated in time
        both['time'] = 1.7e9 + (both['time'] - 1.7e9) * 60.0 / 460.0
        chosen = np.sort(rng.permutation(460)[:60])
        rate = rng.uniform(5.0, 10.0) / 5.0  # of the 5" in U
        s = EFFECTS[name](both, rng)
        if not name.startswith('camera'):
            s = s * rate
        s = s / ARCSEC
        e = noise(rng, 'gauss', both['el'])
        whole = make_run(both, *(e + s))
        others = np.setdiff1d(np.arange(460), chosen)
        train, test = whole.select(chosen), whole.select(others)
        result = diagnose(train, cross_validation=False, flips=args.flips,
                          seed=int(rng.integers(2**31)))
        floor = np.sqrt(np.mean(np.square(e[:, others]).sum(axis=0)))
        ours.append(_radial(result.model, test) / floor)
        before.append(_radial(result.base_model, test) / floor)
        known.append(_knew(train, test, name) / floor)
    root = [float(np.sqrt(np.mean(np.square(v)))) for v in (ours, known, before)]
    median = float(np.median(ours))
    table.row(f'held-out radial RMS / noise floor, 60 stars, effects{kind} of 5-10"',
              f'{root[0]:.3f} (median {median:.3f})', '' if kind else '<= 1.06',
              f'fit that knew the effect {root[1]:.3f}; seven terms {root[2]:.3f}',
              None if kind else root[0] <= 1.06)


def _radial(model, run):
    x, y = model.residuals(run)
    return float(np.sqrt(np.mean(x**2 + y**2))) / ARCSEC


def _knew(train, test, name):
    run = RunProblem(observations(train), Base.parse('physical'), ALPHA)
    bank = run.problem.dictionary
    gain = bank.score(run.problem.fit([])).delta_bic
    # of the times of a step the best
    chosen = [CandidateGroup(max((i for i, e in enumerate(bank.effects) if e.name == name),
                                 key=lambda i: gain[i]))]
    fitted = exact_fit(run, chosen, run.problem.fit(chosen, final=True))
    return _radial(exact_model(run, fitted, chosen)[0], test)


def outside(table, args, rng, size=10.0):
    """Effects that are not in the dictionary."""
    for kind, of_time in (('', False), (' of time', True)):
        names = [n for n, (what, _) in OUTSIDE.items()
                 if (what in ('time', 'temperature', 'order')) is of_time]
        if names:
            _outside(table, args, rng, size, kind, names)


def _outside(table, args, rng, size, kind, names):
    told = count = found = driver = unknown = 0
    missed = []
    for i in range(args.trials):
        what, curve = OUTSIDE[names[i % len(names)]]
        c = sky(rng, 60)
        value = curve(c, rng)
        axis_el = what == 'elevation' or rng.integers(2)
        s = scaled(c, on_el(value) if axis_el else on_az(c, value), size)
        if s is None:
            continue
        count += 1
        result = diagnose(make_run(c, *(noise(rng, 'gauss', c['el']) + s)),
                          cross_validation=False, flips=args.flips,
                          seed=int(rng.integers(2**31)))
        drivers = [x.fitted.effect.driver for x in result.effects]
        found += bool(drivers)
        told += result.verdict != 'none'
        driver += what in drivers
        unknown += result.verdict == 'unknown'
        if what not in drivers:
            missed.append(f'{names[i % len(names)]} -> '
                          f'{[x.fitted.effect.name for x in result.effects]}')
    label = f'outside the dictionary{kind}, lambda = {size:g}, 60 stars: '
    table.row(label + 'detected', _share(told, count), '' if kind else '>= 98 %',
              f'as an effect, not as a wander: {100.0 * found / count:.1f} %',
              None if kind else told >= 0.98 * count)
    table.row(label + 'driver right', _share(driver, count), '' if kind else '>= 95 %',
              f'verdict unknown {100.0 * unknown / count:.0f} %',
              None if kind else driver >= 0.95 * count)
    if args.verbose:
        print('\n'.join('    ' + m for m in missed))


def measured(table, args, rng):
    """Runs of other telescopes."""
    folder = Path(args.data) if args.data else None
    if folder is None or not folder.is_dir():
        table.row('measured runs', 'left out: no --data', '')
        return
    run = read_run(folder / 'spk8m' / 'pmfit_altaz.dat', azimuth_origin='N')
    values = []
    for seed in range(args.repeats):
        result = diagnose(run, seed=seed)
        values.append(result.after['cv_rms_arcsec'])
    table.row('spk8m: nested cross-validation, radial (mean over partitions)',
              f'{np.mean(values):.3f}" ({min(values):.3f}-{max(values):.3f})', '<= 1.05"',
              f'seven terms {result.before["cv_rms_arcsec"]:.2f}"; published 1.01" in-sample',
              np.mean(values) <= 1.05)
    train, test = _arc35m(folder / 'arc35m')
    start = time.process_time()
    result = diagnose(train, 'standard6', own_terms=STANDARD6, holdout=test,
                      cross_validation=False)
    spent = time.process_time() - start
    before, after = (v['holdout_rms_arcsec'] for v in (result.before, result.after))
    table.row(f'arc35m: {len(test)} runs left out, six terms refitted in each',
              f'{after:.2f}" ({100.0 * (1.0 - after / before):.1f} % below)', '>= 14 % below',
              f'six terms {before:.2f}"; {len(result.effects)} effects, {spent:.0f} s CPU',
              after <= 0.86 * before)


def _arc35m(folder):
    train, test = [], []
    for path in sorted(folder.glob('*.dat')):
        try:
            run = read_run(path)
        except ValueError:  # two files hold 0 and 2 rows
            continue
        if len(run) > 6:
            year = int(re.search(r'ptdata_(\d{4})', path.name).group(1))
            (train if year < 2018 else test).append(run)
    return train, test


def speed(table, args, rng):
    """One night."""
    c = sky(rng, 105)
    for i in range(23):  # columns of the user's own
        c[f'own_{i}'] = rng.normal(size=105)
    run = make_run(c, *noise(rng, 'gauss', c['el']))
    run.columns['az_enc'] += 4.0 * ARCSEC * c['approach_az']
    passes, whole = [], []
    for _ in range(5):
        start = time.process_time()
        obs = observations(run)
        problem = RunProblem(obs, Base.parse('physical'), ALPHA, curves=False).problem
        scores = problem.dictionary.score(problem.fit([]))
        passes.append(time.process_time() - start)
        start = time.process_time()
        diagnose(run)
        whole.append(time.process_time() - start)
    table.row(f'105 stars, {len(scores.dof)} candidates, without resampling',
              f'{1e3 * min(passes):.1f} ms CPU', '<= 30 ms', good=min(passes) <= 0.030)
    table.row('105 stars, with resampling and nested cross-validation',
              f'{min(whole):.2f} s CPU', '<= 5 s', good=min(whole) <= 5.0)


def stream(table, args, rng):
    """Very many rows, by the command: read from a CSV, diagnosed, written."""
    names, spent = ('azimuth_hysteresis_cosE', 'elevation_nod_3'), {}
    with tempfile.TemporaryDirectory() as folder:
        for total in (args.rows // 4, args.rows):
            parts = [_chunk(i, min(20000, total - i)) for i in range(0, total, 20000)]
            write_csv(PointingRun.concatenate(parts), f'{folder}/run.csv')
            del parts
            read = _used('from telescope_mount.input_files.run_loader import load_run',
                         f'load_run({folder + "/run.csv"!r})')
            whole = _used('from telescope_mount.cli import main', f"main(['diagnose', "
                          f"'{folder}/run.csv', '--json', '{folder}/found.json'])")
            found = json.loads(Path(folder, 'found.json').read_text(encoding='utf-8'))['effects']
            shown = {name for e in found for name in (e['name'], *e['alternatives'])}
            spent[total] = (whole[0], read[0], whole[1], set(names) <= shown)
    (small, a), (large, b) = spent.items()
    table.row(f'{large} rows by the command, of them reading the CSV',
              f'{b[0]:.1f} s, {b[1]:.1f} s CPU, {b[2]:.0f} MB', '<= 20 s besides, 1 GB',
              f'{small} rows {a[0]:.1f} s, {a[1]:.1f} s, {a[2]:.0f} MB',
              b[0] - b[1] <= 20.0 and b[2] <= 1024.0 and b[3])


def _used(*lines):
    """CPU seconds and MB of a separate process."""
    code = '\n'.join((*lines, 'import resource; u = resource.getrusage(resource.RUSAGE_SELF); '
                      'print(u.ru_utime + u.ru_stime, u.ru_maxrss / 1024.0)'))
    out = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    return [float(v) for v in out.stdout.split()[-2:]]


def _chunk(first, n):
    rng = np.random.default_rng(first)
    c = sky(rng, n)
    c['time'] = 1.7e9 + 30.0 * (first + np.arange(n))
    e = noise(rng, '1/sin E', c['el'])
    return make_run(c, e[0] + 0.03 * c['approach_az'] * np.cos(c['el']),
                    e[1] + 0.05 * np.sin(3.0 * c['az']))


PARTS = {'clean': clean_nights, 'one': one_effect, 'two': two_effects, 'held': held_out,
         'outside': outside, 'measured': measured, 'speed': speed, 'stream': stream}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--nights', type=int, default=100, help='clean nights of each kind')
    parser.add_argument('--trials', type=int, default=116, help='nights with effects')
    parser.add_argument('--rows', type=int, default=200_000, help='of the stream')
    parser.add_argument('--repeats', type=int, default=3, help='partitions of spk8m')
    parser.add_argument('--flips', type=int, default=1999)
    parser.add_argument('--data', help='folder with the measured runs')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--only', nargs='+', choices=PARTS, default=list(PARTS))
    parser.add_argument('--full', action='store_true',
                        help='2000 nights, 1160 trials, 1 000 000 rows')
    parser.add_argument('--verbose', action='store_true', help='list what was missed')
    args = parser.parse_args()
    if args.full:
        args.nights, args.trials, args.rows, args.repeats = 2000, 1160, 1_000_000, 10
    print(f'{"what":66s} {"figure":>22s}  {"target":>14s}')
    for name in args.only:
        PARTS[name](Table(), args, np.random.default_rng(args.seed))


if __name__ == '__main__':
    main()
