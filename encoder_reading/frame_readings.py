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

"""What every reader makes of the frames of the linear CCD."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import wrap

EXACT, CORRECTED, REJECTED = 0, 1, 2
#: names of the qualities
QUALITIES = ('exact', 'corrected', 'rejected')


@dataclass(frozen=True)
class FrameReadings:
    """The readings of n frames.

    Attributes
    ----------
    angle : ndarray, shape (n,)
        Disc angle at the middle of the row, rad in [0, 2 pi); NaN where rejected.
    quality : ndarray of int8, shape (n,)
        EXACT: every bar that was read fits the code there. CORRECTED: some bars do not, and the
        place was found all the same. REJECTED: no angle.
    sigma : ndarray, shape (n,)
        Standard error of the angle from the image alone, rad; NaN where rejected, or where the
        method knows none.
    """

    angle: np.ndarray
    quality: np.ndarray
    sigma: np.ndarray


class Differenced:
    """Rates from a reader's own readings: the last two over the time between them.

    An image gives no rate. Of readings with a standard error sigma, `dt` apart, the rate has
    sqrt(2) sigma / dt.
    """

    #: s between two readings from which on they tell no rate: the axis may have been elsewhere
    LONGEST = 1.0

    def __init__(self):
        self._last = None

    def forget(self):
        """What follows has nothing to do with what was read before."""
        self._last = None

    def __call__(self, stamp, angle):
        """Rates with the reading of `stamp`.

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
        if not 0.0 < passed <= self.LONGEST:
            return np.full(len(self._last[1]), np.nan)
        return wrap(self._last[1] - before[1]) / passed


def checked_frames(frames, pixels):
    """Frames as an array of shape (n, pixels).

    Raises
    ------
    ValueError
        They have another number of pixels.
    """
    frames = np.asarray(frames)
    frames = frames[np.newaxis] if frames.ndim == 1 else frames
    if frames.ndim != 2 or frames.shape[1] != pixels:
        raise ValueError(
            f'frames of shape {np.shape(frames)}: the CCD has {pixels} pixels, give (n, {pixels})')
    return frames
