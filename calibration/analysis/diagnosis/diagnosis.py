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

"""Diagnosis of a pointing run: what the declared model lacks, how sure that is, what it gains."""

from functools import partial

import numpy as np

from calibration.estimation.chance import FLIPS, Chance
from calibration.estimation.select import choose, settled
from calibration.estimation.significance import SET_WIDTH
from pointing_model.effects.base import readable
from pointing_model.rms import radial_arcsec

from ..finding import Finding
from .alternatives import (
    alternatives,
    cause_counts,
    compare_alternatives,
    fit_causes,
    repeated_choice,
    run_counts,
)
from .detection_limits import detectable
from .diagnosis_base import Base, determined_base, mount_of, observations, with_held_terms
from .diagnosis_result import (
    DiagnosedEffect,
    cause_entry,
    diagnosed_effect,
    diagnosis_of,
    hidden,
    ranking_of,
)
from .expected_error import ahead, expected_error
from .history_facts import history_findings
from .implausible_terms import implausible_terms
from .input_check import check_columns
from .next_observations import propose
from .page_figures import add_page_figures
from .period_scans import period_findings, settle_periods
from .prediction import better_prediction
from .residual_correlation import along_the_sky, correlation_entry, residual_correlation
from .residual_patterns import (
    MOVES,
    ResidualRows,
    cluster_findings,
    gathered,
    patterns_first,
    visit_findings,
)
from .row_counts import diagnosis_row_counts, refused_if_few, row_word
from .row_facts import repeats, worst_rows
from .run_problem import RunProblem
from .scatter import unequal_axes, unequal_scatter
from .sessions import arrange, split
from .validation import FOLDS, cross_validated, hold_out, mark_undecided, partitions_of

#: rows that are looked at, where there are more: time and memory grow with them
MOST_ROWS = 5000
#: what changes little by little, where a step says "at once"
_GRADUAL = ('time', 'order', 'run_hours', 'temperature')
_MOST_CURVES = 2
_MORE = 1.02  # what terms fitted beside a wander leave over those without, from where it is said


