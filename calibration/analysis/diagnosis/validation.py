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

"""Comparison on rows left out: cross-validation with the choice repeated.

Something may be significant though these observations cannot test it: it is neither found nor
absent. What is dropped because rows or runs that are left out are predicted worse is, as a rule, no
effect of the mount. Where it carries most of the error, or where the declared model itself fails on
what is left out, the runs are too few or too unequal to say so: without one of them the rest does
not determine it.
"""

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from calibration.estimation.chance import NESTED_FLIPS, Chance
from calibration.estimation.folds import (
    FEW_FOLDS,
    cross_validate,
    leaves_runs,
    partitions_of,
    predicted,
)
from calibration.estimation.select import choose
from msg_tools.forks import forked
from msg_tools.units import ARCSEC
from pointing_model.effects.base import readable
from pointing_model.mounts import ALTAZ

from ..finding import Finding
from .alternatives import cause_counts, run_counts
from .expected_error import ahead, expected_error

#: partitions into folds over which the figure of rows left out at random is a mean: at least and at
#: most; from `MANY` rows on, where a row more or less in a fold changes little, one at least
PARTITIONS, MOST_PARTITIONS, MANY = 2, 10, 250
#: there are more while the standard error of the mean is above this part of it, or while what the
#: effects gain is below so many of its standard errors (of one partition: below this part)
SPREAD, _CLEAR = 0.03, 3.0
#: rows of a fold, below which each row is left out alone: there is one such partition, and its
#: figure does not hang on the seed (of 38 stars it scattered by 0.2 of 3" from one to the next)
_LEAST_ROWS = 4
_IN = ('radial', 'x', 'y')
#: part by which one axis may seem worse while the whole gains: from partition to partition the
#: figure of the MMT's night differs by 0.4 %, that of the 8 m telescope by 3 %
_WORSE = 0.02
#: ... and of the squares that the whole gains, the part that an axis may lose: an effect of one
#: axis gives its rows more weight in the terms that both share, which the other axis feels
#: (a second flexure of 2.3": 2.74 to 1.43" on the sky, and 1.06 to 1.09" in azimuth)
_LOST = 0.1
#: RMS of rows left out over the noise floor, times what the fit's freedom makes of it (see
#: `_expected_ratio`), from where the model fails there; where something was dropped besides, and
#: where nothing was. On 150 clean nights each of 12, 16, 30 and 60 stars it was 1.5, 1.4, 1.1 and
#: 1.0 at most.
_FAILS, _FAILS_ALONE = 1.3, 1.6


@dataclass
class CrossValidation:
    """Cross-validated RMS, the choice repeated.

    Attributes
    ----------
    before, after : dict
        ``radial``, ``x``, ``y``: arcsec, the mean over partitions.
    left_out : ndarray, shape (2, n)
        Residuals of rows left out, the choice repeated: the mean over partitions of their squares,
        as its root, radians.
    spread : dict or None
        ``partitions``, and of the radial RMS after ``min_arcsec`` and ``max_arcsec``; of how many
        ``folds``, with those of stretches, ``same_choice`` chose the same effects, ``no_choice``
        none; and in how many each effect that was ``chosen``, and ``others``, the most frequent
        first.
    cut : int or None
        How many choices hold, where not all do.
    stretches : dict
        ``before``, ``after``: radial RMS with stretches of time left out; ``before_x``, ...
    chosen : list of list of Effect
        What was chosen in each fold.
    cautions : list of Finding
    """

    before: dict
    after: dict
    left_out: np.ndarray
    spread: dict | None = None
    cut: int | None = None
    stretches: dict = field(default_factory=dict)
    chosen: list = field(default_factory=list)
    cautions: list = field(default_factory=list)


