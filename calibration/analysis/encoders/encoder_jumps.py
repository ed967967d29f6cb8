"""Steps and drifts inside a power-on: at what moment, and which witness moved.

The moment and the cause of a jump are found together. At each moment that the rows allow, a fit of
incremental - absolute, d = I - B, and one of absolute - sky, s = B + S, tell how likely each cause
is: the incremental encoder (s = 0), the absolute one (s = -d), both alike or the mount (d = 0),
both unlike (d and s free); the moments are added up. What each size is beforehand is measured in
its own sigma (Zellner's g prior), so that a jump of one is called one of both by a chance of
`Budget.second` whatever the noise. The noises are those of the night, and what they have in common
(the absolute encoder's reading is in both) is taken out first.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from ...estimation.step_scan import Free, clipped, log_normal, probabilities, robust_fit
from .cross_check_night import AXES, SEGMENT
from .cross_check_noise import LEAST, colour_of, strongest
from .cross_check_records import EncoderEvent
from .jump_causes import ABSOLUTE, ALIKE, BOTH, INCREMENTAL

#: of twice the logarithm of the likelihood: moments of a step, within 3 sigma of the best
_NEAR = 9.0
#: steps against the sky of an axis in a night; who has more has another trouble
_MOST = 2


class EncoderJump(NamedTuple):
    """An `EncoderEvent`, its axis and its column of coordinate angles, shape (n,)."""

    axis: int
    event: EncoderEvent
    column: np.ndarray


class _Fits(NamedTuple):
    """A difference with each of k steps: sizes and their sigmas, (k,), rad."""

    size: np.ndarray
    sigma: np.ndarray

    @property
    def gain(self):
        return (self.size / self.sigma) ** 2


def jumps_of(night, sky, events, budget):
    """Who moved in the night, by steps of either difference.

    Parameters
    ----------
    night : Night
    sky : Sky or None
        None: the stars do not tell; what the encoders show is named without them.
    events : list of (int, Found)
        Axis, and what was found in incremental - absolute.
    budget : Budget

    Returns
    -------
    list of Jump
        Those of `events`, in their order, then those that only the sky shows.
    """
    if sky is not None:
        events = _retimed(night, sky, events, budget)
    found = [(axis, event.column) for axis, event in events]
    out = []
    for n, (axis, event) in enumerate(events):
        jump = None
        if sky is not None and event.kind == 'step':
            jump = _named(night, sky, axis, event.run, found, n, budget)
        if jump is None:
            said = attributed(axis, event, night, sky)
        else:
            cause, trust, said, column = jump
            found[n] = axis, column
            said = replace(said, probability=event.probability)
        out.append(EncoderJump(axis, said, found[n][1]))
    if sky is not None:
        out += _against_sky(night, sky, found, budget)
    return out


def _retimed(night, sky, events, budget):
    """The events, small ones as a step where the sky has one.

    A small difference of two large jumps is found beside its moment, or as a drift, which then
    would take up the large one on the sky.
    """
    steps = night.moves(SEGMENT + 2).only(lambda about: about[1] == 'step')
    out = list(events)
    for axis in (0, 1):
        own = [n for n, (k, _) in enumerate(events) if k == axis]
        if len(own) != 1 or not len(steps) or events[own[0]][1].kind == 'wander':
            continue
        event = events[own[0]][1]
        others = [night.on(k, e.column) for k, e in events if k != axis]
        best = strongest(
            sky.fixed.beside(*others), sky.enc, steps.on(axis, night.cos_el),
            budget.false_alarm / 2.0, night.sequence_2, night.halves)
        if best is None:
            continue
        run, _, time = steps.about[best.place]
        column = steps.column(best.place)
        base = night.apart_base(axis)
        y = clipped(base.beside(column, event.column), night.apart[axis])
        there, here = (robust_fit(base.beside(one), y) for one in (event.column, column))
        if here.residual @ here.residual - there.residual @ there.residual < (
                _NEAR * there.scatter[0]**2):
            out[own[0]] = axis, event._replace(
                run=run, kind='step', time=time, column=column, amount=float(here.coefficients[-1]),
                sigma=float(np.sqrt(here.covariance[-1, -1])))
    return out


def attributed(axis, found, night, sky):
    """Which encoder made a drift or walk of incremental - absolute, an `EncoderEvent`.

    One of both; also of a step where the stars are too few.
    """
    trust = 0.5
    if sky is not None:
        full = sky.fixed.beside(night.on(axis, found.column))
        colour = colour_of(full, clipped(full, sky.abs), night.sequence_2, night.halves)
        fit = robust_fit(colour.white(full), colour.white(sky.abs))
        against, variance = fit.coefficients[-1], fit.covariance[-1, -1]
        # the absolute encoder stood still, or it moved by as much the other way
        trust = probabilities({
            INCREMENTAL: log_normal(against, variance) + np.log(found.odds),
            ABSOLUTE: log_normal(against + found.amount, variance + found.sigma**2),
        })[INCREMENTAL]
    moved = INCREMENTAL if trust >= 0.5 else ABSOLUTE
    sign = 1.0 if moved == INCREMENTAL else -1.0
    return EncoderEvent(AXES[axis], float(found.run), found.kind, float(found.time),
                 sign * found.amount, found.sigma, moved,
                 float(max(trust, 1.0 - trust)), found.probability)


def _against_sky(night, sky, found, budget):
    """Steps and drifts against the sky that both encoders share, or have a part of."""
    moves = night.moves(SEGMENT + 2)
    out = []
    if not len(moves):
        return out
    for axis in (0, 1):
        on_sky = moves.on(axis, night.cos_el)
        for _ in range(_MOST):
            full = sky.fixed.beside(*(night.on(*one) for one in found))
            best = strongest(full, sky.enc, on_sky, budget.false_alarm / 2.0, night.sequence_2,
                             night.halves)
            if best is None:
                break
            run, kind, time = moves.about[best.place]
            event = EncoderEvent(AXES[axis], float(run), kind, float(time), best.amount, best.sigma,
                          ALIKE, 1.0 - best.probability, 2.0 * best.probability)
            column = moves.column(best.place)
            if kind == 'step':
                jump = _named(night, sky, axis, run, [*found, (axis, column)], len(found), budget)
                if jump is not None and jump[0] in (BOTH, ALIKE):
                    _, _, event, column = jump
                    event = replace(event, probability=2.0 * best.probability)
            found = [*found, (axis, column)]
            out.append(EncoderJump(axis, event, column))
    return out


def _named(night, sky, axis, run, found, number, budget):
    """Cause, its probability, `EncoderEvent` and column of the step `number` of those `found`.

    The others are kept where they are. None where no moment determines it.
    """
    steps = night.moves(SEGMENT, [run]).only(lambda about: about[1] == 'step')
    columns, times = steps.dense(), np.array([time for _, _, time in steps.about])
    others = [one for n, one in enumerate(found) if n != number]
    apart_base = night.apart_base(axis).beside(*(c for k, c in others if k == axis))
    sky_base = sky.fixed.beside(*(night.on(*one) for one in others))
    on_sky = np.column_stack([night.on(axis, column) for column in columns.T])
    at = int(np.argmin(np.abs(columns - found[number][1][:, None]).sum(axis=0)))
    from_apart = None
    for _ in range(2):  # outliers and noise are those beside the step
        here = columns[:, at]
        apart_full, sky_full = apart_base.beside(here), sky_base.beside(on_sky[:, at])
        if min(len(here) - len(apart_full), 2 * len(here) - len(sky_full)) < 3:
            return None
        y = clipped(apart_full, night.apart[axis])
        fit = robust_fit(apart_full, y)
        own = fit.residual + here * fit.coefficients[-1]
        second = clipped(sky_full, sky.abs)
        left = [fit.residual, robust_fit(sky_full, second).residual]
        shared = _shared(night.on(axis, left[0]), left[1])
        other = second - shared * night.on(axis, own)
        d = _fits(apart_base, y, columns, at, night.sequence)
        u = _fits(sky_base, other, on_sky, at, night.sequence_2, night.halves)
        gain = d.gain + u.gain
        if from_apart is None:
            # found in incremental - absolute: not far from where that has it
            from_apart = d.gain[at] > d.gain.max() - _NEAR and d.gain.max() > 2.0 * _NEAR
        if from_apart:
            gain = np.where(d.gain > d.gain.max() - _NEAR, gain, -np.inf)
        at = int(np.argmax(gain))
    allowed = np.isfinite(gain)
    logs = {name: np.where(allowed, value, -np.inf) for name, value in _logs(
        d, u, shared, budget.second).items()}
    said = probabilities({name: float(np.logaddexp.reduce(value))
                          for name, value in logs.items()})
    cause = max(said, key=said.get)
    at = int(np.argmax(logs[cause]))
    event = _event(axis, run, times[at], cause, said[cause], shared,
                   (d.size[at], d.sigma[at]), (u.size[at], u.sigma[at]))
    return cause, said[cause], event, columns[:, at]


def _fits(design, y, steps, at, sequence, series=None):
    """Each step alone beside the design, with the noise beside the step `at`."""
    colour = colour_of(design.beside(steps[:, at]), y, sequence, series)
    free = Free.of(colour.white(design))
    y, steps = free.off(colour.white(y)), free.off(colour.white(steps))
    square = np.sum(steps**2, axis=0)
    square = np.maximum(square, 1e-6)  # not determined: no gain
    amount = steps.T @ y / square
    left = y @ y - amount[at] ** 2 * square[at]
    noise = np.sqrt(max(left / max(len(y) - free.rank - 1, 1), LEAST**2))
    return _Fits(amount, noise / np.sqrt(square))


def _shared(apart, second):
    """How much of incremental - absolute is in absolute - sky, by what both leave: -1 ... 0."""
    square = apart @ apart
    return float(np.clip(apart @ second / square, -1.0, 0.0)) if square > 0.0 else 0.0


def _logs(d, u, shared, chance):
    """Log evidence of each cause at each moment, (k,), by (d, s - shared d)."""
    toll = 0.5 * ndtri(0.5 * chance) ** 2
    # of a size g times its sigma: half its square goes with the factor g / (1 + g)
    half = 0.5 * -np.expm1(-2.0 * toll)
    return {INCREMENTAL: half * _along(d, u, 1.0, -shared) - toll,
            ABSOLUTE: half * _along(d, u, -1.0, 1.0 + shared) - toll,
            BOTH: half * (d.gain + u.gain) - 2.0 * toll,
            ALIKE: half * u.gain - toll}


def _along(d, u, first, other):
    """Gain of a jump of both differences in a fixed ratio."""
    return (first * d.size / d.sigma**2 + other * u.size / u.sigma**2) ** 2 / (
        (first / d.sigma) ** 2 + (other / u.sigma) ** 2)


def _event(axis, run, time, cause, trust, shared, d, u):
    """The event of a step by its cause; `d` and `u` are a size and its sigma each."""
    second = u[0] + shared * d[0]
    second_sigma = np.hypot(u[1], shared * d[1])
    amount, sigma = {
        INCREMENTAL: d, ABSOLUTE: (-d[0], d[1]), ALIKE: u,
        BOTH: (second + d[0], np.hypot(u[1], (1.0 + shared) * d[1]))}[cause]
    event = EncoderEvent(AXES[axis], float(run), 'step', float(time), float(amount), float(sigma),
                         cause,
                  float(trust), np.nan)
    return event if cause != BOTH else replace(
        event, second=float(second), second_sigma=float(second_sigma))
