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

"""Steps and drifts inside a power-on: when, and whether an encoder or the mount moved.

The time and the cause of a jump are estimated together. At each possible time, a fit of incremental
- absolute, d = I - B, and one of absolute - sky, s = B + S, give the likelihood of each cause: the
incremental encoder (s = 0), the absolute one (s = -d), both alike or the mount (d = 0), both unlike
(d and s free). The evidence is summed over the times. The prior of each size is in units of its own
sigma (Zellner's g prior), so that a jump of one is attributed to both with probability
`Budget.second` whatever the noise. The noise is estimated from the night, and the correlation of
the two differences (the absolute encoder's reading is in both) is removed first.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pointing_model.rms import sigma_of

from ...estimation.step_scan import (
    clipped,
    detect,
    log_normal,
    neighbour_noise,
    noise_beside,
    probabilities,
    robust_fit,
    two_sided,
)
from .cross_check_rows import ABSOLUTE, ALIKE, AXES, BOTH, INCREMENTAL, LEAST
from .jump_or_slow_change import jumps_or_slow

#: fewest rows on either side of a step. Two adjacent wild readings at the end of 40 rows make a
#: step in 29 % of the nights with 1 or 2, in 8 % with 3, in 1.5 % with 4, which detects later
_SEGMENT = 3
#: ... of a step that is seen against the sky only
_SKY_SEGMENT = 5
#: largest number of steps and drifts of an axis in a night, of the difference and against the sky;
#: more would be another kind of trouble
_MOST, _MOST_SKY = 3, 2
#: drop in 2 ln(likelihood) of the times of a step within 3 sigma of the best
_NEAR = 9.0


class DifferenceEvent(NamedTuple):
    """A step, drift or walk of incremental - absolute on an axis, its column shape (n,)."""

    axis: int
    run: float
    kind: str
    time: float
    column: np.ndarray
    amount: float
    sigma: float
    probability: float
    #: prior odds that the incremental encoder moved
    odds: float = 1.0
    #: gain in BIC over the best slow change
    lead: float = np.inf


@dataclass(frozen=True)
class EncoderEvent:
    """A motion inside a power-on.

    `kind` is ``step`` (amount in rad, at `time`), ``drift`` (amount in rad/s) or ``walk`` (random,
    amount in rad from minimum to maximum), and `column`, shape (n,), its time course. The amount is
    the reading error of `moved`; `confidence` is the posterior probability of that cause.
    `probability` is the p-value of such a step anywhere in the night under noise alone; `lead` the
    gain in BIC over the best `SlowChange`. If `moved` is `BOTH`, the amount is that of the
    incremental encoder, and `second` that of the absolute one.
    """

    axis: str
    run: float
    kind: str
    time: float
    column: np.ndarray
    amount: float
    sigma: float
    moved: str
    confidence: float
    probability: float
    second: float = np.nan
    second_sigma: float = np.nan
    lead: float = np.inf


class _StepFits(NamedTuple):
    """Fits of a difference with each of k steps: sizes and their sigmas, (k,), rad."""

    size: np.ndarray
    sigma: np.ndarray

    @property
    def gain(self):
        return (self.size / self.sigma) ** 2


def difference_events(night, axis, budget, slow=()):
    """Steps and drifts of incremental - absolute, a list of `DifferenceEvent`.

    Parameters
    ----------
    night : CrossCheckNight
    axis : {0, 1}
    budget : Budget
    slow : sequence of SlowChange
        Slow changes that could be mistaken for them.

    Returns
    -------
    found : list of DifferenceEvent
    instead : list of SlowChange
        Slow changes that explain rejected events better.
    """
    candidates, design = night.candidates(_SEGMENT), night.difference_design(axis)
    if not len(candidates) or len(night.run) <= len(design) + _MOST + 1:
        return [], []
    y = night.difference[axis]

    def is_one_by_places(best, design):
        fitted = design.beside(candidates.column(best.place))
        left, column = map(night.by_place, (robust_fit(fitted, y).residual, fitted.common[-1]))
        column = column[night.run[night.begins] == candidates.labels[best.place][0]]
        sigma = max(float(sigma_of(left)), LEAST) / np.sqrt(np.square(column - column.mean()).sum())
        chance = two_sided(best.amount / sigma, max(len(left) - len(fitted), 1))
        return chance * len(candidates) < budget.false_alarm / 2.0

    found, lead, instead = _jumps(
        design, y, candidates, slow, budget, night.run, _MOST, is_one_by_places)
    return [DifferenceEvent(
        axis, *candidates.labels[best.place], candidates.column(best.place), best.amount,
        best.sigma, best.probability * 2.0, lead=lead) for best in found], instead


def _jumps(design, y, candidates, slow, budget, run, most, is_one=lambda best, design: True):
    """`jumps_or_slow` of candidates that are detected one after another, as `Detection`."""
    def search(design):
        found = []
        while len(found) < most:
            beside = design.beside(*(candidates.column(one.place) for one in found))
            best = detect(beside, y, candidates, budget.false_alarm / 2.0, run, LEAST)  # two axes
            if best is None or not is_one(best, beside):
                break
            found.append(best)
        return found
    return jumps_or_slow(search, slow, design, y, run, candidates)


def encoder_events(night, sky, events, budget, slow=((), ())):
    """Attribute events to an encoder or the mount, and search further ones against the sky.

    Parameters
    ----------
    night : CrossCheckNight
    sky : SkyResiduals or None
        None: no information from stars.
    events : list of DifferenceEvent
    budget : Budget
    slow : pair of sequence of SlowChange
        For each axis.

    Returns
    -------
    found : list of EncoderEvent
        Those of `events`, in the same order, then those seen against the sky only.
    instead : list of (int, SlowChange)
        Axis and slow change that explains rejected events against the sky better.
    """
    if sky is None:
        return [_drifting_encoder(night, None, event) for event in events], []
    events = _retimed(night, sky, events, budget)
    found, out = [(event.axis, event.column) for event in events], []
    for n, event in enumerate(events):
        step = None
        if event.kind == 'step':
            step = _step(night, sky, event.run, found, n, budget)
        if step is None:
            step = _drifting_encoder(night, sky, event)
        found[n] = event.axis, step.column
        out.append(replace(step, probability=event.probability, lead=event.lead))
    more, instead = _sky_events(night, sky, found, budget, slow)
    return out + more, instead


def _retimed(night, sky, events, budget):
    """The events, with small ones moved to the time of a step against the sky.

    If both encoders jump by large, nearly equal amounts, their small difference may be found at a
    wrong time, or as a drift, which would then absorb the large jump against the sky.
    """
    steps, out = night.candidates(_SKY_SEGMENT, drifts=False), list(events)
    for n, event in enumerate(events):
        others = [other for other in events if other.axis != event.axis]
        if len(others) < len(events) - 1 or not len(steps) or event.kind == 'walk':
            continue
        best = detect(
            sky.design.beside(*(night.on_sky(other.axis, other.column) for other in others)),
            sky.incremental, steps.on_axis(event.axis, night.cos_el), budget.false_alarm / 2.0,
            night.run, LEAST)
        if best is None:
            continue
        run, _, time = steps.labels[best.place]
        column = steps.column(best.place)
        design = night.difference_design(event.axis)
        y = clipped(design.beside(column, event.column), night.difference[event.axis])
        there, here = (robust_fit(design.beside(one), y) for one in (event.column, column))
        if here.residual @ here.residual - there.residual @ there.residual < (
                _NEAR * there.scatter[0]**2):
            out[n] = event._replace(
                run=run, kind='step', time=time, column=column, amount=float(here.coefficients[-1]),
                sigma=float(np.sqrt(here.covariance[-1, -1])))
    return out


def _drifting_encoder(night, sky, event):
    """Attribute a drift or walk of incremental - absolute to one encoder, an `EncoderEvent`.

    Also used for a step if there are too few stars.
    """
    trust = 0.5
    if sky is not None:
        full = sky.design.beside(night.on_sky(event.axis, event.column))
        noise = noise_beside(full, sky.absolute, night.run)
        fit = robust_fit(full.whitened(noise), noise.whiten(sky.absolute))
        against, variance = fit.coefficients[-1], fit.covariance[-1, -1]
        # either the absolute encoder did not move, or it moved by the opposite amount
        trust = probabilities({
            INCREMENTAL: log_normal(against, variance) + np.log(event.odds),
            ABSOLUTE: log_normal(against + event.amount, variance + event.sigma**2),
        })[INCREMENTAL]
    moved, sign = (INCREMENTAL, 1.0) if trust >= 0.5 else (ABSOLUTE, -1.0)
    return EncoderEvent(AXES[event.axis], float(event.run), event.kind, float(event.time),
                        event.column, sign * event.amount, event.sigma, moved,
                        float(max(trust, 1.0 - trust)), event.probability)


def _sky_events(night, sky, found, budget, slow):
    """Steps and drifts against the sky that both encoders share, fully or in part.

    Returns
    -------
    found : list of EncoderEvent
    instead : list of (int, SlowChange)
    """
    candidates, out, better = night.candidates(_SKY_SEGMENT), [], []
    if not len(candidates):
        return out, better
    for axis in (0, 1):
        on_sky = candidates.on_axis(axis, night.cos_el)
        known = sky.design.beside(*(night.on_sky(*one) for one in found))
        shown = [change._replace(columns=np.stack(
            [night.on_sky(axis, one) for one in change.columns])) for change in slow[axis]]
        own, lead, instead = _jumps(
            known, sky.incremental, on_sky, shown, budget, night.run, _MOST_SKY)
        better += [(axis, change) for change in instead]
        for best in own:
            run, kind, time = candidates.labels[best.place]
            event = EncoderEvent(AXES[axis], float(run), kind, float(time),
                                 candidates.column(best.place), best.amount, best.sigma, ALIKE,
                                 1.0 - best.probability, 2.0 * best.probability)
            if kind == 'step':
                step = _step(night, sky, run, [*found, (axis, event.column)], len(found), budget)
                if step is not None and step.moved in (BOTH, ALIKE):
                    event = replace(step, probability=2.0 * best.probability)
            found = [*found, (axis, event.column)]
            out.append(replace(event, lead=lead))
    return out, better


def _step(night, sky, run, found, number, budget):
    """Time and most likely cause of the step `number` of those `found` (axis, column).

    The others are kept fixed.

    Returns
    -------
    EncoderEvent or None
        None if it is determined at no time.
    """
    axis, column = found[number]
    steps = night.candidates(_SEGMENT, [run], drifts=False)
    columns, times = steps.dense(), np.array([time for _, _, time in steps.labels])
    others = [one for n, one in enumerate(found) if n != number]
    design = night.difference_design(axis).beside(*(c for k, c in others if k == axis))
    sky_design = sky.design.beside(*(night.on_sky(*one) for one in others))
    on_sky = np.column_stack([night.on_sky(axis, one) for one in columns.T])
    at, by_difference = int(np.argmin(np.abs(columns - column[:, None]).sum(axis=0))), None
    for _ in range(2):  # outliers and noise depend on the step
        full, sky_full = design.beside(columns[:, at]), sky_design.beside(on_sky[:, at])
        if min(len(columns) - len(full), 2 * len(columns) - len(sky_full)) < 3:
            return None
        y, second = clipped(full, night.difference[axis]), clipped(sky_full, sky.absolute)
        fit = robust_fit(full, y)
        # regression of absolute - sky on incremental - absolute, from the residuals of both
        left = night.on_sky(axis, fit.residual)
        shared = float(np.clip(left @ robust_fit(sky_full, second).residual
                               / max(left @ left, 1e-300), -1.0, 0.0))
        own = fit.residual + columns[:, at] * fit.coefficients[-1]
        d = _step_fits(design, y, columns, at, night.run)
        u = _step_fits(sky_design, second - shared * night.on_sky(axis, own), on_sky, at, night.run)
        gain = d.gain + u.gain
        if by_difference is None:
            # a step clear in incremental - absolute keeps about the time found there
            by_difference = d.gain[at] > d.gain.max() - _NEAR and d.gain.max() > 2.0 * _NEAR
        if by_difference:
            gain = np.where(d.gain > d.gain.max() - _NEAR, gain, -np.inf)
        at = int(np.argmax(gain))
    logs = {name: np.where(np.isfinite(gain), value, -np.inf)
            for name, value in _evidence(d, u, shared, budget.second).items()}
    chances = probabilities({name: float(np.logaddexp.reduce(value))
                             for name, value in logs.items()})
    cause = max(chances, key=chances.get)
    at = int(np.argmax(logs[cause]))
    d_size, d_sigma, u_size, u_sigma = d.size[at], d.sigma[at], u.size[at], u.sigma[at]
    second, second_sigma = u_size + shared * d_size, np.hypot(u_sigma, shared * d_sigma)
    amount, sigma = {
        INCREMENTAL: (d_size, d_sigma), ABSOLUTE: (-d_size, d_sigma), ALIKE: (u_size, u_sigma),
        BOTH: (second + d_size, np.hypot(u_sigma, (1.0 + shared) * d_sigma))}[cause]
    return EncoderEvent(
        AXES[axis], float(run), 'step', float(times[at]), columns[:, at], float(amount),
        float(sigma), cause, float(chances[cause]), np.nan,
        *((float(second), float(second_sigma)) if cause == BOTH else ()))


def _step_fits(design, y, steps, at, run):
    """Fit each step alone with the design, with the noise estimated with the step `at`."""
    noise = neighbour_noise(design.beside(steps[:, at]), y, run)
    basis = design.basis(noise)
    y, steps = basis.off(noise.whiten(y)), basis.off(noise.whiten(steps.T))
    square = np.maximum(np.sum(steps**2, axis=1), 1e-6)  # not determined: no gain
    size = steps @ y / square
    left = y @ y - size[at] ** 2 * square[at]
    sigma = np.sqrt(max(left / max(len(y) - len(basis) - 1, 1), LEAST**2))
    return _StepFits(size, sigma / np.sqrt(square))


def _evidence(d, u, shared, chance):
    """Log evidence of each cause at each time, (k,), from (d, s - shared d)."""
    from scipy.special import ndtri  # takes 0.25 s to load
    toll = 0.5 * ndtri(0.5 * chance) ** 2
    # g prior: the log-likelihood gain, half the square, is multiplied by g / (1 + g)
    half = 0.5 * -np.expm1(-2.0 * toll)

    def along(first, other):
        """Gain of a jump of both differences in a fixed ratio."""
        return (first * d.size / d.sigma**2 + other * u.size / u.sigma**2) ** 2 / (
            (first / d.sigma) ** 2 + (other / u.sigma) ** 2)
    return {INCREMENTAL: half * along(1.0, -shared) - toll,
            ABSOLUTE: half * along(-1.0, 1.0 + shared) - toll,
            BOTH: half * (d.gain + u.gain) - 2.0 * toll,
            ALIKE: half * u.gain - toll}
