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

"""Regenerates the sample night: a simulated night with seed 1, without the truth, and its page.

    .venv/bin/python docs/make/night.py
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NIGHT = ROOT / 'examples' / 'night'


def run(*words, cwd):
    """Run a command of this project."""
    subprocess.run([sys.executable, '-m', 'telescope_mount', *words], cwd=cwd, check=True,
                   env={**os.environ, 'PYTHONPATH': str(ROOT)})


def main():
    """Write examples/night."""
    with tempfile.TemporaryDirectory() as folder:
        run('night', '--out', 'night', cwd=folder)
        shutil.rmtree(NIGHT, ignore_errors=True)
        shutil.copytree(Path(folder) / 'night', NIGHT, ignore=shutil.ignore_patterns(
            'bag_truth', 'nodes', 'page.html'))
    run('info', 'examples/night', '--report', 'examples/night/page.html', cwd=ROOT)


if __name__ == '__main__':
    main()
