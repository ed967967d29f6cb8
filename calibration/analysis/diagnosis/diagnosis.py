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


"""Diagnosis of a pointing run: effects the declared model lacks, their significance and gain."""

from dataclasses import replace

import numpy as np

from calibration.estimation.chance import FLIPS, Chance
from calibration.estimation.false_alarms import ALPHA
from calibration.estimation.folds import FOLDS, partitions_of

from ..finding import Finding, cautions_first
from .alternatives import alternatives, repeated_choice
from .base_terms import Base
from .detection_limits import detectable
from .diagnosis_result import build_diagnosis
from .effect_causes import diagnosed_effects, doubt_columns
from .effect_choice import choose_effects, keep_repeated, refine_scans
from .exact_models import exact_fits, exact_models, memory_findings
from .history_facts import history_findings
from .holdout import hold_out
from .implausible_terms import implausible_terms
from .mistaken_columns import check_columns
from .moving_terms import moving_findings
from .next_observations import propose
from .observations import mount_of, observations
from .page_figures import add_page_figures
from .period_scans import add_aliases, gear_findings, period_finding, settle_periods
from .prediction import better_prediction
from .residual_correlation import correlation_entry, residual_correlation
from .residual_patterns import (
    MOVES,
    ResidualRows,
    cluster_findings,
    rounding_findings,
    visit_findings,
)
from .row_counts import count_rows, repeats, worst_rows
from .run_problem import RunProblem
from .runs_alone import ask_runs
from .scatter import noise_of_runs, unequal_axes, unequal_scatter
from .sessions import arrange, median_findings, split_runs, with_zeros_of_terms
from .validation import add_errors, cross_validated

#: largest number of rows searched: time and memory grow with it
MOST_ROWS = 5000


