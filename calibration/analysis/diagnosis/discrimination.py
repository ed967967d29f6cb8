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

"""Discrimination between causes that explain a run equally well, by requested stars.

After a diagnosis with an ambiguous verdict, only its sets of possible causes are compared as stars
come in. Each cause is fitted with all terms to all rows, and excluded if it is `SEPARATE` behind
the best. The best next star is requested until one cause is left, or no possible star is likely to
decide. The result depends on the diagnosis and the rows only, not on the sequence of requests.
"""

from dataclasses import dataclass, field

import numpy as np

from calibration.estimation.candidate_scores import CandidateGroup
from calibration.estimation.equal_causes import SET_WIDTH, overlap
from calibration.estimation.false_alarms import ALPHA
from calibration.estimation.linear_model import DISTINCT, weighted_fit
from calibration.estimation.memory_test import MemoryMask
from calibration.estimation.selection_problem import SelectionProblem
from pointing_model.calibration_messages import ASKS, CANNOT, ONE_CAUSE
from pointing_model.effects import smooths

from ..finding import Finding
from .alternatives import likelihood_ratio
from .discriminating_star import ENOUGH, LEAST_CHANCE, SEPARATE, Pair, Points, drivers_of, needed
from .observations import observations
from .offered_effects import effect_bank
from .run_problem import RunProblem

#: largest number of requested stars
MOST_STARS = 15
_MOST_PAIRS = 6  # largest number of pairs for which a star is chosen
_NEWCOMERS = 4  # largest number of candidates added to a set


@dataclass
class CauseSet:
    """One set of possible causes: the best one, and the state of the others.

    Attributes
    ----------
    best : str
    out : dict of str to float
        Excluded causes, and their distance from the best in 2 ln(likelihood ratio).
    open, stays : dict of str to float
        Causes that may still be separated from the best, and those that no star here is likely to
        separate.
    same : list of str
        Members of `stays` with the same mechanism as the best, which are no other cause.
    needed : dict of str to Finding
        For the closest of `stays`, the observations that would separate them.
    """

    best: str
    out: dict = field(default_factory=dict)
    open: dict = field(default_factory=dict)
    stays: dict = field(default_factory=dict)
    same: list = field(default_factory=list)
    needed: dict = field(default_factory=dict)

    @property
    def state(self):
        """`ASKS`, `ONE_CAUSE` or `CANNOT`."""
        if self.open:
            return ASKS
        return CANNOT if set(self.stays) - set(self.same) else ONE_CAUSE

    def finding(self):
        """The state as a Finding."""
        causes = self.open or [name for name in self.stays if name not in self.same]
        kind = {ONE_CAUSE: 'one cause left', ASKS: 'causes open', CANNOT: 'causes alike here'}
        return Finding(kind[self.state], unit='', causes=(self.best, *causes), evidence={
            'behind': self.open, 'needed': self.needed})

    def to_dict(self):
        """Entry for JSON, with findings."""
        return {'state': self.state, 'best': self.best, 'out': self.out, 'open': self.open,
                'stays': self.stays, 'same': self.same, 'needed': self.needed,
                'says': self.finding()}


@dataclass
class CauseStanding:
    """State of the sets of causes with the rows so far, and what to observe next.

    Attributes
    ----------
    questions : list of CauseSet
    request : dict or None
        ``az_deg``, ``el_deg`` and so on, see `next_observations.propose`; ``magnitude`` (None:
        any), ``before`` (what to observe before it, a short move away, or None), ``separates``,
        ``differ_sigma`` (difference of the two causes there, in units of the noise of a star) and
        ``why``.
    """

    questions: list
    request: dict | None = None

    @property
    def state(self):
        """`ASKS` if any set needs stars; `CANNOT` if one is undecidable; else `ONE_CAUSE`."""
        states = {q.state for q in self.questions}
        return next((s for s in (ASKS, CANNOT) if s in states), ONE_CAUSE)

    def finding(self):
        """The states of all sets as a Finding."""
        return Finding('sets of causes', evidence={'sets': [q.finding() for q in self.questions]})

    def to_dict(self):
        """Entry for JSON, with findings."""
        return {'state': self.state, 'says': self.finding(), 'request': self.request,
                'sets': [q.to_dict() for q in self.questions]}


