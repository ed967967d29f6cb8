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

"""Which terms do the stars determine, and are their printed errors correct?

    python benchmarks/determined.py [--runs N] [--first N] [--only WORD ...] [--full]

Runs of three mounts with terms of up to 100 arcsec on skies that determine all of them or few: 8 to
12 stars, one circle of the second axis, exactly and within 0.001 to 1 degree, two such circles, one
elevation, two elevations, one pier side, a field of 5 degrees. The mount is simulated by rotations
(scipy's, from readings to directions). The noise is 1 arcsec per axis (5 in the last kind, of 20
rows), known to the fit or not. Printed for each kind: refused runs (by the check of the columns or
by the fit); number of undetermined terms; fraction of the other values outside their 95 % interval;
runs with a value off by more than 5 sigma (probability 6e-7, from Student's t with the printed
degrees of freedom). `--full` makes 1000 runs of each kind. Values of one run are correlated, so the
standard error of the fraction is computed over runs. If the fraction is within it of a limit, three
times as many runs are added.
"""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import norm
from scipy.stats import t as student

from calibration.analysis.diagnosis.mistaken_columns import check_columns
from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import Mount
from pointing_model.runs.run import PointingRun

LATITUDE = 48.0 * DEG
NOISE, SIZE = 1.0 * ARCSEC, 100.0 * ARCSEC
LOWEST, NEAREST = 20.0 * DEG, 5.0 * DEG  # elevation; from the pole of the first axis
MOUNTS = {'alt-az': Mount(), 'fork': Mount.equatorial(LATITUDE),
          'German': Mount.equatorial(LATITUDE, 'german')}
#: sign and place of each rotation's term in the mount's own names
TURNS = ('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF')
#: two-sided chance of 5 sigmas
FIVE = 2.0 * norm.sf(5.0)


def look(reading, mount, turns):
    """Directions (n, 3) of the horizon at which a mount looks, by rotations."""
    x, y, z = np.array(mount.frame)
    of, up = dict(zip(TURNS, turns)), np.array([0.0, 0.0, 1.0])

    def seen(sag):
        return (Rotation.from_rotvec(-of['AN'] * x - of['AW'] * y)
                * Rotation.from_rotvec(-(reading[0] - of['IA'])[:, None] * z)
                * Rotation.from_rotvec(-of['NPAE'] * y)
                * Rotation.from_rotvec((reading[1] - of['IE'] - sag)[:, None] * x)).apply(
                    Rotation.from_rotvec(of['CA'] * z).apply(y))
    # weight lowers the tube by the cosine of where it comes to lie: in the plane of the tube of a
    # fork that stands upright, along the vertical circle of any other mount
    out = stiff = seen(0.0)
    for _ in range(3):
        sag = of['TF'] * np.linalg.norm(np.cross(up, out), axis=1)
        if mount.vertical:
            out = seen(sag)
        else:
            axis = np.cross(up, stiff)
            axis /= np.linalg.norm(axis, axis=1, keepdims=True)
            out = Rotation.from_rotvec(axis * sag[:, None]).apply(stiff)
    return out


def readings(first, second, mount, turns):
    """Axis readings when the mount points to given axis places, shape (2, n)."""
    wanted = np.array([first, second])
    reading = wanted.copy()
    x, y, z = np.array(mount.frame)
    beyond = np.cos(second) < 0.0
    for _ in range(8):
        seen = look(reading, mount, turns)
        a, e = np.arctan2(seen @ x, seen @ y), np.arcsin(np.clip(seen @ z, -1.0, 1.0))
        a, e = np.where(beyond, a + np.pi, a), np.where(beyond, np.pi - e, e)
        reading += wrap(wanted - np.array([a, e]))
    return reading


def high(mount, first, second):
    """Elevation of places of the axes."""
    return mount.horizon_of(first, second)[1]


