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

"""Comparison of methods to predict held-out stars, on all measured telescopes.

    python benchmarks/league.py [--data FOLDER] [--only NAME] [--json FILE]
                                [--render FILE ...]

FOLDER holds the runs of `docs/measured_data.md`; absent ones are skipped. `--render` prints the
table of files written with `--json`, without fitting: the benchmark may be run in parts.

The rules below were fixed before the first run and not changed afterwards.

Rules. A telescope counts once, with the geometric mean of its runs. MMT, 8 m, 5 m, COATLI and Warp
Astron have one run, the IRAM 30 m has two; of the ARC 3.5 m every twelfth run with 40 rows or more
is used. Cross-validation with ten random folds (rows of one star within minutes together; seeds 0
and 1, averaged; the slow `cause` only seed 0), and with ten consecutive blocks in time, or in file
order if there are no times. Everything a method selects, it selects without the held-out fold. The
figure is the radial RMS on the sky of all usable rows, including outliers. Zeros and terms are the
seven physical ones of the mount everywhere.

Pool. All columns of the diagnosis's dictionary for the run (direction, time or order, temperature,
approach, columns of the file), without its steps and encoder subdivisions. It is the same for all
methods, each column scaled to its part orthogonal to the terms.

Methods, each as a careful user would apply it: `terms` (robust least squares), `katpoint` (its own
linear fit of the same seven terms, only alt-azimuth mounts), `greedy` (forward selection by BIC,
ordinary least squares), `ridge` and `lasso` (scikit-learn's RidgeCV and LassoCV, 15 and 50
strengths, five inner folds, on the residuals of the terms), `average` of greedy and ridge, `gp`
(scikit-learn's Gaussian process for each axis on the residuals of the terms: squared exponential in
the direction's three components and time, a length scale each, and white noise), `cause` (our
diagnosis, effects re-selected in each fold), `ours` (`fit --predict`). Published figures are listed
too; they are in-sample.

Compared: `ours` with the single method of best geometric mean over all telescopes (that it can
read), and with the best method on each telescope.
"""

import argparse
import json
import time
import warnings
from pathlib import Path

import numpy as np

from calibration.analysis.diagnosis.base_terms import Base
from calibration.analysis.diagnosis.observations import observations
from calibration.analysis.diagnosis.prediction import prediction_problem
from calibration.analysis.diagnosis.run_problem import RunProblem
from calibration.analysis.diagnosis.validation import nested
from calibration.analysis.sky_model import settled
from calibration.estimation.false_alarms import ALPHA
from calibration.estimation.folds import contiguous_folds, random_folds
from calibration.estimation.predictor import DRIVEN, rows_left_out
from calibration.estimation.shrinkage import Beyond, chosen
from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site
from telescope_mount.input_files.run_loader import load_run

ROOT = Path(__file__).resolve().parent.parent
FOLDS, SEEDS = 10, (0, 1)
#: rows of a run of the ARC 3.5 m, and which of them are taken
ARC_ROWS, ARC_EACH = 40, 12
COATLI = {'site': Site(31.0455305556 * DEG, -115.4669 * DEG, 2790.0),
          'weather': Weather(720.0, 8.0)}
METHODS = ('terms', 'katpoint', 'greedy', 'ridge', 'lasso', 'average', 'gp', 'cause', 'ours')
PUBLISHED = {'8 m': 'TPOINT 1.01, 18 terms', '5 m': 'TPOINT 1.65, 14 terms',
             'ARC 3.5 m': 'TPOINT 5.65, 6 terms, one run',
             'COATLI': 'owners 5.4 and 6.1, 17 terms a side',
             'MMT': '', 'Warp Astron': '', 'IRAM 30 m': 'observers 2.30 az, 2.51 el, of one'}


def runs_of(folder):
    """Telescope -> list of (name, file, options)."""
    return {
        'MMT': [(path.stem, path, {}) for path in [folder / 'mmt' / 'point_20210821.dat']],
        '8 m': [('pmfit_altaz', folder / 'spk8m' / 'pmfit_altaz.dat', {})],
        '5 m': [('pmfit_equat', folder / 'spk5m' / 'pmfit_equat.dat', {})],
        'COATLI': [('20211103b', folder / 'coatli' / '20211103b.txt', COATLI)],
        'Warp Astron': [('warp-astron', folder / 'warp_astron' / 'warp-astron.dat', {})],
        'IRAM 30 m': [(p.stem, p, {}) for p in sorted((folder / 'iram30m').glob('*.log'))],
        'ARC 3.5 m': [(p.stem, p, {}) for p in arc(folder)],
    }


def arc(folder):
    """Every twelfth of the runs that are long enough."""
    long = []
    for path in sorted((folder / 'arc35m').glob('*.dat')):
        try:
            if len(load_run(path)) >= ARC_ROWS:
                long.append(path)
        except ValueError:
            continue
    return long[::ARC_EACH]


