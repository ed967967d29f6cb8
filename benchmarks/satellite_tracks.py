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

"""Tracks of satellites, simulated from precise orbits: model, clock, time bias, a wrong orbit.

    OMP_NUM_THREADS=1 python benchmarks/satellite_tracks.py [--trials 100] [--part model,bias,...]

Arcs are of LAGEOS-2 (whole passes above 20 degrees; a single pass culminates above 40), Etalon-2
and GPS (30 minutes each, or a whole pass), with a row every 10 s, at 34.3 N 109 E. Noise per axis:
white 1.4", and correlated 1.4" with a correlation time of 300 s. Orbit errors are 20 m RMS along,
across and radially, different in each arc. Integers count trials. A model is good if its error is
at most 1.1 x that without the wrong satellite. The mount has seven terms of 100"; the clock is late
by 10 ms. Stars: 60 above 20 degrees, white 2". z: error over its sigma. The Cramer-Rao bound is for
exactly known noise.
"""

import argparse
from functools import cache
from pathlib import Path

import numpy as np

from calibration.analysis.satellites.track_columns import CLOCK, track_columns
from calibration.analysis.satellites.track_faults import fit_without_faults
from calibration.analysis.satellites.track_fit import fit_tracks
from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun
from pointing_model.runs.satellite_tracks import SatelliteTracks, satellite_tracks
from pointing_model.sky.orbits.orbit_files import Orbits
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.satellite_place import satellite_place
from pointing_model.sky.site import Site

DATA = Path(__file__).resolve().parent.parent.parent / 'shared' / 'data' / 'orbits'
SITE = Site(34.3 * DEG, 109.0 * DEG, 500.0)
STEP, ARC, LOW = 10.0, 1800.0, 20.0 * DEG
WHITE, WALK, MEMORY = 1.4 * ARCSEC, 1.4 * ARCSEC, 300.0
STAR = 2.0 * ARCSEC
ORBIT_ERROR = 20.0  # m
#: satellites of the GPS file that arcs are taken of
_GPS = ('G02', 'G05', 'G07', 'G10', 'G12', 'G13', 'G15', 'G18', 'G23', 'G24', 'G25', 'G29', 'G32')
#: kind of arcs -> file: LAGEOS, Etalon, GPS, and whole passes of GPS (P)
_FILES = {'L': 'ilrsa.orb.lageos2.160319.v35.sp3.gz', 'E': 'asi.orb.etalon2.171209.v70.sp3',
          'G': 'ESA0OPSRAP_20232390000_01D_15M_ORB.SP3.gz',
          'P': 'ESA0OPSRAP_20232390000_01D_15M_ORB.SP3.gz'}
_PRECISE = 0.05  # m


@cache
def pool(kind, step=STEP):
    """Arcs of a kind (L, E, G, P): a list of `SatelliteTracks` with one arc each."""
    orbits, arcs = Orbits([DATA / _FILES[kind]]), []
    for name in _GPS if kind in 'GP' else (None,):
        orbit = orbits.orbit(name)
        time = np.arange(np.ceil(orbit.begin) + 60.0, orbit.end - 60.0, step)
        up = satellite_place(orbit, time, SITE)[1] > LOW
        for rows in np.split(np.arange(len(time)), np.flatnonzero(np.diff(up)) + 1):
            if not up[rows[0]] or len(rows) * step < ARC:
                continue
            size = int(ARC / step) if kind in 'EG' else len(rows)
            for first in range(0, len(rows) - size + 1, size):
                when = time[rows[first:first + size]]
                zero = np.zeros(len(when))
                arcs.append(satellite_tracks(
                    {'time': when, 'az_enc': zero, 'el_enc': zero}, [orbit.name] * len(when),
                    {orbit.name: orbit}, SITE, DEFAULT_WEATHER))
    return arcs


def joined(arcs, orbit_sigma=ORBIT_ERROR):
    """Several arcs as one `SatelliteTracks`, of orbits with a sigma (m)."""
    objects = tuple(sorted({arc.objects[0] for arc in arcs}))
    move = {name: np.concatenate([getattr(arc, name) for arc in arcs], axis=1)
            for name in ('clock', 'ahead', 'across', 'out')}
    common = {name: np.concatenate([arc.common[name] for arc in arcs], axis=1)
              for name in arcs[0].common}
    run = PointingRun({name: np.concatenate([arc.run[name] for arc in arcs])
                       for name in arcs[0].run.columns}, arcs[0].run.meta)
    sizes = [len(arc) for arc in arcs]
    return SatelliteTracks(
        run, objects, np.repeat([objects.index(arc.objects[0]) for arc in arcs], sizes),
        np.repeat(np.arange(len(arcs)), sizes), **move,
        speed=np.concatenate([arc.speed for arc in arcs]),
        orbit_sigma=np.full(sum(sizes), orbit_sigma), common=common)


