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

"""A node for a mount of a server: its axes as joint states, `command` as goto and track."""

from contextlib import suppress

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.node import Param
from msg_tools.node_lifecycle import WorkerNode
from pointing_model.sky.sky_params import mount_of

from .axes_and_places import check_kind
from .connection import BridgeError

TOLERANCE = Param('tolerance_arcsec', 1.0, 'axes that are farther from their demand are sent again '
                  '[arcsec]', 0.1, 3600.0, fixed=True)
#: s for which home waits until the mount is ready
WAIT = 5.0


class MountBridge(WorkerNode):
    """Owns the connection; `goto_mount` does the computations. A protocol has `make_driver(mount)`.

    Parameters
    ----------
    name, params, hardware_id, **kwargs
        See `WorkerNode`.
    """

    def __init__(self, name, params, hardware_id, **kwargs):
        super().__init__(name, params, hardware_id=hardware_id, **kwargs)
        mount = mount_of(self)
        check_kind(mount)  # refuse other kinds at once
        self._names = mount.names.keys
        self.worker = self._driver = self.make_driver(mount)
        self._before = None
        self._pub = self.publisher(topics.INCREMENTAL)
        self.subscribe(topics.COMMAND, self._on_command)
        self.serve('home', self._home)
        self.every(0.02, self._tick)

    def deactivated(self):
        """Stop the mount."""
        with suppress(BridgeError):  # not connected: then nothing was commanded
            self._driver.abort()

    def _on_command(self, message):
        self._driver.command(*self.read_command(message, self._names))

    def _home(self):
        if not self.active:
            return False, self.inactive
        try:
            self._driver.wait_ready(WAIT)
            self._driver.unpark()
        except BridgeError as err:
            return False, str(err)
        return True, ('the zero is that of the driver, which is left as it is; the mount is ready')

    def _tick(self):
        for stamp, angles in self._driver.readings():
            self._pub.publish(convert.joint_state(
                stamp, angles, self._rate(stamp, angles), names=self._names))
        try:
            self._driver.step()
        except BridgeError as err:
            self.reject(topics.COMMAND.name, str(err))
        self.log_change(self._driver.state()[0], 'the mount is ready')

    def _rate(self, stamp, angles):
        before, self._before = self._before, (stamp, angles)
        if before is None or not 0 < stamp - before[0] < 1e9:
            return np.full(2, np.nan)
        return (angles - before[1]) / ((stamp - before[0]) * 1e-9)

    def problems(self):
        """No connection, no encoders, or the wrong side of the pier."""
        text, lost = self._driver.state()
        return [(DiagnosticStatus.ERROR if lost else DiagnosticStatus.WARN, text)] if text else []

    def details(self):
        """Device, side of the pier, and correction of the driver's own model."""
        return [*super().details(), *self._driver.details()]
