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

"""Plate-solved runs: fitted terms, detection of bad rows, frames, and a real solver.

    python benchmarks/plate_solved.py [--nights N] [--images N] [--full]

Nights are simulated by rotations (`encoder_sim.mount_geometry`): terms from zero to a degree, some
with an azimuth bearing wobble that no term represents, 20 to 80 rows in 1 to 6 hours, noise of 0.3
to 5 arcsec. `terms`: the same night as readings with the star centred, and as image centres two
arcminutes from it. `named`: fraction of rows made false, copied, double or of another scale that
are recognised as such; `sound rows named`: fraction of all other rows named. `frames`: fraction of
files in another frame than declared that are refused with the right frame named, and fraction of
correct files refused.

With `solve-field` and index files installed, `--images` of catalogue stars are drawn (400 x 400
pixels of 60 arcsec) and solved. Printed: error of the place in arcsec and in the sigma from
`telescope-mount solve`. Then a night of such images is fitted.
"""

import argparse
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from calibration.analysis.term_fit import fit_terms
from encoder_sim.azimuth_track import Wobble
from encoder_sim.mount_geometry import (
    MountErrors,
    MountGeometry,
    azimuth_elevation,
    direction,
)
from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import centred
from pointing_model.runs.formats.csv import iso_utc
from pointing_model.runs.plate_solves.frames import parse_frame, to_icrs
from pointing_model.runs.run import PointingRun
from pointing_model.sky.places import observed_place, observed_to_icrs
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site
from pointing_model.sky.star_catalogue import load_catalogue

SITE = Site(34.3 * DEG, 109.0 * DEG, 500.0)
START = 1_795_000_000.0  # 2026-11-18T11:06:40Z
SOLID = MountErrors(ia=310 * ARCSEC, ie=-170 * ARCSEC, ca=46 * ARCSEC, npae=-23 * ARCSEC,
              an=37 * ARCSEC, aw=-21 * ARCSEC, tf=15 * ARCSEC)
HEAD = '# latitude_deg: 34.3\n# longitude_deg: 109.0\n# height_m: 500\n'
KINDS = ('false', 'copied', 'double', 'scale')
FRAMES = ('mean of date', 'of date', 'B1950')


def simulated(count=40, hours=4.0, seed=5, beside=15.0, noise=1.0, mount=SOLID):
    """A night: readings and image centres, and the readings with the star centred.

    Parameters
    ----------
    count : int
        Stars, of which those below 20 degrees are dropped.
    hours : float
    seed : int
    beside : float
        How far the axes point beside the star, arcsec, standard deviation of each.
    noise : float
        Of the readings, arcsec.
    mount : encoder_sim.mount_geometry.MountErrors

    Returns
    -------
    SimpleNamespace
        ``time``, ``az``, ``el`` (of the star), ``centred``, ``read`` (2, n), ``ra``, ``dec`` (ICRS,
        of the boresight), ``air``; radians.
    """
    rng = np.random.default_rng(seed)
    time = START + np.sort(rng.uniform(0.0, 3600.0 * hours, count))
    pressure, temperature = rng.uniform(940, 960, count), np.linspace(12.0, 3.0, count)
    air = Weather(pressure, temperature, 0.5, 0.55)
    stars = load_catalogue(mag_limit=5.0)
    up = observed_place(stars, START, SITE)[1] > 30 * DEG
    stars = stars.select(rng.choice(np.flatnonzero(up), count, replace=False))
    az, el = observed_place(stars, time, SITE, air)
    high = el > 20 * DEG
    az, el, time = az[high], el[high], time[high]
    air = Weather(pressure[high], temperature[high], 0.5, 0.55)
    # the axes point beside the star, and what the camera then says is taken out of the readings
    axis_az = az + rng.normal(0.0, beside, len(az)) * ARCSEC / np.cos(el)
    axis_el = el + rng.normal(0.0, beside, len(az)) * ARCSEC
    bore = azimuth_elevation(MountGeometry(mount).frames(axis_az, axis_el)[:, 1])
    noise = rng.normal(0.0, noise, (2, len(az))) * ARCSEC
    noise[0] /= np.cos(el)
    centre = star_centred(axis_az, axis_el, direction(az, el), mount)
    ra, dec = observed_to_icrs(*bore, time, SITE, air)
    return SimpleNamespace(time=time, az=az, el=el, centred=centre + noise, ra=ra, dec=dec, air=air,
                           read=np.stack((axis_az, axis_el)) + noise)


