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

"""Axis angles interpolated between readings, and simultaneous readings of both encoders."""

from collections import deque

import numpy as np

from msg_tools.units import DEG, wrap

#: faster axes are not used to compare encoders of different latency, rad/s
_SLOW = 0.01 * DEG


class Difference:
    """Simultaneous readings of both encoders, from two independent streams.

    Attributes
    ----------
    incremental, absolute : ndarray, shape (2,), or None
        The last pair, rad.
    start : float
        Begin of the power-on of the absolute encoder in which it gave this reading, UTC s; NaN
        if it is not reported.
    """

    def __init__(self):
        self._readings = deque(maxlen=100)
        self._second = None
        self.incremental = self.absolute = None
        self.start = np.nan

    def update_incremental(self, stamp, angles):
        """Take a reading (ns, rad)."""
        if self._readings and stamp <= self._readings[-1][0]:
            self._readings.clear()
        self._readings.append((stamp, angles))
        self._pair()

    def update_absolute(self, stamp, angles, start=np.nan):
        """Take a reading (ns, rad), and the begin of its power-on (UTC s)."""
        self._second = stamp, angles, start
        self._pair()

    def _pair(self):
        if self._second is None or not np.isfinite(self._second[1]).all():
            return
        stamps, angles = [s for s, _ in self._readings], [a for _, a in self._readings]
        try:
            reading, rate = interpolate(stamps, angles, self._second[0])
        except ValueError:
            return
        if np.all(np.abs(rate) < _SLOW):
            self.incremental, self.absolute = reading, np.array(self._second[1])
            self.start = self._second[2]


def interpolate(stamps, angles, stamp, before=0):
    """Angles at `stamp`, interpolated between the two adjacent readings.

    Parameters
    ----------
    stamps : array_like of int, shape (n,)
        Nanoseconds, increasing.
    angles : array_like, shape (n, 2)
        Azimuth and elevation, rad.
    stamp : int
        Within the range of `stamps`.
    before : int
        Rates are averaged from this long before `stamp` (ns) to the next reading; 0: between the
        two adjacent readings.

    Returns
    -------
    angles : ndarray, shape (2,)
        Radians; NaN for an axis without a reading.
    rates : ndarray, shape (2,)
        rad/s.

    Raises
    ------
    ValueError
        No reading on one side of `stamp`.
    """
    stamps = np.asarray(stamps, dtype=np.int64)
    angles = np.asarray(angles, dtype=float).reshape(-1, 2)
    i = int(np.searchsorted(stamps, stamp, side='left'))
    if i < len(stamps) and stamps[i] == stamp and i == 0:
        i = 1
    if i == 0 or i >= len(stamps):
        raise ValueError('no encoder readings on both sides of the exposure')
    low, high = angles[i - 1], angles[i]
    span = float(stamps[i] - stamps[i - 1])
    step = np.array([wrap(high[0] - low[0]), high[1] - low[1]])
    first = min(int(np.searchsorted(stamps, stamp - before)), i - 1)
    way = np.array([wrap(high[0] - angles[first, 0]), high[1] - angles[first, 1]])
    rate = way / (float(stamps[i] - stamps[first]) * 1e-9)
    return low + step * (float(stamp - stamps[i - 1]) / span), rate
