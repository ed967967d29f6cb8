"""Cross-validation of a choice of effects, the choice repeated without the rows that are judged."""

from dataclasses import dataclass, field

import numpy as np

from .constants import FEW_FOLDS, LONG, RUNS
from .resampling import (
    contiguous_folds,
    cross_validate,
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
    """Whole runs from 4 runs on, else rows at random; fewer folds where each takes long."""
    if work.problem.n > LONG:
        count = min(count, FEW_FOLDS)
    if len(work.obs.runs) >= RUNS:
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
    if len(work.obs.runs) >= RUNS:
        if out.after > before:
            out.cut = min(int(np.argmin(counts)), len(found.chosen))
            out.after = counts[out.cut]
            out.caution = _NOT_REPEATED if out.cut < len(found.chosen) else ''
    elif not work.base.own:
        apart, counts = judged(_stretches(work, len(parts)))
        out.stretches = {'before': apart, 'after': counts[-1]}
        if counts[-1] > apart:
            out.caution = _CAUTION.format('stretches of time', apart, counts[-1])
    if not out.caution and out.after > before:
        out.caution = _CAUTION.format('rows', before, out.after)
    return out
