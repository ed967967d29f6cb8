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
from .air import DEFAULT_WEATHER, Weather
from .site import DEFAULT_SITE, Site

KIND_OF_MOUNT = Param(
    'mount', 'altaz', f'kind of mount: {kinds_text()}; where the first axis points [deg]',
    check=lambda text: parse_mount(text, 0.0), fixed=True)

#: in the order of the fields of `Site` and `Weather`
SKY_PARAMS = (
    Param('latitude_deg', DEFAULT_SITE.latitude / DEG, 'geodetic latitude of the site [deg]',
          -90.0, 90.0),
    Param('longitude_deg', DEFAULT_SITE.longitude / DEG,
          'longitude of the site, east positive [deg]', -180.0, 360.0),
    Param('height_m', DEFAULT_SITE.height, 'height above the ellipsoid [m]', -500.0, 9000.0),
    Param('pressure_hpa', DEFAULT_WEATHER.pressure_hpa,
          'air pressure at the site, 0 for no refraction [hPa]', 0.0, 1100.0),
    Param('temperature_c', DEFAULT_WEATHER.temperature_c, 'air temperature at the site [Celsius]',
          -90.0, 60.0),
    Param('humidity', DEFAULT_WEATHER.humidity, 'relative humidity at the site [1]', 0.0, 1.0),
    Param('wavelength_um', DEFAULT_WEATHER.wavelength_um,
          'effective wavelength of the camera [um]', 0.2, 1000.0),
)


def mount_of(node):
    """The `Mount` from the parameters of `node`, at its site."""
    return parse_mount(node.value(KIND_OF_MOUNT.name), node.value('latitude_deg') * DEG)


def sky_of(node):
    """Site and weather from the parameters of `node`.

    Returns
    -------
    site : Site
    weather : Weather
    """
    latitude, longitude, height, *weather = (node.value(param.name) for param in SKY_PARAMS)
    return Site(latitude * DEG, longitude * DEG, height), Weather(*weather)
