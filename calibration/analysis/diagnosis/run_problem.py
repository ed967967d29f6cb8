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

"""A run as a selection problem: observations, base columns and offered effects."""

from dataclasses import replace

import numpy as np

from calibration.estimation.selection_problem import SelectionProblem
from msg_tools.units import ARCSEC
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect

from ..finding import Finding
from ..term_fit import rotation_start
from .base_terms import determined_base
from .decoder_slips import decode_slips
from .offered_effects import offer_effects
from .row_counts import row_word


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
        self.problem = SelectionProblem(columns, left, obs.inverse_sigma, None, None,
                                        obs.sequence)
        self.slips = self._slips(alpha)
        self.untestable = offer_effects(self.problem, obs.context, base, curves)
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
