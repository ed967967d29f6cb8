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


"""Exact fits of a run without and with the effects found, and the resulting models."""

from dataclasses import replace

import numpy as np

from calibration.estimation.correlated_noise import CorrelatedNoise, WhiteNoise
from calibration.estimation.estimate import Estimate
from calibration.estimation.robust import bisquare
from msg_tools.units import ARCSEC
from pointing_model.fitted_effects import FittedEffect
from pointing_model.harmonics import Harmonics
from pointing_model.model import PointingModel
from pointing_model.mounts import rows_by_side
from pointing_model.rms import radial_arcsec, sigma_of

from ..finding import Finding
from ..term_fit import after_rotation

_MORE = 1.02  # reported: ratio of the fit RMS with a model of correlated noise to that without it


def _rotation_fit(obs, base, design, start, left, weights, scatter, noise, true_noise=None):
    """Fit exact rotations together with the effects, by iteration.

    Parameters
    ----------
    obs : Observations
    base : Base
    design : GroupColumns
        Columns of the base and the effects.
    start : dict of str to float
        Initial terms of the rotations.
    left : ndarray, shape (2n,)
        Residuals of these rotations.
    weights : ndarray, shape (n,)
        Weights of the rows.
    scatter : ndarray, shape (2,)
        Scatter of the axes.
    noise : WhiteNoise or CorrelatedNoise
        With these weights and that scatter.
    true_noise : WhiteNoise or CorrelatedNoise, optional
        Noise model for the covariance, if different.

    Returns
    -------
    Estimate
        The common coefficients, then those of each run; covariance of the common ones only.
    """
    common, geometric = base.common, _geometric(obs, base)
    solve, start = design.solver(noise), dict(start)
    for _ in range(4):
        p, own = solve(left)
        residual = left - np.append(p, own) @ design
        step = p[geometric].copy()
        # move the corrections of the geometric terms into the rotations
        for i, d in zip(geometric, step):
            start[common[i]] += d
        if not geometric or np.abs(step).max() < 1e-5 * ARCSEC:
            break
        left, _ = after_rotation(obs, start)
    p[geometric] = [start[common[i]] for i in geometric]
    inverse = solve.inverse if true_noise is None else solve.inverse_under(true_noise)
    return Estimate(np.append(p, own), inverse, np.full(len(p), np.inf), tuple(scatter), residual,
                    weights, len(design), robust=True)


def _geometric(obs, base):
    """Indices of the common terms that are rotations of the mount."""
    return [i for i, t in enumerate(base.common) if t in obs.context.mount.names.terms]


def exact_fit(run, chosen, fit, true_noise=None):
    """`_rotation_fit` of a choice to the rows of a `RunProblem` with weights of a `WeightedFit`."""
    return _rotation_fit(run.obs, run.base, run.problem.design(chosen), run.start, run.problem.b,
                     fit.weights, fit.scale, fit.noise, true_noise)


def choice_fit(run, chosen, correlation):
    """The exact fit of a choice, and the weighted fit that gives its weights and noise.

    Parameters
    ----------
    run : RunProblem
    chosen : list of CandidateGroup
    correlation : ResidualCorrelation or None
        Correlation of the residuals. Noise correlated along the sky cannot be distinguished from a
        function of direction: then the terms are fitted with white noise, and only their covariance
        uses the correlated noise.

    Returns
    -------
    Estimate, WeightedFit
    """
    plain = run.problem.plain.fit(chosen, final=True)
    if correlation is None:
        return exact_fit(run, chosen, plain), plain
    fit = run.problem.fit(chosen, final=True)
    return (exact_fit(run, chosen, plain, fit.noise) if correlation.along_the_sky else
            exact_fit(run, chosen, fit)), fit


def exact_fits(run, choice, correlation):
    """The exact fits without and with the effects; sets `choice.fit` to the fit with them.

    The fit without the effects uses white noise: there the effects themselves look like correlated
    noise. Without any effect both fits are the same.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    correlation : ResidualCorrelation or None
        See `choice_fit`.

    Returns
    -------
    tuple of Estimate
    """
    fitted, choice.fit = choice_fit(run, choice.chosen, correlation)
    if correlation is not None and not choice.chosen:
        return fitted, fitted
    return exact_fit(run, [], run.problem.plain.fit([], final=True)), fitted


