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

"""A run in the form of the search, and the exact fit and the model that come out of it."""

from itertools import product

import numpy as np

from calibration.estimation.candidates import CandidateBank
from calibration.estimation.correlated_noise import CorrelatedNoise, WhiteNoise
from calibration.estimation.estimate import Estimate
from calibration.estimation.periodogram import PeriodBank
from calibration.estimation.robust import bisquare
from calibration.estimation.selection_problem import SelectionProblem
from msg_tools.units import ARCSEC
from pointing_model.effects import changes, dictionary, effect, smooths, steps
from pointing_model.effects.base import known
from pointing_model.effects.drifts import places_of_steps
from pointing_model.fitted_effects import FittedEffect
from pointing_model.harmonics import COUNT, Harmonics
from pointing_model.model import PointingModel
from pointing_model.mounts import rows_by_side
from pointing_model.rms import sigma_of

from ..finding import Finding
from .diagnosis_base import after_rotation, decode_slips, linearised, sequence_of
from .period_scans import period_bank
from .row_counts import row_word

_CHUNK = 64  # columns that are looked through at a time


def effect_bank(effects, context, sizes=True):
    """`CandidateBank` of effects, their columns for the rows of a context."""
    n, sizes_of = len(context), [len(e.coefficient_names) for e in effects]
    columns, start = np.zeros((sum(sizes_of), 2 * n)), 0
    # hundreds of effects: `Effect.columns` of each would take twice as long
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        for e, size in zip(effects, sizes_of):
            e.fill(columns[start:start + size].reshape(size, 2, n), context)
            start += size
    for i in range(0, len(columns), _CHUNK):
        known(columns[i:i + _CHUNK])
    return CandidateBank(effects, columns, sizes)


#: values of a scanned number that are tried between its neighbours, where one is scanned, or two
_FINER = {1: 9, 2: 5}


class EffectVariants:
    """How the effects of a dictionary may change, and members of a scan between those tried.

    Each is evaluated when it is asked for.

    Parameters
    ----------
    dictionary : CandidateBank
    context : Context
        Of the rows.
    """

    def __init__(self, dictionary, context):
        self._dictionary, self._context, self._banks = dictionary, context, {}

    def changes(self, group):
        """`CandidateBank` of the changes of a group; it may be empty."""
        one = self._dictionary.effects[group]
        if group not in self._banks or self._banks[group][0] is not one:
            self._banks[group] = one, effect_bank(changes(one, self._context), self._context)
        return self._banks[group][1]

    def finer(self, group, level=0):
        """Of a scan the `CandidateBank` of its members from the one that is tried before to the one
        after it, of a step at all places between rows; None of other effects. At each `level` four
        times as near to it.
        """
        bank, e = self._dictionary, self._dictionary.effects[group]
        if not e.searched:
            return None
        scan = [bank.effects[g] for g in np.flatnonzero(bank.line == bank.line[group])]
        grids = [self._between(e, scan, name, 0.25**level) for name in e.searched]
        return effect_bank([effect(e.form, **{**e.parameters, **dict(zip(e.searched, values))})
                            for values in product(*grids)], self._context)

    def _between(self, e, scan, name, part):
        """Values of one of the numbers of a scan about that of a member."""
        tried = sorted({f.parameters[name] for f in scan if f is not e})
        at = e.parameters[name]
        low = at - part * (at - max((v for v in tried if v < at), default=at))
        high = at + part * (min((v for v in tried if v > at), default=at) - at)
        if name == 'at':  # between two rows it is everywhere the same
            places = places_of_steps(self._context, e.driver)
            return places[(places >= low) & (places <= high)].tolist() or [e.parameters[name]]
        count = _FINER[len(e.searched)] // 2 + 1
        return sorted({*np.linspace(low, at, count).tolist(),
                       *np.linspace(at, high, count).tolist()})

    def rows(self, rows):
        """Those of some rows."""
        return _SomeVariants(self, rows)


class _SomeVariants:
    """`EffectVariants` of some rows."""

    def __init__(self, whole, rows):
        self._whole, self._rows, self._banks = whole, rows, {}

    def changes(self, group):
        bank = self._whole.changes(group)
        if group not in self._banks or self._banks[group][0] is not bank:
            self._banks[group] = bank, bank.rows(self._rows)
        return self._banks[group][1]

    def finer(self, group, level=0):
        bank = self._whole.finer(group, level)
        return None if bank is None else bank.rows(self._rows)

    def rows(self, rows):
        return _SomeVariants(self._whole, self._rows[rows])


