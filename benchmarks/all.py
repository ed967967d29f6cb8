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

"""Everything that is promised of speed, beside what a user would run instead, in one table.

    python benchmarks/all.py                     # within two minutes
    python benchmarks/all.py --full              # all sizes, cost curves, judged by the history
    python benchmarks/all.py --part fit,sky --json figures.json

Ratio: how many times as fast as the peer, or as the limit; both are measured in the same run, in
turns, one numeric thread, best of the rounds. A full run is judged by `history.json`, which has the
ratios by kind of processor: a line whose ratio is slower by a quarter than there in each of three
runs one after the other makes it end with code 1, as a limit that is missed does. `--record` writes
what was measured beside a peer into the history; seconds beside a limit are those of the machine.
Peers come with the extras `bench` and `test`; one that is missing leaves its place empty.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

from telescope_mount import ONE_THREAD

os.environ.update(ONE_THREAD)  # before numpy comes

from compared import PARTS
from history import SLOWER, History
from race import show

HISTORY = Path(__file__).with_name('history.json')
#: the curves of cost belong to a full run
KNOWN = (*PARTS, 'curves')
#: runs in which a ratio must be slower to be a step back
RUNS = 3


def measure(parts, full, say):
    """Rows of the parts, in turn."""
    rows = []
    for name in parts:
        begin = time.perf_counter()
        rows += PARTS[name](full)
        say(f'{name}: {time.perf_counter() - begin:.0f} s')
    return rows


def main():
    """Measure, print, judge; the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--part', default=','.join(KNOWN), help='some of ' + ', '.join(KNOWN))
    parser.add_argument('--json', type=Path, metavar='FILE')
    parser.add_argument('--history', type=Path, default=HISTORY, metavar='FILE')
    parser.add_argument('--record', action='store_true', help='write the ratios to the history')
    args = parser.parse_args()
    parts = args.part.split(',')
    if wrong := [name for name in parts if name not in KNOWN]:
        parser.error(f'no part {wrong[0]!r}: it is some of {", ".join(KNOWN)}')
    curved = 'curves' in parts and args.full
    parts = [name for name in parts if name in PARTS]

    def say(text):
        print(f'# {text}', file=sys.stderr, flush=True)
    rows = measure(parts, args.full, say)
    history = History(args.history)
    fallen = history.slower(rows) if args.full else set()
    for number in range(RUNS - 1):
        if not fallen:
            break
        say(f'slower than in the history, run {number + 2} of {RUNS}: ' + '; '.join(fallen))
        again = {key.split(' | ')[0] for key in fallen}
        fallen &= history.slower(measure([p for p in parts if p in again], args.full, say))
    curves = []
    if curved:
        from curves import measure_curves
        curves = measure_curves(say)
    show(rows)
    if curves:
        from curves import show_curves
        show_curves(curves)
    for key in sorted(fallen):
        print(f'SLOWER than in the history by more than {100 * SLOWER:.0f} %: {key}')
    if args.json:
        args.json.write_text(json.dumps({'rows': [row.document() for row in rows], 'curves': [
            curve.document() for curve in curves]}, indent=1) + '\n')
    if args.record:
        history.record(rows)
    missed = [row for row in rows if row.met is False] + [c for c in curves if not c.met]
    return int(args.full and bool(fallen or missed))


if __name__ == '__main__':
    sys.exit(main())
