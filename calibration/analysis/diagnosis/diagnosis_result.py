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

"""What a diagnosis says: the verdict, the effects, the errors before and after."""

from dataclasses import dataclass, field
from pathlib import PurePath

import numpy as np

from calibration.estimation.candidates import TIE
from calibration.estimation.linearisation import Linearisation
from calibration.estimation.significance import SET_WIDTH
from calibration.rows import OUTLIER
from msg_tools.units import ARCSEC
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import stacked_design
from pointing_model.rms import radial_arcsec, rms

from .diagnosis_base import Base, Observations
from .row_counts import RMS_KEYS

#: rows and coefficients up to which a result keeps its linear problem, for a page
_LINEAR = 1500, 60


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
    columns : ndarray, shape (k, 2, n)
    contenders : list of dict
        What lost its place to this effect, though it explains the rows as well alone: see
        `alternatives.Alternative.entry`.
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
    contenders: list = field(default_factory=list)
    removes_arcsec: float | None = None
    offsets: np.ndarray | None = None
    own: np.ndarray | None = None
    beyond: np.ndarray | None = None

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


@dataclass
class Diagnosis:
    """Result of `diagnose`.

    Attributes
    ----------
    verdict : {'none', 'wanders', 'undecided', 'identified', 'ambiguous', 'unknown', 'refused'}
    base : Base
    observations : Observations
        The rows that were used.
    model, base_model : PointingModel
        With and without the effects.
    effects : list of DiagnosedEffect
    before, after : dict
        RMS of the JSON result.
    residual_before, residual_after : ndarray, shape (2, n)
        Radians, x and y.
    weights : ndarray, shape (n,)
        Robust; 0: set aside.
    ranking : list of dict
        Every candidate on what the base leaves, best first: ``name``, ``driver``, ``axes``,
        ``delta_bic``, ``p_family``, ``in_set``.
    untestable : list of (str, str)
        What could not be tested, and why.
    noise_floor_arcsec : float
    excluded, next_observations, notes : list
    detectable : list of dict or None
        With the verdict ``none``: what these observations would have shown, see `detectable`.
    cv_contiguous : dict
        ``before``, ``after``: RMS in arcsec with folds contiguous in time.
    run_terms : dict
        Run -> terms that it fitted for itself, arcsec.
    columns_alike : list of str
        Readings of the columns that fit as well, see `input_check`.
    cautions : list of Finding or str
        Where the gain does not hold on some kind of rows left out.
    noise_memory : dict or None
        Rows resemble their neighbours in time though no effect explains it, see
        `residual_correlation.correlation_entry`.
    expected : dict or None
        Error on fresh stars of the same night, see `expected_error`.
    held_out : list of dict
        Runs held out, each for itself, see `row_facts.nights_held_out`.
    no_star : list of list of str
        Effects, each with the rivals that no observation tells it from, see
        `next_observations.propose`.
    unphysical : list of dict
        Terms that no mount should have so, see `implausible_terms`.
    whole : bool
        Whether the rows are what the encoders read, and nothing was taken off before.
    correlations : tuple
        Names and matrix, see `page_figures.correlations`.
    counts : dict
        Of `RowCounts`.
    worst_rows, unequal_scatter, unequal_axes : dict or None
        See `row_facts`, `scatter`.
    linear : tuple of Linearisation
        The fits without and with the effects; names are (term, None) or (effect, coefficient).
        Empty where the run is large.
    """

    verdict: str
    base: Base
    observations: Observations
    model: PointingModel
    base_model: PointingModel
    effects: list
    before: dict
    after: dict
    residual_before: np.ndarray
    residual_after: np.ndarray
    weights: np.ndarray
    ranking: list
    untestable: list
    noise_floor_arcsec: float
    excluded: list
    notes: list
    run_terms: dict
    next_observations: list = field(default_factory=list)
    detectable: list | None = None
    cv_contiguous: dict = field(default_factory=dict)
    columns_alike: list = field(default_factory=list)
    cautions: list = field(default_factory=list)
    noise_memory: dict | None = None
    expected: dict | None = None
    held_out: list = field(default_factory=list)
    no_star: list = field(default_factory=list)
    unphysical: list = field(default_factory=list)
    whole: bool = True
    correlations: tuple = ((), None)
    counts: dict = field(default_factory=dict)
    worst_rows: dict | None = None
    unequal_scatter: dict | None = None
    unequal_axes: dict | None = None
    linear: tuple = ()

    def add_correlation(self, entry):
        """Take a `residual_correlation.correlation_entry`."""
        self.noise_memory = entry
        if self.verdict == 'none' and entry['slow']:
            self.verdict = 'wanders'

    @property
    def _south(self):
        """Whether the pole that is above the horizon is the southern one, where that matters."""
        mount = self.observations.run.mount
        return bool(not mount.vertical and mount.latitude < 0.0)

    def to_dict(self):
        """The JSON result; keys that do not apply are None."""
        return {
            **self.observations.run.mount.entries(), 'south': self._south,
            'observations': len(self.observations), 'runs': len(self.observations.runs),
            'base_terms': self.base.names(), 'verdict': self.verdict, 'before': self.before,
            'after': self.after, 'noise_floor_arcsec': self.noise_floor_arcsec,
            'effects': [e.to_dict() for e in self.effects], **self.counts,
            'columns_alike': self.columns_alike, 'readings': [],
            'excluded': _excluded(self.excluded, self.observations),
            'next_observations': self.next_observations, 'detectable': self.detectable,
            'wander': self.noise_memory, 'expected': self.expected,
            'as_read_rms_arcsec': raw_rms_arcsec(
                self.observations, self.weights) if self.whole else None,
            'as_read_terms': raw_terms(self) if self.whole else [],
            'equinox': self.observations.run.meta.get('equinox_taken'),
            'cv_contiguous': self.cv_contiguous, 'worst_rows': self.worst_rows,
            'held_out': self.held_out, 'no_star': self.no_star,
            'unequal_scatter': self.unequal_scatter, 'unequal_axes': self.unequal_axes,
            # what is left beside terms that were taken off before has any sign
            'unphysical': self.unphysical if self.whole else [],
            'approach_from': self.observations.run.meta.get('approach_from'),
        }


