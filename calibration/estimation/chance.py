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

"""Significance of a candidate's score: sign flips of leverage-corrected residual pairs."""

from copy import copy
from functools import cached_property

import numpy as np

from .candidate_scores import best_of
from .choice_likelihood import ChoiceLikelihood
from .memory_test import SIMULATIONS, MemoryMask, MemoryTest
from .reduced_squares import times_rows

#: prior rows that shrink a group's variance toward that of its axis: for a group on 100 rows its
#: own variance has half the weight. The false-alarm rate hardly depends on it (noise as 1/sin^2 E,
#: alpha 0.05, false alarms of 60 nights with 1, 100, 1e6: 30 stars 1, 3, 1; 200 stars 4, 5, 4).
PRIOR = 100.0
#: sign flips for each p: at p = 0.01, 1999 flips have a counting error of 0.002
FLIPS = 1999
#: flips inside a fold, where a p is only compared with alpha
NESTED_FLIPS = 499
#: up to 4 times as many flips are drawn while p is within 2 counting errors of alpha: otherwise the
#: seed decides (second effect of a run of 39 rows: named with 5 of 20 seeds, now with none)
_LONGEST, _NEAR = 4, 2.0
#: a score this many standard deviations above the largest of the first flips needs no further flips
_FAR = 2.5
#: with more groups than this, a score is first tested among every tenth of them
_MANY, _THINNED = 400, 10


def pair_corrected(basis, residual, beside=None):
    """Leverage-corrected residuals: (I - H)^(-1/2) of each row's 2 x 2 block.

    Parameters
    ----------
    basis : Basis
        Orthonormal basis of the fitted columns.
    residual : ndarray, shape (2n,)
    beside : ndarray, shape (j, 2n), optional
        Further fitted directions, orthonormal.

    Returns
    -------
    ndarray, shape (2, n)
    """
    n = len(residual) // 2
    a, c, off = basis.blocks_of_rows(beside)
    a, c, off = np.clip(1.0 - a, 1e-3, 1.0), np.clip(1.0 - c, 1e-3, 1.0), -off
    off = np.sign(off) * np.minimum(np.abs(off), 0.999 * np.sqrt(a * c))
    # square root of [[a, off], [off, c]] is (M + s I) / t; invert that
    s = np.sqrt(a * c - off * off)
    t = np.sqrt(a + c + 2.0 * s)
    ma, mc, mo = (a + s) / t, (c + s) / t, off / t
    det = ma * mc - mo * mo
    rx, ry = residual[:n], residual[n:]
    return np.array([(mc * rx - mo * ry) / det, (ma * ry - mo * rx) / det])


def normal_score(gain, dof, nu):
    """Normal deviate equivalent to gain / dof ~ F(dof, nu) (Paulson), comparable across groups."""
    a, b = 2.0 / (9.0 * dof), 2.0 / (9.0 * nu)
    root = np.cbrt(gain / dof)
    return ((1.0 - b) * root - (1.0 - a)) / np.sqrt(a + b * root * root)


def _gain_of(z, dof, nu):
    """Inverse of `normal_score`: the gain with score `z`; infinite where no gain reaches it."""
    a, b = 2.0 / (9.0 * dof), 2.0 / (9.0 * nu)
    square = np.square(1.0 - b) - z * z * b
    root = (1.0 - a) * (1.0 - b) + z * np.sqrt(np.maximum(
        np.square(1.0 - b) * a + np.square(1.0 - a) * b - z * z * a * b, 0.0))
    with np.errstate(divide='ignore', over='ignore'):
        gain = dof * (root / square)**3
    return np.where(square > 0.0, gain, np.inf if z > 0.0 else -np.inf)