def star_centred(az, el, star, mount):
    """Axis angles that put the star on the boresight, by miss distances until there is none."""
    for _ in range(8):
        seen = np.einsum('nij,nj->ni', MountGeometry(mount).frames(az, el), star)
        right, forward, upward = seen.T
        az, el = centred(az, el, right / forward, upward / forward)
    return np.stack((az, el))


def columns_of(night, **more):
    """Columns of a plate-solved CSV, by name; `more` replaces and adds."""
    return {'time': iso_utc(night.time), 'ra_deg': night.ra / DEG, 'dec_deg': night.dec / DEG,
            'az_enc_deg': night.read[0] / DEG, 'el_enc_deg': night.read[1] / DEG,
            'pressure_hpa': night.air.pressure_hpa, 'temperature_c': night.air.temperature_c,
            **more}


def write(path, columns, head=HEAD + '# frame: ICRS\n'):
    """Write such a CSV; its first row is line 6 with the default head."""
    lines = [','.join(columns)]
    lines += [','.join(str(v) for v in row) for row in zip(*columns.values())]
    path.write_text(head + '\n'.join(lines) + '\n')
    return path


def given_in(night, frame):
    """Right ascension and declination (degrees) of the night in another frame, by iteration."""
    ra, dec = night.ra.copy(), night.dec.copy()
    for _ in range(30):
        back = to_icrs(ra, dec, frame, night.time)
        ra = ra - np.angle(np.exp(1j * (back[0] - night.ra)))
        dec = dec - (back[1] - night.dec)
    return {'ra_deg': np.mod(ra, 2 * np.pi) / DEG, 'dec_deg': dec / DEG}


def draw(path, ra, dec, header, size=400, scale=60.0, roll=0.4, seed=0):
    """An image of the catalogue's stars about a place (radians), as the eye sees the sky."""
    from astropy.io import fits
    rng = np.random.default_rng(seed)
    stars = load_catalogue(mag_limit=8.0)
    star_ra, star_dec = stars.at_j2000[:2]
    toward = np.cos(star_dec) * np.cos(star_ra - ra)
    depth = np.sin(dec) * np.sin(star_dec) + np.cos(dec) * toward
    east = np.cos(star_dec) * np.sin(star_ra - ra) / depth
    north = (np.cos(dec) * np.sin(star_dec) - np.sin(dec) * toward) / depth
    x = (-east * np.cos(roll) + north * np.sin(roll)) / (scale * ARCSEC) + 0.5 * (size - 1)
    y = (east * np.sin(roll) + north * np.cos(roll)) / (scale * ARCSEC) + 0.5 * (size - 1)
    seen = (depth > 0) & (np.abs(x - size / 2) < size / 2) & (np.abs(y - size / 2) < size / 2)
    image = rng.normal(100.0, 5.0, (size, size))
    flux = 6e6 * 10 ** (-0.4 * stars.mag)
    grid = np.arange(-6, 7)
    for i in np.flatnonzero(seen):
        col, row = int(round(x[i])), int(round(y[i]))
        rows, cols = row + grid, col + grid
        rows, cols = rows[(rows >= 0) & (rows < size)], cols[(cols >= 0) & (cols < size)]
        spot = np.exp(-0.5 * ((rows[:, None] - y[i]) ** 2 + (cols - x[i]) ** 2) / 1.3**2)
        image[np.ix_(rows, cols)] += flux[i] / (2 * np.pi * 1.3**2) * spot
    fits.writeto(path, np.clip(image, 0, 6e4).astype(np.uint16), fits.Header(header))


def any_mount(rng):
    """A mount with terms from zero to a degree, in half of the cases with a wobble."""
    size = 10 ** rng.uniform(0.0, 3.5)
    names = ('ia', 'ie', 'ca', 'npae', 'an', 'aw')
    terms = dict(zip(names, rng.normal(0.0, size, len(names)) * ARCSEC))
    wobble = ()
    if rng.random() < 0.5:
        wobble = (Wobble(amplitude=10 ** rng.uniform(0, 1.5) * ARCSEC, per_turn=2,
                         phase=rng.uniform(0, 6), lean='forward'),)
    return MountErrors(**terms, tf=rng.normal(0, 20) * ARCSEC, wobble=wobble)


