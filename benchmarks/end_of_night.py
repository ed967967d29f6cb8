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

"""Does a moving mount stop when `telescope-mount observe` is ended? With the toy telescope.

    python benchmarks/end_of_night.py [--times N] [--ways SIGINT,SIGTERM,SIGKILL,abort,park]

The toy telescope runs with `observe`, which starts the sample drivers. In the middle of a slew at
full speed the command gets a signal, or the guard a request (`telescope-mount guard`). The motion
of the axes is read from the telescope's port, bypassing ROS.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from guard_stops import EXAMPLES, PORT, Telescope, start, wait

from telescope_mount.processes import domain

DRIVERS = ('mount_driver', 'encoder_driver', 'camera_driver')
WAYS = ('SIGINT', 'SIGTERM', 'SIGKILL', 'abort', 'park')
TARGETS = {'park': 'at 180 deg, parked', 'SIGKILL': 'at rest'}
#: where nobody else is
LOCK = domain.claim()
#: full speed is 80 % of 12 deg/s
FULL = 9.0


def cli(*words):
    """Start a `telescope-mount` command."""
    return subprocess.Popen(
        [sys.executable, '-m', 'telescope_mount.cli', *map(str, words), '--domain',
         str(LOCK.number)],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))


def end_one(way, telescope, folder):
    """Seconds to rest, distance moved (deg), final angle (deg), exit code and last lines."""
    params = folder / 'toy.yaml'
    params.write_text((EXAMPLES / 'toy_telescope.yaml').read_text() + ''.join(
        f'/**/{name}:\n  ros__parameters:\n    port: {PORT}\n' for name in DRIVERS))
    observe = cli('observe', '--plan', 'stars 40, fit', '--out', folder / 'out', '--params', params,
                  *(word for name in DRIVERS for word in ('--driver', EXAMPLES / f'{name}.py')))
    begin = time.time()

    def slews():  # for half a second: it jumps to its first track
        rates = np.array([row[2] for row in telescope.rows[-40:] if row[0] > begin])
        return len(rates) == 40 and np.abs(rates).min() > FULL

    if not wait(slews, 120.0):
        observe.kill()
        raise SystemExit(f'the mount does not slew: {observe.communicate()[0]}')
    began = time.time()
    if way.startswith('SIG'):
        observe.send_signal(getattr(signal, way))
    else:
        asked = cli('guard', way)
        print(asked.communicate()[0].strip(), end='; ')
    told = observe.communicate()[0].strip().split('\n')
    wait(lambda: np.abs([row[2] for row in telescope.rows[-70:]]).max() < 0.01, 20.0)
    at, first, rate = np.array([row for row in telescope.rows if row[0] > began]).T
    last = len(rate) - np.argmax(np.abs(rate[::-1]) > 0.01) - 1
    return at[last] - began, abs(first[last] - first[0]), first[-1], observe.returncode, told[-3:]


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--times', type=int, default=1)
    parser.add_argument('--ways', default=','.join(WAYS), help='which of them')
    args = parser.parse_args()
    toy = start('toy_telescope')
    try:
        telescope = Telescope()
        for way in args.ways.split(','):
            rows = []
            for _ in range(args.times):
                with tempfile.TemporaryDirectory() as folder:
                    rows.append(end_one(way, telescope, Path(folder)))
                print(f'{way}: at rest after {rows[-1][0]:.2f} s, {rows[-1][1]:.1f} deg on; at '
                      f'{rows[-1][2]:.2f} deg; code {rows[-1][3]}: {" | ".join(rows[-1][4])}',
                      flush=True)
            seconds, gone = np.array([row[:2] for row in rows]).T
            print(f'{way:8} {args.times:3} times: at rest after {np.median(seconds):.2f} s '
                  f'({seconds.max():.2f} at worst), {np.median(gone):.1f} deg on '
                  f'({gone.max():.1f})  {TARGETS.get(way, "at rest before the command ends")}')
    finally:
        telescope.close()
        toy.kill()


if __name__ == '__main__':
    main()