def diagnose(runs, base='physical', alpha=ALPHA, *, holdout=None, own_terms=None, encoder='enc',
             flips=FLIPS, folds=FOLDS, seed=0, cross_validation=True,
             most_rows=MOST_ROWS, sessions=None, partitions=None, progress=None,
             first_answer=None, jobs=1, checked=None):
    """Find the effects that a model lacks, and cross-validate the improvement.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
        One run, or several runs of one mount.
    base : str or Base
        The declared model, see `Base.parse`.
    alpha : float
        Family-wise error rate: the probability that a clean run gets any effect.
    holdout : PointingRun or sequence of PointingRun, optional
        Validation runs; only `own_terms` (by default the zeros IA and IE) are refitted on them.
    own_terms : sequence of str, optional
        Terms fitted separately to each run (or session). By default chosen by `sessions.arrange`
        where there are several runs. ``()``: none.
    encoder : {'enc', 'abs'}
    flips : int
        Number of sign flips for each p-value. Fewer than 7 / alpha cannot resolve the smallest
        shares of alpha.
    folds : int
        Number of cross-validation folds (random, and as many contiguous ones; whole runs from 4
        runs on; at most 5 from 1500 rows on).
    seed : int
    cross_validation : bool
    most_rows : int
        Largest number of rows searched. Of more rows a sample, spread evenly over each run, is
        searched, and the resulting model is fitted to all rows. A note reports this and its cost.
    sessions : float, optional
        Gap, in hours, beyond which a new session with separate terms begins. By default chosen
        from the data, see `sessions.arrange`. 0: do not split runs.
    partitions : int, optional
        Number of random partitions in the cross-validation. By default as many as are needed to
        know its RMS to 3 %.
    progress : callable, optional
        Called with the current step, the folds done and the total number of folds (str, int, int;
        None where there is nothing to count).
    first_answer : callable, optional
        Called with a Finding when the search ends, before alternatives and cross-validation: the
        effects found, and the fit RMS without and with them. Also called before the search, with
        each Finding of motion between repeated visits to the same places.
    jobs : int
        Number of folds run in parallel, in forked processes. Keep 1 where threads of a ROS node
        hold locks. The result is the same.
    checked : sequence of ColumnCheck, optional
        Column checks of the runs and of the held-out runs, if already done.

    Returns
    -------
    Diagnosis

    Raises
    ------
    MistakenColumns
        A ValueError: the columns of a run do not hold what their names say, see
        `mistaken_columns`.
    ValueError
        Too few usable rows for the base, unknown terms, or a bad option.
    """
    checked, held = checked or [check_columns(each, encoder) for each in (runs, holdout or ())]
    if not 0.0 < alpha < 1.0:
        raise ValueError(f'alpha {alpha} is no probability between 0 and 1')
    hours = read = None
    if not isinstance(base, Base):
        base, read = Base.parse(base, own_terms or (), mount_of(runs)), runs
        runs, own_terms, hours = arrange(runs, base, own_terms, sessions, encoder)
        base = replace(base, own=own_terms)
    obs, rng = observations(runs, encoder), np.random.default_rng(seed)
    if len(obs) > most_rows:
        obs = obs.thinned(most_rows, rng)
    if progress:
        progress('looking for effects', 0, None)
    run = RunProblem(obs, base, alpha)
    rows = ResidualRows.from_observations(run.obs, run.problem.plain.fit([]).raw)
    again = visit_findings(rows, rows.visits(run.base.terms or rows.context.mount.names.index,
                                             bool(run.base.own)))
    for one in (*run.obs.notes, *again) if first_answer else ():
        if getattr(one, 'kind', '') in MOVES:
            first_answer(one)
    chance = Chance(run.problem.n, flips, rng, group=run.problem.sequence.group)
    folds = folds if cross_validation else 0
    parts = partitions_of(run.problem, folds, rng) if folds else ()
    choice = choose_effects(run, alpha, chance, parts, first_answer)

    def search_anew():
        """Repeat the search with the current rows and candidates."""
        tests = Chance(run.problem.n, flips, rng, group=run.problem.sequence.group)
        parts = partitions_of(run.problem, folds, rng) if folds else ()
        return tests, parts, choose_effects(run, alpha, tests, parts, first_answer)

    noise, noisier = noise_of_runs(run.obs, run.problem.plain.fit(
        choice.chosen, final=True).raw.reshape(2, -1))
    if noise is not None:  # with the noise of the other runs, rows of a noisy run were outliers
        run.weigh_runs(noise)
        chance, parts, choice = search_anew()
    shown, offered = ask_runs(run, choice, alpha, flips, rng)
    if offered:
        chance, parts, choice = search_anew()
    problem = run.problem
    left = residual_correlation(run, choice, alpha)
    errors = cross_validated(
        run, choice.chosen, left is not None and not left.along_the_sky, folds, alpha, chance, rng,
        partitions, progress, repeated_choice(choice), jobs) if folds else None
    if errors and errors.cut is not None:
        keep_repeated(problem, choice, errors.cut, alpha, chance, parts)
        left = residual_correlation(run, choice, alpha)
    refine_scans(run, choice)
    settled = settle_periods(problem, choice)
    add_aliases(problem, choice)
    periods = [period_finding(problem, choice, i, *each) for i, each in settled.items()]

    fits = exact_fits(run, choice, left)
    models = exact_models(run, choice, fits, left)
    effects = diagnosed_effects(run, choice, models[1][0], left)
    result = build_diagnosis(run, choice, fits, models, effects, chance)
    if read is not None:
        result.model = with_zeros_of_terms(result, read, runs)
    found = effects[len(run.slips):]
    rows = ResidualRows.from_observations(run.obs, result.residual_after)
    gathered = cluster_findings(rows)
    result.notes += [*moving_findings(run, choice, fits[1], result.run_terms), *noisier,
                     *median_findings(run, result.model), *history_findings(run, choice),
                     *repeats(rows), *periods,
                     *gear_findings(run, choice, found), *again, *gathered]
    if left is not None:
        result.add_correlation(
            correlation_entry(left, run, choice.chosen, result.residual_after))
    if errors:
        add_errors(result, found, run, choice, errors, rng)
    if result.verdict == 'none':
        result.detectable = detectable(problem, chance, alpha)
    if left is not None and not left.along_the_sky:
        result.notes += memory_findings(run, choice, fits[1])
    others = alternatives(problem, choice, errors.chosen if errors else [])
    for entry, some in zip(found, others):
        entry.contenders = [one for _, one in some]
    if result.verdict == 'ambiguous' or any(one['open'] for some in others for _, one in some):
        result.next_observations, result.no_star = propose(
            run, choice, [[group for group, one in some if one['open']] for some in others])
    result.notes += run.undetermined_findings()
    result.notes += rounding_findings(run.obs.run.meta, result.noise_floor_arcsec)

    result = count_rows(result)
    add_page_figures(result)
    result.worst_rows, result.unequal_scatter = worst_rows(result), unequal_scatter(result)
    result.unequal_axes = unequal_axes(result.residual_after, result.weights > 0.0,
                                       result.observations.context)
    if shown and not effects and result.unequal_axes:
        result.unequal_axes['runs_alone'] = shown
    result.columns_alike = checked.alike
    if run.obs.whole:
        result.notes.append(Finding('rows searched', len(run.obs), unit='rows',
                                    evidence={'all': len(run.obs.whole)}))
    result.notes += [*doubt_columns(result, checked.findings),
                     *(Finding('held out', evidence={'of': one}) for one in held.findings)]
    if result.cv_contiguous:
        result.notes += better_prediction(run, result.cv_contiguous['after'])
    result.notes = cautions_first(result.notes)
    result.unphysical = implausible_terms(result)
    if holdout is not None:
        holdout = holdout if hours is None else split_runs(holdout, hours)
        hold_out(holdout, result, own_terms or run.obs.run.mount.names.index, encoder)
    return result