class League:
    """A run with its pool, and each method on held-out rows."""

    def __init__(self, path, options):
        run = load_run(path, **options)
        run, _ = settled(run, run.mount.names.physical)
        self.obs = observations(run)
        self.base = Base.parse('physical', (), run.mount)
        self.problem, self.columns, _ = prediction_problem(self.obs, self.base)
        pool = self.problem.kind <= DRIVEN
        self.n, self.terms = len(self.obs), self.problem.base
        self.pool, self.b = self.problem.others[pool], self.problem.b
        self.time = self.problem.order / max(self.n - 1, 1)
        if self.obs.context.get('time') is not None:
            at = np.asarray(self.obs.context.get('time'), float)
            self.time = (at - at.min()) / max(np.ptp(at), 1e-9)

    def folds(self, kind, seed):
        if kind == 'blocks':
            return contiguous_folds(self.problem.order, FOLDS)
        return random_folds(self.problem.group, FOLDS, np.random.default_rng(seed))

    def rms(self, method, folds, seed):
        """Cross-validated radial RMS of all rows, arcsec; None if the method is not applicable."""
        if method in ('terms', 'ours'):
            left, _ = rows_left_out(self.problem, folds)
            return _rms(left[int(method == 'ours')])
        if method == 'cause':
            run = RunProblem(self.obs, self.base, alpha=ALPHA)
            left, _ = nested(run.problem, folds, ALPHA, np.random.default_rng(seed))
            return _rms(left[-1] / ARCSEC)
        if method == 'katpoint' and not self.obs.run.mount.vertical:
            return None
        left = np.empty(2 * self.n)
        for fold in folds:
            train = np.setdiff1d(np.arange(self.n), fold)
            rows, test = (np.concatenate((of, of + self.n)) for of in (train, fold))
            left[test] = self.b[test] - _METHODS[method](self, train, rows, test)
        return _rms(left.reshape(2, -1))

    def partial(self, rows, test):
        """Of the rows' terms alone: what they leave, the pool beyond them, and at the test rows
        the prediction and the pool beyond.
        """
        q = np.linalg.lstsq(self.terms[:, rows].T, np.column_stack(
            (self.b[rows], self.pool[:, rows].T)), rcond=None)[0]
        known, across = q[:, 0], q[:, 1:]
        return (self.b[rows] - known @ self.terms[:, rows],
                self.pool[:, rows].T - self.terms[:, rows].T @ across,
                known @ self.terms[:, test],
                self.pool[:, test].T - self.terms[:, test].T @ across)


def _rms(residual):
    return float(np.sqrt(np.mean(np.square(residual).sum(axis=0))))


