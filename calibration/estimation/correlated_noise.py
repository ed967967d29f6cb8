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

"""Noise that remembers: white noise and, beside it, a process with exponential memory.

The noise of an axis is white plus a stationary process with the correlation exp(-dt / tau)
(Ornstein and Uhlenbeck; a random walk where tau is far longer than the run). How large it is and
how long it remembers is the maximum of the restricted likelihood (Patterson and Thompson 1971,
Biometrika 58, 545; REML) over a grid. In the order of time, differences e_i - phi_i e_(i-1) of such
rows have a tridiagonal covariance: rows are whitened in O(n).
"""

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

#: eigenvalues of a normal matrix of unit columns below this part of the largest are rounding: its
#: entries are good to some 1e-13 of 1e5 rows
EIGEN = 1e-10
#: between memories that are tried, and between sizes (variance over that of the white noise); then
#: half a step about the best of them
_MEMORY_STEP, _SIZE_STEP = 4.0, 10.0
_SIZES = _SIZE_STEP ** np.arange(-1.0, 3.0)
_FINER = _SIZE_STEP ** np.arange(-1.5, 3.0, 0.5)
_ABOUT = np.array([(longer, larger) for longer in (-0.5, 0.0, 0.5) for larger in (-0.5, 0.0, 0.5)
                   if longer or larger])
#: numbers in the columns of the noises that are tried at a time
AT_ONCE = 200_000


class Sequence:
    """The order in which rows were observed, and how far apart they are.

    Parameters
    ----------
    position : ndarray, shape (n,)
        Time (s), or the place in the order.
    run : ndarray of int, shape (n,)
        A run remembers nothing of the one before.
    factor : ndarray, shape (n,)
        Of a process on the first axis that may have a factor in each row, as an angle of an azimuth
        axis has cos E on the sky.
    timed : bool
        Whether the position is a time.
    group : ndarray of int, shape (n,), optional
        Rows of one star within minutes share a number: what is left out is left out together.
    """

    def __init__(self, position, run, factor, timed=True, group=None):
        self.position, self.run, self.factor, self.timed = position, run, factor, timed
        self.group = np.arange(len(run)) if group is None else group
        self.order = np.lexsort((position, run))
        gap = np.diff(position[self.order], prepend=-np.inf)
        gap[np.diff(run[self.order], prepend=run[self.order[:1]]) != 0] = np.inf
        #: to the row before in `order`; infinite where a run begins
        self.gap = gap
        self._known = {}

    def rows(self, rows):
        """Of some rows (indices)."""
        return Sequence(self.position[rows], self.run[rows], self.factor[rows], self.timed,
                        self.group[rows])

    def some(self, keep):
        """Rows of a mask (n,) in their order, the gap before each, starts and lengths of runs."""
        key = keep.tobytes()
        if key not in self._known:
            keep = keep[self.order]
            rows = self.order[keep]
            # over rows that are left out the gaps add up
            since = np.cumsum(np.where(np.isfinite(self.gap), self.gap, 0.0))[keep]
            gap, run = np.diff(since, prepend=-np.inf), self.run[rows]
            first = np.diff(run, prepend=run[:1]) != 0
            gap[first] = np.inf
            starts = np.append(0, np.flatnonzero(first))
            self._known[key] = rows, gap, starts, np.diff(np.append(starts, len(run)))
        return self._known[key]

    @property
    def span(self):
        """Length of the longest run, in units of the position."""
        ordered, begins = self.position[self.order], np.flatnonzero(np.isinf(self.gap))
        ends = np.append(begins[1:], len(ordered)) - 1
        return float(np.max(ordered[ends] - ordered[begins]))

    @cached_property
    def memories(self):
        """Correlation times to be tried, from the shortest gap that counts to far beyond the run.

        Returns
        -------
        ndarray
            Ascending; empty where no row has a row before it.
        """
        gap = self.gap[np.isfinite(self.gap) & (self.gap > 0.0)]
        if not len(gap):
            return gap
        first = np.quantile(gap, 0.1)
        count = int(np.ceil(np.log(4.0 * self.span / first) / np.log(_MEMORY_STEP))) + 1
        return first * _MEMORY_STEP ** np.arange(max(count, 1))


