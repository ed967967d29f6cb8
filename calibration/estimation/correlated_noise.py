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

"""Correlated noise: white noise plus a process with exponentially decaying correlation.

The noise of an axis is white plus a stationary process with the correlation exp(-dt / tau)
(Ornstein and Uhlenbeck; a random walk where tau is far longer than the run). In the order of time,
differences e_i - phi_i e_(i-1) of such rows have a tridiagonal covariance: rows are whitened in
O(n). `memory_likelihood` estimates its variance and its correlation time, called the memory.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .lapack import lapack

#: eigenvalues of a normal matrix of unit columns below this part of the largest are rounding: with
#: 1e5 rows its entries are precise to some 1e-13
EIGEN = 1e-10
#: ratio of successive correlation times tried
MEMORY_STEP = 4.0
#: most numbers whitened at a time, when several noises are tried
AT_ONCE = 200_000


class Sequence:
    """The order in which rows were observed, and the gaps between them.

    Parameters
    ----------
    position : ndarray, shape (n,)
        Time (s), or the place in the order.
    run : ndarray of int, shape (n,)
        Run of each row; rows of different runs are uncorrelated.
    factor : ndarray, shape (n,)
        Factor of each row by which the process on the first axis may be scaled: cos E if it is an
        angle of the azimuth axis.
    timed : bool
        Whether the position is a time.
    group : ndarray of int, shape (n,), optional
        Rows of one star within minutes share a number, and are held out together.
    """

    def __init__(self, position, run, factor, timed=True, group=None):
        self.position, self.run, self.factor, self.timed = position, run, factor, timed
        self.group = np.arange(len(run)) if group is None else group
        self.order = np.lexsort((position, run))
        gap = np.diff(position[self.order], prepend=-np.inf)
        gap[np.diff(run[self.order], prepend=run[self.order[:1]]) != 0] = np.inf
        #: gap to the row before in `order`; infinite where a run begins
        self.gap = gap
        self._known = {}

    def rows(self, rows):
        """The sequence of some rows (indices)."""
        return Sequence(self.position[rows], self.run[rows], self.factor[rows], self.timed,
                        self.group[rows])

    def some(self, keep):
        """Rows of a mask (n,) in order, the gap before each, starts and lengths of the runs."""
        key = keep.tobytes()
        if key not in self._known:
            keep = keep[self.order]
            rows = self.order[keep]
            # across excluded rows the gaps add up
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
        """Correlation times to try, from the 10 % quantile of the gaps to four times the span.

        Returns
        -------
        ndarray
            Ascending; empty where no row has a predecessor in its run.
        """
        gap = self.gap[np.isfinite(self.gap) & (self.gap > 0.0)]
        if not len(gap):
            return gap
        first = np.quantile(gap, 0.1)
        count = int(np.ceil(np.log(4.0 * self.span / first) / np.log(MEMORY_STEP))) + 1
        return first * MEMORY_STEP ** np.arange(max(count, 1))


@dataclass(frozen=True)
class AxisNoise:
    """Noise of an axis: white, plus a correlated process.

    Attributes
    ----------
    variance : float
        Variance of the process, rad^2; 0: the noise is white.
    memory : float
        Correlation time of the process, in units of the sequence's position.
    scaled : bool
        Whether the process is scaled by the factor of the sequence.
    scale : float
        Scale of the white part, as `WeightedFit.scale`.
    gain : float
        2 ln of the restricted likelihood ratio against white noise alone.
    """

    variance: float = 0.0
    memory: float = np.inf
    scaled: bool = False
    scale: float = 1.0
    gain: float = 0.0


class WhiteNoise:
    """White noise: a weight for each value.

    Parameters
    ----------
    root : ndarray, shape (2n,)
        1 / sigma of each value, 0 for excluded rows.
    """

    white = True

    def __init__(self, root):
        self.root = root

    def whiten(self, values):
        """Whitened values, shape (..., 2n)."""
        return values * self.root

    def spread(self, values):
        """`values` (..., 2n) scaled so that their squares sum to the variance of values @ noise."""
        return values * _sigma(self.root)

    def without(self, rows):
        """The same noise with some rows (indices of n) excluded."""
        root = self.root.copy()
        root.reshape(2, -1)[:, rows] = 0.0
        return WhiteNoise(root)

    def rows(self, rows):
        """The noise of some rows (indices of n)."""
        return WhiteNoise(self.root.reshape(2, -1)[:, rows].ravel())


class CorrelatedNoise:
    """Correlated noise: weights, and differences of successive rows that whiten them.

    Parameters
    ----------
    root : ndarray, shape (2n,)
        1 / sigma of the white part, 0 for excluded rows.
    sequence : Sequence
    memory : tuple of AxisNoise
        Noise of each axis, such as x and y.
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
        """Correlated noise with the weights and the `scale` of a fit with white `noise`."""
        white = [one.scale / s if one.variance > 0.0 else 1.0 for one, s in zip(memory, scale)]
        return cls(noise.root / np.repeat(white, len(noise.root) // 2), sequence, memory)

    def whiten(self, values):
        """Whitened values, shape (..., 2n); 0 in excluded rows."""
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
        """See `WhiteNoise.spread`."""
        return self._each(values, _sigma(self.root), _Differences.spread)

    def coloured(self, values):
        """Inverse of `whiten`: white noise (..., 2n) turned into this noise; 0 in excluded rows."""
        return self._each(values, _sigma(self.root), _Differences.coloured)

    def process(self, residual):
        """The process predicted from residuals, (..., 2n): its mean given these.

        Simple kriging (Cressie 1993, Statistics for Spatial Data, section 3.2).
        """
        return self._each(residual, 0.0, _Differences.process)

    def _each(self, values, factor, of_axis):
        flat = values.reshape(-1, values.shape[-1])
        out = flat * factor
        for part, axis in self._axes:
            some = flat[:, part].any(axis=1)  # most effects act on one axis
            some = slice(None) if some.all() else np.flatnonzero(some)
            out[some, part] = of_axis(axis, flat[some, part])
        return out.reshape(values.shape)

    @property
    def log_det(self):
        """ln of the determinant of the covariance of the rows with weight."""
        plain = self.root.copy()
        for part, _ in self._axes:
            plain[part] = 0.0
        return float(-2.0 * np.log(plain[plain > 0.0]).sum()
                     + sum(axis.log_det for _, axis in self._axes))

    def rows(self, rows):
        """The noise of some rows (indices of n)."""
        return CorrelatedNoise(self.root.reshape(len(self.memory), -1)[:, rows].ravel(),
                               self._sequence.rows(rows), self.memory)

    def values(self, places):
        """The noise of some values (indices of 2n) of one axis."""
        axis, n = places[0] // len(self._sequence.run), len(self._sequence.run)
        return CorrelatedNoise(self.root[places], self._sequence.rows(places - axis * n),
                               self.memory[axis:axis + 1])

    @property
    def neighbour(self):
        """Correlation of the process of each axis at a distance of 1 in position; 0 if white."""
        return np.array([np.exp(-1.0 / one.memory) if one.variance > 0.0 else 0.0
                         for one in self.memory])


def _sigma(root):
    return 1.0 / np.where(root > 0.0, root, np.inf)


class AxisRows:
    """The rows with weight of one axis, in order, with values scaled to units of the process."""

    def __init__(self, root, sequence, scaled):
        self.all = len(root)
        self.rows, self.gap, self.starts, self.lengths = sequence.some(root > 0.0)
        self._as_they_stand = np.array_equal(self.rows, np.arange(self.all))
        self._scale = 1.0 / sequence.factor[self.rows] if scaled else np.ones(len(self.rows))
        #: variance of the white part
        self.white = np.square(self._scale / root[self.rows])
        # the factor may be negative: beyond the pole an angle moves a star the other way
        self.log_scale = 2.0 * float(np.log(np.abs(self._scale)).sum())

    def of(self, values):
        """Values (k, n) of all rows -> (k, m) of these."""
        return values if self._as_they_stand else values.take(self.rows, axis=1)

    def scaled(self, values):
        """Values (k, n) of all rows -> (k, m) of these, in units of the process."""
        return self.of(values) * self._scale

    def whitened_by(self, columns, memories, variances, white):
        """Columns from `scaled`, whitened by several noises.

        Parameters
        ----------
        columns : ndarray, shape (k, m)
        memories, variances : ndarray, shape (t,)
            Correlation time and variance of the process of each noise.
        white : ndarray, shape (t,)
            Sigma of the white part, in units of that of these rows.

        Returns
        -------
        columns : ndarray, shape (k, t, m)
        log_det : ndarray, shape (t,)
            ln of the determinant of the covariance of the rows.
        """
        # the noises are handled like uncorrelated runs, one after the other
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
        """Inverse of the scaling: values (k, m) of these rows in angles on the sky."""
        return values / self._scale

    def placed(self, values):
        """Values (k, m) of these rows -> (k, n) of all."""
        if self._as_they_stand:
            return values
        out = np.zeros((len(values), self.all))
        out[:, self.rows] = values
        return out


class _Differences:
    """Whitening of one axis by differences of successive rows, values of shape (k, n)."""

    def __init__(self, rows, noise):
        self._rows, self._phi = rows, np.exp(-rows.gap / noise.memory)
        diagonal, self._lower = _factored(self._phi, rows.white, noise.variance)
        self._root = np.sqrt(diagonal)
        #: ln of the determinant of the covariance of the rows with weight
        self.log_det = float(np.log(diagonal).sum()) - rows.log_scale

    def whitened(self, values):
        """Whitened values."""
        return self._rows.placed(_solved(self._phi, self._root, self._lower,
                                         self._rows.scaled(values)))

    def spread(self, values):
        """Inverse of the transposed whitening."""
        u = _bidiagonal(-self._phi[1:], self._rows.unscaled(self._rows.of(values)), 'T')
        u[:, :-1] += self._lower * u[:, 1:]
        return self._rows.placed(u * self._root)

    def process(self, values):
        """Mean of the process given the values: the values less their white part."""
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
    """LDL^T of the covariance of the differences: D (m,) and the subdiagonal of L (m-1,)."""
    before = np.concatenate(([0.0], white[:-1]))
    diagonal = variance * (1.0 - phi * phi) + white + phi * phi * before
    if len(diagonal) < 2:  # see `_bidiagonal`
        return diagonal, diagonal[:0]
    d, lower, info = lapack().dpttrf(diagonal, -phi[1:] * white[:-1])
    if info:
        raise np.linalg.LinAlgError('covariance of correlated noise is not positive definite')
    return d, lower


def _bidiagonal(lower, values, trans='N'):
    """Solve a unit lower bidiagonal system; `values` (k, m) are overwritten."""
    if not values.size:  # LAPACK's routine writes beyond an empty array
        return values
    band = np.ones((2, len(lower) + 1))  # the last entry below the diagonal is not used
    band[1, :-1] = lower
    return lapack().dtbtrs(
        band, values.T, uplo='L', trans=trans, diag='U', overwrite_b=1)[0].T


def _solved(phi, root, lower, values):
    """Whitened values (k, m) of scaled rows, overwritten; `root` (m,): square root of D."""
    values[:, 1:] -= phi[1:] * values[:, :-1]
    values = _bidiagonal(lower, values)
    values /= root
    return values
