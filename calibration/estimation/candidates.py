"""Candidate groups of columns, and their scores on what a fit leaves."""

from copy import copy
from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC

from .linear_model import DISTINCT, LIVE

#: standard errors within which a fitted size agrees with one that physics fixes
AGREES = 3.0
#: bytes of the bases that are at work at a time, and groups of which they are at least
_NEAR, _FEW = 4_000_000, 8


@dataclass(frozen=True)
class CandidateGroup:
    """A group of the dictionary, of the curves, or of the changes of a group of the dictionary."""

    group: int
    curve: bool = False
    of: int | None = None

    @property
    def plain(self):
        """Whether it is of the dictionary."""
        return not self.curve and self.of is None

    def changes(self, chosen):
        """Whether a change of it is among a choice."""
        return self.plain and any(c.of == self.group for c in chosen)

    def bank(self, problem):
        """Where it comes from."""
        if self.of is not None:
            return problem.variants.changes(self.of)
        return problem.curves if self.curve else problem.dictionary

    def family(self, problem, chosen):
        """All that it is chosen from beside `chosen`, and its place there: CandidateBank, int."""
        if self.of is None:
            return self.bank(problem), self.group
        bank, all_ = problem.changes_of(chosen)
        return bank, all_.index(self)

    def columns(self, problem):
        """Shape (d, 2n)."""
        return self.bank(problem).of(self.group)

    def effect(self, problem):
        """What the group stands for."""
        return self.bank(problem).effects[self.group]


@dataclass
class Scores:
    """Of every candidate group on one residual.

    Attributes
    ----------
    dof : ndarray of int, shape (G,)
        Columns that the model does not have; 0: none, it cannot be told from the model.
    delta_bic : ndarray, shape (G,)
        Gain of adding the group; -inf where dof is 0, and where physics fixes the group's size
        and the rows ask for another.
    bases : list of (ndarray of int, ndarray of shape (G_d, d, 2n), ndarray of int)
        Groups of equal size, their orthonormal bases beyond the model, and their dof.
    """

    dof: np.ndarray
    delta_bic: np.ndarray
    bases: list

    def basis(self, group):
        """Orthonormal basis of one group, shape (d, 2n)."""
        for groups, basis, _ in self.bases:
            where = np.flatnonzero(groups == group)
            if len(where):
                return basis[where[0]]
        raise ValueError(f'no candidate group {group}')


