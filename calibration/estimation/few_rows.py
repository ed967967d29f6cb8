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

"""Outlier rejection in fits of few rows.

With few degrees of freedom robust weights mislead: their noise is estimated from the same few
residuals, and a row with high leverage has a small residual however wrong it is. Here a row counts
in full or not at all. The test statistic is its deleted studentised residual (the error with which
a fit without it predicts it, over the standard error of that prediction; Cook and Weisberg 1982,
section 2.2), each axis with its own noise, whose degrees of freedom are Satterthwaite's (1946).
Rows are removed one by one, worst first; all up to the last significant one are rejected (Rosner
1983), so that two wrong rows do not mask each other.
"""

import numpy as np

from .least_squares import satterthwaite
from .step_scan import two_sided

#: degrees of freedom below which rows may be few: 2 sigma then cover less than 95 %
FEW = 30
#: degrees of freedom for each coefficient up to which robust weights mislead (`are_few`): they
#: reject a good row of 6 in 7 % of runs, of 8 in 2 % with seven terms, of 5 in 7 % with two zeros
_FEW_EACH = 4
#: family-wise probability that a fit with normal noise rejects any row, by Bonferroni over rows and
#: axes; 0.01 finds no more wrong stars of 60 sigma, and rejects three times as many good ones of
#: t(4) noise
LEVEL = 0.002
#: degrees of freedom of an axis, without the row, that its test needs. With seven terms that takes
#: 8 rows. With 1.5, a wrong row of 6 is found in 4 runs of 10, and 9 % of the terms are outside
#: their 95 % intervals
LEAST = 3.0
#: part of the rows that may be rejected, at least one row
PART = 0.25

_ALONE = 1e-6  # determinant of a row's block of I - H: below it no other row constrains the row
_RCOND = 1e-9


def are_few(dof, rank):
    """Whether rows must be tested rather than down-weighted, by degrees of freedom and rank."""
    return dof < FEW and dof <= _FEW_EACH * rank


def kept_rows(rows, b, base=None, least_noise=0.0):
    """Rows of a fit of few rows that pass the outlier test.

    Parameters
    ----------
    rows : ndarray, shape (k, 2n)
        The design; x of all rows, then y.
    b : ndarray, shape (2n,)
        Fitted values.
    base : ndarray, shape (2n,), or None
        Weights; 0: an excluded row.
    least_noise : float
        Least noise of an axis, in the unit of `b` times the root of the weights.

    Returns
    -------
    ndarray of bool, shape (n,), or None
        None where there are too few rows to test any.
    """
    n = len(b) // 2
    keep = np.ones(n, bool)
    if base is not None:
        rows, b = rows * np.sqrt(base), b * np.sqrt(base)
        keep = (base > 0.0).reshape(2, n).all(axis=0)
    there = np.count_nonzero(keep)
    taken, significant, known = [], 0, False
    for _ in range(max(1, int(PART * there))):
        both = np.concatenate((keep, keep))
        chance = _chances(rows[:, both].T, b[both], least_noise)
        at = int(np.argmin(chance))
        if not np.isfinite(chance[at]):
            break
        known = True
        taken.append(np.flatnonzero(keep)[at])
        keep[taken[-1]] = False
        if chance[at] * 2 * len(chance) < LEVEL:
            significant = len(taken)
    keep[taken[significant:]] = True
    return keep if known else None


def _chances(design, b, least_noise):
    """The p of each row, of the worse axis; infinite where it cannot be tested."""
    n = len(b) // 2
    u, s, _ = np.linalg.svd(design / np.maximum(np.linalg.norm(design, axis=0), 1e-300),
                            full_matrices=False)
    u = u[:, s > _RCOND * s[0]]
    free = np.eye(2 * n) - u @ u.T  # residual = free @ b
    own = np.arange(2 * n).reshape(2, n)
    blocks = free[own[:, None], own].transpose(2, 0, 1)  # (n, 2, 2)
    usable = np.linalg.det(blocks) > _ALONE
    inverse = np.linalg.inv(np.where(usable[:, None, None], blocks, np.eye(2)))
    error_of = inverse @ free[own].transpose(1, 0, 2)  # (n, 2, 2n): error predicted = this @ b
    error = error_of @ b
    # residuals of the others by a fit without the row, and their degrees of freedom
    left = free @ b - np.einsum('pai,ia->ip', free[:, own], error)
    freedom = np.diag(free) - np.einsum('pai,iap->ip', free[:, own], error_of)
    freedom = freedom.reshape(n, 2, n).sum(axis=2)
    enough = usable[:, None] & (freedom >= LEAST)
    freedom = np.maximum(freedom, 1.0)
    noise = np.maximum(np.square(left).reshape(n, 2, n).sum(axis=2) / freedom, least_noise**2)
    parts = np.square(error_of).reshape(n, 2, 2, n).sum(axis=3) * noise[:, None]
    variance = np.maximum(parts.sum(axis=2), 1e-300)
    dof = satterthwaite(parts, freedom[:, None])
    chance = two_sided(error / np.sqrt(variance), dof)
    return np.where(enough, chance, np.inf).min(axis=1)
