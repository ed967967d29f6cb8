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

"""Adaptive model: choice of stars, start of a night, smoothing, rates from earlier nights.

    python benchmarks/tracking_stars.py [--nights N] [--only PART] [--full] [--data FOLDER]

Parts: ``hold`` (pointing kept below 1.5" radial; chosen stars compared with stars in raster order),
``begin`` (changes since the last run, from five stars), ``hindsight``, ``rates`` (learned from
earlier nights), ``walks`` and ``real`` (measured telescopes), ``arc`` (five stars of real runs with
those before, FOLDER/arc35m).

Slews: both axes together at 2 deg/s, 1 deg/s^2, 3 s to settle, 10 s for exposure and readout; from
a target to the star and to the next target; targets anywhere, a new one every 20 minutes. `--full`:
60 nights of ``hold``, 400 beginnings of each kind, 100 nights of the others.
"""

import argparse
from collections import Counter
from pathlib import Path

import numpy as np
from tracking_nights import BASE, NAMES, K, Night, Truth, columns, radial, sky

from calibration.analysis.term_fit import fit_terms
from calibration.analysis.tracking.history import (
    Past,
    past_of_runs,
    rates_of_nights,
    rows_of,
    tracked,
)
from calibration.analysis.tracking.innovations import Measurement
from calibration.analysis.tracking.motion_causes import TrackingSettings
from calibration.analysis.tracking.smoother import smooth
from calibration.analysis.tracking.tracker import Tracker
from calibration.analysis.tracking.warm_start import (
    AS_IT_WAS,
    HYPOTHESES,
    LEAN,
    REFIT,
    STARS,
    ZEROS,
    begin,
)
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ
from pointing_model.pointing_terms import design, terms_of
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run
from telescope_mount.observing.tracking_star import SlewTime, next_star, until

GOAL, EXPOSURE = 1.5 * ARCSEC, 10.0
STEP = 10.0  # s, of the true path
PLACES = sky(np.random.default_rng(11), 80)


def choose(covariance, columns, everywhere, count, noise):
    """Stars chosen one after the other for the most information on pointing over the sky.

    Parameters
    ----------
    covariance : ndarray, shape (k, k)
        Of the terms before any star, rad^2.
    columns : ndarray, shape (n, 2, k)
        Of stars that could be taken.
    everywhere : ndarray, shape (p, 2, k)
        Of places where the mount shall point.
    count : int
    noise : float
        1 sigma of a star, rad.

    Returns
    -------
    list of int
        Rows of `columns`, in order. What the stars will show is not asked.
    """
    weight = np.einsum('pij,pik->jk', everywhere, everywhere)
    chosen = []
    for _ in range(min(count, len(columns))):
        gains = covariance @ columns.swapaxes(1, 2)  # (n, k, 2)
        inverse = np.linalg.inv(columns @ gains + noise**2 * np.eye(2))
        gain = np.einsum('aki,aij,alj,kl->a', gains, inverse, gains, weight)
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        covariance = covariance - gains[best] @ inverse[best] @ gains[best].T
    return chosen


def prediction_errors(runs, names, everywhere, *, memory=np.inf, first=4):
    """How well a few chosen stars of each run and the runs before it predict the rest of it.

    Parameters
    ----------
    runs : sequence of PointingRun
    names : sequence of str
        Terms.
    everywhere : ndarray, shape (p, 2, k)
        As of `choose`.
    memory : float
        As of `past_of_runs`.
    first : int
        Runs that are only past.

    Returns
    -------
    list of (ndarray, shape (n, 2))
        What is left of each run from `first` on, rad; NaN in the rows that were chosen.
    """
    rows = [rows_of(run, names) for run in runs]
    out = []
    for place in range(first, len(rows)):
        columns, offsets = rows[place]
        past = past_of_runs(rows[:place], names, memory=memory)
        chosen = choose(past.covariance, columns, everywhere, STARS, past.noise)
        found = begin(past, columns[chosen], offsets[chosen], mount=runs[place].mount)
        left = offsets - columns @ np.array(list(found.terms.values()))
        left[chosen] = np.nan
        out.append(left)
    return out


def menus():
    """Sets of terms of an alt-azimuth mount to choose from by `prediction_errors`."""
    names, known = ALTAZ.names, tuple(terms_of(ALTAZ))
    rest = tuple(name for name in known if name not in names.physical)
    return {'six': names.standard6, 'physical': names.physical,
            'encoders': (*names.physical, *(name for name in (
                'TX', 'ACEC', 'ACES', 'HACA2', 'HASA2') if name in rest)),
            'all': (*names.physical, *(name for name in rest if name != 'TX3'))}


