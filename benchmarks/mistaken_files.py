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

"""Files with mistaken columns, clock or site, for all kinds of mount; and correct files.

    python benchmarks/mistaken_files.py [--runs N] [--right N] [--only KIND ...] [--verbose]

Files as users write them: alt-azimuth, fork and German mounts; German ones with and without a pier
side column, with and without rows through the pole; alt-azimuth ones with 0, 30 and 60 % of the
rows beyond the zenith. They have 8 to 80 rows, terms of 10 to 1000 arcsec, zeros of degrees in a
third of them, noise of 0.5 to 10 arcsec. Every mistake of `mistakes` is made in the catalogue's
columns, the mount's, or both; for files with right ascensions every clock and site of `elsewhere`.

`named`: refused with the right reason; `refused`: refused with another reason or none; `noted`:
fitted, with a note that it may be mistaken; `alike`: both signs reversed, or mount and catalogue
exchanged, which no fit can detect: the result reports this; `harmless`: fitted, with every term
within 5 sigma of the true one; `WRONG`: fitted, with some term farther off. Then correct files,
none of which may be refused.
"""

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from calibration.analysis.diagnosis.mistaken_columns import check_columns
from calibration.analysis.term_fit import fit_terms
from calibration.report.wording import wording
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.geometry import sky_to_encoder
from pointing_model.mounts import ALTAZ, Mount, through_pole
from pointing_model.sky.places import observed_to_icrs
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site
from telescope_mount.input_files.run_loader import load_run

SIGMAS = 5.0
#: kind of mount, a column of the side of the pier, share of the rows through the pole (of a German
#: mount those east of the meridian) or beyond the zenith
FORMS = {'alt-azimuth': ('altaz', False, 0.0), 'fork': ('equatorial', False, 0.0),
         'German, pier column, both sides': ('german', True, 0.5),
         'German, pier column, one side': ('german', True, 0.0),
         'German, through the pole by declination': ('german', False, 0.5),
         'German, one side': ('german', False, 0.0),
         'alt-azimuth, 30 % beyond the zenith': ('altaz', False, 0.3),
         'alt-azimuth, 60 % beyond the zenith': ('altaz', False, 0.6)}
OF_CATALOGUE, OF_ENCODERS = ' of the catalogue', ' of the encoders'
OF_BOTH = ' of catalogue and encoders'
START = 1772539200.0  # 2026-03-03T12:00:00Z
ZONES = (-11, -8, -5, -3.5, -1, 1, 2, 5.5, 5.75, 8, 9.5, 12)


def mount_of(kind, site):
    """The mount."""
    return ALTAZ if kind == 'altaz' else Mount.equatorial(site.latitude, kind)


def simulated(rng, kind, through, site):
    """Mount, places and readings on the sky and beyond (radians), terms, rows beyond, moments."""
    mount, n = mount_of(kind, site), int(rng.choice([8, 12, 20, 40, 80]))
    size = 10**rng.uniform(1.0, 3.0)
    terms = {name: rng.normal() * size * ARCSEC for name in mount.names.physical}
    if rng.random() < 1.0 / 3.0:
        first, second = mount.names.index
        terms[first] = rng.uniform(-170.0, 170.0) * DEG
        terms[second] = rng.normal() * DEG
    if kind == 'altaz':
        h, d = rng.uniform(0.0, 360.0, n) * DEG, np.arcsin(rng.uniform(0.3, 0.99, n))
    else:
        h, d = rng.uniform(-85.0, 85.0, 20 * n) * DEG, np.arcsin(rng.uniform(-0.5, 0.99, 20 * n))
        h, d = (v[mount.horizon_of(h, d)[1] > 15.0 * DEG][:n] for v in (h, d))
    if kind == 'altaz':
        beyond = rng.permutation(n) < round(through * n)
    else:
        beyond = (h < 0.0) & (through > 0.0)
    a, e = sky_to_encoder(*through_pole(h, d, beyond), terms, mount)
    noise = 10**rng.uniform(-0.3, 1.0) * ARCSEC
    x, y = noise * rng.normal(size=(2, len(h)))
    seen = np.isfinite(a + e)
    moment = START + np.sort(rng.uniform(0.0, 6.0, len(h))) * 3600.0
    return mount, [v[seen] for v in (h, d, a + x / np.cos(d), e + y, moment)], terms, beyond[seen]


