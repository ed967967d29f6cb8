"""What is beyond chance, but not beyond a zero that wanders: its cause is not told."""

from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtrc

from msg_tools.units import ARCSEC
from pointing_model.effects.base import AXES, readable

from .constants import WANDER_TESTS

_AHEAD, _POINTS = 1800.0, 12  # s, and places in them
_SOME = 100  # rows that stand for a run
_NIGHTS = 1000  # simulated


@dataclass
class Unexplained:
    """Rows alike, though no driver explains them.

    Attributes
    ----------
    axes : dict of str to AxisWander
        ``az``, ``el``: the axes that wander.
    p : float
        That noise without memory would show as much, at most.
    like : list of Choice
        Effects of the dictionary that would explain it, were there no wander.
    """

    axes: dict
    p: float
    like: list = field(default_factory=list)


def unexplained(problem, found, alpha):
    """Whether the noise wanders, beyond what the choice explains.

    Either of two tests is beyond chance at `alpha`: effects that would be added if rows had no
    memory, and that are not beyond a wander; or the restricted likelihood of the wander itself.

    Parameters
    ----------
    problem : Problem
    found : Found
    alpha : float

    Returns
    -------
    Unexplained or None
    """
    wander = problem.state(found.chosen).wander
    if not wander:
        return None
    p = wander_chance(wander)
    if not found.wandering and p > alpha:
        return None
    axes = {name: one for name, one in zip(('az', 'el'), wander) if one.variance > 0.0}
    # of effects that are beyond chance no more is known than that they are
    return Unexplained(axes, min(p, alpha), list(found.wandering))


def wander_chance(wander):
    """Chance that noise without memory has as large a likelihood ratio on either axis.

    Parameters
    ----------
    wander : tuple of AxisWander

    Returns
    -------
    float
    """
    gain = max(one.gain for one in wander)
    return float(min(WANDER_TESTS * 0.5 * chdtrc(1.0, max(gain, 0.0)), 1.0))


def ahead(problem, chosen, rng):
    """What a wandering zero does to fresh stars in the half hour (or ten rows) after the last row.

    Nights are simulated that have left these residuals (simple kriging; Cressie 1993, Statistics
    for Spatial Data, section 3.2), each with a wander that is likely: where the zero is after the
    last row is known in part.

    Parameters
    ----------
    problem : Problem
    chosen : list of Choice
    rng : numpy.random.Generator

    Returns
    -------
    squares : ndarray, shape (b,)
        Of each night: mean square of the zero then, of both axes on the sky, rad^2; zero where
        nothing wanders.
    still : ndarray, shape (b,)
        Mean square of fresh stars without it, rad^2; NaN where nothing wanders.
    """
    plain = problem.plain.state(chosen)
    raw, root = (v.reshape(2, -1) for v in (plain.raw, plain.white.root))
    noise = np.repeat(np.square(plain.scale)[:, None], _NIGHTS, axis=1)
    squares = np.zeros(_NIGHTS)
    for axis, (every, chance) in enumerate(problem.likely(chosen)):
        which = rng.choice(len(every), _NIGHTS, p=chance)
        for k in np.unique(which[which > 0]):
            nights = np.flatnonzero(which == k)
            squares[nights] += _after(problem.sequence, every[k], root[axis] * plain.scale[axis]
                                      / every[k].scale, raw[axis], len(nights), rng)
            noise[axis, nights] = every[k].scale**2
    fitted = 1.0 + len(plain.basis) / (2.0 * problem.n)  # the error of the terms
    return squares, np.where(squares > 0.0, fitted * noise.sum(axis=0), np.nan)


def _after(sequence, one, root, raw, count, rng):
    """Mean square of a wander after the last row, shape (count,), by what it left in the rows."""
    last = sequence.order[sequence.run[sequence.order] == sequence.run[sequence.order[-1]]]
    rows = last[root[last] > 0.0][-_SOME:]
    n = len(rows)
    on_sky = sequence.cos_el[rows] if one.angle else np.ones(n)
    at = np.concatenate((sequence.position[rows], sequence.position[last[-1]] + np.linspace(
        0.0, _AHEAD if sequence.timed else 10.0, _POINTS + 1)[1:]))
    z = one.variance * np.exp(-np.abs(at[:, None] - at) / one.memory)
    noise = np.diag(1.0 / np.square(root[rows] * on_sky))
    known = np.linalg.solve(z[:n, :n] + noise, z[:n, n:]).T
    values, vectors = np.linalg.eigh(z[n:, n:] - known @ z[:n, n:])
    drawn = known @ (raw[rows] / on_sky) + rng.standard_normal((count, _POINTS)) @ (
        vectors * np.sqrt(np.maximum(values, 0.0))).T
    return np.square(drawn).mean(axis=1) * np.mean(np.square(on_sky))


def wander_entry(found, problem, words=AXES):
    """JSON-ready entry of a result.

    Parameters
    ----------
    found : Unexplained
    problem : Problem
    words : dict
        ``az``, ``el``: what the angles of the axes are called.

    Returns
    -------
    dict
        ``p`` (at most); ``like`` (names of effects that would explain it); ``slow``: it lasts
        longer than from row to row; ``text``, a sentence; and ``axes``: of each ``sigma_arcsec``
        of the process, ``memory`` and ``span`` (of the rows) in ``unit`` (hours, rows),
        ``angle`` (it is one of the azimuth axis: times cos E on the sky), ``moves_arcsec``: how
        far it is expected to move (RMS) in one hour, or in ten rows.
    """
    timed = problem.sequence.timed
    unit, far = (3600.0, 3600.0) if timed else (1.0, 10.0)
    gap = problem.sequence.gap
    usual = float(np.quantile(gap[np.isfinite(gap)], 0.9))
    axes, parts, slow = {}, [], False
    for name, one in found.axes.items():
        sigma = np.sqrt(one.variance) / ARCSEC
        moves = sigma * np.sqrt(2.0 * -np.expm1(-far / one.memory))
        axes[name] = {'sigma_arcsec': float(sigma), 'memory': float(one.memory / unit),
                      'span': problem.sequence.span / unit,
                      'unit': 'hours' if timed else 'rows', 'moves_arcsec': float(moves),
                      'angle': one.angle}
        slow |= one.memory > usual
        parts.append(f'in {words[name]} by {moves:.2f}\u2033 (RMS) within '
                     + ('an hour' if timed else 'ten rows'))
    like = list(dict.fromkeys(c.effect(problem).name for c in found.like))
    if slow:
        text = f'the zero wanders, {" and ".join(parts)}, and its cause is not told'
        if like:
            text += f'; it could as well be {" or ".join(map(readable, like))}'
    else:
        text = 'rows taken close together share their error: they count as fewer'
    return {'axes': axes, 'p': found.p, 'like': like, 'slow': bool(slow), 'text': text}
