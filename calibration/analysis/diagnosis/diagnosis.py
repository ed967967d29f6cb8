"""Diagnosis of a pointing run: what the declared model lacks, how sure that is, what it gains."""

import numpy as np

from calibration.estimation.robust import BISQUARE
from pointing_model.effects import effect
from pointing_model.effects.base import readable, the
from pointing_model.effects.drifts import places_of_steps

from .alternative_choice import choose_with_rivals, with_rivals
from .alternatives import contenders
from .cause_models import by_any_cause, fit_causes
from .chance import Chance
from .choice_rules import choose, settled
from .constants import FLIPS, FOLDS, MOST_ROWS, SET_WIDTH
from .detection_limits import detectable
from .diagnosis_base import Base, mount_of, observations
from .diagnosis_result import DiagnosedEffect, cause_entry, concluded, diagnosed, hidden, ranking_of
from .excess import ahead, along_the_sky, unexplained, wander_entry
from .expected_error import expected_error
from .folds import radial_arcsec
from .implausible_terms import unphysical
from .input_check import check_columns
from .next_observations import propose
from .page_figures import by_size
from .repeats import repeats_sentence
from .row_counts import claimed, row_word
from .scores import Bank
from .sessions import arrange, split
from .undetermined_terms import determined, said
from .untestable import judge_undecided
from .validation import cross_validated, judge_on, partitions_of
from .working_run import Work

#: what changes little by little, where a step says "at once"
_GRADUAL = ('time', 'order', 'run_hours', 'temperature')
_MOST_CURVES = 2
_MORE = 1.02  # what terms fitted beside a wander leave over those without, from where it is said


def diagnose(runs, base='physical', alpha=0.01, *, holdout=None, own_terms=None, encoder='enc',
             flips=FLIPS, folds=FOLDS, seed=0, cross_validation=True,
             most_rows=MOST_ROWS, sessions=None, partitions=None, progress=None,
             jobs=1):
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
        Of more than this a part is looked at, spread evenly over each run. A note says so, and what
        it costs.
    sessions : float, optional
        A gap longer than so many hours begins a session with terms of its own; by default told
        by the data, see `sessions.arrange`. 0: runs are taken as they are.
    partitions : int, optional
        Ways to divide the rows in the cross-validation; by default as many as it takes to know
        its figure to 1 %.
    progress : callable, optional
        Is told what is being done, and of the cross-validation how many folds of how many (str,
        int, int; None where there is nothing to count).
    jobs : int
        Folds of the cross-validation at a time, in processes that are forked: not where threads
        of a ROS node hold locks. The result is the same.

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
    checked = check_columns(runs, encoder)
    held = check_columns(holdout or (), encoder)
    if not 0.0 < alpha < 1.0:
        raise ValueError(f'alpha {alpha} is no probability between 0 and 1')
    hours = None
    if not isinstance(base, Base):
        runs, own_terms, hours = arrange(runs, base, own_terms, sessions, encoder)
        base = Base.parse(base, own_terms, mount_of(runs))
    obs = observations(runs, encoder)
    if obs.context.left_out():
        obs.notes.append(not_taken(obs.context))
    base, left_open = determined(obs, base)
    rng = np.random.default_rng(seed)
    if len(obs) > most_rows:
        obs = obs.thinned(most_rows, rng)
    result = _diagnosis(obs, base, alpha, rng, flips, folds if cross_validation else 0, partitions,
                        progress or _silent, jobs)
    if left_open is not None:
        result = said(result, left_open)
    result = claimed(result)
    by_size(result)
    result.columns_alike = checked.alike
    if obs.thinned_from:
        result.notes.append(
            f'{len(obs)} of {obs.thinned_from} rows were looked at, spread evenly over each run. '
            f'An effect must be {(obs.thinned_from / len(obs))**0.5:.1f} times as large to be '
            'found as with all of them; fit --base MODEL fits all rows to the model that is found')
    result.notes += [*checked.notes, *(f'held out: {note}' for note in held.notes)]
    result.unphysical = unphysical(result)
    if holdout is not None:
        holdout = holdout if hours is None else split(holdout, hours)
        judge_on(holdout, result, own_terms or obs.run.mount.names.index, encoder)
    return result


def _silent(text, done, total):
    """Progress that nobody asked for."""


def not_taken(context):
    """A note of the columns that are not taken as causes, and how to make one of them.

    Parameters
    ----------
    context : Context

    Returns
    -------
    str
    """
    names = context.left_out()
    how = '--cause COLUMN takes one'
    if any(name.startswith('auxiliary_') for name in names):  # of TPOINT, which does not name them
        how += ('; one that is the air temperature: telescope-mount export RUN run.csv, and call '
                'the column temperature_c')
    return ('not taken as causes, for they may be outcomes of a measurement: '
            f'{", ".join(map(context.said, names))} ({how})')


