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

"""Why the zero differs between power-ons: temperature, supply voltage, time since the last, side.

Paper 000 names temperature and supply voltage as causes of motion of the reference mark. Here the
zeros of a season, one per power-on, are regressed on values measured when the marks were met (with
the tests of `covariate_choice`). If they depend on a covariate, the zero of tonight can be
predicted, with its error, before Polaris is measured.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import rms

from ...estimation.covariate_choice import CovariateChoice, choose_covariates, fewest_epochs
from ...estimation.extra_scatter import are_borne_out, whitening
from ...estimation.step_scan import student_factor
from ...rows import floored
from ..finding import Finding, far_outside

AXES = ('azimuth', 'elevation')
#: covariate -> (unit, the least standard deviation over the nights that counts)
COVARIATES = {
    'temperature': ('°C', 0.3),
    'supply': ('V', 0.01),
    'hours': ('h', 0.1),
    'side': ('side', 0.1),
}
#: false-alarm probability: zeros without a cause are given one
ZERO_ALPHA = 0.02
CAUSE, INCONCLUSIVE, NOTHING = 'cause', 'undecided', 'nothing'
#: largest share of nights with an unknown value of a covariate
_UNKNOWN = 0.3
#: fewest power-ons to reject outliers among them; their threshold, in sigmas of the prediction from
#: the others; smallest sigma, rad
_FEWEST, _ODD, _LEAST = 8, 10.0, ARCSEC
_ROUNDS = 50


@dataclass(frozen=True)
class Season:
    """Zeros of power-ons in order of time, and covariates measured when the marks were met.

    Parameters
    ----------
    run : ndarray, shape (n,)
        Numbers of the power-ons.
    time : ndarray, shape (n,)
        Times, s; if not all are known, the order is used.
    zeros, sigmas : ndarray, shape (n, 2)
        Azimuth and elevation (coordinate angles) from one common origin, and their errors, rad. The
        weights use these errors and an additional scatter. NaN: the median error of the others.
    covariates : dict of str to ndarray, shape (n, 2)
        For each name in `COVARIATES` the values of both axes; NaN where unknown.
    """

    run: np.ndarray
    time: np.ndarray
    zeros: np.ndarray
    sigmas: np.ndarray
    covariates: dict

    def __len__(self):
        return len(self.run)

    def select(self, rows):
        """The season with only `rows` (a mask, indices or a slice)."""
        return Season(self.run[rows], self.time[rows], self.zeros[rows], self.sigmas[rows],
                      {name: values[rows] for name, values in self.covariates.items()})


@dataclass(frozen=True)
class _Line:
    """Linear fit: zero of an axis = level + slopes · covariates, with `weights` of mean 1."""

    names: tuple
    origin: np.ndarray
    level: float
    slopes: np.ndarray
    inverse: np.ndarray  # of the normal matrix, (k, k)
    n: int
    rms: float  # unexplained, of one night of weight 1
    dof: int
    weights: np.ndarray

    def at(self, values):
        """Predicted zero and its 1 sigma for covariates `values`, shape (k,)."""
        away = values - self.origin
        leverage = 1.0 + 1.0 / self.n + away @ self.inverse @ away
        return (self.level + float(away @ self.slopes),
                float(self.rms * np.sqrt(leverage) * student_factor(max(self.dof, 1))))


def _fit(season, axis, names):
    zeros = season.zeros[:, axis]
    values = np.array([season.covariates[name][:, axis] for name in names])
    values = values.reshape(len(names), len(zeros))
    middle = (values - values.mean(axis=1, keepdims=True)).T
    weights = np.square(np.diag(whitening(
        zeros, np.column_stack([np.ones(len(zeros)), middle]), _variances(season)[:, axis])))
    weights /= weights.mean()
    origin = np.average(values, axis=1, weights=weights)
    design = (values - origin[:, np.newaxis]).T
    weighted = weights * design.T
    inverse = np.linalg.pinv(weighted @ design) if names else np.zeros((0, 0))
    level = float(np.average(zeros, weights=weights))
    slopes = inverse @ weighted @ (zeros - level)
    left = zeros - level - design @ slopes
    dof = len(zeros) - 1 - len(names)
    rms = float(np.sqrt(weights @ np.square(left) / dof)) if dof > 0 else np.nan
    return _Line(tuple(names), origin, level, slopes, inverse, len(zeros), rms, dof, weights)


def _variances(season):
    """Variances of the zeros, shape (n, 2); unknown errors are the median of the others."""
    out = np.zeros(season.sigmas.shape)
    for axis, sigmas in enumerate(season.sigmas.T):
        known = np.isfinite(sigmas) & (sigmas > 0.0)
        if known.any():
            out[:, axis] = np.square(floored(np.where(known, sigmas, np.median(sigmas[known]))))
            if np.ptp(out[:, axis]) > 0.0 and not are_borne_out(
                    season.zeros[:, axis], _lines(season, axis), out[:, axis]):
                out[:, axis] = out[:, axis].mean()  # the scatter does not follow the given errors
    return out


def _lines(season, axis):
    """Design matrix: level, and as many known covariates as nights allow, shape (n, k)."""
    n = len(season)
    known = [of[:, axis] - of[:, axis].mean() for of in season.covariates.values()
             if np.isfinite(of[:, axis]).all()]
    return np.column_stack([np.ones(n), *known[:max(n // 3 - 1, 0)]])


def usable_covariates(season):
    """Covariates that can be tested, and why the others cannot.

    Parameters
    ----------
    season : Season

    Returns
    -------
    names : list of str
    why : list of Finding
        One on each of the other `COVARIATES`.
    """
    names, why = [], []
    for name, (unit, least) in COVARIATES.items():
        values = season.covariates.get(name)
        known = np.isfinite(values).all(axis=1) if values is not None and len(season) else None
        if known is None or not known.any():
            why.append(Finding('covariate unknown', causes=(name,)))
        elif np.mean(~known) > _UNKNOWN:
            why.append(Finding('covariate unknown', int(np.sum(~known)), unit='nights',
                               causes=(name,), evidence={'nights': len(season)}))
        elif values[known].std(axis=0).max() < least:
            spread = values[known].std(axis=0).max()
            why.append(Finding('covariate constant', float(spread), unit=unit, causes=(name,)))
        else:
            names.append(name)
    return names, why


def _complete(season, names):
    good = np.isfinite(season.zeros).all(axis=1)
    for name in names:
        good &= np.isfinite(season.covariates[name]).all(axis=1)
    return season.select(good)


def _without_odd(season, names):
    """The season without outlying power-ons, and a Finding on each.

    A wrong star or missed marks depend on no covariate, and one hides all causes. Outliers up to
    the last power-on are kept: they may be a lasting step.
    """
    n = len(season)
    if n < _FEWEST:
        return season, []
    out, (offs, times) = np.zeros(n, bool), np.empty((2, 2, n))
    for axis in range(2):
        far = _far(season, axis, names)
        line = _fit(season.select(~far), axis, names)
        values = np.array([season.covariates[name][:, axis] for name in names]).reshape(-1, n)
        expected, sigma = np.transpose([line.at(one) for one in values.T])
        off = season.zeros[:, axis] - expected
        error = np.hypot(np.hypot(sigma, np.nan_to_num(season.sigmas[:, axis])), _LEAST)
        offs[axis], times[axis] = off, np.abs(off) / error
        out |= far & (times[axis] > _ODD)
    out &= np.cumsum(~out[::-1])[::-1] > 0
    if not out.any() or out.sum() > n // 3:
        return season, []
    found = []
    for night in np.flatnonzero(out):
        axis = int(np.argmax(times[:, night]))
        found.append(Finding('odd power-on', float(offs[axis, night]) / ARCSEC, evidence={
            'run': int(season.run[night]), 'axis': AXES[axis],
            'times': float(times[axis, night])}))
    return season.select(~out), found


def _far(season, axis, names):
    """Which zeros are far from a least absolute deviations fit, ndarray of bool, shape (n,)."""
    n = len(season)
    design = np.array([np.ones(n), *(season.covariates[name][:, axis] for name in names)])
    design[1:] -= design[1:].mean(axis=1, keepdims=True)
    design /= np.linalg.norm(design, axis=1, keepdims=True) + 1e-300
    zeros = season.zeros[:, axis] / ARCSEC
    left = zeros - np.median(zeros)
    for _ in range(_ROUNDS):
        root = 1.0 / np.sqrt(np.maximum(np.abs(left), 1e-6))
        left = zeros - np.linalg.lstsq((design * root).T, zeros * root)[0] @ design
    # skip the smallest residuals: the fit passes through that many points
    scatter = 1.4826 * np.median(np.sort(np.abs(left))[len(design):])
    return np.abs(left) > _ODD * max(scatter, _LEAST / ARCSEC)


_NO_CHOICE = CovariateChoice(*[((), ())] * 3, np.ones(2), np.ones(2))


def _choice(season, names, alpha, seed):
    if not names:
        return _NO_CHOICE
    covariates = np.array([season.covariates[name] for name in names])
    still = np.ptp(covariates, axis=1).max(axis=-1) <= 0.0  # may happen without one night
    moving = [i for i in range(len(names)) if not still[i]]
    when = season.time
    if not (np.isfinite(when).all() and np.all(np.diff(when) > 0.0)):
        when = np.arange(float(len(season)))  # use their order
    found = choose_covariates(season.zeros, covariates[moving], when, alpha, seed=seed,
                              variances=_variances(season))

    def named(places):
        return tuple(tuple(names[moving[i]] for i in axis) for axis in places)
    return found._replace(causes=named(found.causes), alike=named(found.alike),
                          trend=named(found.trend))


def _left_out(season, names, alpha, seed):
    """Leave-one-out errors of the zeros without and with causes, (n, 2) each.

    The causes are selected again without that night.
    """
    before, after = np.empty((2, len(season), 2))
    everyone = np.arange(len(season))
    for night in everyone:
        others = season.select(everyone != night)
        causes = _choice(others, names, alpha, seed).causes
        for axis in range(2):
            line = _fit(others, axis, causes[axis])
            values = np.array([season.covariates[n][night, axis] for n in causes[axis]])
            before[night, axis] = season.zeros[night, axis] - _fit(others, axis, ()).level
            after[night, axis] = season.zeros[night, axis] - line.at(values)[0]
    return before, after


def zero_causes(season, tonight=None, alpha=ZERO_ALPHA, *, leave_out=True, seed=1):
    """Find causes of the zeros of power-ons, and predict the zero of tonight.

    Parameters
    ----------
    season : Season
        Power-ons with a zero.
    tonight : dict of str to array_like, shape (2,), optional
        The covariates of a power-on whose zero is not measured yet.
    alpha : float
        Family-wise false-alarm probability over all covariates and both axes.
    leave_out : bool
        Whether to cross-validate: each night predicted from the others, causes selected anew.
    seed : int
        Seed of the permutations.

    Returns
    -------
    dict
        JSON-ready except for findings. ``verdict`` (`CAUSE`, `INCONCLUSIVE` or `NOTHING`) and
        ``text``; ``nights``, ``left_out`` (numbers of power-ons with an unknown covariate), ``odd``
        (findings on rejected outliers), ``drivers`` (covariates tested), ``not_tried`` (findings),
        ``p`` over all covariates and both axes. ``axes``: for each ``verdict``, ``text``, ``p``,
        ``p_levels`` (for the zeros themselves only, not their changes), ``causes`` (``driver``,
        ``slope_arcsec``, ``sigma_arcsec`` per ``unit``), ``alike``, ``std_arcsec`` of the zeros,
        ``measured_arcsec`` (RMS of their errors), ``unexplained_arcsec``, and, if cross-validated,
        ``left_out_before_arcsec`` and ``left_out_after_arcsec`` (RMS). ``tonight``: None, or for
        each axis ``zero_arcsec``, ``sigma_arcsec``, the causes ``by`` which it is predicted and
        those ``missing``; ``far``: findings on causes tonight far outside the measured ones.
    """
    names, why = usable_covariates(season)
    complete = _complete(season, names)
    used, odd = _without_odd(complete, names)
    enough = len(used) >= fewest_epochs(alpha)
    found = _choice(used, names, alpha, seed) if enough else _NO_CHOICE
    lines = [_fit(used, axis, found.causes[axis]) for axis in range(2)] if len(used) > 1 else None
    errors = _left_out(used, names, alpha, seed) if leave_out and enough else None
    axes = {}
    for axis, name in enumerate(AXES):
        axes[name] = _axis(axis, found, lines and lines[axis], used, names, enough, errors)
    verdicts = [axis['verdict'] for axis in axes.values()]
    verdict = next((v for v in (CAUSE, INCONCLUSIVE) if v in verdicts), NOTHING)
    out = {
        'verdict': verdict, 'nights': len(used), 'alpha': alpha,
        'left_out': sorted({int(r) for r in season.run} - {int(r) for r in complete.run}),
        'odd': odd,
        'drivers': names, 'not_tried': why,
        'p': float(found.p.min()) if enough and names else None, 'axes': axes,
        'tonight': None, 'far': [],
    }
    if not enough:
        out['text'] = Finding('few power-ons', len(used), unit='power-ons', evidence={
            'needed': fewest_epochs(alpha), 'incomplete': max(len(season) - len(complete), 0)})
    else:
        out['text'] = Finding('causes of zeros', evidence={
            'not_tried': why if not names else [],
            'axes': {name: axis['text'] for name, axis in axes.items()}})
    if tonight is not None and lines:
        means = [_fit(used, axis, ()) for axis in range(2)]
        tonight = {n: np.broadcast_to(tonight.get(n, np.nan), 2) for n in COVARIATES}
        out['tonight'] = _expected(lines, means, tonight)
        out['far'] = [found for axis, line in enumerate(lines) for name in line.names
                      for found in far_outside(f'{name} ({AXES[axis]})', tonight[name][axis],
                                               used.covariates[name][:, axis])]
    return out


def _axis(axis, found, line, used, names, enough, errors):
    """Entry of one axis; see `zero_causes`."""
    causes, alike, trend = (part[axis] for part in (found.causes, found.alike, found.trend))
    verdict = CAUSE if causes else INCONCLUSIVE if alike or trend else NOTHING
    known = line is not None and line.dof > 0
    tested = enough and names
    out = {
        'verdict': verdict, 'p': float(found.p[axis]) if tested else None,
        'p_levels': float(found.p_levels[axis]) if tested else None,
        'causes': [], 'alike': list(alike or trend),
        'std_arcsec': _fit(used, axis, ()).rms / ARCSEC if known else None,
        'measured_arcsec': rms(used.sigmas[:, axis]) / ARCSEC
        if known and np.isfinite(used.sigmas[:, axis]).all() else None,
        'unexplained_arcsec': line.rms / ARCSEC if known else None,
    }
    if causes:
        sigma = line.rms * np.sqrt(np.diag(line.inverse)) * student_factor(line.dof)
        out['causes'] = [
            {'driver': name, 'unit': COVARIATES[name][0], 'slope_arcsec': float(slope) / ARCSEC,
             'sigma_arcsec': float(s) / ARCSEC}
            for name, slope, s in zip(line.names, line.slopes, sigma)]
        out['text'] = Finding(
            'zero follows', out['std_arcsec'], causes=causes, after=out['unexplained_arcsec'],
            evidence={'slopes': out['causes'], 'p': out['p']})
    else:
        out['text'] = Finding('covariates alike' if alike else 'common trend' if trend else
                              'zero follows nothing', causes=alike or trend)
    if errors is not None:
        out['left_out_before_arcsec'], out['left_out_after_arcsec'] = (
            rms(np.sqrt(line.weights) * e[:, axis]) / ARCSEC for e in errors)
    return out


def _expected(lines, means, tonight):
    """Zero of tonight predicted from its covariates, for each axis in arcsec with 1 sigma.

    ``by`` are the causes used. Without any, or if tonight's value of a cause is unknown
    (``missing``), the prediction is the mean of the nights with the scatter of the zeros.
    """
    out = {}
    for axis, (name, line, mean) in enumerate(zip(AXES, lines, means)):
        known = {n: float(tonight[n][axis]) for n in line.names}
        missing = [n for n, value in known.items() if not np.isfinite(value)]
        line = mean if missing else line
        value, sigma = line.at(np.array([known[n] for n in line.names]))
        out[name] = {'zero_arcsec': value / ARCSEC,
                     'sigma_arcsec': sigma / ARCSEC if np.isfinite(sigma) else None,
                     'by': list(line.names), 'missing': missing}
    return out