class Discrimination:
    """Discriminates between the possible causes in a diagnosis.

    Parameters
    ----------
    diagnosis : Diagnosis
        With the verdict ``ambiguous``.
    hours : float
        Longest wait for a star, h.
    elevations : (float, float), optional
        Elevation limits of the mount, rad; by default the range of the rows.
    least_chance : float
        Smallest probability that the remaining stars separate a pair, to request one.

    Raises
    ------
    ValueError
        The diagnosis leaves nothing open.
    """

    def __init__(self, diagnosis, hours=0.0, elevations=None,
                 least_chance=LEAST_CHANCE):
        self._base, self._alpha = diagnosis.base, ALPHA
        self._encoder, self._seen = diagnosis.observations.encoder, len(diagnosis.observations)
        self._hours, self._elevations, self._least = hours, elevations, least_chance
        found = [e for e in diagnosis.effects if e.fitted.effect.kind != 'known']
        self._effects = [e.fitted.effect for e in found]
        self._sets = {i: [e.fitted.effect.name, *e.other_causes] for i, e in enumerate(found)
                      if e.other_causes and e.fitted.effect.kind == 'effect'}
        self._beside = {i: e.beside for i, e in enumerate(found)}
        if not self._sets:
            raise ValueError('the diagnosis leaves no set of causes open: there is nothing to '
                             'distinguish')

    def compare(self, runs, most=MOST_STARS, ask=True):
        """Compare the causes of each set with all rows so far.

        Parameters
        ----------
        runs : PointingRun or sequence of PointingRun
            The rows of the diagnosis and those since.
        most : int
            Largest number of stars since the diagnosis.
        ask : bool
            Whether to request a star. If not, all causes that are not excluded count as open.

        Returns
        -------
        CauseStanding
        """
        obs = observations(runs, self._encoder)
        stars = max(most - (len(obs) - self._seen), 0)
        problem = RunProblem(obs, self._base, self._alpha, curves=False).problem
        bank = effect_bank([*problem.dictionary.effects, *smooths(obs.context)], obs.context)
        effects, matches = list(self._effects), {}
        for _ in range(2 if len(effects) > 1 else 1):  # again, with the best causes of the others
            for i in self._sets:
                others = [e for j, e in enumerate(effects) if j != i]
                matches[i] = _SetMatch(problem, obs, bank, others, self._sets[i],
                                    self._beside[i])
                effects[i] = matches[i].best
        questions, asked = [], None
        for match in matches.values():
            question, points = self._question(match, obs, stars, ask)
            questions.append(question)
            if points and asked is None:
                asked = self._request(*points, obs)
        return CauseStanding(questions, asked)

    def _question(self, match, obs, stars, ask):
        question = CauseSet(match.best.name)
        close = []
        for effect, behind in match.others:
            if behind >= SEPARATE:
                question.out[effect.name] = behind
            else:
                close.append((effect, behind))
        if not ask:
            question.open.update((e.name, behind) for e, behind in close)
            return question, None
        pairs = []
        points = Points(obs, drivers_of([match.best, *(e for e, _ in close)]), self._hours,
                        self._elevations)
        for effect, behind in close[:_MOST_PAIRS]:
            pair = match.pair(obs, self._base, effect, points, behind)
            if stars and pair.chance(stars) >= self._least:
                pairs.append(pair)
                question.open[effect.name] = behind
            else:
                question.stays[effect.name] = behind
                if effect.mechanism and effect.mechanism == match.best.mechanism:
                    question.same.append(effect.name)
        question.open.update((e.name, d) for e, d in close[_MOST_PAIRS:] if pairs)
        question.stays.update((e.name, d) for e, d in close[_MOST_PAIRS:] if not pairs)
        if question.state == CANNOT:
            for effect, behind in [one for one in close if one[0].name not in question.same][:3]:
                drivers = drivers_of([match.best, effect])

                def make(effect=effect, behind=behind, drivers=drivers, **options):
                    points = Points(obs, drivers, elevations=self._elevations, **options)
                    return match.pair(obs, self._base, effect, points, behind)
                question.needed[effect.name] = needed(make, MOST_STARS)
        return question, (pairs, points, stars, question) if pairs else None

    def _request(self, pairs, points, stars, question, obs):
        differ = [pair.differ() for pair in pairs]
        weight = np.array([np.exp(-0.5 * max(pair.behind, 0.0)) for pair in pairs])
        total = (weight / weight.sum()) @ differ
        free = ~points.taken(obs.context, range(self._seen, len(obs)))
        # wait no longer than needed for a decision to be likely
        for hours in np.unique(points.later):
            soon = points.later <= hours
            if hours == points.later.max() or max(p.chance(stars, soon) for p in pairs) >= ENOUGH:
                break
        if stars < 2:  # a short move takes two stars
            soon &= ~points.short
        free &= soon
        j = int(np.argmax(np.where(free if free.any() else soon, total, -1.0)))
        nearest = list(question.open)[0]
        row = points.request(j)
        row['separates'] = [question.best, nearest]
        row['differ_sigma'] = round(float(np.sqrt(differ[0][j])), 2)
        row['why'] = Finding('star to discriminate', row['differ_sigma'], unit='sigma',
                             causes=(question.best, nearest), evidence={
                                 'behind': float(pairs[0].behind), 'told': SEPARATE})
        return row