def stars(rng, n=60):
    """Stars all over the sky as tracks of one arc."""
    el = np.arcsin(rng.uniform(np.sin(LOW), np.sin(85.0 * DEG), n))
    az, time = rng.uniform(0.0, 2.0 * np.pi, n), 1.5e9 + 60.0 * np.arange(n)
    return satellite_tracks({'time': time, 'az': az, 'el': el, 'az_enc': az, 'el_enc': el},
                            [''] * n, {}, SITE, DEFAULT_WEATHER)


def memory_noise(rng, time):
    """White plus correlated noise of an axis, rad, at evenly spaced times, s."""
    keep = np.exp(-(time[1] - time[0]) / MEMORY)
    steps = rng.normal(size=len(time)) * WALK * np.sqrt(1.0 - keep**2)
    walk = np.empty(len(time))
    walk[0] = rng.normal() * WALK
    for i in range(1, len(time)):
        walk[i] = keep * walk[i - 1] + steps[i]
    return walk + WHITE * rng.normal(size=len(time))


def measured(rng, tracks, truth, clock=0.01, ahead=None, orbits=True, remembers=True):
    """The tracks with simulated encoder readings.

    Parameters
    ----------
    truth : PointingModel
    clock : float
        s, the stamps are late.
    ahead : dict of str to (callable or float), optional
        Of a satellite, s as a function of time.
    orbits : bool
        Whether orbits are off.
    remembers : bool
        Whether the noise of satellites does; else it is that of stars.
    """
    run, n = tracks.run, len(tracks)
    x, y = np.zeros((2, n)) - clock * tracks.clock
    for arc in np.unique(tracks.arc):
        rows = np.flatnonzero(tracks.arc == arc)
        name = tracks.objects[tracks.object[rows[0]]]
        if name == '' or not remembers:
            noise = STAR * rng.normal(size=(2, len(rows)))
        else:
            noise = np.stack([memory_noise(rng, run['time'][rows]) for _ in range(2)])
        if orbits and name != '':
            along, across, out = ORBIT_ERROR * rng.normal(size=3)
            noise += (along / tracks.speed[rows] * tracks.ahead[:, rows]
                      + across * tracks.across[:, rows] + out * tracks.out[:, rows])
        late = (ahead or {}).get(name, 0.0)
        noise += (late(run['time'][rows]) if callable(late) else late) * tracks.ahead[:, rows]
        x[rows] += noise[0]
        y[rows] += noise[1]
    az, el = truth.sky_to_encoder(run['az'], run['el'])
    columns = {**run.columns, 'az_enc': az + x / np.cos(run['el']), 'el_enc': el + y}
    out = tracks.select(slice(None))
    out.run = PointingRun(columns, run.meta)
    return out


def mount(rng):
    """A mount of seven terms."""
    return PointingModel(dict(zip(PHYSICAL, 100.0 * ARCSEC * rng.normal(size=7))))


def fresh_error(rng, model, truth):
    """Radial RMS of a model at places without noise all over the sky, rad."""
    el = np.arcsin(rng.uniform(np.sin(LOW), np.sin(80.0 * DEG), 400))
    az = rng.uniform(0.0, 2.0 * np.pi, 400)
    off = np.array(model.offsets(az, el)) - truth.offsets(az, el)
    return float(np.sqrt(np.mean(np.sum(off**2, axis=0))))


def pick(rng, kind, count, step=STEP):
    """Arcs of a kind; H: passes of LAGEOS that culminate above 40 degrees."""
    arcs = pool('L' if kind == 'H' else kind, step)
    if kind == 'H':
        arcs = [arc for arc in arcs if arc.run['el'].max() > 40.0 * DEG]
    return [arcs[i] for i in rng.choice(len(arcs), count, replace=False)]


def star_model(rng, truth):
    """`fit_terms` of 60 stars."""
    run = measured(rng, stars(rng), truth, 0.0).run
    return fit_terms(run).model