class ChanceTest:
    """Compare a group's score with the best score of all groups on sign-flipped residuals.

    The flipped residual is that of the model *with* the group, corrected for the leverage of all
    its columns, so that a strong effect does not hide itself. Scores are studentised with a
    variance for each group from that residual (the noise may be heteroscedastic), shrunk toward
    the common variance of the axis with `PRIOR` rows (a group on few rows would otherwise have
    an erratic variance).

    Parameters
    ----------
    fit : WeightedFit
        Fit without the group.
    scores : Scores
        Scores of the bank on that fit.
    group : int
        Group to test.
    among : sequence of int, optional
        Groups that are scored; by default all.
    """

    def __init__(self, fit, scores, group, among=None):
        n, r = fit.n, fit.residual
        tested = next(scores.bank.bases(fit, [group]))
        own = tested[1][0]
        own = own[np.einsum('ij,ij->i', own, own) > 0.5]
        e = pair_corrected(fit.basis, r - (own @ r) @ own, own)
        sigma = np.repeat(np.sqrt(np.mean(np.square(e), axis=1) + 1e-30), n)
        free = 1.0 - len(fit.basis) / (2.0 * n)
        self._found, self.all = [], np.full(len(scores.dof), -np.inf)
        alone = among is not None and len(among) == 1
        for groups, basis, dof in [tested] if alone else scores.bank.bases(fit, among):
            pairs = basis[:, :, :n] * e[0] + basis[:, :, n:] * e[1]
            scaled = basis * sigma
            v, common = times_rows(pairs, pairs), times_rows(scaled, scaled)
            energy = np.square(basis).reshape(len(basis), -1, n).sum(axis=1)
            rows = np.square(dof) / np.maximum(np.einsum('gi,gi->g', energy, energy), 1e-30) * free
            rows = np.maximum(rows, 0.5)
            share = (rows / (rows + PRIOR))[:, None, None]
            whiten = _inverse_root(share * v + (1.0 - share) * common)
            w = rows / (rows + PRIOR)
            # degrees of freedom of that variance, and how much fitting the group reduces it
            nu = 1.0 / (w * w / rows + (1.0 - w * w) / (n * free))
            shrink = w / rows + (1.0 - w) / (n * free)
            gain = np.square(np.einsum('gij,gj->gi', whiten, basis @ r)).sum(axis=1)
            ok = dof > 0
            self.all[groups[ok]] = normal_score(gain[ok], dof[ok], nu[ok])
            self._found.append([of[ok] for of in (pairs, whiten, dof, nu, shrink)])

        #: score of the group; `all`: of all groups (the variance is that left by this group)
        self.z = float(self.all[group])

    @cached_property
    def _parts(self):
        """For each number of columns: whitened pairs, dof, nu, shrink."""
        # single precision is enough for flips, and halves the time of the cube roots
        return [[of.astype(np.float32) for of in (whiten @ pairs, *others)]
                for pairs, whiten, *others in self._found]

    def flipped_max(self, signs):
        """Largest score of all groups for each flip.

        Parameters
        ----------
        signs : ndarray, shape (B, n)
            -1 and 1.

        Returns
        -------
        ndarray, shape (B,)
        """
        best = np.full(len(signs), -np.inf)
        for gain, (dof, nu, shrink) in self._gains(signs):
            best = np.maximum(best, normal_score(_unshrunk(gain, shrink), dof, nu).max(axis=1))
        return best

    def flipped_beyond(self, signs):
        """Number of flips that reach the group's own score, and the largest score of all flips.

        Like `flipped_max`, but without its slow cube root for each flip and group.
        """
        reached, largest = np.zeros(len(signs), bool), -np.inf
        for gain, (dof, nu, shrink) in self._gains(signs):
            least = np.clip(_gain_of(self.z, dof, nu), 0.0, 1e30)
            # the gain before the variance is corrected: the inverse of `_unshrunk`
            reached |= (gain >= np.where(least * shrink < 49.0, least / (1.0 + least * shrink),
                                         0.02 * least)).any(axis=1)
            largest = max(largest, normal_score(
                _unshrunk(gain.max(axis=0), shrink), dof, nu).max())
        return int(np.count_nonzero(reached)), float(largest)

    def _gains(self, signs):
        """Yield block by block of groups: gain of each flip (B, G); their dof, nu, shrink."""
        for pairs, *known in self._parts:  # (G_d, d, n)
            g, d, n = pairs.shape
            step = max(1, 4_000_000 // max(len(signs) * d, 1))
            for i in range(0, g, step):
                gain = np.square(signs @ pairs[i:i + step].transpose(1, 0, 2).reshape(-1, n).T)
                if d > 1:  # components outermost: summing adjacent ones takes five times as long
                    gain = gain.reshape(len(signs), d, -1).sum(axis=1)
                yield gain, [one[i:i + step] for one in known]


def _unshrunk(gain, shrink):
    """Gain corrected for the part of the flip's variance that the group itself explains."""
    return gain / np.maximum(1.0 - gain * shrink, 0.02)


class Chance:
    """Sign flips, drawn once and shared by all significance tests of a search.

    Parameters
    ----------
    n : int
        Number of rows.
    count : int
        Number of sign flips.
    rng : numpy.random.Generator
    whole : Chance, optional
        That of an earlier search of all rows, of which these are a part (or the same rows); its
        simulations are reused.
    group : ndarray of int, shape (n,), optional
        Rows of one group are flipped together: two measurements of a star within minutes share
        their error and are not independent.
    """

    def __init__(self, n, count, rng, whole=None, group=None):
        self._group = np.arange(n) if group is None else np.unique(group, return_inverse=True)[1]
        self._rng, self._n, self._count = rng.spawn(1)[0], n, count
        self._memory_tests, self._likelihood, self._whole = {}, None, whole
        self._simulated_for = None, []
        self._further = []  # further sets of `count` flips
        if whole is None:
            self.signs = self._drawn(rng)

    @property
    def least(self):
        """Smallest p that this number of flips can show."""
        return 1.0 / (self._count + 1)

    @property
    def of_part(self):
        """Whether the rows are only a part of the run (a fold)."""
        return self._whole is not None and self._whole._n != self._n

    @property
    def searched_before(self):
        """Whether an earlier search of these or all rows has simulated the null distributions."""
        return self._whole is not None

    def for_alternatives(self):
        """The same flips, for further searches of the same rows."""
        out = copy(self)
        out._memory_tests, out._likelihood, out._whole = {}, None, self
        return out

    @cached_property
    def signs(self):
        """Flips of each row, -1 and 1, shape (count, n)."""
        return self._drawn(self._rng)

    def _drawn(self, rng):
        groups = self._group.max(initial=-1) + 1
        signs = rng.integers(0, 2, (self._count, groups)).astype(np.float32)
        return signs[:, self._group] * 2.0 - 1.0

    @cached_property
    def _normal(self):
        return self._rng.standard_normal((SIMULATIONS, 2 * self._n))

    def p_beyond_memory(self, problem, chosen, bank, mask, g):
        """`MemoryTest.p` of a group among those of its share, with `chosen` in the model."""
        # a curve without a cause, or a change of an effect, is no better than correlated noise
        if bank is not problem.dictionary:
            return 1.0
        if self.of_part and problem.base.groups:
            return 1.0  # with terms for each run, all folds together would take minutes
        test = self._memory_test(problem, chosen, mask, bank.effects[g].share)
        return test.p(g) if test is not None else 1.0

    def beyond_memory(self, problem, chosen, bank, mask, without=()):
        """The group with the largest likelihood ratio over correlated noise, and its p.

        The p is family-wise over all groups of its share, so the best of them may be picked.

        Parameters
        ----------
        problem, chosen, bank
            See `p_beyond_memory`.
        mask : MemoryMask
        without : sequence of int
            Excluded groups.

        Returns
        -------
        group : int or None
        p : float
        """
        none = None, 1.0
        if bank is not problem.dictionary or self.of_part and problem.base.groups:
            return none
        found = []
        for share in bank.shares:
            test = self._memory_test(problem, chosen, mask, share)
            group, ratio = (None, 0.0) if test is None else test.best(without)
            if group is not None:
                found.append((group, ratio, test))
        if not found:
            return none
        group, _, test = max(found, key=lambda one: one[1])
        return group, test.p(group)

    def simulate(self, problem, chosen):
        """Store null distributions of largest scores, for folds and alternatives to reuse.

        By sign flips, and by simulated runs with the correlated noise estimated with `chosen` in
        the model. They depend on the groups and hardly on the rows.
        """
        known, of = self._simulated_for
        if known is problem and of == chosen:
            return
        self._simulated_for = problem, list(chosen)
        fit = problem.plain.fit(chosen)
        periods = [c for c in chosen if c.period]
        if periods:
            problem.periods.shortlist(
                problem.periods.score(problem.plain.fit([c for c in chosen if not c.period])),
                [c.group for c in periods])
        curves = [problem.curves] if any(c.curve for c in chosen) else []
        for bank in (problem.dictionary, *curves, *[problem.periods][:len(periods)]):
            scores = bank.score(fit)
            for share, groups in bank.shares.items():
                best, gain = best_of(scores, np.setdiff1d(np.arange(len(bank)), groups))
                if np.isfinite(gain):
                    bank.by_chance[share] = np.sort(
                        ChanceTest(fit, scores, best, groups).flipped_max(self.signs))
        if problem.sequence is None or problem.base.groups:
            return  # with terms for each run it takes minutes
        bank = problem.dictionary
        mask = MemoryMask(problem, chosen, bank, fit)
        shares = {c.effect(problem).share for c in chosen if c.plain}
        for share in shares | {'dictionary'}:
            if len(mask.covered(bank.shares.get(share, ()))):
                self._memory_test(problem, chosen, mask, share).by_chance  # noqa: B018

    def _memory_test(self, problem, chosen, mask, share):
        key, fit = (share, frozenset(chosen)), problem.plain.fit(chosen)
        known, test = self._memory_tests.get(key, (None, None))
        if known is not fit:  # an effect was refined since: its ratios have changed
            normal = self._simulated(*key)
            if normal is None:
                return None
            chosen = list(chosen)
            test = MemoryTest(problem, mask, share, normal,
                              lambda: self._choice_likelihood(problem, chosen))
            self._memory_tests[key] = fit, test
        return test

    def _choice_likelihood(self, problem, chosen):
        """The likelihoods beside `chosen`; only the last are kept, for a search moves on."""
        if self._likelihood is None or self._likelihood.plain is not problem.plain.fit(chosen):
            self._likelihood = ChoiceLikelihood(problem, chosen)
        return self._likelihood

    def _simulated(self, share, key):
        """Normal deviates to simulate runs with, or the ratios known for the most similar choice.

        None in a fold for a share other than the dictionary's, where nothing is known from the
        whole run: it would take too long.
        """
        known = {chosen: test.by_chance for (of, chosen), (_, test) in (
            self._whole or self)._memory_tests.items() if of == share and test.has_simulated}
        if not known:
            return None if self.of_part and share != 'dictionary' else self._normal
        # the null distribution of the largest ratio hardly depends on the model
        return known[max(known, key=lambda chosen: len(chosen & key) - len(chosen ^ key))]

    def p(self, fit, scores, group, alpha=None):
        """Family-wise p of a group: fraction of flips whose best score reaches its own.

        The family is all groups with the same share of the family-wise error.

        Parameters
        ----------
        fit : WeightedFit
            Fit without the group.
        scores : Scores
        group : int
        alpha : float, optional
            Stop once p is certain to be above.
        """
        # a search returns to earlier fits
        key = self, scores.bank, group, float(scores.delta_bic[group]), alpha
        if key not in fit.known:
            fit.known[key] = self._p(fit, scores, group, alpha)
        return fit.known[key]

    def _p(self, fit, scores, group, alpha):
        bank = scores.bank
        by_chance = bank.by_chance.get(bank.effects[group].share)
        if self.searched_before and by_chance is not None:
            return _share(by_chance, ChanceTest(fit, scores, group, [group]).z)
        every = bank.same_share(group)
        if alpha is not None and len(every) > _MANY:  # some groups may already give p > alpha
            some = np.union1d(every[::_THINNED], [group])
            share = self._share_of_flips(ChanceTest(fit, scores, group, some), alpha)
            if share > alpha:
                return share
        return self._share_of_flips(ChanceTest(fit, scores, group, every), alpha)

    def _share_of_flips(self, test, alpha):
        """Fraction of flips whose best score reaches the tested one; `alpha` as in `p`."""
        count, hits, drawn = len(self.signs), 0, 0
        limit = count if alpha is None else int(np.ceil(alpha * (count + 1)))
        near = 0.0 if self.searched_before else _NEAR
        for signs in self._blocks():
            reached, largest = test.flipped_beyond(signs)
            hits, drawn = hits + reached, drawn + len(signs)
            if drawn < count:
                if hits > limit + near * limit**0.5:
                    return max((hits + 1) / (drawn + 1), 1.0001 * alpha)
                if test.z > largest + _FAR:  # no flip will come near
                    drawn = count
                    break
            elif alpha is None or abs(hits - alpha * drawn) >= near * (alpha * drawn)**0.5:
                break
        return (hits + 1) / (drawn + 1)

    def _blocks(self):
        """Yield the flips in growing blocks, then further sets of the same number."""
        count, start = len(self.signs), 0
        for stop in (*(n for n in (50, 200, 600, 1200) if n < count), count):
            yield self.signs[start:stop]
            start = stop
        for k in range(_LONGEST - 1):
            if k == len(self._further):
                self._further.append(self._drawn(self._rng.spawn(1)[0]))
            yield self._further[k]

    def p_of_all(self, fit, scores):
        """Family-wise p of every group, from the residual after the best group of its share.

        Returns
        -------
        ndarray, shape (G,)
        """
        out = np.ones(len(scores.dof))
        for groups in scores.bank.shares.values():
            best = groups[int(np.argmax(scores.delta_bic[groups]))]
            if np.isfinite(scores.delta_bic[best]):
                test = ChanceTest(fit, scores, best, groups)
                out[groups] = _share(np.sort(test.flipped_max(self.signs)), test.all[groups])
        return out


def _share(by_chance, z):
    """Family-wise p of scores `z`, from the null distribution of the largest score, ascending."""
    hits = len(by_chance) - np.searchsorted(by_chance, z, side='left')
    return (hits + 1.0) / (len(by_chance) + 1.0)


def _inverse_root(v):
    """V^(-1/2) of a stack of symmetric matrices, without directions of (nearly) zero eigenvalue."""
    if v.shape[-1] == 1:
        return np.where(v > 1e-9, 1.0 / np.sqrt(np.maximum(v, 1e-9)), 0.0)
    values, vectors = np.linalg.eigh(v)
    keep = values > 1e-6 * np.maximum(values[:, -1:], 1e-6)
    factor = np.where(keep, 1.0 / np.sqrt(np.where(keep, values, 1.0)), 0.0)
    return (vectors * factor[:, None, :]) @ vectors.transpose(0, 2, 1)
