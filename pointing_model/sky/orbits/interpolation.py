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

"""Positions between the epochs of an ephemeris: Lagrange, and Hermite where velocities help.

Lagrange's polynomial in its barycentric form (Berrut and Trefethen 2004, SIAM Review 46, 501),
Hermite's by the squares of Lagrange's factors. Both through any epochs, the nearest about a time
or, at the ends, those on one side.
"""

import numpy as np


def window(epochs, time, count):
    """Which epochs a polynomial goes through.

    Parameters
    ----------
    epochs : ndarray, shape (n,)
        Ascending.
    time : ndarray, shape (m,)
    count : int
        Of epochs; at most n.

    Returns
    -------
    ndarray of int, shape (m, count)
        As many before the time as after it, where there are.
    """
    first = np.searchsorted(epochs, time, 'right') - count // 2
    if count % 2:  # the nearest in the middle
        near = np.clip(first + count // 2, 1, len(epochs) - 1)
        first += time - epochs[near - 1] > epochs[near] - time
        first -= 1
    return np.clip(first, 0, len(epochs) - count)[:, None] + np.arange(count)


def _weights(nodes):
    """Barycentric weights of nodes, shape (m, k), and what they differ by, (m, k, k)."""
    spacing = nodes[:, :, None] - nodes[:, None, :]
    k = np.arange(nodes.shape[1])
    spacing[:, k, k] = 1.0
    return 1.0 / np.prod(spacing, axis=2), spacing


def _in_units(epochs, rows, time):
    """Nodes and time of each window from its middle on, in steps of it, and the step."""
    nodes = epochs[rows]
    middle, step = nodes[:, [nodes.shape[1] // 2]], (nodes[:, 1] - nodes[:, 0])[:, None]
    return (nodes - middle) / step, (time[:, None] - middle) / step, step


def lagrange(epochs, values, time, count):
    """Polynomial of degree count - 1 through the epochs about each time.

    Parameters
    ----------
    epochs : ndarray, shape (n,)
    values : ndarray, shape (n, c)
    time : ndarray, shape (m,)
    count : int

    Returns
    -------
    ndarray, shape (m, c)
    """
    rows = window(epochs, time, count)
    starts, which = np.unique(rows[:, 0], return_inverse=True)
    nodes, _, _ = _in_units(epochs, starts[:, None] + np.arange(count), epochs[starts])
    weights = _weights(nodes)[0][which]
    nodes, at, _ = _in_units(epochs, rows, time)
    off = at - nodes
    hit = off == 0.0
    factor = np.where(hit.any(axis=1)[:, None], hit, weights / np.where(hit, 1.0, off))
    factor /= factor.sum(axis=1)[:, None]
    return np.einsum('mk,mkc->mc', factor, values[rows])


def hermite(epochs, values, rates, time, count):
    """Polynomial of degree 2 count - 1 through values and rates of the epochs about each time.

    Parameters
    ----------
    epochs : ndarray, shape (n,)
    values, rates : ndarray, shape (n, c)
        The rates in units of the values in that of the epochs.
    time : ndarray, shape (m,)
    count : int

    Returns
    -------
    ndarray, shape (m, c)
    """
    rows = window(epochs, time, count)
    nodes, at, step = _in_units(epochs, rows, time)
    weights, spacing = _weights(nodes)
    same = np.eye(count, dtype=bool)
    slope = np.where(same, 0.0, 1.0 / spacing).sum(axis=2)
    off = at - nodes
    factor = np.square(np.prod(np.where(same, 1.0, off[:, None, :]), axis=2) * weights)
    by_value = (1.0 - 2.0 * slope * off) * factor
    return (np.einsum('mk,mkc->mc', by_value, values[rows])
            + np.einsum('mk,mkc->mc', off * factor * step, rates[rows]))
