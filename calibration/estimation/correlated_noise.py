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
(Ornstein and Uhlenbeck; a random walk where tau is far longer than the run). In the order of time,
differences e_i - phi_i e_(i-1) of such rows have a tridiagonal covariance: rows are whitened in
O(n). How large it is and how long it remembers: `memory_likelihood`.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .lapack import lapack

#: eigenvalues of a normal matrix of unit columns below this part of the largest are rounding: its
#: entries are good to some 1e-13 of 1e5 rows
EIGEN = 1e-10
#: between memories that are tried
MEMORY_STEP = 4.0
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
        count = int(np.ceil(np.log(4.0 * self.span / first) / np.log(MEMORY_STEP))) + 1
        return first * MEMORY_STEP ** np.arange(max(count, 1))


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

    white = True

    def __init__(self, root):
        self.root = root

    def whiten(self, values):
        """Whitened values, shape (..., 2n)."""
        return values * self.root

    def spread(self, values):
        """`values` (..., 2n) such that their squares sum to the variance of values @ noise."""
        return values * _sigma(self.root)

    def without(self, rows):
        """The same with some rows (indices of n) set aside."""
        root = self.root.copy()
        root.reshape(2, -1)[:, rows] = 0.0
        return WhiteNoise(root)

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

    white = False

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
        """Whitened values of x (0) or y (1), shape (m, n)."""
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
        phi = np.exp(-self.gap / np.asarray(memories)[:, None])
        diagonal, lower = _factored(phi.ravel(), np.outer(np.square(white), self.white).ravel(),
                                    np.repeat(variances, n))
        out = np.empty((len(columns), tries, n))
        out[:, :, 0] = columns[:, :1]
        np.multiply(phi[:, 1:], columns[:, None, :-1], out=out[:, :, 1:])
        np.subtract(columns[:, None, 1:], out[:, :, 1:], out=out[:, :, 1:])
        out = _bidiagonal(lower, out.reshape(len(columns), tries * n))
        out *= 1.0 / np.sqrt(diagonal)
        return (out.reshape(len(columns), tries, n),
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
    d, lower, info = lapack().dpttrf(diagonal, -phi[1:] * white[:-1])
    if info:
        raise np.linalg.LinAlgError('covariance of correlated noise is not positive definite')
    return d, lower


def _bidiagonal(lower, values, trans='N'):
    """Solution with a unit lower bidiagonal matrix; values (k, m) are overwritten."""
    if not values.size:  # LAPACK's routine writes beyond an empty array
        return values
    band = np.ones((2, len(lower) + 1))  # the last below the diagonal is not looked at
    band[1, :-1] = lower
    return lapack().dtbtrs(
        band, values.T, uplo='L', trans=trans, diag='U', overwrite_b=1)[0].T


def _solved(phi, root, lower, values):
    """Values (k, m) of scaled rows, whitened; `root` (m,) of the diagonal; they are overwritten."""
    values[:, 1:] -= phi[1:] * values[:, :-1]
    values = _bidiagonal(lower, values)
    values /= root
    return values
