"""A run in the form of the search, and the exact fit and the model that come out of it."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.effects import dictionary, effect, smooths, steps
from pointing_model.fitted_effects import FittedEffect
from pointing_model.harmonics import COUNT, Harmonics
from pointing_model.model import PointingModel
from pointing_model.mounts import rows_by_side

from .correlated_noise import Sequence
from .diagnosis_base import after_rotation, decode_slips, linearised
from .problem import Changes, Problem
from .row_counts import row_word
from .scores import Bank


class Work:
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
        self.problem = Problem(columns, left, obs.inverse_sigma, None, None,
                               Sequence.of(obs.context, obs.label))
        self.slips = self._slips(alpha)
        self.problem.dictionary = Bank(effects + steps(obs.context), obs.context)
        self.problem.curves = Bank(smooths(obs.context) if curves else [], obs.context)
        self.problem.changes = Changes(self.problem.dictionary, obs.context)
        self.infeasible = ~feasible

    def _slips(self, alpha):
        """Correct whole bars and lines; they are known amounts."""
        out, names = [], self.obs.context.mount.names
        for axis, graduation, rows, multiples, p in decode_slips(
                self.obs, self.problem.state([]), alpha):
            e = effect('decode_slip', axis=axis, rows=self.obs.run['row'][rows].tolist(),
                       multiples=multiples.tolist(), graduation=graduation,
                       lines=self.obs.context.graduation[axis][graduation],
                       mount=self.obs.context.mount.kind)
            fitted = FittedEffect(e, np.array([ARCSEC]), np.zeros(1))
            x, y = fitted.offsets(self.obs.context)
            self.obs.observed = self.obs.observed - np.concatenate((x, y))
            self.problem.b = self.problem.b - np.concatenate((x, y))
            out.append((fitted, p))
            self.obs.notes.append(
                f'the {names.word(axis)} encoder was read whole {graduation} beside the true '
                'place, and set right, in ' + ', '.join(
                    f'{row_word(self.obs.run)} {self.obs.lines[r]} ({m:+d})'
                    for r, m in zip(rows, multiples)))
        return out

    def fit(self, chosen, state, noise=None):
        """Exact rotations with the effects: coefficients, covariance, residual, by iteration.

        Parameters
        ----------
        chosen : list of Choice
        state : State
            By which rows are weighted.
        noise : State, optional
            With the wander by which the covariance is, where `state` has none.

        Returns
        -------
        Fitted
        """
        design = self.problem.design(chosen)
        common = [t for t in self.base.terms if t not in self.base.own]
        geometric = [i for i, t in enumerate(common) if t in self.obs.context.mount.names.terms]
        solve = design.solver(state.white)
        start, left = dict(self.start), self.problem.b
        for _ in range(4):
            p, own = solve(left)
            residual = design.left_by(p, own, left)
            step = p[geometric].copy()
            # what the geometric terms gained goes into the rotations
            for i, d in zip(geometric, step):
                start[common[i]] += d
            if not geometric or np.abs(step).max() < 1e-5 * ARCSEC:
                break
            left, _ = after_rotation(self.obs, start)
        p[geometric] = [start[common[i]] for i in geometric]
        inverse = solve.inverse if noise is None else solve.inverse_under(noise.white)
        return Fitted(np.append(p, own), inverse, start, residual.reshape(2, -1), common)

    def model(self, fitted, chosen):
        """`PointingModel` with the effects, and the terms of each run."""
        return made_model(self.obs, self.base, fitted, [c.effect(self.problem) for c in chosen])


@dataclass
class Fitted:
    """Coefficients, first the common ones, then those of each run; covariance of the common."""

    p: np.ndarray
    inverse: np.ndarray
    start: dict
    residual: np.ndarray
    common: list


def made_model(obs, base, fitted, effects):
    """What a fit says, as a model.

    Parameters
    ----------
    obs : Observations
    base : Base
    fitted : Fitted
    effects : list of Effect
        In the order of their coefficients.

    Returns
    -------
    model : PointingModel
    run_terms : dict
        Run -> terms that it fitted for itself, arcsec.
    """
    p = fitted.p
    values = dict(zip(fitted.common, p))
    k, count = len(fitted.common), base.harmonic_count
    harmonics = None
    if count:
        full = np.zeros((2, COUNT))
        full[:, :count] = p[k:k + 2 * count].reshape(2, count)
        covariance = np.zeros((2 * COUNT, 2 * COUNT))
        index = np.concatenate((np.arange(count), COUNT + np.arange(count)))
        covariance[np.ix_(index, index)] = fitted.inverse[k:k + 2 * count, k:k + 2 * count]
        harmonics = Harmonics(base.interpretation, full[0], full[1], covariance)
    sigma = np.sqrt(np.maximum(np.diag(fitted.inverse), 0.0))
    at, found = k + 2 * count, []
    for e in effects:
        part = slice(at, at + len(e.coefficient_names))
        found.append(FittedEffect(e, p[part], sigma[part]))
        at = part.stop
    own = base.own
    run_terms = {int(r): dict(zip(own, p[at + i * len(own):at + (i + 1) * len(own)]))
                 for i, r in enumerate(np.unique(obs.label))} if own else {}
    for t in base.own:
        values[t] = fitted.start.get(t, 0.0) + float(np.median([r[t] for r in run_terms.values()]))
    covariance = np.zeros((len(values), len(values)))
    covariance[:k, :k] = fitted.inverse[:k, :k]
    facts = {'method': 'diagnosis', 'source': obs.run.meta.get('source'),
             'rows': len(obs), 'encoder': obs.encoder}
    if base.own:
        facts['own_terms'] = list(base.own)
        facts['own_terms_are'] = 'the median of the runs'
    texts = {str(obs.runs[r]): {t: (v + fitted.start.get(t, 0.0)) / ARCSEC
                                for t, v in terms.items()} for r, terms in run_terms.items()}
    return PointingModel({t: values[t] for t in [*fitted.common, *base.own]}, covariance,
                         harmonics, facts, 'rotation', found, obs.run.mount,
                         sides=rows_by_side(obs.run.mount, obs.run['el'])), texts
