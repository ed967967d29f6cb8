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

"""What to observe next to separate effects that explain a run equally well.

Of two possible causes, each is taken as the truth in turn, and the other (with all terms of the
model) is fitted to the values it predicts. The squared residual of that fit, in units of the noise,
is the expected separation in 2 ln(likelihood ratio). The next observation is where the two disagree
most; it is added, and the fit repeated (sequential T-optimal design, Atkinson and Fedorov 1975).
For the rows so far the actual difference of the scores is used, not the expected one; the expected
separation of new observations is added to it.
"""

from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibration.estimation.correlated_noise import WhiteNoise
from calibration.estimation.group_columns import GroupColumns
from msg_tools.units import DEG
from pointing_model.context import Context

from .observation_places import (
    SHORT,
    dark_hours,
    next_night,
    observation_context,
    place_of,
    places_under,
    utc_of,
)

_COUNT = 6  # observations for each ambiguous effect
_MOST_EQUALS = 4
_WORTH = 0.5  # smallest useful separation, delta BIC: exact aliases cannot be separated
MIN_GAP = 3.0 * DEG
_LATER = (0.25, 2.0, 6.0)  # hours


def propose(run, choice, alternatives=None):
    """Observations that separate the best effect from the strongest alternative that they can.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    alternatives : list of list of int, optional
        For each effect chosen: groups that lost to it but leave its cause open.

    Returns
    -------
    proposals : list of dict
        ``az_deg``, ``el_deg`` (horizontal; unless alt-azimuth also the axis angles, such as
        ``ha_deg``, ``dec_deg``, and ``through_pole``), ``approach_az``, ``approach_el`` (0:
        either), ``last_move_deg`` (length of a last, reversed move of both axes; None: any),
        ``after_hours`` (since the last row; None: any time), ``utc`` (of that time; None: any time,
        or unknown), ``next_night`` (no such hour is dark tonight), ``separates`` (two names),
        ``separation_before``: delta BIC between them with the present rows, and
        ``separation_after``: the expected value with all proposals so far.
    none : list of list of str
        An effect and its strongest alternatives, if no observation separates them.
    """
    problem, out, none, grid = run.problem, [], [], _grid(run.obs.context)
    for i, (one, significance) in enumerate(zip(choice.chosen, choice.significances)):
        others = [c.effect(problem) for j, c in enumerate(choice.chosen) if j != i]
        bank, group = one.family(problem, choice.chosen)
        own = bank.effects[group].cause_summary
        look_at = bank.effects[group].look_at
        # first alternatives with another cause and another part to look at; last those that need
        # more effects
        near = [] if one.curve else sorted(
            [*significance.equals, *(alternatives[i] if alternatives else ())],
            key=lambda k, bank=bank, own=own, look_at=look_at, more=significance.larger: (
                bank.effects[k].cause_summary == own, bank.effects[k].look_at == look_at,
                k in more))
        for other in near[:_MOST_EQUALS]:
            *pair, shared = _members(problem, one.effect(problem), others, bank.effects[other],
                                     significance.others.get(other))
            proposals = _separate(run, choice.fit, pair, shared, grid, abs(
                significance.every[group] - significance.every[other]))
            last = proposals[-1]
            if last['separation_after'] > last['separation_before'] + _WORTH:
                out += proposals
                break
        else:
            tried = [bank.effects[k] for k in near[:_MOST_EQUALS]]
            if tried and tried[0].cause_summary != own:
                none.append([one.effect(problem).name, *dict.fromkeys(
                    e.name for e in tried if e.cause_summary != own)])
    return out, none


def _members(problem, best, others, other, beside):
    """Effects only in the model of `best`, only in that of `other` (each itself first), in both.

    `beside`: the other effects in the model of the alternative, list of CandidateGroup; None: the
    same as `others`.
    """
    if beside is None:
        return [best], [other], others
    own = [choice.effect(problem) for choice in beside]
    both = {e.name for e in own} & {e.name for e in others}
    return ([best, *(e for e in others if e.name not in both)],
            [other, *(e for e in own if e.name not in both)],
            [e for e in others if e.name in both])


