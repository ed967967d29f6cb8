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

"""Result of a diagnosis: the verdict, the effects, the errors before and after."""

from dataclasses import dataclass, field
from pathlib import PurePath

import numpy as np

from calibration.estimation.row_influence import Linearisation
from calibration.rows import OUTLIER
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import stacked_design
from pointing_model.rms import radial_arcsec, rms

from ..finding import Finding
from .base_terms import Base
from .effect_causes import ranking_of
from .observations import Observations
from .row_counts import RMS_KEYS

#: largest numbers of rows and coefficients with which a result keeps its linear problem for a page
_LINEAR = 1500, 60


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
        RMS entries of the JSON result.
    residual_before, residual_after : ndarray, shape (2, n)
        Radians, x and y.
    weights : ndarray, shape (n,)
        Robust weights; 0: outlier.
    ranking : list of dict
        Every candidate, tested on the residuals of the base, best first: ``name``, ``driver``,
        ``axes``, ``delta_bic``, ``p_family``, ``in_set``.
    untestable : list of (str, str)
        What could not be tested, and why.
    noise_floor_arcsec : float
    excluded, next_observations, notes : list
    detectable : list of dict or None
        Detection limits, with the verdict ``none`` only, see `detection_limits`.
    cv_contiguous : dict
        ``before``, ``after``: cross-validated RMS in arcsec with folds contiguous in time.
    run_terms : dict
        Run -> terms fitted to that run alone, arcsec.
    columns_alike : list of str
        Other readings of the columns that differ only by signs, or fit better, see
        `mistaken_columns`.
    cautions : list of Finding or str
        Cases where the cross-validated improvement does not hold.
    noise_memory : dict or None
        Residuals are correlated in time and no effect explains it, see
        `residual_correlation.correlation_entry`.
    expected : dict or None
        Error on new stars of the same night, see `expected_error`.
    held_out : list of dict
        One entry for each held-out run, see `holdout.nights_held_out`.
    no_star : list of list of str
        Effects, each with the alternatives from which no observation can distinguish it, see
        `next_observations.propose`.
    unphysical : list of dict
        Terms with values implausible for any mount, see `implausible_terms`.
    whole : bool
        Whether the rows are raw encoder readings, with no model removed before.
    correlations : tuple
        Names and matrix, see `page_figures.correlations`.
    counts : dict
        See `row_counts.RowCounts`.
    worst_rows, unequal_scatter, unequal_axes : dict or None
        See `row_counts`, `scatter`.
    linear : tuple of Linearisation
        The fits without and with the effects; names are (term, None) or (effect, coefficient).
        Empty for a large run.
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
        """Store a `residual_correlation.correlation_entry`, and adjust the verdict."""
        self.noise_memory = entry
        if self.verdict == 'none' and entry['slow']:
            self.verdict = 'wanders'

    def to_dict(self):
        """JSON result; keys that do not apply are None."""
        mount = self.observations.run.mount
        return {
            # southern hemisphere; does not matter for an alt-azimuth mount
            **mount.entries(), 'south': bool(not mount.vertical and mount.latitude < 0.0),
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
            # terms left after an earlier model was removed may have any sign
            'unphysical': self.unphysical if self.whole else [],
            'approach_from': self.observations.run.meta.get('approach_from'),
        }


def _excluded(rows, obs):
    """Row and reason, and the file name if there are several files."""
    several = len({e.get('source') for e in rows} | set(obs.sources)) > 1
    return [{'row': e['row'], 'reason': e['reason'],
             **({'source': PurePath(str(e['source'])).name} if several and e.get('source') else {})}
            for e in rows]


def verdict_of(effects):
    """Verdict by what carries most of the gain: smooth curves (unknown) or named effects."""
    if not effects:
        return 'none'
    curves = [e for e in effects if e.fitted.effect.kind == 'smooth']
    named = [e for e in effects if e.fitted.effect.kind != 'smooth']
    if sum(e.delta_bic for e in curves) > sum(e.delta_bic or 0.0 for e in named):
        return 'unknown'
    return 'ambiguous' if any(e.other_causes for e in effects) else 'identified'


