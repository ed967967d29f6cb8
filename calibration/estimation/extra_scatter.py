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

"""Values with more scatter than their sigmas, such as terms from night to night."""

import numpy as np

_HALVINGS = 60  # bisections for the extra variance
#: significance level of a pattern of sigmas, and permutations that give its p
_LEVEL, _EXCHANGES = 0.05, 499


def are_borne_out(values, design, variances):
    """Whether values scatter more where their sigmas are larger: otherwise these are no guide.

    Permutation test: residuals of a line, in units of the sigmas, are smaller than with the sigmas
    permuted at random. Sigmas with a wrong pattern would produce false causes.

    Parameters
    ----------
    values, design, variances
        See `whitening`.

    Returns
    -------
    bool
    """
    rng = np.random.default_rng(1)
    weights = 1.0 / rng.permuted(np.tile(variances, (_EXCHANGES + 1, 1)), axis=1)
    weights[0] = 1.0 / variances
    weighted = weights[:, :, np.newaxis] * design  # for each permutation, (n, k)
    line = np.linalg.pinv(design.T @ weighted) @ (values @ weighted)[:, :, np.newaxis]
    left = (weights * np.square(values - (design @ line)[:, :, 0])).sum(axis=1)
    return bool(np.mean(left <= left[0] * (1.0 + 1e-9)) < _LEVEL)


def whitening(values, design, variances, differences=False):
    """Matrix that whitens values with given errors and a common extra scatter.

    The extra variance makes the chi-squared of the residuals from a line equal to its degrees of
    freedom (Paule and Mandel 1982), so that values with far too small sigmas get nearly equal
    weights.

    Parameters
    ----------
    values : ndarray, shape (n,)
    design : ndarray, shape (n, k)
        Columns of the line.
    variances : ndarray, shape (n,), or (n + 1,) for differences
        Squares of the sigmas. If all are equal, the matrix is the identity.
    differences : bool
        Whether `values` are differences of neighbours of a series with these sigmas. Successive
        differences then share an error.

    Returns
    -------
    ndarray, shape (n, n)
    """
    n, least = len(values), variances.min()
    if not np.ptp(variances) > 0.0:
        return np.eye(n)
    # the smallest variance is common to all values, like the extra scatter
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