def part_model(trials):
    """Model from satellites alone against that of 60 stars."""
    ratio, z, clocks, few = [], [], [], 0
    for trial in range(trials):
        rng = np.random.default_rng(trial)
        truth = mount(rng)
        tracks = measured(rng, joined(pick(rng, 'L', 6) + pick(rng, 'E', 3) + pick(rng, 'G', 11)),
                          truth)
        fit = fit_tracks(tracks)
        by_stars = star_model(rng, truth)
        ratio.append(fresh_error(rng, fit.model, truth) / fresh_error(rng, by_stars, truth))
        z.append([(fit[name][0] - truth.terms[name]) / fit[name][1] for name in PHYSICAL])
        clocks.append((fit['clock'][0] - 0.01) / fit['clock'][1])
        alone = fit_tracks(measured(rng, joined(pick(rng, 'E', 4)), truth))
        few += not alone.determines
    low, middle, high = np.quantile(ratio, (0.25, 0.5, 0.75))
    yield ('model from satellites over that from 60 stars, median (quartiles)',
           f'{middle:.2f} ({low:.2f}, {high:.2f})', '0.9')
    yield 'z of its terms; its clock', '; '.join(
        f'{np.sqrt(np.mean(np.square(one))):.2f}' for one in (z, clocks)), '0.8…1.25'
    yield 'four Etalon arcs do not determine the terms', f'{few}', 'most'


def part_bias(trials):
    """A time bias of 20 ms and a zero off by 10"; the same with all free, and 5 ms on GPS."""
    bias, within, z, free, gps = [], 0, [], 0, 0
    for trial in range(trials):
        rng = np.random.default_rng(1000 + trial)
        truth = mount(rng)
        known = star_model(rng, truth)
        off = dict(truth.terms, IA=truth.terms['IA'] + 10.0 * ARCSEC)
        moved = PointingModel(off)
        one = joined(pick(rng, 'H', 1), _PRECISE)
        name = one.objects[0]
        rows = measured(rng, one, moved, 0.0, {name: 0.02}, orbits=False)
        options = {'clock_sigma': 0.0, 'bias_free': (name,)}
        fit = fit_tracks(rows, held=known, **options)
        value, sigma = fit[f'ahead {name}']
        both = [(value - 0.02) / sigma, (fit['IA'][0] - off['IA']) / fit['IA'][1]]
        bias.append(sigma)
        z.append(both)
        within += np.all(np.abs(both) < 2.5) and fit.separated(f'ahead {name}')
        free += not fit_tracks(rows, **options).separated(f'ahead {name}')
        one = joined(pick(rng, 'P', 1), _PRECISE)
        name = one.objects[0]
        rows = measured(rng, one, moved, 0.0, {name: 0.005}, orbits=False)
        fit = fit_tracks(rows, held=known, clock_sigma=0.0, bias_free=(name,))
        gps += not fit.separated(f'ahead {name}')
    yield ('20 ms, one LAGEOS pass: σ; both within 2.5 σ; z',
           f'{1e3 * np.median(bias):.1f} ms; {within}; '
           + ', '.join(f'{v:.2f}' for v in np.sqrt(np.mean(np.square(z), axis=0))), '6 ms; 93')
    yield 'not separable: all free; 5 ms of GPS', f'{free}; {gps}', 'most'


def clock_bound(tracks, remembers):
    """Cramer-Rao bound of the clock's sigma, s: the exact covariance of all noise is known."""
    columns, time = track_columns(tracks, PHYSICAL), np.asarray(tracks.run['time'], float)
    information = columns.precision()
    for arc in np.unique(tracks.arc):
        rows = np.flatnonzero(tracks.arc == arc)
        lag = np.abs(np.subtract.outer(time[rows], time[rows]))
        star = tracks.objects[tracks.object[rows[0]]] == '' or not remembers
        covariance = (STAR**2 * np.eye(len(rows)) if star else
                      WHITE**2 * np.eye(len(rows)) + WALK**2 * np.exp(-lag / MEMORY))
        root = np.linalg.cholesky(covariance)
        for axis in columns.columns.reshape(len(columns.names), 2, -1).swapaxes(0, 1):
            white = np.linalg.solve(root, axis[:, rows].T)
            information = information + white.T @ white
    at = columns.place(CLOCK)
    return float(np.sqrt(np.linalg.inv(information)[at, at]))


