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

"""Search in each run alone: a worm error with a different phase per run cancels in all of them."""

from dataclasses import replace

import numpy as np

from calibration.estimation.chance import Chance
from calibration.estimation.folds import FOLDS, partitions_of
from pointing_model.effects.base import for_mount
from pointing_model.effects.drifts import several_runs
from pointing_model.effects.gears_and_worms import worm_waves

from .effect_choice import choose_effects
from .offered_effects import effect_bank
from .run_problem import RunProblem
from .scatter import unequal_axes

#: fewest rows of a run that is searched; largest number of runs searched
_ROWS, _MOST_RUNS = 20, 12


def ask_runs(run, choice, alpha, flips, rng):
    """Search each run alone, if no effect is found in all of them but one axis scatters more.

    Worm waves found in one run are offered to all, with a separate phase for each run. Such phases
    cannot be predicted for held-out runs, so cross-validation then holds out rows, not runs.

    Parameters
    ----------
    run : RunProblem
        Its problem is changed if such waves are found.
    choice : ModelChoice
    alpha : float
        Family-wise error rate over all runs.
    flips : int
    rng : numpy.random.Generator

    Returns
    -------
    shown : list of dict
        ``run``, ``effect`` (its name) and ``delta_bic``.
    offered : bool
        Whether new waves are offered.
    """
    obs, problem = run.obs, run.problem
    hidden = any(c.effect(problem).parameters.get('runs') for c in choice.dropped_by_cv)
    if len(obs.runs) < 2 or choice.chosen or not (hidden or unequal_axes(
            choice.fit.raw.reshape(2, -1), choice.fit.weights > 0.0, obs.context)):
        return [], False
    shown, worms = [], {}
    counts = np.bincount(obs.label, minlength=len(obs.runs))
    asked = np.flatnonzero(counts >= _ROWS)[:_MOST_RUNS]
    for k in asked:
        for e, gain in _alone(run, np.flatnonzero(obs.label == k), alpha / len(asked), flips, rng):
            shown.append({'run': obs.runs[k], 'effect': e.name, 'delta_bic': gain})
            p = e.parameters
            if e.form == 'periodic' and p['of'] != 'time' and not p['tape']:
                worms[p['axis']] = max(worms.get(p['axis'], (0.0,)), (gain, p['turns']))
    known = {e.name for e in problem.dictionary.effects}
    more = [e for axis, (_, turns) in worms.items() for e in for_mount(worm_waves(
        obs.context, axis, turns, several_runs(obs.context)), obs.context.mount)]
    if worms:
        run.problem = replace(problem, by_rows=True, _memories={}, _fits={}, dictionary=effect_bank(
            [*problem.dictionary.effects, *(e for e in more if e.name not in known)], obs.context))
    return shown, bool(worms)


def _alone(run, rows, alpha, flips, rng):
    """Effects found in some rows, with their BIC gains; empty if the base is undetermined."""
    try:
        own = RunProblem(run.obs.select(rows), replace(run.base, own=()), alpha)
    except ValueError:
        return []
    chance = Chance(own.problem.n, flips, rng, group=own.problem.sequence.group)
    choice = choose_effects(own, alpha, chance, partitions_of(own.problem, FOLDS, rng))
    return [(c.effect(own.problem), float(s.delta_bic))
            for c, s in zip(choice.chosen, choice.significances)]
