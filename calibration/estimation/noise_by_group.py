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

"""Rows of several instruments or objects in one fit: each group has its own noise.

The white noise of a group is estimated from its own rows. One arc of a satellite hardly determines
the correlated noise: a short correlation time with the observed scatter and a long one with far
more variance look alike in it. So groups with correlated noise share the correlation time (memory)
and the ratio of its variance to the white noise, the same on both axes. All rows, with all columns
and priors of the coefficients, give the posterior probability of each such noise, and the fit is
the average over them with these probabilities.
"""

from dataclasses import dataclass

import numpy as np

from .correlated_noise import AxisNoise, CorrelatedNoise, Sequence
from .group_columns import GroupColumns
from .linear_model import memory_of, weighted_fit
from .prior_fit import PriorFit, gram_of

#: fewest rows to estimate a correlation time
LEAST_ROWS = 20
#: ratio of successive correlation times tried
_MEMORY_STEP = 2.0
#: variances of the process tried, over that of the white noise
_SIZES = 4.0 ** np.arange(-2.0, 3.0)
#: probability, relative to the most likely noise, below which a noise is ignored
_UNLIKELY = 1e-4
_MOST = 12  # most noises averaged
#: degrees of freedom needed to estimate the noise of a group from its own rows; nonzero values that
#: a column must have there: one with fewer would fit whatever is in these rows
_FREEDOM, _SUPPORT = 20, 10
_BESIDE = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


@dataclass
class GroupNoise:
    """Noise of all rows, of which some are correlated.

    Attributes
    ----------
    root : ndarray, shape (2n,)
        1 / sigma of the white part, 0 for excluded rows.
    rows : ndarray of int
        Rows with correlated noise.
    process : CorrelatedNoise or None
        Noise of these rows.
    """

    root: np.ndarray
    rows: np.ndarray
    process: CorrelatedNoise | None

    def whiten(self, values):
        """Whitened values, shape (..., 2n)."""
        out = values * self.root
        if self.process is not None:
            both = np.concatenate((self.rows, self.rows + len(self.root) // 2))
            out[..., both] = self.process.whiten(values[..., both])
        return out

    @property
    def count(self):
        """Number of values with weight."""
        return int(np.count_nonzero(self.root))

    @property
    def log_det(self):
        """ln of the determinant of the covariance of the correlated rows."""
        if self.process is not None:
            return self.process.log_det
        n = len(self.root) // 2
        root = self.root[np.concatenate((self.rows, self.rows + n))]
        return -2.0 * float(np.log(root[root > 0.0]).sum())


def group_roots(columns, b, groups, time, run, factor, memory):
    """White noise of each group from its own rows; with few rows, that of the other groups.

    Parameters
    ----------
    columns : ndarray, shape (k, 2n)
        All fitted columns.
    b : ndarray, shape (2n,)
        Radians.
    groups : ndarray of int, shape (n,)
        0, 1, ...
    time : ndarray, shape (n,)
        s.
    run : ndarray of int, shape (n,)
        Arc of each row; different arcs are uncorrelated.
    factor : ndarray, shape (n,)
        See `Sequence`.
    memory : sequence of bool
        Whether the noise of each group may be correlated.

    Returns
    -------
    root : ndarray, shape (2n,)
        1 / sigma, with robust weights.
    weights : ndarray, shape (n,)
    """
    n = len(b) // 2
    root, weights, few = np.zeros(2 * n), np.ones(n), []
    for group, remembers in enumerate(memory):
        rows = np.flatnonzero(groups == group)
        both = np.concatenate((rows, rows + n))
        own = columns[:, both]
        own = own[np.count_nonzero(own, axis=1) >= _SUPPORT]
        if 2 * len(rows) < len(own) + _FREEDOM:
            few.append(both)
            continue
        own = GroupColumns.alone(own)
        fit = weighted_fit(own, b[both], final=True)
        white = np.ones(2)
        if remembers and len(rows) >= LEAST_ROWS:
            found = memory_of(fit, own, Sequence(time[rows], run[rows], factor[rows]))
            white = [one.scale / s for one, s in zip(found, fit.scale)]
        root[both] = fit.noise.root / np.repeat(white, len(rows))
        weights[rows] = fit.weights
    if few:
        known = white_sigmas(root)
        if not (known > 0.0).all():  # no group has enough rows: use all together
            known = weighted_fit(GroupColumns.alone(columns), b, final=True).scale
        for both in few:
            root[both] = np.repeat(1.0 / known, len(both) // 2)
    return root, weights


def likely_noises(columns, b, precision, root, rows, sequence):
    """Possible noises of all rows with their posterior probabilities.

    Parameters
    ----------
    columns, b
        See `group_roots`.
    precision : ndarray, shape (k, k)
        Inverse prior covariance of the coefficients.
    root : ndarray, shape (2n,)
    rows : ndarray of int
        Rows whose noise may be correlated.
    sequence : Sequence
        Sequence of these rows.

    Returns
    -------
    list of (GroupNoise, float)
        Most probable first; probabilities sum to 1. Prior: 1/2 for white noise, 1/2 spread evenly
        over the logarithms of memory and size.
    """
    n = len(b) // 2
    found = {(): (GroupNoise(root, rows, None), 0.0)}
    memories = _memories(sequence) if len(rows) >= LEAST_ROWS else np.empty(0)
    own = root.reshape(2, n)[:, rows].ravel()
    white = [float(np.median(1.0 / np.square(part[part > 0.0]))) if np.any(part > 0.0) else 0.0
             for part in np.split(own, 2)]

    def try_noise(i, j):
        if (i, j) in found or not (0 <= i < len(memories) and 0 <= j < len(_SIZES)):
            return
        of_axes = tuple(AxisNoise(_SIZES[j] * one, memories[i]) for one in white)
        noise = GroupNoise(root, rows, CorrelatedNoise(own, sequence, of_axes))
        found[i, j] = noise, (_evidence(columns, b, precision, noise)
                              - np.log(len(memories) * len(_SIZES)))

    found[()] = found[()][0], _evidence(columns, b, precision, found[()][0])
    # every second grid point first, then the neighbours of probable ones
    for i in range(0, len(memories), 2):
        for j in range(0, len(_SIZES), 2):
            try_noise(i, j)
    most = max(log for _, log in found.values())
    for i, j in [at for at, (_, log) in found.items() if at and log > most + np.log(_UNLIKELY)]:
        for di, dj in _BESIDE:
            try_noise(i + di, j + dj)
    tried, logs = zip(*found.values())
    chance = np.exp(np.array(logs) - max(logs))
    chance[chance < _UNLIKELY] = 0.0
    best = np.argsort(-chance)[:_MOST]
    best = best[chance[best] > 0.0]
    return [(tried[i], float(chance[i] / chance[best].sum())) for i in best]


def _memories(sequence):
    gap = sequence.gap[np.isfinite(sequence.gap) & (sequence.gap > 0.0)]
    if not len(gap):
        return gap
    first = 2.0 * np.quantile(gap, 0.1)
    count = int(np.floor(np.log(max(sequence.span / first, 1.0)) / np.log(_MEMORY_STEP))) + 1
    return first * _MEMORY_STEP ** np.arange(count)


def _evidence(columns, b, precision, noise):
    fit = PriorFit(gram_of(noise.whiten(columns), noise.whiten(b)), noise.count, precision)
    return fit.evidence - 0.5 * noise.log_det


def white_sigmas(root):
    """Median sigma of x and y of the rows with weight, shape (2,)."""
    return np.array([1.0 / np.median(part[part > 0.0]) if np.any(part > 0.0) else 0.0
                     for part in np.split(root, 2)])
