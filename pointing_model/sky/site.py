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

"""The site of a mount."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG, wrap


class Quantity(NamedTuple):
    """A number that describes a site or its air, as in files and parameters.

    Attributes
    ----------
    field : str
        Name in `Site` or `refraction.Weather`.
    unit : str
        Name of the unit.
    size : float
        Size of the unit, in that of the field.
    low, high : float
        Allowed range, in the unit.
    same : float
        Largest difference between two values of one site, in the unit.
    """

    field: str
    unit: str
    size: float
    low: float
    high: float
    same: float = 0.0

    def check(self, holder):
        """Raise a ValueError that names the first value out of range."""
        value = np.asarray(getattr(holder, self.field), float) / self.size
        bad = ~((value >= self.low) & (value <= self.high))
        if np.any(bad):
            raise ValueError(f'{self.field.split("_")[0]} {value[bad].flat[0]:g} is outside '
                             f'{self.low:g} to {self.high:g} {self.unit}')


#: quantities by their names in files and nodes
SITE = {'latitude_deg': Quantity('latitude', 'degrees', DEG, -90.0, 90.0, 0.01),
        'longitude_deg': Quantity('longitude', 'degrees', DEG, -180.0, 360.0, 0.01),
        'height_m': Quantity('height', 'm', 1.0, -500.0, 10000.0, 30.0)}


def site_contradictions(given, declared):
    """Notes on a given site that replaces another one in a file.

    Parameters
    ----------
    given, declared : dict
        Fields of `Site`, those that are known.

    Returns
    -------
    list of str
    """
    notes = []
    for one in SITE.values():
        mine, theirs = (of.get(one.field) for of in (given, declared))
        if mine is None or theirs is None:
            continue
        away = wrap(mine - theirs) if one.size == DEG else mine - theirs
        if abs(away) > one.same * one.size:
            notes.append(f'{one.field} {mine / one.size:.7g} {one.unit} used, although the '
                         f'file declares {theirs / one.size:.7g}')
    return notes


@dataclass(frozen=True)
class Site:
    """Location of the mount.

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
        for quantity in SITE.values():
            quantity.check(self)


DEFAULT_SITE = Site()
