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

"""Predictive model: predicts other stars of a mount as well as possible, and names no cause.

In addition to the terms it uses the effects of the dictionary, steps of the zeros between rows, and
slowly changing zeros. `estimation.predictor` fits several models with them, and averages these with
weights from cross-validation on blocks of time. All reported errors are cross-validated, with the
whole procedure repeated in each fold.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibration.estimation.folds import contiguous_folds, random_folds
from calibration.estimation.predictor import (
    BLOCKS,
    DIRECT,
    DRIVEN,
    LIVE,
    SLOW,
    STEP,
    PredictionProblem,
    Predictor,
    predictor,
    rows_left_out,
    terms_alone,
)
from msg_tools.units import ARCSEC, DEG
from pointing_model.context import Context
from pointing_model.effects import dictionary, direct, effect, steps
from pointing_model.effects.base import for_mount
from pointing_model.effects.drifts import clock
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.mounts import rows_by_side
from pointing_model.rms import Rms, rms_arcsec

from ..finding import Finding
from ..term_fit import rotation_start
from .base_terms import Base
from .observations import mount_of, observations
from .offered_effects import effect_bank

#: forms not used to predict: tan E is unbounded near the pole, where there are no rows; the turns
#: that wind up a cable are specific to a run
_FOR_A_CAUSE = ('off_axis', 'cable_drag')
FOLDS = 10
#: smallest squared share of a column not explained by the terms: less is rounding error
_DISTINCT = 1e-6
#: fewest rows in excess of the number of terms
_MORE_ROWS = 4
#: largest number of knots of a slow change, and its correlation time relative to the run length
_KNOTS, _MEMORY = 40, 0.05
#: drivers that keep growing after the run
_CLOCKS = ('time', 'order', 'run_hours')
#: grid over the sky: lowest and highest elevation, number of directions
_LOW, _HIGH, _SKY = 15.0 * DEG, 88.0 * DEG, 400
#: if nothing beyond the terms was found, effects are kept only if they raise the standard error of
#: a new star by at least this factor
_ADDED = 1.05
#: prediction is reported as better if its RMS is below this times that of the diagnosis
_BETTER = 0.95
#: quantile of the standard error over the sky that is reported as its poorly known part
_LEAST_KNOWN = 0.9


@dataclass
class PredictiveModel:
    """A predictive model and its cross-validated errors.

    Attributes
    ----------
    model, base_model : PointingModel
        The best predictor, and the terms alone.
    found : Predictor
    fitted : Rms
        Fit RMS of all rows of the run, with outliers, arcsec.
    blocks_before, blocks : Rms or None
        Cross-validated RMS of all rows on contiguous blocks of time, for the terms alone and for
        the model, arcsec.
    before, after : list of Rms
        The same on random folds, one for each partition.
    rows : int
    parts : list of dict
        Contribution of each effect beyond the terms, largest first: ``name``, ``columns``,
        ``rms_arcsec``, ``moves`` (whether it depends on anything but the direction).
    reach : dict
        ``noise_x_arcsec``, ``noise_y_arcsec`` of a star; the radial standard error of a new star:
        ``among_arcsec``, its median over the rows, and ``least_arcsec``, its 90 % quantile over
        the sky.
    timed : bool
        Whether rows have times; otherwise changes are modelled by row order.
    """

    model: PointingModel
    base_model: PointingModel
    found: Predictor
    fitted: Rms
    blocks_before: Rms | None
    blocks: Rms | None
    before: list
    after: list
    rows: int
    parts: list
    reach: dict
    timed: bool

    def coefficients(self):
        """``name``, ``tpoint``, ``value_arcsec``, ``sigma_arcsec`` of the effects' coefficients."""
        out = []
        for e in self.model.effects:
            names, tpoint = e.effect.coefficient_names, (e.effect.tpoint or '').split()
            tpoint = tpoint if len(tpoint) == len(names) else [None] * len(names)
            out += [{'name': e.effect.name if len(names) == 1 else f'{e.effect.name}: {name}',
                     'tpoint': term, 'value_arcsec': float(v / ARCSEC),
                     'sigma_arcsec': float(s / ARCSEC)}
                    for name, term, v, s in zip(names, tpoint, e.coefficients, e.sigma)]
        return out

    def findings(self):
        """Findings for users, list of Finding."""
        found, largest = self.found, [part['name'] for part in self.parts[:4]]
        out = [Finding('prediction', found.gain, found.gain_sigma, '',
                       before=self.blocks_before and self.blocks_before.radial,
                       after=self.blocks and self.blocks.radial,
                       evidence={'shares': found.shares, 'beyond': found.beyond,
                                 'largest': largest, 'timed': self.timed}),
               Finding('reach of a prediction', evidence=self.reach)]
        moved = [p for p in self.parts if p['moves']]
        if moved and not self.timed:
            out.append(Finding('prediction by order', max(p['rms_arcsec'] for p in moved)))
        return out


