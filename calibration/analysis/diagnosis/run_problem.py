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

"""A run as a selection problem: observations, base columns and candidate effects."""

from copy import copy
from dataclasses import replace
from itertools import product

import numpy as np

from calibration.estimation.candidates import CandidateBank
from calibration.estimation.periodogram import PeriodBank
from calibration.estimation.selection_problem import SelectionProblem
from msg_tools.units import ARCSEC
from pointing_model.effects import changes, dictionary, effect, smooths, steps
from pointing_model.effects.base import known
from pointing_model.effects.drifts import places_of_steps
from pointing_model.fitted_effects import FittedEffect

from ..finding import Finding
from ..term_fit import rotation_start
from .base_terms import determined_base
from .decoder_slips import decode_slips
from .period_scans import period_bank
from .row_counts import row_word

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


class RunProblem:
    """Observations, base and candidates in the form of the search.

    Parameters
    ----------
    obs : Observations
    base : Base
        Stored without the terms that the stars do not determine.
    alpha : float
        False-alarm probability of decoder slips.
    curves : bool
        Whether smooth curves and waves of unknown period are candidates.

    Attributes
    ----------
    undetermined : FitResult or None
        See `determined_base`.

    Raises
    ------
    ValueError
        Too few rows for the base.
    """

    def __init__(self, obs, base, alpha, curves=True):
        base, self.undetermined = determined_base(obs, base)
        columns = base.columns(obs.context, obs.label)
        if 2 * len(obs) < len(columns) + 4:
            raise ValueError(f'{len(obs)} usable observations do not determine {len(columns)} '
                             'coefficients and a residual; observe more or fit fewer terms')
        self.obs, self.base = obs, base
        self.start, left, feasible = rotation_start(obs, base.terms)
        names = obs.context.mount.names
        effects, self.untestable = dictionary(
            obs.context, [t for t in names.physical if t not in base.terms], base.own)
        if base.own and set(names.index) <= set(base.own):
            effects = [e for e in effects if e.form != 'run_zero']
        self.problem = SelectionProblem(columns, left, obs.inverse_sigma, None, None,
                                        obs.sequence)
        self.slips = self._slips(alpha)
        self.problem.dictionary = effect_bank(effects + steps(obs.context), obs.context)
        self.problem.curves = effect_bank(smooths(obs.context) if curves else [], obs.context)
        self.problem.periods = period_bank(obs.context) if curves else PeriodBank([])
        self.problem.variants = EffectVariants(obs.context)
        self.infeasible = ~feasible

    def weigh_runs(self, sigma):
        """Weight rows by the noise of their run, shape (runs,), for another search."""
        for obs in filter(None, (self.obs, self.obs.whole)):
            own = np.tile(1.0 / sigma[obs.label], 2)
            obs.inverse_sigma = own if obs.inverse_sigma is None else own * obs.inverse_sigma
        self.problem = replace(
            self.problem, inverse_sigma=self.obs.inverse_sigma, trusted=None, first=(),
            dictionary=self.problem.dictionary.as_offered(),
            periods=self.problem.periods.as_offered(), _memories={}, _fits={})

    def undetermined_findings(self):
        """Findings on terms that the stars do not determine; empty if they determine all."""
        return [] if self.undetermined is None else [
            one for one in self.undetermined.findings(self.obs.run)
            if one.kind == 'undetermined terms']

    def _slips(self, alpha):
        """Correct slips by whole bars or lines, which are known amounts."""
        out, names = [], self.obs.context.mount.names
        for axis, graduation, rows, multiples, p in decode_slips(
                self.obs, self.problem.fit([]), alpha):
            e = effect('decode_slip', axis=axis, rows=self.obs.run['row'][rows].tolist(),
                       multiples=multiples.tolist(), graduation=graduation,
                       lines=self.obs.context.graduation[axis][graduation],
                       mount=self.obs.context.mount.kind)
            fitted = FittedEffect(e, np.array([ARCSEC]), np.zeros(1))
            x, y = fitted.offsets(self.obs.context)
            self.obs.observed = self.obs.observed - np.concatenate((x, y))
            self.problem.b = self.problem.b - np.concatenate((x, y))
            out.append((fitted, p))
            self.obs.notes.append(Finding('reading set right', evidence={
                'axis': names.word(axis), 'graduation': graduation,
                'word': row_word(self.obs.run),
                'rows': [(self.obs.places[r], m) for r, m in zip(rows, multiples)]}))
        return out
