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

"""The zero from exposures of chosen stars, at any latitude, compared with Polaris at +34 degrees.

    python benchmarks/zero_on_stars.py [--dates N] [--seeds N] [--full] [--seed N] [--only PART ...]

The model, with its covariance, is a fit of seven terms to 30 stars of the night before (noise 1"
per axis); tonight's zero is different. Each date and hour has its own choice of stars, each seed
its own mount, earlier night and noise. Exposures are 8 s apart, or 30 s with a change of star. The
peer is the zero from 16 exposures of Polaris with an alt-azimuth mount at +34.3 degrees and a model
of the same kind, everything else equal. `sigma` is from the covariance (RMS over the cases),
`error` the RMS of the true error, `error/sigma` its RMS in units of each case's sigma, `slew` the
total motion of the axes in degrees. `--full`: 4 dates, 3 hours, 100 seeds.
"""

import argparse
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
import zero_drift

from calibration.analysis.encoders.cross_check import cross_check
from calibration.analysis.term_fit import fit_terms
from calibration.analysis.zero.power_on_zeros import zero_from_exposures
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.runs.run import PointingRun
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import Site
from pointing_model.sky.star_catalogue import POLARIS_HIP, load_catalogue
from pointing_model.zero import MARK
from telescope_mount.observing.star_choice import ANYWHERE, axes_at, choose_stars
from telescope_mount.observing.zero_stars import Before, zero_stars

START, DAY = 1_768_482_000.0, 86400.0
LATITUDES = (-80, -60, -40, -20, 0, 20, 40, 60, 80)
TARGET, PEER = 1.3, 34.3
PARTS = ('sixteen', 'change', 'few', 'coloured', 'mounts', 'encoders')
PACE, SLEW = 8.0, 30.0
FIRST = 900_000  # number of a star that is exposed for a zero
of_polaris = zero_drift.sky
NAMES = {'altaz': lambda latitude: ALTAZ, 'fork': Mount.equatorial,
         'german': lambda latitude: Mount.equatorial(latitude, 'german')}


class Cases(NamedTuple):
    """Errors and sigmas of zeros, (n, 2), arcsec; stars and degrees slewed of each choice."""

    error: np.ndarray
    sigma: np.ndarray
    stars: list
    slews: list

    @property
    def rms(self):
        """RMS of the errors, (2,)."""
        return np.sqrt(np.mean(np.square(self.error), axis=0))

    @property
    def said(self):
        """RMS of the sigmas, (2,)."""
        return np.sqrt(np.mean(np.square(self.sigma), axis=0))

    @property
    def pull(self):
        """RMS of error / sigma, (2,)."""
        return np.sqrt(np.mean(np.square(self.error / self.sigma), axis=0))


def noise(rng, n, rho):
    """Noise of both axes, arcsec: AR(1) with coefficient `rho`, white for 0."""
    e = rng.normal(size=(2, n))
    for i in range(1, n if rho else 0):
        e[:, i] = rho * e[:, i - 1] + np.sqrt(1.0 - rho * rho) * e[:, i]
    return e


def places(stars, rows, times, site, mount):
    """Axis angles of perfect axes at each time."""
    az, el = observed_place(stars.select(rows), times, site, DEFAULT_WEATHER)
    return axes_at(mount, az, el, ANYWHERE, stars.hip[rows])


def times_of(begin, star):
    """Times of successive exposures."""
    step = np.where(np.diff(star) == 0, PACE, SLEW)
    return begin + np.concatenate(([0.0], np.cumsum(step)))


def run_of(truth, place, star, zero, e, marked):
    """Simulated encoder readings."""
    first, second = truth.sky_to_encoder(*place)
    return PointingRun({
        'az': place[0], 'el': place[1], 'star': star.astype(float),
        'az_enc': place[0] + wrap(first + zero[0] + e[0] * ARCSEC / np.cos(place[1]) - place[0]),
        'el_enc': second + zero[1] + e[1] * ARCSEC, 'run': np.ones(len(star)),
        MARK: np.full(len(star), float(marked))},
        {} if truth.mount.vertical else {'mount': truth.mount})


