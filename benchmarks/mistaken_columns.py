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

"""Mistaken columns: are they recognised, and are correct columns accepted?

    python benchmarks/mistaken_columns.py [--data ../shared/data] [--nights N] [--full]

Eight kinds of mistakes (in the columns of the catalogue, of the encoders, or both) on three
telescopes: the MMT night of this project, the 8 m of `--data` (else a simulated one), and a
simulated mount with arbitrary zeros and terms of a degree. Then correct input: measured runs of
`--data`, and simulated nights with terms from zero to a degree and up to three effects of 1 to 300
arcsec, with 12 to 200 rows over a strip, a quadrant or all of the sky.

`named`: the mistake is among the interpretations reported to fit; `alike`: it fits as well as the
columns as written, and the result reports it; `noted`: it may also be an effect, and a note reports
it. `effects` are those claimed by the diagnosis of mistaken columns that are in no set of equals
for the correct columns.
"""

import argparse
import time
from collections import Counter
from pathlib import Path

import numpy as np

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.mistaken_columns import MistakenColumns, check_columns
from calibration.report.wording import wording
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.geometry import sky_to_encoder
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.columns.row_checks import NoUsableRow
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run

ROOT = Path(__file__).resolve().parent.parent
NAMES = ('az', 'el', 'az_enc', 'el_enc')
TURN = 2.0 * np.pi

#: kind -> (what is written of a place, what the message must say; of the mirrored ones any)
KINDS = {
    'axes exchanged': (lambda a, e: (e, np.mod(a, TURN)), 'azimuth and elevation {} exchanged'),
    'zenith distance': (lambda a, e: (a, np.pi / 2 - e), 'zenith distance in place of the '
                        'elevation {}'),
    'azimuth reversed': (lambda a, e: (-a, e), 'azimuth {} counted'),
    'azimuth from south': (lambda a, e: (np.mod(np.pi - a, TURN), e), 'azimuth {} counted'),
    'hours': (lambda a, e: (np.mod(a, TURN) / 15.0, e), 'azimuth {} in hours'),
    'arcseconds': (lambda a, e: (3600.0 * a, 3600.0 * e), 'azimuth and elevation {} in '
                   'arcseconds'),
}
WHERE = {'catalogue': 'of the catalogue', 'encoders': 'of the encoders',
         'both': 'of catalogue and encoders'}


def cases(columns):
    """Yield kind, place, required text, and the mistaken columns."""
    az, el, az_enc, el_enc = columns
    for kind, (write, said) in KINDS.items():
        for where, text in WHERE.items():
            place = write(az, el) if where != 'encoders' else (az, el)
            reading = write(az_enc, el_enc) if where != 'catalogue' else (az_enc, el_enc)
            yield kind, where, said.format(text), (*place, *reading)
    x, y = wrap(az_enc - az), el_enc - el
    for where, given in (('coordinates', x), ('on the sky', x * np.cos(el))):
        for unit, factor in (('degrees', 1.0), ('arcseconds', 3600.0)):
            yield ('offsets', f'{unit}, {where}', "offsets in place of the encoders' readings, in "
                   + unit + ' on the sky' * (where == 'on the sky'),
                   (az, el, factor * given, factor * y))
    yield 'mount and catalogue exchanged', '', 'mount and catalogue exchanged', (
        az_enc, el_enc, az, el)


def simulated(rng, n, terms, noise=1.0, span=(0.0, 360.0)):
    """The four columns of a mount with terms in arcsec."""
    az, el = rng.uniform(*span, n) * DEG, np.arcsin(rng.uniform(0.27, 0.998, n))
    az_enc, el_enc = sky_to_encoder(az, el, {k: v * ARCSEC for k, v in terms.items()})
    x, y = rng.normal(size=(2, n)) * noise * ARCSEC
    seen = np.isfinite(az_enc)
    return [v[seen] for v in (az, el, az_enc + x / np.cos(el), el_enc + y)]


