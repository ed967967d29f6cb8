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

"""Velocities of the axes as differences of readings."""

import numpy as np

from msg_tools.units import wrap

#: s between two readings from which on they give no velocity: the axis may have been elsewhere
LONGEST_GAP = 1.0


class Velocities:
    """Velocities from a reader's own readings: the last two over the time between them.

    An image gives no velocity. Of readings with a standard error sigma, `dt` apart, the velocity
    has sqrt(2) sigma / dt.
    """

    def __init__(self):
        self._last = None

    def forget(self):
        """What follows has nothing to do with what was read before."""
        self._last = None

    def __call__(self, stamp, angle):
        """Velocities with the reading of `stamp`.

        Parameters
        ----------
        stamp : int
            ns.
        angle : array_like, shape (n,)
            Of each axis, rad; NaN where rejected.

        Returns
        -------
        ndarray, shape (n,)
            rad/s; NaN without two good readings in a row.
        """
        before, self._last = self._last, (stamp, np.asarray(angle, dtype=float))
        passed = np.nan if before is None else (stamp - before[0]) * 1e-9
        if not 0.0 < passed <= LONGEST_GAP:
            return np.full(len(self._last[1]), np.nan)
        return wrap(self._last[1] - before[1]) / passed
