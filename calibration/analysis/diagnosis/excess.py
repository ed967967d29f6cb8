"""What is beyond chance, but not beyond a zero that wanders: its cause is not told."""

from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtrc

from msg_tools.units import ARCSEC
from pointing_model.effects.base import arcsec, the

from .alike_rows import Seen, direction_sentence, seen_sentence
from .constants import WANDER_TESTS
from .slow_noise import beyond_terms, slow_part, trend

_AHEAD, _POINTS = 1800.0, 12  # s, and places in them
_SOME = 100  # rows that stand for a run
_NIGHTS = 1000  # simulated
_PART = 0.5  # of the run, in which it is said how rows differ
_STEP = 1.0 / 3.0  # of the distance of any two rows: steps so short go along the sky
_NAMED = 5  # drivers in a sentence, at most
#: of the variance of an axis, from where an even drift is told
MOSTLY = 0.5


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


def wander_entry(found, problem, context, chosen=(), residual=None):
    """JSON-ready entry of a result.

    Parameters
    ----------
    found : Unexplained
    problem : Problem
    context : Context
        Of the rows.
    chosen : sequence of Choice
        The effects in the model.
    residual : ndarray, shape (2, n), optional
        What the model leaves, radians; by default what a fit without memory does.

    Returns
    -------
    dict
        ``p`` (at most); ``like`` (names of effects that would explain it); ``slow``: it lasts
        longer than from row to row; ``text``, a sentence; ``along_the_sky``, see
        `along_the_sky`; ``removes_rms_arcsec``: what the wander did in these rows, RMS on the sky
        beyond the terms; and ``axes``: of each ``sigma_arcsec`` of the process, ``memory`` and
        ``span`` (of the rows) in ``unit`` (hours, rows), ``angle`` (it is one of the azimuth axis:
        times cos E on the sky), as the likelihood has them; ``row_to_row_arcsec``, the noise that
        neighbours show between them by it; what is measured of rows that are ``apart`` from one
        another, in ``unit``, see `wander_seen.Seen.to_dict`; and ``trend``, see `slow_part.trend`.
    """
    sequence, words = problem.sequence, context.mount.names.axes
    unit = 3600.0 if sequence.timed else 1.0
    apart, said = _apart(sequence)
    gap = sequence.gap
    usual = float(np.quantile(gap[np.isfinite(gap)], 0.9))
    axes, slow, drifts = {}, False, []
    typical = 1.0 if problem.inverse_sigma is None else 1.0 / np.median(
        problem.inverse_sigma.reshape(2, -1), axis=1)
    typical = np.broadcast_to(typical, 2)
    plain = problem.plain.state(list(chosen))
    seen = Seen(context, sequence, plain.raw.reshape(2, -1) if residual is None else residual,
                plain.weights > 0.0, apart)
    for name, one in found.axes.items():
        axis = ('az', 'el').index(name)
        near = one.scale**2 + one.variance * -np.expm1(-float(np.median(gap[np.isfinite(gap)]))
                                                       / one.memory)
        axes[name] = {'sigma_arcsec': float(np.sqrt(one.variance) / ARCSEC),
                      'memory': float(one.memory / unit), 'span': sequence.span / unit,
                      'unit': 'hours' if sequence.timed else 'rows', 'apart': apart / unit,
                      'angle': one.angle, **seen.to_dict(axis),
                      'row_to_row_arcsec': float(np.sqrt(near) * typical[axis] / ARCSEC),
                      'trend': trend(problem, list(chosen), name, one)}
        drift = axes[name]['trend']
        if drift and drift['share'] > MOSTLY:
            drifts.append(drift_words(words[axis], drift))
        slow |= one.memory > usual
    step = along_the_sky(context, sequence)
    if slow:
        text = '. '.join(filter(None, [
            _lead(step, _like(found, problem)), seen_sentence(axes, words, said),
            direction_sentence(axes, words, said, seen.within, seen.pairs()) if step else '',
            f'Most of it is even: {" and ".join(drifts)}, as where something slips or settles '
            '(clutch, clamp, saddle, tripod or pier, mirror)' if drifts else '',
            'What moves it is not known' if not step else
            'To tell them apart return to stars of the beginning now and then, or observe in an '
            'order that mixes the sky']))
    else:
        text = 'rows taken close together share their error: they count as fewer'
    return {'axes': axes, 'p': found.p,
            'removes_rms_arcsec': beyond_terms(
                problem, slow_part(problem, list(chosen), found.axes), chosen),
            'like': list(dict.fromkeys(c.effect(problem).name for c in found.like)),
            'slow': bool(slow), 'along_the_sky': step, 'text': text}


def _lead(step, like):
    """What it may be: what the rows do not tell apart comes first."""
    if not step:
        return f'neighbouring rows err alike: the zero wanders, or {like} does it' if like else \
            'the zero wanders'
    more = f', or {like} does it' if like else ''
    return ('neighbouring rows err alike, and these rows do not tell why: the zero wanders, or the '
            f'direction has an error that no effect in the model describes{more}; for they went '
            f'over the sky step by step, {step["step_deg"]:.0f}\u00b0 from one to the next '
            f'({step["any_deg"]:.0f}\u00b0 between any two)')


def drift_words(axis, drift):
    """A `slow_part.trend` of an axis in words."""
    rate = drift['rate_arcsec_per_hour']
    return f'the {axis} error {"falls" if rate < 0.0 else "grows"} by {arcsec(abs(rate))} an hour'


def _apart(sequence):
    """How far apart two rows are of which is said how they differ, and in words."""
    if not sequence.timed:
        return (10.0, 'ten') if _PART * sequence.span >= 10.0 else (3.0, 'three')
    for seconds, words in ((3600.0, 'an hour'), (600.0, 'ten minutes')):
        if seconds <= _PART * sequence.span:
            return seconds, words
    return 60.0, 'a minute'


def along_the_sky(context, sequence):
    """Whether neighbours in time are neighbours on the sky: what wanders may follow the direction.

    Returns
    -------
    dict or None
        ``step_deg`` and ``any_deg``: medians of the distances from one row to the next, and
        between any two; None where the order mixes the sky.
    """
    places = context.mount.direction(context.az, context.el).T[sequence.order]
    if len(places) < 3:
        return None
    following = np.isfinite(sequence.gap[1:])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)[following]
    rng = np.random.default_rng(0)  # the same rows say the same
    any_two = np.linalg.norm(places - places[rng.permutation(len(places))], axis=1)
    any_two = any_two[any_two > 0.0]
    if not len(steps) or not len(any_two):
        return None
    step, other = (float(np.degrees(2.0 * np.arcsin(0.5 * np.median(chord))))
                   for chord in (steps, any_two))
    return {'step_deg': step, 'any_deg': other} if step < _STEP * other else None


def _like(found, problem):
    """What would explain it, in words: one cause by its name, of several what they follow."""
    effects = [c.effect(problem) for c in found.like]
    causes = list(dict.fromkeys(e.cause_told for e in effects if e.kind != 'smooth'))
    if len(causes) == 1 and len(effects) == 1:
        return f'"{causes[0]}"'
    drivers = list(dict.fromkeys(the(e.driver) for e in effects))
    if len(drivers) > _NAMED:
        drivers = [*drivers[:_NAMED - 1], f'{len(drivers) - _NAMED + 1} more that the ranking has']
    return f'something that changes with {" or ".join(drivers)}' if drivers else ''