class Grid(NamedTuple):
    """Possible observations.

    Attributes
    ----------
    context : Context
    later : ndarray
        Hours after the last row.
    short : ndarray of bool
        Whether reached by a reversed move of only `SHORT`.
    tomorrow : bool
        Whether no dark hour is left tonight.
    utc : dict of float to (str or None)
        UTC of these hours.
    """

    context: Context
    later: np.ndarray
    short: np.ndarray
    tomorrow: bool
    utc: dict


def _grid(known):
    """`Grid` over the sky, both approaches, early and late hours, long and short last moves.

    Parameters
    ----------
    known : Context
        Context of the rows.
    """
    hours = dark_hours(known, _LATER)
    tomorrow = not hours
    hours = hours or next_night(known, _LATER)
    utc = {hour: utc_of(known, hour) for hour in hours}
    above = known.on_horizon()[1]
    low = max(15.0 * DEG, float(above.min()))
    high = min(88.0 * DEG, max(float(above.max()), low + 0.1))
    az, el, s_az, s_el, later, short = places_under(
        known, low, high, [-1.0, 1.0], [-1.0, 1.0], hours, [False, True])
    context = observation_context(known, az, el, (s_az, s_el), later, short)
    return Grid(context, later, short, tomorrow, utc)


def _separate(run, fit, pair, others, grid, before):
    context, later, short = grid.context, grid.later, grid.short
    m = len(context)
    views = views_of(run.problem, run.obs, run.base, fit, pair, others, context)
    start = min(v.separation() for v in views)
    proposals, used = [], np.zeros(m, bool)
    for _ in range(_COUNT):
        gain = np.min([v.disagreement() for v in views], axis=0)
        j = int(np.argmax(np.where(used, -1.0, gain)))
        by_az, by_el, by_time, by_move = _matters(gain, j, len(np.unique(later)))
        near = np.hypot((context.az - context.az[j]) * np.cos(context.el[j]),
                        context.el - context.el[j]) < MIN_GAP
        used |= near & ((later == later[j]) | (not by_time)) & ((short == short[j]) | (not by_move))
        for v in views:
            v.add(j)
        timed = by_time and 'time' in context.columns
        after = before + min(v.separation() for v in views) - start
        proposals.append({
            **place_of(context, j),
            'approach_az': int(context.columns['approach_az'][j]) if by_az else 0,
            'approach_el': int(context.columns['approach_el'][j]) if by_el else 0,
            'last_move_deg': float(SHORT / DEG) if by_move and short[j] else None,
            'after_hours': float(later[j]) if timed else None,
            'utc': grid.utc[later[j]] if timed else None,
            'next_night': timed and grid.tomorrow,
            'separates': [member[0].name for member in pair],
            'separation_before': float(before), 'separation_after': float(after)})
    return proposals


def views_of(problem, obs, base, fit, pair, others, context):
    """A `Prospect` with either member of a pair as the truth, fitted by the other.

    Parameters
    ----------
    problem : SelectionProblem
    obs : Observations
    base : Base
    fit : WeightedFit
        Fit that gives the weights of the rows.
    pair : sequence of sequence of Effect, length 2
        The members: an effect, and the other effects that only its model has.
    others : sequence of Effect
        Effects in both models.
    context : Context
        Possible observations.

    Returns
    -------
    list of Prospect
        The first member true, the second true.
    """
    n, m = problem.n, len(context)
    # new observations belong to the last run, with its terms
    last = int(np.searchsorted(np.unique(obs.label), obs.label[-1]))
    grid_base = base.columns(context, np.full(m, obs.label[-1]))
    shared = problem.base.beside(*(e.columns(obs.context).reshape(-1, 2 * n) for e in others))
    shared_grid = [grid_base.common, *(e.columns(context).reshape(-1, 2 * m) for e in others)]
    rows = [shared.common]
    if shared.groups:
        rows.append(shared.own * (shared.group == last))
        shared_grid.append(grid_base.own)
    rows = [np.vstack(rows), *(_stacked(member, obs.context) for member in pair),
            problem.b[None]]
    shared_rows, *sides, b = (_beyond_other_runs(shared, fit.noise.whiten(r), fit.noise, last)
                              for r in rows)
    sides = [(r, _stacked(member, context)) for r, member in zip(sides, pair)]
    noise = _noise(fit, problem, context)
    shared_grid = np.vstack(shared_grid)
    return [Prospect(shared_rows, shared_grid, sides[k], sides[1 - k], b[0], noise) for k in (0, 1)]


