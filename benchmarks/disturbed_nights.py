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

"""Mounts that no model can represent: is a wrong cause claimed, does a model worsen pointing?

    python benchmarks/disturbed_nights.py [--seeds N] [--first N] [--scenarios 'mount_*'] [--keep F]

Each is a night of `close-the-loop` in the whole graph (about fifteen seconds each), one seed after
the other, so that an interrupted run still counts. `found` is the command's result, see
docs/closing_the_loop.md. A wrong cause is `wrong`, or `no` with effects in the model: it is not one
of the scenario's, and fresh stars did not reject it. Printed at the end: nights by scenario and by
result, and the 95 % limit of the fraction of nights with a wrong cause (exact binomial).
"""

import argparse
import json
import tempfile
from collections import Counter
from fnmatch import fnmatchcase
from pathlib import Path

from scipy.stats import beta

from telescope_mount.closed_loop.closed_loop import close_the_loop
from telescope_mount.nights.whole_night import NightFailed
from telescope_mount.simulation import scenario_names

WRONG, FAILED = ('wrong', 'harmful'), 'failed'


def one_night(name, seed):
    """Result of the command for a night, with the effects that it added."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            report = close_the_loop(Path(folder) / 'night', scenario=name, seed=seed)
        except NightFailed as error:
            return {'scenario': name, 'seed': seed, 'found': FAILED, 'effects': [str(error)]}
    return {'scenario': name, 'seed': seed, 'found': report['found'],
            'effects': [one['effect'] if isinstance(one, dict) and 'effect' in one else str(one)
                        for one in report['applied'] or ()]}


def table(nights):
    """Print nights by scenario, and the limit."""
    for name in sorted({one['scenario'] for one in nights}):
        counts = Counter(one['found'] for one in nights if one['scenario'] == name)
        print(f'{name:30s} ' + ', '.join(f'{found} {n}' for found, n in counts.most_common()))
    done = [one for one in nights if one['found'] != FAILED]
    wrong = [one for one in done
             if one['found'] in WRONG or (one['found'] == 'no' and one['effects'])]
    for one in wrong:
        print(f'  {one["found"]}: {one["scenario"]}, seed {one["seed"]}: {one["effects"]}')
    limit = beta.ppf(0.95, len(wrong) + 1, len(done) - len(wrong))
    print(f'a wrong name, or harm, in {len(wrong)} of {len(done)} nights; below '
          f'{100 * limit:.1f} % (95 %); {len(nights) - len(done)} failed')


def main():
    """Run the nights, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--seeds', type=int, default=2)
    parser.add_argument('--first', type=int, default=1)
    parser.add_argument('--scenarios', default='mount_*')
    parser.add_argument('--keep', type=Path, help='a line of JSON a night is appended to it')
    args = parser.parse_args()
    nights = []
    try:
        for seed in range(args.first, args.first + args.seeds):
            for name in scenario_names():
                if fnmatchcase(name, args.scenarios):
                    nights.append(one_night(name, seed))
                    if args.keep:
                        with open(args.keep, 'a', encoding='utf-8') as stream:
                            stream.write(json.dumps(nights[-1]) + '\n')
    finally:
        if nights:
            table(nights)


if __name__ == '__main__':
    main()
