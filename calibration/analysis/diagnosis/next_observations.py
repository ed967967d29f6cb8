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

"""What to observe next, so that effects which explain a run equally well come apart.

For two members of a set, each is taken as the truth in turn and the other (with all terms of the
model) is fitted to what the truth would give. What that fit cannot follow, squared and in units
of the noise, is the expected separation in 2 ln(likelihood ratio). The next observation is where
the two disagree most; it is added, and the fit repeated (T-optimal design of Atkinson and
Fedorov, 1975, one point after the other). What the rows so far say is no expectation: it is the
difference of the scores by which the members are one set, and what is expected is added to it.
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

_COUNT = 6  # for each ambiguous effect
_MOST_EQUALS = 4
_WORTH = 0.5  # delta BIC: exact aliases do not come apart anywhere
MIN_GAP = 3.0 * DEG
_LATER = (0.25, 2.0, 6.0)  # hours


def propose(run, choice, alternatives=None):
    """Observations that separate the best effect from the strongest alternative that they can.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    alternatives : list of list of int, optional
        Of each chosen: groups that lost their place to it and leave its cause open all the same.

    Returns
    -------
    proposals : list of dict
        ``az_deg``, ``el_deg`` (of the horizon; of another mount than an alt-azimuth one its own
        angles too, such as ``ha_deg``, ``dec_deg``, and ``through_pole``), ``approach_az``,
        ``approach_el`` (0: either), ``last_move_deg`` (of both axes, against the move before;
        None: any), ``after_hours`` (since the last row; None: at any time), ``utc`` (then; None:
        at any time, or not known), ``next_night`` (none of these hours is dark tonight),
        ``separates`` (two
        names), and ``separation_before``: delta BIC between them by the rows there are;
        ``separation_after``: the same to be expected with all proposals so far.
    none : list of list of str
        An effect and its strongest alternatives, where no observation tells it from any.
    """
    problem, out, none, grid = run.problem, [], [], _grid(run.obs.context)
    for i, (one, significance) in enumerate(zip(choice.chosen, choice.significances)):
        others = [c.effect(problem) for j, c in enumerate(choice.chosen) if j != i]
        bank, group = one.family(problem, choice.chosen)
        own = bank.effects[group].cause_summary
        look_at = bank.effects[group].look_at
        # what people are told as another cause, and look for elsewhere, comes first, what takes
        # more effects last
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
    """What the models of an effect and an alternative have alone, each itself first, and in common.

    An alternative may have others of its own beside it, a list of CandidateGroup, else None.
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
        Reached by a move of `SHORT` back on the one before.
    tomorrow : bool
        Whether tonight no dark hour is left.
    utc : dict of float to (str or None)
        Of these hours.
    """

    context: Context
    later: np.ndarray
    short: np.ndarray
    tomorrow: bool
    utc: dict


def _grid(known):
    """`Grid`: the sky, both approaches, soon and late, after a long move or a short.

    Parameters
    ----------
    known : Context
        Of the rows.
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
    """Either member of a pair as the truth, and how far the other can follow it.

    Parameters
    ----------
    problem : SelectionProblem
    obs : Observations
    base : Base
    fit : WeightedFit
        By which the rows are weighted.
    pair : sequence of sequence of Effect, length 2
        The members: an effect, and what its model alone has besides.
    others : sequence of Effect
        What else is in both models.
    context : Context
        Observations that might be made.

    Returns
    -------
    list of Prospect
        The first member true, the second true.
    """
    n, m = problem.n, len(context)
    # they are observed in the last run, with its terms
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
    """Whether the approaches, the time (of so many) and the last move change what `j` tells."""
    shape = (2, 2, hours, 2)
    here = gain.reshape(-1, *shape)[j // np.prod(shape)]
    by_az, by_el, by_time, by_move = (
        bool(np.any(np.ptp(here, axis=axis) > 0.01 * gain[j])) for axis in range(4))
    return by_az, by_el, by_time or hours == 1, by_move  # one hour has nothing beside it


def _beyond_other_runs(shared, rows, noise, last):
    """Whitened rows without what the runs but the last can fit for themselves."""
    others = replace(shared.without_common(), own=shared.own * (shared.group != last))
    return others.whitened(noise).orthonormal_groups().off(rows, in_place=True)


def _noise(fit, problem, context):
    """Noise of each axis of new observations, shape (2, m), radians, with what it remembers."""
    unit = problem.scale_unit
    noise = np.repeat((fit.scale * unit)[:, None], len(context), axis=1)
    for axis, one in enumerate(fit.memory):
        on_sky = context.trig.cos_el if one.scaled else 1.0
        noise[axis] = np.hypot(one.scale * unit[axis], np.sqrt(one.variance) * on_sky)
    return noise


def _coefficients(rows, b):
    """Least squares of `b` by rows that are white."""
    return GroupColumns.alone(rows).solver(WhiteNoise(np.ones(len(b))))(b)[0]


class Prospect:
    """One member of the pair is true; how well can the other follow it. Rows are whitened."""

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
        """Of each point, if nothing is refitted after it, shape (m,)."""
        left = (self._signal_grid - self._fit() @ self._grid).reshape(2, -1)
        return np.square(left / self._noise).sum(axis=0)

    def add(self, j, stars=1.0):
        """Observe point `j`, or so many stars at it."""
        at = [j, j + self._m]
        n = self._rows.shape[1] // 2
        place = [n, 2 * n]  # behind the x and behind the y rows
        noise = self._noise[:, j] / np.sqrt(stars)
        self._rows = np.insert(self._rows, place, self._grid[:, at] / noise, axis=1)
        self._signal = np.insert(self._signal, place, self._signal_grid[at] / noise)

    def copy(self):
        """The same, to add to."""
        return copy(self)