def places(kind, mount, rng):
    """Places of a run by the axes of the mount, (first, second)."""
    n = int(rng.integers(8, 13)) if kind == 'few stars' else 20 if '20 rows' in kind else 30

    def over(draw, count):
        out = np.empty((2, 0))
        while out.shape[1] < count:
            a, e = draw(20 * count)
            good = (high(mount, a, e) > LOWEST) & (np.abs(e) < 90.0 * DEG - NEAREST)
            out = np.hstack((out, np.array([a, e])[:, good]))
        return out[:, :count]

    def sky(count):
        return over(lambda m: (rng.uniform(-np.pi, np.pi, m), np.arcsin(rng.uniform(-1, 1, m))),
                    count)

    def circle(count, width, middle):
        return over(lambda m: (rng.uniform(-np.pi, np.pi, m),
                               middle + rng.uniform(-width, width, m)), count)

    def elevation(count, value):
        a = rng.uniform(-np.pi, np.pi, count)
        return np.array(mount.axes_of(a, np.full(count, value)))

    middle = rng.uniform(25.0, 65.0) * DEG
    other = middle + (15.0 if middle < 45.0 * DEG else -15.0) * DEG
    if kind.startswith('one circle'):
        width = float(kind.split()[-1]) if kind[-1].isdigit() else 0.0
        out = circle(n, width * DEG, middle)
    elif kind.startswith('two circles'):
        out = np.hstack([circle(6, float(kind.split()[-1]) * DEG, at)
                         for at in (middle, other)])
    elif kind == 'one elevation':
        out = elevation(n, middle)
    elif kind == 'two elevations':
        out = np.hstack([elevation(n // 2, at) for at in (middle, other)])
    elif kind.startswith('a field'):
        a, e = sky(1)[:, 0]
        radius, turn = 2.5 * DEG * np.sqrt(rng.uniform(size=n)), rng.uniform(-np.pi, np.pi, n)
        e = np.clip(e, -70.0 * DEG, 70.0 * DEG)
        out = np.array([a + radius * np.sin(turn) / np.cos(e), e + radius * np.cos(turn)])
    else:
        out = sky(n)
    if mount.two_sided and kind.split()[1] not in ('side', 'field'):
        through = wrap(out[0]) < 0.0  # the east through the pole
        out = np.where(through, [out[0] + np.pi, np.pi - out[1]], out)
    return out


KINDS = ('few stars', 'one circle', 'one circle +- 0.001', 'one circle +- 0.01',
         'one circle +- 0.1', 'one circle +- 1', 'two circles +- 0.01', 'one elevation',
         'two elevations', 'one side', 'a field of 5 deg', 'a field of 5 deg, 20 rows, 5 arcsec')
#: of the values beyond their 95 % interval, per cent
LEAST, MOST = 4.0, 6.0


def simulated(kind, name, seed, given):
    """A run, and its true terms in the mount's own names, radians."""
    mount = MOUNTS[name]
    rng = np.random.default_rng([seed, KINDS.index(kind), list(MOUNTS).index(name)])
    truth = dict(zip(mount.names.physical, rng.uniform(-SIZE, SIZE, 7)))
    turns = np.zeros(7)
    for term, (own, sign) in mount.names.terms.items():
        turns[TURNS.index(own)] = sign * truth[term]
    first, second = places(kind, mount, rng)
    a, e = readings(first, second, mount, turns)
    sigma = 5.0 * NOISE if '5 arcsec' in kind else NOISE
    noise = rng.normal(scale=sigma, size=(2, len(a)))
    columns = {'az': first, 'el': second, 'az_enc': a + noise[0] / np.abs(np.cos(second)),
               'el_enc': e + noise[1]}
    if given:
        columns |= dict.fromkeys(('sigma_x', 'sigma_y'), np.full(len(a), sigma))
    return PointingRun(columns, {'mount': mount}), truth


def judged(kind, name, given, runs, first, checked):
    """Outcomes of several runs of a kind, and lists of results of those that are fitted."""
    found = {'refused': 0, 'undetermined': [], 'terms': [], 'beyond': [], 'far': [], 'said': []}
    for seed in range(first, first + runs):
        run, truth = simulated(kind, name, seed, given)
        try:
            if seed - first < checked:
                check_columns(run)
            fit = fit_terms(run)
        except ValueError as error:  # MistakenColumns is one
            found['refused'] += 1
            found['said'].append(str(error))
            continue
        known = np.array([term not in fit.undetermined for term in fit.names])
        away = np.abs(fit.coefficients - np.array(list(truth.values())))[known]
        ratio, freedom = away / fit.sigma[known], fit.freedom[known]
        chance = np.where(np.isinf(freedom), 2.0 * norm.sf(ratio),
                          2.0 * student.sf(ratio, np.minimum(freedom, 1e9)))
        found['undetermined'].append(np.count_nonzero(~known))
        found['terms'].append(np.count_nonzero(known))
        found['beyond'].append(np.count_nonzero(away > fit.within95[known]))
        found['far'].append((chance < FIVE).any())
    return found


def share_of(found):
    """Percentage of values outside their 95 % interval, and its standard error over runs."""
    terms, beyond = np.array(found['terms'], float), np.array(found['beyond'], float)
    if not terms.sum():
        return 0.0, np.inf
    share = beyond.sum() / terms.sum()
    return (100.0 * share,
            100.0 * float(np.linalg.norm(beyond - share * terms)) / terms.sum())


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--runs', type=int, default=0, help='of each kind (50)')
    parser.add_argument('--first', type=int, default=1, help='seed (1)')
    parser.add_argument('--checked', type=int, default=10, help='runs of each kind of which the '
                        'columns are checked too, which takes 30 times as long (10)')
    parser.add_argument('--only', nargs='*', default=(), help='kinds with one of these words')
    parser.add_argument('--full', action='store_true', help='1000 runs of each kind, '
                        '4000 where these do not decide')
    args = parser.parse_args()
    runs = args.runs or (1000 if args.full else 50)
    print('| stars | mount | sigmas | runs | refused | undetermined terms a run | beyond 95 % | '
          'runs beyond 5 sigma | |\n' + '| --- ' * 9 + '|')
    for kind in KINDS:
        for name in MOUNTS:
            if args.only and not any(word in f'{kind} {name}' for word in args.only):
                continue
            for given in (False, True):
                one = judged(kind, name, given, runs, args.first, args.checked)
                share, error = share_of(one)
                if min(abs(share - LEAST), abs(share - MOST)) < error and args.full:
                    more = judged(kind, name, given, 3 * runs, args.first + runs, 0)
                    one = {key: one[key] + more[key] for key in one}
                    share, error = share_of(one)
                count = len(one['terms']) + one['refused']
                room = 0.0 if args.full else 2.0 * error  # few runs tell less
                good = (one['refused'] == 0 and sum(one['far']) <= (0 if given else count / 1000)
                        and LEAST - room <= share <= MOST + room)
                print(f'| {kind.replace("+-", "±")} | {name} | {"given" if given else "measured"} '
                      f'| {count} | {one["refused"]} | {np.mean(one["undetermined"]):.2f} | '
                      f'{share:.1f} ± {error:.1f} % | {sum(one["far"])} | '
                      f'{"ok" if good else "MISSED"} |', flush=True)
                for text in dict.fromkeys(one['said']):
                    print(f'      {text:.160}', flush=True)


if __name__ == '__main__':
    main()
