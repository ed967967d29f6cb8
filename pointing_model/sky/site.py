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

"""The site of a mount: latitude, longitude, height."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import DEG


def within(name, value, low, high, unit):
    """Refuse what is outside a range: a ValueError with the first such value."""
    value = np.asarray(value, float)
    bad = ~((value >= low) & (value <= high))
    if np.any(bad):
        raise ValueError(f'{name} {value[bad].flat[0]:g} is outside {low:g} to {high:g} {unit}')


@dataclass(frozen=True)
class Site:
    """Where the mount stands.

    Parameters
    ----------
    latitude, longitude : float
        Geodetic (WGS84), radians, north and east positive.
    height : float
        Above the ellipsoid, metres.

    Raises
    ------
    ValueError
        Out of range.
    """

    latitude: float = 34.3 * DEG
    longitude: float = 109.0 * DEG
    height: float = 500.0

    def __post_init__(self):
        within('latitude', self.latitude / DEG, -90.0, 90.0, 'degrees')
        within('longitude', self.longitude / DEG, -360.0, 360.0, 'degrees')
        within('height', self.height, -500.0, 10000.0, 'm')


DEFAULT_SITE = Site()
