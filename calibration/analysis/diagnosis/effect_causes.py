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


"""An effect of the verdict: its possible causes, and the model with each of them."""

from dataclasses import dataclass, field, replace

import numpy as np

from calibration.estimation.candidate_scores import TIE
from calibration.estimation.equal_causes import SET_WIDTH
from msg_tools.units import ARCSEC
from pointing_model.effects.base import coefficient_word
from pointing_model.fitted_effects import FittedEffect

from ..finding import Finding
from .exact_models import choice_fit, exact_model

#: drivers of gradual change, offered as alternatives to a step
_GRADUAL = ('time', 'order', 'run_hours', 'temperature')
_MOST_CURVES = 2
#: a reading of the columns fits as well as the effects if its RMS is below this times theirs
_AS_WELL = 1.25


@dataclass
class DiagnosedEffect:
    """One effect of the verdict.

    Attributes
    ----------
    fitted : FittedEffect
    p_family, delta_bic, cv_gain_arcsec : float or None
    alternatives : list of str
        Effects that explain the run as well (within 6 of the best BIC).
    aliases, other_causes : list of str
        The alternatives with the same curve in this run, and those with a different cause
        (backlash taken up at once or over some degrees is one cause).
    ranking : list of dict
        Every candidate in place of this effect: ``name``, ``driver``, ``axes``, ``delta_bic``,
        ``in_set``; best first.
    causes : list of dict
        Possible causes as worded for users: ``cause``, ``effects`` (names), ``driver``, ``axes``,
        ``delta_bic``, ``only_shape`` (uncertain even if it is the only cause, see `Effect`), and
        ``more_effects`` (number of additional effects in its model). Those within `SET_WIDTH` of
        the best, best first, and last those that need more effects. Causes with the same wording
        are merged.
    beside : dict of str to list of Effect
        Alternatives that explain the run as well only with other effects: these other effects.
    larger : dict of str to (int, float)
        Alternatives that need more effects: how many more, and the BIC gain of their model.
    columns : ndarray, shape (k, 2, n)
    contenders : list of dict
        Candidates that explain the rows as well when alone, but lost to this effect, see
        `alternatives.alternatives`.
    removes_arcsec : float or None
        RMS on the sky removed by the effect, beyond what the declared terms can absorb.
    offsets, own, beyond : ndarray or None
        Offset of each row; its part that no term and no other effect absorbs, shape (2, n); and,
        in rows with non-zero weight, its part that the declared terms do not absorb, shape (2, m):
        arcsec.
    """

    fitted: FittedEffect
    p_family: float
    columns: np.ndarray
    delta_bic: float | None = None
    alternatives: list = field(default_factory=list)
    aliases: list = field(default_factory=list)
    other_causes: list = field(default_factory=list)
    ranking: list = field(default_factory=list)
    cv_gain_arcsec: float | None = None
    causes: list = field(default_factory=list)
    beside: dict = field(default_factory=dict)
    larger: dict = field(default_factory=dict)
    contenders: list = field(default_factory=list)
    removes_arcsec: float | None = None
    offsets: np.ndarray | None = None
    own: np.ndarray | None = None
    beyond: np.ndarray | None = None

    @property
    def other_models(self):
        """A Finding for each alternative model that explains the run as well."""
        out = []
        for other, others in self.beside.items():
            more, better = self.larger.get(other, (0, 0.0))
            out.append(Finding('another model', causes=(self.fitted.effect.name, other), evidence={
                'beside': [e.name for e in others], 'more': more,
                'better': better if better > SET_WIDTH else 0.0}))
        return out

    def to_dict(self):
        """Entry of the JSON result."""
        e = self.fitted.effect
        names = e.coefficient_names
        return {
            'name': e.name, 'tpoint': e.tpoint, 'driver': e.driver, 'axes': e.axes,
            'coefficients_arcsec': dict(zip(names, (self.fitted.coefficients / ARCSEC).tolist())),
            'sigma_arcsec': dict(zip(names, (self.fitted.sigma / ARCSEC).tolist())),
            'p_family': self.p_family, 'delta_bic': self.delta_bic,
            'alternatives': self.alternatives, 'cv_gain_arcsec': self.cv_gain_arcsec,
            'causes': self.causes, 'contenders': self.contenders,
            'removes_rms_arcsec': self.removes_arcsec,
        }


