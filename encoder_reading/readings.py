"""What every reader makes of the frames of the linear CCD."""

from dataclasses import dataclass

import numpy as np

EXACT, CORRECTED, REJECTED = 0, 1, 2
#: names of the qualities
QUALITIES = ('exact', 'corrected', 'rejected')


@dataclass(frozen=True)
class Readings:
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