def cross_validated(run, chosen, remembers, count, alpha, chance, rng, ways=None,
                    progress=None, chooser=choose, jobs=1):
    """RMS of rows left out, without any effect and with the choice repeated in each fold.

    Parameters
    ----------
    run : RunProblem
    chosen : list of CandidateGroup
        Of all rows.
    remembers : bool
        Whether rows that resemble their neighbours are taken as such in the fits.
    count : int
        Folds.
    alpha : float
    chance : Chance
        Of all rows.
    rng : numpy.random.Generator
    ways : int, optional
        Partitions; by default until the mean is known to `SPREAD` and the gain is clear.
    progress : callable, optional
        As of `diagnose`.
    chooser : callable
        What chooses in each fold, see `choose`.
    jobs : int
        Folds at a time, see `forked`.

    Returns
    -------
    CrossValidation
    """
    problem, words = run.problem, run.obs.run.mount.names.axes
    fits = problem if remembers else problem.plain
    keep = problem.plain.fit(chosen, final=True).weights > 0.0
    if not chosen:  # the model stays as it was
        ways = ways or (MOST_PARTITIONS if problem.n <= MANY else 1)
        partitions = [_folds_of_rows(problem, count, rng) for _ in range(ways)]
        squares = [np.square(cross_validate(fits, [], folds))
                   for folds in (partitions[:1] if _only(problem, partitions[0]) else partitions)]
        before = _mean([_rms(one, keep) for one in squares])
        return CrossValidation(before, before, np.sqrt(np.mean(squares, axis=0)))

    def count_fold():
        nonlocal folds_done
        folds_done += 1
        if progress:
            progress('cross-validation', folds_done, max(expected, folds_done))

    def errors_of(folds):
        left, choices = nested(problem, folds, alpha, rng, remembers, whole=chance, done=count_fold,
                               chooser=chooser, jobs=jobs)
        every.extend(choices)
        without = cross_validate(problem.plain, [], folds) if remembers else left[0]
        return _rms(np.square(without), keep), np.square(left)
    parts, every, folds_done, expected = [], [], 0, 0
    chance.simulate(problem, chosen)  # once, and not in each fold
    least, most = (ways, ways) if ways is not None else (
        PARTITIONS if problem.n <= MANY else 1, MOST_PARTITIONS)
    while len(parts) < least or (len(parts) < most and _unsure(parts, keep)):
        folds = _folds_of_rows(problem, count, rng)
        only = _only(problem, folds)
        expected = len(folds) * (1 if only else max(least, len(parts) + 1)) + count * (
            not leaves_runs(problem))
        parts.append(errors_of(folds))
        if only:
            break
    before = _mean([one for one, _ in parts])
    by_count = [_figure(before, [_first(squares, k) for _, squares in parts], keep)
                for k in range(max(len(squares) for _, squares in parts))]
    if leaves_runs(problem):
        out = _by_runs(by_count, keep, len(chosen), words)
    else:
        stretches = errors_of(partitions_of(problem, count, rng)[1])
        out = _by_rows(by_count, stretches, keep, len(chosen), words)
    out.spread.update(_repeated(problem, chosen, every))
    out.chosen = [[c.effect(problem) for c in some] for some in every]
    return out


def _folds_of_rows(problem, count, rng):
    """Rows left out at random, each alone where they are few; whole runs from 4 runs on."""
    groups = len(np.unique(problem.sequence.group))
    if not leaves_runs(problem) and groups <= _LEAST_ROWS * count:
        count = groups
    return partitions_of(problem, count, rng)[0]


def _only(problem, folds):
    """Whether there is but one such partition: each run, or each group of rows, alone."""
    of = problem.sequence
    runs = len(np.unique(of.run))
    return len(folds) == runs > 1 or len(folds) == len(np.unique(of.group))


def _repeated(problem, chosen, choices):
    """How often the same effects were chosen, and each, and others, for `CrossValidation`."""
    every = [[c.effect(problem) for c in some] for some in choices]
    own = {c.effect(problem).line: c.effect(problem).name for c in chosen}
    # in order: a set of names has another one in each process
    counts = Counter(line for some in every for line in dict.fromkeys(e.line for e in some))
    others = {e.line: e.name for some in every for e in some if e.line not in own}
    return {'folds': len(choices),
            'same_choice': sum({e.line for e in some} == set(own) for some in every),
            'no_choice': sum(not some for some in every),
            'chosen': {name: counts[line] for line, name in own.items()},
            'others': {others[line]: count for line, count in counts.most_common()
                       if line in others}}


def _first(squares, k):
    """Of the first `k` choices of each fold; all where there are fewer."""
    return squares[min(k, len(squares) - 1)]


def _figure(before, squares, keep):
    """`CrossValidation` of squares, each (2, n), of several partitions."""
    after = [_rms(one, keep) for one in squares]
    radial = [one['radial'] for one in after]
    return CrossValidation(before, _mean(after), np.sqrt(np.mean(squares, axis=0)), {
        'partitions': len(after), 'min_arcsec': min(radial), 'max_arcsec': max(radial)})


