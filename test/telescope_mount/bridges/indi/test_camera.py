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

"""The sky by the plate solves of a camera of an INDI server."""

import base64
import shutil
import time
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from fake_server import FakeServer, number, switch
from plate_solved import draw

from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import Mount, is_beyond
from pointing_model.runs.formats.csv import iso_utc
from pointing_model.runs.plate_solves.fits_images import PlateSolution
from pointing_model.runs.plate_solves.frames import ICRS
from pointing_model.runs.plate_solves.solvers import NotSolved, find_solver
from pointing_model.sky.places import icrs_to_observed
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import load_catalogue
from telescope_mount.bridges.indi.indi_camera import CCD
from telescope_mount.bridges.indi.indi_sources import SolvedSky
from telescope_mount.bridges.star_field import StarField

if find_spec('astropy') is None:
    pytest.skip('needs astropy (./install.sh ros,test,images)', allow_module_level=True)
pytest.importorskip('indipyclient', reason='indipyclient is not installed (extra indi)')
CAMERA = (
    switch('CONNECTION', {'CONNECT': 'Off', 'DISCONNECT': 'On'}, 'def', device='Eye')
    + '<defTextVector device="Eye" name="DRIVER_INFO" state="Ok" perm="ro">'
      f'<defText name="DRIVER_INTERFACE">{CCD}</defText></defTextVector>'
    + number('CCD_EXPOSURE', {'CCD_EXPOSURE_VALUE': 1}, 'def', device='Eye')
    + '<defBLOBVector device="Eye" name="CCD1" state="Idle" perm="ro">'
      '<defBLOB name="CCD1"/></defBLOBVector>')
EXPOSURE = 0.2
MOUNT = Mount.equatorial(DEFAULT_SITE.latitude, 'german')


class CameraServer(FakeServer):
    """Sends an image for each exposure; `late` s are on its clock."""

    def __init__(self, image, late=0.0):
        super().__init__(CAMERA)
        self.image, self.late, self.began = image, late, []

    def _obey(self, tag, head, body):
        if 'CCD_EXPOSURE' not in head:
            super()._obey(tag, head, body)
            return
        self.began.append(time.time())
        start = np.array([self.began[-1] + self.late])
        data = self.image({'DATE-OBS': iso_utc(start)[0].rstrip('Z'), 'EXPTIME': EXPOSURE})
        self.say('<setBLOBVector device="Eye" name="CCD1" state="Ok">'
                 f'<oneBLOB name="CCD1" size="{len(data)}" format=".fits">'
                 f'{base64.b64encode(data).decode()}</oneBLOB></setBLOBVector>')


def blank(cards):
    from astropy.io import fits
    out = BytesIO()
    fits.writeto(out, np.zeros((4, 4), np.int16), fits.Header(cards))
    return out.getvalue()


class Solver:
    """Finds a place, or does not."""

    def __init__(self, ra, dec, solves=True):
        self.place, self.solves = (ra / DEG, dec / DEG), solves

    def solve(self, path):
        assert path.read_bytes().startswith(b'SIMPLE')
        if not self.solves:
            raise NotSolved('no solution')
        return PlateSolution(*self.place, 60.0, -1, ICRS), 1.0


def a_star():
    """One that is well up now and alone, and its angles of perfect axes, not through the pole."""
    stars = load_catalogue(mag_limit=3.0)
    ra, dec = stars.at_j2000[:2]
    az, el = icrs_to_observed(ra, dec, time.time(), DEFAULT_SITE, DEFAULT_WEATHER)
    up = np.flatnonzero((el > 40.0 * DEG) & (np.abs(dec) < 60.0 * DEG))
    # a solve is of J2000: one that hardly moves
    row = up[np.argmin(np.hypot(*stars.at_j2000[2:4])[up])]
    return ra[row], dec[row], float(stars.mag[row])


def seen(server, solver, second=30.0 * DEG, exposure=EXPOSURE):
    """What comes of the first exposure, and the source."""
    field = StarField(MOUNT, DEFAULT_SITE, DEFAULT_WEATHER, 0.3 * DEG, 3.5)
    source = SolvedSky('localhost', server.port, field, '', solver, exposure)
    source.take_axes(second)
    source.start()
    try:
        end = time.monotonic() + 30.0
        while not source.exposures:
            assert time.monotonic() < end, source.why
            time.sleep(0.01)  # polls: of a thread of the source
        return *source.exposures[0], source
    finally:
        source.close()


@pytest.mark.parametrize('beyond', [False, True])
def test_a_solve_beside_a_star_is_its_miss_distance_in_the_middle_of_the_exposure(beyond):
    ra, dec, _ = a_star()
    second = np.pi - dec if beyond else dec
    assert is_beyond(second) == beyond
    east, north = 300.0 * ARCSEC, -200.0 * ARCSEC
    with CameraServer(blank) as server:
        stamp, miss, source = seen(server, Solver(ra - east / np.cos(dec), dec - north), second)
        assert stamp * 1e-9 == pytest.approx(server.began[0] + EXPOSURE / 2.0, abs=1e-3)
        assert 'enableBLOB' in ' '.join(server.got) and not source.note
    # the first angle rises to the west, and through the pole both are reversed
    side = -1.0 if beyond else 1.0
    assert miss / ARCSEC == pytest.approx((-300.0 * side, -200.0 * side), abs=4.0)


def test_what_is_odd_is_said_and_an_image_without_a_place_is_no_star():
    ra, dec, _ = a_star()
    with CameraServer(blank, late=40.0) as server:
        stamp, _, source = seen(server, Solver(ra, dec))
        assert 'the clock of the camera is 40.0 s off' in source.note
        assert stamp * 1e-9 == pytest.approx(server.began[0] + EXPOSURE / 2.0, abs=0.5)
    with CameraServer(blank) as server:
        _, miss, source = seen(server, Solver(ra, dec, solves=False))
        assert np.isnan(miss).all() and 'was not solved: no solution' in source.note


@pytest.mark.skipif(not shutil.which('solve-field') or not list(Path('/usr/share/astrometry').glob(
    'index-tycho2-*')), reason='no solve-field with index files of Tycho-2')
def test_a_real_solver_finds_it_on_an_image_of_the_catalogue(tmp_path):
    ra, dec, _ = a_star()
    east = 400.0 * ARCSEC

    def image(cards):
        draw(tmp_path / 'drawn.fits', ra - east / np.cos(dec), dec, cards)
        data = (tmp_path / 'drawn.fits').read_bytes()
        (tmp_path / 'drawn.fits').unlink()
        return data
    with CameraServer(image) as server:
        _, miss, _ = seen(server, find_solver('solve-field', 20.0, (50.0, 70.0)), dec)
    assert miss / ARCSEC == pytest.approx((-400.0, 0.0), abs=15.0)  # a pixel is 60
