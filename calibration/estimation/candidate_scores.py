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

"""Candidate groups of columns, and their scores on the residuals of a fit."""

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msg_tools.units import ARCSEC

from .linear_model import DISTINCT, LIVE
from .reduced_squares import directions, each_two, reduced_squares, times_rows

#: rounding error of 2 ln L: two names of one curve may differ by this much
TIE = 1e-6
#: standard errors within which a fitted size agrees with one that physics fixes
AGREES = 3.0
#: bytes of columns processed at a time, so that they fit the cache; fewest groups at a time
_NEAR, _FEW = 4_000_000, 8


@dataclass(frozen=True)
class CandidateGroup:
    """Reference to a candidate group.

    A group of the dictionary, of the curves, of the changes of dictionary group `of`, or of the
    waves of unknown period.
    """

    group: int
    curve: bool = False
    of: int | None = None
    period: bool = False

    @property
    def plain(self):
        """Whether it is a group of the dictionary."""
        return not (self.curve or self.period) and self.of is None

    def changes(self, chosen):
        """Whether a change of it is among the selected groups."""
        return self.plain and any(c.of == self.group for c in chosen)

    def bank(self, problem):
        """The `CandidateBank` that holds it."""
        if self.of is not None:
            return problem.changes(self.of)
        if self.period:
            return problem.periods
        return problem.curves if self.curve else problem.dictionary

    def family(self, problem, chosen):
        """All candidates it competes with, with `chosen` selected, and its index among them."""
        if self.of is None:
            return self.bank(problem), self.group
        bank, all_ = problem.changes_of(chosen)
        return bank, all_.index(self)

    def columns(self, problem):
        """Its columns, shape (d, 2n)."""
        return self.bank(problem).of(self.group)

    def effect(self, problem):
        """The effect whose columns the group holds."""
        return self.bank(problem).effects[self.group]


@dataclass
class Scores:
    """Scores of every candidate group on the residual of one fit.

    Attributes
    ----------
    dof : ndarray of int, shape (G,)
        Directions that the group adds to the model; 0: it is degenerate with the model.
    delta_bic : ndarray, shape (G,)
        Gain in BIC from adding the group; -inf where dof is 0, and where physics fixes the
        group's size and the fitted size disagrees.
    bank : CandidateBank
    fit : WeightedFit
    """

    dof: np.ndarray
    delta_bic: np.ndarray
    bank: object
    fit: object

    def basis(self, group):
        """Orthonormal basis of one group orthogonal to the model, shape (d, 2n)."""
        return next(self.bank.bases(self.fit, [group]))[1][0]


@dataclass
class _AxisColumns:
    """Columns of a bank on one axis, and their products row by row, to be summed with weights.

    Attributes
    ----------
    columns, pairs : ndarray of int, shape (k,), (q,)
        Indices of those of the bank that are not zero on this axis.
    values, squares : ndarray, shape (k, n)
    pair : ndarray of int, shape (2, q)
        The two columns of each pair, as indices of `values`.
    products : ndarray, shape (q, n)
    """

    columns: np.ndarray
    pairs: np.ndarray
    values: np.ndarray
    squares: np.ndarray
    pair: np.ndarray
    products: np.ndarray

    @classmethod
    def of(cls, columns, some, pairs):
        """From columns (K, n), a mask `some` of those not zero, and pairs (2, Q) of them."""
        place, here = np.cumsum(some) - 1, np.flatnonzero(some)
        there = np.flatnonzero(some[pairs[0]])
        values, pair = columns[here], place[pairs[:, there]]
        return cls(here, there, values, np.square(values), pair, values[pair[0]] * values[pair[1]])