def diagnose(runs, base='physical', alpha=0.01, *, holdout=None, own_terms=None, encoder='enc',
             flips=FLIPS, folds=FOLDS, seed=0, cross_validation=True,
             most_rows=MOST_ROWS, sessions=None, partitions=None, progress=None,
             first_answer=None, jobs=1, checked=None):
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
        Terms that each run (or session) fits for itself; by default chosen where there are
        several, see `sessions.arrange`. ``()``: none.
    encoder : {'enc', 'abs'}
    flips : int
        Sign flips behind each p.
    folds : int
        Of the cross-validation (random; as many contiguous ones; whole runs from 4 runs on; at
        most 5 from 1500 rows on).
    seed : int
    cross_validation : bool
    most_rows : int
        Of more than this a part is searched, spread evenly over each run, and the model that is
        found is fitted to all. A note says so, and what it costs.
    sessions : float, optional
        A gap longer than so many hours begins a session with terms of its own; by default told
        by the data, see `sessions.arrange`. 0: runs are taken as they are.
    partitions : int, optional
        Ways to divide the rows in the cross-validation; by default as many as it takes to know
        its figure to 1 %.
    progress : callable, optional
        Is told what is being done, and of the cross-validation how many folds of how many (str,
        int, int; None where there is nothing to count).
    first_answer : callable, optional
        Called with a Finding as soon as the search is over, before alternatives and rows left out:
        what it found, and the RMS of the rows fitted without and with it. Before the search with
        each on what moved between visits of the same places.
    jobs : int
        Folds of the cross-validation at a time, in processes that are forked: not where threads
        of a ROS node hold locks. The result is the same.
    checked : sequence of ColumnCheck, optional
        Of the runs, and of those held out, where their columns are checked already.

    Returns
    -------
    Diagnosis

    Raises
    ------
    MistakenColumns
        A ValueError: the columns of a run are not what they are named, see `input_check`.
    ValueError
        Too few usable rows for the base, unknown terms, or a bad option.
    """
    checked, held = checked or [check_columns(each, encoder) for each in (runs, holdout or ())]
    if not 0.0 < alpha < 1.0:
        raise ValueError(f'alpha {alpha} is no probability between 0 and 1')
    hours = None
    if not isinstance(base, Base):
        runs, own_terms, hours = arrange(runs, base, own_terms, sessions, encoder)
        base = Base.parse(base, own_terms, mount_of(runs))
    obs = observations(runs, encoder)
    if obs.context.left_out():
        obs.notes.append(not_taken(obs.context))
    base, left_open = determined_base(obs, base)
    rng = np.random.default_rng(seed)
    if len(obs) > most_rows:
        obs = obs.thinned(most_rows, rng)
    result = _diagnosis(obs, base, alpha, rng, flips, folds if cross_validation else 0, partitions,
                        progress or _silent, first_answer, jobs)
    if left_open is not None:
        result = with_held_terms(result, left_open)
    result = refused_if_few(result)
    add_page_figures(result)
    result.counts = diagnosis_row_counts(result).to_dict()
    result.worst_rows, result.unequal_scatter = worst_rows(result), unequal_scatter(result)
    result.unequal_axes = unequal_axes(result)
    result.columns_alike = checked.alike
    if obs.whole:
        result.notes.append(Finding('rows searched', len(obs), unit='rows',
                                    evidence={'all': len(obs.whole)}))
    result.notes += [*checked.findings,
                     *(Finding('held out', evidence={'of': one}) for one in held.findings)]
    if result.cv_contiguous:
        result.notes += better_prediction(obs, base, result.cv_contiguous['after'])
    result.notes = patterns_first(result.notes)
    result.unphysical = implausible_terms(result)
    if holdout is not None:
        holdout = holdout if hours is None else split(holdout, hours)
        hold_out(holdout, result, own_terms or obs.run.mount.names.index, encoder)
    return result


def _moves(obs, base, residual):
    """Findings on places visited again: of steps that began sessions, and of the given rows."""
    rows = ResidualRows(obs.context, obs.label, obs.lines, residual, row_word(obs.run))
    again = visit_findings(rows, rows.visits(base.terms or obs.run.mount.names.index))
    known = [one for one in obs.notes if isinstance(one, Finding)]
    return [one for one in (*known, *again) if one.kind in MOVES], again


def _silent(text, done, total):
    """Progress that nobody asked for."""


def not_taken(context):
    """Finding on the columns of a Context that are not taken as causes."""
    names = context.left_out()
    return Finding('columns not taken', evidence={
        'columns': [*map(context.wording, names)],
        # of TPOINT, which does not name them
        'unnamed': any(name.startswith('auxiliary_') for name in names)})


def _diagnosis(obs, base, alpha, rng, flips, folds, ways, progress, first_answer, jobs):
    progress('looking for effects', 0, None)
    run = RunProblem(obs, base, alpha)
    problem = run.problem
    moved, again = _moves(obs, base, problem.plain.fit([]).raw.reshape(2, -1))
    for one in moved if first_answer else ():
        first_answer(one)
    chance = Chance(problem.n, flips, rng, group=problem.sequence.group)
    partitions = partitions_of(problem, folds, rng) if folds else ()
    choice = _choose_beside_outliers(run, alpha, chance, partitions)
    problem = run.problem
    settle_periods(problem, choice)
    if first_answer:
        first_answer(_first_answer(problem, choice))
    choice = compare_alternatives(problem, choice, alpha, chance, partitions)
    settle_periods(problem, choice)
    left = residual_correlation(problem, choice, alpha)
    # noise that goes along the sky is not told from what the direction does: terms do not rest on
    # its memory
    mixed = along_the_sky(obs.context, problem.sequence) is None
    errors = cross_validated(run, choice.chosen, left is not None and mixed, folds, alpha, chance,
                             rng, ways, progress, repeated_choice(choice), jobs) if folds else None
    if errors and errors.cut is not None:
        choice.not_repeated = choice.chosen[errors.cut:]
        del choice.chosen[errors.cut:]
        choice.fit = problem.plain.fit(choice.chosen)
        settled(problem, choice, alpha, chance, partitions)
        compare_alternatives(problem, choice, alpha, chance, partitions, replacing=False)
        left = residual_correlation(problem, choice, alpha)
    _refine_scans(run, choice)
    periods = period_findings(problem, choice, settle_periods(problem, choice))
    fits = _fits(run, choice, left, mixed)
    result = _assemble(run, choice, fits, _models(run, choice, fits, mixed), chance,
                       partial(run.fits, left=left, mixed=mixed))
    result.notes += history_findings(run, choice, obs.lines)
    twice = repeats(problem.sequence.group, obs.lines, result.residual_after, row_word(obs.run))
    result.notes += [twice] if twice else []
    result.notes += periods + again + cluster_findings(ResidualRows(
        obs.context, obs.label, obs.lines, result.residual_after, row_word(obs.run)))
    if left is not None:
        result.add_correlation(correlation_entry(left, problem, obs.context, choice.chosen,
                                                 result.residual_after))
    found = result.effects[len(run.slips):]
    if errors:
        _add_errors(result, found, run, choice, errors, rng)
    if result.verdict == 'none':
        result.detectable = detectable(problem, chance, alpha)
    if left is not None and mixed:
        result.notes += _without_memory(run, choice, fits[1])
    others = alternatives(problem, choice, errors.chosen if errors else [])
    for entry, some in zip(found, others):
        entry.contenders = [one.entry for one in some]
    if result.verdict == 'ambiguous' or any(one.entry['open'] for some in others for one in some):
        result.next_observations, result.no_star = propose(
            problem, obs, base, choice,
            [[one.group for one in some if one.entry['open']] for some in others])
    return result


def _choose_beside_outliers(run, alpha, chance, partitions):
    """`choose`; outliers that gather at a place are no accidents where an effect explains them.

    `run.problem` trusts these rows then. One place after the other: beside those of another every
    effect would look like chance.
    """
    obs, plain = run.obs, run.problem
    groups = gathered(ResidualRows(obs.context, obs.label, obs.lines,
                                   plain.plain.fit([]).raw.reshape(2, -1)))
    trusted = np.zeros(len(obs), int)
    if groups:
        trusted[np.concatenate(groups)] = -1
    choice, first = None, ()
    for rows in groups:
        more = trusted.copy()
        more[rows] = 1
        problem = plain.trusting(more, first)
        found = choose(problem, alpha, chance, partitions)
        kept = plain.plain.fit(found.chosen, final=True).weights[rows] > 0.0
        if np.mean(kept) > 0.5:
            choice, trusted, run.problem = found, more, problem
            first = tuple(c for c in found.chosen
                          if c.plain and c.effect(problem).share == 'scans')
    return choice or choose(plain, alpha, chance, partitions)


def _first_answer(problem, choice):
    """What a search has found, and the RMS of the rows fitted without and with it, arcsec."""
    before, after = (radial_arcsec(fit.raw.reshape(2, -1), fit.weights > 0.0)
                     for fit in (problem.plain.fit([]), choice.fit))
    return Finding('first answer', before=before, after=after, causes=tuple(
        dict.fromkeys(c.effect(problem).name for c in choice.chosen)))


def _add_errors(result, found, run, choice, errors, rng):
    """Put the figures of rows left out into a result."""
    problem = run.problem
    if not choice.chosen:  # the model stays as it was
        errors.before, errors.stretches = errors.after, {
            key: errors.stretches[key.replace('before', 'after')] for key in errors.stretches}
    for entry, gain in zip(found, choice.gains):
        entry.cv_gain_arcsec = float(gain)
    for entry, one in ((result.before, errors.before), (result.after, errors.after)):
        entry.update(cv_rms_arcsec=one['radial'], cv_rms_x_arcsec=one['x'],
                     cv_rms_y_arcsec=one['y'])
    if errors.spread and choice.chosen:
        errors.spread |= cause_counts(errors.chosen, found) | run_counts(problem, choice)
    result.after['cv_spread'] = errors.spread
    result.cv_contiguous, result.cautions = errors.stretches, errors.cautions
    result.expected = expected_error(errors.left_out, choice.fit.weights > 0.0,
                                     problem.sequence.order, rng,
                                     *ahead(problem, choice.chosen, rng))
    if not problem.sequence.timed:
        result.expected['within'] = 'ten rows'
    mark_undecided(result, [readable(c.effect(problem).name) for c in
                            choice.dropped_by_cv + choice.not_repeated],
                   result.ranking[0]['delta_bic'] if result.ranking else 0.0)


def _fits(run, choice, left, mixed):
    """The exact fits without and with what was found; `choice.fit` is of the latter.

    What is not beyond chance is no reason for another fit. Without the effects noise with memory
    is mostly what they do: before them the rows are taken as `fit` takes them.
    """
    fitted, choice.fit = run.fits(choice.chosen, left, mixed)
    if left is not None and not choice.chosen:
        return fitted, fitted
    return run.exact_fit([], run.problem.plain.fit([], final=True)), fitted


def _models(run, choice, fits, mixed):
    """The models without and with what was found, and the terms of each run: of all rows."""
    fitted = zip(fits, ([], choice.chosen))
    if not run.obs.whole:
        return tuple(run.model(fit, chosen) for fit, chosen in fitted)
    memory = choice.fit.memory
    return tuple(run.model(run.whole_fit(fit, chosen, memory if fit is fits[1] else (), mixed),
                           chosen, run.obs.whole) for fit, chosen in fitted)


def _without_memory(run, choice, fitted):
    """A note where the same terms leave less if rows are taken to have no memory."""
    keep = choice.fit.weights > 0.0
    plain = run.problem.plain.fit(choice.chosen, final=True)
    alone = run.exact_fit(choice.chosen, plain)
    alone, here = (radial_arcsec(of.residual.reshape(2, -1), keep) for of in (alone, fitted))
    return [Finding('terms beside correlated noise', before=alone, after=here)
            ] if here > _MORE * alone else []


def _refine_scans(run, choice):
    """Put each member of a scan where it fits best: the search tries some of many places only."""
    problem = run.problem
    for i, one in enumerate(choice.chosen):
        if not one.plain or not one.effect(problem).searched:
            continue
        near = problem.finer(one.group)
        # with weights of its own: rows between the old place and the new look like outliers
        scores = near.score(problem.plain.fit(choice.chosen, without=i))
        best = int(np.argmax(scores.delta_bic))
        problem.replace(one.group, near.effects[best], near.of(best))


def _as_well_as_a_step(problem, choice, i):
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


def _beside(found, other, others, more=0, better=0.0):
    """What else a model has that explains the run as well with another effect in it."""
    return Finding('another model', causes=(found.name, other), evidence={
        'beside': [e.name for e in others], 'more': more,
        'better': better if better > SET_WIDTH else 0.0})


def _assemble(run, choice, fits, models, chance, fit):
    problem, obs = run.problem, run.obs
    effects = [DiagnosedEffect(f, p, f.effect.columns(obs.context)) for f, p in run.slips]
    beside = []
    for i, (c, s, f) in enumerate(zip(choice.chosen, choice.significances, models[1][0].effects)):
        bank, group = c.family(problem, choice.chosen)
        one = diagnosed_effect(f, s, c.columns(problem).reshape(-1, 2, len(obs)), bank.effects,
                               group)
        one.beside = {bank.effects[k].name: [c.effect(problem) for c in others]
                      for k, others in s.others.items()}
        larger = {bank.effects[k].name: more for k, more in s.larger.items()}
        for cause in one.causes:
            cause['more_effects'] = min(larger.get(name, (0,))[0] for name in cause['effects'])
        if len(one.causes) > 1:
            fit_causes(run, choice, i, one.causes, fit)
        gradual = _as_well_as_a_step(problem, choice, i)
        for e, gain in gradual:
            one.alternatives.append(e.name)
            one.other_causes.append(e.name)
            if e.cause_summary not in [cause['cause'] for cause in one.causes]:
                one.causes.append(cause_entry(e, gain))
        # of equals the order of the dictionary counts, not rounding
        one.causes.sort(key=lambda cause: (cause['more_effects'] > 0,
                                           -round(cause['delta_bic'], 1)))
        beside += [_beside(f.effect, other, others, *larger.get(other, ()))
                   for other, others in one.beside.items()]
        effects.append(one)
    notes = list(obs.notes)
    notes += [Finding(kind, causes=tuple(dict.fromkeys(c.effect(problem).name for c in dropped)))
              for kind, dropped in (('no gain on rows left out', choice.dropped_by_cv),
                                    ('not repeated', choice.not_repeated)) if dropped]
    if run.infeasible.any():
        notes.append(Finding('beyond the zenith', int(run.infeasible.sum()), unit='rows'))
    notes += beside
    notes += [Finding('curve', evidence={'driver': e.fitted.effect.driver,
                                         'shape': e.fitted.effect.shape})
              for e in effects if e.fitted.effect.kind == 'smooth']
    candidates = problem.dictionary.effects
    nothing = problem.plain.fit([])
    scores = problem.dictionary.score(nothing)
    ranking = ranking_of(candidates, scores.delta_bic, chance.p_of_all(nothing, scores))
    return diagnosis_of(run, choice, fits, models, effects, ranking,
                        run.untestable + hidden(candidates, scores.dof), notes)
