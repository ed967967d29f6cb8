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

"""The same night twice, the second time with both cores busy: are the observations the same?

    python benchmarks/night_repeat.py
"""

import multiprocessing
import tempfile
import time
from pathlib import Path

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.runs.run_reader import read_run
from telescope_mount.nights.whole_night import run_night


def burn():
    """Keep a core busy until killed."""
    while True:
        sum(range(10000))


def main():
    """Run both nights and print the largest difference of any column."""
    with tempfile.TemporaryDirectory() as folder:
        runs = []
        for name, load in (('quiet', 0), ('busy', 2 * multiprocessing.cpu_count())):
            burners = [multiprocessing.Process(target=burn, daemon=True) for _ in range(load)]
            for process in burners:
                process.start()
            began = time.perf_counter()
            run_night(Path(folder) / name, seed=7)
            print(f'{name:6} {load} busy processes beside it: '
                  f'{time.perf_counter() - began:5.1f} s')
            for process in burners:
                process.kill()
            runs.append(read_run(Path(folder) / name / 'observations.csv'))
        quiet, busy = runs
        print(f'rows {len(quiet)} and {len(busy)}')
        for column in ('az', 'el', 'az_enc', 'el_enc', 'az_abs', 'el_abs', 'miss_x', 'miss_y'):
            worst = float(np.nanmax(np.abs(quiet[column] - busy[column]))) / ARCSEC
            print(f'{column:8} largest difference {worst:.2e} arcsec')
        same = (Path(folder) / 'quiet/observations.csv').read_bytes() == (
            Path(folder) / 'busy/observations.csv').read_bytes()
        print('files', 'equal to the byte' if same else 'DIFFER')


if __name__ == '__main__':
    main()
