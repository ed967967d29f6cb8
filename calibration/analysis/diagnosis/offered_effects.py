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

"""Effects that are offered to a search: of the dictionary, steps, curves, periods, changes."""

from copy import copy
from itertools import product

import numpy as np

from calibration.estimation.candidate_scores import CandidateBank
from calibration.estimation.periodogram import PeriodBank
from pointing_model.effects import changes, dictionary, effect, smooths, steps
from pointing_model.effects.base import known
from pointing_model.effects.drifts import STEPPING, places_of_steps

from .period_scans import period_bank

_CHUNK = 64  # columns processed at a time


def effect_bank(effects, context, sizes=True):
    """`CandidateBank` of effects, with their columns for the rows of a context."""
    n, sizes_of = len(context), [len(e.coefficient_names) for e in effects]
    columns, start = np.zeros((sum(sizes_of), 2 * n)), 0
    # there are hundreds of effects: `Effect.columns` of each would take twice as long
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        for e, size in zip(effects, sizes_of):
            e.fill(columns[start:start + size].reshape(size, 2, n), context)
            start += size
    for i in range(0, len(columns), _CHUNK):
        known(columns[i:i + _CHUNK])
    return CandidateBank(effects, columns, sizes)


#: number of refined values of each scanned parameter, with one or two scanned parameters
_FINER = {1: 9, 2: 5}


class EffectVariants:
    """Changes of effects with time, and scan members between the grid points; evaluated on demand.

    Parameters
    ----------
    context : Context
        Context of the rows.
    """

    def __init__(self, context):
        self._context, self._changes, self._whole, self._rows = context, {}, None, None

    def columns(self, one):
        """Columns of any effect, shape (d, 2n)."""
        return self._bank([one]).columns

    def changes(self, one):
        """`CandidateBank` of the changes of an effect; it may be empty."""
        if id(one) not in self._changes:  # the stored effect keeps its id unique
            bank = (self._bank(changes(one, self._context)) if self._whole is None
                    else self._whole.changes(one).rows(self._rows))
            self._changes[id(one)] = one, bank
        return self._changes[id(one)][1]

    def finer(self, one, scan, level=0):
        """`CandidateBank` of members between the grid neighbours of a scan member.

        For a step these are all positions between rows. None for an effect that is not scanned.
        Each `level` narrows the interval by a factor of four.
        """
        if not one.searched:
            return None
        grids = [self._between(one, scan, name, 0.25**level) for name in one.searched]
        return self._bank([effect(one.form, **one.parameters | dict(zip(one.searched, values)))
                           for values in product(*grids)])

    def _between(self, e, scan, name, part):
        """Refined values of one scanned parameter around that of a member."""
        tried = sorted({f.parameters[name] for f in scan if f is not e})
        at = e.parameters[name]
        low = at - part * (at - max((v for v in tried if v < at), default=at))
        high = at + part * (min((v for v in tried if v > at), default=at) - at)
        if name == 'at':  # the position of a step between two rows does not matter
            places = places_of_steps(self._context, e.driver)
            return places[(places >= low) & (places <= high)].tolist() or [e.parameters[name]]
        count = _FINER[len(e.searched)] // 2 + 1
        return sorted({*np.linspace(low, at, count).tolist(),
                       *np.linspace(at, high, count).tolist()})

    def rows(self, rows):
        """Variants for a subset of the rows."""
        out = copy(self)
        out._changes, out._whole = {}, self._whole or self
        out._rows = rows if self._whole is None else self._rows[rows]
        return out

    def _bank(self, effects):
        """`CandidateBank` of effects for these rows."""
        bank = effect_bank(effects, self._context)
        return bank if self._whole is None else bank.rows(self._rows)


def offer_effects(problem, context, base, curves=True):
    """Give a `SelectionProblem` its candidates.

    Parameters
    ----------
    problem : SelectionProblem
    context : Context
        Context of its rows.
    base : Base
        Its terms and effects are not offered again.
    curves : bool
        Whether smooth curves and waves of unknown period are offered.

    Returns
    -------
    list
        Effects that these rows cannot test, see `pointing_model.effects.dictionary`.
    """
    names = context.mount.names
    effects, untestable = dictionary(
        context, [t for t in names.physical if t not in base.terms], base.own)
    if base.own and set(names.index) <= set(base.own):
        effects = [e for e in effects if e.form != 'run_zero']
    problem.dictionary = effect_bank(effects + steps(context, STEPPING), context)
    problem.curves = effect_bank(smooths(context) if curves else [], context)
    problem.periods = period_bank(context) if curves else PeriodBank([])
    problem.variants = EffectVariants(context)
    return untestable
