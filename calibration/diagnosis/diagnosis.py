"""Diagnosis of a pointing run: what the declared model lacks, how sure that is, what it gains."""

from dataclasses import dataclass, field
from pathlib import PurePath

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model import geometry as rotation
from pointing_model.effects import dictionary, effect, smooths, steps
from pointing_model.effects.base import AXES
from pointing_model.effects.drifts import places_of_steps
from pointing_model.fitted_effects import FittedEffect
from pointing_model.harmonics import COUNT, Harmonics
from pointing_model.model import PointingModel
from pointing_model.terms import PHYSICAL

from .base import (
    Base,
    Observations,
    after_rotation,
    decode_slips,
    linearised,
    observations,
)
from .holdout import holdout_rms
from .linear import Bank, inverse_normal
from .next_observations import propose
from .resampling import (
    contiguous_folds,
    cross_validate,
    cv_gains,
    nested,
    random_folds,
    rms,
    run_folds,
)
from .search import Chance, Problem, search, standing

_FLIPS = 1999
_FOLDS = 10
_LONG = 1500  # rows
_RUNS = 4  # from which whole runs are left out
_NOT_REPEATED = ('More is beyond chance, but it does not hold from run to run, so it is not added '
                 '(the notes have the names): what the rows of one run share looks like an effect.')
_CAUTION = ('But where {} are left out, they are predicted worse than without any effect '
            '({:.2f}\u2033 to {:.2f}\u2033): what was found may hold for these observations alone. '
            'Judge it on another run (--holdout) before you use it there.')


@dataclass
class DiagnosedEffect:
    """One effect of the verdict.

    Attributes
    ----------
    fitted : FittedEffect
    p_family, delta_bic, cv_gain_arcsec : float or None
    alternatives : list of str
        Effects that explain the run as well (within 6 of the best BIC).
    aliases, rivals : list of str
        Of these the ones that are the same curve in this run, and the ones that have another
        cause (not that a backlash is complete after some degrees or at once).
    ranking : list of dict
        Every candidate with this effect left out: ``name``, ``driver``, ``axes``, ``delta_bic``,
        ``in_set``; best first.
    columns : ndarray, shape (k, 2, n)
    """

    fitted: FittedEffect
    p_family: float
    delta_bic: float | None
    cv_gain_arcsec: float | None
    alternatives: list
    aliases: list
    rivals: list
    ranking: list
    columns: np.ndarray

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
        }