def build_diagnosis(run, choice, fits, models, effects, chance):
    """Build the `Diagnosis` from the effects found.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    fits : tuple of Estimate
        Without and with the effects.
    models : sequence of (PointingModel, dict)
        The same fits as models, and the terms of each run.
    effects : list of DiagnosedEffect
    chance : Chance
    """
    obs, problem, weights = run.obs, run.problem, choice.fit.weights
    keep = weights > 0.0
    before, after = (fit.residual.reshape(2, -1) for fit in fits)
    (base_model, _), (model, run_terms) = models
    excluded = [obs.excluding(i, OUTLIER) for i in np.flatnonzero(~keep)]
    free = max(2 * np.count_nonzero(keep) - len(choice.fit.basis), 1)
    floor = radial_arcsec(after, keep) * np.sqrt(2 * keep.sum() / free)
    candidates, nothing = problem.dictionary.effects, problem.plain.fit([])
    scores = problem.dictionary.score(nothing)
    # effects that a run cannot distinguish from the base terms, and the reason if known
    hidden = {e.name: e.alias for e, dof in zip(candidates, scores.dof) if dof == 0}
    return Diagnosis(
        verdict_of(effects), run.base, obs, model, base_model, effects, rms_entry(before, keep),
        rms_entry(after, keep), before, after, weights,
        ranking_of(candidates, scores.delta_bic, chance.p_of_all(nothing, scores)),
        run.untestable + [*hidden.items()], floor, obs.excluded + excluded,
        _notes(run, choice, effects), run_terms,
        linear=_linear(run, choice, fits))


def _notes(run, choice, effects):
    """Notes on the rows, on dropped effects, and on the effects found."""
    notes = [*run.obs.notes, *not_taken(run.obs.context)]
    notes += [Finding(kind, causes=tuple(dict.fromkeys(
        c.effect(run.problem).name for c in dropped)))
        for kind, dropped in (('no gain on rows left out', choice.dropped_by_cv),
                              ('not repeated', choice.not_repeated)) if dropped]
    if run.infeasible.any():
        notes.append(Finding('beyond the zenith', int(run.infeasible.sum()), unit='rows'))
    notes += [found for one in effects for found in one.other_models]
    return notes + [Finding('curve', evidence={'driver': e.fitted.effect.driver,
                                               'shape': e.fitted.effect.shape})
                    for e in effects if e.fitted.effect.kind == 'smooth']


def not_taken(context):
    """A Finding on columns of a Context that are not used as drivers; empty if there are none."""
    names = context.left_out()
    return [] if not names else [Finding('columns not taken', evidence={
        'columns': [*map(context.wording, names)],
        # auxiliary columns of TPOINT, which have no names
        'unnamed': any(name.startswith('auxiliary_') for name in names)})]


def _linear(run, choice, fits):
    """`Linearisation` of each of the fits; empty for a large run."""
    small = (len(run.obs) <= _LINEAR[0] and not run.obs.whole
             and len(run.problem.design(choice.chosen)) <= _LINEAR[1])
    return tuple(_linear_fit(run, *each) for each in zip(fits, ([], choice.chosen)) if small)


def _linear_fit(run, fit, chosen):
    """`Linearisation` of an exact fit: its covariance uses the final scatter of that fit."""
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


def rms_entry(residual, keep):
    """RMS entry of the JSON result: residuals of shape (2, n), radians, in the rows `keep`."""
    x, y = (rms(r[keep]) / ARCSEC for r in residual)
    return dict.fromkeys(RMS_KEYS) | {
        'rms_arcsec': float(np.hypot(x, y)), 'rms_x_arcsec': x, 'rms_y_arcsec': y}


_MOVED = 2.0  # sigma: a term that the effects shift by more is also reported as fitted with them


def raw_rms_arcsec(obs, weights):
    """Radial RMS of encoder minus catalogue, arcsec, in rows with non-zero weight.

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
    """Contribution of each term, fitted without effects, to the raw error, largest first.

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    list of dict
        ``name``, ``value_arcsec`` (the median over runs of a term fitted to each run) and
        ``rms_arcsec``, its RMS on the sky in rows with non-zero weight. For a term that effects
        shift by more than two standard errors: ``beside_effects_arcsec``, and ``resembles`` (the
        effect most correlated with it) with ``correlation``. For a term that the stars do not
        determine: ``undetermined``.
    """
    # fitted with effects of nearly the same shape, a term is a difference of large numbers
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
    """Terms shifted by the effects: their values with the effects, and the most correlated one."""
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
