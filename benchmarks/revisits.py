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

"""Revisited places and clustered outliers: detection rates and false detections.

    python benchmarks/revisits.py [--runs N] [--only PART ...] [--seed N]

steps      two passes of an alt-azimuth and of a German mount over the same sky, with 8 places of 40
           rows in both and with 30 of 80: a step of one zero by 5 sigma of one star between the
           passes, found and called a step; so too with a restart in the middle of each pass, and
           with an effect of 3 sigma that the terms lack
white      the same without a step: anything found
wander     the same with drifting zeros: how often this is called a step
outliers   80 rows with four outliers of 10 sigma, of one axis and sign, within 3 degrees of a
           direction or of an azimuth, with and without three single outliers elsewhere: how often
           the cluster is reported
accidents  the same with single outliers only: clean, with drifting zeros, with an unmodelled effect
step38     two passes with a step of -38" between them: 2-fold cross-validated RMS of the terms with
           one zero, and with `sessions` found from the data

Noise is 1" per axis; seven terms of 20" are fitted. The results are those of `fit`.
"""

import argparse

import numpy as np

from calibration.analysis.diagnosis.residual_patterns import (
    ResidualRows,
    cluster_findings,
    visit_findings,
)
from calibration.analysis.run_fit import fit_run
from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model.geometry import sky_to_encoder
from pointing_model.mounts import ALTAZ, Mount, through_pole
from pointing_model.runs.run import PointingRun

MOUNTS = {'alt-az': ALTAZ, 'German': Mount.equatorial(34.3 * DEG, 'german')}
#: rows, and places that both passes have
LAYOUTS = ((40, 8), (80, 30))
LOWEST, HIGHEST = 20.0 * DEG, 80.0 * DEG
SIZE, STEP, FAR = 20.0, 5.0, 10.0


def directions(rng, mount, n):
    """Places over the sky by the axes of the mount; of a German one the east through its pole."""
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(LOWEST), np.sin(HIGHEST), n))
    return on_axes(mount, az, el)


def on_axes(mount, az, el):
    """Angles of the axes, shape (2, n)."""
    if mount.vertical:
        return np.array([az, el])
    first, second = mount.axes_of(az, el)
    return np.array(mount.on_travel(*through_pole(first, second, np.sin(first) < 0.0)))


def passes(rng, mount, rows, shared):
    """Two passes, each in random order: axis angles, (2, rows), and mask of the second pass."""
    half = rows // 2
    first = directions(rng, mount, half)
    again = first[:, :shared] + rng.normal(0.0, 0.3 * DEG, (2, shared)) / np.array(
        [np.cos(first[1, :shared]), np.ones(shared)])
    second = np.concatenate((again, directions(rng, mount, half - shared)), axis=1)
    return np.concatenate([one[:, rng.permutation(half)] for one in (first, second)], axis=1), (
        np.arange(rows) >= half)


def run_of(rng, mount, axes, zeros=(0.0, 0.0), sky=(0.0, 0.0)):
    """A run with terms and noise; `zeros` of the axes and offsets on the sky, arcsec."""
    terms = dict(zip(mount.names.physical, SIZE * ARCSEC * rng.normal(size=7)))
    flexure = [t for t in terms if t not in mount.names.terms]
    readings = np.array(sky_to_encoder(*axes, {
        t: v for t, v in terms.items() if t not in flexure}, mount))
    n, scale = axes.shape[1], np.array([np.cos(axes[1]), np.ones(axes.shape[1])])
    noise = rng.normal(size=(2, n)) + np.array([np.broadcast_to(one, n) for one in sky])
    shift = np.array([np.broadcast_to(one, n) for one in zeros])
    readings = readings + ARCSEC * (noise / scale + shift)
    return PointingRun({'az': axes[0], 'el': axes[1], 'az_enc': readings[0],
                        'el_enc': readings[1], 'time': 1.7e9 + 90.0 * np.arange(n)},
                       {'mount': mount})


def lacking(axes, rng):
    """An unmodelled effect on the sky: 3 sigma RMS, in elevation or declination."""
    return 0.0, 3.0 * np.sqrt(2.0) * np.sin(3.0 * axes[1] + 2.0 * axes[0] + rng.uniform(0.0, 6.0))


def on_axis(rng, axes, curve, on_sky=True):
    """A curve in the zero of one random axis, (2, n), with the same size on the sky for either."""
    axis = rng.integers(2)
    out = np.zeros((2, len(curve)))
    out[axis] = curve / (np.sqrt(np.mean(np.cos(axes[1])**2)) if axis == 0 and on_sky else 1.0)
    return out


