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

"""Common causes of pointing errors: is the true one in the reported set, or a wrong one alone?

    python benchmarks/mount_causes.py [--only NAME ...] [--nights N] [--rows N] [--lambda L]
                                      [--seed N] [--full] [--verbose] [--list]

Each cause is simulated by independent geometry (`CAUSES`), on an alt-azimuth or a German mount with
errors in the seven terms, scaled to a given lambda = |(1 - P) s| / sigma: the signal that the seven
terms cannot absorb over the noise of an axis. Each night has one of six results. `set`: the cause
is in the set of equals of a found effect (near aliases, `alike`, count). `or drift`: only a drift
of unknown cause is found, but the true cause is among the effects that explain the data equally
well. `drift`: a drift without it. `shape`: only a smooth curve without a cause is found. `nothing`:
nothing is found. `wrong`: another effect is found whose set lacks the true cause. `--full` runs 200
nights of 60 rows at lambda 9 and of 120 rows at lambda 7, or at sizes specific to a cause.

To add a cause, add an entry to `CAUSES`: see `mount_cause_nights.py`, `mount_history_nights.py`.
"""

import argparse
from collections import Counter

import numpy as np
from equatorial_runs import LATITUDE, make_run, scaled, sky
from mount_cause_nights import CAUSES as OF_PLACES
from mount_history_nights import HISTORIES

from calibration.analysis.diagnosis.diagnosis import diagnose
from pointing_model.mounts import Mount

SIZES = ((60, 9.0), (120, 7.0))
CAUSES = {**OF_PLACES, **HISTORIES}
ANSWERS = ('set', 'or drift', 'drift', 'shape', 'nothing', 'wrong')


def mount_of(kind):
    """The mount that is simulated."""
    return Mount() if kind == 'altaz' else Mount.equatorial(LATITUDE, kind)


def night(cause, kind, rows, size, rng):
    """A run with a cause, and its largest signal, arcsec; (None, None) if the terms hide it."""
    mount = mount_of(kind)
    columns = sky(rng, rows, mount)
    if cause.prepare:
        columns.update(cause.prepare(columns, mount, rng))
    signal = scaled(columns, cause.signal(columns, mount, rng), size, mount)
    if signal is None:
        return None, None
    turns = columns.pop('turns', 0.0)
    # not of the file: what nobody has read, and what `prepare` takes away
    columns = {name: values for name, values in columns.items()
               if values is not None and not name.startswith('_')}
    run = make_run(columns, *(signal + rng.normal(size=(2, rows))), mount)
    run.columns['az_enc'] = run.columns['az_enc'] + 2.0 * np.pi * turns
    return run, float(np.abs(signal).max())


def answer(result, cause):
    """One of `ANSWERS`, and the names that were found."""
    found = [e.fitted.effect for e in result.effects]
    shown = {name for e in result.effects
             for name in (e.fitted.effect.name, *e.alternatives, *e.aliases)}
    if any(name.startswith(cause.names + cause.alike) for name in shown):
        return 'set', found
    if not found and result.noise_memory:
        drift = any(name.startswith(cause.names + cause.alike)
                    for name in result.noise_memory['like'])
        return 'or drift' if drift else 'drift', found
    if not found:
        return 'nothing', found
    return 'shape' if all(e.kind == 'smooth' for e in found) else 'wrong', found


def measure(name, kind, rows, size, args):
    """Print a line of the table."""
    cause, rng, count, largest, missed = CAUSES[name], np.random.default_rng(args.seed), \
        Counter(), [], []
    for _ in range(args.nights):
        run, peak = night(cause, kind, rows, size, rng)
        if run is None:
            count['hidden'] += 1
            continue
        result = diagnose(run, cross_validation=False, flips=args.flips,
                          seed=int(rng.integers(2**31)))
        what, found = answer(result, cause)
        count[what] += 1
        largest.append(peak)
        if what != 'set':
            missed.append(f'    {what}: {[e.name for e in found]} {result.verdict}')
    total = max(sum(count[one] for one in ANSWERS), 1)
    print(f'{name:28s} {kind:8s} {rows:4d} {size:5.1f} {np.mean(largest or [np.nan]):7.1f}"  '
          + '  '.join(f'{100.0 * count[one] / total:6.1f} %' for one in ANSWERS)
          + f'  {total:4d}' + (f' ({count["hidden"]} hidden)' if count['hidden'] else ''),
          flush=True)
    if args.verbose:
        print('\n'.join(missed))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--only', nargs='+', help='causes whose names begin so')
    parser.add_argument('--nights', type=int, default=20)
    parser.add_argument('--rows', type=int)
    parser.add_argument('--lambda', type=float, dest='size')
    parser.add_argument('--flips', type=int, default=1999)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--full', action='store_true', help='200 nights')
    parser.add_argument('--verbose', action='store_true', help='list what was missed')
    parser.add_argument('--list', action='store_true', help='name the causes')
    args = parser.parse_args()
    if args.list:
        print('\n'.join(CAUSES))
        return
    if args.full:
        args.nights = 200
    print(f'{"cause":28s} {"mount":8s} {"rows":>4s} {"lambda":>5s} {"largest":>8s}  '
          + '  '.join(f'{one:>8s}' for one in ANSWERS) + '  nights')
    for name, cause in CAUSES.items():
        if args.only and not name.startswith(tuple(args.only)):
            continue
        for kind in cause.mounts:
            for rows, size in dict.fromkeys((args.rows or rows, args.size or size)
                                            for rows, size in cause.sizes or SIZES):
                measure(name, kind, rows, size, args)


if __name__ == '__main__':
    main()
