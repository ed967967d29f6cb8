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

"""Backward elimination: keep groups that are significant beside all others, and cross-validated."""

import numpy as np

from pointing_model.rms import radial_arcsec

from .folds import cross_validate_quickly
from .linear_model import LIVE
from .significance import significance, significances

#: part of the cross-validated RMS that a change of an effect must remove: an effect at a slightly
#: wrong place or width looks like a changing one
_WORTH = 0.05


def eliminate(problem, choice, alpha, chance, partitions, alone=False):
    """Test each selected group with all others in the model; drop one by one until all pass.

    Parameters
    ----------
    problem, alpha, chance, partitions
        See `select.choose`.
    choice : ModelChoice
        Changed in place.
    alone : bool
        Skip the final `Significance` of each group, with its alternatives; always so in a fold.

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
            choice.gains, spare = _gains(problem, choice, partitions)
            if min(spare, default=1.0) > 0.0:
                break
            worst = int(np.argmin(spare))
            choice.dropped_by_cv.append(choice.chosen[worst])
            choice.chosen = choice.without(worst)
        choice.fit = problem.plain.fit(choice.chosen)
    if not (alone or chance.of_part):
        choice.significances = significances(problem, choice, alpha, chance)
    return choice


def _weakest(problem, choice, alpha, chance, alone, failing):
    """The least significant group (largest p) of those that fail beside the others.

    Those that failed before are tested first.

    Returns
    -------
    weakest : int or None
    failing : list of CandidateGroup
        Other groups that fail.
    """
    for asked in (failing, choice.chosen):
        weakest, most, failing = None, -1.0, []
        for i in reversed(range(len(choice.chosen))):
            one = choice.chosen[i]
            # an effect stays while its change is selected: in mid-run the effect may be small
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
    """Cross-validated RMS removed by each group, the others being in the model, arcsec.

    For an effect of one axis the RMS of that axis. The least of all partitions; empty without
    partitions.

    Returns
    -------
    gains : list of float
    spare : list of float
        The same less the required improvement.
    """
    keep, noise = choice.fit.weights > LIVE, choice.fit.noise
    if not partitions or not choice.chosen:
        return [], []
    whole, *without = (cross_validate_quickly(problem, some, noise, partitions) for some in (
        choice.chosen, *map(choice.without, range(len(choice.chosen)))))
    gains, spare = [], []
    for one, less in zip(choice.chosen, without):
        axes = {'az': [0], 'el': [1]}.get(one.effect(problem).axes, [0, 1])
        rms = np.array([[radial_arcsec(left[axes], keep) for left in pair]
                        for pair in zip(less, whole)])
        gains.append(float((rms[:, 0] - rms[:, 1]).min()))
        least = 0.0 if one.of is None else _WORTH
        spare.append(float(((1.0 - least) * rms[:, 0] - rms[:, 1]).min()))
    return gains, spare
