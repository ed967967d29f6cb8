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

"""A zero that changes slowly without a known cause: a Gaussian process in time.

It is used for prediction only: a diagnosis does not search for it, so this module proposes none.
The covariance is exponential (Ornstein-Uhlenbeck): between the knots the process interpolates, and
away from them it returns to zero. The last column is the standard deviation left by the knots, with
a coefficient of zero: it makes the standard error grow where and when there are no rows.
"""

import numpy as np

from pointing_model.mount_kinds import KINDS, USUAL

from .base import Effect, driver_word, form, on_axis


@form
def _slow_zero(axis, knots, memory, driver='time', mount=USUAL):
    """The zero of an axis as a process of correlation time `memory` with values at `knots`."""
    names, knots = KINDS[mount], np.asarray(knots, float)
    among = np.exp(-np.abs(knots[:, None] - knots) / memory) + 1e-9 * np.eye(len(knots))
    lower = np.linalg.cholesky(among)

    def columns(c):
        at = c.get(driver)
        at = np.full(len(c), np.nan) if at is None else np.asarray(at, float)
        known = np.isfinite(at)
        shape = np.exp(-np.abs(np.where(known, at, 0.0) - knots[:, None]) / memory) * known
        shape = np.linalg.solve(lower, shape)
        left = np.sqrt(np.maximum(1.0 - np.square(shape).sum(axis=0), 0.0))
        return [on_axis(axis, one, c.trig.cos_el) for one in (*shape, left)]

    word = names.word(axis)
    return Effect(f'slow_change_of_{names.key(axis)}_zero',
                  f'unknown cause: the {word} zero changes slowly with {driver_word(driver)}',
                  f'process with exponential memory of {driver}', driver, axis,
                  (*(f'k{i + 1}' for i in range(len(knots))), 'left'), columns, kind='smooth')