def _by_runs(by_count, keep, chosen, words):
    """With whole runs left out: all choices, or as many as predict them best."""
    out = by_count[-1]
    if out.after['radial'] > out.before['radial']:
        cut = min(int(np.argmin([one.after['radial'] for one in by_count])), chosen)
        out = replace(by_count[cut], cut=cut,
                      cautions=[Finding('not from run to run')] if cut < chosen else [])
    surely = _surely(by_count[0].left_out[:, keep]**2, out.left_out[:, keep]**2)
    worse = _worse('rows', [out.before], out.after, surely, words)
    if worse and not out.cautions:
        out.cautions = [Finding('worse on rows left out', **worse)]
    return out


def _by_rows(by_count, stretches, keep, chosen, words):
    """With rows and stretches of time left out: all choices, or as many as do no harm there."""
    before, squares = stretches
    counts = range(max(len(by_count), len(squares)))
    rows = [_first(by_count, k) for k in counts]
    in_stretches = [_rms(_first(squares, k), keep) for k in counts]
    worse = [
        _worse('stretches of time', [before, *in_stretches[:k]], in_stretches[k],
               _surely(squares[0][:, keep], _first(squares, k)[:, keep]), words)
        or _worse('rows', [rows[k].before, *(one.after for one in rows[:k])], rows[k].after,
                  _surely(rows[0].left_out[:, keep]**2, rows[k].left_out[:, keep]**2), words)
        for k in counts]
    count, cut, cautions = counts[-1], None, []
    if worse[-1]:
        kind = 'worse on rows left out'
        sound = [k for k in counts if not worse[k]] or [0]
        best = min(sound, key=lambda k: rows[k].after['radial'] + in_stretches[k]['radial'])
        if best < chosen:
            count, cut, kind = best, best, 'dropped, worse on rows left out'
        cautions = [Finding(kind, **worse[-1])]
    after = in_stretches[count]
    return replace(rows[count], cut=cut, cautions=cautions, stretches={
        'before': before['radial'], 'after': after['radial'],
        **{f'{when}_{axis}': one[axis] for axis in 'xy'
           for when, one in (('before', before), ('after', after))}})


def _unsure(parts, keep):
    """Whether more partitions could change the figure, or whether the effects gain at all."""
    before, after = np.array([(one['radial'], _rms(squares[-1], keep)['radial'])
                              for one, squares in parts]).T
    gain = abs(np.mean(before - after))
    if len(parts) == 1:
        return bool(gain < SPREAD * before[0])
    error, of_gain = (each.std(ddof=1) / np.sqrt(len(parts)) for each in (after, before - after))
    return bool(error > SPREAD * after.mean() or gain < _CLEAR * of_gain)


def _worse(what, before, after, surely, words=ALTAZ.names.axes):
    """Where the whole is predicted worse, or an axis of those in `surely`, and that for no gain.

    Parameters
    ----------
    what : str
        What was left out.
    before : sequence of dict
        RMS without any effect, and with fewer of them than `after`.
    after : dict
    surely : set of str
        Of `_surely`.
    words : sequence of str
        The axes.

    Returns
    -------
    dict
        Of a Finding: `what`, RMS before and after, and the axis; empty where nothing is worse.
    """
    without = before[0]
    for axis in _IN:
        limit = without[axis] * (1.0 if axis == 'radial' else 1.0 + _WORSE)
        if after[axis] > limit and (axis == 'radial' or axis in surely and any(
                after[axis]**2 - one[axis]**2 > _LOST * (one['radial']**2 - after['radial']**2)
                for one in before)):
            return {'before': without[axis], 'after': after[axis], 'evidence': {
                'what': what, 'axis': dict(zip('xy', words)).get(axis, '')}}
    return {}


def _surely(before, after):
    """Axes that squares, shape (2, n), of the same rows show worse by more than their scatter.

    Of 40 rows an axis that an effect does not touch differs by 3 % by chance.
    """
    more = after - before
    scatter = more.std(axis=1, ddof=1) / np.sqrt(more.shape[1])
    return {axis for axis, worse in zip('xy', more.mean(axis=1) > scatter) if worse}


def _rms(squares, keep):
    """Of squared residuals, shape (2, n), rad^2."""
    x, y = (float(np.sqrt(np.mean(one[keep]))) / ARCSEC for one in squares)
    return {'radial': float(np.hypot(x, y)), 'x': x, 'y': y}


def _mean(entries):
    return {axis: float(np.mean([e[axis] for e in entries])) for axis in _IN}


