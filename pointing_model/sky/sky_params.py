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

"""Site and weather as parameters of a node."""

from msg_tools.node import Param
from msg_tools.units import DEG

from ..mount_kinds import kinds_text
from ..mounts import parse_mount
from .refraction import AIR, DEFAULT_WEATHER, air_at, odd_pressure
from .site import DEFAULT_SITE, SITE, Site

KIND_OF_MOUNT = Param(
    'mount', 'altaz', f'kind of mount: {kinds_text()}; where the first axis points [deg]',
    check=lambda text: parse_mount(text, 0.0), fixed=True)

#: meaning of each, for users
_MEANING = {
    'latitude_deg': 'geodetic latitude of the site [deg]',
    'longitude_deg': 'longitude of the site, east positive [deg]',
    'height_m': 'height above the ellipsoid [m]',
    'pressure_hpa': 'air pressure at the mount [hPa]; 0: no refraction, -1: that of a standard '
                    'atmosphere at height_m',
    'temperature_c': 'air temperature at the site [Celsius]',
    'humidity': 'relative humidity at the site [1]',
    'wavelength_um': 'effective wavelength of the camera [um]'}
#: default and least value: a height tells the pressure to 4 %, no other site's does
_STANDARD = {'pressure_hpa': -1.0}
#: in the order of the fields of `Site` and `Weather`
SKY_PARAMS = tuple(
    Param(name, _STANDARD.get(name, getattr(default, one.field) / one.size), _MEANING[name],
          _STANDARD.get(name, one.low), one.high, fixed=table is SITE)  # the air changes in a night
    for default, table in ((DEFAULT_SITE, SITE), (DEFAULT_WEATHER, AIR))
    for name, one in table.items())


def mount_of(node):
    """The `Mount` from the parameters of `node`, at its site."""
    return parse_mount(node.value(KIND_OF_MOUNT.name), node.value('latitude_deg') * DEG)


def site_of(value):
    """The `Site` from its parameters; `value`: of a name, as `node.value`."""
    return Site(**{one.field: value(name) * one.size for name, one in SITE.items()})


def sky_of(node):
    """Site and weather from the parameters of `node`.

    Returns
    -------
    site : Site
    weather : Weather
    """
    site, air = site_of(node.value), {
        one.field: node.value(name) * one.size for name, one in AIR.items()}
    if air['pressure_hpa'] < 0.0:
        del air['pressure_hpa']
    weather = air_at(site.height, air)
    for text in odd_pressure(weather.pressure_hpa, site.height):
        node.get_logger().warning(text)
    return site, weather