def diagnosed_effects(run, choice, model, correlation):
    """Effects of the verdict: decoder slips first, then the selected effects.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    model : PointingModel
        With the effects.
    correlation : ResidualCorrelation or None
        See `exact_models.choice_fit`.

    Returns
    -------
    list of DiagnosedEffect
    """
    problem, obs = run.problem, run.obs
    effects = [DiagnosedEffect(f, p, f.effect.columns(obs.context)) for f, p in run.slips]
    for i, (c, s, f) in enumerate(zip(choice.chosen, choice.significances, model.effects)):
        bank, group = c.family(problem, choice.chosen)
        one = diagnosed_effect(f, s, c.columns(problem).reshape(-1, 2, len(obs)), bank.effects,
                               group)
        one.beside = {bank.effects[k].name: [c.effect(problem) for c in others]
                      for k, others in s.others.items()}
        one.larger = {bank.effects[k].name: more for k, more in s.larger.items()}
        for cause in one.causes:
            cause['more_effects'] = min(
                one.larger.get(name, (0,))[0] for name in cause['effects'])
        if len(one.causes) > 1:
            _fit_causes(run, choice, i, one.causes, correlation)
        for e, gain in _equals_of_step(problem, choice, i):
            one.alternatives.append(e.name)
            one.other_causes.append(e.name)
            if e.cause_summary not in [cause['cause'] for cause in one.causes]:
                one.causes.append(cause_entry(e, gain))
        # among equals keep the order of the dictionary, not that of rounding errors
        one.causes.sort(key=lambda cause: (cause['more_effects'] > 0,
                                           -round(cause['delta_bic'], 1)))
        effects.append(one)
    return effects


def diagnosed_effect(fitted, significance, columns, effects, group):
    """Build the `DiagnosedEffect` of a candidate.

    Parameters
    ----------
    fitted : FittedEffect
    significance : Significance
    columns : ndarray, shape (k, 2, n)
    effects : list of Effect
        All candidates.
    group : int
        Index of this candidate in `effects`.
    """
    def names(groups):
        return list(dict.fromkeys(effects[k].name for k in groups))
    own, s = fitted.effect.mechanism, significance
    # the same curve may have two causes
    others = [k for k in s.equals
              if k not in s.same or own is None or effects[k].mechanism != own]
    return DiagnosedEffect(fitted, s.p, columns, s.delta_bic, names(s.equals), names(s.same),
                           names(others), ranking_of(effects, s.every),
                           causes=_causes(effects, s.every, [group, *s.equals]))


def cause_entry(e, delta_bic, names=None):
    """Entry of `DiagnosedEffect.causes` for an effect; `names` defaults to its own name."""
    return {'cause': e.cause_summary, 'shape': e.shape, 'driver': e.driver, 'axes': e.axes,
            'look_at': e.look_at, 'effort': e.effort,
            'only_shape': e.only_shape, 'effects': [e.name] if names is None else list(names),
            'delta_bic': delta_bic, 'more_effects': 0}


def doubt_columns(result, findings):
    """Add, in place, readings of the columns that fit as well as the effects as possible causes.

    Parameters
    ----------
    result : Diagnosis
    findings : list of Finding
        Findings of `mistaken_columns.ColumnCheck`.

    Returns
    -------
    list of Finding
        The remaining findings.
    """
    doubts = [one for one in findings if one.kind == 'better reading'
              and one.after < _AS_WELL * result.after['rms_arcsec']]
    result.cautions = [*result.cautions, *doubts]
    for found in doubts:
        for effect in result.effects:
            effect.causes += [{
                'cause': text, 'shape': one['shape'],
                'driver': one['driver'], 'axes': one['axes'], 'delta_bic': one['delta_bic'],
                'look_at': f'the {found["what"]} of the file', 'effort': 0, 'only_shape': False,
                'effects': [], 'more_effects': 0}
                for one in effect.causes[:1] for text in found.causes]
        if result.verdict == 'identified':
            result.verdict = 'ambiguous'
    return [replace(one, caution=False) for one in findings if one not in doubts]


