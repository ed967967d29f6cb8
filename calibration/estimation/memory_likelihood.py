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

"""Variance and correlation time (memory) of correlated noise, by restricted likelihood.

The maximum of the restricted likelihood (Patterson and Thompson 1971, Biometrika 58, 545; REML)
over a grid of correlation times and variances of `correlated_noise`.
"""

from copy import copy

import numpy as np

from .correlated_noise import AT_ONCE, EIGEN, MEMORY_STEP, AxisNoise, AxisRows, WhiteNoise

#: ratio of successive sizes tried (variance over that of the white noise); then the grid is refined
#: by half a step about the best size and memory
_SIZE_STEP = 10.0
_SIZES = _SIZE_STEP ** np.arange(-1.0, 3.0)
_FINER = _SIZE_STEP ** np.arange(-1.5, 3.0, 0.5)
_ABOUT = np.array([(longer, larger) for longer in (-0.5, 0.0, 0.5) for larger in (-0.5, 0.0, 0.5)
                   if longer or larger])


def noise_memory(sequence, root, scale, columns, b):
    """Estimate the correlated noise of each axis by restricted likelihood.

    Parameters
    ----------
    sequence : Sequence
    root : ndarray, shape (2n,)
        1 / sigma of a fit with white noise.
    scale : ndarray, shape (2,)
        Scale of that noise, see `WeightedFit.scale`.
    columns : GroupColumns
        Fitted columns; groups are runs, or parts of them.
    b : ndarray, shape (2n,)

    Returns
    -------
    tuple of AxisNoise
        Noise of x and y.
    """
    return MemorySearch(sequence, root, scale, columns, b).noise()


class MemorySearch:
    """`noise_memory` with all columns and without some, sharing most of the work.

    For the parameters see `noise_memory`.
    """

    def __init__(self, sequence, root, scale, columns, b):
        self._memories, self._scale, self._with_factor = sequence.memories, scale, None
        self._axes = [AxisLikelihood(sequence, axis, False, root, scale, columns, b)
                      for axis in (0, 1)]
        self._of_all = {}  # noise of each axis with all columns

    def noise(self, without=()):
        """`AxisNoise` of x and y, without some of the common columns (indices)."""
        return tuple(self._of_axis(axis, without) if every.has(without) else self._known(axis)
                     for axis, every in enumerate(self._axes))

    def _known(self, axis):
        if axis not in self._of_all:
            self._of_all[axis] = self._of_axis(axis, ())
        return self._of_all[axis]

    def _of_axis(self, axis, without):
        every = self._axes[axis]
        best, likelihood = AxisNoise(scale=self._scale[axis]), every.without(without)
        if not likelihood.few:
            best = likelihood.climb(self._memories, _SIZES, best)
        if axis == 0 and best.gain > 0.0:
            # the likelihood with the factor is similar: start at the best noise without it
            self._with_factor = self._with_factor or every.with_factor()
            likelihood = self._with_factor.without(without)
            size = best.variance / (best.scale / self._scale[0])**2 / likelihood.typical
            best = likelihood.climb([best.memory], [size], best)
        return best


def likely_memories(sequence, root, memory, scale, columns, b):
    """Possible noises of each axis with posterior probabilities, for one estimate is too certain.

    Prior: 1/2 for white noise, 1/2 spread evenly over the logarithms of memory and size.

    Parameters
    ----------
    sequence, root, scale, columns, b
        See `noise_memory`.
    memory : tuple of AxisNoise
        The estimate.

    Returns
    -------
    list of (list of AxisNoise, ndarray)
        For x and y: noises, the first of them white, and their probabilities.
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
    """All pairs of memories and sizes, each shape (m s,)."""
    return np.repeat(memories, len(sizes)), np.tile(sizes, len(memories))


class AxisLikelihood:
    """The restricted likelihood of the noise of one axis; for the parameters see `noise_memory`.

    Attributes
    ----------
    few : bool
        Too few rows to determine the columns and a noise.
    typical : float
        Typical (median) variance of the white noise.
    """

    def __init__(self, sequence, axis, scaled, root, scale, columns, b):
        n = len(b) // len(scale)
        part = slice(axis * n, (axis + 1) * n)
        own = columns.own[:, part]
        own = own[np.abs(own).max(axis=1, initial=0.0) > 0.0]
        # a basis of the columns on this axis, for dependent ones would leave rounding errors
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
        self._products = {}  # for each noise
        self._turn(np.eye(len(self._common.T)))

    def _turn(self, basis):
        """Set the design to the span with this basis (j, k)."""
        self._basis = np.zeros((len(basis) + 1, len(basis.T) + 1))
        self._basis[:-1, :-1], self._basis[-1, -1] = basis, 1.0
        self.few = len(self._rows.rows) < len(basis) + self._own * len(self._rows.starts) + 3
        if not self.few:
            self._none = float(self._of(None)[0][0])

    def has(self, columns):
        """Whether any of the common columns (indices) is not zero on the axis."""
        return bool(self._common[list(columns)].any())

    def without(self, columns):
        """The likelihood without some of the common columns (indices)."""
        if not len(columns):
            return self
        out = copy(self)
        out._turn(self._alone(np.delete(self._common, columns, axis=0)).basis().common)
        return out

    def with_factor(self):
        """The likelihood of a process scaled by the factor of the sequence."""
        out = copy(self)
        out._set(True)
        return out

    def climb(self, memories, sizes, best):
        """The best noise of a grid and of a finer one about its best, or `best` if better."""
        if not len(memories):
            return best
        tried = self._tried(*_grid(memories, sizes))
        memory, size, value, _ = tried[:, int(np.argmin(tried[2]))]
        if value < self._none:
            tried = np.hstack((tried, self._tried(memory * MEMORY_STEP**_ABOUT[:, 0],
                                                  size * _SIZE_STEP**_ABOUT[:, 1])))
        return max(best, self._noise(*tried[:, int(np.argmin(tried[2]))]), key=lambda one: one.gain)

    def at(self, memories, sizes):
        """`AxisNoise` of each pair of memory and size (variance over that of the white noise)."""
        return [self._noise(*one) for one in self._tried(memories, sizes).T]

    def _tried(self, memories, sizes):
        """Memories, sizes, -2 ln L and variances, shape (4, t)."""
        noises = np.array([memories, sizes])
        return np.vstack((noises, self._of(noises) if len(noises.T) else noises))

    def _noise(self, memory, size, value, variance):
        return AxisNoise(float(size * self.typical * variance), float(memory), self._scaled,
                         self._scale * float(np.sqrt(variance)), float(self._none - value))

    def _of(self, noises):
        """-2 ln L restricted (but for a constant) of noises, and the variance factor of the rows.

        `noises` : memories and sizes, shape (2, t); None: white noise.
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
        """Products of whitened columns, shape (k, t, m), for `restricted`, for each noise.

        The first columns are those that each run fits for itself. Runs are uncorrelated, so these
        are projected out run by run.

        Returns
        -------
        products : ndarray, shape (t, j, j)
        log_det : ndarray, shape (t,)
            Including the determinants of the normal matrices of the runs' own columns.
        taken : ndarray of int, shape (t,)
            Number of coefficients projected out.
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
    """-2 ln L restricted, with the variance factor estimated from the rows.

    Parameters
    ----------
    products : ndarray, shape (..., k + 1, k + 1)
        Products of the whitened columns: the (independent) columns of the design, then the data.
    log_det : float or ndarray, shape (...)
        ln of the determinant of the covariance, but for the variance factor.
    free : int or ndarray, shape (...)
        Rows less the coefficients already projected out.

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