def random_walk(rng, n, size):
    """A random walk with steps of RMS `size` per row."""
    return size * np.cumsum(rng.normal(size=n))


def memory(rng, n, size, rows):
    """AR(1) noise of RMS `size` with a correlation length of `rows`."""
    rho, out = np.exp(-1.0 / rows), np.empty(n)
    out[0] = rng.normal()
    for i in range(1, n):
        out[i] = rho * out[i - 1] + np.sqrt(1.0 - rho * rho) * rng.normal()
    return size * out


WANDERS = {
    'walk of 0.2" a row': lambda r, n: random_walk(r, n, 0.2),
    'walk of 0.5" a row': lambda r, n: random_walk(r, n, 0.5),
    'walk of 1" a row': lambda r, n: random_walk(r, n, 1.0),
    'memory of 5 rows, 3"': lambda r, n: memory(r, n, 3.0, 5.0),
    'memory of 20 rows, 3"': lambda r, n: memory(r, n, 3.0, 20.0),
    'drift of 10" in all': lambda r, n: 10.0 * np.arange(n) / n,
    'wave of 5", half to two in all': lambda r, n: 5.0 * np.sin(
        2.0 * np.pi * (np.linspace(0.0, r.uniform(0.5, 2.0), n) + r.uniform())),
}


def patterns(run):
    """Findings of `fit` on revisited places, and on clustered outliers."""
    rows = ResidualRows.from_fit(run, fit_terms(run))
    visits = rows.visits(run.mount.names.physical)
    return visit_findings(rows, visits), cluster_findings(rows)


def line(what, *figures):
    """Print a line of the table."""
    print(f'{what:76s}' + ''.join(f'{figure:>14s}' for figure in figures), flush=True)


def _moves(args, rng, make):
    found = at_once = 0
    for _ in range(args.runs):
        kinds = {one.kind for one in patterns(make(rng))[0]}
        at_once += 'step between visits' in kinds
        found += bool(kinds & {'step between visits', 'moved between visits'})
    return f'{found} of {args.runs}', f'{at_once} of {args.runs}'


def _each(kind):
    for name, mount in MOUNTS.items():
        for rows, shared in LAYOUTS:
            yield f'{name}, {shared} places twice of {rows} rows: {kind}', mount, rows, shared


def steps(args):
    """Detection of a step between two passes."""
    def restarted(rng, axes, later):
        n = len(later)
        parts = np.arange(n) * 4 // n
        return on_axis(rng, axes, STEP * later) + np.array(
            [0.3 * rng.normal(size=4)[parts] for _ in range(2)])
    line('a step of 5 sigma between two passes', 'found', 'called a step')
    for kind, zeros, sky in (
            ('white noise', lambda r, a, later: on_axis(r, a, STEP * later), None),
            ('restarts by 0.3 sigma', restarted, None),
            ('an effect of 3 sigma', lambda r, a, later: on_axis(r, a, STEP * later), lacking)):
        for what, mount, rows, shared in _each(kind):
            def make(rng, mount=mount, rows=rows, shared=shared, zeros=zeros, sky=sky):
                axes, later = passes(rng, mount, rows, shared)
                return run_of(rng, mount, axes, zeros(rng, axes, later),
                              sky(axes, rng) if sky else (0.0, 0.0))
            line(what, *_moves(args, np.random.default_rng(args.seed), make))


def white(args):
    """False detections without a step."""
    line('no step', 'found', 'called a step')
    for kind, sky in (('white noise', lambda axes, rng: (0.0, 0.0)),
                      ('an effect of 3 sigma', lacking),
                      ('wild noise beside it', lambda axes, rng: rng.standard_t(2, axes.shape))):
        for what, mount, rows, shared in _each(kind):
            def make(rng, mount=mount, rows=rows, shared=shared, sky=sky):
                axes, _ = passes(rng, mount, rows, shared)
                return run_of(rng, mount, axes, sky=sky(axes, rng))
            line(what, *_moves(args, np.random.default_rng(args.seed), make))


def wander(args):
    """False detections with a drifting zero instead of a step."""
    line('a zero that wanders', 'found', 'called a step')
    for kind, curve in WANDERS.items():
        for what, mount, rows, shared in _each(kind):
            def make(rng, mount=mount, rows=rows, shared=shared, curve=curve):
                axes, _ = passes(rng, mount, rows, shared)
                return run_of(rng, mount, axes, on_axis(rng, axes, curve(rng, rows)))
            line(what, *_moves(args, np.random.default_rng(args.seed), make))


