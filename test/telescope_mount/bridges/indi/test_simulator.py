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

"""INDI's own telescope simulator: its pointing model is found, and where it acts; the guard."""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from guarded import Guarded
from indi_server import DEVICE, SimulatorServer, missing
from indi_simulator import MODEL, set_model
from indi_survey import Survey, places
from two_axes import draw_errors

from calibration.analysis.sky_model import ON_SKY, origin_of_errors, with_errors
from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import Mount, is_beyond
from pointing_model.runs.run import PointingRun
from pointing_model.sky.site import Site
from telescope_mount.bridges.indi.client import IndiClient
from telescope_mount.bridges.indi.indi_telescope import CUSTOM, MODE, IndiTelescope, Ticks

pytest.importorskip('indipyclient', reason='indipyclient is not installed (extra indi)')
pytestmark = pytest.mark.skipif(bool(missing()), reason=missing() or 'all is there')

SEED = 16
SITE = Site()
MOUNT = Mount.equatorial(SITE.latitude, 'german')


def survey(wanted):
    """A server of its own, which waits for its slews beside the others."""
    observer = Survey(MOUNT, SITE)
    ticks = Ticks(observer.take)
    with SimulatorServer() as server, IndiClient('localhost', server.port, update=ticks) as client:
        telescope = ticks.telescope = observer.telescope = IndiTelescope(client, DEVICE)
        telescope.connect()
        set_model(telescope, draw_errors(SEED, MODEL))
        assert telescope.kind == 'german' and telescope.has_axes
        client.send(DEVICE, 'POLLING_PERIOD', PERIOD_MS=100)
        telescope.prepare(SITE)
        # beside other processes many messages are late: of more of them one is not
        return observer.run(wanted, ticks=24)


@pytest.fixture(scope='module')
def surveyed():
    """The pointings of four servers, which wait for their slews beside other tests."""
    # few that lie near each other; the full size is in benchmarks/indi.py
    wanted = places(8, SEED, SITE.latitude, hour_angles=(40.0 * DEG, 85.0 * DEG),
                    south=45.0 * DEG)
    east = wanted[:, 0] < 0.0
    parts = [*np.split(wanted[east], 2), *np.split(wanted[~east], 2)]
    with ThreadPoolExecutor(4) as pool:
        yield [pool.submit(survey, part) for part in parts]


def test_behind_the_guard_it_points_stands_and_says_what_is_lost(surveyed):
    with SimulatorServer() as server:
        with IndiClient('localhost', server.port) as client:
            telescope = IndiTelescope(client, DEVICE)
            telescope.connect()
            set_model(telescope, draw_errors(SEED, MODEL))
        _behind_the_guard(server)


def _behind_the_guard(server):
    with Guarded(server.port, MOUNT, ((-10.0, 190.0), (-90.0, 270.0)), SITE) as mount:
        mount.until(lambda: mount.here is not None)
        mount.ask(84.0, 84.0)
        mount.until(lambda: mount.supervisor.state == 'following' and mount.off() < 30.0)
        # below the horizon: refused, and what was under way stops
        with pytest.raises(ValueError, match='horizon of 10.0 deg'):
            mount.ask(150.0, 20.0)
        mount.asked = None
        mount.until(lambda: mount.supervisor.state == 'stopped')
        telescope = mount.driver.telescope
        mount.until(lambda: telescope.get('TELESCOPE_TRACK_STATE').on == 'TRACK_OFF')
        # a commander that is gone in the middle of a slew
        mount.ask(60.0, 60.0)
        mount.until(lambda: telescope.slewing)
        mount.asked = None
        mount.until(lambda: not telescope.slewing and mount.supervisor.state == 'stopped', 3.0)
        assert np.all(mount.here / DEG > 70.0)
        # and stands: an aborted slew goes on tracking, whatever it was told with the abort
        mount.until(lambda: not mount.driver._stopping, 4.0)
        here, end = telescope.axes[0], time.monotonic() + 0.5
        mount.until(lambda: time.monotonic() > end)
        assert not telescope.tracks and np.all(telescope.axes[0] == here)
        # and a server that dies in the middle of one
        mount.ask(60.0, 60.0)
        mount.until(lambda: telescope.slewing)
        server.stop()
        mount.until(lambda: 'no reading of the encoders' in mount.supervisor.reason)
        assert 'is lost: a mount whose driver still runs goes where it was sent last' in (
            mount.driver.state()[0])


def test_it_is_led_along_the_track_of_a_satellite():
    with SimulatorServer() as server:
        with IndiClient('localhost', server.port) as client:
            telescope = IndiTelescope(client, DEVICE)
            telescope.connect()
            set_model(telescope, draw_errors(SEED, MODEL))
        with Guarded(server.port, MOUNT, ((-10.0, 190.0), (-90.0, 270.0)), SITE) as mount:
            mount.until(lambda: mount.here is not None)
            mount.ask(80.0, 75.0, (-50.0, 110.0))  # as LAGEOS
            off = []

            def led():
                if mount.driver.telescope.last(MODE).on == CUSTOM:
                    off.append(mount.off())
                return len(off) > 300 and np.median(off[-100:]) < 3.0
            mount.until(led)
            # and stars again, by places, to the tolerance of either axis (3.1 arcsec)
            mount.ask(78.0, 76.0)
            mount.until(lambda: mount.supervisor.state == 'following' and mount.off() < 4.5
                        and mount.driver.telescope.last(MODE).on != CUSTOM)


def test_its_model_is_found_and_that_it_acts_on_the_sky(surveyed):
    run = PointingRun.concatenate([part.result() for part in surveyed])
    assert is_beyond(run['el_enc']).sum() == 4
    terms, origin = draw_errors(SEED, MODEL), origin_of_errors(run, tuple(MODEL))
    assert origin.holds == ON_SKY and origin.left_out['mount'] > 20.0 * ARCSEC
    model = fit_terms(with_errors(run, ON_SKY), tuple(MODEL)).model
    off = {name: (model.terms[name] - terms[name]) / ARCSEC for name in MODEL}
    assert abs(off.pop('IH')) < 3.0
    assert np.abs(list(off.values())).max() < 2.0