@dataclass(frozen=True)
class AxisNoise:
    """Noise of an axis.

    Attributes
    ----------
    variance : float
        Of the process, rad^2; 0: the noise is white.
    memory : float
        Its correlation time, in units of the sequence's position.
    scaled : bool
        It has the factor of the sequence.
    scale : float
        Of the white noise beside it, as `WeightedFit.scale`.
    gain : float
        2 ln of the restricted likelihood ratio against white noise alone.
    """

    variance: float = 0.0
    memory: float = np.inf
    scaled: bool = False
    scale: float = 1.0
    gain: float = 0.0


class WhiteNoise:
    """Weights alone: noise without memory.

    Parameters
    ----------
    root : ndarray, shape (2n,)
        1 / sigma of each value, 0 for rows set aside.
    """

    def __init__(self, root):
        self.root = root

    def whiten(self, values):
        """Whitened values, shape (..., 2n)."""
        return values * self.root

    def whiten_axis(self, axis, values):
        """Whitened values of x (0) or y (1), shape (m, n)."""
        n = values.shape[1]
        return values * self.root[axis * n:(axis + 1) * n]

    def spread(self, values):
        """`values` (..., 2n) such that their squares sum to the variance of values @ noise."""
        return values * _sigma(self.root)

    def without(self, rows):
        """The same with some rows (indices of n) set aside."""
        return WhiteNoise(_set_aside(self.root, rows))

    def rows(self, rows):
        """Of some rows (indices of n)."""
        return WhiteNoise(self.root.reshape(2, -1)[:, rows].ravel())


