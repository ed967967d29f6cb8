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

"""All speed targets, compared with what a user would run instead, in one table.

    python benchmarks/all.py                     # within two minutes
    python benchmarks/all.py --full              # all sizes, cost curves, judged by the history
    python benchmarks/all.py --part fit,sky --json figures.json

Ratio: speed relative to the peer or to the limit. Both are measured in the same run, in turns, with
one numeric thread; the best round counts. A full run is compared with `history.json`, which holds
the ratios for each kind of processor. The exit code is 1 if a ratio is a quarter slower than there
in three runs in a row, or if a limit is missed. `--record` adds the ratios to peers to the history;
times against a limit depend on the machine and are not recorded. Peers come with the extras `bench`
and `test`; a missing one leaves its place empty.
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