@dataclass
class Diagnosis:
    """Result of `diagnose`.

    Attributes
    ----------
    verdict : {'none', 'identified', 'ambiguous', 'unknown'}
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
    p_first : float
        Family-wise p that the base leaves anything at all.
    untestable : list of (str, str)
        What could not be tested, and why.
    noise_floor_arcsec : float
    excluded, next_observations, notes : list
    cv_contiguous : dict
        ``before``, ``after``: RMS in arcsec with folds contiguous in time.
    run_terms : dict
        Run -> terms that it fitted for itself, arcsec.
    caution : str
        A sentence where the gain does not hold on some kind of rows left out.
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
    p_first: float
    untestable: list
    noise_floor_arcsec: float
    excluded: list
    next_observations: list
    notes: list
    cv_contiguous: dict = field(default_factory=dict)
    run_terms: dict = field(default_factory=dict)
    caution: str = ''

    def to_dict(self):
        """The JSON result; keys that do not apply are None."""
        return {
            'observations': len(self.observations), 'runs': len(self.observations.runs),
            'base_terms': self.base.names(), 'verdict': self.verdict, 'before': self.before,
            'after': self.after, 'noise_floor_arcsec': self.noise_floor_arcsec,
            'effects': [e.to_dict() for e in self.effects],
            'excluded': _excluded(self.excluded, self.observations),
            'next_observations': self.next_observations,
        }


def diagnose(runs, base='physical', alpha=0.01, *, holdout=None, own_terms=None, encoder='enc',
             flips=_FLIPS, folds=_FOLDS, seed=0, robust=True, max_effects=20,
             cross_validation=True):
    """Find the effects that a model lacks, and prove the gain.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
        Several are several runs of one mount.
    base : str or Base
        The declared model, see `Base.parse`.
    alpha : float
        Family-wise error: the chance that a clean run gets any effect.
    holdout : PointingRun or sequence of PointingRun, optional
        Judge there too; only `own_terms` (by default the zeros IA and IE) are refitted.
    own_terms : sequence of str, optional
        Terms that each run fits for itself; by default IA and IE if there are several runs.
        ``()``: none.
    encoder : {'enc', 'abs'}
    flips : int
        Sign flips behind each p.
    folds : int
        Of the cross-validation (random; as many contiguous ones; whole runs from 4 runs on; at
        most 5 from 1500 rows on).
    seed : int
    robust : bool
    max_effects : int
    cross_validation : bool

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError
        Too few usable rows for the base, unknown terms, or a bad option.
    """
    if not 0.0 < alpha < 1.0:
        raise ValueError(f'alpha {alpha} is no probability between 0 and 1')
    obs = observations(runs, encoder)
    if own_terms is None:
        own_terms = ('IA', 'IE') if len(obs.runs) > 1 else ()
    if not isinstance(base, Base):
        base = Base.parse(base, own_terms)
    rng = np.random.default_rng(seed)
    work = _Work(obs, base, alpha, robust, encoder)
    chance = Chance(work.problem.n, flips, rng)
    parts = _folds(work, folds, rng) if cross_validation else []
    found = search(work.problem, alpha, chance, max_effects=max_effects)
    stands, gains = _settle(work.problem, found, alpha, chance, parts)
    errors = _cross_validated(work, found, parts, alpha, rng) if parts else None
    if errors and errors.cut is not None:
        found.not_repeated = found.chosen[errors.cut:]
        del found.chosen[errors.cut:]
        found.state = work.problem.state(found.chosen)
        stands, gains = _settle(work.problem, found, alpha, chance, parts)
    _refine_steps(work, found)
    found.state = work.problem.state(found.chosen, final=True)
    fitted = work.fit(found.chosen, found.state)
    result = _assemble(work, found, stands, fitted, chance)
    if errors:
        for entry, gain in zip(result.effects[len(work.slips):], gains):
            entry.cv_gain_arcsec = gain
        result.before['cv_rms_arcsec'], result.after['cv_rms_arcsec'] = errors.before, errors.after
        result.cv_contiguous, result.caution = errors.stretches, errors.caution
    if holdout is not None:
        judged = holdout_rms(holdout, result, own_terms or ('IA', 'IE'), encoder)
        result.before['holdout_rms_arcsec'] = judged.before
        result.after['holdout_rms_arcsec'] = judged.after
        result.notes += judged.notes
    if result.verdict == 'ambiguous':
        result.next_observations = propose(work.problem, obs, base, found, stands)
    return result


def _excluded(rows, obs):
    """Row and reason; of several files, which."""
    several = len({e.get('source') for e in rows} | set(obs.sources)) > 1
    return [{'row': e['row'], 'reason': f'{PurePath(str(e["source"])).name}: {e["reason"]}'
             if several and e.get('source') else e['reason']} for e in rows]


class _Work:
    """Observations, base and candidates in the form of the search."""

    def __init__(self, obs, base, alpha, robust, encoder, curves=True):
        columns = base.columns(obs.context, obs.label)
        if 2 * len(obs) < len(columns) + 4:
            raise ValueError(f'{len(obs)} usable observations do not determine {len(columns)} '
                             'coefficients and a residual; observe more or fit fewer terms')
        self.obs, self.base = obs, base
        self.start, left, feasible = linearised(obs, base)
        effects, self.untestable = dictionary(
            obs.context, [t for t in PHYSICAL if t not in base.terms], base.own)
        if base.own and {'IA', 'IE'} <= set(base.own):
            effects = [e for e in effects if e.form != 'run_zero']
        self.problem = Problem(columns, left, obs.inverse_sigma, None, None, robust)
        self.slips = self._slips(alpha)
        self.problem.dictionary = Bank(effects + steps(obs.context), obs.context)
        self.problem.curves = Bank(smooths(obs.context) if curves else [], obs.context)
        self.infeasible = ~feasible
        self.encoder = encoder

    def _slips(self, alpha):
        """Correct whole bars and lines; they are known amounts."""
        out = []
        for axis, graduation, rows, multiples, p in decode_slips(
                self.obs, self.problem.state([]), alpha):
            e = effect('decode_slip', axis=axis, rows=self.obs.run['row'][rows].tolist(),
                       multiples=multiples.tolist(), graduation=graduation)
            fitted = FittedEffect(e, np.array([ARCSEC]), np.zeros(1))
            x, y = fitted.offsets(self.obs.context)
            self.obs.observed = self.obs.observed - np.concatenate((x, y))
            self.problem.b = self.problem.b - np.concatenate((x, y))
            out.append((fitted, p))
            self.obs.notes.append(
                f'the {AXES[axis]} encoder was read whole {graduation} beside the true place, and '
                'set right, in ' + ', '.join(f'row {self.obs.lines[r]} ({m:+d})'
                                             for r, m in zip(rows, multiples)))
        return out

    def fit(self, chosen, state):
        """Exact rotations with the effects: coefficients, covariance, residual, by iteration.

        Returns
        -------
        _Fitted
        """
        design = self.problem.design(chosen).dense()
        common = [t for t in self.base.terms if t not in self.base.own]
        geometric = [i for i, t in enumerate(common) if t in rotation.GEOMETRIC]
        root = state.root
        inverse = inverse_normal(design, root)
        start, left = dict(self.start), self.problem.b
        for _ in range(4):
            p = inverse @ (design @ (root * root * left))
            residual = left - p @ design
            step = p[geometric].copy()
            # what the geometric terms gained goes into the rotations
            for i, d in zip(geometric, step):
                start[common[i]] += d
            if not geometric or np.abs(step).max() < 1e-5 * ARCSEC:
                break
            left, _ = after_rotation(self.obs, start)
        p[geometric] = [start[common[i]] for i in geometric]
        return _Fitted(p, inverse, start, residual.reshape(2, -1), common)

    def model(self, fitted, chosen):
        """`PointingModel` with the effects, and the terms of each run."""
        base, p = self.base, fitted.p
        values = dict(zip(fitted.common, p))
        k, count = len(fitted.common), base.harmonic_count
        at = k + 2 * count
        effects = []
        for c in chosen:
            e = c.effect(self.problem)
            d = len(e.coefficient_names)
            sigma = np.sqrt(np.maximum(np.diag(fitted.inverse)[at:at + d], 0.0))
            effects.append(FittedEffect(e, p[at:at + d], sigma))
            at += d
        run_terms = self._run_terms(fitted, at)
        for t in base.own:
            values[t] = self.start.get(t, 0.0) + float(
                np.median([r[t] for r in run_terms.values()]))
        harmonics = None
        if count:
            full = np.zeros((2, COUNT))
            full[:, :count] = p[k:k + 2 * count].reshape(2, count)
            covariance = np.zeros((2 * COUNT, 2 * COUNT))
            index = np.concatenate((np.arange(count), COUNT + np.arange(count)))
            covariance[np.ix_(index, index)] = fitted.inverse[k:k + 2 * count, k:k + 2 * count]
            harmonics = Harmonics('zenith', full[0], full[1], covariance)
        covariance = np.zeros((len(values), len(values)))
        covariance[:k, :k] = fitted.inverse[:k, :k]
        facts = {'method': 'diagnosis', 'source': self.obs.run.meta.get('source'),
                 'rows': len(self.obs), 'encoder': self.encoder}
        if base.own:
            facts['own_terms'] = list(base.own)
            facts['own_terms_are'] = 'the median of the runs'
        texts = {str(self.obs.runs[r]): {t: (v + self.start.get(t, 0.0)) / ARCSEC
                                         for t, v in terms.items()}
                 for r, terms in run_terms.items()}
        order = [*fitted.common, *base.own]
        return PointingModel({t: values[t] for t in order}, covariance, harmonics, facts,
                             'rotation', effects), texts

    def _run_terms(self, fitted, at):
        own = self.base.own
        runs = np.unique(self.obs.label)
        return {int(r): dict(zip(own, fitted.p[at + i * len(own):at + (i + 1) * len(own)]))
                for i, r in enumerate(runs)} if own else {}


@dataclass
class _Fitted:
    p: np.ndarray
    inverse: np.ndarray
    start: dict
    residual: np.ndarray
    common: list


def _settle(problem, found, alpha, chance, folds):
    """Test each choice with all others in the model, and drop until all of them hold.

    They must be beyond chance, and gain on rows left out (not on stretches of time left out: what
    happened in one of them only is real, and cannot be foretold from the others).

    Returns
    -------
    stands : list of Standing
    gains : list of float
        Of each choice in `folds`, arcsec; empty without folds.
    """
    while True:
        stands = [standing(problem, found, i, chance) for i in range(len(found.chosen))]
        weak = [(s.p, i) for i, s in enumerate(stands) if s.p > alpha or s.delta_bic <= 0.0]
        if weak:
            found.dropped.append(found.chosen.pop(max(weak)[1]))
        else:
            gains = cv_gains(problem, found, folds) if folds else []
            if min(gains, default=1.0) > 0.0:
                return stands, gains
            found.dropped_by_cv.append(found.chosen.pop(int(np.argmin(gains))))
        found.state = problem.state(found.chosen)


def _refine_steps(work, found):
    """Put each step where it fits best: the search tries some of many times only."""
    problem, context = work.problem, work.obs.context
    bank = problem.dictionary
    for i, choice in enumerate(found.chosen):
        e = choice.effect(problem)
        if e.form != 'step':
            continue
        p = e.parameters
        tried = sorted(f.parameters['at'] for f in bank.effects
                       if f.form == 'step' and f.parameters['axis'] == p['axis'])
        k = tried.index(p['at'])
        between = places_of_steps(context, p['driver'])
        between = between[(between >= tried[max(k - 1, 0)])
                          & (between <= tried[min(k + 1, len(tried) - 1)])]
        near = Bank([effect('step', **{**p, 'at': float(t)}) for t in between], context)
        # with weights of its own: rows between the old place and the new look like outliers
        scores = near.score(problem.state(found.chosen, without=i))
        best = int(np.argmax(scores.delta_bic))
        bank.replace(choice.group, near.effects[best], near.of(best))


def _assemble(work, found, stands, fitted, chance):
    problem, obs = work.problem, work.obs
    nothing = problem.state([])
    base_fit = work.fit([], problem.state([], final=True))
    model, run_terms = work.model(fitted, found.chosen)
    base_model, _ = work.model(base_fit, [])
    effects = [_slip_effect(f, p, obs) for f, p in work.slips]
    for c, s, f in zip(found.chosen, stands, model.effects):
        effects.append(_diagnosed(problem, c, s, f, len(obs)))
    weights = found.state.weights
    keep = weights > 0.0
    excluded = obs.excluded + [
        obs.excluding(i, 'outlier: more than 7 times the noise from the model, and no whole bar '
                      'or line off') for i in np.flatnonzero(~keep)]
    dof = 2 * np.count_nonzero(keep) - len(found.state.basis)
    floor = rms(fitted.residual, keep) * np.sqrt(2 * keep.sum() / max(dof, 1))
    notes = list(obs.notes)
    for why, dropped in (('no gain on rows left out', found.dropped_by_cv),
                         ('the choice does not repeat without some of the runs, and predicts '
                          'them worse', found.not_repeated)):
        if dropped:
            notes.append(f'beyond chance, but {why}, so not added: '
                         + ', '.join(c.effect(problem).name for c in dropped))
    if work.infeasible.any():
        notes.append(f'{int(work.infeasible.sum())} rows are nearer to the zenith than the mount '
                     'can look')
    notes += [f'something unknown is left that follows the {e.fitted.effect.driver}: the model '
              f'has a curve for it ({e.fitted.effect.name})' for e in effects
              if e.fitted.effect.kind == 'smooth']
    return Diagnosis(
        _verdict(effects), work.base, obs, model, base_model, effects,
        _rms_entry(base_fit.residual, keep), _rms_entry(fitted.residual, keep),
        base_fit.residual, fitted.residual, weights,
        _ranking(problem, nothing, chance), found.first_p, work.untestable + _hidden(problem),
        floor, excluded, [], notes, {}, run_terms)


def _verdict(effects):
    """Of what carries most of the gain: curves (unknown), or effects that have a name."""
    if not effects:
        return 'none'
    curves = [e for e in effects if e.fitted.effect.kind == 'smooth']
    named = [e for e in effects if e.fitted.effect.kind != 'smooth']
    if sum(e.delta_bic for e in curves) > sum(e.delta_bic or 0.0 for e in named):
        return 'unknown'
    return 'ambiguous' if any(e.rivals for e in effects) else 'identified'


def _rms_entry(residual, keep):
    x, y = (float(np.sqrt(np.mean(np.square(r[keep])))) / ARCSEC for r in residual)
    return {'rms_arcsec': float(np.hypot(x, y)), 'rms_x_arcsec': x, 'rms_y_arcsec': y,
            'cv_rms_arcsec': None, 'holdout_rms_arcsec': None}


def _slip_effect(fitted, p, obs):
    return DiagnosedEffect(fitted, p, None, None, [], [], [], [],
                           fitted.effect.columns(obs.context))


def _diagnosed(problem, choice, stand, fitted, n):
    bank = choice.bank(problem)

    def names(groups):
        return list(dict.fromkeys(bank.effects[k].name for k in groups))
    rivals = [k for k in stand.alternatives
              if k not in stand.same or fitted.effect.mechanism is None
              or bank.effects[k].mechanism != fitted.effect.mechanism]
    return DiagnosedEffect(
        fitted, stand.p, stand.delta_bic, None, names(stand.alternatives), names(stand.same),
        names(rivals), _lines(bank, stand.scores.delta_bic),
        choice.columns(problem).reshape(-1, 2, n))


def _lines(bank, delta_bic):
    """Ranking: the best member of each line."""
    out, seen = [], set()
    best = delta_bic.max(initial=-np.inf)
    for g in np.argsort(-delta_bic):
        if np.isfinite(delta_bic[g]) and int(bank.line[g]) not in seen:
            seen.add(int(bank.line[g]))
            e = bank.effects[g]
            out.append({'name': e.name, 'cause': e.cause, 'driver': e.driver, 'axes': e.axes,
                        'delta_bic': float(delta_bic[g]),
                        'in_set': bool(delta_bic[g] >= max(best - 6.0, 0.0)), 'group': int(g)})
    return out


def _ranking(problem, state, chance):
    scores = problem.dictionary.score(state)
    lines = _lines(problem.dictionary, scores.delta_bic)
    p = chance.p_of_all(state, scores)
    for line in lines:
        line['p_family'] = float(p[line.pop('group')])
    return lines


def _hidden(problem):
    """Effects that this run cannot tell from the base's terms."""
    scores = problem.dictionary.score(problem.state([]))
    out = {}
    for e, dof in zip(problem.dictionary.effects, scores.dof):
        if dof == 0:
            out[e.name] = e.alias or 'it is the same as terms of the base on these directions'
    return list(out.items())


