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

"""Which of a choice stand with all others in the model, and gain on rows left out."""

import numpy as np

from pointing_model.rms import radial_arcsec

from .folds import cross_validate_quickly
from .linear_model import LIVE
from .significance import significance


def eliminate(problem, choice, alpha, chance, partitions, alone=False):
    """Test each of a choice with all others in the model, and drop until all of them hold.

    Parameters
    ----------
    problem, alpha, chance, partitions
        As of `select.choose`.
    choice : ModelChoice
        Is changed.
    alone : bool
        Whether it is not asked how each stands in the end, and what could stand in its place; of a
        part it never is.

    Returns
    -------
    ModelChoice
    """
    failing = []
    while True:
        weakest, failing = _weakest(problem, choice, alpha, chance, alone or chance.of_part,
                                    failing)
        if weakest is not None:
            choice.dropped.append(choice.chosen.pop(weakest))
        else:
            choice.gains = _gains(problem, choice, partitions)
            if min(choice.gains, default=1.0) > 0.0:
                break
            worst = int(np.argmin(choice.gains))
            choice.dropped_by_cv.append(choice.chosen[worst])
            choice.chosen = choice.without(worst)
        choice.fit = problem.plain.fit(choice.chosen)
    if not (alone or chance.of_part):
        choice.significances = significances(problem, choice, alpha, chance)
    return choice


def significances(problem, choice, alpha, chance):
    """`Significance` of each of a choice; parameters as of `eliminate`."""
    return [significance(problem, choice, i, chance, alpha)
            for i in range(len(choice.chosen))]


def _weakest(problem, choice, alpha, chance, alone, failing):
    """Which of a choice does not hold beside the others, of several the likeliest by chance.

    Those that failed before are asked first.

    Returns
    -------
    weakest : int or None
    failing : list of CandidateGroup
        Others that do not hold.
    """
    for asked in (failing, choice.chosen):
        weakest, most, failing = None, -1.0, []
        for i in reversed(range(len(choice.chosen))):
            one = choice.chosen[i]
            # an effect stays while it changes: in the middle of the night it may be small
            if one not in asked or one.changes(choice.chosen):
                continue
            found = significance(problem, choice, i, chance, alpha, alone, most)
            if found.p > alpha or found.delta_bic <= 0.0:
                failing.append(one)
                if found.p > most:
                    weakest, most = i, found.p
                if most >= 1.0:
                    break
        if weakest is not None:
            break
    return weakest, [one for one in failing if one != choice.chosen[weakest]]


def _gains(problem, choice, partitions):
    """What each takes off the RMS of rows left out, the others being in the model, arcsec.

    Of an effect of one axis the RMS of that axis counts: what it does there must hold there. Of
    each the least of all partitions; empty without any.
    """
    keep, noise = choice.fit.weights > LIVE, choice.fit.noise
    if not partitions or not choice.chosen:
        return []
    whole, *without = (cross_validate_quickly(problem, some, noise, partitions) for some in (
        choice.chosen, *map(choice.without, range(len(choice.chosen)))))
    out = []
    for one, less in zip(choice.chosen, without):
        axes = {'az': [0], 'el': [1]}.get(one.effect(problem).axes, [0, 1])
        out.append(min(radial_arcsec(left[axes], keep) - radial_arcsec(with_it[axes], keep)
                       for left, with_it in zip(less, whole)))
    return out
