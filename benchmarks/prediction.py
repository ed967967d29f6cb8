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

"""Predictive model on simulated runs: accuracy against the terms alone, and its stated errors.

    python benchmarks/prediction.py [--part clean|sure ...] [--runs N] [--first N]

Mounts are an alt-azimuth, an equatorial and a German one, with 20 to 200 random stars above 20
degrees, a minute each. The noise is 1": normal, Student's t (3), unequal in the axes, or different
for each star. `clean`: only the terms; ratio of the RMS of 200 later stars by the prediction to
that by the terms. `sure`: eccentric discs, bearing wobble, a second flexure (each 0.5 to 6"), and a
drifting zero, simulated by independent formulas. Tested is the stated standard error of a new star,
including its noise, per axis, pooled over all runs: for rows held out at random, in blocks of time,
and for later stars in a part of the sky without rows (120 degrees of the first angle).
"""

import argparse

import numpy as np

from calibration.analysis.diagnosis.base_terms import Base
from calibration.analysis.diagnosis.observations import observations
from calibration.analysis.diagnosis.prediction import prediction_problem, predictive_model
from calibration.estimation.folds import contiguous_folds, random_folds
from calibration.estimation.predictor import rows_left_out
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.mounts import Mount
from pointing_model.runs.run import PointingRun

FRESH = 200
MOUNTS = ('altaz', 'equatorial', 'german')
NOISES = ('normal', 't', 'unequal', 'by star')
LATITUDE = 0.6


def noise_of(kind, count, rng):
    """Shape (2, count), arcsec."""
    if kind == 't':
        return rng.standard_t(3, size=(2, count))
    out = rng.normal(size=(2, count))
    if kind == 'unequal':
        return out * np.array([[1.0], [0.4]])
    return out * rng.choice([0.5, 1.0, 2.0], count) if kind == 'by star' else out


def errors_of(az, el, time, rng):
    """Errors in addition to the terms, (2, n) on the sky, arcsec."""
    size, phase = rng.uniform(0.5, 6.0, 5) * (rng.random(5) < 0.6), rng.uniform(0.0, 6.28, 5)
    x = size[0] * np.sin(2.0 * az + phase[0]) * np.cos(el) + size[1] * np.sin(az + phase[1])
    y = size[2] * np.sin(el + phase[2]) + size[3] * np.cos(3.0 * az + phase[3])
    return np.array((x + size[4] * np.sin(4.0 * time / time.max()) * np.cos(el), y))


def simulated(seed, effects):
    """A run of training rows and later ones, the number of the former, and the noise of each."""
    rng = np.random.default_rng(seed)
    kind, noise = MOUNTS[seed % 3], NOISES[seed // 3 % 4]
    mount = Mount() if kind == 'altaz' else Mount.equatorial(LATITUDE, kind)
    rows = int(round(20.0 * 10.0**rng.uniform()))
    n = rows + FRESH
    az, el = rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.34, 0.99, n))
    if not mount.vertical:
        az, el = mount.axes_of(az, el, beyond=(np.sin(az) > 0.0) & (kind == 'german'))
    if effects:  # a third of the first angle is kept from the rows
        hidden = np.mod(az, 2.0 * np.pi) < 2.0 * np.pi / 3.0
        order = np.concatenate((np.flatnonzero(~hidden)[:rows], np.flatnonzero(hidden)))
        az, el, rows = az[order], el[order], min(rows, int(np.sum(~hidden)))
        n = len(az)
    time = 60.0 * np.arange(n)
    terms = {name: 30.0 * ARCSEC * rng.normal() for name in mount.names.physical}
    first, second = PointingModel(terms, mount=mount).sky_to_encoder(az, el)
    off = noise_of(noise, n, rng)
    if effects:
        off = off + errors_of(az, el, np.minimum(time, time[rows - 1]), rng)
    return PointingRun({'az': az, 'el': el, 'time': time, 'az_enc': first + off[0] * ARCSEC
                        / np.cos(el), 'el_enc': second + off[1] * ARCSEC}, {'mount': mount}), rows


def clean(seed):
    """Ratio of RMS on later stars, and whether the prediction uses more than the terms."""
    run, rows = simulated(seed, False)
    train, later = run.select(np.arange(rows)), run.select(np.arange(rows, len(run)))
    found = predictive_model(train, ways=0)
    left = [np.array(m.residuals(later)) for m in (found.model, found.base_model)]
    return np.sqrt(np.mean(left[0]**2) / np.mean(left[1]**2)), found.found.beyond


def sure(seed):
    """|error| over its stated sigma: at random, in blocks, in the sky that no row was in."""
    run, rows = simulated(seed, True)
    train, later = run.select(np.arange(rows)), run.select(np.arange(rows, len(run)))
    obs = observations(train)
    problem, _, _ = prediction_problem(obs, Base.parse('physical', (), run.mount))
    out = []
    for folds in (random_folds(problem.group, 5, np.random.default_rng(seed)),
                  contiguous_folds(problem.order, 5)):
        left, sigma = rows_left_out(problem, folds)
        out.append(np.abs(left[1] / sigma).ravel())
    model = predictive_model(train, ways=0).model
    noise = np.array(model.provenance['star_noise_arcsec'])[:, None] * ARCSEC
    known = observations(later).context
    sigma = np.hypot(model.sigma(later['az'], later['el'], known), noise)
    return [*out, np.abs(np.array(model.residuals(later)) / sigma).ravel()]


def main():
    """Run the parts, print a line for each figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--part', nargs='+', default=['clean', 'sure'], choices=['clean', 'sure'])
    parser.add_argument('--runs', type=int, default=500)
    parser.add_argument('--first', type=int, default=0)
    args = parser.parse_args()
    seeds = range(args.first, args.first + args.runs)
    if 'clean' in args.part:
        ratio, beyond = np.array([clean(seed) for seed in seeds]).T
        print(f'clean, {len(ratio)} runs: RMS over that of the terms: mean {ratio.mean():.4f}, '
              f'<= 1.03 in {100 * np.mean(ratio <= 1.03):.1f} %, <= 1.10 in '
              f'{100 * np.mean(ratio <= 1.10):.1f} %, largest {ratio.max():.3f}; terms left in '
              f'{100 * beyond.mean():.1f} %', flush=True)
    if 'sure' in args.part:
        each = [sure(seed) for seed in seeds]
        for i, name in enumerate(('random', 'blocks of time', "beyond the rows' sky")):
            z = np.concatenate([one[i] for one in each])
            z = z[np.isfinite(z)]
            print(f'stated sigma, {len(each)} runs, {name}: {100 * np.mean(z < 1.0):.1f} % within '
                  f'1, {100 * np.mean(z < 1.96):.1f} % within 1.96', flush=True)


if __name__ == '__main__':
    main()