def _diagnosis(obs, base, alpha, rng, flips, folds, ways, progress, jobs):
    progress('looking for effects', 0, None)
    work = Work(obs, base, alpha)
    problem = work.problem
    chance = Chance(problem.n, flips, rng, group=problem.sequence.group)
    partitions = partitions_of(problem, folds, rng) if folds else ()
    chosen = choose_with_rivals(problem, alpha, chance, partitions)
    found = chosen.found
    left = unexplained(problem, found, alpha)
    # a wander along the sky is not told from what the direction does: terms do not rest on it
    mixed = along_the_sky(obs.context, problem.sequence) is None
    errors = cross_validated(work, found.chosen, left is not None and mixed, folds, alpha, chance,
                             rng, ways, progress,
                             choose_with_rivals if chosen.replaced else choose,
                             jobs) if folds else None
    if errors and errors.cut is not None:
        found.not_repeated = found.chosen[errors.cut:]
        del found.chosen[errors.cut:]
        found.state = problem.plain.state(found.chosen)
        chosen = with_rivals(problem, settled(problem, found, alpha, chance, partitions), alpha,
                             chance, partitions, replacing=False)
        left = unexplained(problem, found, alpha)
    _refine_steps(work, found)
    base_fit, fitted = _fits(work, found, left, mixed)
    result = _assemble(work, found, chosen.stands, (base_fit, fitted), chance,
                       lambda some: _fit_of(work, some, left, mixed)[0])
    twice = repeats_sentence(problem.sequence.group, obs.lines, result.residual_after,
                             row_word(obs.run))
    result.notes += [twice] * bool(twice)
    if left is not None:
        result.told_of_wander(wander_entry(left, problem, obs.context, found.chosen,
                                           result.residual_after))
    if errors:
        if not found.chosen:  # the model stays as it was
            errors.before, errors.stretches = errors.after, {
                key: errors.stretches[key.replace('before', 'after')] for key in errors.stretches}
        for entry, gain in zip(result.effects[len(work.slips):], chosen.gains):
            entry.cv_gain_arcsec = float(gain)
        for entry, one in ((result.before, errors.before), (result.after, errors.after)):
            entry.update(cv_rms_arcsec=one['radial'], cv_rms_x_arcsec=one['x'],
                         cv_rms_y_arcsec=one['y'])
        if errors.spread and found.chosen:
            errors.spread |= by_any_cause(errors.chosen, result.effects[len(work.slips):])
        result.after['cv_spread'] = errors.spread
        result.cv_contiguous, result.caution = errors.stretches, errors.caution
        result.expected = expected_error(
            errors.left_out, found.state.weights > 0.0, problem.sequence.order, rng,
            *ahead(problem, found.chosen, rng))
        if not problem.sequence.timed:
            result.expected['within'] = 'ten rows'
        judge_undecided(result, [readable(c.effect(work.problem).name) for c in
                                 found.dropped_by_cv + found.not_repeated],
                        result.ranking[0]['delta_bic'] if result.ranking else 0.0)
    if result.verdict == 'none':
        result.detectable = detectable(work.problem, chance, alpha)
    if left is not None and mixed:
        result.notes += _without_memory(work, found, fitted)
    rivals = contenders(problem, chosen, errors.chosen if errors else [])
    for entry, some in zip(result.effects[len(work.slips):], rivals):
        entry.contenders = [one.entry for one in some]
    if result.verdict == 'ambiguous' or any(one.entry['open'] for some in rivals for one in some):
        result.next_observations, result.no_star = propose(
            problem, obs, base, found, chosen.stands,
            [[one.group for one in some if one.entry['open']] for some in rivals])
    return result


def _fits(work, found, left, mixed):
    """The exact fits without and with what was found; `found.state` is of the latter.

    What is not beyond chance is no reason for another fit. Without the effects what wanders is
    mostly what they do: before them the rows are taken as `fit` takes them.
    """
    fitted, found.state = _fit_of(work, found.chosen, left, mixed)
    if left is not None and not found.chosen:
        return fitted, fitted
    return work.fit([], work.problem.plain.state([], final=True)), fitted


def _fit_of(work, chosen, left, mixed):
    """The exact fit of a choice, and the state by which it is made."""
    problem = work.problem
    if left is None:
        state = problem.plain.state(chosen, final=True)
        return work.fit(chosen, state), state
    state = problem.state(chosen, final=True)
    return (work.fit(chosen, state) if mixed else work.fit(
        chosen, problem.plain.state(chosen, final=True), state)), state