class _Columns:
    """Candidate effects and their columns, scaled by their RMS beyond the terms."""

    def __init__(self, obs, base):
        context, names = obs.context, obs.context.mount.names
        known, _ = dictionary(context, [t for t in names.physical if t not in base.terms], base.own)
        # exclude scanned effects: they are for finding causes, and have as many columns as rows
        known = [_held(e, context) for e in known
                 if e.share == 'dictionary' and e.form not in _FOR_A_CAUSE
                 and not e.driver.startswith('reading')]
        jumps, slow = steps(context), _slow_zeros(context, obs.label)
        self.effects = [*known, *jumps, *slow]
        kinds = ([DIRECT if direct(e) else DRIVEN for e in known] + [STEP] * len(jumps)
                 + [SLOW] * len(slow))
        bank = effect_bank(self.effects, context, sizes=False)
        sizes = [len(e.coefficient_names) for e in self.effects]
        self.effect = np.repeat(np.arange(len(self.effects)), sizes)
        kind = np.repeat(kinds, sizes).astype(int)
        axis = np.repeat([int(e.axes == 'el') for e in self.effects], sizes).astype(int)
        columns, terms = bank.columns, base.columns(context, obs.label).common
        given = np.ones(terms.shape[1]) if obs.inverse_sigma is None else obs.inverse_sigma
        basis = np.linalg.svd((terms * given / np.linalg.norm(terms * given, axis=1)[:, None]),
                              full_matrices=False)[2]
        weighed = columns * given
        own = np.square(weighed).sum(axis=1)
        left = np.square(weighed - (weighed @ basis.T) @ basis).sum(axis=1)
        mean = np.sqrt(left / np.square(given).sum() * 2.0)
        # the variance between the knots of a slow change has no column in the design
        slow_left = np.array([c == 'left' for e in self.effects for c in e.coefficient_names])
        self.scale = np.where(kind == SLOW, 1.0, 1.0 / np.where(mean > 0.0, mean, 1.0))
        self.keep = (left > _DISTINCT * own) & (own > 0.0) & ~slow_left
        self.kind, self.axis, self.columns, self.terms = kind, axis, columns, terms

    def problem(self, obs, left):
        """`PredictionProblem` for the residuals of exact rotations, in arcsec."""
        keep, sequence = self.keep, obs.sequence
        order = np.empty(len(obs))
        order[sequence.order] = np.arange(len(obs))
        return PredictionProblem(
            self.terms, self.columns[keep] * self.scale[keep, None], self.kind[keep],
            self.axis[keep], left / ARCSEC,
            None if obs.inverse_sigma is None else obs.inverse_sigma * ARCSEC, order,
            sequence.group)

    def fitted(self, found, p):
        """`FittedEffect` of each effect used, and the joint covariance, rad^2."""
        values, sizes = np.zeros(len(self.keep)), np.concatenate((np.ones(p), self.scale))
        values[self.keep] = found.coefficients[p:]
        values *= self.scale
        index = np.concatenate((np.arange(p), p + np.flatnonzero(self.keep)))
        joint = np.zeros((len(sizes), len(sizes)))
        joint[np.ix_(index, index)] = found.covariance
        joint *= sizes[:, None] * sizes * ARCSEC**2
        for one in np.flatnonzero((self.kind == SLOW) & ~self.keep):
            same = p + np.flatnonzero((self.effect == self.effect[one]) & self.keep)
            if len(same):  # the prior variance, which knots far from any row have, too
                joint[p + one, p + one] = joint[same, same].max()
        sigma, out, order = np.sqrt(np.maximum(np.diag(joint), 0.0)), [], list(range(p))
        for i, e in enumerate(self.effects):
            own = np.flatnonzero(self.effect == i)
            if (values[own] != 0.0).any() or (sigma[p + own] > 0.0).any():
                out.append(FittedEffect(e, values[own] * ARCSEC, sigma[p + own]))
                order += (p + own).tolist()
        return out, joint[np.ix_(order, order)]