def raster():
    """Places in rows of elevation, there and back in azimuth."""
    out = []
    for row, el in enumerate((25.0, 40.0, 55.0, 70.0)):
        turn = np.arange(0.0, 360.0, 45.0)
        out += [(az * DEG, el * DEG) for az in (turn if row % 2 == 0 else turn[::-1])]
    return out


def hold(seed, chosen, weights=None, hours=8.0, noise=ARCSEC):
    """One night: true radial RMS (rad), telescope time (s) and stars that it took."""
    rng = np.random.default_rng(seed)
    truth = Truth(2.0 * ARCSEC, 0.5 * ARCSEC, hours=hours)
    night = Night(truth, rng)
    steps = int(3600.0 * hours / STEP)
    path = np.cumsum(rng.normal(size=(steps, K)) * truth.walk * np.sqrt(STEP / 3600.0), axis=0)
    targets = np.stack(sky(rng, int(3 * hours) + 1), axis=1)
    candidates, slew = sky(np.random.default_rng(seed + 9), 300), SlewTime()
    allowed = candidates[1] < 80 * DEG
    tracker, in_force = Tracker(night.model(), 0, rate_weights=weights), np.full(
        (steps, K), np.nan)
    rows, number, now, spent, stars = raster(), seed % 32, 0.0, 0.0, 0
    place, back = None, 0.0

    def terms():
        return np.array([tracker.terms()[0][name] for name in NAMES]) - BASE

    while True:
        left = until(tracker, PLACES, GOAL)
        start = max(now, tracker.stamp / 1e9 + left - 40.0)
        in_force[int(now / STEP):] = terms()  # until there are others
        if start >= 3600.0 * hours - 60.0:
            break
        target = targets[int(start / 1200.0)]
        at_star = start == now and stars and left == 0.0
        here = place if at_star else target
        if at_star:
            spent -= back  # it goes on from there
        if chosen:
            row = next_star(tracker, *candidates, here, PLACES, sigma=noise, allowed=allowed,
                            exposure_s=EXPOSURE).row
            place = candidates[0][row], candidates[1][row]
        else:
            place = rows[number % len(rows)]
            number += 1
        there = float(slew.seconds(ALTAZ, here, ([place[0]], [place[1]]))[0])
        back = float(slew.seconds(ALTAZ, place, ([target[0]], [target[1]]))[0])
        spent += there + EXPOSURE + back
        seen = start + there + EXPOSURE / 2.0
        if seen >= 3600.0 * hours:
            break
        model = PointingModel(dict(zip(NAMES, BASE + path[int(seen / STEP)])))
        x, y = np.array(model.offsets(*place)) + rng.normal(size=2) * noise
        tracker.star(int(seen * 1e9), *place, x, y, noise)
        stars += 1
        now = seen + EXPOSURE / 2.0
    squares = [radial(mine - true)[1] for mine, true in zip(in_force, path)]
    return np.sqrt(np.mean(squares)), spent, stars


def say_hold(count):
    """Stars chosen against stars in raster order."""
    learned = rates_of_nights([as_run(Night(Truth(2 * ARCSEC, 0.5 * ARCSEC),
                                            np.random.default_rng(900 + i))) for i in range(10)])
    for words, weights in (('rates unknown', None), ('rates of ten nights', learned.weights)):
        got = {way: np.array([hold(seed, way, weights) for seed in range(count)])
               for way in (True, False)}
        (good, time, stars), (other, slow, more) = (got[way].mean(axis=0) for way in
                                                    (True, False))
        over = [(got[way][:, 0] > GOAL).sum() for way in (True, False)]
        print(f'\nzeros 2", tilt 0.5"/h^.5, {count} nights, {words}: true radial RMS '
              f'{good / ARCSEC:.2f}", raster {other / ARCSEC:.2f}" (held: 1.5); nights above 1.5" '
              f'{over[0]}, {over[1]}; worst {got[True][:, 0].max() / ARCSEC:.2f}", '
              f'{got[False][:, 0].max() / ARCSEC:.2f}"\n  telescope time {time / 60:.1f} min a '
              f'night for {stars:.0f} stars, raster {slow / 60:.1f} min for {more:.0f}: '
              f'{100 * time / slow:.0f} % (<= 75)')


