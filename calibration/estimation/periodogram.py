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

"""Waves of unknown period: a periodogram of the residuals that refits all columns of the model.

A wave in an angle u has the columns f cos(r u) and f sin(r u); the factor f is the effect of a unit
wave in each row. The generalised Lomb-Scargle periodogram (Zechmeister and Kuerster 2009, A&A 496,
577) fits a mean together with them; here all columns of the model are refitted, from the same
products that score any candidate. Rates are a quarter of the resolution apart, so that at most 5 %
of the power is lost between two of them; a detected wave is then tuned to the best rate.

For a significant period the shape is selected: a sinusoid, one with harmonics, or a longer period
whose second or third harmonic was detected first.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np

from .candidate_scores import CandidateBank, Scores
from .equal_causes import SET_WIDTH
from .linear_model import LIVE

#: rates for each resolution element (1 / range of the driver)
OVERSAMPLED = 4
#: fewest waves over the range of the rows: fewer may be any smooth curve
_FEWEST_WAVES = 3.0
#: shapes of a wave: harmonic orders of the period
SHAPES = ((1,), (1, 2), (1, 2, 3))
#: multiples of the detected period that may be the true one
_LONGER = (1, 2, 3)
#: expected number of waves as large by chance from which a wave is rejected without sign flips
_PLAINLY_CHANCE = 0.03
#: waves tried in a part of the rows: the best of all rows, and so many neighbouring rates
_SHORTLIST, _BESIDE = 60, 2
_SHARE = 'periods'
#: part of a wave's energy that must remain beyond slower waves than are searched: with evenly
#: spaced rows some rates alias to these, and any amplitude of the wave would fit
_SEEN = 0.2
#: |mean of exp(i 2 pi angle / step)| above which rows are evenly spaced (within 6 % of a step, 1
#: sigma), and the rows used to find it
_EVEN, _STEPPED = 0.93, 200
#: part of its gain that a wave may lose between two rates: 5 % of the power of one that leaves a
#: hundredth of the variance
_UNTUNED = 0.5
#: size of the cache of wave columns, in numbers
_KEPT = 5_000_000


@dataclass(frozen=True, eq=False)
class WaveScan:
    """The waves of one driver.

    Attributes
    ----------
    angle : ndarray, shape (n,)
        The driver, radians; NaN where unknown.
    factor : ndarray, shape (2n,)
        Effect of a unit wave on each value.
    rates : ndarray, shape (F,)
        Ascending, waves per turn of the angle.
    effect : callable
        ``effect(rate, orders)``: the effect of a wave.
    """

    angle: np.ndarray
    factor: np.ndarray
    rates: np.ndarray
    effect: object

    @classmethod
    def over(cls, angle, factor, low, high, effect):
        """Scan of rates from `low` to `high`, spaced according to the range of the angle.

        At least `_FEWEST_WAVES` waves fit in that range; None where there is no such rate.
        """
        known = angle[np.isfinite(angle)]
        turns = float(np.ptp(known)) / (2.0 * np.pi) if len(known) else 0.0
        low = max(low, _FEWEST_WAVES / turns) if turns > 0.0 else np.inf
        if not low < high:
            return None
        count = int(np.ceil((high - low) * turns * OVERSAMPLED)) + 1
        return cls(np.asarray(angle, float), factor, np.linspace(low, high, count), effect)

    @property
    def step(self):
        """Spacing of the rates."""
        return float(self.rates[1] - self.rates[0]) if len(self.rates) > 1 else 0.0

    def rows(self, rows):
        """The scan of some rows (indices of n)."""
        n = len(self.angle)
        return WaveScan(self.angle[rows], self.factor[np.concatenate((rows, rows + n))],
                        self.rates, self.effect)

    def seen(self, rates):
        """Whether these rows can show waves of `rates` (k,) at any phase: a mask, shape (k,).

        With evenly spaced rows a wave may alias to one as slow as the terms of a mount, or of
        fewer waves over the rows than are searched.
        """
        n, length = len(self.angle), np.ptp(self.angle[np.isfinite(self.angle)])
        weight = np.hypot(self.factor[:n], self.factor[n:]) * np.isfinite(self.angle)
        angle = np.nan_to_num(self.angle)
        bends = np.arange(2.0 * _FEWEST_WAVES + 1.0) * np.pi / length
        if self.rates[0] > bends[-1] * (1.0 + 1e-9):
            bends = np.arange(2.0)  # no length limits the rates
        bends = np.multiply.outer(angle, bends)
        slow, size, _ = np.linalg.svd(
            weight[:, None] * np.hstack((np.cos(bends), np.sin(bends))), full_matrices=False)
        slow = slow[:, size > 1e-6 * max(size[0], 1e-300)]
        phase = np.multiply.outer(rates, angle)
        cosine, sine = weight * np.cos(phase), weight * np.sin(phase)
        cosine, sine = (wave - (wave @ slow) @ slow.T for wave in (cosine, sine))
        a, b, c = (np.einsum('ij,ij->i', *both) for both in (
            (cosine, cosine), (sine, sine), (cosine, sine)))
        least = 0.5 * (a + b - np.hypot(a - b, 2.0 * c))
        return least > _SEEN * 0.5 * (weight @ weight)

    def even_step(self):
        """Spacing of the angle if nearly all rows are evenly spaced, radians; else None."""
        known = self.angle[np.isfinite(self.angle)]
        known = known[::max(len(known) // _STEPPED, 1)]
        together = np.abs(np.exp(1j * np.multiply.outer(self.rates, known)).mean(axis=1))
        even = np.flatnonzero(together > _EVEN)
        if not len(even):
            return None
        first = even[even < even[0] + OVERSAMPLED]
        return 2.0 * np.pi / float(self.rates[first[np.argmax(together[first])]])

    def waves(self, rates, shift):
        """Values cos(rate angle - shift) x factor, shape (k, 2n)."""
        wave = np.multiply.outer(rates, np.nan_to_num(self.angle))
        wave -= shift[:, None]
        np.cos(wave, out=wave)
        out, known = np.zeros((len(rates), len(self.factor))), np.isfinite(self.angle)
        for part in (slice(0, len(self.angle)), slice(len(self.angle), None)):
            if self.factor[part].any():
                np.multiply(wave, self.factor[part] * known, out=out[:, part])
        return out


class _WaveColumns:
    """Lazy ndarray of shape (k, 2n): rows are computed on demand."""

    def __init__(self, bank):
        self._bank = bank

    @property
    def shape(self):
        return len(self._bank.column_group), len(self._bank.scans[0].factor)

    def __len__(self):
        return self.shape[0]

    def __array__(self, dtype=None, copy=None):
        return self[:]

    def __getitem__(self, key):
        bank, index = self._bank, np.arange(len(self))[key]
        place = index.tobytes()
        if place not in bank.kept:
            if sum(of.size for of in bank.kept.values()) > _KEPT:
                bank.kept.clear()
            bank.kept[place] = self._made(index)
            bank.kept[place].flags.writeable = False
        return bank.kept[place]

    def _made(self, index):
        bank = self._bank
        group, order, sine = (of[index] for of in (
            bank.column_group, bank.column_order, bank.column_sine))
        rates, scan = bank.rate[group] * order, bank.line[group]
        out = np.empty((len(index), self.shape[1]))
        for number in np.unique(scan):
            mine = scan == number
            out[mine] = bank.scans[number].waves(rates[mine], 0.5 * np.pi * sine[mine])
        return out


class _WaveEffects:
    """Lazy list of effects, each made on demand."""

    def __init__(self, bank):
        self._bank = bank

    def __len__(self):
        return len(self._bank.rate)

    def __getitem__(self, group):
        bank = self._bank
        return bank.scans[bank.line[group]].effect(float(bank.rate[group]),
                                                   SHAPES[group // bank.count])


class PeriodBank(CandidateBank):
    """Waves of all rates of some scans, in each of the `SHAPES`.

    Parameters
    ----------
    scans : list of WaveScan

    Attributes
    ----------
    count : int
        Number of rates of all scans, and of groups of each shape; groups are ordered by shape.
    rate : ndarray, shape (3 count,)
        Rate of each group.
    near : ndarray of int or None
        Groups that are tried; None: all of the first shape.
    kept : dict
        Cache of columns, which each fit needs again.
    """

    def __init__(self, scans):
        self.scans, self.count = list(scans), sum(len(one.rates) for one in scans)
        shapes, count = len(SHAPES), self.count
        empty = np.empty(0)
        self.rate = np.tile(np.concatenate([empty, *(one.rates for one in scans)]), shapes)
        self._offered = self.rate.copy()
        self.line = np.tile(np.repeat(np.arange(len(scans)), [len(one.rates) for one in scans]),
                            shapes)
        sizes = np.repeat([2 * len(orders) for orders in SHAPES], count)
        self.column_group = np.repeat(np.arange(shapes * count), sizes)
        self.column_order = np.concatenate([empty, *(
            np.tile(np.repeat(orders, 2), count) for orders in SHAPES)])
        self.column_sine = np.tile([0.0, 1.0], len(self.column_group) // 2)
        self._start = np.concatenate(([0], np.cumsum(sizes)))
        self._by_size = [(int(d), np.flatnonzero(sizes == d)) for d in np.unique(sizes)]
        self.scan_cost = np.ones(shapes * count)
        self.by_chance, self._sized, self.near, self._tuned, self.kept = {}, [], None, 0, {}
        self.shares = {_SHARE: np.flatnonzero(np.concatenate(
            [empty.astype(bool), *(one.seen(one.rates) for one in scans)]))}

    effects = property(_WaveEffects)
    columns = property(_WaveColumns)

    def __len__(self):
        return len(self.rate)

    def same_share(self, g):
        """All sinusoids that the rows can show, and `g`."""
        return np.union1d(self.shares[_SHARE], [g])

    def rows(self, rows):
        """The bank of some rows (indices or a mask of n)."""
        out = copy(self)
        n = len(self.scans[0].angle) if self.scans else 0
        out.scans = [one.rows(np.arange(n)[rows]) for one in self.scans]
        out.rate, out.kept = self.rate.copy(), {}
        return out

    def as_offered(self):
        """The bank before any wave was tuned."""
        return self.tuned_as(self._offered)

    def tuned_as(self, rate):
        """The bank with other rates, shape (3 count,)."""
        out = copy(self)
        out.rate, out.kept = rate.copy(), {}
        return out

    def score(self, fit, groups=None):
        """See `CandidateBank.score`; by default of the groups that are tried, else of `groups`."""
        tried = self.shares[_SHARE]
        if self.near is not None:
            tried = np.intersect1d(tried, self.near)
        if groups is not None:
            return self._scored(fit, np.unique(groups))
        key = self, self._tuned
        if key not in fit.known:
            fit.known[key] = self._scored(fit, tried)
        return fit.known[key]

    def _scored(self, fit, groups):
        # the groups to score may be few and scattered among thousands
        dof, gains = np.zeros(len(self), int), np.full(len(self), -np.inf)
        for block in self._blocks(groups):
            columns = np.concatenate([np.arange(a, b) for a, b in zip(
                self._start[block], self._start[block + 1])])
            some = CandidateBank(map(_Wave, self._start[block + 1] - self._start[block]),
                          self.columns[columns])._scored(fit, None)
            dof[block], gains[block] = some.dof, some.delta_bic
        return Scores(dof, gains, self, fit)

    def bases(self, fit, groups=None):
        """See `CandidateBank.bases`; by default of all sinusoids that the rows can show."""
        return super().bases(fit, self.shares[_SHARE] if groups is None else groups)

    def tune(self, g, rate):
        """Set the rate of group `g`, near its own."""
        self.rate[g], self._tuned = rate, self._tuned + 1
        self.kept.clear()

    def offer(self, scores, without=()):
        """The sinusoid that gains most, not of the scans of `without`; -1 if plainly by chance."""
        line, gains = self.line[:self.count], scores.delta_bic[:self.count]
        # a gain that rises toward the end of a scan has its peak beyond it, and another cause
        edge = np.diff(line, prepend=-1, append=-1) != 0
        beside = np.concatenate(([np.inf], gains, [np.inf]))
        peak = (gains >= np.where(edge[:-1], np.inf, beside[:-2])) & (
            gains >= np.where(edge[1:], np.inf, beside[2:]))
        gains = np.where(peak & ~np.isin(line, self.line[list(without)]), gains, -np.inf)
        g = int(np.argmax(gains)) if self.count else -1
        if g < 0 or not gains[g] > 0.0:
            return -1
        live = max(np.count_nonzero(scores.fit.weights > LIVE), 2)
        free = live - 0.5 * len(scores.fit.basis) - 2.0
        ratio = scores.delta_bic[g] / live + 3.0 * np.log(live) / live  # ln of the variance ratio
        expected = self.count / OVERSAMPLED * np.exp(-0.5 * free * ratio)
        return g if expected < _PLAINLY_CHANCE else -1

    def best_of_scans(self, scores, g):
        """The group that gains most of each scan but that of `g`."""
        return [int(of[np.argmax(scores.delta_bic[of])]) for scan in range(len(self.scans))
                if scan != self.line[g] and len(of := np.flatnonzero(
                    self.line[:self.count] == scan))]

    def shaped(self, fit, g):
        """The best shape and rate of a detected wave.

        Parameters
        ----------
        fit : WeightedFit
            Fit without the wave.
        g : int
            Its group of the first shape.

        Returns
        -------
        group : int
        rate : float
            The best one.
        """
        rate, best = self.tuned_rate(fit, g, float(self.rate[g]))
        scan, found = self.line[g], (g, rate)
        low, high = self.scans[scan].rates[[0, -1]]
        for longer in _LONGER:
            base = rate / longer
            if not 0.5 * low <= base <= high:
                continue
            near = self.nearest(scan, base)
            for shape, orders in enumerate(SHAPES):
                # the detected wave must be among the orders of a longer period
                if max(orders) < longer or (longer == 1 and shape == 0) or not self.scans[
                        scan].seen(base * np.array(orders)).all():
                    continue
                group = shape * self.count + near
                own, gain = self.tuned_rate(fit, group, base)
                if gain > best + SET_WIDTH:
                    found, best = (group, own), gain
        return found

    def tuned_rate(self, fit, g, rate, rounds=3):
        """The best rate of a group near `rate`, and its gain there."""
        width = self.scans[self.line[g]].step
        for _ in range(rounds):
            rates = rate + width * np.linspace(-1.0, 1.0, 9)
            gains = self._gains_at(fit, g, rates)
            best = int(np.argmax(gains))
            rate, width = float(rates[best]), 0.25 * width
        return rate, float(gains[best])

    def _gains_at(self, fit, g, rates):
        """Gains of a group at other rates."""
        orders = SHAPES[g // self.count]
        columns = self.scans[self.line[g]].waves(
            np.multiply.outer(rates, np.repeat(orders, 2)).ravel(),
            0.5 * np.pi * np.tile([0.0, 1.0], len(orders) * len(rates)))
        bank = CandidateBank([_Wave(2 * len(orders))] * len(rates), columns)
        return bank._scored(fit, None).delta_bic

    def shortlist(self, scores, chosen):
        """Limit the rates tried in parts of the rows to those near the best scores or `chosen`."""
        order = np.argsort(-scores.delta_bic[:self.count])[:_SHORTLIST]
        centres = np.concatenate((order, np.asarray(chosen, int) % self.count))
        near = (centres[:, None] + np.arange(-_BESIDE, _BESIDE + 1)).ravel()
        self.near = np.unique(np.clip(near, 0, self.count - 1))

    def aliases(self, fit, g, width):
        """Rates of the same scan that fit as well as a detected wave, within `width` of BIC.

        Parameters
        ----------
        fit : WeightedFit
            Fit without the wave.
        g : int
        width : float

        Returns
        -------
        ndarray
            Best first; none within a resolution element of the wave's rate or its harmonics.
        """
        own, orders = self.rate[g], SHAPES[g // self.count]
        first = self._first_of(self.line[g])
        best = float(self._gains_at(fit, int(first[0]), np.array([
            own * order for order in orders])).max())
        return self.as_good(fit, self.line[g], best - width, [own * n for n in orders])

    def as_good(self, fit, scan, least, known=()):
        """Rates of a scan with a gain above `least` when tuned, and nearly so before.

        Parameters
        ----------
        fit : WeightedFit
        scan : int
        least : float
        known : sequence of float
            Rates within a resolution element of these are skipped.

        Returns
        -------
        ndarray
            Best first.
        """
        first, spacing = self._first_of(scan), OVERSAMPLED * self.scans[scan].step
        gains = self._scored(fit, first).delta_bic[first]
        out = []
        for k in np.argsort(-gains):
            rate = float(self.scans[scan].rates[k])
            if gains[k] < (1.0 - _UNTUNED) * least or len(out) > 9:
                break
            if all(abs(rate - other) > spacing for other in (*out, *known)):
                tuned, gain = self.tuned_rate(fit, int(first[k]), rate)
                if gain > least:
                    out.append(tuned)
        return np.array(out)

    def nearest(self, scan, rate):
        """Group of the first shape of a scan whose untuned rate is nearest to `rate`."""
        return int(self._first_of(scan)[np.argmin(np.abs(self.scans[scan].rates - rate))])

    def _first_of(self, scan):
        """Groups of the first shape of a scan."""
        return np.flatnonzero(self.line[:self.count] == scan)


class _Wave:
    """Minimal effect, with what scoring needs."""

    scan, scanned, size, share, line = 'period', 1, None, _SHARE, 0

    def __init__(self, size):
        self.coefficient_names = ('',) * size


def rate_error(fit, scan, rate, orders):
    """Standard error of the rate of a wave, per radian.

    Parameters
    ----------
    fit : WeightedFit
        Fit without the wave.
    scan : WaveScan
    rate : float
    orders : sequence of int

    Returns
    -------
    float
    """
    turns = np.repeat(orders, 2).astype(float)
    shift = 0.5 * np.pi * np.tile([0.0, 1.0], len(orders))
    columns = fit.basis.off(np.array(fit.noise.whiten(scan.waves(rate * turns, shift))),
                            in_place=True)
    p = np.linalg.lstsq(columns.T, fit.residual, rcond=None)[0]
    # d/dr cos(n r u - s) = -n u sin(n r u - s)
    slope = (p * turns) @ scan.waves(rate * turns, shift - 0.5 * np.pi) * np.tile(
        np.nan_to_num(scan.angle - np.nanmean(scan.angle)), 2)
    slope = fit.basis.off(np.array(fit.noise.whiten(slope[None])), in_place=True)[0]
    slope = slope - np.linalg.lstsq(columns.T, slope, rcond=None)[0] @ columns
    left = fit.residual - p @ columns
    noise = float(left @ left) / max(2 * fit.n - len(fit.basis) - len(columns) - 1, 1)
    return float(np.sqrt(noise / max(slope @ slope, 1e-300)))
