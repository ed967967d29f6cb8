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

"""The diagnosis on measured data: RMS before, after and cross-validated, and published figures.

    python benchmarks/measured_data.py --data ../shared/data [--only NAME] [--seeds N]

`--data` is a folder with the runs of an 8 m telescope (spk8m), the ARC 3.5 m (arc35m) and the
IRAM 30 m (iram30m: all logs there). Without it only the data of this project are used: the MMT
night, and the tables of papers 000 and 001. Sessions are those of the data. With `--seeds` each run
is diagnosed N times, and the table shows how the cross-validated RMS after depends on the seed.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.report.wording import paragraph
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.runs.run import PointingRun
from telescope_mount.input_files.run_loader import load_run, load_runs
from telescope_mount.papers.encoder_test import TABLE_2_MEASURED, TABLE_2_STANDARD
from telescope_mount.papers.table_1 import PAPER_TABLE_1

ROOT = Path(__file__).resolve().parent.parent
MMT = ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv'


def mmt(_, seed=0):
    """The MMT night of this project; seven terms."""
    return diagnose(load_run(MMT), seed=seed), 'x 0.51", el 0.80" with two effects (10-fold)'


def spk8m(data, seed=0):
    """105 stars; six terms."""
    run = load_run(data / 'spk8m' / 'pmfit_altaz.dat')
    return diagnose(run, 'standard6', seed=seed), '1.01" in sample, 1.02" nested, with 18 terms'


def arc35m(data, seed=0):
    """All runs: the model of 2014 to 2017, validated on 2018 and 2019."""
    files = sorted((data / 'arc35m').glob('*.dat'))
    year = [int(path.name.split('_')[1][:4]) for path in files]
    train, _ = load_runs([p for p, y in zip(files, year) if y <= 2017])
    later, _ = load_runs([p for p, y in zip(files, year) if y > 2017])
    # a night's six terms are its own
    own = ('IA', 'IE', 'CA', 'AN', 'AW', 'TF')
    return (diagnose(train, 'standard6', own_terms=own, holdout=later, seed=seed),
            '6.47" with six terms; 5.55" with one effect, 4.96" with 18 terms')


def iram(name):
    """Days of the 30 m; seven terms, not their eight."""
    def work(data, seed=0):
        run = load_run(data / 'iram30m' / f'pointing-{name}.log')
        return diagnose(run, seed=seed), _IRAM[name]
    return work


#: what the observers' models say of themselves, arcsec
_IRAM = {
    '2011-04': '2.5 az, 2.5 el', '2012-04A': '< 3 az, < 3 el, with sin 2A -30.9',
    '2012-04B': '< 3 az, < 3 el; el 3.04 with one effect', '2012-11': '< 4 az, < 4 el',
    '2013-04': '< 3 az, < 3 el', '2013-10': '< 3 az, < 3 el',
    '2014-04': '< 2 az, 4.7 el; 2.30, 2.51 with the added effects', '2014-10': '2.6 az, 2.9 el',
    '2015-03': '2.25 az, 2.21 el',
}


def table_2(_, seed=0):
    """Paper 001: 23 angles of the absolute encoder."""
    angle, error = TABLE_2_STANDARD, wrap(TABLE_2_MEASURED - TABLE_2_STANDARD)
    rng = np.random.default_rng(0)
    # one axis: the other is level and has noise of its own
    run = PointingRun({'az': angle, 'el': np.zeros(len(angle)), 'az_enc': angle + error,
                       'el_enc': error.std() * rng.standard_normal(len(angle))})
    return diagnose(run, 'index', seed=seed), 'nothing found'


def table_1(_, seed=0):
    """Paper 000: means of eleven nights after the zero calibration, at the mean of the sky."""
    rows = PAPER_TABLE_1
    el = np.full(len(rows), 45.0 * DEG)
    az = np.zeros(len(rows))
    run = PointingRun({
        'time': np.array([86400.0 * row['night'] for row in rows]), 'az': az, 'el': el,
        'az_enc': az + np.array([row['after_az_arcsec'] for row in rows]) * ARCSEC,
        'el_enc': el + np.array([row['after_el_arcsec'] for row in rows]) * ARCSEC})
    return diagnose(run, 'index', seed=seed), 'two groups in azimuth, unnamed'


RUNS = {
    'MMT 6.5 m, 2021-08-21': (mmt, ''),
    '8 m (SPK)': (spk8m, 'spk8m'),
    'ARC 3.5 m, 2014-2019': (arc35m, 'arc35m'),
    **{f'IRAM 30 m, {name}': (iram(name), f'iram30m/pointing-{name}.log') for name in _IRAM},
    'paper 001, table 2': (table_2, ''),
    'paper 000, table 1 after': (table_1, ''),
}


def row_of(document, stretches):
    """Cells of the table: RMS in arcsec."""
    before, after = document['before'], document['after']
    apart = '{before:.2f} -> {after:.2f}'.format(**stretches) if stretches else '-'

    def cell(key):
        if before[key] is None:
            return '-'
        return f'{before[key]:.2f} -> {after[key]:.2f}'
    return [document['verdict'], cell('rms_x_arcsec'), cell('rms_y_arcsec'), cell('rms_arcsec'),
            cell('cv_rms_arcsec'), apart, cell('holdout_rms_arcsec')]


def _wanted(name, args):
    return any(part.lower() in name.lower() for part in args.only)


def _seeds(args):
    print('| data | seeds | verdicts | after, mean | (max - min) / mean |')
    print('| --- ' * 5 + '|')
    for name, (work, folder) in RUNS.items():
        if _wanted(name, args) and (not folder or (args.data / folder).exists()):
            found = [work(args.data, seed)[0] for seed in range(args.seeds)]
            after = np.array([one.after['cv_rms_arcsec'] for one in found])
            verdicts = ', '.join(sorted({one.verdict for one in found}))
            print(f'| {name} | {args.seeds} | {verdicts} | {after.mean():.2f} | '
                  f'{np.ptp(after) / after.mean():.1%} |', flush=True)


def main():
    """Run, print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--data', type=Path, default=ROOT.parent / 'shared' / 'data')
    parser.add_argument('--only', nargs='+', default=[''], help='names that contain one of these')
    parser.add_argument('--json', type=Path)
    parser.add_argument('--seeds', type=int, default=0)
    args = parser.parse_args()
    if args.seeds:
        return _seeds(args)
    results = {}
    print('| data | rows | standard model | verdict | az × cos E | el | radial, fitted | '
          'cross-validated | stretches of time left out | held out | published | effects |')
    print('| --- ' * 12 + '|')
    for name, (work, folder) in RUNS.items():
        if not _wanted(name, args):
            continue
        if folder and not (args.data / folder).exists():
            print(f'| {name} | no data in {args.data / folder} |')
            continue
        begin = time.process_time()
        found, published = work(args.data)
        document = found.to_dict()
        results[name] = {**document, 'own_terms': list(found.base.own), 'caution': paragraph(
            found.cautions),
                         'cpu_seconds': time.process_time() - begin}
        effects = '; '.join(effect['name'] + (f' ({len(effect["alternatives"])} others)'
                                              if effect['alternatives'] else '')
                            for effect in document['effects']) or '-'
        if found.base.own:
            name += f", {document['runs']} sessions of their own {', '.join(found.base.own)}"
        cells = [name, str(document['observations']), ' '.join(document['base_terms']),
                 *row_of(document, found.cv_contiguous), published, effects]
        print('| ' + ' | '.join(cells) + ' |', flush=True)
    if args.json:
        args.json.write_text(json.dumps(results, indent=1) + '\n')


if __name__ == '__main__':
    main()