def _folds(work, count, rng):
    """Whole runs from 4 runs on, else rows at random; fewer folds where each takes long."""
    if work.problem.n > _LONG:
        count = min(count, 5)
    if len(work.obs.runs) >= _RUNS:
        return run_folds(work.obs.label, min(count, len(work.obs.runs)), rng)
    return random_folds(work.problem.n, count, rng)


def _stretches(work, count):
    """Folds of neighbours in time (or in the order of the rows), who may share their error."""
    order = work.obs.context.get('time')
    return contiguous_folds(np.arange(work.problem.n) if order is None else order, count)


@dataclass
class _Errors:
    """Cross-validated RMS, the choice repeated; `cut`: how many choices hold, where not all do."""

    before: float
    after: float
    cut: int | None = None
    stretches: dict = field(default_factory=dict)
    caution: str = ''


def _cross_validated(work, found, parts, alpha, rng):
    problem = work.problem
    keep = problem.state(found.chosen, final=True).weights > 0.0

    def judged(folds):
        """RMS with no choice, and with the first 0, 1, ... of each fold."""
        left, _ = nested(problem, folds, alpha, rng)
        return rms(cross_validate(problem, [], folds), keep), [rms(r, keep) for r in left]
    if not found.chosen:  # the model stays as it was
        before = rms(cross_validate(problem, [], parts), keep)
        return _Errors(before, before)
    before, counts = judged(parts)
    out = _Errors(before, counts[-1])
    if len(work.obs.runs) >= _RUNS:
        if out.after > before:
            out.cut = min(int(np.argmin(counts)), len(found.chosen))
            out.after = counts[out.cut]
            out.caution = _NOT_REPEATED if out.cut < len(found.chosen) else ''
    elif not work.base.own:
        apart, counts = judged(_stretches(work, len(parts)))
        out.stretches = {'before': apart, 'after': counts[-1]}
        if counts[-1] > apart:
            out.caution = _CAUTION.format('stretches of time', apart, counts[-1])
    if not out.caution and out.after > before:
        out.caution = _CAUTION.format('rows', before, out.after)
    return out