def any_night(seed, hours=None):
    """A night of such a mount."""
    rng = np.random.default_rng([seed, 77])
    return simulated(int(rng.integers(24, 90)), hours or rng.uniform(1.0, 6.0), seed,
                     beside=60.0, noise=10 ** rng.uniform(-0.5, 0.7), mount=any_mount(rng))


def spoil(night, kind, rng):
    """Columns with two bad rows of a kind, and (words, line in the file) that must be reported."""
    columns = {name: np.array(v) for name, v in columns_of(night).items()}
    n = len(night.time)
    columns['sigma_arcsec'] = np.full(n, 0.3)
    columns['scale_arcsec_px'] = np.full(n, 1.2) * rng.normal(1.0, 1e-3, n)
    rows = rng.choice(np.arange(1, n), 2, replace=False)
    if kind == 'false':
        columns['ra_deg'][rows] = rng.uniform(0, 360, 2)
        columns['dec_deg'][rows] = np.degrees(np.arcsin(rng.uniform(-0.2, 0.9, 2)))
        # below the horizon a row is left out for that
        return columns, {int(r) + 6: ('false solve', 'elevation outside') for r in rows}
    if kind == 'copied':
        for name in ('ra_deg', 'dec_deg'):
            columns[name][rows] = columns[name][rows - 1]
        names = {}
        for r in rows:
            # of two the one that fits the encoders stays
            names[int(r) + 6] = ('copied', 'elevation outside')
        return columns, names
    if kind == 'double':
        columns = {name: np.concatenate((v, v[rows])) for name, v in columns.items()}
        columns['ra_deg'][n:] += rng.normal(0, 0.5, 2) / 3600
        columns['sigma_arcsec'][n:] = 0.4
        return columns, {n + 6: ('a second solution',), n + 7: ('a second solution',)}
    columns['scale_arcsec_px'][rows] *= [2.0, -1.0]
    return columns, {int(r) + 6: ('image scale',) for r in rows}


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--nights', type=int, default=12)
    parser.add_argument('--images', type=int, default=6)
    parser.add_argument('--full', action='store_true', help='200 nights, 40 images')
    args = parser.parse_args()
    nights, images = (200, 40) if args.full else (args.nights, args.images)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        _terms(folder, min(nights, 50))
        _named(folder, nights)
        _frames(folder, nights)
        _solver(folder, images)


def _say(what, figure, target='', count=''):
    print(f'{what:<58} {figure:>22} {target:>12} {count:>14}', flush=True)


def _terms(folder, nights):
    from telescope_mount.input_files.run_loader import load_run
    worst, ratio = 0.0, 0.0
    for seed in range(nights):
        for noise in (1e-6, 1.0):
            night = simulated(40, 4.0, seed, beside=120.0, noise=noise)
            az, el = night.centred
            missed = fit_terms(PointingRun({'az': night.az, 'el': night.el, 'az_enc': az,
                                            'el_enc': el}))
            solved = fit_terms(load_run(write(folder / 'run.csv', columns_of(night))))
            away = np.abs(solved.coefficients - missed.coefficients)
            if noise < 0.1:
                worst = max(worst, away.max() / ARCSEC)
            else:
                ratio = max(ratio, (away / np.sqrt(np.diag(missed.covariance))).max())
    _say('terms, solved - centred, no noise, largest, arcsec', f'{worst:.5f}', '0.01', nights)
    _say('the same with 1 arcsec of noise, in sigma', f'{ratio:.3f}', '', nights)


def _named(folder, nights):
    from telescope_mount.input_files.run_loader import load_run
    found, made, wrong, sound = dict.fromkeys(KINDS, 0), dict.fromkeys(KINDS, 0), 0, 0
    for seed in range(nights):
        night = any_night(seed)
        rng = np.random.default_rng([seed, 5])
        for kind in (*KINDS, None):
            columns, lines = spoil(night, kind, rng) if kind else (columns_of(night), {})
            run = load_run(write(folder / 'run.csv', columns))
            told = {row['row']: row['reason'] for row in run.meta['excluded']}
            if kind:
                made[kind] += len(lines)
                found[kind] += sum(any(word in told.get(line, '') for word in words)
                                   for line, words in lines.items())
            wrong += len(set(told) - set(lines))
            sound += len(columns['time']) - len(lines)
    for kind in KINDS:
        _say(f'rows named: {kind}', f'{100 * found[kind] / made[kind]:.1f} %', '', made[kind])
    _say('sound rows named', f'{100 * wrong / sound:.3f} %', '', sound)


