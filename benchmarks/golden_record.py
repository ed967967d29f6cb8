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

"""Record of the commands' results on measured and simulated data, compared with a later commit.

    python benchmarks/golden_record.py write RECORD.json [--data ../shared/data] [--full]
    python benchmarks/golden_record.py compare RECORD.json [--data ../shared/data] [--full]

A refactoring must not change results. The record holds the commands' JSON output, which is
independent of the code's structure. Values with a standard error may differ by 0.001 of it, other
numbers by 0.001 of their size. Words (verdicts, names of effects and terms, sets of equal causes)
must be the same; sentences are not compared. `--full` adds diagnoses that take minutes, and
simulated nights. `--only TEXT` selects cases with this text in their name. To record an older
commit, run this file with the Python of that checkout's environment.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MMT = ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv'
#: what two runs of one commit may say otherwise
UNSTABLE = {'created', 'version', 'source', 'seconds', 'started', 'software', 'folder', 'files'}
PART = 1e-3
PURE = ('correlations', '_sigmas/', 'covariance')


def cases(data, full):
    """Arguments of `telescope-mount` by the name of the case; FOLDER: one that is empty."""
    out = {'fit mmt': ['fit', MMT], 'diagnose mmt': ['diagnose', MMT], 'track mmt': ['track', MMT],
           'fit mmt plain': ['fit', MMT, '--no-robust'],
           'fit mmt harmonics': ['fit', MMT, '--harmonics', 'zenith'],
           'fit mmt harmonics printed': ['fit', MMT, '--harmonics', 'printed'],
           'fit mmt predict': ['fit', MMT, '--predict'],
           'fit mmt absolute': ['fit', MMT, '--encoder', 'abs'],
           'verify sample': ['verify', ROOT / 'test' / 'data' / 'sample_log'],
           'fit sample night': ['fit', ROOT / 'examples' / 'night']}
    runs = {}
    for pattern in ('mmt/*.dat', 'spk?m/*.dat', 'iram30m/*.log', 'coatli/20211103b.txt',
                    'warp_astron/*.dat', 'arc35m/*.dat'):
        runs |= {str(path.relative_to(data)): path for path in sorted(data.glob(pattern))}
    german = ['--mount', 'german', '--latitude', '31.0455', '--longitude', '-115.4669']
    options = {name: german if name.startswith('coatli') else [] for name in runs}
    out |= {f'fit {name}': ['fit', path, *options[name]] for name, path in runs.items()}
    nights = [path for name, path in runs.items() if name.startswith('arc35m')]
    if nights:
        out['season arc35m'] = ['season', *nights]
        out['diagnose spk5m'] = ['diagnose', data / 'spk5m' / 'pmfit_equat.dat']
    if full:
        slow = ('spk8m', 'coatli', 'warp', 'iram30m')
        out |= {f'diagnose {name}': ['diagnose', path, *options[name]]
                for name, path in runs.items() if name.startswith(slow)}
        out |= {f'night {words}': ['night', '--out', 'FOLDER', *words.split()]
                for words in ('--seed 1', '--seed 2 --harmonics zenith',
                              '--seed 3 --scenario german --mount german')}
        out |= {f'loop {name}': ['close-the-loop', '--out', 'FOLDER', '--scenario', name]
                for name in ('loop_clean', 'loop_elevation_disc_tilted')}
    return out


def answer(words):
    """What the command says: its exit code, and its JSON or, where there is none, nothing."""
    with tempfile.TemporaryDirectory() as folder:
        words = [str(Path(folder) / 'out') if word == 'FOLDER' else str(word) for word in words]
        done = subprocess.run([sys.executable, '-m', 'telescope_mount', *words, '--json'],
                              cwd=ROOT, capture_output=True, text=True)
    try:
        said = json.loads(done.stdout)
    except ValueError:
        said = None
    return {'code': done.returncode, 'json': said}


def differences(before, after, at='', sigma=None):
    """Yield a line for each value that is not as it was.

    Parameters
    ----------
    before, after : object
        Of JSON.
    at : str
        Where in the document.
    sigma : float, optional
        Standard error of the value.
    """
    if isinstance(before, dict) and isinstance(after, dict):
        for key in before.keys() | after.keys():
            if key in UNSTABLE:
                continue
            if key not in before or key not in after:
                yield f'{at}/{key}: {"new" if key in after else "gone"}'
                continue
            yield from differences(before[key], after[key], f'{at}/{key}',
                                   before.get(key.replace('value', 'sigma')))
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            yield f'{at}: {len(before)} entries, now {len(after)}'
        for number, (one, other) in enumerate(zip(before, after)):
            yield from differences(one, other, f'{at}/{number}')
    elif isinstance(before, str) and isinstance(after, str):
        if before != after and ' ' not in before.strip():  # else a sentence
            yield f'{at}: {before!r}, now {after!r}'
    elif _is_number(before) and _is_number(after):
        # of correlations, and of what is in standard errors, the unit is 1
        size = 1.0 if any(word in at for word in PURE) else abs(before)
        near = PART * (sigma if _is_number(sigma) and sigma > 0.0 else size)
        if not math.isclose(before, after, rel_tol=0.0, abs_tol=near + 1e-9):
            yield f'{at}: {before:.6g}, now {after:.6g}'
    elif before != after:
        yield f'{at}: {before!r}, now {after!r}'


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def main():
    """Write or compare the record; exit code 1 where anything differs."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('what', choices=('write', 'compare'))
    parser.add_argument('record', type=Path)
    parser.add_argument('--data', type=Path, default=ROOT.parent / 'shared' / 'data')
    parser.add_argument('--only', default='')
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--jobs', type=int, default=2)
    args = parser.parse_args()
    wanted = {name: words for name, words in cases(args.data, args.full).items()
              if args.only in name}
    with ThreadPoolExecutor(args.jobs) as pool:
        now = dict(zip(wanted, pool.map(answer, wanted.values())))
    if args.what == 'write':
        args.record.write_text(json.dumps(now, indent=1) + '\n')
        print(f'{len(now)} cases in {args.record}')
        return 0
    then, changed = json.loads(args.record.read_text()), 0
    for name, said in now.items():
        lines = (list(differences(then[name], said)) if name in then
                 else ['not in the record'])
        changed += bool(lines)
        for line in lines[:10]:
            print(f'{name}: {line}')
        if len(lines) > 10:
            print(f'{name}: and {len(lines) - 10} more')
    print(f'{len(now)} cases, {changed} changed')
    return int(changed > 0)


if __name__ == '__main__':
    sys.exit(main())
