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

"""A mount of an INDI server in the graph: its axes as joint states, `command` as goto and track."""

from msg_tools.node import Param
from msg_tools.node_lifecycle import AUTOSTART
from msg_tools.units import ARCSEC
from pointing_model.sky.sky_params import KIND_OF_MOUNT, SKY_PARAMS, sky_of

from ..mount_bridge import TOLERANCE, MountBridge
from .indi_driver import MountDriver
from .indi_sources import SERVER_PARAMS

PARAMS = (
    AUTOSTART, *SERVER_PARAMS, *SKY_PARAMS, KIND_OF_MOUNT, TOLERANCE,
    Param('set_site', True, 'set the site of the driver, and its time',
          fixed=True),
    Param('period_ms', 100, 'time between two readings, where the driver can be set; 0: its own '
          '[ms]', 0, 10000, fixed=True),
)


class IndiMount(MountBridge):
    """`MountBridge` to an INDI server."""

    def __init__(self, **kwargs):
        super().__init__('indi_mount', PARAMS, 'mount of an INDI server', **kwargs)

    def make_driver(self, mount):
        """The driver for the parameters."""
        value = self.value
        return MountDriver(
            value('host'), value('port'), mount, sky_of(self)[0], value('device'), value('axes'),
            value('tolerance_arcsec') * ARCSEC, value('set_site'), value('period_ms'))
