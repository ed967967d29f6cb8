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

"""Bolts by the images of a camera of an INDI server."""

import base64
import time
from importlib.util import find_spec
from io import BytesIO

import numpy as np
import pytest
from bolts import UP, Bolted
from fake_server import TELESCOPE, FakeServer, number, switch

from msg_tools.iso_time import iso_seconds
from msg_tools.units import ARCSEC, DEG
from pointing_model.runs.formats.csv import iso_utc
from pointing_model.sky.places import observed_to_icrs, sidereal_time
from pointing_model.sky.site import Site

if find_spec('astropy') is None:
    pytest.skip('needs astropy (./install.sh ros,test,images)', allow_module_level=True)
pytest.importorskip('indipyclient', reason='indipyclient is not installed (extra indi)')
CAMERA = (
    switch('CONNECTION', {'CONNECT': 'On', 'DISCONNECT': 'Off'}, 'def', device='Eye')
    + '<defTextVector device="Eye" name="DRIVER_INFO" state="Ok" perm="ro">'
      '<defText name="DRIVER_INTERFACE">2</defText></defTextVector>'
    + number('CCD_EXPOSURE', {'CCD_EXPOSURE_VALUE': 1}, 'def', device='Eye')
    + '<defBLOBVector device="Eye" name="CCD1" state="Idle" perm="ro">'
      '<defBLOB name="CCD1"/></defBLOBVector>')
SITE = Site(10.0 * DEG, -10.0 * DEG, 100.0)  # of the fake telescope
HOURS = [-40.0, -39.0, -5.0, 30.0, 30.0, -40.0, -5.0, 30.0]
TURNED_BEFORE = 4


class Sky(FakeServer):
    """A mount on bolts whose camera is asked for one image after the other.

    `axes` says whether the driver tells axes; else it tells a place of date.
    """

    def __init__(self, axes):
        super().__init__((TELESCOPE if axes else TELESCOPE.replace('MOUNT_AXES', 'OTHER'))
                         + CAMERA)
        self.axes, self.shots, self.place = axes, 0, None
        self.mount = Bolted(SITE.latitude, 'equatorial', UP, {'ca': 300.0 * ARCSEC})
        self.mount.turn_azimuth(0.5 * DEG)
        self.mount.raise_axis(0.3 * DEG)

    def _obey(self, tag, head, body):
        if 'CCD_EXPOSURE' not in head:
            super()._obey(tag, head, body)
            return
        from astropy.io import fits
        hour = HOURS[self.shots]
        if self.shots == TURNED_BEFORE:
            self.mount.turn_azimuth(-0.5 * DEG)
            self.mount.raise_axis(-0.3 * DEG)
        self.shots += 1
        now = time.time()
        if self.axes:
            self.say(number('MOUNT_AXES', {'PRIMARY': hour, 'SECONDARY': 20.0}))
        else:
            ra = np.mod(sidereal_time(np.array([now]), SITE)[0] - hour * DEG, 2.0 * np.pi)
            self.say(number('EQUATORIAL_EOD_COORD', {'RA': ra / (15.0 * DEG), 'DEC': 20.0}))
        self.place = self.mount.looks(np.array([hour * DEG]), np.array([20.0 * DEG]))[0]
        out = BytesIO()
        fits.writeto(out, np.zeros((4, 4), np.int16), fits.Header({
            'DATE-OBS': iso_utc(np.array([now]))[0].rstrip('Z'), 'EXPTIME': 0.0}))
        self.say('<setBLOBVector device="Eye" name="CCD1" state="Ok">'
                 f'<oneBLOB name="CCD1" size="{len(out.getvalue())}" format=".fits">'
                 f'{base64.b64encode(out.getvalue()).decode()}</oneBLOB></setBLOBVector>')


class Solver:
    """Knows where the mount looks."""

    kind = 'told'

    def __init__(self, server):
        self.server = server

    def solve(self, path, boresight=None):
        from astropy.io import fits

        from pointing_model.runs.plate_solves.fits_images import PlateSolution
        from pointing_model.runs.plate_solves.frames import ICRS
        east, north, up = self.server.place
        moment = iso_seconds(fits.getheader(path)['DATE-OBS'])
        ra, dec = observed_to_icrs(np.arctan2(east, north), np.arcsin(up), moment, SITE)
        return PlateSolution(float(ra) / DEG, float(dec) / DEG, 1.0, -1, ICRS), 0.5


@pytest.mark.parametrize('axes', [True, False])
def test_a_camera_of_a_server_takes_image_after_image(ended, monkeypatch, axes):
    with Sky(axes) as server:
        monkeypatch.setattr('telescope_mount.live_bolts.find_solver',
                            lambda *_: Solver(server))
        code, out, err = ended('bolts', '--live', f'indi:localhost:{server.port}', '--exposure',
                               0.01, '--every', 0.1, '--within', 20)
    assert err == '' and code == 0 and server.shots == len(HOURS)
    assert out.count('Image 1 of 3') == 2  # said once, though two images came of the first
    assert 'Three images are solved: the axis is 34' in out
    assert 'One image is solved' in out and 'Done: measured once more' in out


@pytest.mark.parametrize(('where', 'words'), [
    ('indi:', 'write indi:HOST'), ('indi:localhost:x', 'write indi:HOST'),
    ('indi:localhost:99999', 'write indi:HOST')])
def test_a_server_that_is_none_is_one_line(refused, monkeypatch, where, words):
    monkeypatch.setattr('telescope_mount.live_bolts.find_solver', lambda *_: None)
    assert words in refused('bolts', '--live', where)