class RunProblem:
    """Observations, base and candidates in the form of the search."""

    def __init__(self, obs, base, alpha, curves=True):
        columns = base.columns(obs.context, obs.label)
        if 2 * len(obs) < len(columns) + 4:
            raise ValueError(f'{len(obs)} usable observations do not determine {len(columns)} '
                             'coefficients and a residual; observe more or fit fewer terms')
        self.obs, self.base = obs, base
        self.start, left, feasible = linearised(obs, base)
        names = obs.context.mount.names
        effects, self.untestable = dictionary(
            obs.context, [t for t in names.physical if t not in base.terms], base.own)
        if base.own and set(names.index) <= set(base.own):
            effects = [e for e in effects if e.form != 'run_zero']
        self.problem = SelectionProblem(columns, left, obs.inverse_sigma, None, None,
                                        sequence_of(obs.context, obs.label))
        self.slips = self._slips(alpha)
        self.problem.dictionary = effect_bank(effects + steps(obs.context), obs.context)
        self.problem.curves = effect_bank(smooths(obs.context) if curves else [], obs.context)
        self.problem.periods = period_bank(obs.context) if curves else PeriodBank([])
        self.problem.variants = EffectVariants(self.problem.dictionary, obs.context)
        self.infeasible = ~feasible

    def _slips(self, alpha):
        """Correct whole bars and lines; they are known amounts."""
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
                'rows': [(self.obs.lines[r], m) for r, m in zip(rows, multiples)]}))
        return out

    def exact_fit(self, chosen, fit, true_noise=None):
        """`exact_fit` of a choice to these rows as a `WeightedFit` weighs them, an `Estimate`."""
        return exact_fit(self.obs, self.base, self.problem.design(chosen), self.start,
                         self.problem.b, fit.weights, fit.scale, fit.noise, true_noise)

    def fits(self, chosen, left, mixed):
        """The exact fit of a choice, and the weighted fit by which it is made."""
        plain = self.problem.plain.fit(chosen, final=True)
        if left is None:
            return self.exact_fit(chosen, plain), plain
        fit = self.problem.fit(chosen, final=True)
        return (self.exact_fit(chosen, fit) if mixed else
                self.exact_fit(chosen, plain, fit.noise)), fit

    def whole_fit(self, fitted, chosen, memory=(), mixed=True):
        """`exact_fit` of all rows of which these are a part.

        Each is weighted by how far it is from the fit of the part.

        Parameters
        ----------
        fitted : Estimate
            Of the part.
        chosen : list of CandidateGroup
        memory : tuple of AxisNoise
            Of the part's noise.
        mixed : bool
            Whether coefficients rest on that memory, and not their covariance alone.

        Returns
        -------
        Estimate
        """
        whole, n = self.obs.whole, len(self.obs.whole)
        design = self.base.columns(whole.context, whole.label).beside(
            *(c.effect(self.problem).columns(whole.context).reshape(-1, 2 * n) for c in chosen))
        start = self._rotation(fitted)
        left, _ = after_rotation(whole, start)
        p = fitted.coefficients.copy()
        p[_geometric(whole, self.base)] = 0.0  # in the rotations
        given = np.ones(2 * n) if whole.inverse_sigma is None else whole.inverse_sigma
        standard = ((left - p @ design) * given).reshape(2, n)
        middle = np.maximum(sigma_of(standard, axis=1), 1e-6 * ARCSEC)
        weights = bisquare(np.hypot(*(standard / middle[:, None])))
        scale = np.sqrt((weights * standard**2).sum(axis=1) / weights.sum()) + 1e-9 * ARCSEC
        white = WhiteNoise(given * np.tile(np.sqrt(weights), 2) / np.repeat(scale, n))
        noises = [white]
        if memory:
            sequence = sequence_of(whole.context, whole.label)
            noises += [CorrelatedNoise.beside(white, scale, sequence, memory)]
        return exact_fit(whole, self.base, design, start, left, weights, scale,
                         *(noises[-1:] if mixed else noises))

    def _rotation(self, fitted):
        """Terms of the exact rotations that a fit ends with."""
        values = dict(zip(self.base.common, fitted.coefficients))
        return {**self.start, **{name: values[name] for name in self.base.common
                                 if name in self.obs.context.mount.names.terms}}

    def model(self, fitted, chosen, obs=None):
        """What a fit of these rows, or of others, gives as a model.

        Returns
        -------
        model : PointingModel
            With the effects.
        run_terms : dict
            Run -> terms that it fitted for itself, arcsec.
        """
        obs, base = obs or self.obs, self.base
        p, common, start = fitted.coefficients, base.common, self.start
        values = dict(zip(common, p))
        k, count = len(common), base.harmonic_count
        harmonics = None
        if count:
            full = np.zeros((2, COUNT))
            full[:, :count] = p[k:k + 2 * count].reshape(2, count)
            covariance = np.zeros((2 * COUNT, 2 * COUNT))
            index = np.concatenate((np.arange(count), COUNT + np.arange(count)))
            covariance[np.ix_(index, index)] = fitted.covariance[k:k + 2 * count, k:k + 2 * count]
            harmonics = Harmonics(base.interpretation, full[0], full[1], covariance)
        sigma = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
        at, found = k + 2 * count, []
        for e in (c.effect(self.problem) for c in chosen):
            part = slice(at, at + len(e.coefficient_names))
            found.append(FittedEffect(e, p[part], sigma[part]))
            at = part.stop
        own = base.own
        run_terms = {int(r): dict(zip(own, p[at + i * len(own):at + (i + 1) * len(own)]))
                     for i, r in enumerate(np.unique(obs.label))} if own else {}
        for t in base.own:
            values[t] = start.get(t, 0.0) + float(np.median(
                [r[t] for r in run_terms.values()]))
        covariance = np.zeros((len(values), len(values)))
        covariance[:k, :k] = fitted.covariance[:k, :k]
        facts = {'method': 'diagnosis', 'source': obs.run.meta.get('source'),
                 'rows': len(obs), 'encoder': obs.encoder}
        if base.own:
            facts['own_terms'] = list(base.own)
            facts['own_terms_are'] = 'the median of the runs'
        texts = {str(obs.runs[r]): {t: (v + start.get(t, 0.0)) / ARCSEC
                                    for t, v in terms.items()} for r, terms in run_terms.items()}
        return PointingModel({t: values[t] for t in [*common, *base.own]}, covariance,
                             harmonics, facts, 'rotation', found, obs.run.mount,
                             sides=rows_by_side(obs.run.mount, obs.run['el'])), texts