def write(path, kind, columns, beyond=None, stars=None, site=None, lst=None):
    """Write a file; `columns` in degrees, `stars`: ra, dec, time.

    `lst`: a column of the sidereal time, degrees.
    """
    names = ['az_deg', 'el_deg', 'az_enc_deg', 'el_enc_deg'] if kind == 'altaz' else [
        'ha_deg', 'dec_deg', 'ha_enc_deg', 'dec_enc_deg']
    head = [] if kind == 'altaz' else [f'# mount: {kind}']
    head += [f'# latitude_deg: {site.latitude / DEG:.6f}', '# frame: ICRS',
             f'# longitude_deg: {site.longitude / DEG:.6f}', f'# height_m: {site.height}',
             '# pressure_hpa: 955', '# temperature_c: 8']
    if stars is not None:
        ra, dec, moment = stars
        names[:2] = ['time', 'ra_deg', 'dec_deg']
        stamps = np.datetime_as_string((moment * 1e3).astype('datetime64[ms]'))
        columns = [stamps, *(np.char.mod('%.7f', v) for v in (ra / DEG, dec / DEG)), *(
            np.char.mod('%.7f', v) for v in columns[2:])]
    else:
        columns = [np.char.mod('%.9f', v) for v in columns]
    if lst is not None:
        names.append('lst_h')
        columns.append(np.char.mod('%.9f', lst / 15.0))
    if beyond is not None:
        names.append('pier_side')
        columns.append(np.where(beyond, 'west', 'east'))
    rows = [','.join(row) for row in zip(*columns)]
    path.write_text('\n'.join([*head, ','.join(names), *rows]) + '\n')


def mistakes(kind, lst):
    """Yield name, place, required text, and the change of (a, e) of both pairs, degrees.

    None where nothing is done; `lst` the sidereal time, degrees.
    """
    a, e, p = ('azimuth', 'elevation', 'zenith distance') if kind == 'altaz' else (
        'hour angle', 'declination', 'polar distance')

    def short(v):
        return np.remainder(v, 360.0) if kind == 'altaz' else np.remainder(v + 180.0, 360.0) - 180.0
    for name, said, one in (
            (f'{a} in hours', f'{a}%s in hours', lambda x, y: (short(x) / 15.0, y)),
            ('gradians', f'{a} and {e}%s in gradians', lambda x, y: (short(x) / 0.9, y / 0.9)),
            ('radians', 'radians', lambda x, y: (short(x) * DEG, y * DEG)),
            (f'{a} in radians', 'radians', lambda x, y: (short(x) * DEG, y)),
            ('arcminutes', f'{a} and {e}%s in arcminutes', lambda x, y: (60.0 * x, 60.0 * y)),
            ('arcseconds', f'{a} and {e}%s in arcseconds', lambda x, y: (3600.0 * x, 3600.0 * y)),
            (f'sign of {a}', f'{a}%s counted', lambda x, y: (short(-x), y)),
            (f'sign of {e}', f'{e}%s with the other sign', lambda x, y: (x, -y)),
            (p, f'{p} in place of the {e}%s', lambda x, y: (x, 90.0 - y)),
            ('axes exchanged', f'{a} and {e}%s exchanged', lambda x, y: (y, short(x))),
            *([] if kind == 'altaz' else [(
                'right ascension', 'right ascension in place of the hour angle%s',
                lambda x, y: (np.remainder(lst - x, 360.0), y))])):
        for where, on in ((OF_CATALOGUE, (one, None)), (OF_ENCODERS, (None, one)),
                          (OF_BOTH, (one, one))):
            yield name, where, said % where if '%s' in said else said, on