def nested(problem, folds, alpha, rng, remembers=False, flips=NESTED_FLIPS, whole=None, done=None,
           chooser=choose, jobs=1):
    """As `cross_validate`, with the whole choice repeated without each fold.

    Parameters
    ----------
    problem : SelectionProblem
    folds : list of ndarray of int
    alpha : float
    rng : numpy.random.Generator
    remembers : bool
        As of `cross_validated`.
    flips : int
    whole : Chance, optional
        Of all rows.
    done : callable, optional
        Called after each fold.
    chooser : callable
    jobs : int
        As of `cross_validated`.

    Returns
    -------
    residual : ndarray, shape (k + 1, 2, n)
        Radians: with the first 0, 1, ... k choices of each fold; k is the most that one has, and
        a fold that has fewer takes all of its own.
    choices : list of list of CandidateGroup
        Of each fold.
    """
    everything = np.arange(problem.n)

    def without(fold):
        # all that is random is drawn here, in order, whoever does the work
        part = problem.part(np.setdiff1d(everything, fold))
        chance = Chance(part.n, flips, rng, whole, part.sequence.group)
        partitions = partitions_of(part, FEW_FOLDS, rng)

        def work():
            choice = chooser(part, alpha, chance, partitions)
            left = []
            for k in range(len(choice.chosen) + 1):
                fit = (part if remembers else part.plain).fit(
                    choice.chosen[:k], choice.fit.weights if k else None, final=True)
                left.append(predicted(problem, part, choice.chosen[:k], fit.noise, fold))
            return choice.chosen, left
        return work

    choices, parts = zip(*forked(map(without, folds), jobs, done))
    out = np.empty((max(map(len, parts)), 2, problem.n))
    for fold, left in zip(folds, parts):
        for k in range(len(out)):
            out[k][:, fold] = left[min(k, len(left) - 1)]
    return out, choices


def add_errors(result, found, run, choice, errors, rng):
    """Put the figures of rows left out into a result.

    Parameters
    ----------
    result : Diagnosis
    found : list of DiagnosedEffect
        Of the choice, which are in the result.
    run : RunProblem
    choice : ModelChoice
    errors : CrossValidation
    rng : numpy.random.Generator
    """
    problem = run.problem
    if not choice.chosen:  # the model stays as it was
        errors.before, errors.stretches = errors.after, {
            key: errors.stretches[key.replace('before', 'after')] for key in errors.stretches}
    for entry, gain in zip(found, choice.gains):
        entry.cv_gain_arcsec = float(gain)
    for entry, one in ((result.before, errors.before), (result.after, errors.after)):
        entry.update(cv_rms_arcsec=one['radial'], cv_rms_x_arcsec=one['x'],
                     cv_rms_y_arcsec=one['y'])
    if errors.spread and choice.chosen:
        errors.spread |= cause_counts(errors.chosen, found) | run_counts(problem, choice)
    result.after['cv_spread'] = errors.spread
    result.cv_contiguous, result.cautions = errors.stretches, errors.cautions
    result.expected = expected_error(errors.left_out, choice.fit.weights > 0.0,
                                     problem.sequence.order, rng,
                                     *ahead(problem, choice.chosen, rng))
    if not problem.sequence.timed:
        result.expected['within'] = 'ten rows'
    mark_undecided(result, [readable(c.effect(problem).name) for c in
                            choice.dropped_by_cv + choice.not_repeated],
                   result.ranking[0]['delta_bic'] if result.ranking else 0.0)


def mark_undecided(result, dropped, delta_bic):
    """Take back a verdict of ``none`` that the observations cannot support, in place.

    Parameters
    ----------
    result : Diagnosis
        With its cross-validated RMS.
    dropped : list of str
        Names of what was beyond chance and given up on rows or runs left out.
    delta_bic : float
        Of the best candidate on what the base leaves: from n ln 2 on it takes away half of the
        variance of an axis.
    """
    cv, floor = result.before['cv_rms_arcsec'], result.noise_floor_arcsec
    if result.verdict != 'none' or cv is None:
        return
    limit = (_FAILS if dropped else _FAILS_ALONE) * _expected_ratio(
        result.before['rms_arcsec'], floor)
    most = bool(dropped) and delta_bic > len(result.observations) * np.log(2.0)
    if cv <= limit * floor and not most:
        return
    result.verdict = 'undecided'
    several = len(np.unique(result.observations.label)) > 1
    result.cautions = [Finding(
        'undecided', cv, causes=tuple(dropped), before=floor,
        todo='another session' if several else 'more stars',
        evidence={'misses': bool(cv > limit * floor)})]


def _expected_ratio(left, floor):
    """What cross-validation adds to the noise of a fit that leaves `left` of it, generously."""
    return float(np.sqrt(1.0 + 4.0 * ((floor / left)**2 - 1.0))) if left > 0.0 else 1.0
