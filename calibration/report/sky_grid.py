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

"""Where the axes of a mount stand on the sky: lines and names for a map."""

import numpy as np

#: angles of the second and of the first axis that are drawn, deg
_EACH, _ROUND = np.arange(-60.0, 61.0, 30.0), np.arange(-150.0, 181.0, 30.0)


def grid_of(mount):
    """The grid of a mount; None of an alt-azimuth one, whose axes are those of the map.

    Parameters
    ----------
    mount : pointing_model.mounts.Mount

    Returns
    -------
    lines : list of (ndarray, ndarray)
        Azimuth and elevation, rad, along which one axis stands still.
    names : list of (float, float, str)
        Where something is said, and what.
    """
    if mount.vertical:
        return None
    along, across = np.radians(np.arange(-180.0, 181.0, 3.0)), np.radians(_EACH)
    up = along[np.abs(along) <= 0.5 * np.pi]
    one, other = mount.names.letters
    names = (*((0.0, angle, f'{other} {angle:g}°') for angle in _EACH), (0.0, 90.0, 'pole'),
             (0.0, -90.0, 'pole'),
             *((angle, 0.0, f'{one} {angle:g}°') for angle in _ROUND if angle))
    return ([*(mount.horizon_of(along, angle + 0.0 * along) for angle in across),
             *(mount.horizon_of(angle + 0.0 * up, up) for angle in np.radians(_ROUND))],
            [(*mount.horizon_of(*np.radians([first, second])), name)
             for first, second, name in names])
