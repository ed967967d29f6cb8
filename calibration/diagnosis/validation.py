"""Judging on rows left out: cross-validation with the choice repeated, and runs held out.

A run held out is a new night of the same mount.
"""

from dataclasses import dataclass, field, replace
from pathlib import PurePath

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.fitted_effects import total
from pointing_model.rms import rms
from pointing_model.terms import stacked_design

from .base import observations
from .chance import Chance
from .choosing import choose
from .constants import (
    FEW_FOLDS,
    LONG,
    MANY,
    MOST_PARTITIONS,
    NESTED_FLIPS,
    PARTITIONS,
    RUNS,
    SPREAD,
)
from .linear import Columns, fit_state
from .resampling import (
    contiguous_folds,
    cross_validate,
    effective_runs,
    predicted,
    radial_arcsec,
    random_folds,
    run_folds,
)

_NOT_REPEATED = ('More is beyond chance, but it does not hold from run to run, so it is not added '
                 '(the notes have the names): what the rows of one run share looks like an effect.')
_NOT_AHEAD = ('More is beyond chance, but where rows or stretches of time are left out it predicts '
              'them worse than without it, so it is not added (the notes have the names).')
_CAUTION = ('But where {} are left out, they are predicted worse than without any effect '
            '({:.2f}\u2033 to {:.2f}\u2033{}): what was found may hold for these observations '
            'alone. Judge it on another run (--holdout) before you use it there.')
_IN = {'radial': '', 'x': ', in azimuth', 'y': ', in elevation'}
#: part by which one axis may seem worse while the whole gains: the error of an RMS of 30 rows left
#: out, of which nine tenths are predicted by nearly the same fit
_WORSE = 0.02


def partitions_of(problem, count, rng):
    """Folds by which a choice is judged: at random and in stretches; whole runs from 4 runs on.

    Parameters
    ----------
    problem : Problem
    count : int
    rng : numpy.random.Generator

    Returns
    -------
    list of list of ndarray of int
    """
    sequence = problem.sequence
    if problem.n > LONG:
        count = min(count, FEW_FOLDS)
    if effective_runs(sequence.run) >= RUNS:
        return [run_folds(sequence.run, min(count, len(np.unique(sequence.run))), rng)]
    return [random_folds(sequence.group, count, rng), _stretches(problem, count)]


def _stretches(problem, count):
    """Folds of neighbours in time (or in the order of the rows), who may share their error."""
    return contiguous_folds(np.argsort(problem.sequence.order), count)


@dataclass
class Errors:
    """Cross-validated RMS, the choice repeated.

    Attributes
    ----------
    before, after : dict
        ``radial``, ``x``, ``y``: arcsec, the mean over partitions.
    left_out : ndarray, shape (2, n)
        Residuals of rows left out, the choice repeated: the mean over partitions of their squares,
        as its root, radians.
    spread : dict or None
        ``partitions``, and of the radial RMS after ``min_arcsec`` and ``max_arcsec``.
    cut : int or None
        How many choices hold, where not all do.
    stretches : dict
        ``before``, ``after``: radial RMS with stretches of time left out; ``before_x``, ...
    caution : str
    """

    before: dict
    after: dict
    left_out: np.ndarray
    spread: dict | None = None
    cut: int | None = None
    stretches: dict = field(default_factory=dict)
    caution: str = ''


def cross_validated(work, chosen, wanders, count, alpha, chance, rng, ways=None):
    """RMS of rows left out, without any effect and with the choice repeated in each fold.

    Parameters
    ----------
    work : Work
    chosen : list of Choice
        Of all rows.
    wanders : bool
        Whether rows that resemble their neighbours are taken as such in the fits.
    count : int
        Folds.
    alpha : float
    chance : Chance
        Of all rows.
    rng : numpy.random.Generator
    ways : int, optional
        Partitions; by default until the mean is known to `SPREAD`.

    Returns
    -------
    Errors
    """
    problem = work.problem
    plain = problem if wanders else problem.plain
    keep = problem.plain.state(chosen, final=True).weights > 0.0
    if not chosen:  # the model stays as it was
        left_out = cross_validate(plain, [], partitions_of(problem, count, rng)[0])
        before = _rms(left_out, keep)
        return Errors(before, before, np.abs(left_out))
    squares = []
    left = []  # of each partition: with no choice, with the first 0, 1, ... of each fold
    least, most = (ways, ways) if ways is not None else (
        PARTITIONS, MOST_PARTITIONS if problem.n <= MANY else PARTITIONS)
    while len(left) < least or (len(left) < most and _unsure(left)):
        folds = partitions_of(problem, count, rng)[0]
        apart, _ = nested(problem, folds, alpha, rng, wanders, whole=chance)
        squares.append(np.square(apart[-1]))
        left.append([_rms(cross_validate(plain, [], folds), keep),
                     [_rms(r, keep) for r in apart]])
        if len(folds) == len(np.unique(problem.sequence.run)) > 1:
            break  # each run alone: there is but one such partition
    every = [steps[-1]['radial'] for _, steps in left]
    out = Errors(_mean([b for b, _ in left]), _mean([steps[-1] for _, steps in left]),
                 np.sqrt(np.mean(squares, axis=0)), {
        'partitions': len(left), 'min_arcsec': min(every), 'max_arcsec': max(every)})
    if effective_runs(problem.sequence.run) >= RUNS:
        if out.after['radial'] > out.before['radial']:
            counts = [_mean([steps[min(k, len(steps) - 1)] for _, steps in left])
                      for k in range(max(len(steps) for _, steps in left))]
            out.cut = min(int(np.argmin([c['radial'] for c in counts])), len(chosen))
            out.after = counts[out.cut]
            out.caution = _NOT_REPEATED if out.cut < len(chosen) else ''
        out.caution = out.caution or _worse('rows', out.before, out.after)
        return out
    folds = partitions_of(problem, count, rng)[1]
    before = _rms(cross_validate(plain, [], folds), keep)
    apart, _ = nested(problem, folds, alpha, rng, wanders, whole=chance)
    ways = [[_mean([steps[min(k, len(steps) - 1)] for _, steps in left]),
             _rms(apart[min(k, len(apart) - 1)], keep)]
            for k in range(max(len(apart), *(len(steps) for _, steps in left)))]
    worse = [_worse('stretches of time', before, stretch) or _worse('rows', out.before, row)
             for row, stretch in ways]
    after = ways[-1][1]
    if worse[-1]:
        sound = [k for k, text in enumerate(worse) if not text] or [0]
        cut = min(sound, key=lambda k: ways[k][0]['radial'] + ways[k][1]['radial'])
        if cut < len(chosen):
            out.cut, (out.after, after) = cut, ways[cut]
            out.caution = _NOT_AHEAD
        else:
            out.caution = worse[-1]
    out.stretches = {'before': before['radial'], 'after': after['radial'],
                     **{f'{when}_{axis}': one[axis] for axis in 'xy'
                        for when, one in (('before', before), ('after', after))}}
    return out


