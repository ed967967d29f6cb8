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

"""Seven-term pointing fit: time and coefficients against katpoint 0.10.3.

    OMP_NUM_THREADS=1 python benchmarks/fit_vs_katpoint.py [--sizes N ...] [--seed N]

Both fit IA, IE, CA, NPAE, AN, AW and TF by linear least squares to the same on-sky offsets in the
same process, in turn. katpoint's P-terms give encoder - catalogue with these columns, so

    P1 = IA, P3 = NPAE, P4 = -CA, P5 = AN, P6 = -AW, P7 = IE, P8 = TF.

`katpoint.PointingModel.fit` returns coefficients and standard errors for unit noise. Timed
beside it:

- `calibration.analysis.term_fit`, `fit_first_order`: the same linear fit, with residuals and the
  full covariance scaled by the measured scatter of each axis;
- `fit_terms` with everything (checks, rank, provenance, model), but with first-order columns and
  without robust weights, so that the numbers are the same;
- `fit_terms` with exact rotations, without and with robust weights (the default): a better fit,
  whose coefficients differ by the second order and by the weights;
- the normal equations alone, columns included, formed and solved in plain numpy, with sigmas, and
  the plain fits with those sigmas.

Rounds alternate between the candidates; the best is printed. The one-time import is not timed. The
deprecation warning of `fit` is avoided, not timed. katpoint: .venv/bin/pip install katpoint, or the
extra `bench`.
"""

import argparse

import numpy as np
from race import Row, peer, race, show

from calibration.analysis.term_fit import fit_first_order, fit_terms
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun

#: katpoint's number and sign of each of our terms
P_TERMS = {'IA': (1, 1), 'IE': (7, 1), 'CA': (4, -1), 'NPAE': (3, 1), 'AN': (5, 1),
           'AW': (6, -1), 'TF': (8, 1)}
TRUTH = dict(zip(PHYSICAL, np.array([20.0, -35.0, 25.0, -18.0, 30.0, -22.0, 15.0]) * ARCSEC))
#: rows -> rounds, and how much faster than katpoint the default fit is to be
SIZES = {30: (10, 0.15), 1000: (10, 0.3), 30_000: (7, 0.5), 1_000_000: (5, 0.5)}
KATPOINT, NUMPY = 'katpoint PointingModel.fit', 'normal equations in numpy, with sigmas'
DEFAULT = 'fit_terms, the default'


def make_run(n, seed):
    """Stars above 20 degrees, uniform on the sky, with 1" of noise an axis."""
    rng = np.random.default_rng(seed)
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(np.radians(20.0)), np.sin(np.radians(85.0)), n))
    az_enc, el_enc = PointingModel(TRUTH).sky_to_encoder(az, el)
    noise = rng.normal(size=(2, n)) * ARCSEC
    return PointingRun({'az': az, 'el': el, 'az_enc': az_enc + noise[0] / np.cos(el),
                        'el_enc': el_enc + noise[1]})


def normal_equations(az, el, x, y, sigma):
    """Coefficients of the seven terms by nothing but numpy."""
    n = len(az)
    sin_az, cos_az, sin_el, cos_el = np.sin(az), np.cos(az), np.sin(el), np.cos(el)
    columns = np.zeros((7, 2 * n))
    columns[0, :n], columns[1, n:], columns[2, :n], columns[3, :n] = cos_el, 1.0, 1.0, sin_el
    columns[4, :n], columns[4, n:] = sin_az * sin_el, cos_az
    columns[5, :n], columns[5, n:] = cos_az * sin_el, -sin_az
    columns[6, n:] = cos_el
    weighted = columns / np.square(sigma)
    return np.linalg.solve(weighted @ columns.T, weighted @ np.concatenate((x, y)))


def compare(n, rounds, seed):
    """Seconds and coefficients of every candidate for `n` stars, by name."""
    run = make_run(n, seed)
    az, el = run['az'], run['el']
    x, y = run.offsets()
    d_az, d_el = run['az_enc'] - az, run['el_enc'] - el
    sigma = np.full(n, ARCSEC)
    both = np.concatenate((sigma, sigma))
    given = PointingRun({**run.columns, 'sigma_x': sigma, 'sigma_y': sigma})
    coefficients = {}
    candidates = {
        'fit_first_order': lambda: fit_first_order(az, el, x, y).coefficients,
        'fit_terms, first order, robust off': lambda: fit_terms(
            run, geometry='first_order', robust=False).coefficients,
        'fit_terms, rotations, robust off': lambda: fit_terms(run, robust=False).coefficients,
        DEFAULT: lambda: fit_terms(run).coefficients,
        'fit_first_order, with sigmas': lambda: fit_first_order(
            az, el, x, y, PHYSICAL, sigma, sigma).coefficients,
        'fit_terms, rotations, robust off, with sigmas': lambda: fit_terms(
            given, robust=False).coefficients,
        NUMPY: lambda: normal_equations(az, el, x, y, both),
    }
    katpoint = peer('katpoint')
    if katpoint is not None:
        theirs, enabled = katpoint.PointingModel(), [P_TERMS[name][0] for name in PHYSICAL]

        def katpoint_fit():
            theirs.set()
            values, _ = theirs.fit(az, el, d_az, d_el, enabled_params=enabled,
                                   keep_disabled_params=True)
            return np.array([values[p - 1] * sign for p, sign in P_TERMS.values()])
        candidates[KATPOINT] = katpoint_fit

    def kept(name, call):
        def again():
            coefficients[name] = call()
        return again
    times = race({name: kept(name, call) for name, call in candidates.items()}, rounds)
    return times, coefficients


def rows(sizes=tuple(SIZES), seed=1, names=None):
    """`race.Row` of each fit, or of those of `names`, for each number of stars."""
    out = []
    for n in sizes:
        rounds, least = SIZES[n]
        times, coefficients = compare(n, rounds, seed)
        for name in names or [name for name in times if name not in (NUMPY, KATPOINT)]:
            wanted = least if name == DEFAULT else None
            theirs = NUMPY if 'sigmas' in name else KATPOINT
            out.append(Row('fit', name, str(n), times[name], theirs, times.get(theirs), wanted))
        if KATPOINT in times:
            off = np.abs(coefficients['fit_first_order'] - coefficients[KATPOINT]).max() / ARCSEC
            print(f'{n} stars: fit_first_order and katpoint agree to {off:.1e}"')
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--sizes', type=int, nargs='+', choices=tuple(SIZES), default=tuple(SIZES))
    args = parser.parse_args()
    show(rows(args.sizes, args.seed))


if __name__ == '__main__':
    main()