def _excluded(rows, obs):
    """Row and reason; of several files, which."""
    several = len({e.get('source') for e in rows} | set(obs.sources)) > 1
    return [{'row': e['row'], 'reason': f'{PurePath(str(e["source"])).name}: {e["reason"]}'
             if several and e.get('source') else e['reason']} for e in rows]


def verdict_of(effects):
    """Of what carries most of the gain: curves (unknown), or effects that have a name."""
    if not effects:
        return 'none'
    curves = [e for e in effects if e.fitted.effect.kind == 'smooth']
    named = [e for e in effects if e.fitted.effect.kind != 'smooth']
    if sum(e.delta_bic for e in curves) > sum(e.delta_bic or 0.0 for e in named):
        return 'unknown'
    return 'ambiguous' if any(e.other_causes for e in effects) else 'identified'


def diagnosis_of(run, choice, fits, models, effects, ranking, untestable, notes):
    """`Diagnosis` of what was found.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    fits : tuple of Estimate
        Without and with the effects.
    models : tuple of (PointingModel, dict)
        The same as models, and the terms of each run.
    effects : list of DiagnosedEffect
    ranking, untestable, notes : list
    """
    obs, weights = run.obs, choice.fit.weights
    keep = weights > 0.0
    before, after = (fit.residual.reshape(2, -1) for fit in fits)
    (base_model, _), (model, run_terms) = models
    excluded = [obs.excluding(i, OUTLIER) for i in np.flatnonzero(~keep)]
    free = max(2 * np.count_nonzero(keep) - len(choice.fit.basis), 1)
    floor = radial_arcsec(after, keep) * np.sqrt(2 * keep.sum() / free)
    return Diagnosis(
        verdict_of(effects), run.base, obs, model, base_model, effects, rms_entry(before, keep),
        rms_entry(after, keep), before, after, weights, ranking, untestable, floor,
        obs.excluded + excluded, notes, run_terms,
        linear=tuple(_linear(run, *each) for each in zip(fits, ([], choice.chosen)))
        if _is_small(run, choice) else ())


def _is_small(run, choice):
    return (len(run.obs) <= _LINEAR[0] and not run.obs.whole
            and len(run.problem.design(choice.chosen)) <= _LINEAR[1])


