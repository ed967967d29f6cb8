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

"""Nested cross-validation: the selection of effects is repeated in each fold.

An effect dropped because it predicts held-out rows or runs worse is, as a rule, no effect of the
mount. If it carries most of the error, or if the declared model itself fails on held-out rows, the
runs are too few or too unequal for that conclusion: the other runs do not determine the effect.
Then the effect is significant but untestable with these observations, and the verdict is undecided.
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

#: smallest and largest number of random partitions over which the cross-validated RMS is averaged;
#: from `MANY` rows on, where one row more or less in a fold changes little, at least one
PARTITIONS, MOST_PARTITIONS, MANY = 2, 10, 250
#: partitions are added while the relative standard error of the mean exceeds `SPREAD`, or while the
#: gain of the effects is below `_CLEAR` standard errors (one partition: below `SPREAD` of the RMS)
SPREAD, _CLEAR = 0.03, 3.0
#: folds of at most this many rows are replaced by leave-one-out: that partition is unique, so the
#: RMS does not depend on the seed (with 38 stars it scattered by 0.2 of 3" between partitions)
_LEAST_ROWS = 4
_IN = ('radial', 'x', 'y')
#: relative RMS increase allowed in one axis while the radial RMS improves: between partitions the
#: RMS of the MMT's night differs by 0.4 %, that of the 8 m telescope by 3 %
_WORSE = 0.02
#: ... and the share of the improvement in squares that one axis may lose: an effect of one axis
#: gives its rows more weight in the terms shared by both, which affects the other axis
#: (a second flexure of 2.3": 2.74 to 1.43" on the sky, and 1.06 to 1.09" in azimuth)
_LOST = 0.1
#: ratio of cross-validated RMS to the noise floor, relative to the ratio expected from the degrees
#: of freedom (see `_expected_ratio`), above which the model fails: where effects were dropped, and
#: where none were. On 150 clean nights each of 12, 16, 30 and 60 stars it was at most 1.5, 1.4,
#: 1.1 and 1.0.
_FAILS, _FAILS_ALONE = 1.3, 1.6


@dataclass
class CrossValidation:
    """Cross-validated RMS, with effects re-selected in each fold.

    Attributes
    ----------
    before, after : dict
        ``radial``, ``x``, ``y``: arcsec, the mean over partitions.
    left_out : ndarray, shape (2, n)
        Cross-validated residuals: root mean square over partitions, radians.
    spread : dict or None
        ``partitions``; ``min_arcsec`` and ``max_arcsec`` of the radial RMS after; number of
        ``folds``, including contiguous ones, and in how many of them ``same_choice`` selected the
        same effects and ``no_choice`` none; counts of folds for each effect of the result
        (``chosen``) and for ``others``, most frequent first.
    cut : int or None
        Number of effects kept, if not all are.
    stretches : dict
        ``before``, ``after``: radial RMS with folds contiguous in time; ``before_x``, ...
    chosen : list of list of Effect
        Effects selected in each fold.
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
    """Cross-validated RMS, without effects and with effects re-selected in each fold.

    Parameters
    ----------
    run : RunProblem
    chosen : list of CandidateGroup
        Effects selected on all rows.
    remembers : bool
        Whether the fits model correlated noise.
    count : int
        Number of folds.
    alpha : float
    chance : Chance
        Of all rows.
    rng : numpy.random.Generator
    ways : int, optional
        Number of partitions. By default partitions are added until the mean is known to `SPREAD`
        and the gain is clear.
    progress : callable, optional
        See `diagnose`.
    chooser : callable
        Selects the effects in each fold, called as `choose`.
    jobs : int
        Number of folds run in parallel, see `forked`.

    Returns
    -------
    CrossValidation
    """
    problem, words = run.problem, run.obs.run.mount.names.axes
    fits = problem if remembers else problem.plain
    keep = problem.plain.fit(chosen, final=True).weights > 0.0
    if not chosen:  # no effects: before equals after
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
    """Random folds; leave-one-out where rows are few; whole runs from 4 runs on."""
    groups = len(np.unique(problem.sequence.group))
    if not leaves_runs(problem) and groups <= _LEAST_ROWS * count:
        count = groups
    return partitions_of(problem, count, rng)[0]


def _only(problem, folds):
    """Whether the partition is unique: each run, or each group of rows, is one fold."""
    of = problem.sequence
    runs = len(np.unique(of.run))
    return len(folds) == runs > 1 or len(folds) == len(np.unique(of.group))


def _repeated(problem, chosen, choices):
    """Counts for `CrossValidation.spread`: how often each effect and other ones were selected."""
    every = [[c.effect(problem) for c in some] for some in choices]
    own = {c.effect(problem).line: c.effect(problem).name for c in chosen}
    # dict.fromkeys keeps the order: that of a set of names differs between processes
    counts = Counter(line for some in every for line in dict.fromkeys(e.line for e in some))
    others = {e.line: e.name for some in every for e in some if e.line not in own}
    return {'folds': len(choices),
            'same_choice': sum({e.line for e in some} == set(own) for some in every),
            'no_choice': sum(not some for some in every),
            'chosen': {name: counts[line] for line, name in own.items()},
            'others': {others[line]: count for line, count in counts.most_common()
                       if line in others}}


