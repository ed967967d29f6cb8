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

"""Results of all readers of the linear CCD's frames."""

from dataclasses import dataclass

import numpy as np

EXACT, CORRECTED, REJECTED = 0, 1, 2
#: names of the qualities
QUALITIES = ('exact', 'corrected', 'rejected')


@dataclass(frozen=True)
class FrameReadings:
    """Readings of n frames.

    Attributes
    ----------
    angle : ndarray, shape (n,)
        Disc angle at the middle of the row, rad in [0, 2 pi); NaN if rejected.
    quality : ndarray of int8, shape (n,)
        EXACT: all bars match the code. CORRECTED: some bars do not, but the place was found.
        REJECTED: no angle.
    sigma : ndarray, shape (n,)
        Standard error of the angle from the image alone, rad; NaN if rejected, or if the method
        has no estimate.
    """

    angle: np.ndarray
    quality: np.ndarray
    sigma: np.ndarray


def checked_frames(frames, pixels):
    """Frames as an array of shape (n, pixels).

    Raises
    ------
    ValueError
        The number of pixels is wrong.
    """
    frames = np.asarray(frames)
    frames = frames[np.newaxis] if frames.ndim == 1 else frames
    if frames.ndim != 2 or frames.shape[1] != pixels:
        raise ValueError(
            f'frames of shape {np.shape(frames)}: the CCD has {pixels} pixels, give (n, {pixels})')
    return frames
