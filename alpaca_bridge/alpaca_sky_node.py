"""The sky that a simulated telescope of an Alpaca server sees: where a star lies from it.

What a driver of a real mount reports is what it believes, and no camera: that needs one.
"""

import sys

from indi_bridge.indi_sky_node import FIELD_PARAMS, IndiSky
from indi_bridge.sources import Source
from msg_tools.lifecycle import AUTOSTART
from msg_tools.node import run_node
from pointing_model.sky_params import KIND_OF_MOUNT, SKY_PARAMS

from .params import SERVER_PARAMS
from .telescope import AlpacaTelescope

PARAMS = AUTOSTART, *SERVER_PARAMS, *SKY_PARAMS, KIND_OF_MOUNT, *FIELD_PARAMS


class TrueSky(Source):
    """A simulator that tells where it truly looks, when it is asked.

    Parameters
    ----------
    host, port, number
        As of `telescope.AlpacaTelescope`.
    field : indi_bridge.seen.StarField
    rate : float
        Exposures a second.
    """

    def __init__(self, host, port, number, field, rate=2.0):
        super().__init__(field, f'{host}:{port}')
        self._server, self._rate = (host, port, number), rate

    def work(self):
        """Ask, until nobody answers or nobody wants it."""
        telescope = AlpacaTelescope(*self._server)
        telescope.knows_where_it_looks()
        self.why = ''
        while self.on and not self._closed:
            stamp, (*place, second) = telescope.true_place()
            self.seen.append((stamp, self.field.miss(stamp, place, second)))
            self._wake.wait(1.0 / self._rate)
            self._wake.clear()


class AlpacaSky(IndiSky):
    """As `IndiSky`, of another protocol."""

    def __init__(self, **kwargs):
        super().__init__('alpaca_sky', PARAMS, 'what an Alpaca mount sees', **kwargs)

    def make_source(self, field):
        """That of the parameters."""
        value = self.value
        return TrueSky(value('host'), value('port'), value('number'), field, value('rate_hz'))


def main(args=None):
    """Entry point of ``ros2 run telescope_mount alpaca_sky``."""
    sys.exit(run_node(AlpacaSky, args))


if __name__ == '__main__':
    main()
