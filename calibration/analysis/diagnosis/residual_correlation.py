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

"""Correlated residuals: significant correlation in time whose cause is unknown.

Measures its size, the differences between rows by their distance in time, whether it is a steady
drift, and whether the order of the rows lets it be confused with a function of direction.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from calibration.estimation.candidate_scores import CandidateGroup
from calibration.estimation.correlated_noise import WhiteNoise
from calibration.estimation.equal_causes import SET_WIDTH
from calibration.estimation.linear_model import DISTINCT
from msg_tools.units import ARCSEC
from pointing_model.rms import rms

#: effective number of independent tests in the likelihood ratio of correlated noise, over both axes
#: and all correlation times and sizes tried: of 500 nights of white noise each with N = 30, 60,
#: 200, p is 0.01 or less in 0.8, 0.2 and 1.0 %, 0.05 or less in 4.0, 3.4 and 3.8 %
_TESTS = 6.0
_SOME = 600  # rows at a time: the effort grows with the cube
_PART = 0.5  # largest separation of pairs, relative to the length of the run
_STEP = 1.0 / 3.0  # steps below this share of the typical distance of two rows go along the sky
_ANCHORS = 400  # largest number of rows whose pairs are used
_ABOUT = 0.5  # relative tolerance of the separation of a pair in the order
_NEAR = 5.0  # deg on the sky, two rows within it are always near
#: drivers whose smooth curves are drifts themselves
_DRIFTS = ('time', 'order', 'run_hours')
FEWEST = 10  # fewest pairs for a reported figure


@dataclass
class ResidualCorrelation:
    """Correlated residuals that no driver explains.

    Attributes
    ----------
    axes : dict of str to AxisNoise
        ``az``, ``el``: the axes with correlated noise.
    p : float
        Upper limit of the p-value for white noise.
    like : list of CandidateGroup
        Effects that explain the correlation as well, with white noise; most likely first.
    along_the_sky : dict or None
        See `along_the_sky`.
    """

    axes: dict
    p: float
    like: list = field(default_factory=list)
    along_the_sky: dict | None = None


def residual_correlation(run, choice, alpha):
    """Test for correlated noise beyond the selected effects.

    Noise is correlated if either of two tests is significant at `alpha`: an effect that would be
    added with white noise is not significant with correlated noise, or the restricted likelihood
    ratio of correlated noise is significant.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    alpha : float

    Returns
    -------
    ResidualCorrelation or None
    """
    problem = run.problem
    memory = problem.fit(choice.chosen).memory
    if not memory:
        return None
    p = memory_chance(memory)
    if not choice.masked and p > alpha:
        return None
    axes = {name: one for name, one in zip(('az', 'el'), memory) if one.variance > 0.0}
    # of masked effects only p < alpha is known
    return ResidualCorrelation(axes, min(p, alpha), _equal_effects(problem, choice.chosen, axes),
                               along_the_sky(run.obs.context, problem.sequence))


def _equal_effects(problem, chosen, axes):
    """Candidates that explain the rows as well as correlated noise on their axes does.

    Their BIC is within `SET_WIDTH` of that of correlated noise (two parameters per axis, size and
    correlation time) and of the best candidate on the same axes.
    """
    fit = problem.plain.fit(list(chosen))
    cost = 2.0 * np.log(max(np.count_nonzero(fit.weights > 0.0), 2))
    of_noise = [axes[name].gain - cost if name in axes else -np.inf for name in ('az', 'el')]
    # skip an axis where correlated noise does not gain by BIC
    memory = {i: gain for i, gain in enumerate(of_noise) if gain >= min(max(of_noise), 0.0)}
    least = min(memory.values()) - SET_WIDTH
    found = []
    for bank in (problem.dictionary, problem.curves):
        if not len(bank):
            continue
        gains = bank.score(fit).delta_bic
        for g in np.flatnonzero(gains >= max(least, 0.0)):
            if bank.effects[g].kind == 'smooth' and bank.effects[g].driver in _DRIFTS:
                continue
            one = CandidateGroup(int(g), bank is problem.curves)
            moves = np.abs(one.columns(problem).reshape(-1, 2, problem.n)).max(axis=(0, 2)) > 0.0
            on = tuple(i for i in memory if moves[i])
            if on and gains[g] >= sum(memory[i] for i in on) - SET_WIDTH:
                found.append((float(gains[g]), on, one))
    best = {on: max(gain for gain, its, _ in found if its == on) for _, on, _ in found}
    return [one for gain, on, one in sorted(found, key=lambda each: -each[0])
            if gain >= best[on] - SET_WIDTH]


def memory_chance(memory):
    """P-value, under white noise, of the larger likelihood ratio of the two axes.

    Parameters
    ----------
    memory : tuple of AxisNoise

    Returns
    -------
    float
    """
    gain = max(one.gain for one in memory)
    return float(min(_TESTS * 0.5 * math.erfc(math.sqrt(0.5 * max(gain, 0.0))), 1.0))


def correlation_entry(found, run, chosen, residual):
    """JSON-ready entry of a result.

    Parameters
    ----------
    found : ResidualCorrelation
    run : RunProblem
    chosen : list of CandidateGroup
        The effects in the model.
    residual : ndarray, shape (2, n)
        Residuals of the model, radians.

    Returns
    -------
    dict
        ``p`` (upper limit); ``like`` (names of effects that explain it as well); ``slow``: whether
        the correlation time exceeds the interval between rows; ``along_the_sky``, see
        `along_the_sky`; ``removes_rms_arcsec``: its contribution in these rows, RMS on the sky
        beyond the terms; ``explained_by``: ``cause`` and ``driver`` of the effects that explain it
        as well, and whether they are a ``curve``; ``pairs``: number of pairs of rows ``within_deg``
        on the sky and far apart in the order; and ``axes``. For each axis the fitted
        ``sigma_arcsec``, correlation time ``memory`` and ``span`` of the rows in ``unit`` (hours,
        rows), ``angle`` (whether it acts on the axis angle: times cos E on the sky);
        ``row_to_row_arcsec``, the expected noise between neighbours; measured differences of rows
        ``apart`` from one another, in ``unit``, see `PairDifferences.to_dict`; and ``trend``, see
        `trend`.
    """
    problem, context = run.problem, run.obs.context
    sequence = problem.sequence
    unit = 3600.0 if sequence.timed else 1.0
    distance = _pair_distance(sequence)
    gap = sequence.gap
    usual = float(np.quantile(gap[np.isfinite(gap)], 0.9))
    axes, slow = {}, False
    seen = PairDifferences(context, sequence, residual,
                           problem.plain.fit(chosen).weights > 0.0, distance)
    for name, one in found.axes.items():
        axis = ('az', 'el').index(name)
        near = (one.scale * problem.scale_unit[axis])**2 + one.variance * -np.expm1(
            -float(np.median(gap[np.isfinite(gap)])) / one.memory)
        axes[name] = {'sigma_arcsec': float(np.sqrt(one.variance) / ARCSEC),
                      'memory': float(one.memory / unit), 'span': sequence.span / unit,
                      'unit': 'hours' if sequence.timed else 'rows', 'apart': distance / unit,
                      'angle': one.scaled, **seen.to_dict(axis),
                      'row_to_row_arcsec': float(np.sqrt(near) / ARCSEC),
                      'trend': trend(problem, chosen, name, one)}
        slow |= one.memory > usual
    effects = [c.effect(problem) for c in found.like]
    return {'axes': axes, 'p': found.p,
            'removes_rms_arcsec': beyond_terms(
                problem, slow_noise(problem, chosen, found.axes), chosen),
            'like': list(dict.fromkeys(e.name for e in effects)),
            'explained_by': [{'cause': e.cause_summary, 'driver': e.driver,
                              'curve': e.kind == 'smooth'} for e in effects],
            'slow': bool(slow), 'along_the_sky': found.along_the_sky,
            'within_deg': seen.within, 'pairs': seen.pairs()}


def _pair_distance(sequence):
    """Separation of the pairs of rows whose differences are reported."""
    if not sequence.timed:
        return 10.0 if _PART * sequence.span >= 10.0 else 3.0
    return next((s for s in (3600.0, 600.0) if s <= _PART * sequence.span), 60.0)


def along_the_sky(context, sequence):
    """Whether neighbours in time are neighbours on the sky: then drift can look like direction.

    Returns
    -------
    dict or None
        ``step_deg`` and ``any_deg``: median distances from one row to the next, and between any
        two; None if consecutive rows are spread over the sky.
    """
    places = context.mount.direction(context.az, context.el).T[sequence.order]
    if len(places) < 3:
        return None
    following = np.isfinite(sequence.gap[1:])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)[following]
    rng = np.random.default_rng(0)  # the same rows give the same result
    any_two = np.linalg.norm(places - places[rng.permutation(len(places))], axis=1)
    any_two = any_two[any_two > 0.0]
    if not len(steps) or not len(any_two):
        return None
    step, other = (float(np.degrees(2.0 * np.arcsin(0.5 * np.median(chord))))
                   for chord in (steps, any_two))
    return {'step_deg': step, 'any_deg': other} if step < _STEP * other else None


def slow_noise(problem, chosen, axes):
    """Estimate of the correlated noise in the rows (simple kriging).

    Cressie 1993, Statistics for Spatial Data, section 3.2; like `expected_error.ahead`, but within
    the rows.

    Parameters
    ----------
    problem : SelectionProblem
    chosen : list of CandidateGroup
        Effects in the model.
    axes : dict of str to AxisNoise
        The axes, ``az`` or ``el``, with correlated noise.

    Returns
    -------
    ndarray, shape (2, n)
        Radians on the sky; 0 in rows without weight.
    """
    sequence, plain = problem.sequence, problem.plain.fit(chosen)
    raw, root = (v.reshape(2, -1) for v in (plain.raw, plain.noise.root))
    out = np.zeros_like(raw)
    for name, one in axes.items():
        axis = ('az', 'el').index(name)
        rows = sequence.order[root[axis][sequence.order] > 0.0]
        for begin in range(0, len(rows), _SOME):
            part = rows[begin:begin + _SOME]
            on_sky = sequence.factor[part] if one.scaled else np.ones(len(part))
            since = np.abs(sequence.position[part][:, None] - sequence.position[part])
            alike = one.variance * np.exp(-since / one.memory) * (
                sequence.run[part][:, None] == sequence.run[part])
            noise = np.square(one.scale / (root[axis, part] * plain.scale[axis] * on_sky))
            out[axis, part] = on_sky * (alike @ np.linalg.solve(
                alike + np.diag(noise), raw[axis, part] / on_sky))
    return out


def beyond_terms(problem, offsets, chosen=()):
    """Radial RMS of some offsets on the sky, beyond what the declared terms absorb, arcsec.

    Like `page_figures.beyond_base`, before there is a result; over the rows with weight.

    Parameters
    ----------
    problem : SelectionProblem
    offsets : ndarray, shape (2, n)
        Radians.
    chosen : list of CandidateGroup
        Effects in the fit that gives the weights.
    """
    live = problem.plain.fit(list(chosen)).weights > 0.0
    left = problem.base.left_of(offsets.ravel(), WhiteNoise(np.tile(live, 2).astype(float)))
    return float(np.sqrt(np.square(left.reshape(2, -1)[:, live]).sum() / max(live.sum(), 1))
                 / ARCSEC)


def trend(problem, chosen, name, one):
    """Linear drift of an axis, and the share of the residual variance that it explains.

    Parameters
    ----------
    problem : SelectionProblem
    chosen : list of CandidateGroup
        Effects in the model.
    name : {'az', 'el'}
    one : AxisNoise

    Returns
    -------
    dict or None
        ``rate_arcsec_per_hour`` (of the axis angle), ``share`` (of the residual variance of the
        axis) and ``removes_rms_arcsec`` (radial on the sky, beyond the terms); None if the rows
        have no times, or if the model contains a linear drift already.
    """
    sequence, n = problem.sequence, problem.n
    if not sequence.timed:
        return None
    plain = problem.plain.fit(chosen)
    part = slice(0, n) if name == 'az' else slice(n, 2 * n)
    hours = sequence.position / 3600.0
    run = np.unique(sequence.run, return_inverse=True)[1]
    hours = hours - (np.bincount(run, hours) / np.bincount(run))[run]
    column = np.zeros(2 * n)
    column[part] = hours * (sequence.factor if one.scaled else 1.0)
    white, left = plain.noise.whiten(column), plain.noise.whiten(plain.raw)
    own = plain.basis.off(white)
    size = float(own @ own)
    if size <= DISTINCT**2 * float(white @ white):
        return None
    rate = float(own @ left) / size
    share = rate**2 * size / max(float(np.square(left[part]).sum()), 1e-300)
    return {'rate_arcsec_per_hour': rate / ARCSEC, 'share': share,
            'removes_rms_arcsec': beyond_terms(problem, (rate * column).reshape(2, -1), chosen)}


class PairDifferences:
    """RMS differences of the residuals of two rows, by their separation.

    Parameters
    ----------
    context : Context
    sequence : Sequence
    residual : ndarray, shape (2, n)
        Residuals on the sky, radians.
    live : ndarray of bool, shape (n,)
        Rows with weight.
    distance : float
        Separation of far pairs, in units of the sequence's position.
    """

    def __init__(self, context, sequence, residual, live, distance):
        rows = sequence.order[live[sequence.order]]
        places = context.mount.direction(context.az, context.el).T[rows]
        position, run, m = sequence.position[rows], sequence.run[rows], len(rows)
        self._left = residual[:, rows]
        first, second = np.arange(max(m - 1, 0)), np.arange(1, m)
        self._next = _one_run(run, first, second)
        anchors = np.unique(np.linspace(0, m - 1, min(m, _ANCHORS)).astype(int))
        first, second = (v.ravel() for v in np.meshgrid(anchors, np.arange(m), indexing='ij'))
        # pairs of two anchors occur twice, which changes no mean
        first, second = _one_run(run, first[first != second], second[first != second])
        since = np.abs(position[first] - position[second])
        self._far = [v[np.abs(since - distance) <= _ABOUT * distance] for v in (first, second)]
        between = _between(places, *self._next)
        #: degrees on the sky
        self.within = max(float(np.median(between)) if len(between) else 0.0, _NEAR)
        self._near_next = [v[between <= self.within] for v in self._next]
        later = (since >= distance) & (_between(places, first, second) <= self.within)
        self._near_later = [v[later] for v in (first, second)]

    def pairs(self):
        """Number of pairs that are near on the sky and far apart in the order."""
        low, high = (np.sort(self._near_later, axis=0) if len(self._near_later[0])
                     else np.zeros((2, 0), int))
        return len(set(zip(low.tolist(), high.tolist())))

    def to_dict(self, axis):
        """RMS differences of an axis (0 or 1), arcsec; None if there are too few pairs.

        Returns
        -------
        dict
            ``next_arcsec`` (a row and the next), ``apart_arcsec`` (rows about `distance` apart),
            ``moves_arcsec`` (their difference in quadrature); ``near_next_arcsec``,
            ``near_apart_arcsec``: the same for rows `within` on the sky, the latter at least
            `distance` apart.
        """
        near, far = (self._differ(axis, pair) for pair in (self._next, self._far))
        return {'next_arcsec': near, 'apart_arcsec': far,
                'moves_arcsec': None if None in (near, far) else float(np.sqrt(
                    max(far**2 - near**2, 0.0))),
                'near_next_arcsec': self._differ(axis, self._near_next),
                'near_apart_arcsec': self._differ(axis, self._near_later)}

    def _differ(self, axis, pair):
        first, second = pair
        if len(first) < FEWEST:
            return None
        return float(rms(self._left[axis, first] - self._left[axis, second]) / ARCSEC)


def _one_run(run, first, second):
    same = run[first] == run[second]
    return first[same], second[same]


def _between(places, first, second):
    chord = np.linalg.norm(places[first] - places[second], axis=1)
    return np.degrees(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))
