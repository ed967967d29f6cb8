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

"""What groups of a few columns take off sums of squares, of very many groups at a time."""

from functools import cache

import numpy as np

from .linear_model import DISTINCT


@cache
def each_two(d):
    """Pairs of `d` columns, shape (2, q)."""
    return np.array(np.triu_indices(d, 1))


def directions(gram):
    """What makes groups of unit columns orthonormal, of their products beyond the model.

    Parameters
    ----------
    gram : ndarray, shape (..., d, d)

    Returns
    -------
    factor : ndarray, shape (..., d, d)
        Zero columns where a group has fewer directions of its own than `DISTINCT` asks for.
    dof : ndarray of int, shape (...)
        Directions.
    """
    values, vectors = _eigen(gram)
    keep = values > DISTINCT**2
    return (vectors * np.where(keep, 1.0 / np.sqrt(np.where(keep, values, 1.0)), 0.0)[..., None, :],
            keep.sum(axis=-1))


def _eigen(gram):
    """As `numpy.linalg.eigh`, which takes ten times as long of many that are this small."""
    if gram.shape[-1] == 1:
        return gram[..., 0], np.ones_like(gram)
    if gram.shape[-1] > 2:
        return np.linalg.eigh(gram)
    a, b, c = gram[..., 0, 0], gram[..., 0, 1], gram[..., 1, 1]
    middle, half = 0.5 * (a + c), 0.5 * (c - a)
    away, turn = np.hypot(half, b), 0.5 * np.arctan2(b, half)
    cos, sin = np.cos(turn), np.sin(turn)
    return (np.stack((middle - away, middle + away), axis=-1),
            np.stack((cos, sin, -sin, cos), axis=-1).reshape(gram.shape))


def times_rows(a, b):
    """Products of the rows of many small matrices, (..., d, k) each: shape (..., d, d)."""
    if a.shape[-2] == 1:  # one by one `@` would take ten times as long
        return (a * b).sum(axis=-1, keepdims=True)
    return a @ np.swapaxes(b, -1, -2)


def _times(a, b):
    """As `a @ b`, which takes ten times as long of many 1 x 1."""
    return a * b if a.shape[-1] == 1 else a @ b


def reduced_squares(squares, across, length):
    """Sums of squares of each axis of what is left, with each group in the model too.

    Parameters
    ----------
    squares : sequence of ndarray, shape (..., m)
        Of each axis, without the groups.
    across : sequence of (ndarray of shape (..., G, d, d), ndarray of shape (..., G, d, m))
        Of each axis, products of the groups beyond the model with themselves, and with what is
        left.
    length : ndarray, shape (..., G, d)
        Of the columns, before the model took its part.

    Returns
    -------
    left : list of ndarray, shape (..., G, m)
        As precise as the products with what is left.
    dof : ndarray of int, shape (..., G)
    """
    own, with_left = map(sum, zip(*across))
    scale = 1.0 / np.where(length > 0.0, length, 1.0)[..., None]
    factor, dof = directions(own * scale * np.swapaxes(scale, -1, -2))
    kind = with_left.dtype
    factor = (factor * scale).astype(kind, copy=False)
    fitted = _times(factor, _times(np.swapaxes(factor, -1, -2), with_left))
    return [square[..., None, :].astype(kind, copy=False) - (fitted * (
        2.0 * with_one - _times(of.astype(kind, copy=False), fitted))).sum(axis=-2)
        for square, (of, with_one) in zip(squares, across)], dof
