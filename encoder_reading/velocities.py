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

"""Velocities of the axes from differences of readings."""

import numpy as np

from msg_tools.units import wrap

#: s between readings from which on they give no velocity: the axis may have been elsewhere
LONGEST_GAP = 1.0


class Velocities:
    """Velocities from a reader's own readings: difference of the last two over the time between.

    An image alone gives no velocity. For readings with a standard error sigma, `dt` apart, that of
    the velocity is sqrt(2) sigma / dt.
    """

    def __init__(self):
        self._last = None

    def forget(self):
        """Forget the last reading, since the next one is not related to it."""
        self._last = None

    def __call__(self, stamp, angle):
        """Velocities at the reading of `stamp`.

        Parameters
        ----------
        stamp : int
            ns.
        angle : array_like, shape (n,)
            Angle of each axis, rad; NaN if rejected.

        Returns
        -------
        ndarray, shape (n,)
            rad/s; NaN without two consecutive good readings.
        """
        before, self._last = self._last, (stamp, np.asarray(angle, dtype=float))
        passed = np.nan if before is None else (stamp - before[0]) * 1e-9
        if not 0.0 < passed <= LONGEST_GAP:
            return np.full(len(self._last[1]), np.nan)
        return wrap(self._last[1] - before[1]) / passed
