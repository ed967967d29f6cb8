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

"""Sources of exposures for `indi_sky`: a simulator, or a camera's plate solves."""

import numpy as np

from msg_tools.node import Param
from pointing_model.mounts import is_beyond

from ..connection import PORTS
from ..star_field import SkySource
from .client import IndiClient, IndiError
from .indi_camera import IndiCamera
from .indi_telescope import IndiTelescope, Ticks, find_device, knows_where_it_looks


class IndiSource(SkySource):
    """A `SkySource` with a connection to an INDI server.

    Parameters
    ----------
    host, port : str, int
    field : StarField
    **calls
        See `client.IndiClient`.
    """

    def __init__(self, host, port, field, **calls):
        super().__init__(field, f'{host}:{port}')
        self.client = IndiClient(host, port, connection=self._connection, **calls)

    def start(self):
        """Begin; returns at once."""
        self.client.start()
        super().start()

    def close(self):
        """End the connection."""
        super().close()
        self.client.close()

    def _connection(self, up):
        if not up:
            self.lose()
            self.why = f'the connection to {self.where} is lost'
        self._reconnection.wake()


class TrueSky(IndiSource):
    """A simulator that reports its true pointing: exposures at its ticks.

    Parameters
    ----------
    host, port, field
        See `IndiSource`.
    device, axes : str
        See `indi_telescope.find_device` and `indi_telescope.IndiTelescope`.
    rate : float
        Most exposures per second.
    """

    def __init__(self, host, port, field, device='', axes='', rate=2.0):
        self.ticks = Ticks(self._take)
        super().__init__(host, port, field, update=self.ticks)
        self._device, self._axes, self._rate = device, axes, rate
        self._tick, self._last = None, 0

    def lose(self):
        """Forget the telescope."""
        self.ticks.telescope, self._tick = None, None

    def work(self):
        """Find the telescope."""
        if self.ticks.telescope is None:
            telescope = IndiTelescope(self.client, find_device(self.client, self._device),
                                      self._axes, self.field.mount.vertical)
            telescope.connect()
            knows_where_it_looks(telescope)
            self.ticks.telescope, self.why = telescope, ''

    def _take(self, tick):
        """Use the previous tick: an unchanged place is not sent, so it is only known afterwards."""
        before, telescope = self._tick, self.ticks.telescope
        self._tick = tick
        if tick.place is not None or before is None or telescope is None or (
                before.stamp - self._last < 1e9 / self._rate):
            return
        place = before.place if before.place is not None else telescope.place[0]
        self._last = before.stamp
        self.exposures.append((before.stamp, self.field.miss(before.stamp, place, before.axes[1])))


class SolvedSky(IndiSource):
    """Plate solves of a camera's successive exposures.

    Parameters
    ----------
    host, port, field
        See `IndiSource`.
    camera : str
        Name of the camera on the server.
    solver : pointing_model.runs.plate_solves.solvers.Solver
    exposure : float
        Exposure time, s.
    """

    def __init__(self, host, port, field, camera, solver, exposure):
        super().__init__(host, port, field, blob=lambda *of: self.camera.take(*of))
        self.camera = IndiCamera(self.client, camera)
        self._solver, self._exposure = solver, exposure
        self._second = None

    def lose(self):
        """Stop waiting for an image."""
        self.camera.lose()

    def take_axes(self, second):
        """Angle of the second axis, rad: shows whether the tube points through the pole."""
        self._second = float(second)

    def work(self):
        """Expose and solve, until something is missing or exposures are no longer wanted."""
        from pointing_model.runs.plate_solves.solvers import NotSolved
        self.camera.connect()
        self.why = ''
        while self.on and not self._reconnection.closed:
            image = self.camera.expose(self._exposure)
            self.why, self.note = '', image.note
            if self._second is None:
                raise IndiError('the mount reports no axes, so the side of the pier is unknown')
            try:
                self.exposures.append((image.middle, self._miss(image)))
            except NotSolved as err:
                self.note = f'an image was not solved: {err}'
                self.exposures.append((image.middle, np.full(2, np.nan)))

    def _miss(self, image):
        from pointing_model.runs.plate_solves.frames import ICRS, to_icrs
        found, _ = image.solved(self._solver.solve)
        time = image.middle * 1e-9
        ra, dec = to_icrs(np.radians(found.ra_deg), np.radians(found.dec_deg),
                          found.frame or ICRS, time)
        return self.field.miss_of(time, self.field.looks_at(
            time, float(ra), float(dec), bool(is_beyond(self._second))))


SERVER_PARAMS = (
    Param('host', 'localhost', 'where the INDI server runs', fixed=True),
    Param('port', PORTS['indi'], 'its port', 1, 65535, fixed=True),
    Param('device', '', 'name of the telescope there; empty: the only one', fixed=True),
    Param('axes', '', 'property of the driver with the axis angles and its two elements, in '
          'degrees, NAME:FIRST,SECOND; empty: MOUNT_AXES', fixed=True),
)