def cases(latitude, n, moments, seeds, *, mount='altaz', polaris=False, rho=0.0, seed=0):
    """Zeros at a latitude, `Cases`."""
    stars, pole = load_catalogue(mag_limit=8.0), load_catalogue(hip=[POLARIS_HIP])
    site, mount = Site(latitude * DEG, 0.5, 0.0), NAMES[mount](latitude * DEG)
    error, sigma, different, slews = [], [], [], []
    for number, moment in enumerate(moments):
        evening = moment - DAY
        rows = choose_stars(stars, evening, site, n=30, seed=number, duration=1200.0)
        field = places(stars, rows, evening + 40.0 * np.arange(30), site, mount)
        before = None
        for k in range(seeds):
            rng = np.random.default_rng([seed, number, k, n, round(10 * (latitude + 90))])
            truth = PointingModel(dict(zip(mount.names.physical,
                                           60.0 * ARCSEC * rng.normal(size=7))), mount=mount)
            model = fit_terms(run_of(truth, field, stars.hip[rows], (0.0, 0.0),
                                     rng.normal(size=(2, 30)), False)).model
            if before is None:  # the choice rests on the geometry of the night before
                if polaris:
                    chosen, catalogue = np.zeros(n, int), pole
                else:
                    found = zero_stars(stars, moment, n, site=site, mount=mount, model=model,
                                       duration=n * 40.0)
                    chosen, catalogue = np.repeat(found.rows, found.counts), stars
                    different.append(len(found.rows))
                before = places(catalogue, chosen, times_of(moment, chosen), site, mount)
                slews.append(_degrees(before, mount))
            zero = ARCSEC * 30.0 * rng.normal(size=2)
            exposed = run_of(truth, before, catalogue.hip[chosen], zero, noise(rng, n, rho),
                             not polaris)
            got = zero_from_exposures(exposed, model)
            error.append((got.angles - zero) / ARCSEC)
            sigma.append(got.sigma / ARCSEC)
    return Cases(np.array(error), np.array(sigma), different, slews)


def changes(latitude, n, moments, seeds, *, polaris=False, seed=0):
    """Changes from power-on to power-on, ten minutes apart, of nights without a model, `Cases`.

    What is held is what the night reports: the terms by its own 30 stars.
    """
    stars, pole = load_catalogue(mag_limit=8.0), load_catalogue(hip=[POLARIS_HIP])
    site = Site(latitude * DEG, 0.5, 0.0)
    error, sigma, different, slews = [], [], [], []
    for number, moment in enumerate(moments):
        rows = choose_stars(stars, moment, site, n=30, seed=number, duration=1200.0)
        field = places(stars, rows, moment + 40.0 * np.arange(30), site, ALTAZ)
        begin, catalogue, exposed = moment + 1200.0, pole if polaris else stars, []
        for again in (False, True):
            chosen = np.zeros(n, int)
            if not polaris:
                before, prefer = None, ()
                if again:
                    before = Before(*exposed[0][1], np.zeros(n, bool))
                    prefer = np.unique(stars.hip[exposed[0][0]]).tolist()
                found = zero_stars(stars, begin, n, site=site, before=before, prefer=prefer,
                                   exclude=stars.hip[rows].tolist(),
                                   duration=n * 40.0 + 1800.0 * (not again))
                chosen = np.repeat(found.rows, found.counts)
                different.append(len(found.rows))
            exposed.append((chosen, places(catalogue, chosen, times_of(begin, chosen), site,
                                           ALTAZ)))
            slews.append(_degrees(exposed[-1][1], ALTAZ))
            begin += 600.0
        for k in range(seeds):
            rng = np.random.default_rng([seed, number, k, n, round(10 * (latitude + 90)), 1])
            truth = PointingModel(dict(zip(ALTAZ.names.physical,
                                           60.0 * ARCSEC * rng.normal(size=7))))
            model = fit_terms(run_of(truth, field, stars.hip[rows], (0.0, 0.0),
                                     rng.normal(size=(2, 30)), False)).model
            zeros = ARCSEC * 30.0 * rng.normal(size=(2, 2))
            then, now = (run_of(truth, place, catalogue.hip[chosen], zero, rng.normal(size=(2, n)),
                                not polaris) for (chosen, place), zero in zip(exposed, zeros))
            got = zero_from_exposures(now, then, model=model)
            error.append((got.angles - zeros[1] + zeros[0]) / ARCSEC)
            sigma.append(got.sigma / ARCSEC)
    return Cases(np.array(error), np.array(sigma), different, slews)


def _degrees(place, mount):
    """Total motion of the axes, each time the longer one."""
    first, second = mount.on_travel(*place)
    moves = np.abs(np.diff([first, second], axis=1))
    moves[0] = np.abs(wrap(moves[0])) if not mount.two_sided else moves[0]
    return float(moves.max(axis=0).sum() / DEG)


def with_stars(times, seed):
    """Like `zero_drift.sky`, with exposures of the same five stars instead of Polaris."""
    az, el, star = of_polaris(times, seed)
    rng = np.random.default_rng([7, seed[0]])
    pole = slice(zero_drift.STARS, zero_drift.STARS + zero_drift.EXPOSURES)
    group = np.repeat(np.arange(5), [4, 3, 3, 3, 3])
    later = times[pole] - times[pole][0] + 300.0 * seed[1]  # the second night some minutes later
    az[pole] = rng.uniform(0.0, 2.0 * np.pi, 5)[group] + 3.5e-5 * later
    el[pole] = rng.uniform(30.0, 65.0, 5)[group] * DEG + 1.5e-5 * later
    star[pole] = FIRST + group
    return az, el, star


