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


"""The geometric terms as exact rotations: where they start, and the offsets that they leave."""

import numpy as np

from pointing_model import geometry

from ..finding import Finding
from ..term_fit import fit_terms


def rotation_start(obs, base):
    """Start of the exact rotations, and the offsets that they leave.

    Parameters
    ----------
    obs : Observations
    base : Base

    Returns
    -------
    start : dict of str to float
        Coefficients of the geometric terms, radians.
    left : ndarray, shape (2n,)
        Radians.
    feasible : ndarray of bool, shape (n,)
    """
    names = obs.run.mount.names
    geometric = tuple(t for t in base.terms if t in names.terms)
    if not geometric:
        return {}, obs.observed, np.ones(len(obs), bool)
    start = dict.fromkeys(geometric, 0.0)
    try:
        start.update(fit_terms(obs.run, geometric, encoder=obs.encoder).model.terms)
    except ValueError:
        # directions that do not determine the rotations: from the indices alone
        obs.notes.append(Finding('undetermined base'))
        few = tuple(t for t in names.index if t in geometric)
        if few:
            start.update(fit_terms(obs.run, few, encoder=obs.encoder).model.terms)
    left, feasible = after_rotation(obs, start)
    return start, left, feasible


def after_rotation(obs, start):
    """Offsets beyond the exact rotations, shape (2n,), and where the mount can look."""
    x, y = geometry.offsets(obs.context.az, obs.context.el, start, obs.context.mount)
    feasible = np.isfinite(x) & np.isfinite(y)
    left = obs.observed - np.nan_to_num(np.hstack((x, y)))
    return left, feasible