class CandidateBank:
    """Candidate groups with their columns.

    Parameters
    ----------
    effects : list of object
        The effect of each group: ``coefficient_names``; ``line``, equal for all members of a
        scan; ``driver``; ``scan``, the kind of scan or None, and ``scanned``, its number of
        parameters; ``size``, physical limits of its amplitude, or None; ``share``, its share of
        the family-wise error.
    columns : ndarray, shape (k, 2n)
        Columns of all groups, one group after the other.
    sizes : bool
        Whether the limits ``size`` are enforced; not where no cause is wanted.
    """

    def __init__(self, effects, columns, sizes=True):
        self.effects, self.columns = list(effects), columns
        self._sized = [g for g, e in enumerate(self.effects) if sizes and e.size is not None]
        #: of each share: null distribution of its largest score, one for each flip, ascending;
        #: empty where not known
        self.by_chance = {}
        sizes = np.array([len(e.coefficient_names) for e in self.effects], int)
        self._start = np.concatenate(([0], np.cumsum(sizes)))
        self._by_size = [(int(d), np.flatnonzero(sizes == d)) for d in np.unique(sizes)]
        self._known, self._offered = {}, {}
        # number of scanned parameters, which BIC counts too
        self.scan_cost = np.array([0 if e.scan is None else e.scanned for e in self.effects],
                                  float)
        names = {}
        self.line = np.array([names.setdefault(e.line, len(names)) for e in self.effects], int)
        #: groups of each share of the family-wise error
        self.shares = {share: np.array([g for g, e in enumerate(self.effects) if e.share == share])
                       for share in dict.fromkeys(e.share for e in self.effects)}

    @classmethod
    def empty(cls, n):
        """A bank of `n` rows without groups."""
        return cls([], np.empty((0, 2 * n)))

    @classmethod
    def joined(cls, banks):
        """All groups of several banks of the same rows."""
        return cls([e for bank in banks for e in bank.effects],
                   np.vstack([bank.columns for bank in banks]))

    def __len__(self):
        return len(self.effects)

    @property
    def starts(self):
        """First column of each group, shape (G,)."""
        return self._start[:-1]

    def same_share(self, g):
        """Groups with the same share of the family-wise error as group `g`, shape (r,)."""
        return self.shares[self.effects[g].share]

    def of(self, g):
        """Columns of group `g`, shape (d, 2n)."""
        return self.columns[self._start[g]:self._start[g + 1]]

    def replace(self, g, effect, columns):
        """Replace group `g` by another effect with as many columns, shape (d, 2n)."""
        self._offered.setdefault(g, (self.effects[g], self.of(g).copy()))
        self.effects = [*self.effects[:g], effect, *self.effects[g + 1:]]
        self.of(g)[:] = columns
        self.__dict__.pop('_of_axes', None)
        self._known.clear()

    def as_offered(self):
        """The bank before any `replace`; itself where there was none."""
        if not self._offered:
            return self
        out = copy(self)
        out.columns, out._known, out._offered = self.columns.copy(), {}, {}
        for g, known in self._offered.items():
            out.replace(g, *known)
        out._offered = {}
        return out

    def only(self, groups):
        """The bank of some groups (indices), numbered anew."""
        return CandidateBank([self.effects[g] for g in groups],
                             np.vstack([self.of(g) for g in groups]))

    def rows(self, rows):
        """The bank of some rows (indices or a mask of n)."""
        n = self.columns.shape[1] // 2
        index = np.arange(n)[rows]
        out = copy(self)  # the effects stay the same
        both = np.concatenate((index, index + n))
        # `take` needs half the time of indexing
        out.columns, out._known = self.columns.take(both, axis=1), {}
        out._offered = {g: (e, columns[:, both]) for g, (e, columns) in self._offered.items()}
        return out

    @cached_property
    def _of_axes(self):
        """Whether each group is not zero on x, and on y, shape (2, G): most act on one axis."""
        some = self.columns.reshape(len(self.columns), 2, -1).any(axis=2)
        return np.logical_or.reduceat(some, self.starts, axis=0).T

    @cached_property
    def _pairs(self):
        """All pairs of columns within a group, shape (2, q), group after group."""
        out = np.zeros((2, self._pair_start[-1]), int)
        for d, which in self._by_size:
            two = each_two(d)
            out[:, self._pair_start[which][:, None] + np.arange(len(two[0]))] = (
                self._start[which][:, None] + two[:, None])
        return out

    @cached_property
    def _pair_start(self):
        """Index of the first pair of each group, and the end, shape (G + 1,)."""
        sizes = np.diff(self._start)
        return np.concatenate(([0], np.cumsum(sizes * (sizes - 1) // 2)))

    def on_axis(self, axis):
        """Columns of the groups that are not zero on x (0) or y (1), ascending."""
        return np.flatnonzero(np.repeat(self._of_axes[axis], np.diff(self._start)))

    def by_size(self, groups=None):
        """Yield for each d the groups with d columns, (G_d,), and indices of these, (G_d, d).

        Of all groups, or of some `groups`, an array.
        """
        if groups is not None:
            sizes = self._start[groups + 1] - self._start[groups]
        for d, which in self._by_size:
            if groups is not None:
                which = groups[sizes == d]
            if len(which):
                yield which, self._start[which][:, None] + np.arange(d)

    def _blocks(self, groups=None):
        """Groups, all or some, ascending, in blocks whose columns fit the processor's cache."""
        groups = np.arange(len(self)) if groups is None else np.asarray(groups, int)
        step = max(_FEW, _NEAR // max(8 * self.columns.shape[1], 1))
        return [groups[i:i + step] for i in range(0, len(groups), step)]

    def bases(self, fit, groups=None):
        """Orthonormal bases of all or some `groups`, orthogonal to the model.

        Yields
        ------
        groups : ndarray of int, shape (G_d,)
        basis : ndarray, shape (G_d, d, 2n)
            Some rows are zero where the group adds fewer than d directions.
        dof : ndarray of int, shape (G_d,)
        """
        for block in self._blocks(groups):
            for some, places in self.by_size(block):
                white = fit.noise.whiten(self.columns[places.ravel()])
                length = np.sqrt(np.einsum('ij,ij->i', white, white))
                white /= np.where(length > 0.0, length, 1.0)[:, None]
                basis = fit.basis.off(white, in_place=True).reshape(*places.shape, -1)
                factor, dof = directions(basis @ basis.transpose(0, 2, 1))
                yield some, factor.transpose(0, 2, 1) @ basis, dof

    def score(self, fit, groups=None):
        """Score all groups on the residuals of a fit.

        Parameters
        ----------
        fit : WeightedFit
        groups : sequence of int, optional
            Groups that must be scored, ascending; others may get dof 0.

        Returns
        -------
        Scores
            Computed once for each fit.
        """
        key = self if groups is None or self in fit.known else (self, *groups)
        if key not in fit.known:
            fit.known[key] = self._scored(fit, groups)
        return fit.known[key]

    def gains_without(self, fit, b, parts):
        """Gains of all groups in place of parts of the model, at the weights of the fit.

        Parameters
        ----------
        fit : WeightedFit
        b : ndarray, shape (2n,)
            The fitted values.
        parts : sequence of ndarray, shape (p, k)
            Orthonormal directions in the basis of the fit; each part is removed in turn.

        Returns
        -------
        ndarray, shape (len(parts), G)
        """
        common = fit.basis.common
        out = np.concatenate([np.zeros((0, len(common))), *parts])
        parted = np.zeros((len(out), len(parts)))
        parted[np.arange(len(out)), np.repeat(np.arange(len(parts)), [*map(len, parts)])] = 1.0
        return self._scored_without(fit, None, out, out @ (common @ fit.noise.whiten(b)),
                                    parted)[1]

    def _scored(self, fit, groups):
        none = np.zeros((0, len(fit.basis.common)))
        dof, dbic = self._scored_without(fit, groups, none, none.sum(axis=1), np.zeros((0, 1)))
        return Scores(dof[0], dbic[0], self, fit)

    def _scored_without(self, fit, groups, out, onto_out, parted):
        """`Scores.dof` and `.delta_bic`, shape (m, G), with each part of the model removed in turn.

        Parameters
        ----------
        fit, groups
            See `score`.
        out : ndarray, shape (p, k)
            Removed directions in the basis of the fit, orthonormal within each part.
        onto_out : ndarray, shape (p,)
            Their products with the whitened values.
        parted : ndarray, shape (p, m)
            1 where a direction belongs to a part, else 0.
        """
        shape = parted.shape[1], len(self)
        dof, dbic = np.zeros(shape, int), np.full(shape, -np.inf)
        live = max(np.count_nonzero(fit.weights > LIVE), 2)
        model = np.vstack((fit.basis.common, fit.residual))
        model = model.reshape(len(model), 2, -1).transpose(1, 0, 2)
        within = [of[:-1] @ of.T for of in model]
        of_axes, rss = [], []
        for of, one in zip(model, within):  # the directions with each other, and with the residual
            each, left = (out @ one[:, :-1] @ out.T) * (parted @ parted.T), out @ one[:, -1]
            more = left + each @ onto_out
            of_axes.append((each, more))
            rss.append((of[-1] @ of[-1] + (onto_out * (left + more)) @ parted + 1e-30)[:, None])
        for block in self._blocks(groups):
            first, first_pair = self._start[block[0]], self._pair_start[block[0]]
            length, products = self._products(fit, model, block)
            onto = sum(one for one, _, _ in products)[:, :-1]
            with_out = onto @ out.T
            beyond = []
            for (one, _, _), one_within, (each, more) in zip(products, within, of_axes):
                both = onto @ one_within
                half, left = one - 0.5 * both, one - both
                back, left = left[:, :-1] @ out.T, left[:, -1:]
                if len(out):
                    left = left + (back * onto_out + with_out * more) @ parted
                    back += 0.5 * (with_out @ each)
                beyond.append((half[:, :-1], left, back))
            for of_size, places in self.by_size(block):
                at, across = places - first, []
                d = at.shape[1]
                onto_model, onto_each = onto[at], with_out[at]
                for (_, square, pair), (half, left, back) in zip(products, beyond):
                    own = square[at][..., None]
                    if d > 1:
                        own = own * np.eye(d)
                        i, j = each_two(d)
                        own[:, i, j] = own[:, j, i] = pair[
                            (self._pair_start[of_size] - first_pair)[:, None] + np.arange(len(i))]
                    shared = times_rows(half[at], onto_model)
                    if len(out):
                        shared = shared - np.moveaxis(
                            (back[at][:, :, None] * onto_each[:, None]) @ parted, -1, 0)
                    across.append((own - shared - np.swapaxes(shared, -1, -2),
                                   left[at].transpose(2, 0, 1)[..., None]))
                left, dof[:, of_size] = reduced_squares(rss, across, length[at])
                ratios = [np.maximum(one[..., 0] / all_, 1e-12) for one, all_ in zip(left, rss)]
                gain = -live * np.log(ratios[0] * ratios[1]) - (
                    dof[:, of_size] + self.scan_cost[of_size]) * np.log(live)
                dbic[:, of_size] = np.where(dof[:, of_size] > 0, gain, -np.inf)
        for g in self._sized if groups is None else np.intersect1d(self._sized, groups):
            for i in np.flatnonzero(dbic[:, g] > 0.0):  # others are not selected anyway
                mine = parted[:, i] > 0.0
                if not agrees(self.effects[g].size,
                              *self._fitted(g, fit, out[mine], onto_out[mine])):
                    dbic[i, g] = -np.inf
        return dof, dbic

    def _products(self, fit, model, groups):
        """Sums over rows of products of the k whitened columns of consecutive groups.

        Returns
        -------
        length : ndarray, shape (k,)
            Lengths of the columns, before each run's own columns were projected out.
        axes : list of (ndarray of shape (k, j), (k,), (q,))
            Of x and y: products with `model`, shape (2, j, n), with themselves, and of all pairs
            within a group.
        """
        n, noise, length = fit.n, fit.noise, None
        start, stop = self._start[groups[0]], self._start[groups[-1] + 1]
        first, last = self._pair_start[groups[0]], self._pair_start[groups[-1] + 1]
        if fit.basis.groups.groups:
            columns = noise.whiten(self.columns[start:stop])
            length = np.sqrt(np.einsum('ij,ij->i', columns, columns))
            fit.basis.off_groups(columns)  # this mixes the axes
        axes = []
        for axis in (0, 1):
            out = (np.zeros((stop - start, model.shape[1])), np.zeros(stop - start),
                   np.zeros(last - first))
            if length is not None:
                white, pairs = columns[:, axis * n:(axis + 1) * n], self._pairs[:, first:last]
                here, there = slice(None), slice(None)
                pairs = pairs - start
            else:
                rows = self._rows_of(axis, start, stop, first, last)
                here, there, white, pairs = rows.columns, rows.pairs, rows.values, rows.pair
            if length is None and noise.white:
                root = noise.root[axis * n:(axis + 1) * n]
                square = np.square(root)
                out[0][here] = white @ (model[axis] * root).T
                out[1][here], out[2][there] = rows.squares @ square, rows.products @ square
            else:
                white = white if length is not None else noise.whiten_axis(axis, white)
                out[0][here] = white @ model[axis].T
                out[1][here] = np.einsum('ij,ij->i', white, white)
                out[2][there] = np.einsum('ij,ij->i', white[pairs[0]], white[pairs[1]])
            axes.append(out)
        return np.sqrt(axes[0][1] + axes[1][1]) if length is None else length, axes

    def _rows_of(self, axis, *part):
        """`_AxisColumns` of a part (first and last column and pair) of the bank, on x or y."""
        key, whole = (axis, *part), part[0] == 0 and part[1] == len(self.columns)
        if key not in self._known:
            start, stop, first, last = part
            some = np.repeat(self._of_axes[axis], np.diff(self._start))[start:stop]
            n = self.columns.shape[1] // 2
            rows = _AxisColumns.of(self.columns[start:stop, axis * n:(axis + 1) * n], some,
                                   self._pairs[:, first:last] - start)
            if not whole:  # with many rows it would take as much memory as the columns
                return rows
            self._known[key] = rows
        return self._known[key]

    def _fitted(self, g, fit, out, onto_out):
        """Coefficients (radians) of a group and their covariance, without some model directions."""
        white, free = np.array(fit.noise.whiten(self.of(g))), out @ fit.basis.common
        columns = fit.basis.off(white) + (white @ free.T) @ free
        residual = fit.residual + onto_out @ free
        inverse = np.linalg.pinv(columns @ columns.T, rcond=DISTINCT**2)
        coefficients = inverse @ (columns @ residual)
        left = residual - coefficients @ columns
        live = max(np.count_nonzero(fit.weights > LIVE), 2)
        free = max(2 * live - len(fit.basis) + len(out) - len(columns), 1)
        return coefficients, inverse * (left @ left) / free


def agrees(size, coefficients, covariance):
    """Whether the length of fitted coefficients is within limits set by physics, within its error.

    Parameters
    ----------
    size : tuple of float
        Smallest and largest length, arcsec.
    coefficients : ndarray, shape (k,)
        Radians.
    covariance : ndarray, shape (k, k)

    Returns
    -------
    bool
    """
    length = float(np.sqrt(coefficients @ coefficients))
    toward = coefficients / max(length, 1e-300)
    error = AGREES * float(np.sqrt(max(toward @ covariance @ toward, 0.0)))
    return size[0] * ARCSEC - error <= length <= size[1] * ARCSEC + error


def best_of(scores, excluded=()):
    """Group with the largest gain but for `excluded`, and the gain; (-1, -inf) where none."""
    dbic = scores.delta_bic.copy()
    dbic[list(excluded)] = -np.inf
    g = largest(dbic) if len(dbic) else -1
    return (g, float(dbic[g])) if g >= 0 else (-1, -np.inf)


def largest(values):
    """Index of the largest value; the first of those equal but for rounding."""
    return int(np.flatnonzero(values >= values.max() - TIE)[0])