def gathered(rng, mount, kind, strays):
    """80 rows with four clustered outliers of 10 sigma near a direction or azimuth (None: none)."""
    axes = directions(rng, mount, 80)
    sky = np.zeros((2, 80))
    if kind:
        az = rng.uniform(0.0, 2.0 * np.pi)
        if kind == 'direction':
            middle, r = rng.uniform(30.0, 70.0) * DEG, 3.0 * DEG * np.sqrt(rng.uniform(size=4))
            turn = rng.uniform(0.0, 2.0 * np.pi, 4)
            el = middle + r * np.sin(turn)
            az = az + r * np.cos(turn) / np.cos(el)
        else:
            az = az + rng.uniform(-3.0, 3.0, 4) * DEG
            el = np.arcsin(rng.uniform(np.sin(LOWEST), np.sin(HIGHEST), 4))
        axes[:, :4] = on_axes(mount, az, el)
        sky[rng.integers(2), :4] = FAR * rng.choice([-1.0, 1.0])
    for row in range(4, 4 + strays):
        sky[rng.integers(2), row] = FAR * rng.choice([-1.0, 1.0])
    order = rng.permutation(80)
    return axes[:, order], sky[:, order]


def outliers(args):
    """Detection of four clustered outliers."""
    line('four outliers of 80 rows together', 'told', 'right rows')
    for name, mount in MOUNTS.items():
        for kind in ('direction', 'azimuth'):
            for strays in (0, 3):
                rng, told, right = np.random.default_rng(args.seed), 0, 0
                for _ in range(args.runs):
                    axes, sky = gathered(rng, mount, kind, strays)
                    # which four: drawn first, and of one sign and axis
                    found = patterns(run_of(rng, mount, axes, sky=sky))[1]
                    told += bool(found)
                    right += any(len(one['rows']) >= 4 and all(
                        np.abs(sky[:, row]).max() == FAR for row in one['rows']) for one in found)
                line(f'{name}, within 3 degrees of a{"n" * (kind[0] == "a")} {kind}, '
                     f'{strays} strays', f'{told} of {args.runs}', f'{right} of {args.runs}')


def accidents(args):
    """False detections without clustered outliers."""
    line('no outliers together, 80 rows', 'told')
    for name, mount in MOUNTS.items():
        for what, strays, more in (
                ('clean', 0, None), ('4 strays', 4, None), ('7 strays', 7, None),
                ('12 strays', 12, None), ('an effect of 3 sigma', 0, 'lacking'),
                ('walk of 0.5" a row, 4 strays', 4, 'walk')):
            rng, told = np.random.default_rng(args.seed), 0
            for _ in range(args.runs):
                axes, sky = gathered(rng, mount, None, strays)
                zeros = on_axis(rng, axes, random_walk(rng, 80, 0.5)) if more == 'walk' else (
                    0.0, 0.0)
                if more == 'lacking':
                    sky = sky + np.array([np.zeros(80), lacking(axes, rng)[1]])
                told += bool(patterns(run_of(rng, mount, axes, zeros, sky))[1])
            line(f'{name}, {what}', f'{told} of {args.runs}')


def step38(args):
    """Cross-validated RMS of a run with a large step, with one zero and with sessions."""
    line('two passes of 40 rows, a step of -38" of the first axis, halves not seen', 'one zero',
         'sessions')
    rng = np.random.default_rng(args.seed)
    for mount in MOUNTS.values():
        axes, later = passes(rng, mount, 80, 40)
        run = run_of(rng, mount, axes, (-38.0 * later, 0.0), lacking(axes, rng))
        one, more = fit_run(run), fit_run(run, sessions=None)
        line(f'{mount.kind}; {", ".join(f.kind for f in one.findings if "between" in f.kind)}',
             f'{one.halves.radial:.2f}"', f'{more.halves.radial:.2f}"')


PARTS = {'steps': steps, 'white': white, 'wander': wander, 'outliers': outliers,
         'accidents': accidents, 'step38': step38}


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--runs', type=int, default=100, help='of each kind')
    parser.add_argument('--only', nargs='+', choices=PARTS, default=list(PARTS))
    parser.add_argument('--seed', type=int, default=4)
    args = parser.parse_args()
    for name in args.only:
        PARTS[name](args)


if __name__ == '__main__':
    main()