def _held(one, context):
    """The effect itself; a drift with a clock is held constant outside the run."""
    if one.form != 'drift' or one.driver not in _CLOCKS:
        return one
    values = context.span(one.driver)[0]
    return effect(one.form, **{**one.parameters, 'within': [float(values.min()),
                                                            float(values.max())]})


def _slow_zeros(context, label):
    """Effects of slowly changing zeros; none where several runs have only the order of rows."""
    driver, _ = clock(context)
    values, reason = context.span(driver)
    if reason or (driver == 'order' and len(np.unique(label)) > 1) or len(np.unique(values)) < 6:
        return []
    knots = np.unique(np.quantile(values, np.linspace(0.0, 1.0, min(_KNOTS, len(values) // 2))))
    return for_mount([effect('slow_zero', axis=axis, knots=knots.tolist(), driver=driver,
                             memory=float(_MEMORY * np.ptp(values))) for axis in ('az', 'el')],
                     context.mount)


def prediction_problem(obs, base):
    """The `PredictionProblem`, its columns, and the terms of the initial rotations."""
    if len(obs) < len(base.terms) + _MORE_ROWS:
        raise ValueError(f'{len(obs)} usable observations are too few to predict with '
                         f'{len(base.terms)} terms; observe more, fit fewer terms, or leave out '
                         '--predict')
    start, left, _ = rotation_start(obs, base.terms)
    columns = _Columns(obs, base)
    return columns.problem(obs, left), columns, start


def better_prediction(run, rms):
    """Check, at the cost of one fit, whether a predictive model does better than a diagnosis.

    Parameters
    ----------
    run : RunProblem
    rms : float
        Radial RMS of the diagnosis, cross-validated on contiguous folds, without outliers, arcsec.

    Returns
    -------
    list of Finding
        Empty if it does not, or if runs have separate terms or only a sample of rows was searched.
    """
    obs, base = run.obs, run.base
    if base.own or base.degree or obs.whole or len(obs) < len(base.terms) + _MORE_ROWS:
        return []
    found = predictor(prediction_problem(obs, base)[0])
    after = rms_arcsec(*(found.blocks[1][:, found.weights > LIVE] * ARCSEC)).radial
    if not found.beyond or not after < _BETTER * rms:
        return []
    return [Finding('better prediction', before=rms, after=after)]


def predictive_model(runs, base='physical', *, encoder='enc', seed=0, folds=FOLDS, ways=1):
    """Fit the model that best predicts other stars of the mount.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
    base : str
        Terms that are always in the model, see `Base.parse`.
    encoder : {'enc', 'abs'}
    seed : int
        Seed of the first random partition; each further one adds 1.
    folds : int
    ways : int
        Number of random partitions; 0: no cross-validation, neither random nor in blocks.

    Returns
    -------
    PredictiveModel

    Raises
    ------
    ValueError
        Too few rows for the base.
    """
    obs, base = observations(runs, encoder), Base.parse(base, (), mount_of(runs))
    problem, columns, start = prediction_problem(obs, base)
    found = predictor(problem)
    p, unit = problem.p, ARCSEC
    effects, joint = columns.fitted(found, p)
    values = {t: start.get(t, 0.0) + v * unit for t, v in zip(base.terms, found.coefficients)}
    facts = {'method': 'prediction', 'source': obs.run.meta.get('source'), 'rows': len(obs),
             'encoder': obs.encoder, 'shares': found.shares,
             'star_noise_arcsec': (found.noise / np.median(problem.given.reshape(2, -1), axis=1)
                                   ).tolist()}
    mount = obs.run.mount
    model = PointingModel(values, joint[:p, :p], None, facts, 'rotation', effects, mount,
                          sides=rows_by_side(mount, obs.run['el']), joint=joint)
    if not found.beyond:
        model = _terms_alone(model, found, obs.context)
    alone = terms_alone(problem, np.ones(problem.n, bool))[0]
    base_model = replace(model, terms={t: start.get(t, 0.0) + v * unit
                                       for t, v in zip(base.terms, alone)},
                         covariance=None, effects=(), joint=None)
    before, after, blocks = [], [], [None, None]
    if ways:
        left, _ = rows_left_out(problem, contiguous_folds(problem.order, min(BLOCKS, problem.n)))
        blocks = [rms_arcsec(*(one * unit)) for one in left]
    for way in range(ways):
        left, _ = rows_left_out(problem, random_folds(problem.group, folds,
                                                      np.random.default_rng(seed + way)))
        before.append(rms_arcsec(*(left[0] * unit)))
        after.append(rms_arcsec(*(left[1] * unit)))
    fitted = rms_arcsec(*(problem.left(found.coefficients, np.arange(problem.n)) * unit))
    timed = obs.context.get('time') is not None
    return PredictiveModel(model, base_model, found, fitted, *blocks, before, after, len(obs),
                           _parts(model, obs.context, columns.terms),
                           _reach(model, obs.context), timed)


def _terms_alone(model, found, context):
    """Drop effects with zero coefficients if they hardly raise the standard error on the sky."""
    own = found.terms_covariance * ARCSEC**2
    alone = replace(model, covariance=own, effects=(), joint=None)
    with_effects, without = (_reach(m, context)['least_arcsec'] for m in (model, alone))
    return alone if with_effects is None or with_effects < _ADDED * without else model


def _parts(model, context, terms):
    """RMS contribution of each effect beyond the terms, largest first."""
    out = []
    for e in model.effects:
        offsets = np.ravel(e.offsets(context))
        share = np.linalg.lstsq(terms.T, offsets, rcond=1e-9)[0]
        x, y = (offsets - share @ terms).reshape(2, -1)
        out.append({'name': e.effect.name, 'columns': int(np.count_nonzero(e.coefficients)),
                    'moves': not direct(e.effect),
                    'rms_arcsec': float(np.sqrt(np.mean(x**2 + y**2)) / ARCSEC)})
    return sorted((one for one in out if one['columns']), key=lambda one: -one['rms_arcsec'])


def _reach(model, context):
    """Standard error of a new star, among the rows and over the sky."""
    noise = np.array(model.provenance['star_noise_arcsec']) * ARCSEC

    def radial(az, el, where):
        sx, sy = model.sigma(az, el, where)
        return np.sqrt(sx**2 + sy**2 + noise @ noise) / ARCSEC

    # directions spread evenly over the sky, with the median drivers of the run
    i = np.arange(_SKY) + 0.5
    el = np.arcsin(np.sin(_LOW) + (np.sin(_HIGH) - np.sin(_LOW)) * i / _SKY)
    az = np.mod(i * np.pi * (3.0 - np.sqrt(5.0)), 2.0 * np.pi)
    mount = context.mount
    if not mount.vertical:
        az, el = mount.axes_of(az, el)
    drivers = {name: np.full(_SKY, np.nanmedian(np.asarray(context.get(name), float)))
               for name in ('time', 'order', 'temperature') if context.get(name) is not None}
    sky = radial(az, el, Context(az, el, drivers, mount=mount))
    sky = sky[np.isfinite(sky)]
    among = radial(context.az, context.el, context)
    return {'noise_x_arcsec': float(noise[0] / ARCSEC), 'noise_y_arcsec': float(noise[1] / ARCSEC),
            'among_arcsec': float(np.nanmedian(among)),
            'least_arcsec': float(np.quantile(sky, _LEAST_KNOWN)) if len(sky) else None}
