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

"""Air at a mount, and ERFA's refraction for it: A tan z + B tan^3 z."""

from dataclasses import dataclass
from functools import lru_cache

import erfa
import numpy as np

from .earth import EARTH_RADIUS
from .site import DEFAULT_SITE, Quantity

# least cosine and sine of an elevation in ERFA's atioq
_LEAST_COS, _LEAST_SIN = 1e-6, 0.05
_refco_of_numbers = lru_cache(maxsize=256)(erfa.ufunc.refco)
#: quantities by their names in files and nodes
AIR = {'pressure_hpa': Quantity('pressure_hpa', 'hPa', 1.0, 0.0, 1200.0),
       'temperature_c': Quantity('temperature_c', 'degrees Celsius', 1.0, -90.0, 60.0),
       'humidity': Quantity('humidity', '(a fraction)', 1.0, 0.0, 1.0),
       'wavelength_um': Quantity('wavelength_um', 'micrometres', 1.0, 0.2, 1e6)}


@dataclass(frozen=True)
class Weather:
    """Air at the mount, for the refraction; each field is a number or one per observation.

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


#: relative deviation of a pressure from the standard atmosphere that is implausible: weather causes
#: at most 4 %; reduction to sea level from 500 m is 6 %; and the pressure range of any telescope
_UNLIKE, _ANYWHERE = 0.055, (400.0, 1100.0)
#: hPa per mm of mercury: a pressure that is plausible in mm is implausible in hPa at that height
_MERCURY = 1.33322


def standard_pressure(height):
    """Pressure of a standard atmosphere at a height in metres, hPa."""
    return 1013.25 * (1.0 - 2.25577e-5 * height) ** 5.25588


def air_at(height, given=None):
    """Air at a height: standard atmosphere and 10 C, except for given values.

    Parameters
    ----------
    height : float
        Metres.
    given : dict, optional
        Fields of `Weather`.

    Returns
    -------
    Weather
    """
    return Weather(**{'pressure_hpa': standard_pressure(height), **(given or {})})


DEFAULT_WEATHER = air_at(DEFAULT_SITE.height)


def air_of_rows(height, pressure=None, temperature=None, declared=None, given=None):
    """Air of each row: measured in the row, else given or declared, else a standard atmosphere.

    A pressure in a row that is impossible in hPa (0, or another unit) counts as not measured, as
    does a declared one. A declared or given 0 means no refraction.

    Parameters
    ----------
    height : float or None
        Height of the site, metres; None if unknown: sea level is assumed.
    pressure, temperature : ndarray, shape (n,), optional
        Pressure and temperature of the rows, hPa and degrees Celsius; NaN: not measured.
    declared, given : dict or None
        Fields of `Weather` from the file, valid for all rows, and fields that override them.

    Returns
    -------
    weather : Weather
    notes : list of str
        The first names the air that is used.

    Raises
    ------
    ValueError
        A given pressure that is impossible in hPa, or a value out of range.
    """
    usual, notes = standard_pressure(height or 0.0), []
    where = 'at sea level; the height is not given' if height is None else (
        f'at a height of {height:.0f} m')
    odd = f'is no pressure in hPa (usual: {usual:.0f} {where})'
    known = dict(declared or {})
    one = known.get('pressure_hpa', 0.0)
    if one != 0.0 and _is_other_unit(one, height):
        notes.append(f'pressure {known.pop("pressure_hpa"):g} of the file {odd}: treated as '
                     'missing')
    known |= given or {}
    weather = air_at(height or 0.0, known)
    if weather.pressure_hpa != 0.0 and _is_other_unit(weather.pressure_hpa, height):
        raise ValueError(f'pressure {weather.pressure_hpa:g} {odd}; give hPa, or 0: no refraction')
    text = f'refraction for {round(weather.pressure_hpa, 1):g} hPa, {weather.temperature_c:g} C'
    if not known:
        text += f' (standard atmosphere {where})'
    elif 'pressure_hpa' not in known:
        text += f' (the pressure of a standard atmosphere {where})'
    elif not given:
        text += ', as the file says'
    own = {'pressure_hpa': pressure, 'temperature_c': temperature}
    for name, values in own.items():
        if values is None or not np.isfinite(values).any():
            own[name] = getattr(weather, name)
            continue
        if name == 'pressure_hpa':
            other = _is_other_unit(values, height)
            if other.any():
                notes.append(f'{name} {values[other][0]:g} in {other.sum()} of {len(values)} rows '
                             f'{odd}: treated as missing')
            values = np.where(other, np.nan, values)
            if other.all():
                own[name] = weather.pressure_hpa
                continue
        text += f', or {name} of the row where the file has it'
        own[name] = np.where(np.isfinite(values), values, getattr(weather, name))
    if height is not None:
        notes += odd_pressure(float(np.median(own['pressure_hpa'])), height)
    return Weather(humidity=weather.humidity, wavelength_um=weather.wavelength_um, **own), [
        text, *notes]


def odd_pressure(pressure, height):
    """Warnings, a list, about a pressure (hPa) that weather cannot explain at a height (m)."""
    usual = standard_pressure(height)
    if pressure == 0.0 or abs(pressure / usual - 1.0) < _UNLIKE:
        return []
    return [f'pressure {pressure:.0f} hPa, but {usual:.0f} hPa is usual at a height of '
            f'{height:.0f} m. Give the pressure at the mount, not reduced to sea level']


def _is_other_unit(pressure, height):
    pressure = np.asarray(pressure, float)
    with np.errstate(invalid='ignore'):
        odd = (pressure < _ANYWHERE[0]) | (pressure > _ANYWHERE[1])
        if height is not None:
            usual = standard_pressure(height)
            odd |= np.abs(_MERCURY * pressure / usual - 1.0) < _UNLIKE
    return odd


def refraction_constants(weather):
    """A and B of A tan z + B tan^3 z, rad; per observation if the weather is."""
    air = (weather.pressure_hpa, weather.temperature_c, weather.humidity, weather.wavelength_um)
    one = all(isinstance(value, (float, int)) for value in air)
    return (_refco_of_numbers if one else erfa.ufunc.refco)(*air)


def with_refraction(astrom, weather):
    """ERFA's astrom with refraction, set in place unless the weather has more dimensions."""
    refa, refb = refraction_constants(weather)
    if np.ndim(refa) > astrom.ndim:
        astrom = np.broadcast_to(astrom, np.shape(refa)).copy()
    astrom['refa'], astrom['refb'] = refa, refb
    return astrom