class CorrelatedNoise:
    """Weights, and differences that take out what a row has from the rows before.

    Parameters
    ----------
    root : ndarray, shape (2n,)
        1 / sigma of the white part, 0 for rows set aside.
    sequence : Sequence
    memory : tuple of AxisNoise
        Of x and y, or of as many axes as there are.
    """

    def __init__(self, root, sequence, memory):
        n = len(sequence.run)
        self.root, self._sequence, self.memory = root, sequence, memory
        self._axes = [(part, _Differences(AxisRows(root[part], sequence, one.scaled), one))
                      for k, one in enumerate(memory) if one.variance > 0.0
                      for part in [slice(k * n, (k + 1) * n)]]

    @classmethod
    def beside(cls, noise, scale, sequence, memory):
        """With the weights of a fit that took the noise as white, and of that `scale`."""
        white = [one.scale / s if one.variance > 0.0 else 1.0 for one, s in zip(memory, scale)]
        return cls(noise.root / np.repeat(white, len(noise.root) // 2), sequence, memory)

    def whiten(self, values):
        """Whitened values, shape (..., 2n): of rows set aside 0."""
        return self._each(values, self.root, _Differences.whitened)

    def whiten_axis(self, axis, values):
        """As `WhiteNoise.whiten_axis`."""
        n = values.shape[1]
        part = slice(axis * n, (axis + 1) * n)
        for other, of in self._axes:
            if other == part:
                return of.whitened(values)
        return values * self.root[part]

    def spread(self, values):
        """As `WhiteNoise.spread`."""
        return self._each(values, _sigma(self.root), _Differences.spread)

    def coloured(self, values):
        """The way back: white noise (..., 2n) as this noise; 0 in rows set aside."""
        return self._each(values, _sigma(self.root), _Differences.coloured)

    def process(self, residual):
        """What the process did in rows of these residuals, (..., 2n), as far as they show.

        Simple kriging (Cressie 1993, Statistics for Spatial Data, section 3.2).
        """
        return self._each(residual, 0.0, _Differences.process)

    def _each(self, values, factor, of_axis):
        flat = values.reshape(-1, values.shape[-1])
        out = flat * factor
        for part, axis in self._axes:
            some = flat[:, part].any(axis=1)  # most effects are of one axis
            some = slice(None) if some.all() else np.flatnonzero(some)
            out[some, part] = of_axis(axis, flat[some, part])
        return out.reshape(values.shape)

    @property
    def log_det(self):
        """Of the covariance of the rows with weight."""
        plain = self.root.copy()
        for part, _ in self._axes:
            plain[part] = 0.0
        return float(-2.0 * np.log(plain[plain > 0.0]).sum()
                     + sum(axis.log_det for _, axis in self._axes))

    def without(self, rows):
        """The same with some rows (indices of n) set aside."""
        return CorrelatedNoise(_set_aside(self.root, rows), self._sequence, self.memory)

    def rows(self, rows):
        """Of some rows (indices of n)."""
        return CorrelatedNoise(self.root.reshape(len(self.memory), -1)[:, rows].ravel(),
                               self._sequence.rows(rows), self.memory)

    def values(self, places):
        """Of some values (indices of 2n) of one axis."""
        axis, n = places[0] // len(self._sequence.run), len(self._sequence.run)
        return CorrelatedNoise(self.root[places], self._sequence.rows(places - axis * n),
                               self.memory[axis:axis + 1])

    @property
    def neighbour(self):
        """Correlation of each axis with a place before that is 1 away; 0 of white noise."""
        return np.array([np.exp(-1.0 / one.memory) if one.variance > 0.0 else 0.0
                         for one in self.memory])


def _sigma(root):
    return 1.0 / np.where(root > 0.0, root, np.inf)


def _set_aside(root, rows):
    root = root.copy()
    root.reshape(2, -1)[:, rows] = 0.0
    return root


class AxisRows:
    """The rows with weight of one axis, in order; their values in units of the process."""

    def __init__(self, root, sequence, scaled):
        self.all = len(root)
        self.rows, self.gap, self.starts, self.lengths = sequence.some(root > 0.0)
        self._as_they_stand = np.array_equal(self.rows, np.arange(self.all))
        self._scale = 1.0 / sequence.factor[self.rows] if scaled else np.ones(len(self.rows))
        #: variance beside the process
        self.white = np.square(self._scale / root[self.rows])
        # (of either sign: beyond the pole an angle moves a star the other way)
        self.log_scale = 2.0 * float(np.log(np.abs(self._scale)).sum())

    def of(self, values):
        """Values (k, n) of all rows -> (k, m) of these."""
        return values if self._as_they_stand else values.take(self.rows, axis=1)

    def scaled(self, values):
        """Values (k, n) of all rows -> (k, m) of these, in units of the process."""
        return self.of(values) * self._scale

    def whitened_by(self, columns, memories, variances, white):
        """Columns as `scaled` gives them, whitened by several noises.

        Parameters
        ----------
        columns : ndarray, shape (k, m)
        memories, variances : ndarray, shape (t,)
            Of the process of each noise.
        white : ndarray, shape (t,)
            Sigma of the white part, in that of these rows.

        Returns
        -------
        columns : ndarray, shape (k, t, m)
        log_det : ndarray, shape (t,)
            Of the covariance of the rows.
        """
        # the noises are as runs one after the other, that know nothing of each other
        tries, n = len(memories), columns.shape[1]
        phi = np.exp(-self.gap / np.asarray(memories)[:, None]).ravel()
        diagonal, lower = _factored(phi, np.outer(np.square(white), self.white).ravel(),
                                    np.repeat(variances, n))
        out = _solved(phi, np.sqrt(diagonal), lower, np.tile(columns, tries))
        return (out.reshape(-1, tries, n),
                np.log(diagonal).reshape(tries, n).sum(axis=1) - self.log_scale)

    def unscaled(self, values):
        """Values (k, m) of these rows as on the sky."""
        return values / self._scale

    def placed(self, values):
        """Values (k, m) of these rows -> (k, n) of all."""
        if self._as_they_stand:
            return values
        out = np.zeros((len(values), self.all))
        out[:, self.rows] = values
        return out


class _Differences:
    """Whitening of one axis by differences of neighbours, values of shape (k, n)."""

    def __init__(self, rows, noise):
        self._rows, self._phi = rows, np.exp(-rows.gap / noise.memory)
        diagonal, self._lower = _factored(self._phi, rows.white, noise.variance)
        self._root = np.sqrt(diagonal)
        #: of the covariance of the rows with weight
        self.log_det = float(np.log(diagonal).sum()) - rows.log_scale

    def whitened(self, values):
        """Values whitened."""
        return self._rows.placed(_solved(self._phi, self._root, self._lower,
                                         self._rows.scaled(values)))

    def spread(self, values):
        """Inverse of the transposed whitening."""
        u = _bidiagonal(-self._phi[1:], self._rows.unscaled(self._rows.of(values)), 'T')
        u[:, :-1] += self._lower * u[:, 1:]
        return self._rows.placed(u * self._root)

    def process(self, values):
        """The process in values, its mean as they tell it: they less their white part."""
        rows, scaled = self._rows, self._rows.scaled(values)
        u = _solved(self._phi, self._root, self._lower, scaled.copy()) / self._root
        u = _bidiagonal(self._lower, u, 'T')
        u[:, :-1] -= self._phi[1:] * u[:, 1:]
        return rows.placed(rows.unscaled(scaled - rows.white * u))

    def coloured(self, values):
        """Inverse of the whitening."""
        noise = self._rows.of(values) * self._root
        noise[:, 1:] += self._lower * noise[:, :-1]
        return self._rows.placed(self._rows.unscaled(_bidiagonal(-self._phi[1:], noise)))


def _factored(phi, white, variance):
    """LDL^T of the covariance of the differences: D (m,) and the lower diagonal of L (m-1,)."""
    before = np.concatenate(([0.0], white[:-1]))
    diagonal = variance * (1.0 - phi * phi) + white + phi * phi * before
    if len(diagonal) < 2:  # as of `_bidiagonal`
        return diagonal, diagonal[:0]
    from scipy.linalg.lapack import dpttrf  # slow to import
    d, lower, info = dpttrf(diagonal, -phi[1:] * white[:-1])
    if info:
        raise np.linalg.LinAlgError('covariance of correlated noise is not positive definite')
    return d, lower


def _bidiagonal(lower, values, trans='N'):
    """Solution with a unit lower bidiagonal matrix; values (k, m) are overwritten."""
    if not values.size:  # LAPACK's routine writes beyond an empty array
        return values
    from scipy.linalg.lapack import dtbtrs
    band = np.vstack((np.ones(len(lower) + 1), np.append(lower, 0.0)))
    return dtbtrs(band, values.T, uplo='L', trans=trans, diag='U', overwrite_b=1)[0].T


def _solved(phi, root, lower, values):
    """Values (k, m) of scaled rows, whitened; `root` (m,) of the diagonal; they are overwritten."""
    values[:, 1:] -= phi[1:] * values[:, :-1]
    values = _bidiagonal(lower, values)
    values /= root
    return values


def noise_memory(sequence, root, scale, columns, b):
    """How much rows resemble their neighbours: the noise of each axis, by restricted likelihood.

    Parameters
    ----------
    sequence : Sequence
    root : ndarray, shape (2n,)
        Weights, with all noise taken as white.
    scale : ndarray, shape (2,)
        That noise, as `WeightedFit.scale`.
    columns : GroupColumns
        What is fitted; groups are runs, or parts of them.
    b : ndarray, shape (2n,)

    Returns
    -------
    tuple of AxisNoise
        Of x and y.
    """
    return MemorySearch(sequence, root, scale, columns, b).noise()


class MemorySearch:
    """What `noise_memory` finds, also without some columns: most is the same for all of these.

    Parameters are as of `noise_memory`.
    """

    def __init__(self, sequence, root, scale, columns, b):
        self._memories, self._scale, self._with_factor = sequence.memories, scale, None
        self._axes = [AxisLikelihood(sequence, axis, False, root, scale, columns, b)
                      for axis in (0, 1)]

    def noise(self, without=()):
        """`AxisNoise` of x and y, without some of the common columns (indices)."""
        out = []
        for axis, every in enumerate(self._axes):
            best, likelihood = AxisNoise(scale=self._scale[axis]), every.without(without)
            if not likelihood.few:
                best = likelihood.climb(self._memories, _SIZES, best)
            if axis == 0 and best.gain > 0.0:
                # nearly the same curve: near the best of the other
                self._with_factor = self._with_factor or every.with_factor()
                likelihood = self._with_factor.without(without)
                size = best.variance / (best.scale / self._scale[0])**2 / likelihood.typical
                best = likelihood.climb([best.memory], [size], best)
            out.append(best)
        return tuple(out)


def likely_memories(sequence, root, memory, scale, columns, b):
    """Noise that each axis may have, and how likely it is: the estimate alone claims too much.

    Half of the prior is that it has no memory, the other half is even over the logarithms of memory
    and size.

    Parameters
    ----------
    sequence, root, scale, columns, b
        As of `noise_memory`.
    memory : tuple of AxisNoise
        The estimate.

    Returns
    -------
    list of (list of AxisNoise, ndarray)
        Of x and y: noises, the first of them white, and their chances.
    """
    out = []
    for axis in (0, 1):
        likelihood = AxisLikelihood(sequence, axis, memory[axis].scaled, root, scale, columns, b)
        tried = [] if likelihood.few else likelihood.at(*_grid(sequence.memories, _FINER))
        every = [AxisNoise(scale=scale[axis]), *tried]
        gain = np.array([one.gain for one in every])
        chance = np.exp(0.5 * (gain - gain.max()))
        chance[1:] /= max(len(tried), 1)
        out.append((every, chance / chance.sum()))
    return out


def _grid(memories, sizes):
    """All pairs, each shape (m s,)."""
    return np.repeat(memories, len(sizes)), np.tile(sizes, len(memories))


class AxisLikelihood:
    """The restricted likelihood of noise of one axis; parameters as of `noise_memory`.

    Attributes
    ----------
    few : bool
        The rows do not determine what is fitted and a noise.
    typical : float
        Variance of the white noise.
    """

    def __init__(self, sequence, axis, scaled, root, scale, columns, b):
        n = len(b) // len(scale)
        part = slice(axis * n, (axis + 1) * n)
        own = columns.own[:, part]
        own = own[np.abs(own).max(axis=1, initial=0.0) > 0.0]
        # what an axis does not tell apart would be rounding; noise changes nothing of that
        within = columns.rows(np.arange(len(b))[part])
        live = (root[part] > 0.0).astype(float)
        rows = within.basis(WhiteNoise(live)).common
        self._sequence, self._root, self._scale = sequence, root[part], scale[axis]
        self._own, self._common = len(own), (within.common * live) @ rows.T
        self._alone = columns.alone
        self._unscaled = np.vstack((own, rows, b[part]))
        self._set(scaled)

    def _set(self, scaled):
        self._scaled, self._rows = scaled, AxisRows(self._root, self._sequence, scaled)
        self._columns = self._rows.scaled(self._unscaled)
        white = self._rows.white
        self.typical = float(np.mean(np.sort(white)[[(len(white) - 1) // 2, len(white) // 2]])) \
            if len(white) else 1.0
        self._products = {}  # of each noise
        self._turn(np.eye(len(self._common.T)))

    def _turn(self, basis):
        """Let the design be what of the columns has this basis (j, k)."""
        self._basis = np.zeros((len(basis) + 1, len(basis.T) + 1))
        self._basis[:-1, :-1], self._basis[-1, -1] = basis, 1.0
        self.few = len(self._rows.rows) < len(basis) + self._own * len(self._rows.starts) + 3
        if not self.few:
            self._none = float(self._of(None)[0][0])

    def without(self, columns):
        """The same without some of the common columns (indices)."""
        if not len(columns):
            return self
        out = copy(self)
        out._turn(self._alone(np.delete(self._common, columns, axis=0)).basis().common)
        return out

    def with_factor(self):
        """The same of a process that has the factor of the sequence."""
        out = copy(self)
        out._set(True)
        return out

    def climb(self, memories, sizes, best):
        """The best of a grid, and then of a finer one about it."""
        if not len(memories):
            return best
        tried = self._tried(*_grid(memories, sizes))
        memory, size, value, _ = tried[:, int(np.argmin(tried[2]))]
        if value < self._none:
            tried = np.hstack((tried, self._tried(memory * _MEMORY_STEP**_ABOUT[:, 0],
                                                  size * _SIZE_STEP**_ABOUT[:, 1])))
        return max(best, self._noise(*tried[:, int(np.argmin(tried[2]))]), key=lambda one: one.gain)

    def at(self, memories, sizes):
        """`AxisNoise` of each memory and size (over the variance of the white noise), in pairs."""
        return [self._noise(*one) for one in self._tried(memories, sizes).T]

    def _tried(self, memories, sizes):
        """Memories, sizes, -2 ln L and variances, shape (4, t)."""
        noises = np.array([memories, sizes])
        return np.vstack((noises, self._of(noises) if len(noises.T) else noises))

    def _noise(self, memory, size, value, variance):
        return AxisNoise(float(size * self.typical * variance), float(memory), self._scaled,
                         self._scale * float(np.sqrt(variance)), float(self._none - value))

    def _of(self, noises):
        """-2 ln L restricted (but for a constant) of noises, and the variance of the rows.

        Noises are memories and sizes, shape (2, t), None of white noise.
        """
        key = None if noises is None else noises.tobytes()
        if key not in self._products:
            self._products[key] = self._products_of(noises)
        products, log_det, taken = self._products[key]
        return restricted(self._basis @ products @ self._basis.T, log_det,
                          len(self._rows.rows) - taken)

    def _products_of(self, noises):
        if noises is None:
            white = self._rows.white
            return self._left((self._columns / np.sqrt(white))[:, None],
                              np.log(white).sum(keepdims=True) - self._rows.log_scale)
        step = max(1, AT_ONCE // max(self._columns.size, 1))
        parts = [self._left(*self._rows.whitened_by(
            self._columns, memory, size * self.typical, np.ones(len(memory))))
            for memory, size in (noises[:, i:i + step] for i in range(0, len(noises.T), step))]
        return [np.concatenate(of) for of in zip(*parts)]

    def _left(self, white, log_det):
        """Products of columns, shape (k, t, m), for `restricted`, of each try.

        What each run fits for itself comes first in them: no row of one run has to do with those
        of another, so it is taken out run by run.

        Returns
        -------
        products : ndarray, shape (t, j, j)
        log_det : ndarray, shape (t,)
            With that of what was taken out.
        taken : ndarray of int, shape (t,)
            Numbers that were.
        """
        taken = np.zeros(white.shape[1], int)
        if self._own:
            _, tries, n = white.shape
            starts = (self._rows.starts + n * np.arange(tries)[:, None]).ravel()
            rows = np.ascontiguousarray(white.reshape(len(white), -1).T)
            own, rest = rows[:, :self._own], rows[:, self._own:]
            gram = np.add.reduceat(own[:, :, None] * own[:, None, :], starts)
            values, vectors = np.linalg.eigh(gram)
            live = values > EIGEN * np.maximum(values[:, -1:], 1e-300)
            inverse = vectors * np.where(live, 1.0 / np.where(live, values, 1.0), 0.0)[:, None, :]
            p = inverse @ (vectors.transpose(0, 2, 1) @ np.add.reduceat(
                own[:, :, None] * rest[:, None, :], starts))
            taken = live.reshape(tries, -1).sum(axis=1)
            log_det = log_det + np.log(np.where(live, values, 1.0)).reshape(tries, -1).sum(axis=1)
            rest = rest - np.einsum('nj,njk->nk', own,
                                    np.repeat(p, np.tile(self._rows.lengths, tries), axis=0))
            white = rest.T.reshape(-1, tries, n)
        white = white.transpose(1, 0, 2)
        return white @ white.transpose(0, 2, 1), log_det, taken


def restricted(products, log_det, free):
    """-2 ln L restricted, the variance by the rows themselves.

    Parameters
    ----------
    products : ndarray, shape (..., k + 1, k + 1)
        Of whitened columns with each other: the design, of which none depends on others, and
        behind it what it is fitted to.
    log_det : float or ndarray, shape (...)
        Of the covariance they are whitened by, but for the variance.
    free : int or ndarray, shape (...)
        Rows less the numbers that were fitted before.

    Returns
    -------
    value : ndarray, shape (...)
        But for a constant.
    variance : ndarray, shape (...)
    """
    k = products.shape[-1] - 1
    length = np.sqrt(np.diagonal(products, axis1=-2, axis2=-1))
    length = np.where(length > 0.0, length, 1.0)
    unit = products / (length[..., None] * length[..., None, :])
    try:
        root = np.linalg.cholesky(unit)
    except np.linalg.LinAlgError:  # rounding
        root = np.linalg.cholesky(unit + EIGEN * np.eye(k + 1))
    diagonal = np.diagonal(root, axis1=-2, axis2=-1) * length
    free = np.maximum(free - k, 1)
    variance = np.maximum(np.square(diagonal[..., -1]) / free, 1e-300)
    logs = np.log(np.maximum(diagonal[..., :-1], 1e-300)).sum(-1)
    return free * np.log(variance) + log_det + 2.0 * logs, variance
