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

"""Offsets of stars from the boresight, for a simulated telescope of an Alpaca server.

A driver of a real mount reports only its estimate: that needs a camera.
"""

from msg_tools.node_lifecycle import AUTOSTART
from pointing_model.sky.sky_params import KIND_OF_MOUNT, SKY_PARAMS

from ..sky_bridge import FIELD_PARAMS, SkyBridge
from .alpaca_sources import SERVER_PARAMS, AlpacaStars

PARAMS = AUTOSTART, *SERVER_PARAMS, *SKY_PARAMS, KIND_OF_MOUNT, *FIELD_PARAMS


class AlpacaSky(SkyBridge):
    """`SkyBridge` to an Alpaca server."""

    def __init__(self, **kwargs):
        super().__init__('alpaca_sky', PARAMS, 'what an Alpaca mount sees', **kwargs)

    def make_source(self, field):
        """The source for the parameters."""
        value = self.value
        return AlpacaStars(value('host'), value('port'), value('number'), field, value('rate_hz'))