def _without_memory(work, found, fitted):
    """A note where the same terms leave less if rows are taken to have no memory."""
    keep = found.state.weights > 0.0
    alone = work.fit(found.chosen, work.problem.plain.state(found.chosen, final=True)).residual
    alone, here = radial_arcsec(alone, keep), radial_arcsec(fitted.residual, keep)
    return [f'the zero wanders, and the terms were fitted with that in mind; `fit`, which takes '
            f'each row for itself, leaves {alone:.2f} in place of {here:.2f} arcsec on these rows, '
            'because its terms take up a part of the wander'
            ] if here > _MORE * alone else []


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
        scores = near.score(problem.plain.state(found.chosen, without=i))
        best = int(np.argmax(scores.delta_bic))
        problem.replace(choice.group, near.effects[best], near.of(best))


def _as_well_as_a_step(problem, found, i):
    """Curves of time or temperature that explain as much as a step, and their gains."""
    choice = found.chosen[i]
    if choice.effect(problem).form != 'step' or not len(problem.curves):
        return []
    state = problem.plain.state(found.chosen, without=i)
    own = problem.dictionary.score(state).delta_bic[choice.group]
    scores = problem.curves.score(state, gains_only=True)
    out = {}
    for g in np.argsort(-scores.delta_bic):
        e = problem.curves.effects[g]
        if scores.delta_bic[g] > own - SET_WIDTH and e.driver in _GRADUAL:
            out.setdefault(e.name, (e, float(scores.delta_bic[g])))
    return list(out.values())[:_MOST_CURVES]


def _beside(found, rival, others, more=0, better=0.0):
    """A note on what else a model has that explains the run as well with a rival in it."""
    beside = ', '.join(readable(e.name) for e in others) or 'none'
    text = (f'with {readable(rival)} in the place of {readable(found.name)} the run is explained '
            f'as well, with other effects beside it: {beside}')
    if more:
        text += (f'. That is {more} effect{"s" * (more > 1)} more'
                 + (f', which the rows pay for (ΔBIC {better:.0f} better); the model with fewer '
                    'was kept' if better > SET_WIDTH else ''))
    return text


def _assemble(work, found, stands, fits, chance, fit):
    problem, obs = work.problem, work.obs
    base_fit, fitted = fits
    nothing = problem.plain.state([])
    made = work.model(base_fit, []), work.model(fitted, found.chosen)
    effects = [DiagnosedEffect(f, p, f.effect.columns(obs.context)) for f, p in work.slips]
    beside = []
    for i, (c, s, f) in enumerate(zip(found.chosen, stands, made[1][0].effects)):
        bank, group = c.family(problem, found.chosen)
        one = diagnosed(f, s.p, c.columns(problem).reshape(-1, 2, len(obs)), bank.effects,
                        s.every, group, s.alternatives, s.same)
        one.companions = {bank.effects[k].name: [c.effect(problem) for c in others]
                          for k, others in s.companions.items()}
        larger = {bank.effects[k].name: told for k, told in s.larger.items()}
        for told in one.causes:
            told['more_effects'] = min(larger.get(name, (0,))[0] for name in told['effects'])
        if len(one.causes) > 1:
            fit_causes(work, found, i, s, one.causes, fit)
        gradual = _as_well_as_a_step(problem, found, i)
        for e, gain in gradual:
            one.alternatives.append(e.name)
            one.rivals.append(e.name)
            if e.cause_told not in [told['cause'] for told in one.causes]:
                one.causes.append(cause_entry(e, gain))
        one.causes.sort(key=lambda told: (told['more_effects'] > 0, -told['delta_bic']))
        beside += [_beside(f.effect, rival, others, *larger.get(rival, ()))
                   for rival, others in one.companions.items()]
        effects.append(one)
    notes = list(obs.notes)
    for why, dropped in (('no gain on rows left out', found.dropped_by_cv),
                         ('runs or rows that are left out are predicted worse with it',
                          found.not_repeated)):
        if dropped:
            notes.append(f'beyond chance, but {why}, so not added: '
                         + '; '.join(dict.fromkeys(readable(c.effect(problem).name)
                                                      for c in dropped)))
    if work.infeasible.any():
        notes.append(f'{int(work.infeasible.sum())} rows are nearer to the zenith than the mount '
                     'can look')
    notes += beside
    notes += [f'something unknown is left that follows {the(e.fitted.effect.driver)}: the model '
              f'has a curve for it, {e.fitted.effect.shape}' for e in effects
              if e.fitted.effect.kind == 'smooth']
    candidates = problem.dictionary.effects
    scores = problem.dictionary.score(nothing)
    ranking = ranking_of(candidates, scores.delta_bic, chance.p_of_all(nothing, scores))
    outlier = f'outlier: more than {BISQUARE:g} times the noise away from the model, and not by ' \
              'whole lines of the encoder'
    return concluded(
        obs, work.base, (base_fit, fitted), made, effects, found.state.weights,
        len(found.state.basis), outlier, ranking,
        work.untestable + hidden(candidates, scores.dof), notes)
