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

"""Source of exposures for `alpaca_sky`: a simulator."""

from msg_tools.node import Param

from ..connection import PORTS
from ..star_field import SkySource
from .alpaca_telescope import AlpacaTelescope


class AlpacaStars(SkySource):
    """A simulator that reports its true pointing on request.

    Parameters
    ----------
    host, port, number
        See `alpaca_telescope.AlpacaTelescope`.
    field : star_field.StarField
    rate : float
        Exposures per second.
    """

    def __init__(self, host, port, number, field, rate=2.0):
        super().__init__(field, f'{host}:{port}')
        self._server, self._rate = (host, port, number), rate

    def work(self):
        """Poll until there is no answer, or exposures are no longer wanted."""
        telescope = AlpacaTelescope(*self._server)
        telescope.knows_where_it_looks()
        self.why = ''
        while self.on and not self._reconnection.closed:
            stamp, (*place, second) = telescope.true_place()
            self.exposures.append((stamp, self.field.miss(stamp, place, second)))
            self._reconnection.pause(1.0 / self._rate)


SERVER_PARAMS = (
    Param('host', 'localhost', 'where the Alpaca server runs', fixed=True),
    Param('port', PORTS['alpaca'], 'its port', 1, 65535, fixed=True),
    Param('number', 0, 'of the telescope on the server', 0, 255, fixed=True),
)
