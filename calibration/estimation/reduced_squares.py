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

"""Reduction of the residual sum of squares by groups of few columns, for very many groups."""

from functools import cache

import numpy as np

from .linear_model import DISTINCT


@cache
def each_two(d):
    """Pairs of `d` columns, shape (2, q)."""
    return np.array(np.triu_indices(d, 1))


def directions(gram):
    """Factors that make groups of unit columns orthonormal.

    Parameters
    ----------
    gram : ndarray, shape (..., d, d)
        Products of the columns of each group, orthogonal to the model.

    Returns
    -------
    factor : ndarray, shape (..., d, d)
        Columns are zero for directions below the limit `DISTINCT`.
    dof : ndarray of int, shape (...)
        Number of directions.
    """
    values, vectors = _eigen(gram)
    keep = values > DISTINCT**2
    return (vectors * np.where(keep, 1.0 / np.sqrt(np.where(keep, values, 1.0)), 0.0)[..., None, :],
            keep.sum(axis=-1))


def _eigen(gram):
    """`numpy.linalg.eigh`, but ten times as fast for many 1 x 1 or 2 x 2 matrices."""
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
    if a.shape[-2] == 1:  # `@` would take ten times as long
        return (a * b).sum(axis=-1, keepdims=True)
    return a @ np.swapaxes(b, -1, -2)


def _times(a, b):
    """`a @ b`, but ten times as fast for many 1 x 1 matrices."""
    return a * b if a.shape[-1] == 1 else a @ b


def reduced_squares(squares, across, length):
    """Residual sums of squares of each axis, with each group added to the model in turn.

    Parameters
    ----------
    squares : sequence of ndarray, shape (..., m)
        Residual sums of squares of each axis without the groups.
    across : sequence of (ndarray of shape (..., G, d, d), ndarray of shape (..., G, d, m))
        For each axis, products of the groups (orthogonal to the model) with themselves, and with
        the residuals.
    length : ndarray, shape (..., G, d)
        Lengths of the columns, before the model was projected out.

    Returns
    -------
    left : list of ndarray, shape (..., G, m)
        In the number type of the products with the residuals.
    dof : ndarray of int, shape (..., G)
        Directions that each group adds.
    """
    own, with_left = map(sum, zip(*across))
    # the tail of a bump beside the rows: one over its length is infinite in single precision
    scale = 1.0 / np.where(length > 1e-30, length, 1.0)[..., None]
    factor, dof = directions(own * scale * np.swapaxes(scale, -1, -2))
    kind = with_left.dtype
    factor = (factor * scale).astype(kind, copy=False)
    fitted = _times(factor, _times(np.swapaxes(factor, -1, -2), with_left))
    return [square[..., None, :].astype(kind, copy=False) - (fitted * (
        2.0 * with_one - _times(of.astype(kind, copy=False), fitted))).sum(axis=-2)
        for square, (of, with_one) in zip(squares, across)], dof