def mistakes_beyond(beyond):
    """The same for readings through the pole, not turned or folded there."""
    def turned(a):
        return np.where(beyond, np.remainder(a, 360.0) - 180.0, a)

    def folded(e):
        return np.where(beyond, 180.0 - e, e)
    for name, said, one in (
            ('hour angle not turned', 'beyond 90 degrees with the hour angle of the star',
             lambda a, e: (turned(a), e)),
            ('declination folded', 'folded back to below 90 degrees where the hour angle is',
             lambda a, e: (a, folded(e))),
            ('both folded', 'folded back to below 90 degrees where stars east',
             lambda a, e: (turned(a), folded(e)))):
        yield f'beyond the pole, {name}', '', said, (None, one)


def outcome(path, said, truth):
    """Outcome for a file."""
    try:
        run = load_run(path)
        checked = check_columns(run)
        fitted = fit_terms(run)
    except ValueError as error:
        return 'named' if said in str(error) else 'refused', str(error)
    names = list(fitted.names)
    off = [abs(wrap(fitted.model.terms[n] - truth[n])) for n in names]
    sigma = np.sqrt(np.diagonal(fitted.covariance))
    worst = float(np.max(np.divide(off, np.maximum(sigma, 1e-12))))
    notes = [*map(wording, checked.findings),
             *(n for n in run.meta['notes'] if 'axis would be tilted' in n)]
    text = '; '.join(notes) + ' alike: ' + '; '.join(checked.alike) + f' {worst:.1f} sigma'
    signs = ('mount and catalogue exchanged', 'of catalogue and encoders counted the other way')
    if worst <= SIGMAS:
        return 'harmless', text
    if said in signs or said.endswith(OF_BOTH + ' counted'):
        return 'alike', text
    return ('noted' if notes or any(said in one for one in checked.alike)
            else 'WRONG'), text


def of_columns(rng, form, path):
    """Every mistake in the columns of a run of one form."""
    kind, pier, through = FORMS[form]
    site = Site(48.0 * DEG, 11.0 * DEG, 500.0)
    mount, columns, terms, beyond = simulated(rng, kind, through, site)
    h, d, a, e, moment = columns
    lst = np.remainder(moment * 360.0 / 86164.0905 + 10.0, 360.0)
    through_by_reading = beyond.any() and not pier
    if pier:
        a, e = through_pole(a, e, beyond)
    a = wrap(a) if kind != 'altaz' else np.remainder(a, 2.0 * np.pi)
    h, d, a, e = (v / DEG for v in (h, d, a, e))
    for name, where, said, (one, other) in (
            *mistakes(kind, lst), *(
                mistakes_beyond(beyond) if through_by_reading and kind != 'altaz' else ())):
        written = [*(one or (lambda *v: v))(h, d), *(other or (lambda *v: v))(a, e)]
        write(path, kind, written, beyond if pier else None, site=site,
              lst=lst if name == 'right ascension' else None)
        yield (form, name + where), outcome(path, said, terms)
    write(path, kind, [a, e, h, d], beyond if pier else None, site=site)
    yield (form, 'mount and catalogue exchanged'), outcome(
        path, 'mount and catalogue exchanged', terms)


def of_stars(rng, form, path):
    """Every other clock and site of a run of right ascensions."""
    kind, pier, through = FORMS[form]
    site = Site(rng.uniform(15.0, 60.0) * rng.choice([-1, 1]) * DEG,
                rng.uniform(5.0, 85.0) * rng.choice([-1, 1]) * DEG, 500.0)
    mount, (h, d, a, e, moment), terms, beyond = simulated(rng, kind, through, site)
    air = Weather(955.0, 8.0)
    place = (h, d) if kind == 'altaz' else mount.horizon_of(h, d)
    ra, dec = observed_to_icrs(*place, moment, site, air)
    if pier:
        a, e = through_pole(a, e, beyond)
    a, e = (np.remainder(a, 2.0 * np.pi) if kind == 'altaz' else wrap(a)) / DEG, e / DEG
    side = beyond if pier else None

    def file(hours=0.0, where=site):
        write(path, kind, [None, None, a, e], side, (ra, dec, moment + 3600.0 * hours), where)
    zone = float(rng.choice(ZONES))
    file(zone)
    yield (form, 'local time'), outcome(path, f'a clock {abs(zone):g} hour', terms)
    for name, said, other in (
            ('sign of the longitude', 'the longitude with the other sign',
             Site(site.latitude, -site.longitude, 500.0)),
            ('sign of the latitude', 'the latitude with the other sign',
             Site(-site.latitude, site.longitude, 500.0)),
            ('latitude and longitude exchanged', 'latitude and longitude exchanged',
             Site(site.longitude, site.latitude, 500.0))):
        file(where=other)
        yield (form, name), outcome(path, said, terms)


