"""Judging on rows left out: cross-validation with the choice repeated, and runs held out.

A run held out is a new night of the same mount.
"""

from dataclasses import dataclass, field, replace
from pathlib import PurePath

import numpy as np

from pointing_model.fitted_effects import total
from pointing_model.terms import stacked_design

from .base import observations
from .constants import FEW_FOLDS, LONG, RUNS
from .linear import Columns, fit_state
from .resampling import (
    contiguous_folds,
    cross_validate,
    effective_runs,
    nested,
    radial_arcsec,
    random_folds,
    run_folds,
)

_NOT_REPEATED = ('More is beyond chance, but it does not hold from run to run, so it is not added '
                 '(the notes have the names): what the rows of one run share looks like an effect.')
_CAUTION = ('But where {} are left out, they are predicted worse than without any effect '
            '({:.2f}\u2033 to {:.2f}\u2033): what was found may hold for these observations alone. '
            'Judge it on another run (--holdout) before you use it there.')


def folds_of(work, count, rng):
    """Whole runs where 4 and more count, else rows at random; fewer folds where each is long."""
    if work.problem.n > LONG:
        count = min(count, FEW_FOLDS)
    if effective_runs(work.obs.label) >= RUNS:
        return run_folds(work.obs.label, min(count, len(work.obs.runs)), rng)
    return random_folds(work.problem.n, count, rng)


def _stretches(work, count):
    """Folds of neighbours in time (or in the order of the rows), who may share their error."""
    order = work.obs.context.get('time')
    return contiguous_folds(np.arange(work.problem.n) if order is None else order, count)


@dataclass
class Errors:
    """Cross-validated RMS, the choice repeated; `cut`: how many choices hold, where not all do."""

    before: float
    after: float
    cut: int | None = None
    stretches: dict = field(default_factory=dict)
    caution: str = ''


def cross_validated(work, found, parts, alpha, rng):
    problem = work.problem
    keep = problem.state(found.chosen, final=True).weights > 0.0

    def judged(folds):
        """RMS with no choice, and with the first 0, 1, ... of each fold."""
        left, _ = nested(problem, folds, alpha, rng)
        return (radial_arcsec(cross_validate(problem, [], folds), keep),
                [radial_arcsec(r, keep) for r in left])
    if not found.chosen:  # the model stays as it was
        before = radial_arcsec(cross_validate(problem, [], parts), keep)
        return Errors(before, before)
    before, counts = judged(parts)
    out = Errors(before, counts[-1])
    if effective_runs(work.obs.label) >= RUNS:
        if out.after > before:
            out.cut = min(int(np.argmin(counts)), len(found.chosen))
            out.after = counts[out.cut]
            out.caution = _NOT_REPEATED if out.cut < len(found.chosen) else ''
    else:
        apart, counts = judged(_stretches(work, len(parts)))
        out.stretches = {'before': apart, 'after': counts[-1]}
        if counts[-1] > apart:
            out.caution = _CAUTION.format('stretches of time', apart, counts[-1])
    if not out.caution and out.after > before:
        out.caution = _CAUTION.format('rows', before, out.after)
    return out


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