def refracted_elevation(el, weather, distance=np.inf, radius=EARTH_RADIUS):
    """Elevation with refraction, corrected for a finite distance (parallactic refraction).

    The ray of a star passes n0 r0 sin z0 from the Earth's centre. Beyond the air it is parallel to
    the straight line to the observer, but offset: for a GPS satellite 0.15" at 20 degrees of
    elevation (G. H. Kaplan, Atmospheric refraction of light from nearby objects in space, 2014).

    Parameters
    ----------
    el : float or ndarray
        Elevation without air, radians.
    weather : Weather
    distance : float or ndarray
        Distance of the object, metres; infinite for a star.
    radius : float
        Distance of the observer from the Earth's centre, metres.

    Returns
    -------
    float or ndarray
        Radians; for a star equal to `sky.observed_place`.
    """
    refa, refb = refraction_constants(weather)
    bent = _bent(el, refa, refb)
    # refco: A = g (1 - b), B = -g (b - g / 2) with g = n0 - 1, hence A - B = g - g^2 / 2
    excess = 1.0 - np.sqrt(1.0 - 2.0 * (refa - refb))
    z, seen = np.pi / 2.0 - el, np.pi / 2.0 - (el + bent)
    beside = radius * ((1.0 + excess) * np.sin(seen) - np.sin(z))
    lower = el - beside / distance
    return lower + _bent(lower, refa, refb)


def _bent(el, refa, refb):
    """Refraction as in ERFA's atioq: one Newton step from the place without air."""
    cos = np.maximum(np.cos(el), _LEAST_COS)
    sin = np.maximum(np.sin(el), _LEAST_SIN)
    tan = cos / sin
    w = refb * tan * tan
    bent = (refa + w) * tan / (1.0 + (refa + 3.0 * w) / (sin * sin))
    return np.arctan2(bent, 1.0 - 0.5 * bent * bent)