def say_begin(count):
    """Detection of changes since the last run from five chosen stars."""
    rng = np.random.default_rng(31)
    scatter = np.array([30.0, 30.0, 4.0, 3.0, 8.0, 8.0, 4.0, 2.0]) * ARCSEC
    everywhere, pool = columns(*sky(rng, 80)), columns(*sky(rng, 300))
    table = {}
    for story in HYPOTHESES:
        for _ in range(count):
            last = rng.normal(size=K) * scatter
            h = columns(*sky(rng, 40)).reshape(-1, K)
            covariance = np.linalg.inv(h.T @ h) * ARCSEC**2
            past = Past(NAMES, np.zeros(K), np.diag(scatter**2), ARCSEC,
                        rng.multivariate_normal(last, covariance), covariance)
            true = last + rng.normal(size=K) * 0.2 * ARCSEC
            if story in (ZEROS, LEAN):
                true[:2] += rng.normal(size=2) * 30 * ARCSEC
            if story == LEAN:
                true[4:6] += rng.normal(size=2) * 8 * ARCSEC
            if story == REFIT:
                true = rng.normal(size=K) * scatter
            chosen = pool[choose(past.covariance, pool, everywhere, 5, ARCSEC)]
            off = chosen @ true + rng.normal(size=(5, 2)) * ARCSEC
            found = begin(past, chosen, off)
            error = np.sqrt(np.mean(np.sum((everywhere @ (
                np.array(list(found.terms.values())) - true)) ** 2, axis=1)))
            flat, rows = chosen.reshape(-1, K), off.reshape(-1)
            fresh = np.linalg.lstsq(flat[:, [0, 1, 2, 4, 5, 6]], rows, rcond=None)[0]
            plain = np.zeros(K)
            plain[[0, 1, 2, 4, 5, 6]] = fresh
            bare = np.sqrt(np.mean(np.sum((everywhere @ (plain - true)) ** 2, axis=1)))
            table.setdefault(story, []).append((found.likeliest, error, bare))
    print(f'\nfive chosen stars, noise 1", {count} of each: taken for '
          + ', '.join(f'"{s}"' for s in HYPOTHESES) + '; radial error over the sky, of a fresh fit')
    for story, rows in table.items():
        counts = Counter(name for name, _, _ in rows)
        print(f'  {story:22} ' + ' '.join(f'{100 * counts[s] / count:5.1f} %' for s in HYPOTHESES)
              + '   {:.2f}"  {:.2f}"'.format(*(np.sqrt(np.mean(np.square(
                  [r[i] for r in rows]))) / ARCSEC for i in (1, 2))))
    assert AS_IT_WAS in table


def as_run(night):
    """Model of the evening and the stars as a `PointingRun`."""
    x, y = night.offsets.T
    noise = np.full(night.count, night.truth.noise)
    return night.model(), PointingRun({
        'time': night.hours * 3600.0, 'az': night.az, 'el': night.el,
        'az_enc': night.az + x / np.cos(night.el), 'el_enc': night.el + y,
        'sigma_x': noise, 'sigma_y': noise})


def seen_of(night):
    """The stars of a night as they stand in a log."""
    return [Measurement('star', int(stamp), (a, e, *off, night.truth.noise))
            for stamp, a, e, off in zip(night.stamps, night.az, night.el, night.offsets)]


def say_hindsight(count):
    """The smoother against the filter, at the stars."""
    for rate in (10, 5, 2):
        rng, rows = np.random.default_rng(50 + rate), []
        for i in range(count):
            night = Night(Truth(rate * ARCSEC, wrong=0.02, jump=(
                rng.uniform(1, 7) if i % 3 == 0 else None)), rng)
            seen, tracker, live = seen_of(night), Tracker(night.model(), 0), []
            back = smooth(tracker, seen)
            for one in seen:
                tracker.update(one)
                live.append(list(tracker.terms()[0].values()))
            true = BASE + night.path[:, -1]
            rows.append((np.mean([radial(t)[0] for t in back.terms - true]),
                         np.mean([radial(t)[0] for t in np.array(live) - true]),
                         ((back.terms - true) / back.sigma)[:, :2] ** 2))
        smoothed, live = (np.mean([row[i] for row in rows]) for i in range(2))
        size = np.median([row[2] for row in rows])
        print(f'\nin hindsight, {rate}"/h^.5, {count} nights: mean radial error at the stars '
              f'{smoothed / ARCSEC:.2f}", live {live / ARCSEC:.2f}"; median of zeros '
              f'in sigmas, squared, {size:.2f} (0.45)')


