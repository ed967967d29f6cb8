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

"""Causes of changes from night to night: temperature, trend, time of year, maintenance, steps.

Each candidate is a regressor in a model with a random walk, so that two drifting quantities are not
taken for cause and effect. Random walk and scatter are re-estimated with each candidate.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import comb, fdtrc

from ...estimation.kalman import jump_gains
from .season_kalman import fit_variation

#: threshold of the p-value below. With few nights this p-value is too small: with this threshold,
#: 1 of 100 seasons without a cause shows one (docs/season.md)
SEASON_ALPHA = 0.002
#: fewest nights on either side of an undeclared step, and of a declared one
_BESIDE, _BESIDE_DECLARED = 2, 1
#: number of most promising candidates that are fitted fully
_CLOSER = 4
#: largest number of causes: this many, or in a long season one for this many nights
_LEAST_MOST, _NIGHTS_A_CAUSE = 8, 4
#: largest number of steps of one term that are tested jointly
_DEEP = 6
#: variance of the random walk per night, relative to that of a night, from which it may hide steps
_HIDES = 0.01
#: a candidate replaces the best one only if its p-value is smaller by this factor: not by rounding
_BETTER = 0.99
#: smallest share of nights with a value of a cause
_ENOUGH = 0.8
#: largest scatter of a cause within a night, relative to the scatter of nightly means
_WITHIN = 2.0
_YEAR = 365.25


class Cause(NamedTuple):
    """A possible cause of changes in the terms.

    Attributes
    ----------
    kind : str
        ``column``, ``trend``, ``year``, ``declared`` or ``step``.
    text : str
        Description for users.
    terms : tuple of int
        Indices of the terms that it changes.
    shape : ndarray, shape (n, m)
        Regressors in each night; each term has one coefficient for each.
    unit : str
        Unit of a coefficient, after arcsec.
    tonight : callable
        Returns the regressors, shape (m,), of a future night, from days since the first night and
        the causes of that night.
    """

    kind: str
    text: str
    terms: tuple
    shape: np.ndarray
    unit: str
    tonight: object

    @property
    def first(self):
        """Index of the first night after a step."""
        return int(np.argmax(self.shape[:, 0]))

    def columns(self, k):
        """Columns for `NightlyTerms`, shape (n, k, c)."""
        n, m = self.shape.shape
        out = np.zeros((n, k, len(self.terms), m))
        for place, term in enumerate(self.terms):
            out[:, term, place] = self.shape
        return out.reshape(n, k, -1)

    def columns_of(self, day, values, k):
        """Columns for a future night, shape (k, c)."""
        return self._replace(shape=np.array([self.tonight(day, values)])).columns(k)[0]


class SeasonChoice(NamedTuple):
    """A cause found.

    Attributes
    ----------
    cause : Cause
    p : float
        P-value, corrected for the number of candidates.
    """

    cause: Cause
    p: float


def candidates(season, day, declared=()):
    """All possible causes in a season.

    Parameters
    ----------
    season : season_nights.Nights
    day : ndarray, shape (n,)
        Days since the first night.
    declared : sequence of (float, str)
        Maintenance: days since the first night, and what was done to the mount.

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
        # skip quantities that vary within a night, such as a rotator angle: the mean is meaningless
        if known.any() and name not in season.columns:
            known &= within <= _WITHIN * values[known].std()
        if known.mean() < _ENOUGH or np.ptp(values[known]) <= 0.0:
            continue
        middle = float(values[known].mean())
        shape = np.where(known, values - middle, 0.0)[:, None]

        def tonight(_, causes, name=name, middle=middle):
            return [causes.get(name, middle) - middle]
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
    # each step is a view into this array: separate columns would take nights x nights
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
    """Forward selection: add causes one at a time while they are significant.

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
        Fitted with them, by REML.
    """
    n, k = terms.values.shape
    found, candidates = [], list(candidates)
    variation, base = fit_variation(terms, restricted=False)
    # Bonferroni: each date of a step and each other candidate is one test
    while candidates and len(found) < max(_LEAST_MOST, n // _NIGHTS_A_CAUSE):
        best = None
        # in this order a declared step comes before the same undeclared one, and wins a tie
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
    """`NightlyTerms` with columns of more causes."""
    return terms.with_columns([cause.columns(terms.values.shape[1]) for cause in causes])


def _together(terms, found, candidates, variation, base, alpha):
    """Joint test of several steps of one term, which hide one another in the random walk.

    With only one step in the model the random walk still absorbs the others. So steps are added one
    at a time, each where it gains most, and tested jointly: by an F test with that many
    coefficients, times the number of ways to choose that many steps. Steps that are not significant
    given the others are dropped again.

    Parameters
    ----------
    terms : NightlyTerms
        With the columns of the causes found.
    found : list of SeasonChoice
    candidates : list of Cause
    variation : TermVariation
    base : float
        Log-likelihood.
    alpha : float

    Returns
    -------
    tuple or None
        Joint p-value, list of (Cause, its p-value given the others), `NightlyTerms` with them,
        their `TermVariation` and its log-likelihood.
    """
    (n, k), best = terms.values.shape, None
    # a term with hardly any random walk hides nothing
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
    """Largest number of coefficients found so far for any one of these terms."""
    return max(sum(entry.cause.shape.shape[1] for entry in found if term in entry.cause.terms)
               for term in terms)


def _each(terms, p, chosen, variation, held, ways, alpha):
    """Backward elimination of steps that are not significant given the others; see `_together`."""
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
    """P-value of a likelihood ratio by an F test, because nights are few.

    Parameters
    ----------
    ratio : float
        Twice the difference of the log-likelihoods.
    extra : int
        Number of coefficients added.
    n : int
        Number of nights.
    held : int
        Number of coefficients that the same terms have already.

    Returns
    -------
    float
    """
    rest = n - 1 - held - extra
    if rest < 1:
        return 1.0
    return float(fdtrc(extra, rest, np.expm1(max(ratio, 0.0) / n) * rest / extra))


def _step_gains(terms, variation):
    """Gain of a step of each term at each night with fixed variation, shape (n, k)."""
    return jump_gains(terms.forward(*np.square(variation)))


def _likely(terms, candidates, variation):
    """Indices of the most promising candidates, tested with fixed random walk and scatter."""
    n, k = terms.values.shape
    gains = _step_gains(terms, variation)
    chances = np.ones(len(candidates))
    rest = []  # candidates other than steps, of which there is one for each term and night
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
        if np.linalg.cond(passed.whitened[:, 1 + of]) > 1e6:  # collinear with existing columns
            continue
        gain = passed.log_likelihood(False, of) - base
        chances[number] = _chance(2.0 * gain, high - low, n)
    order = np.argsort(chances, kind='stable')[:_CLOSER]
    return [int(i) for i in order if chances[i] < 1.0]


def _alike(one, other):
    """Whether a candidate is the same cause as one already taken."""
    return bool(set(one.terms) & set(other.terms)) and one.kind == other.kind and (
        one.kind != 'column' and one.kind != 'step' or one.text == other.text)
