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

"""Values that scatter beyond their sigmas: from night to night more than one of them shows."""

import numpy as np

_HALVINGS = 60  # of an interval that holds the extra variance
#: chance below which a pattern of sigmas is no chance, and exchanges that give it
_LEVEL, _EXCHANGES = 0.05, 499


def are_borne_out(values, design, variances):
    """Whether values scatter more where their sigmas are larger: else these are no guide.

    A line leaves less, in units of the sigmas, than with these exchanged at random. Sigmas whose
    pattern is wrong would make causes of chance.

    Parameters
    ----------
    values, design, variances
        As of `whitening`.

    Returns
    -------
    bool
    """
    rng = np.random.default_rng(1)
    weights = 1.0 / rng.permuted(np.tile(variances, (_EXCHANGES + 1, 1)), axis=1)
    weights[0] = 1.0 / variances
    weighted = weights[:, :, np.newaxis] * design  # of each exchange, (n, k)
    line = np.linalg.pinv(design.T @ weighted) @ (values @ weighted)[:, :, np.newaxis]
    left = (weights * np.square(values - (design @ line)[:, :, 0])).sum(axis=1)
    return bool(np.mean(left <= left[0] * (1.0 + 1e-9)) < _LEVEL)


def whitening(values, design, variances, differences=False):
    """Makes the errors of values alike: given ones, and a scatter of all beyond these.

    The extra variance is the one with which what a line leaves is as large as it should be (Paule
    and Mandel 1982), so that sigmas that are far too small weigh nearly alike.

    Parameters
    ----------
    values : ndarray, shape (n,)
    design : ndarray, shape (n, k)
        Columns of the line.
    variances : ndarray, shape (n,), of differences (n + 1,)
        Squares of the sigmas; where all are the same, nothing is changed.
    differences : bool
        Whether the values are the differences of neighbours of what has these sigmas: two share
        the error that is between them.

    Returns
    -------
    ndarray, shape (n, n)
    """
    n, least = len(values), variances.min()
    if not np.ptp(variances) > 0.0:
        return np.eye(n)
    # what all have in common is scatter of the values, beside the rest
    rest = np.diag(variances - least)
    if differences:
        rest = np.diff(np.diff(rest, axis=0), axis=1)
    own, axes = np.linalg.eigh(rest)
    own, values, design = np.maximum(own, 0.0), axes.T @ values, axes.T @ design
    dof = n - np.linalg.matrix_rank(design)

    def excess(extra):
        root = 1.0 / np.sqrt(own + extra)
        columns = design * root[:, np.newaxis]
        left = values * root - columns @ np.linalg.lstsq(columns, values * root)[0]
        return left @ left - dof
    low = high = least
    if dof > 0 and excess(least) > 0.0:
        while excess(high) > 0.0:
            low, high = high, 4.0 * high
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return axes * np.sqrt((least + high) / (own + high)) @ axes.T