def _frames(folder, nights):
    from telescope_mount.input_files.run_loader import load_run
    for hours in (0.25, 1.0, 4.0):
        refused, named, lost = 0, 0, 0
        for seed in range(nights):
            night = any_night(seed, hours)
            for said in FRAMES:
                places = given_in(night, parse_frame(said))
                try:
                    load_run(write(folder / 'run.csv', columns_of(night, **places)))
                except ValueError as error:
                    refused += 1
                    named += f'"# frame: {said}"' in str(error)
                try:
                    load_run(write(folder / 'run.csv', columns_of(night, **places),
                                   HEAD + f'# frame: {said}\n'))
                except ValueError:
                    lost += 1
        count = len(FRAMES) * nights
        _say(f'another frame than the file says, {hours:g} h: refused',
             f'{100 * refused / count:.1f} %', '', count)
        _say('   and the right one named', f'{100 * named / count:.1f} %', '', count)
        _say('   right frames refused', f'{100 * lost / count:.1f} %', '', count)


def _solver(folder, images):
    from pointing_model.runs.plate_solves.mapping import load_mapping
    from pointing_model.runs.plate_solves.solvers import NoSolver, find_solver
    from telescope_mount.input_files.image_folder import solve_folder
    from telescope_mount.input_files.run_loader import load_run
    try:
        solver = find_solver('solve-field', 60.0, (50.0, 70.0))
    except NoSolver as error:
        print(f'no real solver: {error}')
        return
    night = simulated(images, 4.0, 1, noise=0.0)
    for i in range(len(night.time)):
        draw(folder / f'img_{i:03d}.fits', night.ra[i], night.dec[i], {
            'DATE-OBS': iso_utc(night.time[i:i + 1])[0].rstrip('Z'), 'TEMP': float(
                night.air.temperature_c[i]), 'PRES': float(night.air.pressure_hpa[i]),
            'ENC_AZ': night.read[0][i] / DEG, 'ENC_EL': night.read[1][i] / DEG}, seed=i)
    (folder / 'mount.yaml').write_text(
        'site: {latitude_deg: 34.3, longitude_deg: 109.0, height_m: 500}\ntime_is: start\n'
        'encoders_at: start\nkeywords: {time: DATE-OBS, az_enc_deg: ENC_AZ, el_enc_deg: ENC_EL, '
        'temperature_c: TEMP, pressure_hpa: PRES}\n')
    counts = solve_folder(folder, load_mapping(folder / 'mount.yaml'), solver,
                          folder / 'solved.csv')
    _say('images solved by solve-field', f'{counts["solved"]}', '', len(night.time))
    lines = [line.split(',') for line in (folder / 'solved.csv').read_text().splitlines()
             if not line.startswith('#')]
    rows = [dict(zip(lines[0], line)) for line in lines[1:]]
    at = [int(row['star'][4:7]) for row in rows]
    x = (np.array([float(row['ra_deg']) for row in rows]) * DEG - night.ra[at]) \
        * np.cos(night.dec[at]) / ARCSEC
    y = (np.array([float(row['dec_deg']) for row in rows]) * DEG - night.dec[at]) / ARCSEC
    sigma = np.array([float(row['sigma_arcsec'] or 'nan') for row in rows])
    _say('their places, RMS an axis, arcsec (a pixel is 60)',
         f'{np.sqrt(np.mean(np.square((x, y)))):.2f}', '', 2 * len(rows))
    _say('the same in their sigma, median of |z| (Gaussian: 0.67)',
         f'{np.nanmedian(np.abs((x / sigma, y / sigma))):.2f}', '', 2 * len(rows))
    if len(rows) >= 10:
        run = load_run(folder / 'solved.csv')
        fitted = fit_terms(run)
        names = ('ia', 'ie', 'ca', 'npae', 'an', 'aw', 'tf')
        z = [(fitted.model.terms[n.upper()] - getattr(SOLID, n)) / s
             for n, s in zip(names, np.sqrt(np.diag(fitted.covariance)))]
        _say('terms of these images, largest |fitted - true| / sigma', f'{np.abs(z).max():.1f}', '',
             len(run))


if __name__ == '__main__':
    main()
