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

"""An Alpaca telescope with errors: ``python examples/simulated_servers/alpaca_simulator.py``.

It draws errors of 0.02 to 0.1 deg for each part, prints them, and runs until Ctrl-C. It reports
the true pointing of its tube by its own action, `TRUE_PLACE`, which no driver of a real mount can.
"""

import sys
from contextlib import contextmanager

from alpaca_server import AlpacaServer
from indi_simulator import simulate
from two_axes import TERMS, TwoAxes, draw_errors

from msg_tools.units import DEG, wrap
from pointing_model.mounts import parse_mount
from pointing_model.sky.site import DEFAULT_SITE
from telescope_mount.bridges.alpaca.alpaca_telescope import KINDS, TRUE_PLACE
from telescope_mount.bridges.axes_and_places import HOUR
from telescope_mount.bridges.connection import PORTS


class SimulatedTelescope(AlpacaServer):
    """A `TwoAxes` with an Alpaca interface.

    Parameters
    ----------
    telescope : TwoAxes
    port : int
    """

    def __init__(self, telescope, port=0):
        super().__init__(port)
        self._telescope, self._parked = telescope, True

    def value(self, name):
        """A property."""
        telescope = self._telescope
        (ra, dec), site = telescope.look()[1], telescope.site
        kind = next(number for number, kind in KINDS.items() if kind == telescope.mount.kind)
        now = {'RightAscension': ra / HOUR, 'Declination': dec / DEG,
               'Slewing': telescope.slewing, 'Tracking': telescope.tracking,
               'SideOfPier': int(telescope.beyond), 'AtPark': self._parked}
        return {name.lower(): value for name, value in {
            **now, 'DeviceState': [{'Name': name, 'Value': value} for name, value in now.items()],
            'Connected': True, 'AlignmentMode': kind, 'EquatorialSystem': 1, 'CanSlewAsync': True,
            'SiteLatitude': site.latitude / DEG, 'SiteLongitude': float(wrap(site.longitude)) / DEG,
            'SiteElevation': site.height, 'SupportedActions': [TRUE_PLACE]}.items()}[name]

    def obey(self, order, given):
        """An order."""
        telescope = self._telescope
        if order == 'slewtocoordinatesasync':
            if self._parked:
                raise ValueError('it is parked')
            telescope.goto(float(given['RightAscension']) * HOUR, float(given['Declination']) * DEG)
        elif order == 'tracking':
            telescope.track(given['Tracking'] == 'True')
        elif order == 'abortslew':
            if telescope.slewing:
                telescope.abort()
        elif order == 'unpark':
            self._parked = False
        elif order == 'action' and given['Action'] == TRUE_PLACE:
            axes, _, true = telescope.look()
            return ' '.join(repr(float(value)) for value in (*true, axes[1]))
        elif order != 'connected':
            raise KeyError(order)
        return None


@contextmanager
def _serve(given):
    mount = parse_mount(given.kind, DEFAULT_SITE.latitude)
    errors = draw_errors(given.seed, TERMS[mount.vertical])
    with SimulatedTelescope(TwoAxes(mount, DEFAULT_SITE, errors), given.port) as server:
        yield server, errors, ''


def main(args=None):
    """Run it; return the exit code."""
    return simulate(__doc__, 'alpaca', PORTS['alpaca'], _serve, args)


if __name__ == '__main__':
    sys.exit(main())
