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

"""How fast stars move in the angles of a mount, and whether measured rates are theirs."""

import numpy as np

#: a turn of the Earth against the stars, rad/s
SIDEREAL = 2.0 * np.pi / 86164.0905
#: part of the stars' rates by which measured ones may differ and be theirs, with noise: those of
#: satellites at rest over the ground or 20 000 km high differ by all of them, those of an axis that
#: slips by 10" by 0.6
_UNLIKE = 0.8


def star_rates(directions, tangents, latitude):
    """Rates of stars on the sky: they turn about the pole, as -(pole x direction).

    Parameters
    ----------
    directions : ndarray, shape (3, n)
        East, north, up.
    tangents : sequence of ndarray, shape (3, n)
        Unit vectors along which both angles grow.
    latitude : float
        rad.

    Returns
    -------
    ndarray, shape (2, n)
        rad/s, that of the first axis times the cosine of the second.
    """
    pole = np.array([[0.0], [np.cos(latitude)], [np.sin(latitude)]])
    moves = -SIDEREAL * np.cross(pole, directions, axis=0)
    return np.array([np.sum(moves * along, axis=0) for along in tangents])


def are_star_rates(x, y, star_x, star_y):
    """Whether measured rates are those of stars, but for the noise of readings.

    What they differ by is then no rate at which an error could grow: an axis that sticks and slips
    has its error in the reading and in the rate.

    Parameters
    ----------
    x, y, star_x, star_y : ndarray, shape (n,)
        rad/s on the sky: measured, and the stars'.

    Returns
    -------
    bool
    """
    off, fast = np.hypot(x - star_x, y - star_y), np.hypot(star_x, star_y)
    known = np.isfinite(off)
    return bool(known.any() and np.median(off[known]) < _UNLIKE * np.median(fast[known]))