def part_clock(trials):
    """60 stars and one pass, with correlated noise or that of stars."""
    for kind, step, remembers in (('H', STEP, True), ('H', 2.0, True), ('H', STEP, False),
                                  ('P', STEP, True), ('P', STEP, False)):
        found = []
        for trial in range(trials):
            rng = np.random.default_rng(2000 + trial)
            truth = mount(rng)
            tracks = measured(rng, joined([stars(rng), *pick(rng, kind, 1, step)], _PRECISE),
                              truth, orbits=False, remembers=remembers)
            value, sigma = fit_tracks(tracks)[CLOCK]
            found.append((1e3 * sigma, (value - 0.01) / sigma,
                          1e3 * clock_bound(tracks, remembers),
                          tracks.run['el'][tracks.speed > 0.0].max()))
        sigma, z, bound, top = np.array(found).T
        high = top > 70.0 * DEG
        yield (f'clock, {"LAGEOS" if kind == "H" else "GPS"} each {step:g} s, '
               f'{"memory" if remembers else "white"}: σ; z (bound; above 70°)',
               f'{np.median(sigma):.1f} ms; {np.sqrt(np.mean(z**2)):.2f} ({np.median(bound):.1f}; '
               f'{np.median(sigma[high]):.1f})', f'{4 if kind == "H" else 15} ms')


def _four(rng, arcs):
    """Arcs of four satellites: LAGEOS, Etalon, two of GPS."""
    out = pick(rng, 'L', arcs) + pick(rng, 'E', arcs)
    names = rng.permutation(_GPS)
    taken = 0
    for name in names:
        own = [arc for arc in pool('G') if arc.objects == (name,)]
        if len(own) >= arcs and taken < 2:
            taken += 1
            out += [own[i] for i in rng.choice(len(own), arcs, replace=False)]
    # passes of LAGEOS are arcs of 30 min here too
    size = int(ARC / STEP)
    return [arc.select(slice(0, size)) if len(arc) > size else arc for arc in out]


def part_fault(trials):
    """One of four satellites 20" RMS off along its track."""
    for arcs in (3, 1):
        for kind in ('constant', 'varying', 'none'):
            right = wrong = good = 0
            for trial in range(trials):
                rng = np.random.default_rng(3000 + trial)
                truth = mount(rng)
                tracks = joined(_four(rng, arcs))
                bad = str(rng.choice(tracks.objects))
                rows = tracks.object == tracks.objects.index(bad)
                scale = 20.0 * ARCSEC / np.sqrt(np.mean(np.sum(tracks.ahead[:, rows]**2, axis=0)))
                phase = rng.uniform(0.0, 2.0 * np.pi)
                sign = rng.choice([-1.0, 1.0])
                ahead = {'constant': sign * scale, 'none': 0.0,
                         'varying': lambda t, s=scale, p=phase: s * np.sqrt(2.0) * np.sin(
                             2.0 * np.pi * t / 7200.0 + p)}[kind]
                tracks = measured(rng, tracks, truth, ahead={bad: ahead})
                fit = fit_without_faults(tracks)
                named = fit.left_out
                right += kind != 'none' and named == (bad,)
                wrong += bool(named) and (kind == 'none' or named != (bad,))
                clean = fit_tracks(tracks.select(~rows)) if kind != 'none' else fit_tracks(tracks)
                error, least = (fresh_error(np.random.default_rng(trial), one.model, truth)
                                for one in (fit, clean))
                good += error <= 1.1 * least
            what = {'constant': '20″ off', 'varying': '20″ varying', 'none': 'none off'}[kind]
            named = {'constant': '90', 'varying': '95'}.get(kind, '–') if arcs == 3 else '–'
            yield (f'{what}, {arcs} arc{"s" * (arcs > 1)}: named; another; model good',
                   f'{right}; {wrong}; {good}',
                   f'{named}; {2 if arcs == 3 and kind != "none" else 5}; 90')


PARTS = {'model': part_model, 'bias': part_bias, 'clock': part_clock, 'fault': part_fault}


def main():
    """Print a Markdown table: what, figure, wanted."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--trials', type=int, default=100)
    parser.add_argument('--part', default=','.join(PARTS))
    args = parser.parse_args()
    print('| what | figure | wanted |\n| --- | --- | --- |', flush=True)
    for name in args.part.split(','):
        for row in PARTS[name](args.trials):
            print('| ' + ' | '.join(row) + ' |', flush=True)


if __name__ == '__main__':
    main()
