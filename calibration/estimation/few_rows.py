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

"""Fits of few rows: which row is wrong, and how far from the truth a term may be.

With few degrees of freedom robust weights mislead: the noise that they rest on is estimated from
the same few residuals, and a row that determines a term has a small one however wrong it is. Here
a row counts in full or not at all. It is judged by the error with which a fit without it predicts
it, over the standard error of that prediction (a deleted studentised residual, Cook and Weisberg
1982, section 2.2), each axis by its own noise, whose degrees of freedom are Satterthwaite's
(1946). What stands out is taken out one after the other, and as many are rejected as the last
that is significant says (Rosner 1983), so that two wrong rows do not hide each other.
"""

import numpy as np

from .least_squares import satterthwaite
from .step_scan import two_sided

#: degrees of freedom below which 95 % are not within two sigmas, and rows may be few
FEW = 30
#: degrees of freedom a coefficient up to which robust weights mislead (`are_few`): they reject a
#: good row of 6 in 7 % of runs, of 8 in 2 % with seven terms, of 5 in 7 % with two zeros
_FEW_EACH = 4
#: chance that a fit to rows of normal noise rejects any, by Bonferroni over rows and axes; 0.01
#: finds no more wrong stars of 60 sigma, and rejects three times as many good ones of t(4) noise
LEVEL = 0.002
#: degrees of freedom of an axis without the row, from which that axis tells of it. With seven
#: terms that is from 8 rows on. From 1.5 on, a wrong row of 6 is found in 4 runs of 10, and 9 % of
#: the terms are beyond their 95 %
LEAST = 3.0
#: part of the rows that may be wrong, but always one
PART = 0.25

_ALONE = 1e-6  # of the determinant of a row's own freedom: below it nothing else tells of the row
_RCOND = 1e-9


def are_few(dof, rank):
    """Whether rows are to be tested and not weighed, by a fit's degrees of freedom and rank."""
    return dof < FEW and dof <= _FEW_EACH * rank


def kept_rows(rows, b, base=None, least_noise=0.0):
    """Which rows of a fit of few stand the test.

    Parameters
    ----------
    rows : ndarray, shape (k, 2n)
        The design; x of all rows, then y.
    b : ndarray, shape (2n,)
        What it is fitted to.
    base : ndarray, shape (2n,), or None
        Weights; 0: the row is not there.
    least_noise : float
        Of an axis (in the unit of `b` times the root of the weights): below it nothing is wrong.

    Returns
    -------
    ndarray of bool, shape (n,), or None
        None where the rows are so few that none could be judged.
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
    """Of each row the chance that noise makes it stand out so; infinite where nothing tells."""
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
    # what a fit without the row leaves of the others, and the freedom that it leaves each
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