def whole_fit(run, fitted, chosen, correlation, memory):
    """`_rotation_fit` of all rows, where only a sample of them was searched.

    Robust weights come from the residuals of the fit to the sample.

    Parameters
    ----------
    run : RunProblem
    fitted : Estimate
        Fit to the sample.
    chosen : list of CandidateGroup
    correlation : ResidualCorrelation or None
        See `choice_fit`.
    memory : tuple of AxisNoise
        Correlated noise of the sample.

    Returns
    -------
    Estimate
    """
    whole, base, n = run.obs.whole, run.base, len(run.obs.whole)
    design = base.columns(whole.context, whole.label).beside(
        *(c.effect(run.problem).columns(whole.context).reshape(-1, 2 * n) for c in chosen))
    turned = dict(zip(base.common, fitted.coefficients))
    start = run.start | {base.common[i]: turned[base.common[i]] for i in _geometric(whole, base)}
    left, _ = after_rotation(whole, start)
    p = fitted.coefficients.copy()
    p[_geometric(whole, base)] = 0.0  # they are in the rotations
    given = np.ones(2 * n) if whole.inverse_sigma is None else whole.inverse_sigma
    standard = ((left - p @ design) * given).reshape(2, n)
    middle = np.maximum(sigma_of(standard, axis=1), 1e-6 * ARCSEC)
    weights = bisquare(np.hypot(*(standard / middle[:, None])))
    scale = np.sqrt((weights * standard**2).sum(axis=1) / weights.sum()) + 1e-9 * ARCSEC
    white = WhiteNoise(given * np.tile(np.sqrt(weights), 2) / np.repeat(scale, n))
    noises = [white]
    if memory:
        noises += [CorrelatedNoise.beside(white, scale, whole.sequence, memory)]
    along = correlation is not None and correlation.along_the_sky
    return _rotation_fit(whole, base, design, start, left, weights, scale,
                     *(noises if along else noises[-1:]))


def exact_models(run, choice, fits, correlation):
    """The models without and with the effects, fitted to all rows, and the terms of each run.

    They include, and mark, the terms held at zero because the stars do not determine them.

    Parameters
    ----------
    run, choice, correlation
        See `exact_fits`.
    fits : tuple of Estimate
        Result of `exact_fits`.

    Returns
    -------
    list of (PointingModel, dict)
        Without and with the effects.
    """
    fitted = [*zip(fits, ([], choice.chosen))]
    if run.obs.whole:
        memory = choice.fit.memory
        fitted = [(whole_fit(run, fit, chosen, correlation, memory if fit is fits[1] else ()),
                   chosen) for fit, chosen in fitted]
    models = [exact_model(run, *each) for each in fitted]
    if run.undetermined is None:
        return models
    return [(_with_held_terms(model, run.undetermined), run_terms) for model, run_terms in models]


def exact_model(run, fitted, chosen):
    """Convert an exact fit of a choice to a model.

    Returns
    -------
    model : PointingModel
        With the effects.
    run_terms : dict
        Run -> terms fitted to that run alone, arcsec.
    """
    obs, base = run.obs.whole or run.obs, run.base
    p, common, start = fitted.coefficients, base.common, run.start
    values = dict(zip(common, p))
    k, count = len(common), base.harmonic_count
    harmonics = None
    if count:
        series = slice(k, k + 2 * count)
        harmonics = Harmonics.from_degree(base.degree, base.interpretation, p[series],
                                          fitted.covariance[series, series])
    sigma = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
    at, found = k + 2 * count, []
    for e in (c.effect(run.problem) for c in chosen):
        part = slice(at, at + len(e.coefficient_names))
        found.append(FittedEffect(e, p[part], sigma[part]))
        at = part.stop
    own = base.own
    run_terms = {int(r): dict(zip(own, p[at + i * len(own):at + (i + 1) * len(own)]))
                 for i, r in enumerate(np.unique(obs.label))} if own else {}
    for t in base.own:
        values[t] = start.get(t, 0.0) + float(np.median(
            [r[t] for r in run_terms.values()]))
    covariance = np.zeros((len(values), len(values)))
    covariance[:k, :k] = fitted.covariance[:k, :k]
    facts = {'method': 'diagnosis', 'source': obs.run.meta.get('source'),
             'rows': len(obs), 'encoder': obs.encoder}
    if base.own:
        facts['own_terms'] = list(base.own)
        facts['own_terms_are'] = 'the median of the runs'
    texts = {str(obs.runs[r]): {t: (v + start.get(t, 0.0)) / ARCSEC
                                for t, v in terms.items()} for r, terms in run_terms.items()}
    return PointingModel({t: values[t] for t in [*common, *base.own]}, covariance,
                         harmonics, facts, 'rotation', found, obs.run.mount,
                         sides=rows_by_side(obs.run.mount, obs.run['el'])), texts


def _with_held_terms(model, fit):
    """The model with the undetermined terms added, at zero."""
    terms = model.terms | {t: 0.0 for t in fit.model.terms if t not in model.terms}
    covariance = np.zeros((len(terms),) * 2)
    covariance[:len(model.terms), :len(model.terms)] = model.covariance
    return replace(model, terms=terms, covariance=covariance,
                   undetermined=fit.model.undetermined, directions=fit.model.directions)


def memory_findings(run, choice, fitted):
    """A Finding where the same terms have a smaller RMS if fitted with white noise."""
    keep = choice.fit.weights > 0.0
    plain = run.problem.plain.fit(choice.chosen, final=True)
    alone = exact_fit(run, choice.chosen, plain)
    alone, here = (radial_arcsec(of.residual.reshape(2, -1), keep) for of in (alone, fitted))
    return [Finding('terms beside correlated noise', before=alone, after=here)
            ] if here > _MORE * alone else []
