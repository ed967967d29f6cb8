"""What of an amended model is published: what holds before rows that nothing has seen."""

from dataclasses import dataclass, replace
from typing import NamedTuple

from pointing_model.model import PointingModel
from pointing_model.zero import Zeros
from pointing_model.zero_drift import KEY as FOLLOWS
from pointing_model.zero_drift import Following

from .analysis.refit import refitted
from .estimation.comparison import FEWEST
from .report.fit_wording import comparison_sentence

UNJUDGED = (f'not judged before it was published: fewer than {FEWEST} rows to judge by, and too '
            'few to leave some out')


class Candidate(NamedTuple):
    """A model, the zeros that go with it, and which of these follow the absolute encoder."""

    model: PointingModel
    zeros: Zeros
    follows: Following = Following()

    def published(self, **provenance):
        """The model with all that whoever points with it must know."""
        follows = {FOLLOWS: self.follows.document()} if self.follows else {}
        return replace(self.model, provenance={
            **self.model.provenance, **provenance, 'zeros_in_force': self.in_force, **follows})

    @property
    def names(self):
        """Of its effects."""
        return [e.effect.name for e in self.model.effects]

    @property
    def axes(self):
        """On which its effects act, of ``az`` and ``el``."""
        acting = {e.effect.axes for e in self.model.effects}
        return tuple(axis for axis in ('az', 'el') if acting & {axis, 'both'})

    @property
    def in_force(self):
        """The zeros as a document has them."""
        return Zeros(self.zeros[number] for number in sorted(self.zeros)).to_list()

    def says_as(self, other):
        """Whether both predict the same."""
        series = self.model.harmonics
        return (self.model.terms == other.model.terms and self.in_force == other.in_force
                and (series.says_as(other.model.harmonics) if series is not None
                     else other.model.harmonics is None)
                and self.follows.document() == other.follows.document()
                and [e.document() for e in self.model.effects]
                == [e.document() for e in other.model.effects])


@dataclass
class Published:
    """What a calibration has published last, and what that replaced.

    Attributes
    ----------
    now, before : Candidate or None
        `before` is None where nothing was replaced, or it came back.
    since : int
        How many rows were known then, of those that are still there.
    """

    now: Candidate | None = None
    before: Candidate | None = None
    since: int = 0

    def replace(self, candidate, since):
        """`candidate` is in force; what was before it can come back unless it is the same."""
        same = self.now is not None and candidate.says_as(self.now)
        self.before = None if same else self.now
        self.now, self.since = candidate, since

    def take_back(self):
        """What was replaced is in force again."""
        self.now, self.before = self.before, None


def publishable(base, whole, strength, stars, zeros, court):
    """The amended model, or as much of it as holds.

    Where the whole does not hold, it is tried without the effects of the axis that it makes
    worse, then without one of them, the weakest first, then without several.

    Parameters
    ----------
    base, whole : Candidate
        The model in force, and the amended one.
    strength : dict of str to float
        How well each effect of `whole` is founded.
    stars : PointingRun
        To which parts of it are fitted again, `zeros` taken off, corrected for what the zeros
        follow.
    zeros : Zeros
    court : callable
        ``court(candidate)`` gives a Judgement against `base`, or None.

    Returns
    -------
    chosen : Candidate
        `base` where nothing holds.
    judged : Judgement or None
        Of `chosen`; of `whole` where nothing holds; None where there was nothing to judge by.
    refused : list of dict
        ``effects`` (their names), ``why`` (a sentence) and ``judgement``.
    """
    judged = court(whole)
    if judged is None or judged.holds:
        return whole, judged, []
    for out in _left_out(whole, judged, strength):
        part = _part(whole, out, stars, zeros)
        verdict = court(part)
        if verdict.holds:
            return part, verdict, [_refusal(out, judged)]
    return base, judged, [_refusal(whole.names, judged)]


def _left_out(whole, judged, strength):
    """Sets of names to try without, some effects being left each time."""
    names = sorted(dict.fromkeys(whole.names), key=lambda name: strength.get(name, 0.0))
    tried = []
    for axis in judged.worse:
        acting = {e.effect.name for e in whole.model.effects if e.effect.axes in (axis, 'both')}
        tried.append([name for name in names if name in acting])
    tried += [[name] for name in names]
    tried += [names[:k] for k in range(2, len(names))]
    seen = []
    for out in tried:
        if 0 < len(out) < len(names) and out not in seen:
            seen.append(out)
    return seen


def _part(whole, out, stars, zeros):
    model, shifts = refitted(
        whole.model, stars, [e for e in whole.model.effects if e.effect.name not in out])
    own = zeros.carried(sorted({*zeros, *map(int, shifts), *map(int, stars['run'])}))
    for run, shift in shifts.items():
        own[run] = own[run].plus(*shift)
    return Candidate(model, own, whole.follows)


def _refusal(names, judged):
    names = list(dict.fromkeys(names))
    return {'effects': names, 'why': f'{", ".join(names)}: {comparison_sentence(judged)}',
            'judgement': judged.to_dict()}

