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

"""Which model may be published: one that is not worse on held-out rows."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pointing_model.model import PointingModel
from pointing_model.zero import Zeros
from pointing_model.zero_drift import KEY as FOLLOWS
from pointing_model.zero_drift import Following

from .analysis.refit import going_on, held_within, is_drift, left_out, refitted
from .estimation.comparison import FEWEST, compare_residuals
from .report.fit_wording import comparison_sentence
from .rows import is_kept_out, without_zeros

NOT_COMPARED = (f'not judged before it was published: fewer than {FEWEST} rows to judge by, and '
                'too few to leave some out')


class ModelWithZeros(NamedTuple):
    """A model, its zeros, and which of these follow the absolute encoder."""

    model: PointingModel
    zeros: Zeros
    follows: Following = Following()

    def published(self, **provenance):
        """The model with provenance that has all that is needed to point with it."""
        follows = {FOLLOWS: self.follows.document()} if self.follows else {}
        return replace(self.model, provenance={
            **self.model.provenance, **provenance, 'zeros_in_force': self.zeros_document,
            **follows})

    @property
    def effect_names(self):
        """Names of its effects."""
        return [e.effect.name for e in self.model.effects]

    @property
    def axes(self):
        """Axes on which its effects act, of ``az`` and ``el``."""
        acting = {e.effect.axes for e in self.model.effects}
        return tuple(axis for axis in ('az', 'el') if acting & {axis, 'both'})

    @property
    def zeros_document(self):
        """The zeros in the form of a document."""
        return Zeros(self.zeros[number] for number in sorted(self.zeros)).to_list()

    def residuals(self, rows, site=None):
        """Residuals of all rows of a night, without refitting, shape (2, n), rad."""
        seen = without_zeros(self.follows.corrected(rows), self.zeros, site)
        return np.array(self.model.residuals(seen))

    def predicts_as(self, other):
        """Whether both make the same predictions."""
        def predicted(one):
            series = one.model.harmonics
            return (one.model.terms, one.zeros_document, one.follows.document(),
                    [e.document() for e in one.model.effects], series and (
                        series.interpretation, series.coef_x.tolist(), series.coef_y.tolist()))
        return predicted(self) == predicted(other)


def carried_on(model, stars):
    """The model with its linear drifts in time extrapolated as far as the night supports.

    `diagnose` holds a driver constant soon after the last row, but tonight's stars come later. A
    linear drift is extrapolated for as long as it has improved the prediction of held-out stretches
    at the end of the night, and held from the last row on if it has not. A drift with the square of
    time would diverge, and is always held.
    """
    if 'time' not in stars or not any(map(is_drift, model.effects)):
        return model
    first, last = np.nanmin(stars['time']), np.nanmax(stars['time'])
    on = [share * (last - first) for share in going_on(model, stars)]
    return replace(model, effects=[
        held_within(e, first - more, last + more) if is_drift(e) else e
        for e, more in zip(model.effects, on)])


class BlindStars:
    """Stars held out from fits and selections, in order of time, to compare models.

    Parameters
    ----------
    rows : PointingRun
        All rows of the night.
    site : dict, optional
        ``latitude``, ``longitude``, rad.
    since : int
        Index of the first row used.
    """

    def __init__(self, rows, site=None, since=0):
        mask = is_kept_out(rows) & (rows['star'] >= 0) & (np.arange(len(rows)) >= since)
        order = np.argsort(rows['time'], kind='stable') if 'time' in rows else slice(None)
        self._rows, self._mask, self._site = rows.select(order), mask[order], site

    def __len__(self):
        return int(np.count_nonzero(self._mask))

    def residuals(self, candidate):
        """Their residuals from a `ModelWithZeros`, without refitting, shape (2, n), rad."""
        # computed with all rows, for a row may depend on the one before
        return candidate.residuals(self._rows, self._site)[:, self._mask]

    def compare(self, before, after, axes=()):
        """PairedComparison of two `ModelWithZeros`; None where there are too few stars."""
        if len(self) < FEWEST:
            return None
        return compare_residuals(self.residuals(before), self.residuals(after), axes)


class AmendmentComparison:
    """Compares a model with the active one on held-out rows.

    These are the blind stars if there are enough. Otherwise some rows of the night are held out,
    and fit and search are repeated without them.

    Parameters
    ----------
    blind : BlindStars
    stars : PointingRun
        The diagnosed stars.
    active : ModelWithZeros
    diagnose : callable
        ``diagnose(stars)`` repeats fit and search; returns a `Diagnosis`.
    """

    def __init__(self, blind, stars, active, diagnose):
        self._blind, self._stars, self._active = blind, stars, active
        self._diagnose, self._trial = diagnose, None

    def __call__(self, candidate):
        """PairedComparison with the active model; None where there are too few rows."""
        try:
            return self._blind.compare(self._active, candidate, candidate.axes) \
                or self._without(candidate)
        except ValueError:  # too few rows, blind or held out
            return None

    def _without(self, candidate):
        hidden = left_out(self._stars)
        if not hidden.any():
            return None
        seen = self._stars.select(~hidden)
        if self._trial is None:
            self._trial = self._diagnose(seen)
        # if no effect is found without these rows, refit all of them without these rows
        effects = [e for e in self._trial.model.effects
                   if e.effect.name in candidate.effect_names] or candidate.model.effects
        models = [refitted(self._trial.base_model, self._stars, own, ~hidden)[0]
                  for own in ((), effects)]
        models[1] = carried_on(models[1], seen)
        return compare_residuals(*(np.array(m.residuals(self._stars))[:, hidden] for m in models),
                                 candidate.axes)


def publishable(base, whole, strength, stars, zeros, comparison):
    """The amended model, or the part of it that is not worse than the active one.

    If the whole is worse, it is tried without the effects on the axis that it makes worse, then
    without one effect, the weakest first, then without several.

    Parameters
    ----------
    base, whole : ModelWithZeros
        The active model, and the amended one.
    strength : dict of str to float
        Gain in BIC of each effect of `whole`.
    stars : PointingRun
        Stars to refit parts of the model, with `zeros` subtracted and corrected for the zeros that
        follow the absolute encoder.
    zeros : Zeros
    comparison : callable
        ``comparison(candidate)`` gives a PairedComparison against `base`, or None.

    Returns
    -------
    chosen : ModelWithZeros
        `base` if every candidate is worse.
    compared : PairedComparison or None
        Comparison of `chosen`; of `whole` if every candidate is worse; None if there were too few
        rows to compare.
    refused : list of dict
        ``effects`` (their names), ``why`` (a sentence) and ``judgement``.
    """
    compared = comparison(whole)
    if compared is None or compared.holds:
        return whole, compared, []
    for out in _left_out(whole, compared, strength):
        part = _part(whole, out, stars, zeros)
        verdict = comparison(part)
        if verdict.holds:
            return part, verdict, [_refusal(out, compared)]
    return base, compared, [_refusal(whole.effect_names, compared)]


def _left_out(whole, compared, strength):
    """Sets of effect names to remove in turn; some effects always remain."""
    names = sorted(dict.fromkeys(whole.effect_names), key=lambda name: strength.get(name, 0.0))
    tried = []
    for axis in compared.worse:
        acting = {e.effect.name for e in whole.model.effects if e.effect.axes in (axis, 'both')}
        tried.append([name for name in names if name in acting])
    tried += [[name] for name in names]
    tried += [names[:k] for k in range(2, len(names))]
    return [out for out in dict.fromkeys(map(tuple, tried)) if 0 < len(out) < len(names)]


def _part(whole, out, stars, zeros):
    model, shifts = refitted(
        whole.model, stars, [e for e in whole.model.effects if e.effect.name not in out])
    own = zeros.carried(sorted({*zeros, *map(int, shifts), *map(int, stars['run'])}))
    for run, shift in shifts.items():
        own[run] = own[run].plus(*shift)
    return ModelWithZeros(model, own, whole.follows)


def _refusal(names, compared):
    names = list(dict.fromkeys(names))
    return {'effects': names, 'why': f'{", ".join(names)}: {comparison_sentence(compared)}',
            'judgement': compared.to_dict()}
