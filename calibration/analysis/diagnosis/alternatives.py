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

"""Alternatives to what was found: whole models, and what the choice left open.

What else is in the model was chosen with a found effect in, and makes up for what that one does
wrong. An alternative that takes up nearly the same loses with these, though with others beside it
it may explain the run as well, or better. So the search is done once more, from the alternative on
and without the effect, and whole models are compared. One that is within `SET_WIDTH` is one of the
causes of the effect. Another one may explain the rows as well alone, and lose only beside the other
effects: that is reported, and where it is often chosen instead with a part of the rows left out,
the cause is open.
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from calibration.estimation.backward_elimination import eliminate
from calibration.estimation.candidates import TIE, CandidateGroup
from calibration.estimation.correlated_noise import WhiteNoise
from calibration.estimation.equal_causes import SET_WIDTH
from calibration.estimation.linear_model import LIVE
from calibration.estimation.select import affordable, choose, search
from calibration.estimation.significance import significances

from .effect_causes import cause_entry

#: part of the signal of a found effect that an alternative must take up alone to be tried with
#: effects of its own (correlation 0.9): what it leaves to them is most of an effect of its own
NEAR = 0.8
#: part of the largest gain of a run below which the alternatives of an effect are not tried so
LARGE = 0.1
#: alternatives that are tried so in one run, at most: each is a search of its own
MOST_TRIED = 4
#: of the folds, from where what is chosen in place of an effect, and as good alone, leaves its
#: cause open
OFTEN = 0.1
#: BIC behind from where rows left out are not asked: what they take back beside an alternative was
#: worth little, and may have cost more than that
_FAR = 4.0 * SET_WIDTH
#: rows of a run that is asked alone, at least
_ALONE = 12
#: of the signal of an effect, that what stands in its place must take up alone
_MOST = 0.5


@dataclass
class AlternativeModel:
    """An effect of the dictionary in the place of a found one, with others of its own beside it.

    Attributes
    ----------
    one : CandidateGroup
    choice : ModelChoice
    behind : float
        BIC of its model less that of the found one's.
    """

    one: CandidateGroup
    choice: object
    behind: float


def repeated_choice(choice):
    """What repeats a choice with a part of the rows left out, called as `choose`.

    Alternatives are searched once: of a part only the one that took the place of a found effect is
    compared with that effect, each with all others chosen anew.

    Parameters
    ----------
    choice : ModelChoice
        Of all rows.
    """
    if not choice.replaced:
        return choose
    own, other = choice.replaced

    def either(problem, alpha, chance, partitions=()):
        found = choose(problem, alpha, chance, partitions)
        if own not in found.chosen or other in found.chosen:
            return found
        model = _tried(problem, found, found.chosen.index(own), other.group, (), alpha, chance,
                       partitions, -SET_WIDTH)
        better = model is not None and len(model.choice.chosen) <= len(found.chosen)
        return model.choice if better else found
    return either


def compare_alternatives(problem, choice, alpha, chance, partitions=(), replacing=True):
    """Try near alternatives of what was found in models of their own; the best model wins.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice
        Its significances are changed: an alternative whose model is as good is one of the equals.
    alpha, chance, partitions
        As of `choose`.
    replacing : bool
        Whether a model that is better by more than `SET_WIDTH`, with no more effects, is taken
        instead.

    Returns
    -------
    ModelChoice
    """
    left = MOST_TRIED
    for i in sorted(range(len(choice.chosen)), key=lambda i: -choice.significances[i].delta_bic):
        near = near_alternatives(problem, choice, i)[:left] if left else []
        left -= len(near)
        if near:  # chance is known from this choice, as it is of parts of the rows
            chance.simulate(problem, choice.chosen)
        tried = [model for g in near if (model := _tried(
            problem, choice, i, g, near, alpha, chance.for_alternatives(), partitions)) is not None]
        choice.significances[i].behind = {model.one.group: model.behind for model in tried}
        best = min(tried, key=lambda model: model.behind, default=None)
        if best is None:
            continue
        # what needs more effects for it is no better explanation: both are reported
        more = len(best.choice.chosen) > len(choice.chosen)
        if best.behind >= -SET_WIDTH or more or not replacing:
            _take_in(choice, i, tried)
            continue
        rest = [replace(model, behind=model.behind - best.behind)
                for model in tried if model is not best]
        own, dropped, choice = choice.chosen[i], choice.dropped_by_cv, best.choice
        choice.replaced = own, best.one
        choice.significances = significances(problem, choice, alpha, chance)
        choice.dropped_by_cv = list(dict.fromkeys(dropped + choice.dropped_by_cv))
        _take_in(choice, choice.chosen.index(best.one), rest)
        break
    return choice


def near_alternatives(problem, choice, i):
    """Candidates that alone take up nearly what a found effect does, and are not in its set.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice
    i : int
        Of what was found.

    Returns
    -------
    list of int
        Groups of the dictionary, of each cause as people are told it the one that fits best; the
        nearest first. None of an effect that is small beside the largest, and of one so small that
        an alternative so near would be in its set with any others beside it.
    """
    one, own = choice.chosen[i], choice.significances[i]
    if (not one.plain or one.changes(choice.chosen) or own.delta_bic * (1.0 - NEAR) < SET_WIDTH
            or own.delta_bic < LARGE * max(s.delta_bic for s in choice.significances)):
        return []
    bank = problem.dictionary
    taken = {bank.effects[k].cause_summary for k in (one.group, *own.equals)}
    taken |= {c.effect(problem).cause_summary for c in choice.chosen}
    shares = signal_shares(problem, choice, i)
    out = {}
    for g in np.argsort(-shares, kind='stable'):
        if shares[g] < NEAR:
            break
        cause = bank.effects[g].cause_summary
        # a shape is no cause: it explains all that has it
        if cause not in taken and np.isfinite(own.every[g]) and bank.effects[g].kind != 'smooth':
            out.setdefault(cause, int(g))
    return list(out.values())


def signal_shares(problem, choice, i):
    """Part of the signal of one of a choice, beyond the base, that each candidate explains."""
    noise, bank = choice.fit.noise, problem.dictionary
    own = choice.chosen[i].columns(problem)
    p, _ = problem.design([*choice.without(i), choice.chosen[i]]).solver(noise)(problem.b)
    alone = replace(choice.fit, basis=problem.base.basis(noise))
    signal = alone.basis.off(noise.whiten(p[-len(own):] @ own))
    out = np.zeros(len(bank))
    for groups, basis, _ in bank.bases(alone):
        out[groups] = np.square(basis @ signal).sum(axis=1) / (signal @ signal)
    return out


def _tried(problem, choice, i, g, near, alpha, chance, partitions, below=np.inf):
    """`AlternativeModel` to a found effect; None where it does not hold so, or is not `below` some
    BIC behind: what does not hold only adds to that.
    """
    bank, own, other = problem.dictionary, choice.chosen[i], CandidateGroup(g)
    # the found one and its other alternatives would only share the lead
    causes = {bank.effects[k].cause_summary for k in (own.group, *near) if k != g}
    # and a wave without a cause would take the place of any of them
    out = [*(CandidateGroup(k) for k, e in enumerate(bank.effects)
             if e.cause_summary in causes or e.kind == 'smooth'), *choice.dropped_by_cv]
    if other in out:
        return None
    model = search(problem, alpha, chance, out, first=(other,))
    for folds in ((), partitions) if partitions else ((),):  # rows left out take the longest
        if not bic_behind(problem, choice, model) < below:
            return None
        eliminate(problem, model, alpha, chance, folds, alone=True)
        if other not in model.chosen:
            return None
        distance = bic_behind(problem, choice, model)
        if distance >= _FAR:
            break
    return AlternativeModel(other, model, distance) if distance < below else None


def bic_behind(problem, first, second):
    """BIC of a second model less that of a first, if rows have no memory.

    Parameters
    ----------
    problem : SelectionProblem
    first, second : ModelChoice
        Rows count as much as the worse of both fits lets them.

    Returns
    -------
    float
    """
    plain = problem.plain
    misfit, (size, other), live = likelihood_ratio(
        problem.b, [problem.design(one.chosen) for one in (first, second)],
        [plain.fit(one.chosen, one.fit.weights) for one in (first, second)])
    scanned, others = (sum(float(c.bank(problem).scan_cost[c.group]) for c in one.chosen)
                       for one in (first, second))
    return misfit + (other + others - size - scanned) * float(np.log(live))


def likelihood_ratio(b, designs, fits):
    """2 ln(likelihood ratio) of a first model to a second, which need not be nested.

    Parameters
    ----------
    b : ndarray, shape (2n,)
    designs : sequence of Columns
        Of both.
    fits : sequence of WeightedFit
        Of them, without memory.

    Returns
    -------
    ratio : float
    sizes : list of int
        Columns of each that are not those of others.
    live : int
        Rows that count.
    """
    weights = np.minimum(*(fit.weights for fit in fits))
    kept = np.where(fits[0].weights > 0.0, fits[0].weights, 1.0)
    noise = WhiteNoise(fits[0].noise.root * np.tile(np.sqrt(weights / kept), 2))
    live = max(np.count_nonzero(weights > LIVE), 2)
    values = noise.whiten(b)
    bases = [design.basis(noise) for design in designs]
    left = [np.square(basis.off(values)).reshape(2, -1).sum(axis=1) + 1e-30 for basis in bases]
    return float(live * np.log(left[1] / left[0]).sum()), [len(basis) for basis in bases], live


def _take_in(choice, i, models):
    """Let alternatives whose models are as good be equals of one of a choice."""
    own = choice.significances[i]
    if not models:
        return
    own.every = own.every.copy()
    # what is better only with more effects stands beside it, no more
    more = [len(model.choice.chosen) - len(choice.chosen) for model in models]
    behind = [max(model.behind, 0.0) if n > 0 else model.behind for model, n in zip(models, more)]
    best = min(0.0, *behind)
    for model, n, distance in zip(models, more, behind):
        group = model.one.group
        own.every[group] = own.delta_bic - distance
        if distance - best < SET_WIDTH:
            own.equals.append(group)
            own.others[group] = [c for c in model.choice.chosen if c != model.one]
            if n > 0:
                own.larger[group] = n, max(-model.behind, 0.0)
    own.equals.sort(key=lambda k: -np.round(own.every[k] / TIE))


def alternatives(problem, choice, choices):
    """Alternatives to each found effect beside its equals, the most often chosen first.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice
    choices : list of list of Effect
        That were chosen where a part of the rows was left out.

    Returns
    -------
    list of list of (int, dict)
        Group of the dictionary, and an entry as of `DiagnosedEffect.causes`, its ``delta_bic`` with
        all else in the model; and ``behind`` (BIC, of the better of that and a model of its own),
        ``alone`` and ``found_alone`` (gains on what the base leaves), ``instead`` of ``folds`` (how
        often it was chosen and the effect was not) and ``open``.
    """
    if not any(c.plain for c in choice.chosen):
        return [[] for _ in choice.chosen]
    alone = problem.dictionary.score(problem.plain.fit([])).delta_bic
    lines = [{e.line for e in some} for some in choices]
    taken = {c.effect(problem).cause_summary for c in choice.chosen}
    return [_to_one(problem, choice, i, alone, lines, taken) if c.plain else []
            for i, c in enumerate(choice.chosen)]


def _to_one(problem, choice, i, alone, lines, taken):
    one, found, bank = choice.chosen[i], choice.significances[i], problem.dictionary
    own = bank.effects[one.group]
    taken = taken | {bank.effects[k].cause_summary for k in found.equals}
    limit, out = alone.max(initial=0.0) - SET_WIDTH, {}
    for g in np.flatnonzero(signal_shares(problem, choice, i) >= _MOST):
        e = bank.effects[g]
        if e.kind != 'effect' or e.cause_summary in taken or not np.isfinite(found.every[g]):
            continue
        if not min(alone[g], alone[one.group]) > max(limit, 0.0):
            continue
        instead = sum(e.line in some and own.line not in some for some in lines)
        behind = min(found.delta_bic - found.every[g], found.behind.get(int(g), np.inf))
        known = out.get(e.cause_summary)
        if known is None or found.every[g] > found.every[known[0]]:
            out[e.cause_summary] = int(g), {
                **cause_entry(e, float(found.every[g])), 'behind': float(behind),
                'alone': float(alone[g]), 'found_alone': float(alone[one.group]),
                'instead': instead, 'folds': len(lines),
                'open': bool(lines) and instead >= OFTEN * len(lines)}
    return sorted(out.values(), key=lambda one: (-one[1]['instead'], one[1]['behind']))


def cause_counts(choices, effects):
    """How often the effects that were found are chosen again, each by one of its causes.

    Parameters
    ----------
    choices : list of list of Effect
        Repeated without a part of the rows.
    effects : list of DiagnosedEffect

    Returns
    -------
    dict
        ``same_set``: how many choices are these and no other; ``chosen_set``: name of each effect
        and how many choices have it; ``others_set``: the same of effects that are none of the
        causes.
    """
    sets = {one.fitted.effect.name: ({one.fitted.effect.name, *one.alternatives}.union(
        *(cause['effects'] for cause in one.causes)), one.fitted.effect.line) for one in effects}

    def of(chosen):
        """Found effects that a choice has, and whether it has these and no other."""
        left, others = dict(sets), []
        for effect in chosen:
            mine = next((name for name, (names, line) in left.items()
                         if effect.name in names or effect.line == line), None)
            others += [effect.name] * (mine is None)
            left.pop(mine, None)
        return set(sets) - set(left), not left and not others, set(others)
    counted = [of(chosen) for chosen in choices]
    return {'same_set': sum(same for _, same, _ in counted),
            'chosen_set': {name: sum(name in found for found, _, _ in counted) for name in sets},
            'others_set': dict(Counter(name for *_, others in counted for name in sorted(others)
                                       ).most_common())}


def run_counts(problem, choice):
    """In how many runs (or sessions), each taken alone, one of the causes of each effect pays.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice

    Returns
    -------
    dict
        ``runs``: how many have rows enough; ``runs_set``: of each effect the number of these in
        which one of its causes gains by BIC, the other effects in the model. Empty where fewer than
        two have.
    """
    label, counts, runs = problem.sequence.run, [0] * len(choice.chosen), 0
    size = sum(len(one.columns(problem)) for one in choice.chosen)
    for run in np.unique(label):
        rows = np.flatnonzero(label == run)
        part = problem.rows(rows).plain
        if len(rows) < _ALONE or not affordable(part, part.fit([]), size):
            continue
        runs += 1
        for i, (one, stand) in enumerate(zip(choice.chosen, choice.significances)):
            others = choice.without(i)
            bank, group = one.family(part, choice.chosen)
            causes = np.unique([group, *stand.equals])
            gains = bank.score(part.fit(others), causes).delta_bic
            counts[i] += bool(gains[causes].max() > 0.0)
    return {'runs': runs, 'runs_set': {
        one.effect(problem).name: count for one, count in zip(choice.chosen, counts)}} \
        if runs > 1 else {}
