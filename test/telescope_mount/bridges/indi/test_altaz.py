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

"""An alt-azimuth mount of an INDI server: its axes, tracks, stops, and the errors of its parts."""

import re
import time

import numpy as np
import pytest
from fake_server import TELESCOPE, FakeServer, switch
from guarded import Guarded
from two_axes import TERMS, TwoAxes, draw_errors
from two_axes_server import TwoAxesServer

from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import ALTAZ
from pointing_model.runs.run import PointingRun
from pointing_model.sky.site import DEFAULT_SITE
from telescope_mount.bridges.axes_and_places import axes_at
from telescope_mount.bridges.goto_mount import NO_AXES
from telescope_mount.bridges.indi.client import IndiClient, IndiError
from telescope_mount.bridges.indi.indi_telescope import (
    SIMULATOR,
    IndiTelescope,
    check_kind,
    find_device,
)

pytest.importorskip('indipyclient', reason='indipyclient is not installed (extra indi)')


def test_behind_the_guard_it_is_brought_onto_a_track_stands_and_parks():
    telescope = TwoAxes(ALTAZ, DEFAULT_SITE, draw_errors(4, TERMS[True]))
    with TwoAxesServer(telescope) as server, Guarded(
            server.port, ALTAZ, ((-270.0, 270.0), (-5.0, 89.0)), dead_man=False, retry=0.1,
            fresh=0.0) as mount:
        mount.until(lambda: mount.here is not None)
        assert mount.driver.state() == (NO_AXES, False)  # as its driver believes
        assert mount.here / DEG == pytest.approx((0.0, 80.0))
        mount.ask(-4.0, 78.0)  # across north, by azimuths below 0
        mount.until(lambda: telescope.tracking and not telescope.slewing
                    and mount.supervisor.state == 'following' and mount.off() < 1.5)
        with pytest.raises(ValueError, match='elevation'):
            mount.ask(0.0, 89.5)
        mount.ask(40.0, 60.0)
        mount.until(lambda: telescope.slewing)
        mount.asked = None  # the commander is gone
        mount.until(lambda: mount.supervisor.state == 'stopped' and not telescope.tracking)
        mount.supervisor.park(time.time_ns(), (0.1, 80.0 * DEG))
        mount.until(lambda: mount.supervisor.state == 'parked')
        mount.until(lambda: not telescope.tracking)


def test_its_errors_are_found_as_terms():
    errors = draw_errors(5, TERMS[True])
    now, rows = [1_768_482_000.0], []
    telescope = TwoAxes(ALTAZ, DEFAULT_SITE, errors, clock=lambda: now[0])
    rng = np.random.default_rng(5)
    for az, el in zip(rng.uniform(0.0, 360.0, 16), rng.uniform(20.0, 75.0, 16)):
        telescope.goto(*np.array(_place(az * DEG, el * DEG, now[0])))
        for _ in range(2):
            now[0] += 60.0
            axes, _, true = telescope.look()
        rows.append((now[0], *axes_at(ALTAZ, *true, now[0], DEFAULT_SITE, False), *axes))
    run = PointingRun(dict(zip(('time', 'az', 'el', 'az_enc', 'el_enc'), np.array(rows).T)),
                      {'mount': ALTAZ, 'site': DEFAULT_SITE})
    model = fit_terms(run, tuple(errors)).model
    off = {name: (model.terms[name] - errors[name]) / ARCSEC for name in errors}
    # the parts are turned in another order than the model has them: second order
    assert max(map(abs, off.values())) < 1.0


def _place(az, el, now):
    from telescope_mount.bridges.axes_and_places import place_of_date
    return place_of_date(ALTAZ, (az, el), now, DEFAULT_SITE)


def test_indis_simulator_set_to_altaz_is_refused_as_its_axes_are_of_another_mount():
    kind = switch('MOUNT_TYPE', {'ALTAZ': 'On', 'EQ_FORK': 'Off', 'EQ_GEM': 'Off'}, 'def')
    properties = re.sub('(<defText name="DRIVER_INTERFACE">5</defText>)',
                        rf'\1<defText name="DRIVER_EXEC">{SIMULATOR}</defText>', TELESCOPE + kind)
    with FakeServer(properties) as server, IndiClient('localhost', server.port) as client:
        telescope = IndiTelescope(client, find_device(client))
        telescope.connect()
        assert telescope.kind == 'altaz'
        with pytest.raises(IndiError, match='but its axes are hour angle and declination'):
            check_kind(telescope, telescope.kind)