def _linear(run, fit, chosen):
    """`Linearisation` of an exact fit: its covariance is by the scatter that it ended with."""
    obs, base, n = run.obs, run.base, len(run.obs)
    names = [(t, None) for t in base.common]
    names += [(f'{axis}{i}', None) for axis in 'AB' for i in range(base.harmonic_count)]
    names += [(e.name, c) for e in (one.effect(run.problem) for one in chosen)
              for c in e.coefficient_names]
    if base.own:
        names += [(f'{t}[{obs.runs[r]}]', None) for r in np.unique(obs.label) for t in base.own]
    weights = fit.weights / np.square(np.asarray(fit.scatter)[:, None])
    if obs.inverse_sigma is not None:
        weights = weights * np.square(obs.inverse_sigma.reshape(2, n))
    return Linearisation(
        tuple(names), fit.coefficients,
        np.asarray(run.problem.design(chosen)).reshape(-1, 2, n), fit.residual.reshape(2, n),
        weights, given=True)


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


def rms_entry(residual, keep):
    """Of the JSON result: RMS of the rows `keep` of residuals of shape (2, n), radians."""
    x, y = (rms(r[keep]) / ARCSEC for r in residual)
    return dict.fromkeys(RMS_KEYS) | {
        'rms_arcsec': float(np.hypot(x, y)), 'rms_x_arcsec': x, 'rms_y_arcsec': y}


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


def hidden(effects, dof):
    """Name of the effects that a run cannot tell from the base's terms, and why if it is known."""
    return list({e.name: e.alias for e, d in zip(effects, dof) if d == 0}.items())


_MOVED = 2.0  # sigma, from where it is said what a term is beside the effects


def raw_rms_arcsec(obs, weights):
    """Radial RMS of what the encoders read beyond the catalogue, arcsec, of rows with weight.

    Parameters
    ----------
    obs : Observations
    weights : ndarray, shape (n,)

    Returns
    -------
    float or None
    """
    keep = weights > 0.0
    return _radial(obs.observed.reshape(2, -1)[:, keep]) if keep.any() else None


def raw_terms(diagnosis):
    """What the terms, fitted alone, are of the errors as read, the largest first.

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    list of dict
        ``name``, ``value_arcsec`` (of a term that each run has for itself the median) and
        ``rms_arcsec``, what it is on the sky over the rows with weight. Of one that effects have
        moved by more than two of its standard errors: ``beside_effects_arcsec``, and
        ``resembles`` (the effect that it is most correlated with) with ``correlation``. Of one
        that the stars do not determine: ``undetermined``.
    """
    # beside effects that are nearly the same curve a term is a difference of large numbers
    obs, terms = diagnosis.observations, diagnosis.base_model.terms
    keep = np.flatnonzero(diagnosis.weights > 0.0)
    if not len(keep) or not terms:
        return []
    columns = stacked_design(tuple(terms), obs.context.az[keep], obs.context.el[keep],
                             obs.run.mount).reshape(len(terms), 2, -1)
    moved = _moved(diagnosis)
    out = [{'name': name, 'value_arcsec': value / ARCSEC,
            'rms_arcsec': _radial(value * column), **moved.get(name, {}),
            **({'undetermined': True} if name in diagnosis.base_model.undetermined else {})}
           for (name, value), column in zip(terms.items(), columns)]
    return sorted(out, key=lambda row: -row['rms_arcsec'])


def _moved(diagnosis):
    """Of terms that the effects have moved: what they are beside them, and whom they resemble."""
    model, base = diagnosis.model, diagnosis.base_model
    if not diagnosis.effects:
        return {}
    moved = [name for (name, value), s in zip(base.terms.items(), base.sigmas)
             if name not in diagnosis.base.own and name in model.terms
             and abs(model.terms[name] - value) > _MOVED * s]
    names, matrix = diagnosis.correlations
    found = [i for i, (_, coefficient) in enumerate(names) if coefficient is not None]
    out = {}
    for name in moved:
        one = {'beside_effects_arcsec': model.terms[name] / ARCSEC}
        if found and (name, None) in names:
            row = matrix[names.index((name, None))]
            most = max(found, key=lambda i, row=row: abs(row[i]))
            one.update(resembles=names[most][0], correlation=float(row[most]))
        out[name] = one
    return out


def _radial(residual):
    return float(np.hypot(*(rms(one) for one in residual))) / ARCSEC
