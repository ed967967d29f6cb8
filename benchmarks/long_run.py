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

"""Thirty nights in one graph, one after the other: memory, open files and threads.

    python benchmarks/long_run.py [--nights N]     # 30 nights
    python benchmarks/long_run.py --full           # 200 nights

Simulated nights as in the command `experiment`, with a power cycle between them, 8 stars and 4
exposures of Polaris each. Recorded after each night for every process: memory (RSS, and unshared,
USS), open files, threads; and the contents of `/dev/shm`. Printed is the growth since the end of
the night `--from`, compared with the limit of 2 %. With `--kept 0` observer and calibration keep
the rows of all nights and grow with them: the growth per row is printed too.
"""

import argparse
import json
import os
import re
import tempfile
import time
from pathlib import Path

import numpy as np

from telescope_mount.graph import night_graph
from telescope_mount.nights.whole_night import observe, prepare_folder

STARS, POLARIS = 4, 4
ROWS = 2 * STARS + POLARIS  # of a night
LIMIT = 0.02


def long_plan(nights):
    """Plan of several nights, with a power-on each."""
    night = f'home, stars {STARS}, zero {POLARIS}, calibrate_zero, stars {STARS}, fit'
    return ', wait 24, power_cycle, '.join([night] * nights)


def children_of(pid):
    """Process id -> name of its direct children."""
    found = {}
    for entry in filter(str.isdigit, os.listdir('/proc')):
        try:
            name, rest = Path(f'/proc/{entry}/stat').read_text().split('(', 1)[1].rsplit(')', 1)
        except OSError:
            continue
        if int(rest.split()[1]) == pid:
            found[int(entry)] = name
    return found


def nodes():
    """Process id -> name, of this one and of the nodes that it started."""
    out = {os.getpid(): 'command line'}
    for child, name in children_of(os.getpid()).items():
        if name == 'fork_server':
            out |= {child: 'fork_server'} | children_of(child)
        else:
            out[child] = name
    return out


def measured(pid):
    """Memory (kB; `uss` is unshared), open files and threads of a process."""
    status = Path(f'/proc/{pid}/status').read_text()
    rollup = Path(f'/proc/{pid}/smaps_rollup').read_text()

    def of(text, name):
        return int(re.search(rf'^{name}:\s+(\d+)', text, re.M)[1])
    return {'rss': of(status, 'VmRSS'), 'threads': of(status, 'Threads'),
            'uss': of(rollup, 'Private_Clean') + of(rollup, 'Private_Dirty'),
            'files': len(os.listdir(f'/proc/{pid}/fd'))}


class Nights:
    """Measures whenever a night has ended: the argument `progress` of `night.observe`.

    Attributes
    ----------
    taken : list of dict
        Of each night, what `measured` gives by process.
    shared : list of int
        Entries of `/dev/shm` then.
    seconds : list of float
        That the night took.
    """

    def __init__(self, count, every, folder):
        self._count = count
        self.taken, self.shared, self.seconds = [], [], []
        self._pids, self._began, self._every = {}, time.monotonic(), every
        self._folder = folder

    def __call__(self, text, done, total):
        over = done >= (len(self.taken) + 1) * ROWS or text.startswith('writing')
        if not over or len(self.taken) == self._count:
            return
        self._pids = self._pids or nodes()
        self.taken.append({name: measured(pid) for pid, name in self._pids.items()})
        self.shared.append(len(os.listdir('/dev/shm')))
        now = time.monotonic()
        self.seconds.append(now - self._began)
        self._began = now
        if len(self.taken) % self._every == 0:
            log = sum(file.stat().st_size for file in self._folder.rglob('*.mcap'))
            total = sum(one['rss'] for one in self.taken[-1].values())
            print(f'night {len(self.taken):4}: {self.seconds[-1]:5.1f} s, all processes '
                  f'{total / 1024:.0f} MB, log {log / 1e6:.1f} MB', flush=True)


def report(nights, since):
    """Print the table; return the number of processes that grow by more than the limit."""
    since = min(since, len(nights.taken) - 1)
    rows = ROWS * (len(nights.taken) - since)
    print(f'\nfrom the end of night {since} to that of night {len(nights.taken)}, {rows} rows')
    print(f'{"process":20}{"RSS, MB":>16}{"growth":>8}{"own, MB":>16}{"B a row":>9}'
          f'{"files":>11}{"threads":>9}')
    grown = 0
    at = np.arange(since - 1, len(nights.taken))
    for name in nights.taken[-1]:
        first, last = (nights.taken[i][name] for i in (since - 1, -1))
        growth = last['rss'] / first['rss'] - 1.0
        own = np.array([nights.taken[i][name]['uss'] for i in at], float)
        slope = np.polyfit(at * ROWS, own * 1024, 1)[0] if len(at) > 1 else np.nan
        grown += growth > LIMIT
        print(f'{name:20}{first["rss"] / 1024:7.1f} ->{last["rss"] / 1024:6.1f}{growth:8.1%}'
              f'{first["uss"] / 1024:7.1f} ->{last["uss"] / 1024:6.1f}{slope:9.0f}'
              f'{first["files"]:5} ->{last["files"]:3}{first["threads"]:4} ->{last["threads"]:2}'
              f'{"   above 2 %" if growth > LIMIT else ""}')
    print(f'/dev/shm: {nights.shared[since - 1]} -> {nights.shared[-1]} entries (of the whole '
          'machine)')
    print(f'a night took {np.mean(nights.seconds[since - 1:since + 2]):.1f} s after night {since}, '
          f'{np.mean(nights.seconds[-3:]):.1f} s at the end')
    print(f'processes that grow by more than {LIMIT:.0%}: {grown} of {len(nights.taken[-1])}')
    return grown


def main():
    """Observe all nights and print what grew."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--nights', type=int, default=30)
    parser.add_argument('--full', action='store_true', help='200 nights')
    parser.add_argument('--from', dest='since', type=int, default=5, metavar='NIGHT')
    parser.add_argument('--kept', type=int, metavar='POWER_ONS', help='kept_power_ons of observer '
                        "and calibration, 0: all; by default the nodes' own")
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--every', type=int, default=5, help='nights between two lines')
    parser.add_argument('--keep', type=Path, help='for what was measured, JSON')
    parser.add_argument('--out', type=Path, help='keep logs here; by default they are removed')
    args = parser.parse_args()
    count = 200 if args.full else args.nights
    if count < 2:
        parser.error('--nights must be 2 or more')
    plan = long_plan(count)
    with tempfile.TemporaryDirectory() as place:
        folder = prepare_folder(args.out or Path(place) / 'night')
        specs = night_graph(bag=str(folder / 'bag'), scenario='default', seed=args.seed,
                            plan=plan, sample_rate_hz=1.0, kept_power_ons=args.kept)
        nights = Nights(count, args.every, folder)
        try:
            observe(folder, specs, plan, lambda latest: None, nights)
        finally:
            if args.keep:
                args.keep.write_text(json.dumps({'nights': nights.taken, 'shm': nights.shared,
                                                 'seconds': nights.seconds}))
            if len(nights.taken) > 1:
                report(nights, args.since)


if __name__ == '__main__':
    main()