class CandidateBank:
    """Candidate groups with their columns.

    Parameters
    ----------
    effects : list of object
        What each group stands for: ``coefficient_names``; ``line``, the same of groups of which
        one is meant; ``driver``; ``scan`` and ``scanned``, the numbers that a scan tries; ``size``,
        what physics fixes its length to, or None.
    columns : ndarray, shape (k, 2n)
        Of all groups, one after the other.
    sizes : bool
        Whether effects of a size that physics fixes are held to it; not where no cause is asked
        for.
    """

    def __init__(self, effects, columns, sizes=True):
        self.effects, self.columns = list(effects), columns
        self._sized = [g for g, e in enumerate(self.effects) if sizes and e.size is not None]
        sizes = np.array([len(e.coefficient_names) for e in self.effects], int)
        self._start = np.concatenate(([0], np.cumsum(sizes)))
        self._by_size = [(int(d), np.flatnonzero(sizes == d)) for d in np.unique(sizes)]
        # what was scanned, in parameters
        self.scan_cost = np.array([0 if e.scan is None else e.scanned for e in self.effects], int)
        names = {}
        self.line = np.array([names.setdefault(e.line, len(names)) for e in self.effects], int)

    @classmethod
    def empty(cls, n):
        """Of `n` rows."""
        return cls([], np.empty((0, 2 * n)))

    @classmethod
    def joined(cls, banks):
        """All groups of several, of the same rows."""
        return cls([e for bank in banks for e in bank.effects],
                   np.vstack([bank.columns for bank in banks]))

    def __len__(self):
        return len(self.effects)

    @property
    def starts(self):
        """First column of each group, shape (G,)."""
        return self._start[:-1]

    def of(self, g):
        """Columns of group `g`, shape (d, 2n)."""
        return self.columns[self._start[g]:self._start[g + 1]]

    def replace(self, g, effect, columns):
        """Put another effect with as many columns, shape (d, 2n), in the place of group `g`."""
        self.effects = [*self.effects[:g], effect, *self.effects[g + 1:]]
        self.of(g)[:] = columns

    def only(self, groups):
        """The bank of some groups (indices), numbered anew."""
        return CandidateBank([self.effects[g] for g in groups],
                             np.vstack([self.of(g) for g in groups]))

    def rows(self, rows):
        """The bank of some rows (indices or a mask of n)."""
        n = self.columns.shape[1] // 2
        index = np.arange(n)[rows]
        out = copy(self)  # what the effects are called is the same
        out.columns = self.columns[:, np.concatenate((index, index + n))]
        return out

    def by_size(self):
        """Of each number of columns: the groups that have so many, (G_d,), and where, (G_d, d)."""
        return [(groups, self._start[groups][:, None] + np.arange(d))
                for d, groups in self._by_size]

    def bases(self, fit):
        """Orthonormal bases of the groups beyond the model.

        Yields
        ------
        groups : ndarray of int, shape (G_d,)
        basis : ndarray, shape (G_d, d, 2n)
            A row is zero where the group has fewer directions of its own.
        dof : ndarray of int, shape (G_d,)
        """
        for all_groups, places in self.by_size():
            # what is at work at a time stays near the processor where rows are many
            d = places.shape[1]
            step = max(_FEW, _NEAR // (self.columns[0].nbytes * d))
            for i in range(0, len(all_groups), step):
                groups = all_groups[i:i + step]
                white = fit.noise.whiten(self.columns[places[i:i + step].ravel()])
                length = np.sqrt(np.einsum('ij,ij->i', white, white))
                white /= np.where(length > 0.0, length, 1.0)[:, None]
                basis = fit.basis.off(white, in_place=True).reshape(len(groups), d, -1)
                values, vectors = np.linalg.eigh(basis @ basis.transpose(0, 2, 1))
                keep = values > DISTINCT**2
                factor = np.where(keep, 1.0 / np.sqrt(np.where(keep, values, 1.0)), 0.0)
                yield (groups, (vectors * factor[:, None, :]).transpose(0, 2, 1) @ basis,
                       keep.sum(axis=1))

    def score(self, fit, gains_only=False):
        """Score all groups on what a fit leaves.

        Parameters
        ----------
        fit : WeightedFit
        gains_only : bool
            Without the bases, which take as much memory as the columns.

        Returns
        -------
        Scores
        """
        n, size = fit.n, len(self.effects)
        dof, dbic = np.zeros(size, int), np.full(size, -np.inf)
        r = fit.residual
        live = max(np.count_nonzero(fit.weights > LIVE), 2)
        rss = np.array([r[:n] @ r[:n], r[n:] @ r[n:]]) + 1e-30
        bases = []
        for groups, basis, k in self.bases(fit):
            if not gains_only:
                bases.append((groups, basis, k))
            left = np.square(r - np.einsum('gd,gdi->gi', basis @ r, basis))
            ratio = left.reshape(-1, 2, n).sum(axis=2) / rss
            cost = (k + self.scan_cost[groups]) * np.log(live)
            gain = -live * np.log(np.maximum(ratio, 1e-12)).sum(axis=1) - cost
            dof[groups] = k
            dbic[groups[k > 0]] = gain[k > 0]
        for g in self._sized:
            if dof[g] and not agrees(self.effects[g].size, *self._fitted(g, fit)):
                dbic[g] = -np.inf
        return Scores(dof, dbic, bases)

    def _fitted(self, g, fit):
        """Coefficients of a group beside the model, and their covariance, radians."""
        columns = fit.basis.off(np.array(fit.noise.whiten(self.of(g))), in_place=True)
        inverse = np.linalg.pinv(columns @ columns.T, rcond=DISTINCT**2)
        coefficients = inverse @ (columns @ fit.residual)
        left = fit.residual - coefficients @ columns
        live = max(np.count_nonzero(fit.weights > LIVE), 2)
        free = max(2 * live - len(fit.basis) - len(columns), 1)
        return coefficients, inverse * (left @ left) / free


def agrees(size, coefficients, covariance):
    """Whether fitted coefficients are as long as physics says, within their error.

    Parameters
    ----------
    size : tuple of float
        Least and most length, arcsec.
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
    """Group with the largest gain but for some, and the gain; (-1, -inf) where there is none."""
    dbic = scores.delta_bic.copy()
    dbic[list(excluded)] = -np.inf
    g = int(np.argmax(dbic)) if len(dbic) else -1
    return (g, float(dbic[g])) if g >= 0 else (-1, -np.inf)
