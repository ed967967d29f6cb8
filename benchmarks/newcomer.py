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

"""From a clone to the report on a user's file, only with the commands of the README.

    python benchmarks/newcomer.py                          # the MMT night
    python benchmarks/newcomer.py --full --data FOLDER     # and files of other telescopes there

Clones this repository (committed files) into a temporary folder, makes a venv, installs without
ROS, and runs `fit` and `diagnose --report` on each original file. pip uses its cache.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MMT = 'calibration/data/mmt_2021-08-21.csv'
#: files of other telescopes, and what the documentation says of such a file
OTHERS = (('spk8m/pmfit_altaz.dat', ()), ('spk5m/pmfit_equat.dat', ()),
          ('warp_astron/warp-astron.dat', ()), ('iram30m/pointing-2014-04.log', ()),
          ('coatli/20211103b.txt', ('--latitude', '31.0455305556', '--longitude', '-115.4669')))
TARGET = 600.0  # s


def main():
    """Print the table; exit code 1 where a command failed or took too long."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--full', action='store_true', help='files of other telescopes too')
    parser.add_argument('--data', type=Path, help='folder with them')
    args = parser.parse_args()
    files = [(ROOT / MMT, ())]
    if args.full and args.data:
        files += [(args.data / name, options) for name, options in OTHERS
                  if (args.data / name).is_file()]
    environment = {key: value for key, value in os.environ.items()
                   if key not in ('PYTHONPATH', 'VIRTUAL_ENV')}
    failed = False

    def run(*command, folder):
        begun = time.perf_counter()
        done = subprocess.run([str(part) for part in command], cwd=folder, env=environment,
                              capture_output=True, text=True)
        return time.perf_counter() - begun, done
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / 'telescope_mount'
        python = getattr(sys, '_base_executable', sys.executable)
        ready = 0.0
        for command in (('git', 'clone', '-q', ROOT, clone),
                        (python, '-m', 'venv', clone / '.venv'),
                        (clone / '.venv/bin/pip', 'install', '-q', clone)):
            seconds, done = run(*command, folder=folder)
            ready += seconds
            if done.returncode:
                raise SystemExit(f'{command[0]} failed: {done.stderr.strip()[-300:]}')
        print(f'{"file":28} {"to fit, s":>10} {"to page, s":>11} {"at most, s":>11}  first effect')
        for path, options in files:
            tool, page = clone / '.venv/bin/telescope-mount', Path(folder) / f'{path.stem}.html'
            fitted, done = run(tool, 'fit', path, *options, folder=folder)
            diagnosed, found = run(tool, 'diagnose', path, *options, '--report', page,
                                   folder=folder)
            bad = done.returncode or found.returncode or not page.is_file()
            total = ready + fitted + diagnosed
            failed |= bool(bad) or total > TARGET
            lines = [line.strip() for line in found.stdout.splitlines() if line.startswith('  ')]
            said = (done.stderr + found.stderr).strip() if bad else lines[1] if len(
                lines) > 1 else found.stdout.splitlines()[1]
            print(f'{path.name:28} {ready + fitted:10.0f} {total:11.0f} {TARGET:11.0f}  '
                  f'{said[:60]}', flush=True)
    print('peer: none that installs and names a cause; the time is without reading')
    return int(failed)


if __name__ == '__main__':
    sys.exit(main())
