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

"""Stars beside a star, which a camera could take for it."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.mounts import ALTAZ

NEIGHBOUR_DISTANCE = 30.0 * 60.0 * ARCSEC  # a field of 30 arcmin to its corner, and a mount 8 off
NEIGHBOUR_CONTRAST = 2.0  # magnitudes; a fainter neighbour does not disturb


def has_neighbour(stars, rows):
    """Which stars have another one beside them that a camera could take for them.

    Parameters
    ----------
    stars : Stars
        Neighbours are looked for among all of these.
    rows : ndarray of int, shape (n,)
        The stars in question.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    deep = np.flatnonzero(stars.mag < stars.mag[rows].max(initial=-9.0) + NEIGHBOUR_CONTRAST)
    deep = deep[np.argsort(stars.dec[deep])]
    place = ALTAZ.direction(stars.ra, stars.dec)
    out, least = np.zeros(len(rows), bool), np.cos(NEIGHBOUR_DISTANCE)
    if not len(rows):
        return out
    # many of nearly the same declination at once, with all that may be beside them
    for part in np.array_split(np.argsort(stars.dec[rows]), len(rows) // 64 + 1):
        row = rows[part]
        beside = stars.dec[row[[0, -1]]] + [-NEIGHBOUR_DISTANCE, NEIGHBOUR_DISTANCE]
        other = deep[slice(*np.searchsorted(stars.dec[deep], beside))]
        near = place[:, row].T @ place[:, other] >= least
        near &= stars.mag[other] < stars.mag[row, np.newaxis] + NEIGHBOUR_CONTRAST
        out[part] = np.any(near & (other != row[:, np.newaxis]), axis=1)
    return out
