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
#: degrees of freedom of the size of a random walk, which one run shows but once; chosen so that the
#: interval holds 53 of 60 random walks
_FREE = 4.0


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


def ahead(wander, problem, rng):
    """What a wandering zero does to fresh stars in the half hour (or ten rows) after the last row.

    Parameters
    ----------
    wander : tuple of AxisWander
        As it is estimated, beyond chance or not: what is expected does not hang on a verdict.
    problem : Problem
    rng : numpy.random.Generator

    Returns
    -------
    squares : ndarray, shape (b,)
        Of simulated nights: mean square of the zero then, less its mean over the rows of the last
        run, of both axes on the sky, rad^2; zeros where nothing wanders.
    among : float
        The same of the rows themselves, expected.
    """
    squares, among = np.zeros(_NIGHTS), 0.0
    sequence = problem.sequence
    last = np.flatnonzero(sequence.run == sequence.run[sequence.order[-1]])
    rows = np.sort(sequence.position[last])[::-(-len(last) // _SOME)]
    at = np.concatenate((rows, rows[-1] + np.linspace(
        0.0, _AHEAD if sequence.timed else 10.0, _POINTS + 1)[1:]))
    for one in (one for one in wander if one.variance > 0.0):
        variance = one.variance * (np.mean(np.square(sequence.cos_el)) if one.angle else 1.0)
        shared = np.exp(-np.abs(at[:, None] - at) / one.memory) + 1e-9 * np.eye(len(at))
        z = np.sqrt(variance) * rng.standard_normal((_NIGHTS, len(at))) @ np.linalg.cholesky(
            shared).T
        z -= z[:, :len(rows)].mean(axis=1, keepdims=True)
        # a run knows the size of a wander by as many values as it is memories long
        free = _FREE + (rows[-1] - rows[0]) / one.memory
        z *= np.sqrt(free / rng.chisquare(free, (_NIGHTS, 1)))
        squares += np.square(z[:, len(rows):]).mean(axis=1)
        among += variance * (1.0 - shared[:len(rows), :len(rows)].mean())
    return squares, float(among)


def wander_entry(found, problem):
    """JSON-ready entry of a result.

    Parameters
    ----------
    found : Unexplained
    problem : Problem

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
        parts.append(f'in {AXES[name]} by {moves:.2f}\u2033 (RMS) within '
                     + ('an hour' if timed else 'ten rows'))
    like = list(dict.fromkeys(c.effect(problem).name for c in found.like))
    if slow:
        text = f'the zero wanders, {" and ".join(parts)}, and its cause is not told'
        if like:
            text += f'; it could as well be {" or ".join(map(readable, like))}'
    else:
        text = 'rows taken close together share their error: they count as fewer'
    return {'axes': axes, 'p': found.p, 'like': like, 'slow': bool(slow), 'text': text}
