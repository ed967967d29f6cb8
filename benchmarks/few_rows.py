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

"""Fits of few rows: coverage of the 95 % intervals, rejected rows, detection of wrong stars.

    python benchmarks/few_rows.py [--runs N] [--full]

Simulated runs of 4 to 20 stars above 20 degrees: seven terms as exact rotations, noise of 1" an
axis (normal, or Student's t of 4 degrees), none or some stars wrong by 60" in a random direction.
For comparison: intervals of two sigma from the robust weights, as used in larger fits (`before`).
`--full`: 1000 runs each, also with noise of 0.58" and 1.73" on the two axes and with two wrong
stars.
"""

import argparse
from unittest.mock import patch

import numpy as np

from calibration.analysis.term_fit import fit_terms
from calibration.estimation import gauss_newton
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun

TRUTH = np.array([200, 100, 60, -90, 120, -130, 80]) * ARCSEC
MOUNT = PointingModel(dict(zip(PHYSICAL, TRUTH)))
WRONG = 60.0 * ARCSEC
ROWS = (4, 5, 6, 8, 12, 20)


def run_of(rng, n, tails, wrong, axes):
    """A run of `n` rows, the first `wrong` of them wrong; `axes`: noise of each, arcsec."""
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(np.radians(20.0)), np.sin(np.radians(85.0)), n))
    az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
    noise = rng.standard_t(4, (2, n)) if tails else rng.normal(size=(2, n))
    x, y = noise * np.array(axes)[:, None] * ARCSEC
    turn = rng.uniform(0.0, 2.0 * np.pi, wrong)
    x[:wrong] += WRONG * np.cos(turn)
    y[:wrong] += WRONG * np.sin(turn)
    return PointingRun({'az': az, 'el': el, 'az_enc': az_enc + x / np.cos(el),
                        'el_enc': el_enc + y})


def figures(n, tails, wrong, axes, runs, before=False):
    """Fractions of terms outside, of runs rejecting a good row, of wrong stars found; failures."""
    beyond, good, found, failed = [], 0, 0, 0
    for seed in range(runs):
        run = run_of(np.random.default_rng([n, seed, tails, wrong]), n, tails, wrong, axes)
        try:
            if before:
                with patch.object(gauss_newton, 'are_few', return_value=False):
                    fit = fit_terms(run)
            else:
                fit = fit_terms(run)
        except ValueError:
            failed += 1
            continue
        wide = 1.96 * fit.sigma if before else fit.within95
        beyond.append(np.abs(fit.coefficients - TRUTH) > wide)
        good += bool(np.any(fit.rejected >= wrong))
        found += np.count_nonzero(fit.rejected < wrong)
    return float(np.mean(beyond)), good / runs, found / (runs * wrong) if wrong else None, failed


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--runs', type=int, default=50)
    parser.add_argument('--full', action='store_true')
    args = parser.parse_args()
    runs = 1000 if args.full else args.runs
    cases = [(wrong, (1.0, 1.0)) for wrong in ((0, 1, 2) if args.full else (0, 1))]
    cases += [(wrong, (3.0**-0.5, 3.0**0.5)) for wrong in (0, 1)] if args.full else []
    print(f'{runs} runs each; beyond: terms beyond their 95 % (target 5 %), good: runs in which a '
          'good row is rejected, found: wrong stars\n')
    print(f'{"rows":>4} {"noise":7} {"axes":11} {"wrong":>5} | {"beyond":>7} {"good":>7} '
          f'{"found":>7} | before: {"beyond":>7} {"good":>7} {"found":>7} {"no fit":>6}')
    for wrong, axes in cases:
        for tails in (False, True):
            for n in ROWS:
                now = figures(n, tails, wrong, axes, runs)
                was = figures(n, tails, wrong, axes, runs, before=True)
                cells = ['-' if v is None else f'{100.0 * v:.1f} %'
                         for v in (*now[:3], *was[:3])]
                print(f'{n:4} {"t(4)" if tails else "normal":7} {axes[0]:.2f}, {axes[1]:.2f}"'
                      f'{wrong:7} | {cells[0]:>7} {cells[1]:>7} {cells[2]:>7} |         '
                      f'{cells[3]:>7} {cells[4]:>7} {cells[5]:>7} {now[3] + was[3]:6}')


if __name__ == '__main__':
    main()