class _SetMatch:
    """The causes of one set fitted to all rows, with everything else in the model.

    A cause that was found together with other effects is fitted with these.

    Attributes
    ----------
    best : Effect
    others : list of (Effect, float)
        The other causes and their distance in 2 ln(likelihood ratio), closest first.
    """

    def __init__(self, problem, obs, bank, others, members, beside):
        self._problem, self._others, self._obs = problem, others, obs
        n = problem.n
        self._whole = SelectionProblem(
            problem.base.beside(*(e.columns(obs.context).reshape(-1, 2 * n) for e in others)),
            problem.b, problem.inverse_sigma, bank, problem.curves, problem.sequence)
        lines = [e.line for e in bank.effects]
        taken = {e.line for e in others}
        # keep the order: equals must not change places between processes
        ours = [line for line, e in zip(lines, bank.effects) if e.name in members]
        ours = [line for line in dict.fromkeys(ours) if line not in taken]
        plain = self._whole.plain

        def of(fit):
            scores = bank.score(fit)
            # the group with the largest gain in each line
            tops = {lines[g]: g for g in np.argsort(scores.delta_bic, kind='stable')}
            return scores, tops, max((tops[one] for one in ours),
                                     key=lambda g: round(scores.delta_bic[g], 6))

        fit = plain.fit([])
        for _ in range(2):  # use the weights of a fit with the best: without it rows look wrong
            weights = plain.fit([CandidateGroup(of(fit)[-1])]).weights
            fit = plain.fit([], weights)
        scores, tops, best = of(fit)
        self._fit = plain.fit([CandidateGroup(best)], weights)
        if MemoryMask(self._whole, [], bank, fit).covers(best):
            memory = self._whole.fit([CandidateGroup(best)], weights).memory
            scores, tops, best = of(self._whole.fit([], weights, memory=memory))
            self._fit = self._whole.fit([CandidateGroup(best)], weights)
        gains = scores.delta_bic
        close = [g for line, g in tops.items()
                 if line not in ours and line not in taken
                 and bank.effects[g].kind == 'effect' and gains[g] > gains[best] - SET_WIDTH]
        close = [g for g in sorted(close, key=lambda g: -gains[g])[:_NEWCOMERS]
                 if self._in_its_place(bank, scores, best, g)]
        members = [tops[line] for line in ours
                   if tops[line] != best and gains[tops[line]] > -np.inf]
        # small-sample correction of n ln(ratio): only the degrees of freedom determine the noise
        cost = (scores.dof + bank.scan_cost) * np.log(n)
        free = 1.0 - len(self._fit.basis) / (2.0 * n)
        behind = free * ((gains + cost)[best] - gains - cost) + cost - cost[best]
        self.best = bank.effects[best]
        ranked = [(bank.effects[g], float(behind[g])) for g in (*members, *close)]
        self._by_models(ranked, beside, free)
        self.others = sorted(((e, max(value, 0.0)) for e, value in ranked),
                             key=lambda one: one[1])

    def _by_models(self, ranked, beside, free):
        """Compare causes that need other effects by whole models; update the best."""
        problem, n = self._problem, self._problem.n

        def model(effects):
            design = problem.base.beside(*(e.columns(self._obs.context).reshape(-1, 2 * n)
                                          for e in effects))
            return design, weighted_fit(design, problem.b, problem.inverse_sigma)

        def scanned(effects):
            return sum(e.scanned for e in effects if e.scan is not None)

        first, lead = [*self._others, self.best], None
        for k, (e, value) in enumerate(ranked):
            if e.name in beside:
                second = [*beside[e.name], e]
                models = model(first), model(second)
                misfit, (size, other), _ = likelihood_ratio(problem.b, *zip(*models))
                more = other + scanned(second) - size - scanned(first)
                ranked[k] = e, min(value, float(free * misfit + more * np.log(n)))
                if ranked[k][1] < min(0.0, 0.0 if lead is None else ranked[lead][1]):
                    lead = k
        if lead is None:
            return
        e, ahead = ranked[lead]
        ranked[:] = [(other, value - ahead) for other, value in ranked if other is not e]
        ranked.append((self.best, -ahead))
        self.best, self._others = e, beside[e.name]
        self._fit = model([*self._others, e])[1]

    def _in_its_place(self, bank, scores, best, other):
        """Whether a candidate outside the set replaces the best rather than complements it."""
        if overlap(scores.basis(best), scores.basis(other))[1] <= DISTINCT:
            return False
        beside = bank.score(self._whole.plain.fit([CandidateGroup(other)]))
        return beside.delta_bic[best] < SET_WIDTH

    def pair(self, obs, base, other, points, behind):
        """`Pair` of the best and another cause."""
        return Pair(self._problem, obs, base, self._fit, (self.best, other), self._others,
                    points, behind)