def right(rng, form, path, of_sky):
    """A correct file: whether it is refused, and a note."""
    kind, pier, through = FORMS[form]
    site = Site(rng.uniform(15.0, 60.0) * DEG, rng.uniform(-150.0, 150.0) * DEG, 500.0)
    mount, (h, d, a, e, moment), terms, beyond = simulated(rng, kind, through, site)
    stars = None
    if of_sky:
        place = (h, d) if kind == 'altaz' else mount.horizon_of(h, d)
        stars = (*observed_to_icrs(*place, moment, site, Weather(955.0, 8.0)), moment)
    if pier:
        a, e = through_pole(a, e, beyond)
    a = np.remainder(a, 2.0 * np.pi) if kind == 'altaz' else wrap(a)
    write(path, kind, [v / DEG for v in (h, d, a, e)], beyond if pier else None, stars, site)
    try:
        run = load_run(path)
        checked = check_columns(run)
    except ValueError as error:
        return 'refused', str(error)
    more = [text for text in checked.alike if 'exchanged' not in text and 'counted' not in text]
    return ('noted' if checked.findings else 'alike' if more else 'passed'), '; '.join(
        [*map(wording, checked.findings), *more])


def table(found, columns):
    """Print counts in Markdown."""
    print('| |' + ''.join(f' {name} |' for name in columns))
    print('| ---' * (len(columns) + 1) + ' |')
    for name, counts in found.items():
        print(f'| {name} |' + ''.join(f' {counts[one]} |' for one in columns))


def main():
    """Run, print tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--runs', type=int, default=10, help='of each form, with every mistake')
    parser.add_argument('--right', type=int, default=200, help='right files')
    parser.add_argument('--only', nargs='+', choices=FORMS, default=list(FORMS))
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--verbose', action='store_true')
    args = parser.parse_args()
    begin = time.process_time()
    results = ('named', 'refused', 'noted', 'alike', 'harmless', 'WRONG')
    by_form, by_mistake = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'run.csv'
        for form in args.only:
            for seed in range(args.runs):
                rng = np.random.default_rng((args.seed, seed, list(FORMS).index(form)))
                for (_, what), (result, text) in (
                        *of_columns(rng, form, path), *of_stars(rng, form, path)):
                    by_form.setdefault(form, Counter())[result] += 1
                    by_mistake.setdefault(what, Counter())[result] += 1
                    if result == 'WRONG' or args.verbose and result in ('refused', 'noted'):
                        print(f'    {result}: {form}, seed {seed}: {what}: {text[:400]}')
        table(by_form, results)
        print()
        table(by_mistake, results)
        passed = {}
        for seed in range(args.right):
            rng = np.random.default_rng((args.seed, seed, 99))
            form = list(args.only)[seed % len(args.only)]
            result, text = right(rng, form, path, bool(rng.integers(2)))
            passed.setdefault(form, Counter())[result] += 1
            if result == 'refused' or args.verbose and result != 'passed':
                print(f'    {result}: {form}, seed {seed}: {text[:400]}')
        print()
        table({f'right: {name}': counts for name, counts in passed.items()},
              ('passed', 'alike', 'noted', 'refused'))
    print(f'\n{time.process_time() - begin:.0f} s of CPU')


if __name__ == '__main__':
    main()
