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

"""Images of an INDI camera for ``bolts --live``: single exposures with axis readings."""

import time

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import through_pole
from pointing_model.runs.plate_solves.solvers import NotSolved
from pointing_model.sky.places import sidereal_time
from pointing_model.sky.site import Site

from ..connection import parse_address
from .client import IndiClient, IndiError
from .indi_camera import IndiCamera
from .indi_telescope import IndiTelescope, find_device


def server_of(text):
    """Host, port and camera of ``indi:HOST[:PORT[:CAMERA]]``; ValueError for other texts."""
    *server, camera = [*text.split(':', 3), ''][:4]
    return *parse_address(':'.join(server)), camera


class BoltCamera:
    """A camera of an INDI server that also has its mount.

    Parameters
    ----------
    where : str
        See `server_of`.
    exposure : float
        Exposure time, s.
    solve : callable
        ``solve(path)`` -> `PlateSolution`, sigma in arcsec or NaN; raises NotSolved.
    place : callable
        ``place(solution, sigma, time, first, second, site, name)`` -> `image_alignment.Image`.
    site : dict
        ``latitude``, ``longitude`` in degrees and ``height``, if given; they replace those of
        the driver.

    Attributes
    ----------
    site : Site
    kind : str
        Kind of mount, '' if the driver does not report it.
    """

    def __init__(self, where, exposure, solve, place, site):
        self._exposure, self._solve, self._place = exposure, solve, place
        host, port, camera = server_of(where)
        self._client = IndiClient(host, port, blob=lambda *of: self._camera.take(*of))
        self._camera = IndiCamera(self._client, camera)
        self._count, self._given = 0, site
        self.site, self.kind, self._telescope = None, '', None

    def __enter__(self):
        self._client.start()
        try:
            self._telescope = telescope = IndiTelescope(self._client, find_device(self._client))
            telescope.connect()
            self._camera.connect()
            self.kind = telescope.kind
            if self.kind == 'altaz':
                raise ValueError(f'{telescope.device} is an alt-azimuth mount: it has no bolts of '
                                 'a polar axis')
            own = dict(zip(('latitude', 'longitude', 'height'), telescope.site or ()))
            own = {name: value if name == 'height' else value / DEG for name, value in own.items()}
            own.update({name: value for name, value in self._given.items() if value is not None})
            if not {'latitude', 'longitude'} <= set(own):
                raise ValueError('the driver gives no site: --latitude and --longitude')
            self.site = Site(own['latitude'] * DEG, own['longitude'] * DEG,
                             own.get('height', 0.0))
        except BaseException:
            self._client.close()
            raise
        return self

    def __exit__(self, *_):
        self._client.close()

    def new_images(self):
        """One exposure, like `live_bolts.LiveFolder.new_images`; none while the mount slews."""
        if self._telescope.slewing:
            return
        image = self._camera.expose(self._exposure)
        if self._telescope.slewing:
            return
        came, self._count = time.time(), self._count + 1
        name, moment = f'image {self._count}', image.middle * 1e-9
        try:
            solution, sigma = image.solved(self._solve)
            yield name, came, self._place(solution, sigma, moment, *self._readings(moment),
                                          self.site, name), None
        except NotSolved as error:
            yield name, came, None, str(error)

    def _readings(self, moment):
        """Hour angle and declination reported by the mount, rad, at a moment."""
        telescope = self._telescope
        if telescope.has_axes:
            return telescope.axes[0].tolist()
        if telescope.place is None:
            raise IndiError(f'{telescope.device} does not report its position')
        (ra, dec), received = telescope.place
        # the right ascension of a mount at rest belongs to the time of its last report
        at = moment if telescope.tracks else received * 1e-9
        hour = float(wrap(sidereal_time(np.array([at]), self.site)[0] - ra))
        if telescope.beyond:
            return [float(v) for v in through_pole(hour, dec, True)]
        return hour, float(dec)
