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


"""An effect of the verdict: what it may be, and the model with each of these causes."""

from dataclasses import dataclass, field, replace

import numpy as np

from calibration.estimation.candidates import TIE
from calibration.estimation.equal_causes import SET_WIDTH
from msg_tools.units import ARCSEC
from pointing_model.effects.base import coefficient_word
from pointing_model.fitted_effects import FittedEffect

from ..finding import Finding
from .exact_models import choice_fit, exact_model

#: what changes little by little, where a step says "at once"
_GRADUAL = ('time', 'order', 'run_hours', 'temperature')
_MOST_CURVES = 2
#: times what the effects leave, within which a reading of the columns explains the rows as well
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
        Of these the ones that are the same curve in this run, and the ones that have another
        cause (not that a backlash is complete after some degrees or at once).
    ranking : list of dict
        Every candidate with this effect left out: ``name``, ``driver``, ``axes``, ``delta_bic``,
        ``in_set``; best first.
    causes : list of dict
        What it may be, as people are told it: ``cause``, ``effects`` (names), ``driver``, ``axes``,
        ``delta_bic``, ``only_shape`` (even alone it is one possibility, see `Effect`), and
        ``more_effects`` (so many more its model has); those within `SET_WIDTH` of the best, the
        best first, and last those that take more effects. What people are told alike is one.
    beside : dict of str to list of Effect
        Of other causes that explain the run as well only with other effects beside them: these.
    larger : dict of str to (int, float)
        Of those that take more effects: how many, and by how much their model is better, in BIC.
    columns : ndarray, shape (k, 2, n)
    contenders : list of dict
        What lost its place to this effect, though it explains the rows as well alone: see
        `alternatives.alternatives`.
    removes_arcsec : float or None
        RMS on the sky that it takes off, beyond what the declared terms could.
    offsets, own, beyond : ndarray or None
        What it moves in each row, and of that what no term and no other effect takes up, shape
        (2, n), and in the rows with weight what the declared terms do not, shape (2, m): arcsec.
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
        """A Finding on each model that explains the run as well with another effect in it."""
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
    """The effects of a choice, after the slips of the decoder.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    model : PointingModel
        With them.
    correlation : ResidualCorrelation or None
        As of `exact_models.choice_fit`.

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
        # of equals the order of the dictionary counts, not rounding
        one.causes.sort(key=lambda cause: (cause['more_effects'] > 0,
                                           -round(cause['delta_bic'], 1)))
        effects.append(one)
    return effects


def diagnosed_effect(fitted, significance, columns, effects, group):
    """`DiagnosedEffect` of a candidate.

    Parameters
    ----------
    fitted : FittedEffect
    significance : Significance
    columns : ndarray, shape (k, 2, n)
    effects : list of Effect
        All candidates.
    group : int
        Which of them it is.
    """
    def names(groups):
        return list(dict.fromkeys(effects[k].name for k in groups))
    own, s = fitted.effect.mechanism, significance
    # one curve may have two causes
    others = [k for k in s.equals
              if k not in s.same or own is None or effects[k].mechanism != own]
    return DiagnosedEffect(fitted, s.p, columns, s.delta_bic, names(s.equals), names(s.same),
                           names(others), ranking_of(effects, s.every),
                           causes=_causes(effects, s.every, [group, *s.equals]))


def cause_entry(e, delta_bic, names=None):
    """Entry of `DiagnosedEffect.causes` for an effect, with its own name unless others are told."""
    return {'cause': e.cause_summary, 'shape': e.shape, 'driver': e.driver, 'axes': e.axes,
            'look_at': e.look_at, 'effort': e.effort,
            'only_shape': e.only_shape, 'effects': [e.name] if names is None else list(names),
            'delta_bic': delta_bic, 'more_effects': 0}


def doubt_columns(result, findings):
    """Say first, in place, where a reading of the columns fits as well as the effects do.

    Parameters
    ----------
    result : Diagnosis
    findings : list of Finding
        Of `mistaken_columns.ColumnCheck`.

    Returns
    -------
    list of Finding
        The others.
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
    return [one for one in findings if one not in doubts]


def _causes(effects, delta_bic, groups):
    """`DiagnosedEffect.causes` of groups."""
    out = {}
    # of equals the found one is first, whatever the rounding
    for k in sorted(groups, key=lambda k: -np.round(delta_bic[k] / TIE)):
        e = effects[k]
        one = out.setdefault(e.cause_summary, cause_entry(e, float(delta_bic[k]), ()))
        if e.name not in one['effects']:
            one['effects'].append(e.name)
    return list(out.values())


def ranking_of(effects, delta_bic, p=None):
    """Ranking of scored effects, best first: the best member of each line.

    Parameters
    ----------
    effects : list of Effect
    delta_bic : ndarray, shape (G,)
        -inf: cannot be told from the model.
    p : ndarray, shape (G,), optional
        Family-wise.

    Returns
    -------
    list of dict
        ``name``, ``cause``, ``driver``, ``axes``, ``delta_bic``, ``in_set`` and ``p_family``.
    """
    out, seen = [], set()
    best = delta_bic.max(initial=-np.inf)
    for g in np.argsort(-delta_bic):
        if not np.isfinite(delta_bic[g]):
            break  # of waves of unknown period there are thousands
        e = effects[g]
        if e.line not in seen:
            seen.add(e.line)
            out.append({'name': e.name, 'cause': e.cause, 'driver': e.driver, 'axes': e.axes,
                        'delta_bic': float(delta_bic[g]),
                        'in_set': bool(delta_bic[g] >= max(best - SET_WIDTH, 0.0)),
                        **({} if p is None else {'p_family': float(p[g])})})
    return out


def _fit_causes(run, choice, i, causes, correlation):
    """Fit the model with each cause of an effect in its place, and write it down there.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    i : int
        Of `choice.chosen`.
    causes : list of dict
        Of `DiagnosedEffect`. Each gets ``fitted``: ``coefficients`` (``name``, ``word`` for people,
        ``value_arcsec``, ``sigma_arcsec``, ``unit``) and ``terms`` (name: ``value_arcsec``,
        ``sigma_arcsec``); None for a cause that is tried by its score alone.
    correlation : ResidualCorrelation or None
        As of `exact_models.choice_fit`.
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
    """Curves of time or temperature that explain as much as a step, and their gains."""
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