def telescopes(data):
    """Name -> columns of three telescopes."""
    def columns(path):
        run = read_run(path)
        return [np.asarray(run[name], float) for name in NAMES]
    out = {'MMT 6.5 m': columns(ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv')}
    spk = data / 'spk8m' / 'pmfit_altaz.dat'
    out['8 m (SPK)' if spk.is_file() else 'simulated, squared'] = columns(spk) if spk.is_file() \
        else simulated(np.random.default_rng(1), 80, {
            'IA': 60, 'IE': -35, 'CA': 12, 'NPAE': -6, 'AN': 8, 'AW': -10, 'TF': 14})
    out['simulated, crooked'] = simulated(np.random.default_rng(2), 80, {
        'IA': 360000, 'IE': 3600, 'CA': 4000, 'NPAE': -2500, 'AN': 5000, 'AW': -3000, 'TF': 600})
    return out


def through_a_file(columns, path):
    """Columns written to a file and read back, without the rows that the reader excludes."""
    rows = np.degrees(np.column_stack(columns))  # as they are: `write_csv` has places on the sky
    np.savetxt(path, rows, '%.12f', ',', header='az_deg,el_deg,az_enc_deg,el_enc_deg', comments='')
    return read_run(path)


def outcome(columns, said, own, path):
    """Outcome for mistaken columns, and number of effects claimed that are not in `own`."""
    try:
        try:
            run = through_a_file(columns, path)
        except NoUsableRow as error:
            run = error.run
        checked = check_columns(run)
    except MistakenColumns as error:
        return ('named' if said in str(error) else 'refused'), 0
    except ValueError:
        return 'refused by the reader', 0
    mirrored = said.startswith('azimuth of catalogue and encoders counted')
    alike = said in checked.alike or mirrored and any(
        text.startswith(said) for text in checked.alike)
    result = diagnose(run, flips=499, cross_validation=False)
    new = [e for e in result.effects if not sets_of([e]) & own]
    noted = ' '.join(map(wording, checked.findings))
    kind = 'alike' if alike else 'noted' if said in noted else 'NOT SEEN'
    return kind, len(new)


def sets_of(effects):
    """Names of effects and of their equally good alternatives."""
    return {name for e in effects for name in (e.fitted.effect.name, *e.alternatives)}


def mistakes(data, path):
    """Print the table of the mistakes."""
    found, more = Counter(), 0
    print('| telescope | mistake | in | outcome | effects beyond those of the right columns |')
    print('| --- ' * 5 + '|')
    for name, columns in telescopes(data).items():
        right = diagnose(through_a_file(columns, path), flips=499, cross_validation=False)
        own = sets_of(right.effects)
        for kind, where, said, written in cases(columns):
            what, effects = outcome(written, said, own, path)
            found[what] += 1
            more += effects
            print(f'| {name} | {kind} | {where} | {what} | {effects} |', flush=True)
    print(f'\nof {sum(found.values())}: ' + ', '.join(f'{n} {k}' for k, n in found.items())
          + f'; {more} effects claimed that the right columns do not have')


def effects_of(rng, az, el):
    """Offsets on the sky of up to three effects of 1 to 300 arcsec."""
    x, y = np.zeros((2, len(az)))
    for _ in range(rng.integers(0, 4)):
        size, k = 10**rng.uniform(0.0, 2.5) * ARCSEC, rng.integers(1, 8)
        phase, kind = rng.uniform(0.0, TURN), rng.integers(7)
        wave = np.cos(k * az + phase)
        drift = np.linspace(0.0, 1.0, len(az))
        x = x + size * [0.0, 0.0, 0.0, wave * np.cos(el), 0.0, drift,
                        np.cos(el) * rng.choice([-1.0, 1.0], len(az))][kind]
        y = y + size * [np.sin(el), 1.0 / np.tan(el), np.cos(2.0 * el + phase), 0.0, wave, 0.0,
                        0.0][kind]
    return x, y


def right_input(data, nights):
    """Print how many correct runs are refused, and the time of a check."""
    files = [ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv',
             *sorted(data.glob('arc35m/*.dat')), *sorted(data.glob('iram30m/*.log')),
             *data.glob('spk8m/pmfit_altaz.dat'), *data.glob('mmt/*.dat')]
    passed, refused, noted, begin = 0, 0, 0, time.process_time()
    for path in files:
        try:
            run = read_run(path)
        except ValueError:
            continue  # a header without rows
        try:
            noted += bool(check_columns(run).findings)
            passed += 1
        except MistakenColumns as error:
            refused += 1
            print(f'REFUSED: {error}')
    print(f'\nmeasured runs: {refused} of {passed + refused} refused, {noted} with a note; '
          f'{1e3 * (time.process_time() - begin) / (passed + refused):.0f} ms CPU each, read '
          'included')
    refused, noted = 0, 0
    for seed in range(nights):
        rng = np.random.default_rng(seed)
        terms = {name: rng.normal() * 10**rng.uniform(0.0, 3.8) for name in PHYSICAL
                 if rng.random() < 0.7}
        if rng.random() < 0.3:
            terms['IA'] = rng.uniform(-170.0, 170.0) * 3600.0
        start, width = rng.uniform(0.0, 360.0), rng.choice([23.0, 90.0, 180.0, 360.0])
        az, el, az_enc, el_enc = simulated(rng, int(rng.choice([12, 20, 40, 80, 200])), terms,
                                           10**rng.uniform(-0.5, 1.0), (start, start + width))
        x, y = effects_of(rng, az, el)
        try:
            noted += bool(check_columns(PointingRun(dict(zip(
                NAMES, (az, el, az_enc + x / np.cos(el), el_enc + y))))).findings)
        except MistakenColumns:
            refused += 1
    print(f'simulated nights: {refused} of {nights} refused, {noted} with a note')


def main():
    """Run, print tables in Markdown."""
    import tempfile
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--data', type=Path, default=ROOT.parent / 'shared' / 'data')
    parser.add_argument('--nights', type=int, default=100)
    parser.add_argument('--full', action='store_true', help='2000 nights')
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        mistakes(args.data, Path(folder) / 'run.csv')
    right_input(args.data, 2000 if args.full else args.nights)


if __name__ == '__main__':
    main()
