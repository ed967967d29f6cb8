"""The camera of a mount that INDI simulates: where the brightest star is that it would see.

Only of a simulator, which knows where it truly looks. What a driver of a real mount reports is what
it believes, and no camera: there a node of the user's own publishes `camera/miss_distance`.
"""

import sys
import threading
from collections import deque

from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.node import MountNode, Param, run_node
from msg_tools.units import ARCSEC, DEG
from pointing_model.sky_params import KIND_OF_MOUNT, SKY_PARAMS, mount_of, sky_of

from .client import IndiClient, IndiError
from .params import SERVER_PARAMS
from .seen import StarField
from .telescope import IndiTelescope, Ticks, find_device, knows_where_it_looks

PARAMS = (
    *SERVER_PARAMS, *SKY_PARAMS, KIND_OF_MOUNT,
    Param('field_deg', 0.33, 'radius of the field [deg]', 0.01, 5.0, fixed=True),
    Param('magnitude_limit', 8.0, 'faintest star, Hipparcos magnitude', -2.0, 12.0, fixed=True),
    Param('noise_arcsec', 0.3, 'noise of each axis [arcsec]', 0.0, 60.0, fixed=True),
    Param('seed', 1, 'of the noise', 0, 2**31 - 1, fixed=True),
    Param('rate_hz', 2.0, 'exposures a second at most [Hz]', 0.1, 20.0, fixed=True),
)
#: s
RETRY = 3.0


class IndiSky(MountNode):
    """An exposure at a tick of the driver; NaN says that no star was measured."""

    def __init__(self, **kwargs):
        super().__init__('indi_sky', PARAMS, hardware_id='what an INDI simulator sees', **kwargs)
        value = self.value
        self._field = StarField(
            mount_of(self), *sky_of(self), value('field_deg') * DEG, value('magnitude_limit'),
            value('noise_arcsec') * ARCSEC, value('seed'))
        self._tick, self._seen = None, deque(maxlen=100)
        self._last, self._without = 0, 0
        self._why, self._said = 'connecting', ''
        self._pub = self.publisher(topics.MISS_DISTANCE)
        self._ticks = Ticks(self._take)
        self._client = IndiClient(value('host'), value('port'), heard=self._ticks,
                                  connection=self._connection)
        self._wake, self._closed = threading.Event(), False
        self._client.start()
        threading.Thread(target=self._find, daemon=True).start()
        self.every(0.05, self._expose)

    def _connection(self, up):
        if not up:
            self._ticks.telescope, self._tick = None, None
            self._why = f'the connection to {self._client.host}:{self._client.port} is lost'
        self._wake.set()

    def _find(self):
        while not self._closed:
            if self._ticks.telescope is None:
                try:
                    telescope = IndiTelescope(
                        self._client, find_device(self._client, self.value('device')),
                        self.value('axes'))
                    telescope.connect()
                    knows_where_it_looks(telescope)
                    self._ticks.telescope, self._why = telescope, ''
                except (IndiError, OSError) as err:
                    self._why = str(err)
            self._wake.wait(RETRY)
            self._wake.clear()

    def _take(self, tick):
        """The place of a tick is known when the next one begins: unchanged, it is not sent."""
        before, telescope = self._tick, self._ticks.telescope
        if tick.place is not None:
            self._tick = tick
            return
        self._tick = tick
        if before is None or before.stamp - self._last < 1e9 / self.value('rate_hz'):
            return
        place = before.place if before.place is not None else telescope.place[0]
        self._last = before.stamp
        self._seen.append((before.stamp, place, before.axes[1]))

    def _expose(self):
        while self._seen:
            stamp, place, second = self._seen.popleft()
            miss = self._field.miss(stamp, place, second)
            self._without += int(miss[0] != miss[0])
            self._pub.publish(convert.vector(stamp, *miss, 'camera'))
        if self._why != self._said:
            self._said = self._why
            if self._why:
                self.get_logger().warning(self._why)
            else:
                self.get_logger().info('the simulator tells where it looks')

    def problems(self):
        """No connection, or a driver that does not know where it looks."""
        return [(DiagnosticStatus.ERROR, self._why)] if self._why else []

    def details(self):
        """Exposures without a star."""
        return [('exposures without a star', str(self._without))]

    def finish(self):
        """End the connection."""
        self._closed = True
        self._wake.set()
        self._client.close()


def main(args=None):
    """Entry point of ``ros2 run telescope_mount indi_sky``."""
    sys.exit(run_node(IndiSky, args))


if __name__ == '__main__':
    main()