def _first(squares, k):
    """Squares with the first `k` effects of each fold, or all where there are fewer."""
    return squares[min(k, len(squares) - 1)]


def _figure(before, squares, keep):
    """`CrossValidation` from squared residuals, each of shape (2, n), of several partitions."""
    after = [_rms(one, keep) for one in squares]
    radial = [one['radial'] for one in after]
    return CrossValidation(before, _mean(after), np.sqrt(np.mean(squares, axis=0)), {
        'partitions': len(after), 'min_arcsec': min(radial), 'max_arcsec': max(radial)})


def _by_runs(by_count, keep, chosen, words):
    """Result with whole runs held out: all effects, or the number that predicts them best."""
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
    """Result with random and contiguous folds: all effects, or the number that does no harm."""
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
    """Whether more partitions are needed: the RMS is imprecise or the gain is not clear."""
    before, after = np.array([(one['radial'], _rms(squares[-1], keep)['radial'])
                              for one, squares in parts]).T
    gain = abs(np.mean(before - after))
    if len(parts) == 1:
        return bool(gain < SPREAD * before[0])
    error, of_gain = (each.std(ddof=1) / np.sqrt(len(parts)) for each in (after, before - after))
    return bool(error > SPREAD * after.mean() or gain < _CLEAR * of_gain)


def _worse(what, before, after, surely, words=ALTAZ.names.axes):
    """Find where the radial RMS is worse, or an axis in `surely` without a matching radial gain.

    Parameters
    ----------
    what : str
        What was held out.
    before : sequence of dict
        RMS without effects, and with fewer effects than `after`.
    after : dict
    surely : set of str
        Result of `_surely`.
    words : sequence of str
        Names of the axes.

    Returns
    -------
    dict
        Arguments of a Finding: `what`, RMS before and after, and the axis; empty if nothing is
        worse.
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
    """Axes in which paired squared residuals, shape (2, n), grow by more than one standard error.

    With 40 rows an axis that an effect does not touch differs by 3 % by chance.
    """
    more = after - before
    scatter = more.std(axis=1, ddof=1) / np.sqrt(more.shape[1])
    return {axis for axis, worse in zip('xy', more.mean(axis=1) > scatter) if worse}


def _rms(squares, keep):
    """RMS, arcsec, of squared residuals, shape (2, n), rad^2."""
    x, y = (float(np.sqrt(np.mean(one[keep]))) / ARCSEC for one in squares)
    return {'radial': float(np.hypot(x, y)), 'x': x, 'y': y}


def _mean(entries):
    return {axis: float(np.mean([e[axis] for e in entries])) for axis in _IN}


def nested(problem, folds, alpha, rng, remembers=False, flips=NESTED_FLIPS, whole=None, done=None,
           chooser=choose, jobs=1):
    """Cross-validate as `cross_validate` does, repeating the whole selection in each fold.

    Parameters
    ----------
    problem : SelectionProblem
    folds : list of ndarray of int
    alpha : float
    rng : numpy.random.Generator
    remembers : bool
        See `cross_validated`.
    flips : int
    whole : Chance, optional
        Of all rows.
    done : callable, optional
        Called after each fold.
    chooser, jobs
        See `cross_validated`.

    Returns
    -------
    residual : ndarray, shape (k + 1, 2, n)
        Radians, with the first 0, 1, ... k effects of each fold, where k is the largest number
        selected in any fold; a fold with fewer uses all it has.
    choices : list of list of CandidateGroup
        Effects selected in each fold.
    """
    everything = np.arange(problem.n)

    def without(fold):
        # random numbers are drawn here, in order, so that the result does not depend on `jobs`
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
    """Store the cross-validated errors in a result.

    Parameters
    ----------
    result : Diagnosis
    found : list of DiagnosedEffect
        The effects of the choice in the result.
    run : RunProblem
    choice : ModelChoice
    errors : CrossValidation
    rng : numpy.random.Generator
    """
    problem = run.problem
    if not choice.chosen:  # no effect is left: before equals after
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
    """Change, in place, a verdict of ``none`` that the observations cannot support.

    Parameters
    ----------
    result : Diagnosis
        With its cross-validated RMS.
    dropped : list of str
        Names of the effects that were significant but dropped by cross-validation.
    delta_bic : float
        BIC gain of the best candidate on the residuals of the base. A gain of n ln 2 halves the
        variance of one axis.
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
    """Upper estimate of cross-validated RMS / `floor`, for a fit with RMS `left`."""
    return float(np.sqrt(1.0 + 4.0 * ((floor / left)**2 - 1.0))) if left > 0.0 else 1.0