def _stacked(effects, context):
    return np.vstack([e.columns(context).reshape(-1, 2 * len(context)) for e in effects])


def _matters(gain, j, hours):
    """Whether the approaches, the time and the last move change the gain at point `j`."""
    shape = (2, 2, hours, 2)
    here = gain.reshape(-1, *shape)[j // np.prod(shape)]
    by_az, by_el, by_time, by_move = (
        bool(np.any(np.ptp(here, axis=axis) > 0.01 * gain[j])) for axis in range(4))
    return by_az, by_el, by_time or hours == 1, by_move  # a single hour cannot be compared


def _beyond_other_runs(shared, rows, noise, last):
    """Whitened rows, with the terms of each run but the last projected out."""
    others = replace(shared.without_common(), own=shared.own * (shared.group != last))
    return others.whitened(noise).orthonormal_groups().off(rows, in_place=True)


def _noise(fit, problem, context):
    """Noise of new observations, shape (2, m), radians, including the correlated part."""
    unit = problem.scale_unit
    noise = np.repeat((fit.scale * unit)[:, None], len(context), axis=1)
    for axis, one in enumerate(fit.memory):
        on_sky = context.trig.cos_el if one.scaled else 1.0
        noise[axis] = np.hypot(one.scale * unit[axis], np.sqrt(one.variance) * on_sky)
    return noise


def _coefficients(rows, b):
    """Least-squares fit of whitened rows to `b`."""
    return GroupColumns.alone(rows).solver(WhiteNoise(np.ones(len(b))))(b)[0]


class Prospect:
    """One member of a pair is the truth, and the other is fitted to it. Rows are whitened."""

    def __init__(self, shared, shared_grid, truth, other, b, noise):
        p = _coefficients(np.vstack((shared, truth[0])), b)
        coefficients = p[len(shared):]
        self._signal = coefficients @ truth[0]
        self._signal_grid = coefficients @ truth[1]
        self._rows = np.vstack((shared, other[0]))
        self._grid = np.vstack((shared_grid, other[1]))
        self._noise, self._m = noise, truth[1].shape[1] // 2

    def _fit(self):
        return _coefficients(self._rows, self._signal)

    def separation(self):
        left = self._signal - self._fit() @ self._rows
        return float(left @ left)

    def disagreement(self):
        """Squared difference at each point without a refit, in units of the noise, shape (m,)."""
        left = (self._signal_grid - self._fit() @ self._grid).reshape(2, -1)
        return np.square(left / self._noise).sum(axis=0)

    def add(self, j, stars=1.0):
        """Add a number of stars at point `j`."""
        at = [j, j + self._m]
        n = self._rows.shape[1] // 2
        place = [n, 2 * n]  # behind the x and behind the y rows
        noise = self._noise[:, j] / np.sqrt(stars)
        self._rows = np.insert(self._rows, place, self._grid[:, at] / noise, axis=1)
        self._signal = np.insert(self._signal, place, self._signal_grid[at] / noise)

    def copy(self):
        """A copy to which points can be added."""
        return copy(self)
