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

"""Alternatives to the effects found: comparison of whole models, and causes left open.

The other effects of a model were selected with the found effect in it, and compensate its errors.
A similar alternative therefore loses in that model, but may explain the run as well or better in a
model of its own. So the search is repeated, starting from the alternative and without the found
effect, and the whole models are compared. An alternative within `SET_WIDTH` is one of the possible
causes of the effect. Another may explain the rows as well when alone, and lose only in the presence
of the other effects: it is reported, and if it is often selected instead in the cross-validation
folds, the cause is open.
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from calibration.estimation.backward_elimination import eliminate
from calibration.estimation.candidate_scores import TIE, CandidateGroup
from calibration.estimation.correlated_noise import WhiteNoise
from calibration.estimation.equal_causes import SET_WIDTH
from calibration.estimation.linear_model import LIVE
from calibration.estimation.select import affordable, choose, search
from calibration.estimation.significance import significances

from .effect_causes import cause_entry

#: share of the signal of a found effect that an alternative must explain alone (correlation 0.9)
#: to get a model of its own
NEAR = 0.8
#: alternatives of an effect with less than this share of the largest BIC gain get no such model
LARGE = 0.1
#: largest number of such models in one run: each needs a full search
MOST_TRIED = 4
#: share of the folds in which an equally good candidate is selected instead, from which the cause
#: of an effect is open
OFTEN = 0.1
#: BIC behind from which an alternative model is not cross-validated: the effects that this would
#: drop are worth little
_FAR = 4.0 * SET_WIDTH
#: fewest rows of a run that is tested alone
_ALONE = 12
#: share of the signal of an effect that a contender must explain alone
_MOST = 0.5


@dataclass
class AlternativeModel:
    """Model with an effect of the dictionary in place of a found one, other effects re-selected.

    Attributes
    ----------
    one : CandidateGroup
        The alternative effect.
    choice : ModelChoice
        Its model.
    behind : float
        BIC of this model minus BIC of the model found.
    """

    one: CandidateGroup
    choice: object
    behind: float


def repeated_choice(choice):
    """Return a function, called as `choose`, that repeats a selection in a cross-validation fold.

    Alternatives are searched on all rows only. In a fold, only the alternative that replaced a
    found effect is compared with that effect, each with all other effects re-selected.

    Parameters
    ----------
    choice : ModelChoice
        Selection on all rows.
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
    """Compare the model found with models of similar alternatives; the best model wins.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice
        Changed: an alternative whose model is as good is added to the equals of its significance.
    alpha, chance, partitions
        See `choose`.
    replacing : bool
        Whether a model that is better by more than `SET_WIDTH`, with no more effects, replaces
        the choice.

    Returns
    -------
    ModelChoice
    """
    left = MOST_TRIED
    for i in sorted(range(len(choice.chosen)), key=lambda i: -choice.significances[i].delta_bic):
        near = near_alternatives(problem, choice, i)[:left] if left else []
        left -= len(near)
        if near:  # simulate chance for this choice once, and reuse it for the alternatives
            chance.simulate(problem, choice.chosen)
        tried = [model for g in near if (model := _tried(
            problem, choice, i, g, near, alpha, chance.for_alternatives(), partitions)) is not None]
        choice.significances[i].behind = {model.one.group: model.behind for model in tried}
        best = min(tried, key=lambda model: model.behind, default=None)
        if best is None:
            continue
        # a model that needs more effects is no better explanation: both are reported
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
    """Candidates that alone explain nearly all of a found effect and are not among its equals.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice
    i : int
        Index of the found effect.

    Returns
    -------
    list of int
        Groups of the dictionary, the best one of each cause as worded for users; the most similar
        first. Empty for an effect much smaller than the largest, and for one so small that any
        such alternative would be within `SET_WIDTH`.
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
        # a smooth curve is no cause: it explains any effect of that shape
        if cause not in taken and np.isfinite(own.every[g]) and bank.effects[g].kind != 'smooth':
            out.setdefault(cause, int(g))
    return list(out.values())


def signal_shares(problem, choice, i):
    """Share of the signal of effect `i`, beyond the base, that each candidate explains."""
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
    """`AlternativeModel` for candidate `g` in place of effect `i`.

    None if `g` is eliminated, or if the model is not less than `below` behind in BIC: elimination
    can only increase that distance.
    """
    bank, own, other = problem.dictionary, choice.chosen[i], CandidateGroup(g)
    # exclude the found effect and its other alternatives: they would share the signal with `g`
    causes = {bank.effects[k].cause_summary for k in (own.group, *near) if k != g}
    # and smooth curves without a cause, which could replace any of them
    out = [*(CandidateGroup(k) for k, e in enumerate(bank.effects)
             if e.cause_summary in causes or e.kind == 'smooth'), *choice.dropped_by_cv]
    if other in out:
        return None
    model = search(problem, alpha, chance, out, first=(other,))
    for folds in ((), partitions) if partitions else ((),):  # the slow cross-validation last
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
    """BIC of a second model minus that of a first, with white noise.

    Parameters
    ----------
    problem : SelectionProblem
    first, second : ModelChoice
        Each row gets the smaller weight of the two fits.

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
        Columns of both models.
    fits : sequence of WeightedFit
        Fits of both models, with white noise.

    Returns
    -------
    ratio : float
    sizes : list of int
        Rank of each design.
    live : int
        Number of rows with weight.
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
    """Add alternatives whose models are as good to the equals of effect `i`."""
    own = choice.significances[i]
    if not models:
        return
    own.every = own.every.copy()
    # a model that is better only with more effects counts as equal, not as better
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
    """Contenders of each found effect that are not its equals, most often selected first.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice
    choices : list of list of Effect
        Effects selected in each cross-validation fold.

    Returns
    -------
    list of list of (int, dict)
        Group of the dictionary, and an entry like those of `DiagnosedEffect.causes`, its
        ``delta_bic`` with all other effects in the model. Further keys: ``behind`` (BIC, the
        smaller of that in this model and in a model of its own), ``alone`` and ``found_alone`` (BIC
        gains on the residuals of the base), ``instead`` of ``folds`` (how often it was selected and
        the effect was not) and ``open``.
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
    """Count how often each found effect, or one of its causes, is selected in the folds.

    Parameters
    ----------
    choices : list of list of Effect
        Effects selected in each cross-validation fold.
    effects : list of DiagnosedEffect

    Returns
    -------
    dict
        ``same_set``: number of folds with exactly these effects; ``chosen_set``: name of each
        effect and number of folds with it; ``others_set``: the same for effects that are none of
        the causes.
    """
    sets = {one.fitted.effect.name: ({one.fitted.effect.name, *one.alternatives}.union(
        *(cause['effects'] for cause in one.causes)), one.fitted.effect.line) for one in effects}

    def of(chosen):
        """Found effects in a selection, whether it has exactly these, and its other effects."""
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
    """Count the runs (or sessions) in which, alone, one of the causes of each effect gains by BIC.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice

    Returns
    -------
    dict
        ``runs``: number of runs with enough rows; ``runs_set``: for each effect, the number of
        these runs in which one of its causes gains by BIC with the other effects in the model.
        Empty if fewer than two runs have enough rows.
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
