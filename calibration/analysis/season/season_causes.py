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

"""What moves the terms from night to night: temperature, time, the year, a date of maintenance.

Each candidate is a column beside a level that walks at random by itself, so that what drifts is not
called a cause because both drift; walk and scatter are estimated anew with it.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import comb, fdtrc

from ...estimation.kalman import jump_gains
from .season_kalman import fit_variation

#: threshold of the chance below, which is too small where nights are few: so 1 season of 100 that
#: has no cause shows one (docs/season.md)
SEASON_ALPHA = 0.002
#: nights on either side of a step that nobody has declared, and of one that somebody has
_BESIDE, _BESIDE_DECLARED = 2, 1
#: candidates that are looked at closely
_CLOSER = 4
#: most causes of a season: so many, and of a long one, one for so many nights
_LEAST_MOST, _NIGHTS_A_CAUSE = 8, 4
#: steps of one term that are looked at together, at most
_DEEP = 6
#: variance of the walk from night to night, of that of a night, from where it may hide steps
_HIDES = 0.01
#: of the chance of another candidate: more like it are as good, but for rounding
_BETTER = 0.99
#: part of the nights that must have a cause's value
_ENOUGH = 0.8
#: scatter of a cause within a night, of that of the means of nights, up to which its mean counts
_WITHIN = 2.0
_YEAR = 365.25


class Cause(NamedTuple):
    """What may move terms.

    Attributes
    ----------
    kind : str
        ``column``, ``trend``, ``year``, ``declared`` or ``step``.
    text : str
        For people.
    terms : tuple of int
        Numbers of the terms that it moves.
    shape : ndarray, shape (n, m)
        Of it at each night; each term has a coefficient for each.
    unit : str
        Of a coefficient, after arcsec.
    tonight : callable
        From days since the first night and the causes of that night to the (m,) of a night to come.
    """

    kind: str
    text: str
    terms: tuple
    shape: np.ndarray
    unit: str
    tonight: object

    @property
    def first(self):
        """Number of the first night of a step."""
        return int(np.argmax(self.shape[:, 0]))

    def columns(self, k):
        """As of `NightlyTerms`, shape (n, k, c)."""
        n, m = self.shape.shape
        out = np.zeros((n, k, len(self.terms), m))
        for place, term in enumerate(self.terms):
            out[:, term, place] = self.shape
        return out.reshape(n, k, -1)

    def columns_of(self, day, values, k):
        """The same of a night to come, shape (k, c)."""
        return self._replace(shape=np.array([self.tonight(day, values)])).columns(k)[0]


class SeasonChoice(NamedTuple):
    """A cause that was found.

    Attributes
    ----------
    cause : Cause
    p : float
        Chance that a season without it shows as much anywhere among the candidates.
    """

    cause: Cause
    p: float


def candidates(season, day, declared=()):
    """All that may move the terms of a season.

    Parameters
    ----------
    season : season_nights.Nights
    day : ndarray, shape (n,)
        Since the first night.
    declared : sequence of (float, str)
        Days since the first night on which something was done to the mount, and what.

    Returns
    -------
    list of Cause
    """
    k, n = len(season.names), len(day)
    every = [(term,) for term in range(k)]
    out = []
    for name in sorted({name for night in season.nights for name in night.causes}):
        values, within = np.array([night.causes.get(name, (np.nan, np.nan))
                                   for night in season.nights]).T
        known = np.isfinite(values)
        # what a night runs through, such as the angle of a rotator, has no mean that counts
        if known.any() and name not in season.columns:
            known &= within <= _WITHIN * values[known].std()
        if known.mean() < _ENOUGH or np.ptp(values[known]) <= 0.0:
            continue
        middle = float(values[known].mean())
        shape = np.where(known, values - middle, 0.0)[:, None]

        def tonight(_, causes, name=name, middle=middle):
            value = causes.get(name, np.nan)
            return [value - middle if np.isfinite(value) else 0.0]
        out += [Cause('column', name, terms, shape, f'per unit of {name}', tonight)
                for terms in every]
    half = float(day.mean())
    out += [Cause('trend', 'time', terms, (day[:, None] - half) / _YEAR, 'a year',
                  lambda at, _: [(at - half) / _YEAR]) for terms in every]
    if day[-1] - day[0] > 1.5 * _YEAR and n >= 12:
        def annual(at, _=None):
            return np.stack([np.cos(2.0 * np.pi * np.asarray(at) / _YEAR),
                             np.sin(2.0 * np.pi * np.asarray(at) / _YEAR)], axis=-1)
        out += [Cause('year', 'the time of the year', terms, annual(day), 'of cosine and sine',
                      annual) for terms in every]
    # each step is a part of it: one column for each would be nights x nights
    stair = np.repeat([0.0, 1.0], n)[:, None]

    def step(kind, text, terms, before, when):
        return Cause(kind, text, terms, stair[n - before:2 * n - before], 'at once',
                     lambda at, _: [float(at >= when)])
    for when, text in declared:
        before = int(np.searchsorted(day, when))
        if min(before, n - before) < _BESIDE_DECLARED:
            continue
        out += [step('declared', text, terms, before, when) for terms in (*every, tuple(range(k)))]
    for i in range(_BESIDE, n - _BESIDE + 1):
        if day[i] > day[i - 1]:
            out += [step('step', season.nights[i].source, terms, i, day[i]) for terms in every]
    return out


def choose_causes(terms, candidates, alpha=SEASON_ALPHA):
    """Add causes one after the other while each is beyond chance.

    Parameters
    ----------
    terms : NightlyTerms
        Without columns.
    candidates : list of Cause
    alpha : float

    Returns
    -------
    found : list of SeasonChoice
    variation : TermVariation
        With them, by REML.
    """
    n, k = terms.values.shape
    found, candidates = [], list(candidates)
    variation, base = fit_variation(terms, restricted=False)
    # a step by each of its dates, all else by itself: as many chances as were tried
    while candidates and len(found) < max(_LEAST_MOST, n // _NIGHTS_A_CAUSE):
        best = None
        # what was declared stands before the steps, and one at its date says the same
        for number in sorted(_likely(terms, candidates, variation)):
            cause = candidates[number]
            with_it = _with(terms, [cause])
            new, value = fit_variation(with_it, variation, restricted=False)
            p = _chance(2.0 * (value - base), cause.columns(k).shape[2], n,
                        _held(found, cause.terms)) * len(candidates)
            if best is None or p < _BETTER * best[0]:
                best = p, [(cause, p)], with_it, new, value
        if best is None or best[0] >= alpha:
            best = _together(terms, found, candidates, variation, base, alpha)
        if best is None or best[0] >= alpha:
            break
        _, more, terms, variation, base = best
        for cause, p in more:
            found.append(SeasonChoice(cause, min(p, 1.0)))
            candidates = [other for other in candidates
                      if other is not cause and not _alike(other, cause)]
    return found, fit_variation(terms, variation)[0]


def _with(terms, causes):
    """With columns of more causes."""
    return terms.with_columns([cause.columns(terms.values.shape[1]) for cause in causes])


def _together(terms, found, candidates, variation, base, alpha):
    """Steps of one term that hide one another: with one taken the walk still has the others.

    So they are taken one after the other, each where it gains most, and tested together: by F with
    as many coefficients, times the number of ways to choose as many. Those are kept each of which
    is beyond chance with the others there.

    Parameters
    ----------
    terms : NightlyTerms
        With the columns of what was found.
    found : list of SeasonChoice
    candidates : list of Cause
    variation : TermVariation
    base : float
        Log likelihood.
    alpha : float

    Returns
    -------
    tuple or None
        Chance of all, list of (Cause, chance of it beside the others), `NightlyTerms` with them,
        their `TermVariation` and its log likelihood.
    """
    (n, k), best = terms.values.shape, None
    # a term that hardly walks hides nothing
    walks = (variation.walk**2 * np.median(np.diff(terms.days))
             > _HIDES * variation.scatter**2)
    for term in np.flatnonzero(walks):
        steps = [cause for cause in candidates if cause.kind == 'step' and cause.terms == (term,)]
        taken = [entry.cause.first for entry in found
                 if entry.cause.kind == 'step' and term in entry.cause.terms]
        held = _held(found, (term,))
        chosen, now, here = [], terms, variation
        for count in range(1, _DEEP + 1):
            free = [cause for cause in steps if all(
                abs(cause.first - other) >= _BESIDE for other in taken)]
            if not free:
                break
            gains = _step_gains(now, here)[:, term]
            cause = max(free, key=lambda one: gains[one.first])
            chosen, now = [*chosen, cause], _with(now, [cause])
            taken = [*taken, cause.first]
            here, value = fit_variation(now, here, restricted=False, term=term)
            p = _chance(2.0 * (value - base), count, n, held) * k * float(
                comb(len(steps), count))
            if best is None or p < best[0]:
                best = p, chosen, here, held
    return None if best is None else _each(terms, *best, len(candidates), alpha)


def _held(found, terms):
    """Coefficients of what was found that move any of some terms; the most that one has."""
    return max(sum(entry.cause.shape.shape[1] for entry in found if term in entry.cause.terms)
               for term in terms)


def _each(terms, p, chosen, variation, held, ways, alpha):
    """As `_together` of steps, of those that are beyond chance each beside the others."""
    n = len(terms.days)
    while chosen and p < alpha:
        whole = _with(terms, chosen)
        variation, value = fit_variation(whole, variation, restricted=False)
        alone = [_chance(2.0 * (value - fit_variation(_with(terms, [
            other for other in chosen if other is not cause]), variation, restricted=False)[1]),
            1, n, held + len(chosen) - 1) * ways for cause in chosen]
        if max(alone) < alpha:
            return p, list(zip(chosen, alone)), whole, variation, value
        chosen = [cause for cause, own in zip(chosen, alone) if own < max(alone)]
    return None


def _chance(ratio, extra, n, held=0):
    """Of twice a difference of log likelihoods, by F: nights are few.

    Parameters
    ----------
    ratio : float
    extra : int
        Coefficients behind it.
    n : int
        Nights.
    held : int
        Coefficients that the same terms have already.

    Returns
    -------
    float
    """
    rest = n - 1 - held - extra
    if rest < 1:
        return 1.0
    return float(fdtrc(extra, rest, np.expm1(max(ratio, 0.0) / n) * rest / extra))


def _step_gains(terms, variation):
    """What a step of each term at each night gains while the variation stays, shape (n, k)."""
    return jump_gains(terms.forward(*np.square(variation)))


def _likely(terms, candidates, variation):
    """Numbers of the candidates that promise most while walk and scatter stay."""
    n, k = terms.values.shape
    gains = _step_gains(terms, variation)
    chances = np.ones(len(candidates))
    rest = []  # all but the steps, of which there is one for each term and night
    for number, cause in enumerate(candidates):
        if cause.kind == 'step':
            chances[number] = _chance(gains[cause.first, cause.terms[0]], 1, n)
        else:
            rest.append(number)
    columns = [candidates[number].columns(k) for number in rest]
    passed = terms.with_columns(columns).forward(*np.square(variation))
    first = k + terms.columns.shape[2]
    ends = first + np.cumsum([0, *(c.shape[2] for c in columns)])
    base = passed.log_likelihood(False, np.arange(first))
    for number, low, high in zip(rest, ends[:-1], ends[1:]):
        of = np.r_[0:first, low:high]
        if np.linalg.cond(passed.whitened[:, 1 + of]) > 1e6:  # the same as what is there
            continue
        gain = passed.log_likelihood(False, of) - base
        chances[number] = _chance(2.0 * gain, high - low, n)
    order = np.argsort(chances, kind='stable')[:_CLOSER]
    return [int(i) for i in order if chances[i] < 1.0]


def _alike(one, other):
    """Whether a candidate is no other cause than one that was taken."""
    return bool(set(one.terms) & set(other.terms)) and one.kind == other.kind and (
        one.kind != 'column' and one.kind != 'step' or one.text == other.text)