def _geometric(obs, base):
    """Which of the common terms turn the mount."""
    return [i for i, t in enumerate(base.common) if t in obs.context.mount.names.terms]


def exact_fit(obs, base, design, start, left, weights, scatter, noise, true_noise=None):
    """Exact rotations with the effects, by iteration.

    Parameters
    ----------
    obs : Observations
    base : Base
    design : GroupColumns
        Of the base and the effects.
    start : dict of str to float
        Terms of the rotations to begin with.
    left : ndarray, shape (2n,)
        What these leave.
    weights : ndarray, shape (n,)
        Of the rows.
    scatter : ndarray, shape (2,)
        Of the axes.
    noise : WhiteNoise or CorrelatedNoise
        With these weights and that scatter.
    true_noise : WhiteNoise or CorrelatedNoise, optional
        By which the covariance is, where it is another.

    Returns
    -------
    Estimate
        First of the common coefficients, then of those of each run; the covariance is that of the
        common ones.
    """
    common, geometric = base.common, _geometric(obs, base)
    solve, start = design.solver(noise), dict(start)
    for _ in range(4):
        p, own = solve(left)
        residual = left - np.append(p, own) @ design
        step = p[geometric].copy()
        # what the geometric terms gained goes into the rotations
        for i, d in zip(geometric, step):
            start[common[i]] += d
        if not geometric or np.abs(step).max() < 1e-5 * ARCSEC:
            break
        left, _ = after_rotation(obs, start)
    p[geometric] = [start[common[i]] for i in geometric]
    inverse = solve.inverse if true_noise is None else solve.inverse_under(true_noise)
    return Estimate(np.append(p, own), inverse, np.full(len(p), np.inf), tuple(scatter), residual,
                    weights, len(design), robust=True)
