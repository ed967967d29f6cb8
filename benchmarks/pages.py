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

"""Report page of a long run: its size, time to open it, and time to refit with excluded rows.

    python benchmarks/pages.py

A fit to 1044 rows, with hysteresis and one gross outlier, is written as by ``fit --report`` and
opened in a headless Chromium. Printed: the time until the page is laid out, best and median of 5
(target below 1 s on an idle machine), and the size of the page (target below 1 MB). Then ten rows
are excluded, one after the other: the time from the click until terms, plots and RMS are laid out
(target below 0.2 s). A table compares the terms of the page with those of the command with
``--exclude``: for a linear fit (IA, IE, TF), exact rotations, and a robust fit.
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

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test' / 'shared'))
from chromium import Browser, program

LONGEST, LARGEST, CLICK = 1.0, 1e6, 0.2  # s, bytes, s
#: fits of which the page's refit is compared, and rows excluded there
FITS = (('linear', {'terms': ('IA', 'IE', 'TF'), 'robust': False}),
        ('exact rotations', {'robust': False}), ('exact rotations, robust', {}))
EXCLUDED = 10


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


def seconds_of_clicks(browser, lines):
    """Longest of the times to exclude rows one after the other, each until it is laid out, s."""
    browser.wait('performance.now() > 1000')
    return 1e-3 * max(browser.run(f"""(() => {{ const begin = performance.now();
        refitPreview.exclude({lines[:i + 1]}); document.body.offsetHeight;
        return performance.now() - begin }})()""") for i in range(len(lines)))


def apart(browser, again):
    """Largest difference of the page's terms from those of a fit, arcsec."""
    here = {name: value for name, value, _ in browser.run('refitPreview.terms()')}
    return max(abs(here[name] - value / ARCSEC)
               for name, value in zip(again.names, again.coefficients))


def compare_refits(folder, run, rng):
    """Print the table of refits."""
    lines = np.sort(rng.choice(run.lines, EXCLUDED, replace=False)).tolist()
    rest = run.select(~np.isin(run.lines, lines))
    browser = Browser(folder / 'home_refit')
    worst = 0.0
    for name, how in FITS:
        found, path = fit_run(run, **how), folder / 'refit.html'
        write_text(path, render_fit(found, fit_document(found)))
        browser.show(path)
        longest = seconds_of_clicks(browser, lines)
        far = apart(browser, fit_run(rest, **how).terms)
        worst = max(worst, longest)
        print(f'{name:26}{EXCLUDED} rows excluded: {1e3 * longest:4.0f} ms at most (limit '
              f'{1e3 * CLICK:g}), terms within {far:.1e} arcsec of the command')
    browser.close()
    return worst


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
        (Path(folder) / 'home_refit').mkdir()
        click = compare_refits(Path(folder), run, np.random.default_rng(2))
    best, middle = min(seconds), statistics.median(seconds)
    print(f'{args.rows} rows: {size / 1e6:.2f} MB (limit {LARGEST / 1e6:g}), opened in '
          f'{best:.2f} s at best, {middle:.2f} s as a median of {args.times} (limit {LONGEST:g})')
    return int(size > LARGEST or middle > LONGEST or click > CLICK)


if __name__ == '__main__':
    sys.exit(main())
