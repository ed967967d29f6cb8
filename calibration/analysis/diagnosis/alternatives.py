"""What would stand in the place of a found effect and lost, though not by much or not always.

A rival within `SET_WIDTH` of an effect is one of its causes. Another one may explain the rows as
well alone, and lose only beside the other effects: that is said, and where it is often chosen
instead with a part of the rows left out, the cause is open.
"""

from dataclasses import dataclass, field

import numpy as np

from .alternative_choice import signal_shares
from .constants import SET_WIDTH
from .diagnosis_result import cause_entry

#: of the folds, from where what is chosen in place of an effect, and as good alone, leaves its
#: cause open
OFTEN = 0.1
#: of the signal of an effect, that what stands in its place must take up alone
_MOST = 0.5


@dataclass
class Contender:
    """Of one found effect.

    Attributes
    ----------
    group : int
        Of the dictionary.
    entry : dict
        As of `DiagnosedEffect.causes`, its ``delta_bic`` with all else in the model; and
        ``behind`` (BIC, of the better of that and a model of its own), ``alone`` and
        ``found_alone`` (gains on what the base leaves), ``instead`` of ``folds`` (how often it was
        chosen and the effect was not) and ``open``.
    """

    group: int
    entry: dict = field(default_factory=dict)


def contenders(problem, chosen, choices):
    """Of each found effect what contends with it, the most often chosen first.

    Parameters
    ----------
    problem : Problem
    chosen : Chosen
    choices : list of list of Effect
        That were chosen where a part of the rows was left out.

    Returns
    -------
    list of list of Contender
    """
    found, bank = chosen.found, problem.dictionary
    if not any(c.plain for c in found.chosen):
        return [[] for _ in found.chosen]
    alone = bank.score(problem.plain.state([]), gains_only=True).delta_bic
    lines = [{e.line for e in some} for some in choices]
    taken = {c.effect(problem).cause_told for c in found.chosen}
    return [_of_one(problem, chosen, i, alone, lines, taken) if c.plain else []
            for i, c in enumerate(found.chosen)]


def _of_one(problem, chosen, i, alone, lines, taken):
    choice, stand, bank = chosen.found.chosen[i], chosen.stands[i], problem.dictionary
    own = bank.effects[choice.group]
    taken = taken | {bank.effects[k].cause_told for k in stand.alternatives}
    limit, out = alone.max(initial=0.0) - SET_WIDTH, {}
    for g in np.flatnonzero(signal_shares(problem, chosen.found, i) >= _MOST):
        e = bank.effects[g]
        if e.kind != 'effect' or e.cause_told in taken or not np.isfinite(stand.every[g]):
            continue
        if not min(alone[g], alone[choice.group]) > max(limit, 0.0):
            continue
        instead = sum(e.line in some and own.line not in some for some in lines)
        open_ = bool(lines) and instead >= OFTEN * len(lines)
        behind = min(stand.delta_bic - stand.every[g], stand.tried.get(int(g), np.inf))
        one = Contender(int(g), {
            **cause_entry(e, float(stand.every[g])), 'behind': float(behind),
            'alone': float(alone[g]), 'found_alone': float(alone[choice.group]),
            'instead': instead, 'folds': len(lines), 'open': open_})
        known = out.get(e.cause_told)
        if known is None or stand.every[g] > stand.every[known.group]:
            out[e.cause_told] = one
    return sorted(out.values(), key=lambda one: (-one.entry['instead'], one.entry['behind']))