def say_rates(count):
    """Nights with rates that were learned from others."""
    for rate in (10, 5, 2):
        rng = np.random.default_rng(600 + rate)
        past = [as_run(Night(Truth(rate * ARCSEC), rng)) for _ in range(10)]
        rates = rates_of_nights(past)
        nis, expected, square, hours = [], [], [], []
        for _ in range(count):
            night = Night(Truth(rate * ARCSEC), rng)
            tracker, terms = Tracker(night.model(), 0, rate_weights=rates.weights), []
            for k, one in enumerate(seen_of(night)):
                terms.append(np.array(list(tracker.terms()[0].values())) - BASE)
                expected.append(np.mean([np.mean(tracker.expected(*PLACES, s).radial ** 2)
                                         for s in (150.0, 300.0, 450.0, 600.0)]))
                nis.append(tracker.update(one).nis / 2.0)
                hours.append(k // (night.count // 3))
            square.append(night.errors(np.array(terms))[1])
        nis, expected, square, hours = map(np.ravel, (nis, expected, square, hours))
        likeliest = rates.facts[np.argmax(rates.weights)]
        print(f'\n{rate}"/h^.5, rates of 10 nights (likeliest {likeliest["zero"] / ARCSEC:.1f}, '
              f'tilt {likeliest["tilt"] / ARCSEC:.1f}), {count} others: NIS {nis.mean():.3f}, '
              'thirds of time ' + ' '.join(f'{nis[hours == t].mean():.2f}' for t in range(3))
              + '; expected^2 / true^2 ' + ' '.join(
                  f'{expected[hours == t].mean() / square[hours == t].mean():.2f}'
                  for t in range(3)))


def say_walks(folder):
    """Drift rates of the zeros of measured telescopes: source of the default rates."""
    for path, hours in (('iram30m/pointing-2012-04B.log', 3.0),
                        ('iram30m/pointing-2014-04.log', 3.0), ('mmt/point_20210821.dat', 9.0)):
        if not Path(folder, path).is_file():
            print(f'\nwalks: skipped, no {folder}/{path}')
            continue
        run = read_run(Path(folder, path))
        run = run.select(np.argsort(run['time'], kind='stable'))
        fit = fit_terms(run, ALTAZ.names.physical)
        run = run.select(fit.weights > 0.0).split_sessions(hours)
        covariance = fit.model.covariance.copy()  # terms of all, zeros of each session
        covariance[[0, 1], [0, 1]] += (20.0 * ARCSEC) ** 2
        model = PointingModel(fit.model.terms, covariance)
        nights = [(model, run.select(run['run'] == number)) for number in np.unique(run['run'])]
        nights = [night for night in nights if len(night[1]) >= 6]
        settings = TrackingSettings(turn_h=1e9)
        seen = {noise: [tracked(*night, settings=settings, noise=noise * ARCSEC)
                        for night in nights] for noise in (0.7, 1.0, 1.5, 2.0, 2.5, 3.0)}
        noise = max(seen, key=lambda n: sum(one.filter.evidence for one in seen[n]))
        zeros = [one.facts[np.argmax(one.rate_weights)]['zero'] / ARCSEC for one in seen[noise]]
        print(f'\n{path}: {len(nights)} sessions, {sum(len(n[1]) for n in nights)} rows; '
              f'likeliest noise {noise}", walk of the zeros "/h^.5 '
              + ' '.join(f'{z:.1f}' for z in sorted(zeros)))


def say_real(folder):
    """Each star of measured sessions, predicted from those before it in its session.

    The model is fitted to the other sessions of the log, its zeros are unknown by 20 arcsec.
    """
    for path, noise in (('iram30m/pointing-2012-04B.log', 2.0),
                        ('iram30m/pointing-2014-04.log', 1.5)):
        if not Path(folder, path).is_file():
            print(f'\nreal: skipped, no {folder}/{path}')
            continue
        run = read_run(Path(folder, path))
        run = run.select(np.argsort(run['time'], kind='stable')).split_sessions(3.0)
        names, errors, nis = ALTAZ.names.physical, [], []
        for number in np.unique(run['run']):
            here = run.select(run['run'] == number)
            if len(here) < 8:
                continue
            fit = fit_terms(run.select(run['run'] != number), names)
            covariance = fit.model.covariance.copy()
            covariance[[0, 1], [0, 1]] += (20.0 * ARCSEC) ** 2
            model = PointingModel(fit.model.terms, covariance)
            tracker = Tracker(model, int(here['time'][0] * 1e9) - 1)
            h = np.stack(design(names, here['az'], here['el']), axis=1)
            off = np.stack(here.offsets(), axis=1)
            plain = off - np.stack(model.offsets(here['az'], here['el']), axis=1)
            for k in range(len(here)):
                heard = tracker.star(int(here['time'][k] * 1e9), here['az'][k], here['el'][k],
                                     *off[k], noise * ARCSEC)
                if k < 4 or not heard.taken:
                    continue
                zeros = [np.linalg.lstsq(h[rows][:, :, :2].reshape(-1, 2), plain[rows].ravel(),
                                         rcond=None)[0]
                         for rows in (slice(0, 3), slice(0, k), slice(k - 1, k))]
                errors.append([heard.innovation,
                               *(plain[k] - h[k][:, :2] @ zero for zero in zeros)])
                nis.append(heard.nis / 2.0)
        size = np.median(np.hypot(*np.array(errors).T), axis=1) / ARCSEC
        print(f'\n{path}, {len(errors)} stars from the fifth of their session: median radial error '
              'predicted by the filter {:.2f}", zeros of the first three {:.2f}", of all so far '
              '{:.2f}", of the last {:.2f}"; '.format(*size)
              + f'NIS {np.mean(nis):.2f}, median {np.median(nis):.2f} (0.69)')


def say_arc(folder):
    """Five stars of each run and the runs before, against six terms fitted to all of its rows."""
    files = sorted(Path(folder, 'arc35m').glob('*.dat'))
    if not files:
        print(f'\narc: skipped, no {folder}/arc35m')
        return
    runs = []
    for path in files:
        try:
            runs.append(read_run(path))
        except ValueError:
            continue
    runs = [run for run in runs if len(run) >= 8]
    rng, first, from_run = np.random.default_rng(1), 4, 8
    az, el = sky(rng, 200)
    left, size = {}, {}
    for name, names in menus().items():
        everywhere = np.stack(design(names, az, el), axis=1)
        for memory in (np.inf, 10.0):
            left[name, memory] = prediction_errors(
                runs, names, everywhere, memory=memory, first=first)
            size[name, memory] = np.array([np.log(np.sqrt(np.nanmean(off**2)))
                                           for off in left[name, memory]])
    ratios, which = [], Counter()
    for place in range(from_run - first, len(runs) - first):
        best = min(left, key=lambda key: size[key][:place].mean())  # of the runs before alone
        which[best] += 1
        off, run = left[best][place], runs[place + first]
        full = fit_terms(run, ALTAZ.names.standard6)
        rest = np.isfinite(off[:, 0])
        six = np.stack((full.residual_x, full.residual_y), axis=1)[rest]
        ratios.append(np.sqrt(np.mean(off[rest] ** 2) / np.mean(six**2)))
    print(f'\nARC 3.5 m, {len(runs)} runs, judged from run {from_run + 1}: {len(ratios)}; RMS of '
          f'the rows left with five chosen stars and the runs before, against six terms fitted to '
          f'all rows: median {np.median(ratios):.3f} (<= 1.12), 90 % '
          f'{np.quantile(ratios, 0.9):.3f} (<= 1.40), worst {max(ratios):.2f}')
    print('  terms and memory taken, by the runs before: ' + ', '.join(
        f'{name}/{memory:g} {number}' for (name, memory), number in which.most_common()))
    for key in left:
        own = [np.sqrt(np.nanmean(off**2)) / ARCSEC for off in left[key][from_run - first:]]
        print(f'  {key[0]:9} memory {key[1]:4g}: median {np.median(own):.2f}" an axis')


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--nights', type=int, default=6)
    parser.add_argument('--only', choices=('hold', 'begin', 'hindsight', 'rates', 'walks', 'real',
                                           'arc'))
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--data', default='../shared/data')
    options = parser.parse_args()
    count = options.nights
    parts = {'hold': lambda: say_hold(60 if options.full else count),
             'begin': lambda: say_begin(400 if options.full else 10 * count),
             'hindsight': lambda: say_hindsight(100 if options.full else count),
             'rates': lambda: say_rates(100 if options.full else count),
             'walks': lambda: say_walks(options.data),
             'real': lambda: say_real(options.data),
             'arc': lambda: say_arc(options.data)}
    for name, part in parts.items():
        if options.only in (None, name):
            part()


if __name__ == '__main__':
    main()
