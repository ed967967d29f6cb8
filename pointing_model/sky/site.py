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

"""The site of a mount, and the air there with the refraction that ERFA computes of it."""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import erfa
import numpy as np

from msg_tools.units import DEG


class Quantity(NamedTuple):
    """A number of a site, or of its air, as files and parameters give it.

    Attributes
    ----------
    field : str
        Of `Site` or `Weather`.
    unit : str
        In words.
    size : float
        Of the unit, in that of the field.
    low, high : float
        Least and most, in the unit.
    """

    field: str
    unit: str
    size: float
    low: float
    high: float

    def check(self, holder):
        """Refuse a value that is out of range: a ValueError with the first such value."""
        value = np.asarray(getattr(holder, self.field), float) / self.size
        bad = ~((value >= self.low) & (value <= self.high))
        if np.any(bad):
            raise ValueError(f'{self.field.split("_")[0]} {value[bad].flat[0]:g} is outside '
                             f'{self.low:g} to {self.high:g} {self.unit}')


#: by the names that files and nodes use
SITE = {'latitude_deg': Quantity('latitude', 'degrees', DEG, -90.0, 90.0),
        'longitude_deg': Quantity('longitude', 'degrees', DEG, -180.0, 360.0),
        'height_m': Quantity('height', 'm', 1.0, -500.0, 10000.0)}
AIR = {'pressure_hpa': Quantity('pressure_hpa', 'hPa', 1.0, 0.0, 1200.0),
       'temperature_c': Quantity('temperature_c', 'degrees Celsius', 1.0, -90.0, 60.0),
       'humidity': Quantity('humidity', '(a fraction)', 1.0, 0.0, 1.0),
       'wavelength_um': Quantity('wavelength_um', 'micrometres', 1.0, 0.2, 1e6)}


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
        for quantity in SITE.values():
            quantity.check(self)


DEFAULT_SITE = Site()


@dataclass(frozen=True)
class Weather:
    """Air at the mount, for the refraction; each a number or one for each observation.

    Parameters
    ----------
    pressure_hpa : float or ndarray
        Pressure at the mount, not reduced to sea level; 0 means no refraction.
    temperature_c : float or ndarray
        Degrees Celsius.
    humidity : float or ndarray
        Relative, 0 to 1.
    wavelength_um : float
        Micrometres.

    Raises
    ------
    ValueError
        Out of range.
    """

    pressure_hpa: float = 955.0
    temperature_c: float = 10.0
    humidity: float = 0.5
    wavelength_um: float = 0.55

    def __post_init__(self):
        for quantity in AIR.values():
            quantity.check(self)


DEFAULT_WEATHER = Weather()


@lru_cache(maxsize=256)
def _constants(pressure, temperature, humidity, wavelength):
    return erfa.ufunc.refco(pressure, temperature, humidity, wavelength)


def refracted(astrom, weather):
    """ERFA's astrom with the refraction; `astrom` itself where its shape is that of the weather."""
    air = (weather.pressure_hpa, weather.temperature_c, weather.humidity, weather.wavelength_um)
    if all(isinstance(value, (float, int)) for value in air):
        refa, refb = _constants(*air)
    else:
        refa, refb = erfa.ufunc.refco(*air)
        if np.ndim(refa) > astrom.ndim:
            astrom = np.broadcast_to(astrom, np.shape(refa)).copy()
    astrom['refa'], astrom['refb'] = refa, refb
    return astrom