def _causes(effects, delta_bic, groups):
    """`DiagnosedEffect.causes` of candidate groups."""
    out = {}
    # among equals the selected one comes first, whatever the rounding
    for k in sorted(groups, key=lambda k: -np.round(delta_bic[k] / TIE)):
        e = effects[k]
        one = out.setdefault(e.cause_summary, cause_entry(e, float(delta_bic[k]), ()))
        if e.name not in one['effects']:
            one['effects'].append(e.name)
    return list(out.values())


def ranking_of(effects, delta_bic, p=None):
    """Rank scored effects, best first, with the best member of each line only.

    Parameters
    ----------
    effects : list of Effect
    delta_bic : ndarray, shape (G,)
        -inf: indistinguishable from the model.
    p : ndarray, shape (G,), optional
        Family-wise p-values.

    Returns
    -------
    list of dict
        ``name``, ``cause``, ``driver``, ``axes``, ``delta_bic``, ``in_set`` and ``p_family``.
    """
    out, seen = [], set()
    best = delta_bic.max(initial=-np.inf)
    for g in np.argsort(-delta_bic):
        if not np.isfinite(delta_bic[g]):
            break  # there are thousands of waves of unknown period
        e = effects[g]
        if e.line not in seen:
            seen.add(e.line)
            out.append({'name': e.name, 'cause': e.cause, 'driver': e.driver, 'axes': e.axes,
                        'delta_bic': float(delta_bic[g]),
                        'in_set': bool(delta_bic[g] >= max(best - SET_WIDTH, 0.0)),
                        **({} if p is None else {'p_family': float(p[g])})})
    return out


def _fit_causes(run, choice, i, causes, correlation):
    """Fit the model with each cause in place of an effect, and store the fit with the cause.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    i : int
        Index of the effect in `choice.chosen`.
    causes : list of dict
        See `DiagnosedEffect.causes`. Each gets ``fitted``: ``coefficients`` (``name``, ``word``
        for people, ``value_arcsec``, ``sigma_arcsec``, ``unit``) and ``terms`` (name:
        ``value_arcsec``, ``sigma_arcsec``); None for a cause tested by its score alone.
    correlation : ResidualCorrelation or None
        See `exact_models.choice_fit`.
    """
    one, own = choice.chosen[i], choice.significances[i]
    bank, group = one.family(run.problem, choice.chosen)
    groups = {} if one.of is not None else {
        bank.effects[k].name: k for k in (*own.equals, *own.same, group)}
    beside = [other for other in choice.chosen if other != one]
    for cause in causes:
        group = next((groups[name] for name in cause['effects'] if name in groups), None)
        cause['fitted'] = None
        if group is not None:
            mine = replace(one, group=group)
            cause['fitted'] = _fitted(run, [mine, *(
                other for other in own.others.get(group, beside) if other != mine)], correlation)


def _fitted(run, chosen, correlation):
    model, _ = exact_model(run, choice_fit(run, chosen, correlation)[0], chosen)
    one = model.effects[0]
    return {
        'coefficients': [
            {'name': name, 'word': coefficient_word(one.effect, name), 'unit': one.effect.unit,
             'value_arcsec': float(value / ARCSEC), 'sigma_arcsec': float(s / ARCSEC)}
            for name, value, s in zip(one.effect.coefficient_names, one.coefficients, one.sigma)],
        'terms': {name: {'value_arcsec': float(value / ARCSEC), 'sigma_arcsec': float(s / ARCSEC)}
                  for (name, value), s in zip(model.terms.items(), model.sigmas)
                  if np.isfinite(s)}}


def _equals_of_step(problem, choice, i):
    """Curves of time or temperature that explain as much as a step, and their BIC gains."""
    one = choice.chosen[i]
    if one.effect(problem).form != 'step' or not len(problem.curves):
        return []
    fit = problem.plain.fit(choice.chosen, without=i)
    own = problem.dictionary.score(fit).delta_bic[one.group]
    scores = problem.curves.score(fit)
    out = {}
    for g in np.argsort(-scores.delta_bic):
        e = problem.curves.effects[g]
        if scores.delta_bic[g] > own - SET_WIDTH and e.driver in _GRADUAL:
            out.setdefault(e.name, (e, float(scores.delta_bic[g])))
    return list(out.values())[:_MOST_CURVES]