def _unsure(left):
    every = np.array([steps[-1]['radial'] for _, steps in left])
    return every.std(ddof=1) > SPREAD * np.sqrt(len(every)) * every.mean()


def _worse(what, before, after):
    """A sentence, where the whole or an axis is predicted worse."""
    for axis, words in _IN.items():
        if after[axis] > before[axis] * (1.0 if axis == 'radial' else 1.0 + _WORSE):
            return _CAUTION.format(what, before[axis], after[axis], words)
    return ''


def _rms(residual, keep):
    x, y = (rms(r[keep]) / ARCSEC for r in residual)
    return {'radial': float(np.hypot(x, y)), 'x': x, 'y': y}


def _mean(entries):
    return {axis: float(np.mean([e[axis] for e in entries])) for axis in _IN}


def nested(problem, folds, alpha, rng, wanders=False, flips=NESTED_FLIPS, whole=None):
    """As `cross_validate`, with the whole choice repeated without each fold.

    Parameters
    ----------
    problem : Problem
    folds : list of ndarray of int
    alpha : float
    rng : numpy.random.Generator
    wanders : bool
        As of `cross_validated`.
    flips : int
    whole : Chance, optional
        Of all rows.

    Returns
    -------
    residual : ndarray, shape (k + 1, 2, n)
        Radians: with the first 0, 1, ... k choices of each fold; k is the most that one has, and
        a fold that has fewer takes all of its own.
    choices : list of list of Choice
        Of each fold.
    """
    choices, parts = [], []
    everything = np.arange(problem.n)
    for fold in folds:
        part = problem.rows(np.setdiff1d(everything, fold))
        found = choose(part, alpha, Chance(part.n, flips, rng, whole),
                       partitions_of(part, FEW_FOLDS, rng)).found
        choices.append(found.chosen)
        left = []
        for k in range(len(found.chosen) + 1):
            state = (part if wanders else part.plain).state(
                found.chosen[:k], found.state.weights if k else None, final=True)
            left.append(predicted(problem, part, found.chosen[:k], state, fold))
        parts.append(left)
    out = np.empty((max(map(len, parts)), 2, problem.n))
    for fold, left in zip(folds, parts):
        for k in range(len(out)):
            out[k][:, fold] = left[min(k, len(left) - 1)]
    return out, choices


def judge_on(runs, result, own_terms, encoder='enc'):
    """Put the radial RMS on left-out runs, without and with the effects, into a result.

    The model stays as it is but for `own_terms`, which each run refits robustly on its own rows:
    so does an observer on a new night.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
    result : Diagnosis
    own_terms : sequence of str
    encoder : {'enc', 'abs'}
    """
    obs = observations(runs, encoder)
    left, kept = [], np.ones(len(obs), bool)
    for model in (result.base_model, result.model):
        state = _refit(obs, model, own_terms)
        left.append(state.raw.reshape(2, -1))
        kept &= state.weights > 0.0
    for entry, residual in zip((result.before, result.after), left):
        entry['holdout_rms_arcsec'] = radial_arcsec(residual, kept)
    notes = [f'held out: {note}' for note in _left_out(obs)]
    for found in result.model.effects:
        lost = np.count_nonzero(found.unknown(obs.context))
        if lost:
            notes.append(f'held out: {found.effect.name} counts as zero in {lost} of {len(obs)} '
                         f'rows, where {found.effect.driver} is not known')
    note = (f'held out: {len(obs)} observations of {len(obs.runs)} runs, '
            f'{", ".join(own_terms)} refitted in each, nothing else; '
            f'{int(np.sum(~kept))} outliers set aside')
    result.notes += [note, *notes]


def _left_out(obs):
    reasons = {}
    for e in obs.excluded:
        place = f'{PurePath(str(e.get("source") or "run")).name}:{e["row"]}'
        reasons.setdefault(e['reason'], []).append(place)
    return [*obs.notes, *(f'{", ".join(places)} left out: {reason}'
                          for reason, places in reasons.items())]


def _refit(obs, model, own_terms):
    az, el = obs.context.az, obs.context.el
    # the effects by the drivers of the whole run: a row may have one from the row before
    b = obs.observed - np.nan_to_num(np.concatenate(replace(model, effects=()).offsets(az, el))) \
        - np.concatenate(total(model.effects, obs.context))
    own = stacked_design(tuple(own_terms), az, el)
    columns = Columns(own[:0], own, obs.label)
    return fit_state(columns, b, obs.inverse_sigma, final=True)
