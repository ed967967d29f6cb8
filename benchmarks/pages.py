"""How large the page of a long run is, and how fast a browser opens it.

    python benchmarks/pages.py

A fit to 1044 rows, with hysteresis and one wild row, is written as ``fit --report`` does and opened
in a headless Chromium: the time of its work until the page is laid out, best and median of 5, which
is to stay below 1 s on a quiet machine, and the bytes of the page, below 1 MB.
"""

import argparse
import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np

from calibration.analysis.run_fit import fit_run
from calibration.report.documents import fit_document
from calibration.report.fit_page import render_fit
from msg_tools.units import ARCSEC
from msg_tools.whole_files import write_text
from pointing_model.runs.run import PointingRun

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test' / 'calibration'))
from chromium import Browser, program

LONGEST, LARGEST = 1.0, 1e6  # s, bytes


def a_run(n, seed=1):
    """A run in five power-ons."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.3, 0.98, n))
    side = rng.choice([-1.0, 1.0], n)
    x, y = rng.normal(size=(2, n)) * ARCSEC
    x[n // 2] += 60.0 * ARCSEC
    time = 1.7e9 + np.sort(rng.uniform(0, 1.5e5, n))
    return PointingRun({
        'time': time, 'az': az, 'el': el, 'az_enc': az + (30 + 4 * side) * ARCSEC + x / np.cos(el),
        'el_enc': el + y, 'star': np.arange(n).astype(str), 'approach_az': side,
        'run': np.floor((time - time[0]) / 3e4)})


def main():
    """Print size and times beside their limits; exit code 1 beyond one of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--rows', type=int, default=1044)
    parser.add_argument('--times', type=int, default=5)
    args = parser.parse_args()
    if program() is None:
        sys.exit('error: no Chromium here; Debian: apt install chromium')
    with tempfile.TemporaryDirectory() as folder:
        path, run = Path(folder, 'page.html'), a_run(args.rows)
        found = fit_run(run)
        write_text(path, render_fit(found, fit_document(found)))
        size, seconds = path.stat().st_size, []
        for number in range(args.times):  # each in a browser of its own: nothing is cached
            home = Path(folder, f'home_{number}')
            home.mkdir()
            browser = Browser(home)
            browser.window(1000)
            seconds.append(browser.show(path))
            browser.close()
    best, middle = min(seconds), statistics.median(seconds)
    print(f'{args.rows} rows: {size / 1e6:.2f} MB (limit {LARGEST / 1e6:g}), opened in '
          f'{best:.2f} s at best, {middle:.2f} s as a median of {args.times} (limit {LONGEST:g})')
    return int(size > LARGEST or middle > LONGEST)


if __name__ == '__main__':
    sys.exit(main())
