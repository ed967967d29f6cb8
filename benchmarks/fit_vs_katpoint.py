"""Seven-term pointing fit: time and coefficients against katpoint 0.10.3.

    python benchmarks/fit_vs_katpoint.py [--repeats N] [--seed N]

Both fit IA, IE, CA, NPAE, AN, AW and TF by linear least squares to the same on-sky offsets in the
same process, in turn. katpoint's P-terms give encoder - catalogue with these columns, so

    P1 = IA, P3 = NPAE, P4 = -CA, P5 = AN, P6 = -AW, P7 = IE, P8 = TF.

`katpoint.PointingModel.fit` returns coefficients and standard errors for unit noise. Timed
beside it:

- `calibration.fit.fit_first_order`: the same linear fit, with residuals and the full covariance
  scaled by the measured scatter of each axis;
- `calibration.fit.fit_terms`: all of it (checks, rank, provenance, model), with first-order
  columns and without robust weights, so the same numbers;
- `fit_terms` with exact rotations, without and with robust weights: another, better fit, timed
  for information; its coefficients differ by the second order and by the weights.

Each round calls every candidate a few times in a row (20 for 30 stars, once for 100 000) and the
rounds alternate between them; printed is the median round. The one-time import is not timed. The
deprecation warning of `fit` is avoided, not timed. katpoint comes with the extra `bench`.
"""

import argparse
import time

import numpy as np

from calibration.fit import fit_first_order, fit_terms
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.run import PointingRun
from pointing_model.terms import PHYSICAL

#: katpoint's number and sign of each of our terms
P_TERMS = {'IA': (1, 1), 'IE': (7, 1), 'CA': (4, -1), 'NPAE': (3, 1), 'AN': (5, 1),
           'AW': (6, -1), 'TF': (8, 1)}
TRUTH = dict(zip(PHYSICAL, np.array([20.0, -35.0, 25.0, -18.0, 30.0, -22.0, 15.0]) * ARCSEC))
TARGET = 8.0


def make_run(n, seed):
    """Stars above 20 degrees, uniform on the sky, with 1" of noise an axis."""
    rng = np.random.default_rng(seed)
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(np.radians(20.0)), np.sin(np.radians(85.0)), n))
    az_enc, el_enc = PointingModel(TRUTH).sky_to_encoder(az, el)
    noise = rng.normal(size=(2, n)) * ARCSEC
    return PointingRun({'az': az, 'el': el, 'az_enc': az_enc + noise[0] / np.cos(el),
                        'el_enc': el_enc + noise[1]})


def compare(n, repeats, calls, seed):
    """Rows (label, seconds, largest coefficient difference in arcsec) for `n` stars."""
    import katpoint

    run = make_run(n, seed)
    az, el = run['az'], run['el']
    x, y = run.offsets()
    d_az, d_el = run['az_enc'] - az, run['el_enc'] - el
    enabled = [P_TERMS[name][0] for name in PHYSICAL]
    theirs = katpoint.PointingModel()

    def katpoint_fit():
        theirs.set()
        values, _ = theirs.fit(az, el, d_az, d_el, enabled_params=enabled,
                               keep_disabled_params=True)
        return np.array([values[p - 1] * sign for p, sign in P_TERMS.values()])

    candidates = {
        'katpoint PointingModel.fit': katpoint_fit,
        'fit_first_order': lambda: fit_first_order(az, el, x, y).coefficients,
        'fit_terms, first order, robust off': lambda: fit_terms(
            run, geometry='first_order', robust=False).coefficients,
        'fit_terms, rotations, robust off': lambda: fit_terms(run, robust=False).coefficients,
        'fit_terms, rotations, robust on': lambda: fit_terms(run).coefficients,
    }
    seconds = {label: [] for label in candidates}
    coefficients = {}
    for _ in range(repeats + 1):  # the first round warms up
        for label, call in candidates.items():
            start = time.perf_counter()
            for _ in range(calls):
                coefficients[label] = call()
            seconds[label].append((time.perf_counter() - start) / calls)
    reference = coefficients['katpoint PointingModel.fit']
    return [(label, float(np.median(s[1:])),
             float(np.abs(coefficients[label] - reference).max()) / ARCSEC)
            for label, s in seconds.items()], coefficients


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--repeats', type=int, default=30, help='for 30 stars (default 30)')
    parser.add_argument('--repeats-large', type=int, default=15,
                        help='for 100 000 stars (default 15)')
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    for n, repeats, calls in ((30, args.repeats, 20), (100_000, args.repeats_large, 1)):
        rows, coefficients = compare(n, repeats, calls, args.seed)
        base = rows[0][1]
        print(f'\n7-term fit of {n} stars, median of {repeats} interleaved rounds of {calls}')
        print(f'{"":36} {"ms":>9} {"katpoint / it":>14} {"largest difference":>19}')
        for label, seconds, difference in rows:
            print(f'{label:36} {seconds * 1e3:9.3f} {base / seconds:13.1f}x '
                  f'{difference:17.2e} "')
        print(f'{"arcsec":36} ' + ' '.join(f'{name:>10}' for name in PHYSICAL))
        for label in ('katpoint PointingModel.fit', 'fit_first_order'):
            print(f'{label:36} ' + ' '.join(
                f'{v:10.5f}' for v in coefficients[label] / ARCSEC))
        ratio = base / rows[1][1]
        print(f'fit_first_order is {ratio:.1f} times as fast (target {TARGET:g}): '
              f'{"reached" if ratio >= TARGET else "MISSED"}')


if __name__ == '__main__':
    main()
