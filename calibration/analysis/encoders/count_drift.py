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

"""Random walk of counts: does incremental - absolute walk, and which encoder does it?

Reading noise is independent from row to row, wrong counts accumulate. Both are fitted together
(`step_scan.random_walk`), with disc errors once and twice per turn. The walk must be significant,
and explain more than one step or one drift, than the side of approach (a coupling that winds up),
and than higher harmonics of the angle. Two or more steps count as a walk.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import Context
from pointing_model.effects.backlash import MEMORIES
from pointing_model.effects.base import effect
from pointing_model.zero_drift import harmonic_columns

from ...estimation.correlated_noise import WhiteNoise
from ...estimation.group_columns import GroupColumns
from ...estimation.step_scan import neighbour_noise, random_walk, robust_fit, two_sided
from ..finding import Finding
from .cross_check_rows import AXES, LEAST, SHORT, USUAL
from .encoder_jumps import DifferenceEvent, difference_events, encoder_events
from .jump_or_slow_change import slow_changes

#: fewest rows to distinguish a walk from noise
_FEWEST = 20
#: fewest degrees of freedom of a fit
_FREE = 8
#: higher harmonics of the angle, which look like a walk if a night is ordered by azimuth
_FINER = (3, 4, 5, 6)
#: robust sigmas from its neighbours from which a reading is an outlier
_WILD = 6.0
#: number of neighbours on each side in this test
_BESIDE = 4
#: prior odds that the incremental encoder walks: its errors accumulate, while an absolute encoder
#: reads each angle independently
_ODDS = 4.0
#: prior 1 sigma of a harmonic of a disc, rad
_DISC = 10.0 * ARCSEC
#: largest correlation of neighbours that counts as noise; longer correlation is a walk
_SHORT = 0.65
#: `CountDrift.lead` from which a walk is sure without stars (100 to 1); below it they must confirm
#: it with this confidence
_LEAD = 2.0 * np.log(100.0)
_SEEN = 0.99
_CHANCE = USUAL.false_alarm / 2.0  # two axes


class CountDrift(NamedTuple):
    """A random walk found in incremental - absolute of one axis.

    Attributes
    ----------
    probability : float
        P-value.
    step, noise : float
        1 sigma of the step from row to row, and of the noise of a difference, rad.
    discs : ndarray, shape (4,)
        Harmonics of the disc errors, rad.
    path : ndarray, shape (n,)
        The walk at each row, minus its mean, rad.
    lead : float
        2 ln(likelihood ratio) to noise with a short correlation; infinite if that noise is
        uncorrelated.
    """

    probability: float
    step: float
    noise: float
    discs: np.ndarray
    path: np.ndarray
    lead: float = np.inf


def count_drift(difference, angle, run, alternatives=(), limit=_CHANCE, sides=(), slow=()):
    """Test differences for a random walk.

    Parameters
    ----------
    difference : ndarray, shape (n,)
        Incremental - absolute in order of time, rad.
    angle : ndarray, shape (n,)
        Angle of the axis, rad.
    run : ndarray, shape (n,)
        Power-on; each has a separate zero.
    alternatives : sequence of (ndarray, int)
        Alternative explanations, fitted together: column, and number of parameters of each.
    limit : float
        P-value from which there is no walk.
    sides : sequence of ndarray, shape (n,)
        Columns of the side of approach; each is tried in addition to the alternatives.
    slow : sequence of (ndarray of shape (k, n), int)
        The same for slow changes: columns, and number of parameters.

    Returns
    -------
    CountDrift or None
        None if chance, the alternatives, the side of approach or higher harmonics of the angle
        explain as much, and leave no walk in the residuals.
    """
    n, design = len(difference), GroupColumns.of(run, common=harmonic_columns(angle).T)
    if n < max(_FEWEST, len(design) + _FREE):
        return None
    y, left = _without_wild(difference, design)
    if left.std() < LEAST:
        return None
    walks = [(random_walk(design, y, position, run), position)
             for position in _positions(angle)]
    walk, position = max(walks, key=lambda one: one[0].memory[0].gain)
    process = walk.memory[0]
    probability = _chance(process.gain) * 2.0  # two kinds
    short = neighbour_noise(design, y, run, _SHORT).memory[0]
    lead = process.gain - short.gain if short.variance > 0.0 else np.inf
    if probability >= limit or lead <= 0.0:
        return None
    curves = design.beside(*(column for column, _ in alternatives))
    cost = sum(cost for _, cost in alternatives)
    others = [(curves, cost), *((curves.beside(side), cost + 1) for side in sides),
              *((curves.beside(*columns), cost + numbers) for columns, numbers in slow),
              (curves.beside(harmonic_columns(angle, _FINER).T), 2 * len(_FINER))]
    best, white = _bic(y, design, walk, walk.log_det, 1), WhiteNoise(np.ones(n))
    for columns, cost in others:
        # an alternative must have a better BIC and leave no walk in the residuals
        if (n >= len(columns) + _FREE and best >= _bic(y, columns, white, 0.0, cost)
                and _chance(random_walk(columns, y, position, run).memory[0].gain) >= limit):
            return None
    whitened = design.whitened(walk)
    # over a part of a turn the harmonics are degenerate: regularise them with the prior `_DISC`
    zeros = whitened.orthonormal_groups()
    rest, target = zeros.off(whitened.common), zeros.off(walk.whiten(y))
    discs = np.linalg.solve(rest @ rest.T + np.eye(len(rest)) / _DISC**2, rest @ target)
    left = y - discs @ design.common
    path = walk.process(left - design.spread(whitened.share(walk.whiten(left)[None]))[0])
    step = np.sqrt(2.0 * process.variance / process.memory)
    return CountDrift(probability, float(step), process.scale, discs,
                      GroupColumns.of(run).basis().off(path), lead)


def _positions(angle):
    """Positions along which counts may walk, one per row on average: two kinds.

    The row number, as for a zero that moves in time; and the angle travelled by the axis, as for
    wrong counts, which accumulate with the counts.
    """
    for way in (np.ones(len(angle)), np.abs(wrap(np.diff(angle, prepend=angle[:1])))):
        if way.any():
            yield np.cumsum(way / way.mean())


def _without_wild(y, design):
    """`y` with outliers replaced by the mean of their neighbours, and its residuals.

    An outlier differs from the readings before and after it: a single one is no walk, a lasting
    change is.
    """
    out = robust_fit(design, y).residual
    smooth = y - out
    for r in range(design.groups):
        at = np.flatnonzero(design.group == r)
        if len(at) < 4 * _BESIDE:
            continue
        own = out[at]
        # median of the next four readings, except for the last four; and the same backwards
        after = np.median(np.lib.stride_tricks.sliding_window_view(own[1:], _BESIDE), axis=1)
        before = np.median(np.lib.stride_tricks.sliding_window_view(own[:-1], _BESIDE), axis=1)
        beside = np.full((2, len(own)), np.nan)
        beside[0, :-_BESIDE], beside[1, _BESIDE:] = after, before
        off = np.abs(own - beside)
        limit = _WILD * np.maximum(1.4826 * np.nanmedian(off, axis=1), LEAST)
        wild = ((off > limit[:, None]) | np.isnan(off)).all(axis=0)
        out[at] = np.where(wild, np.nanmean(beside, axis=0), own)
    return smooth + out, out


def _chance(gain):
    """P-value of a likelihood ratio if there is no walk.

    Half of the ratios are zero then (Self and Liang 1987; for a random walk more, so this is
    conservative).
    """
    return 0.5 * float(two_sided(np.sqrt(max(gain, 0.0)), 1e9)) if gain > 0.0 else 1.0


def _bic(y, design, noise, log_det, numbers):
    """Bayesian information criterion of a fit with given noise and additional parameters."""
    n = len(y)
    left = design.basis(noise).off(noise.whiten(y))
    return n * np.log(max(left @ left / n, 1e-300)) + n + log_det + numbers * np.log(n)


# --- of a night -----------------------------------------------------------------------------------


class Movements(NamedTuple):
    """Motions inside the power-ons of a night.

    Attributes
    ----------
    events : list of EncoderEvent
    drifts : dict of int to CountDrift
        By axis index.
    sky : SkyResiduals or None
    """

    events: list
    drifts: dict
    sky: object


def movements(night, model, budget, notes):
    """Steps, drifts and walks inside power-ons, as `Movements`.

    Parameters
    ----------
    night : CrossCheckNight
    model : PointingModel or None
    budget : Budget
    notes : list of Finding
        Notes on tests that were not possible are appended.
    """
    slow = [slow_changes(night, axis) for axis in (0, 1)]
    both = [difference_events(night, axis, budget, slow[axis]) for axis in (0, 1)]
    plain = [event for found, _ in both for event in found]
    sky = night.sky(plain, model, notes)
    events, instead = encoder_events(night, sky, plain, budget, slow)
    instead += [(axis, one) for axis, (_, better) in enumerate(both) for one in better]
    notes += [Finding('no jump', evidence={'axis': AXES[axis], 'slow': one.kind})
              for axis, one in {(axis, one.kind): (axis, one) for axis, one in instead}.values()]
    walks = {}
    for axis, name in enumerate(AXES):
        # a step against the sky may be a small step of the difference
        also = [event.column for event in events[len(plain):] if event.axis == name]
        walk = _axis_drift(night, axis, [one for one in plain if one.axis == axis], budget, also,
                           slow[axis])
        if walk is not None:
            walks[axis] = walk
    while walks:
        found = [one for one in plain if one.axis not in walks] + [one for one, _ in walks.values()]
        beside = night.sky(found, model, [])
        named, _ = encoder_events(night, beside, found, budget, slow)
        unsure = [axis for axis, (_, drift) in walks.items() if drift.lead < _LEAD and not any(
            event.axis == AXES[axis] and event.kind == 'walk' and event.confidence > _SEEN
            for event in named)]
        if not unsure:
            return Movements(named, {axis: drift for axis, (_, drift) in walks.items()}, beside)
        for axis in unsure:
            del walks[axis]
    return Movements(events, {}, sky)


def _axis_drift(night, axis, events, budget, also, slow=()):
    """A walk of an axis that replaces its steps and drifts.

    Parameters
    ----------
    night : CrossCheckNight
    axis : {0, 1}
    events : list of DifferenceEvent
        Its steps and drifts.
    budget : Budget
    also : sequence of ndarray, shape (n,)
        Steps found against the sky.
    slow : sequence of SlowChange
        Slow changes, as alternatives: turning discs are no walk.

    Returns
    -------
    (DifferenceEvent, CountDrift) or None
    """
    rows, alternatives = night.run >= 0.0, []
    if len(events) <= 1:  # two or more steps count as a walk
        alternatives = [(event.column, 1 if event.kind == 'drift' else 2)
                        for event in events] + [(column, 1) for column in also[:1]]
    sides, angle = _sides(night, axis), night.rows[f'{SHORT[axis]}_enc']
    slow = [one for one in slow if one.kind != 'zero drifts slowly']

    def drift(of, places):
        tonight = rows[places]
        return count_drift(
            of(night.difference[axis])[tonight], angle[places][tonight],
            night.interval[places][tonight],
            [(of(column)[tonight], cost) for column, cost in alternatives],
            budget.false_alarm / 2.0, [of(side)[tonight] for side in sides],
            [(of(one.columns)[:, tonight], one.numbers) for one in slow])
    found = drift(np.asarray, np.arange(len(rows)))
    # many exposures of one place are no walk
    if found is None or drift(night.by_place, night.begins) is None:
        return None
    column, size = np.zeros(len(night.run)), float(np.ptp(found.path))
    column[rows] = found.path / size
    return DifferenceEvent(axis, night.tonight[-1], 'walk', float(night.rows['time'][rows].mean()),
                           column, size, 0.0, 2.0 * found.probability, _ODDS), found


def _sides(night, axis):
    """Columns for a coupling that winds up, or backlash, in the difference: one per memory."""
    context, name = Context.from_run(night.rows), SHORT[axis]
    play = [effect('hysteresis', axis=name, shape='1', memory_deg=memory)
            for memory in (0.0, *MEMORIES)]
    return [np.nan_to_num(np.broadcast_to(one.of(context)[0][axis], len(night.run)))
            for one in play if all(context.get(need) is not None for need in one.requires)]
