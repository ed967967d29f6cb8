"""Makes the sample night anew: a simulated night of seed 1, without the truth, and its page.

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
