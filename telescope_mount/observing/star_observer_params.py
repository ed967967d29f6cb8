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

"""Parameters of the star observer."""

from msg_tools.node import Param
from pointing_model.active_topics import MODEL_FILE
from pointing_model.runs.run import KEPT_POWER_ONS
from pointing_model.sky.sky_params import KIND_OF_MOUNT, SKY_PARAMS
from pointing_model.sky.star_catalogue import satellite_target

from .plan import night_plan, parse_plan
from .star_choice import CHOICE_PARAMS

PARAMS = SKY_PARAMS + (
    KIND_OF_MOUNT,
    Param('plan', night_plan(30, 16), 'steps of the night, separated by commas', check=parse_plan),
    Param('autostart', True, 'start the plan as soon as the graph is connected', fixed=True),
    Param('wait_for_nodes', [''], 'full names of nodes that must be connected before the plan '
          'starts', fixed=True),
    *CHOICE_PARAMS,
    Param('recentre_arcsec', 60.0, 'a star farther from the boresight is centred and measured '
          'again [arcsec]', 0.1, 36000.0),
    Param('on_target_arcsec', 30.0, 'largest difference of the encoder from its demand in an '
          'exposure that counts [arcsec]', 0.1, 36000.0),
    Param('exposure_s', 0.0, 'length of the exposures, with the encoder on target throughout; '
          'its mean is used; 0: its reading in the middle [s]', 0.0, 3600.0),
    Param('smear_arcsec', 5.0, 'largest motion of the axes off their track in an exposure of '
          'exposure_s that counts [arcsec]', 0.01, 3600.0),
    Param('camera_late_s', 0.0, "delay of the camera's stamps behind the encoder's, as measured by "
          'the step clocks; subtracted from them [s]', -10.0, 10.0),
    Param('clock_rate_arcsec_s', 30.0, 'how fast the axes drift past a star in the step clocks '
          '[arcsec/s]', 1.0, 600.0),
    Param('slew_rate_deg_s', 4.0, 'slew rate of the mount, to plan track lengths, visibility and '
          'spacing of stars [deg/s]', 0.01, 90.0),
    Param('field_deg', 1.0, 'a star farther from the boresight is refused: outside the field, '
          'so its message has another unit [deg]', 1e-3, 180.0),
    Param('renew_request_s', 0.2, 'interval at which the request to the guard is repeated; '
          '0: sent once [s]', 0.0, 10.0, fixed=True),
    Param('answer_timeout_s', 5.0, 'wall time after which a pointing without an answer is '
          'commanded again [s]', 0.5, 3600.0),
    Param('absolute_encoder', True, 'whether the mount has an absolute encoder beside the one that '
          'it is pointed with', fixed=True),
    Param('inclinometer', False, 'whether an inclinometer publishes; the rows have what it reads',
          fixed=True),
    Param('give_up_s', 600.0, 'wall time without an observation after which a plan that is '
          'blocked or waiting ends; 0: never [s]', 0.0, 86400.0),
    Param('state_file', '', 'file with the state of the night, to resume its plan after a '
          'restart. That of another plan is put aside; none: no file',
          fixed=True),
    Param('first_run', 1, 'run number of the first power-on, where the calibration has no rows of '
          'the night yet', -1000000, 1000000),
    Param('polaris_exposures', 16, 'exposures that the services zero, zero_on_polaris and '
          'zero_on_stars make', 1, 10000),
    Param('satellite', '', 'what the step satellite tracks: a file of two-line elements, '
          'gps-26690, or a name and a file of its orbit, such as L52 lageos2.sp3',
          check=satellite_target),
    Param('satellite_interval_s', 20.0, 'least time between satellite exposures [s]', 0.0, 3600.0),
    KEPT_POWER_ONS,
    MODEL_FILE,
)
