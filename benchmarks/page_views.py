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

"""Each report page in a real browser, at phone and desktop size, light and dark.

    python benchmarks/page_views.py [PAGE ...]

Makes the page of each command on simulated data (some minutes; with PAGE: only checks those files)
and opens all folded parts. It counts, at 390 and 1280 px: cut-off content, texts with a contrast
below 4.5 (WCAG 2.1 AA; 3 for large text), and script errors. The word count of each page is printed
too: visible, and with all parts open. Exit code 1 if anything is wrong.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test' / 'shared'))
from chromium import Browser, program
from page_audit import ALL_DRAWN, WIDTHS, audit

ROOT = Path(__file__).resolve().parents[1]

#: words with a letter, in sight and all
_WORDS = """(() => {
  """ + ALL_DRAWN + """
  const count = text => text.split(/\\s+/).filter(w => /\\p{L}/u.test(w)).length;
  const main = document.querySelector('main'), open = main.innerText;
  document.querySelectorAll('details').forEach(e => { e.open = true });
  return [count(open), count(main.innerText)] })()"""


def night_of_rows(rng, n, begin=1.7e9, step=0.0):
    """Rows of a run, as CSV: seven terms, hysteresis, a nod, noise of 1 arcsec; AN moved."""
    az, el = rng.uniform(0.0, 360.0, n), np.degrees(np.arcsin(rng.uniform(0.3, 0.98, n)))
    side, a, e = rng.choice([-1, 1], n), np.radians(az), np.radians(el)
    x, y = rng.normal(size=(2, n))
    x += 30.0 * np.cos(e) + 8.0 + 4.0 * side * np.cos(e) + (12.0 + step) * np.sin(a) * np.sin(e)
    y += -20.0 + 15.0 * np.cos(e) + 3.0 * np.sin(2.0 * a) + (12.0 + step) * np.cos(a)
    time = begin + np.sort(rng.uniform(0.0, 2e4, n))
    rows = np.column_stack((time, az, el, az + x / np.cos(e) / 3600.0, el + y / 3600.0, side,
                            12.0 - (time - begin) / 5e3))
    head = 'time,az_deg,el_deg,az_enc_deg,el_enc_deg,approach_az,temperature_c'
    return '\n'.join([head, *(','.join(f'{v:.7f}' for v in row) for row in rows)]) + '\n'


def make_pages(folder):
    """Name -> page of each command."""
    rng = np.random.default_rng(1)
    (folder / 'run.csv').write_text(night_of_rows(rng, 120))
    for i in range(8):
        (folder / f'night_{i}.csv').write_text(night_of_rows(
            rng, 40, 1.7e9 + 86400.0 * 5 * i, 20.0 * (i > 4)))
    nights = [str(folder / f'night_{i}.csv') for i in range(8)]
    run, out = str(folder / 'run.csv'), {}
    for name, *words in (
            ('fit', 'fit', run), ('diagnose', 'diagnose', run), ('track', 'track', run),
            ('season', 'season', *nights), ('night', 'info', str(ROOT / 'examples' / 'night'))):
        out[name] = folder / f'{name}.html'
        _run(*words, '--report', str(out[name]))
    for name, *words in (('encoder-test', 'encoder-test'),
                         ('experiment', 'experiment', '--nights', '4', '--stars', '16'),
                         ('loop', 'close-the-loop', '--scenario', 'loop_two_effects',
                          '--stars', '60')):
        _run(*words, '--out', str(folder / name))
        out[name] = folder / name / 'page.html'
    return out


def _run(*words):
    done = subprocess.run([Path(sys.executable).with_name('telescope-mount'), *words],
                          capture_output=True, text=True)
    if done.returncode:
        sys.exit(f'error: {" ".join(words)}: {done.stderr.strip()}')


def main():
    """Print a row for each page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('pages', nargs='*', type=Path)
    args = parser.parse_args()
    if program() is None:
        sys.exit('error: no Chromium here; Debian: apt install chromium')
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pages = {path.name: path for path in args.pages} or make_pages(folder)
        (folder / 'home').mkdir()
        browser = Browser(folder / 'home')
        print(f'{"page":16}{"in sight":>9}{"words":>7}   wrong at ' + ', '.join(
            f'{width} {scheme}' for width in WIDTHS for scheme in ('light', 'dark')))
        for title, path in pages.items():
            found = [audit(browser, path, width, dark) for width in WIDTHS for dark in (0, 1)]
            browser.show(path)
            seen, words = browser.run(_WORDS)
            wrong += sum(map(len, found))
            print(f'{title:16}{seen:9}{words:7}   ' + ', '.join(str(len(one)) for one in found)
                  + ''.join(f'\n    {text}' for text in dict.fromkeys(sum(found, []))))
        browser.close()
    return int(wrong > 0)


if __name__ == '__main__':
    sys.exit(main())