def encoders(nights):
    """The cross-check of the encoders in pairs of nights whose zeros are by the same stars."""
    print(f'\nEncoders by five stars, pairs of nights\n{"":30} {"nights":>6} {"alarms":>7} '
          f'{"against the sky":>16} {"named":>6}')
    faults = zero_drift.faults()
    quiet = faults['no fault'][0]
    for name, count in (('no fault', 3 * nights), ('absolute encoder slips 6"', nights),
                        ('mount leans 8" to the north', nights)):
        scenario, who, axis = faults[name]
        alarms = against = named = 0
        for seed in range(count):
            pair = [zero_drift.Night(quiet, seed, 0), zero_drift.Night(scenario, seed, 1)]
            with patch('zero_drift.sky', with_stars):
                rows = [night.observe() for night in pair]
            rows = [PointingRun({**run.columns, MARK: (run['star'] >= FIRST).astype(float)})
                    for run in rows]
            said = cross_check(rows[1], rows[0], model=fit_terms(rows[0]).model,
                                   homings=pair[1].homings)
            alarms += bool(said.alarms)
            against += any(change.alarm for change in said.shifts)
            named += bool(who) and any(text.startswith(axis) and who in text
                                       for text in said.alarms)
        print(f'{name:30} {count:6d} {alarms:7d} {against:16d} {named if who else "":>6}',
              flush=True)


def line(label, got, peer, target=TARGET):
    """A row of the table."""
    said, rms = got.said / peer.said, got.rms / peer.rms
    stars = f'{np.mean(got.stars):.1f}' if got.stars else '1'
    verdict = '' if target is None else ('ok' if max(said) <= target else 'MISSED')
    print(f'{label:28} {got.said[0]:5.2f} {got.said[1]:5.2f}  {got.rms[0]:5.2f} {got.rms[1]:5.2f}  '
          f'{got.pull[0]:5.2f} {got.pull[1]:5.2f}   {said[0]:5.2f} {said[1]:5.2f}  '
          f'{rms[0]:5.2f} {rms[1]:5.2f}  {stars:>5} {np.mean(got.slews):5.0f} {len(got.error):6d}  '
          f'{verdict}', flush=True)


def head(title):
    """Print the header of a table."""
    print(f'\n{title}\n{"":28} {"sigma":>11}  {"error":>11}  {"error/sigma":>11}   '
          f'{"sigma/peer":>11}  {"error/peer":>11}  stars  slew  cases')


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--dates', type=int, default=2)
    parser.add_argument('--hours', type=int, default=2)
    parser.add_argument('--seeds', type=int, default=25)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--only', nargs='*', choices=PARTS)
    args = parser.parse_args()
    dates, hours, seeds = (4, 3, 100) if args.full else (args.dates, args.hours, args.seeds)
    moments = [START + DAY * 365.25 * d / dates + 3600.0 * 4.0 * h
               for d in range(dates) for h in range(hours)]
    parts = args.only or PARTS

    def of(latitude, n=16, **options):
        return cases(latitude, n, moments, seeds, seed=args.seed, **options)
    print('Zeros of both axes, coordinate angles, arcsec; noise 1" an axis on the sky. '
          f'Target: sigma <= {TARGET} x that of 16 exposures of Polaris at +{PEER}, both axes.')
    if 'encoders' in parts:
        encoders(40 if args.full else 10)
    if parts == ['encoders']:
        return
    peer = of(PEER, polaris=True)
    if 'sixteen' in parts:
        head('Sixteen exposures, alt-azimuth mount, white noise')
        line(f'Polaris, latitude +{PEER}', peer, peer, None)
        for latitude in LATITUDES:
            line(f'stars, latitude {latitude:+d}', of(latitude), peer)
    if 'change' in parts:
        head('Change between two power-ons of a night without a model, sixteen exposures in each')
        alike = changes(PEER, 16, moments, seeds, polaris=True, seed=args.seed)
        line(f'Polaris, latitude +{PEER}', alike, alike, None)
        for latitude in (-80, -20, 40):
            line(f'stars, latitude {latitude:+d}',
                 changes(latitude, 16, moments, seeds, seed=args.seed), alike)
    if 'few' in parts:
        head('Fewer exposures; the peer has sixteen all the same')
        for n in (4, 8):
            line(f'Polaris x {n}, +{PEER}', of(PEER, n, polaris=True), peer, None)
            for latitude in (-80, -20, 40):
                line(f'stars x {n}, latitude {latitude:+d}', of(latitude, n), peer, None)
    if 'coloured' in parts:
        head('Noise that resembles that of the exposure before, AR(1), rho 0.6; the peer alike')
        alike = of(PEER, polaris=True, rho=0.6)
        line(f'Polaris, latitude +{PEER}', alike, alike, None)
        for latitude in (-80, -20, 40):
            line(f'stars, latitude {latitude:+d}', of(latitude, rho=0.6), alike)
    if 'mounts' in parts:
        head('Equatorial mounts; the peer is Polaris of an alt-azimuth mount')
        for mount in ('fork', 'german'):
            for latitude in (-60, -20, 40):
                line(f'{mount}, latitude {latitude:+d}', of(latitude, mount=mount), peer)


if __name__ == '__main__':
    main()
