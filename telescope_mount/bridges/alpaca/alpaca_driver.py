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

"""A mount of an Alpaca server with the interface of the graph."""

import threading
import time

import numpy as np

from msg_tools.units import wrap
from pointing_model.sky.places import SIDEREAL, sidereal_time

from ..axes_and_places import HOUR, axes_at
from ..connection import RETRY
from ..dead_man import ALPACA, DeadMan
from ..goto_mount import GotoMount, Tick
from .alpaca_telescope import AlpacaError, AlpacaTelescope

#: s: with a larger error of its sidereal time a mount leaves the path that the guard has checked
CLOCK_OFF = 60.0


class AlpacaDriver(GotoMount):
    """`GotoMount` of an Alpaca server, which must be polled for everything.

    Parameters
    ----------
    host, port, number
        See `AlpacaTelescope`.
    mount, site, tolerance, retry
        See `GotoMount`.
    set_site : bool
        Whether to send the site to the driver.
    period : float
        Polling interval, s.
    dead_man : bool
        Whether a separate process stops the mount if this one dies.
    """

    def __init__(self, host, port, mount, site, number=0, tolerance=1.5e-5, set_site=True,
                 period=0.1, dead_man=True, retry=RETRY):
        super().__init__(f'{host}:{port}', mount, site, tolerance, retry)
        self._host, self._port, self._number = host, port, number
        self._set_site, self._period, self._dead_man = set_site, period, dead_man
        self._over = threading.Event()
        self._poller = threading.Thread(target=self._poll, daemon=True)

    def open(self):
        """Start polling."""
        self._poller.start()

    def shut(self):
        """Stop polling."""
        self._over.set()
        self._poller.join(6.0)

    def find(self):
        """The telescope, ready to be pointed."""
        telescope = AlpacaTelescope(self._host, self._port, self._number)
        elsewhere = self.check(telescope, self._set_site)
        telescope.prepare(self.site if elsewhere else None)
        here = sidereal_time(time.time(), self.site)
        ahead = float(wrap(telescope.ask('SiderealTime', here / HOUR) * HOUR - here)) / SIDEREAL
        if abs(ahead) > CLOCK_OFF:
            raise AlpacaError(f'{telescope.device}: its sidereal time is {ahead:+.0f} s from that '
                              'of this machine and site: set its clock, time zone and longitude')
        if self.mount.two_sided and telescope.beyond is None:
            raise AlpacaError(f'{telescope.device} does not report its side of the pier: a German '
                              'mount cannot be read without it')
        if self._dead_man and self.stopper is None:
            self.stopper = DeadMan(self._host, self._port, str(self._number), kind=ALPACA)
        return telescope

    def _poll(self):
        while not self._over.wait(self._period):
            telescope = self.telescope
            if telescope is None:
                continue
            try:
                stamp = telescope.poll()
                place = telescope.place[0]
            except (AlpacaError, TypeError):
                self.lost()
                continue
            axes = axes_at(self.mount, *place, stamp * 1e-9, self.site,
                           self.mount.two_sided and bool(telescope.beyond))
            self.take(Tick(stamp, np.array(axes), place, not telescope.slewing))
