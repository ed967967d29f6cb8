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

"""A mount of an INDI server with the interface of the graph."""

import contextlib
import time

from ..connection import RETRY
from ..dead_man import DeadMan
from ..goto_mount import GotoMount
from .client import IndiClient, IndiError
from .indi_telescope import IndiTelescope, Ticks, check_kind, find_device

#: s in which a driver that was just connected, or sent its site, reports its axes again; with a
#: mount at rest it may report nothing
FRESH = 2.0


class MountDriver(GotoMount):
    """`GotoMount` of an INDI server.

    Parameters
    ----------
    host, port : str, int
    mount, site, tolerance, retry
        See `GotoMount`.
    device, axes : str
        See `indi_telescope.find_device` and `indi_telescope.IndiTelescope`.
    set_site : bool
        Whether to send the site to the driver.
    period_ms : int
        Interval of its readings, if it can be set; 0: unchanged.
    dead_man : bool
        Whether a separate process stops the mount if this one dies.
    fresh : float
        Longest wait for axes that were measured after the preparation, s.
    """

    def __init__(self, host, port, mount, site, device='', axes='', tolerance=1.5e-5,
                 set_site=True, period_ms=0, dead_man=True, retry=RETRY, fresh=FRESH):
        super().__init__(f'{host}:{port}', mount, site, tolerance, retry)
        self._device, self._axes, self._set_site = device, axes, set_site
        self._period_ms, self._dead_man, self._fresh_within = period_ms, dead_man, fresh
        self._ticks = Ticks(self.take)
        self.client = IndiClient(host, port, update=self._ticks, connection=self._connection)

    def open(self):
        """Start to connect; returns immediately."""
        self.client.start()

    def shut(self):
        """End the connection."""
        self.client.close()

    def _connection(self, up):
        if up:
            self.wake()
        else:
            self._ticks.telescope = None
            self.lost()

    def find(self):
        """The telescope of the server, ready to be pointed."""
        device = find_device(self.client, self._device)
        telescope = IndiTelescope(self.client, device, self._axes, self.mount.vertical)
        telescope.connect()
        check_kind(telescope, self.mount.kind)
        self.check(telescope, self._set_site)
        if self._period_ms and telescope.get('POLLING_PERIOD') is not None:
            self.client.send(device, 'POLLING_PERIOD', PERIOD_MS=float(self._period_ms))
        # send an unchanged site too: drivers that have it from a file may not apply it
        telescope.prepare(self.site if self._set_site else None)
        if telescope.has_axes:
            sent = time.time_ns()
            with contextlib.suppress(IndiError):
                self.client.wait(lambda: telescope.axes[1] > sent, 'no reading',
                                 self._fresh_within)
        if self._dead_man and self.stopper is None:
            self.stopper = DeadMan(self.client.host, self.client.port, device)
        self._ticks.telescope = telescope
        return telescope
