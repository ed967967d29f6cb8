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

"""A camera of an INDI server: single exposures and their times."""

import tempfile
import threading
import time
import zlib
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

from msg_tools.iso_time import iso_seconds

from .client import IndiError

EXPOSURE, VALUE = 'CCD_EXPOSURE', 'CCD_EXPOSURE_VALUE'
#: bit of DRIVER_INTERFACE of a camera
CCD = 2
#: most s after the exposure until the image arrives
READOUT = 60.0
#: largest plausible difference between the clocks of camera and this machine, s
LARGEST_OFFSET = 2.0


class CameraImage(NamedTuple):
    """An image.

    Attributes
    ----------
    data : bytes
        Content of a FITS file.
    middle : int
        Middle of the exposure, ns since 1970.
    note : str
        Warning about its time; '' for none.
    """

    data: bytes
    middle: int
    note: str

    def solved(self, solve):
        """Result of `solve`, called with the path of the image."""
        with tempfile.TemporaryDirectory(prefix='indi_image_') as folder:
            path = Path(folder) / 'image.fits'
            path.write_bytes(self.data)
            return solve(path)


class IndiCamera:
    """One camera.

    Parameters
    ----------
    client : IndiClient
        Its `blob` must be this camera's `take`.
    device : str
        Name of the camera; '': the only one on the server.
    """

    def __init__(self, client, device=''):
        self.client, self.device = client, device
        self._came, self._blob = threading.Event(), None

    def take(self, device, values, formats):
        """`blob` of an `IndiClient`."""
        if device == self.device:
            for name, data in values.items():
                self._blob = data, formats[name]
                self._came.set()

    def lose(self):
        """Called when the connection is lost: wakes a waiting `expose`."""
        self._blob = None
        self._came.set()

    def connect(self):
        """Let the server connect to the camera and send its images; IndiError on failure."""
        client = self.client
        if not self.device:
            self.device = client.only('camera', CCD)
        if client.property(self.device, 'CONNECTION').on != 'CONNECT':
            client.switch(self.device, 'CONNECTION', 'CONNECT')
        client.property(self.device, EXPOSURE)
        upload = client.get(self.device, 'UPLOAD_MODE')
        if upload is not None and upload.on == 'UPLOAD_LOCAL':
            client.switch(self.device, 'UPLOAD_MODE', 'UPLOAD_CLIENT')
        client.enable_blobs(self.device)

    def expose(self, seconds):
        """Take one exposure, a `CameraImage`.

        Raises
        ------
        IndiError
            There is no image, or it is not a FITS image.
        """
        self._came.clear()
        began = time.time_ns()
        self.client.send(self.device, EXPOSURE, **{VALUE: seconds})
        if not self._came.wait(seconds + READOUT):
            raise IndiError(f'no image of {self.device} within {READOUT:g} s of its exposure')
        if self._blob is None:
            raise IndiError(f'no image of {self.device}: the connection to the server is lost')
        data, kind = self._blob
        if kind.endswith('.z'):
            data = zlib.decompress(data)
        if not data.startswith(b'SIMPLE'):
            raise IndiError(f'{self.device} sends images as {kind}: set it to FITS')
        return CameraImage(data, *_middle(data, began, seconds))


def _middle(data, began, seconds):
    """Middle of the exposure, ns, by the camera's own stamp if plausible; and a warning."""
    from astropy.io import fits
    header = fits.getheader(BytesIO(data))
    here = began + round(seconds * 0.5e9)
    stamp = header.get('DATE-OBS')
    if stamp is None:
        return here, 'the camera reports no DATE-OBS: exposures are taken to begin when asked for'
    try:
        start = iso_seconds(str(stamp))
        there = round((start + 0.5 * float(header.get('EXPTIME', seconds))) * 1e9)
    except ValueError:
        return here, f'DATE-OBS {stamp!r} of the camera is no time'
    offset = (there - here) * 1e-9
    if abs(offset) > LARGEST_OFFSET:
        return here, (f'the clock of the camera is {offset:.1f} s off: set it; exposures are taken '
                      'to begin when asked for')
    return there, ''
