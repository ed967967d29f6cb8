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

"""Causes of changes over a season: detection rates and false detections.

    python benchmarks/season.py [--full] [--arc FOLDER]

Seasons of 30 nights with terms that drift and scatter by random sigmas, and an annual temperature
cycle: without any cause; with heavy-tailed scatter; with a term that depends on temperature; with
an undeclared step; with four steps of one term, of either sign, that a random walk could absorb.
Then, for measured runs, each night's terms are predicted from the nights before it, and compared
with using those of the last night and the mean of the earlier nights.
"""

import argparse
import time

import numpy as np
from scipy.stats import chi2

from calibration.analysis.season.season_causes import candidates, choose_causes
from calibration.analysis.season.season_kalman import (
    NightlyTerms,
    fit_variation,
    forecast,
    season_path,
)
from calibration.analysis.season.season_nights import Nights, SeasonNight, days, nights_of
from msg_tools.units import ARCSEC
from pointing_model.mounts import ALTAZ
from pointing_model.pointing_terms import design
from pointing_model.runs.run_reader import read_run

NAMES = ('IA', 'IE', 'CA', 'AN', 'AW', 'TF')
STATES = ('nothing', 'long tails', 'temperature', 'a step', 'four steps')


def season(rng, what, count=30):
    """A `Nights` of drifting terms; the term that is changed, and from which nights."""
    k = len(NAMES)
    day = np.sort(rng.uniform(0.0, 700.0, count))
    walk = rng.choice([0.0, 1.0], k) * rng.uniform(0.1, 2.0, k)
    scatter = rng.uniform(1.0, 10.0, k)
    level = np.cumsum(rng.standard_normal((count, k)) * walk
                      * np.sqrt(np.diff(day, prepend=day[0]))[:, None], axis=0)
    tails = rng.standard_t(3, (count, k)) / np.sqrt(3.0) if what == 'long tails' else (
        rng.standard_normal((count, k)))
    values = level + scatter * tails
    temperature = (10.0 - 8.0 * np.cos(2.0 * np.pi * day / 365.25)
                   + 3.0 * rng.standard_normal(count))
    term, at = int(rng.integers(k)), [int(rng.integers(5, count - 5))]
    noise = np.hypot(scatter[term], walk[term] * np.sqrt(np.median(np.diff(day))))
    if what == 'temperature':
        values[:, term] += 2.0 * noise * (temperature - 10.0) / 6.4  # 2 sigma of a night, RMS
    if what == 'a step':
        values[at[0]:, term] += 6.0 * noise
    if what == 'four steps':
        at = (np.arange(1, 5) * count // 5 + rng.integers(-1, 2, 4)).tolist()
        for night, sign in zip(at, rng.choice([-1.0, 1.0], 4)):
            values[night:, term] += sign * rng.uniform(10.0, 20.0) * noise
    sigma = rng.uniform(0.5, 2.0, (count, k))
    values += sigma * rng.standard_normal((count, k))
    nights = [SeasonNight(f'night {i}', 86400.0 * d, 40, v * ARCSEC, np.diag(s**2) * ARCSEC**2, 0.0,
                    {'temperature': (t, 1.0)})
              for i, (d, v, s, t) in enumerate(zip(day, values, sigma, temperature))]
    return Nights(NAMES, ALTAZ, nights, []), term, at


def terms_of_nights(found):
    """`NightlyTerms` without columns."""
    n, k = len(found.nights), len(found.names)
    return NightlyTerms(days(found.nights), np.array([night.values for night in found.nights]),
                np.array([night.covariance for night in found.nights]), np.zeros((n, k, 0)))


def of_chance(count, seed):
    """Rows of the table."""
    rows = []
    for number, what in enumerate(STATES):
        claimed = right = where = wrong = 0
        for trial in range(count):
            rng = np.random.default_rng([seed, number, trial])
            nights, term, at = season(rng, what)
            terms = terms_of_nights(nights)
            got, _ = choose_causes(terms, candidates(nights, terms.days))
            claimed += bool(got)
            names = [(c.cause.kind, c.cause.terms) for c in got]
            kind = {'temperature': 'column', 'a step': 'step', 'four steps': 'step'}.get(what)
            right += names.count((kind, (term,))) >= (len(at) if kind == 'step' else 1)
            wrong += sum(n != (kind, (term,)) for n in names)
            wrong += max(names.count((kind, (term,))) - len(at), 0)
            where += {f'night {i}' for i in at} <= {
                c.cause.text for c in got if c.cause.terms == (term,)}
        rows.append((what, count, claimed, right, where, wrong))
    return rows


def foretold(folder):
    """RMS on the rows of each night, rad, with terms predicted, of the last night, and fitted."""
    import glob
    runs = []
    for path in sorted(glob.glob(f'{folder}/*.dat')):
        try:
            runs.append(read_run(path))
        except ValueError:
            continue
    found = nights_of(runs, NAMES)
    terms, out, variation = terms_of_nights(found), [], None
    by_name = {run.meta['source'].rsplit('/', 1)[-1]: run for run in runs}
    k = len(NAMES)
    for i in range(8, len(found.nights)):
        past = NightlyTerms(*(part[:i] for part in terms))
        variation, _ = fit_variation(past, variation)
        mean, cov = forecast(season_path(past, variation), variation,
                             terms.days[i] - terms.days[i - 1], np.zeros((k, 0)))
        run = by_name[found.nights[i].source]
        x_of, y_of = design(NAMES, run['az'], run['el'])
        off = np.concatenate([np.angle(np.exp(1j * (run['az_enc'] - run['az'])))
                              * np.cos(run['el']), run['el_enc'] - run['el']])
        rows = np.concatenate([x_of, y_of])
        n = len(run)
        left = [off - rows @ p for p in (mean, past.values[-1], past.values.mean(0),
                                         terms.values[i])]
        # the middle, as a false star is in some runs
        size = [np.median(np.hypot(v[:n], v[n:])) for v in left]
        at_once = terms.values[i] - mean
        chi = at_once @ np.linalg.solve(cov + terms.covariances[i], at_once) / k
        out.append([*size, chi])
    return np.array(out)


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--full', action='store_true', help='200 seasons of each instead of 5')
    parser.add_argument('--seasons', type=int)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--arc', metavar='FOLDER', help='TPOINT files of a season')
    args = parser.parse_args()
    began = time.perf_counter()
    print(f'{"season":14}{"seasons":>9}{"a cause":>9}{"the one":>9}{"its night":>11}{"others":>8}')
    for what, *numbers in of_chance(args.seasons or (200 if args.full else 5), args.seed):
        print(f'{what:14}' + ''.join(f'{v:>{w}}' for v, w in zip(numbers, (9, 9, 9, 11, 8))))
    if args.arc:
        found = foretold(args.arc)
        own = found[:, 3]
        print(f'\n{len(found)} nights by the ones before, median miss by its own fit taken as 1:')
        for name, column in zip(('foretold', 'terms of the night before', 'mean of all before'),
                                found.T):
            ratio = column / own
            print(f'  {name:28} median {np.median(ratio):5.2f}, 90 % {np.quantile(ratio, .9):6.2f}')
        k = len(NAMES)
        beyond = np.count_nonzero(found[:, 4] * k > chi2.isf(0.01, k))
        print(f'  chi^2 of the forecast, a term: median {np.median(found[:, 4]):.2f}; beyond what '
              f'one in 100 is: {beyond}')
    print(f'# {time.perf_counter() - began:.0f} s')


if __name__ == '__main__':
    main()