def _katpoint(run, train, rows, test):
    import katpoint
    from fit_vs_katpoint import P_TERMS

    obs = run.obs
    az, el = obs.context.az, obs.context.el
    x, y = obs.observed.reshape(2, -1)
    model = katpoint.PointingModel()
    values, _ = model.fit(az[train], el[train], x[train] / np.cos(el[train]), y[train],
                          enabled_params=[number for number, _ in P_TERMS.values()],
                          keep_disabled_params=False)
    model = katpoint.PointingModel(np.asarray(values))
    fold = test[:len(test) // 2]
    dx, dy = model.offset(az[fold], el[fold])
    # what the league's offsets are beyond, at the same rows
    whole = np.concatenate((dx * np.cos(el[fold]), dy)) / ARCSEC
    observed = np.concatenate((x[fold], y[fold])) / ARCSEC
    return run.b[test] - (observed - whole)


def _greedy(run, train, rows, test):
    columns = np.vstack((run.terms, run.pool, run.b))[:, rows]
    beyond = Beyond.of(columns, len(run.terms), np.ones(len(rows)), np.ones(len(train)))
    found = beyond.whole(chosen(beyond, np.ones(len(run.pool), bool), 1.0))[0]
    return found @ np.vstack((run.terms, run.pool))[:, test]


def _penalised(make):
    def predict(run, train, rows, test):
        left, pool, known, at = run.partial(rows, test)
        scale = pool.std(axis=0)
        good = scale > 1e-6
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            # of a row both axes are in one inner fold
            groups = np.tile(np.arange(len(train)), 2)
            fitted = make(groups).fit(pool[:, good] / scale[good], left)
        return known + fitted.predict(at[:, good] / scale[good])
    return predict


def _inner(groups):
    from sklearn.model_selection import GroupKFold
    return list(GroupKFold(5).split(groups, groups=groups))


def _ridge(groups):
    from sklearn.linear_model import RidgeCV
    return RidgeCV(np.logspace(-3, 4, 15), fit_intercept=False, cv=_inner(groups))


def _lasso(groups):
    from sklearn.linear_model import LassoCV
    return LassoCV(alphas=50, fit_intercept=False, cv=_inner(groups), max_iter=3000, tol=1e-3)


def _gp(run, train, rows, test):
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    left, _, known, _ = run.partial(rows, test)
    where = np.column_stack((run.obs.context.direction().T, run.time))
    fold, out = test[:len(test) // 2], []
    for values in left.reshape(2, -1):
        size = values.std() + 1e-9
        kernel = ConstantKernel(1.0) * RBF([1.0] * 4, (0.02, 100.0)) + WhiteKernel(0.3, (1e-4, 10))
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            fitted = GaussianProcessRegressor(kernel, random_state=0).fit(
                where[train], values / size)
        out.append(fitted.predict(where[fold]) * size)
    return known + np.concatenate(out)


def _average(run, train, rows, test):
    return 0.5 * (_greedy(run, train, rows, test) + _METHODS['ridge'](run, train, rows, test))


_METHODS = {'katpoint': _katpoint, 'greedy': _greedy, 'ridge': _penalised(_ridge),
            'lasso': _penalised(_lasso), 'gp': _gp, 'average': _average}


def measure(folder, only, methods, say=print):
    """Telescope -> run -> method -> [random, blocks], arcsec."""
    out = {}
    for telescope, runs in runs_of(folder).items():
        for name, path, options in runs:
            if not f'{telescope} {name}'.lower().startswith(only.lower()) or not path.is_file():
                continue
            league, entry, begin = League(path, options), {}, time.process_time()
            for method in methods:
                each = [league.rms(method, league.folds('random', seed), seed)
                        for seed in SEEDS[:1 if method == 'cause' else None]]
                entry[method] = None if None in each else [
                    float(np.mean(each)), league.rms(method, league.folds('blocks', 0), 0)]
            out.setdefault(telescope, {})[name] = entry
            say(f'<!-- {telescope} {name}: {league.n} rows, '
                f'{time.process_time() - begin:.0f} s -->', flush=True)
    return out


def table(found):
    """The comparison as Markdown lines."""
    rows, methods = {}, [m for m in METHODS if any(
        m in entry for runs in found.values() for entry in runs.values())]
    for telescope, runs in found.items():
        if not all(entry.get('ours') for entry in runs.values()):
            continue  # measured in part
        rows[telescope] = {m: np.exp(np.mean([np.log(entry[m]) for entry in runs.values()], axis=0))
                           if all(entry.get(m) for entry in runs.values()) else None
                           for m in methods}
    yield '| random / blocks, arcsec | ' + ' | '.join(methods) + ' | published, in sample |'
    yield '| --- ' * (len(methods) + 2) + '|'
    for telescope, row in rows.items():
        yield f'| {telescope} | ' + ' | '.join(
            '-' if row[m] is None else f'{row[m][0]:.2f} / {row[m][1]:.2f}' for m in methods
        ) + f' | {PUBLISHED.get(telescope, "")} |'
    best = {t: np.min([row[m] for m in methods if row[m] is not None and m != 'ours'], axis=0)
            for t, row in rows.items()}
    ratios = {m: [row['ours'] / row[m] for row in rows.values() if row[m] is not None]
              for m in methods}
    yield '| ours over it, geometric mean | ' + ' | '.join('{:.2f} / {:.2f}'.format(
        *np.exp(np.mean(np.log(ratios[m]), axis=0))) if ratios[m] else '-'
        for m in methods) + ' | |'
    own = np.array([rows[t]['ours'] / best[t] for t in rows])
    yield ''
    yield ('ours over the best of all others on each telescope, random / blocks: geometric mean '
           '{:.2f} / {:.2f}; largest {:.2f} / {:.2f}'.format(
               *np.exp(np.log(own).mean(axis=0)), *own.max(axis=0)))


def main():
    """Measure, or print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--data', type=Path, default=ROOT.parent / 'shared' / 'data')
    parser.add_argument('--only', default='', help='telescopes that begin so')
    parser.add_argument('--methods', nargs='+', default=METHODS, choices=METHODS)
    parser.add_argument('--json', type=Path)
    parser.add_argument('--render', type=Path, nargs='+', help='files of --json, put together')
    args = parser.parse_args()
    if args.render:
        found = {}
        for path in args.render:
            for telescope, runs in json.loads(path.read_text()).items():
                for name, entry in runs.items():
                    found.setdefault(telescope, {}).setdefault(name, {}).update(entry)
    else:
        found = measure(args.data, args.only, args.methods)
        if args.json:
            args.json.write_text(json.dumps(found, indent=1))
    if args.render or 'ours' in args.methods:
        print('\n'.join(table(found)))


if __name__ == '__main__':
    main()
