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

"""Clusters of outliers: a scan over windows with a permutation test.

One outlier is an accident; several of one sign at one place, hour or star have a cause. The
outliers of one kind are counted in every window. The least probable count (tail of the
hypergeometric distribution) is compared with that of random permutations of the outliers over all
rows (Kulldorff 1997, Commun. Stat. Theory Methods 26, 1481, for counts of rows).
"""

from typing import NamedTuple

import numpy as np

#: fewest outliers of one kind in a cluster
FEWEST = 3
#: family-wise significance level of a cluster, over all windows and kinds
CHANCE = 0.01
_DEALS = 999  # permutations
#: most windows (more are thinned evenly), and most clusters in a run
_MOST, _CLUSTERS = 8000, 3


class Window(NamedTuple):
    """Rows that may hold a cluster of outliers.

    Attributes
    ----------
    what : str
        Quantity in which it is a window, in one word.
    rows : ndarray of int
    """

    what: str
    rows: np.ndarray


class Cluster(NamedTuple):
    """A cluster of outliers.

    Attributes
    ----------
    kind : int
        Kind of the outliers.
    rows : ndarray of int
        The outliers of that kind in the window.
    window : Window
        The window with the least probable count.
    chance : float
        Family-wise p over all windows and kinds, by permutation.
    """

    kind: int
    rows: np.ndarray
    window: Window
    chance: float


def clusters(kind, windows, rng):
    """Clusters of outliers of one kind, the least probable first.

    Parameters
    ----------
    kind : ndarray of int, shape (n,)
        Kind of outlier of each row; 0: no outlier.
    windows : sequence of Window
    rng : numpy.random.Generator

    Returns
    -------
    list of Cluster
    """
    kind, out = np.array(kind, np.int8), []
    windows = list(windows)[::-(-len(windows) // _MOST) or 1]
    if not windows:
        return out
    inside = np.zeros((len(windows), len(kind)), np.float32)
    for row, window in zip(inside, windows):
        row[window.rows] = 1.0
    while len(out) < _CLUSTERS:
        found = _rarest(kind, windows, inside, rng)
        if found is None:
            break
        out.append(found)
        kind[found.rows] = 0
    return out


def _rarest(kind, windows, inside, rng):
    """The least probable `Cluster`; None where none is significant."""
    kinds = [k for k in np.unique(kind) if k and np.count_nonzero(kind == k) >= FEWEST]
    if not kinds:
        return None
    size = inside.sum(axis=1).astype(int)
    each = [(k, _log_tails(np.count_nonzero(kind == k), size, len(kind))) for k in kinds]
    scores = [_scores(tails, (kind == k)[None], inside) for k, tails in each]
    best = int(np.argmin([one.min() for one in scores]))
    score, at = float(scores[best].min()), int(np.argmin(scores[best][0]))
    if score >= np.log(CHANCE):
        return None
    dealt = rng.permuted(np.tile(kind, (_DEALS, 1)), axis=1)
    least = np.min([_scores(tails, dealt == k, inside).min(axis=1) for k, tails in each], axis=0)
    chance = (1 + np.count_nonzero(least <= score + 1e-9)) / (_DEALS + 1)
    if chance > CHANCE:
        return None
    rows = windows[at].rows
    return Cluster(int(kinds[best]), np.sort(rows[kind[rows] == kinds[best]]), windows[at], chance)


def _log_tails(count, size, n):
    """ln P(at least 0, 1, ... of `count` outliers in `size` of `n` rows), shape (w, count + 1)."""
    from scipy.special import gammaln

    def log_ways(k, of):
        possible = (k >= 0) & (k <= of)
        k = np.where(possible, k, 0)
        return np.where(possible, gammaln(of + 1) - gammaln(k + 1) - gammaln(of - k + 1), -np.inf)
    sizes, which = np.unique(size, return_inverse=True)
    sizes, found = sizes[:, None], np.arange(count + 1)
    each = log_ways(found, sizes) + log_ways(count - found, n - sizes) - log_ways(count, n)
    tails = np.logaddexp.accumulate(each[:, ::-1], axis=1)[:, ::-1]
    return np.where(found < FEWEST, 0.0, tails)[which]


def _scores(tails, marked, inside):
    """ln of the tail probability of each window's count, (b, w); `marked`, shape (b, n)."""
    counts = (marked.astype(np.float32) @ inside.T).astype(int)
    return tails[np.arange(len(tails)), counts]
