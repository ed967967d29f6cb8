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

"""Parameters of the mount guard."""

from msg_tools.node import Param
from msg_tools.node_lifecycle import AUTOSTART
from msg_tools.units import DEG
from pointing_model.sky.sky_params import KIND_OF_MOUNT, SKY_PARAMS
from pointing_model.sky.skyline import parse_horizon

from .limits import Limits, parse_pair
from .reasons_to_stop import GuardSettings
from .sky_limits import SKY_LIMITS

# the defaults are defined there
_SENT, _KEPT = GuardSettings(), Limits()
_FIRST, _SECOND = _KEPT.axes


def _travel(name, which):
    return Param(name, '', f'travel limits of the {which} axis, turns counted: -270,270; '
                 'empty: default of this kind of mount [deg]',
                 check=lambda text: parse_pair(text, 'both ends in degrees'), fixed=True)


PARAMS = (
    AUTOSTART, KIND_OF_MOUNT,
    # a mount does not move, and limits in the sky are computed for its site
    *SKY_PARAMS[:3],
    _travel('first_travel_deg', 'first'),
    _travel('second_travel_deg', 'second'),
    Param('first_rate_deg_s', _FIRST.rate / DEG, 'largest speed of the first axis [deg/s]', 1e-3,
          360.0, fixed=True),
    Param('second_rate_deg_s', _SECOND.rate / DEG, 'largest speed of the second axis [deg/s]', 1e-3,
          360.0, fixed=True),
    Param('first_acceleration_deg_s2', _FIRST.acceleration / DEG,
          'largest acceleration of the first axis [deg/s^2]', 1e-3, 3600.0, fixed=True),
    Param('second_acceleration_deg_s2', _SECOND.acceleration / DEG,
          'largest acceleration of the second axis [deg/s^2]', 1e-3, 3600.0, fixed=True),
    Param('least_elevation_deg', _KEPT.horizon.least / DEG, 'the tube never points lower [deg]',
          -90.0, 90.0, fixed=True),
    Param('horizon', '', 'corners of the skyline, azimuth and elevation: 0 12, 45 20.5, 180 8; or '
          'a file with one on each line [deg]', check=parse_horizon, fixed=True),
    *(Param(limit.parameter, limit.distance_deg, f'least distance from {limit.name}, also in '
            'slews; 0: no limit [deg]', 0.0, 90.0, fixed=True) for limit in SKY_LIMITS),
    Param('slew_timing', _KEPT.timing, 'fraction of speed and acceleration that slews surely '
          'reach, and tracks use at most; 0: any in slews, all in tracks', 0.0, 1.0, fixed=True),
    Param('turn_known', _SENT.turn_known, 'the encoder of the first axis knows its turn; else only '
          'motions that are safe on any turn are allowed', fixed=True),
    Param('renew_s', 0.5, 'time between commands, each of which ends at rest; 0: the whole track '
          'at once, for a simulated mount whose time waits for events [s]', 0.0, 5.0, fixed=True),
    Param('ahead_s', _SENT.ahead, 'how far a command reaches into the future, in graph time '
          '[s]', 0.2, 3600.0, fixed=True),
    Param('goto', False, 'the driver takes target positions and chooses its path: commands hold '
          'the track only, and any path to it must be free', fixed=True),
    Param('silence_s', _SENT.silence, 'the mount is stopped after this time without a reading [s]',
          0.05, 60.0, fixed=True),
    Param('request_timeout_s', _SENT.commander, 'a request that is not repeated within this time '
          'ends [s]', 0.05, 60.0, fixed=True),
    Param('behind_deg', _SENT.behind / DEG, 'an axis this far from its command is stopped '
          '[deg]', 0.01, 180.0, fixed=True),
    Param('park_deg', '', 'park position, the angles of both axes: 180,80 [deg]',
          check=lambda text: parse_pair(text, 'the angles of both axes in degrees'), fixed=True),
)
