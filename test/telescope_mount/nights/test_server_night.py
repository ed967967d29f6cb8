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

"""What a night asks of an INDI or Alpaca server before it starts a graph, and where it goes on."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from alpaca_simulator import SimulatedTelescope
from fake_server import TELESCOPE, FakeServer, switch
from places import ROOT
from two_axes import TwoAxes

from msg_tools.status_rows import Progress
from pointing_model.mounts import ALTAZ
from pointing_model.sky.site import DEFAULT_SITE, SITE
from telescope_mount.bridges.indi.indi_telescope import SIMULATOR
from telescope_mount.nights import whole_night as night
from telescope_mount.nights.night_files import Written
from telescope_mount.nights.real_night import run_server_night
from telescope_mount.nights.server_night import ask_server, nodes_of, parse_camera, server_plan
from telescope_mount.nights.whole_night import STATE
from telescope_mount.observing.night_file import NightFile
from telescope_mount.observing.plan import parse_plan

INFO = '<defText name="DRIVER_INTERFACE">5</defText>'
SIMULATED = TELESCOPE.replace(INFO, f'{INFO}<defText name="DRIVER_EXEC">{SIMULATOR}</defText>')


@pytest.fixture(autouse=True)
def indi():
    pytest.importorskip('indipyclient', reason='indipyclient is not installed (extra indi)')


def test_kind_and_site_are_the_drivers_unless_the_user_says():
    kind = switch('MOUNT_TYPE', {'ALTAZ': 'Off', 'EQ_FORK': 'Off', 'EQ_GEM': 'On'}, 'def')
    with FakeServer(SIMULATED + kind) as server:
        address = f'indi:localhost:{server.port}'
        found = ask_server(address, {'height_m': 5.0})
        assert found.server == {'host': 'localhost', 'port': server.port, 'device': 'Mount'}
        assert found.kind == 'german' and found.simulated and found.protocol == 'indi'
        assert found.sky == pytest.approx(
            {'latitude_deg': 10.0, 'longitude_deg': -10.0, 'height_m': 5.0})
        assert ask_server(f'{address}:equatorial').kind == 'equatorial'


def test_a_driver_that_is_still_telling_what_it_is_is_heard_out():
    site = re.search('<defNumberVector [^>]*name="GEOGRAPHIC_COORD".*?</defNumberVector>',
                     SIMULATED)[0]
    kind = switch('MOUNT_TYPE', {'ALTAZ': 'Off', 'EQ_FORK': 'On', 'EQ_GEM': 'Off'}, 'def')
    with FakeServer(SIMULATED.replace(site, ''), late=kind + site) as server:
        found = ask_server(f'indi:localhost:{server.port}')
    assert found.kind == 'equatorial' and found.sky['latitude_deg'] == pytest.approx(10.0)


def test_a_driver_that_does_not_tell_its_kind_asks_for_it():
    with FakeServer(SIMULATED) as server, pytest.raises(
            ValueError, match='does not say what kind of mount it is: write indi:localhost:'):
        ask_server(f'indi:localhost:{server.port}')


def test_a_real_mount_needs_a_camera(refused, tmp_path):
    with FakeServer() as server:
        address = f'indi:localhost:{server.port}:german'
        said = refused('night', '--mount', address, '--out', tmp_path / 'x')
        found = ask_server(address, seen=True)
    assert 'Mount reports a computed, not a measured position: give a camera with --camera' in said
    assert not (tmp_path / 'x').exists()
    assert not found.simulated and found.sky['latitude_deg'] == pytest.approx(10.0)
    # one whose site was never set has none, and only a simulator gets one
    for properties, place in ((TELESCOPE, set()), (SIMULATED, {*SITE})):
        unset = properties.replace('>10<', '>0<').replace('>350<', '>0<').replace('>100<', '>0<')
        with FakeServer(unset) as server:
            assert {*ask_server(f'indi:localhost:{server.port}:german', seen=True).sky} == place
    specs = {spec.name: spec.parameters for spec in nodes_of(
        found, plan='home', bag='b', camera='indi:dome:7000:CCD Simulator')}
    assert specs['mount_guard']['slew_timing'] == 0.0  # nobody knows how it slews
    assert specs['indi_sky']['camera'] == 'CCD Simulator' and specs['indi_sky']['host'] == 'dome'
    guards = [next(spec.parameters for spec in nodes_of(
        found._replace(kind='equatorial', simulated=simulated), plan='home', bag='b')
        if spec.name == 'mount_guard') for simulated in (False, True)]
    # beyond -90 degrees the simulator's fork goes the long way round
    assert [guard.get('first_travel_deg', '') for guard in guards] == ['', '-88,178']


def test_of_a_pass_the_simulator_shows_the_satellite_and_no_camera_solves_it(refused, tmp_path):
    plan = server_plan(8, 'pass L52 lageos2.sp3')
    with FakeServer(SIMULATED) as server:
        address = f'indi:localhost:{server.port}:german'
        found = ask_server(address)
        said = refused('night', '--mount', address, '--pass', 'L52,lageos2.sp3', '--camera',
                       'indi:dome:CCD 1', '--out', tmp_path / 'x')
    specs = {spec.name: spec.parameters for spec in nodes_of(found, plan=plan, bag='b')}
    assert specs['indi_sky']['satellite'] == 'L52 lageos2.sp3'
    assert '--camera indi:dome:CCD 1: it measures stars only' in said


def test_a_camera_is_one_of_an_indi_server():
    assert parse_camera('indi:dome:CCD 1') == {'host': 'dome', 'port': 7624, 'camera': 'CCD 1'}
    for text in ('CCD 1', 'indi:dome:', 'alpaca:dome:11111:0'):
        with pytest.raises(ValueError, match='write indi:'):
            parse_camera(text)


def test_an_alpaca_telescope_is_asked_for_the_same(refused, tmp_path):
    pytest.importorskip('alpaca', reason='alpyca is not installed (extra alpaca)')
    with SimulatedTelescope(TwoAxes(ALTAZ, DEFAULT_SITE)) as server:
        address = f'alpaca:localhost:{server.port}'
        found = ask_server(address)
        assert found.kind == 'altaz' and found.simulated and found.server['number'] == 0
        assert found.sky['latitude_deg'] == pytest.approx(34.3)
        specs = {spec.name: spec.parameters for spec in nodes_of(found, plan='home', bag='b')}
        assert specs['alpaca_sky']['port'] == server.port
        assert specs['mount_guard']['second_travel_deg'] == '-5,89'
        value = server.value
        server.value = lambda name: [] if name == 'supportedactions' else value(name)
        said = refused('night', '--mount', address, '--out', tmp_path / 'x')
    assert 'reports a computed, not a measured position: give a camera with --camera' in said
    said = refused('night', '--mount', address, '--out', tmp_path / 'x')
    assert 'no answer' in said and not (tmp_path / 'x').exists()


def test_the_plan_is_one_power_on_with_blind_stars():
    verbs = [step.verb for step in parse_plan(server_plan(16))]
    assert verbs == ['home', 'stars', 'fit', 'check', 'diagnose', 'check', 'judge']
    verbs = [step.verb for step in parse_plan(server_plan(16, 'track 2arcsec 30'))]
    assert verbs == ['home', 'stars', 'fit', 'check', 'track', 'check']
    verbs = [step.verb for step in parse_plan(server_plan(16, discrimination='tell_apart 15'))]
    assert verbs == ['home', 'stars', 'fit', 'check', 'diagnose', 'tell_apart', 'check', 'judge']


def test_a_night_that_was_interrupted_goes_on_in_its_folder(tmp_path, monkeypatch):
    begun, said = [], []

    def observe(folder, specs, plan, *args, again, **_):
        values = {spec.name: spec.parameters for spec in specs}
        begun.append((Path(values['mcap_logger']['folder']).name, again))
        return Written(values['star_observer']['state_file'], None)
    monkeypatch.setattr(night, 'observe', observe)
    monkeypatch.setattr('telescope_mount.nights.real_night.write_page', lambda *_: None)
    out = tmp_path / 'night'
    with FakeServer(SIMULATED) as server:
        def run(**given):
            return run_server_night(out, f'indi:localhost:{server.port}:german', stars=8,
                                    note=said.append, **given)
        state = run()
        file = NightFile(state, 'german')
        file.row({'a': 1.0})
        file.plan_state(Progress(state='observing', block=1, step='stars', plan=server_plan(8)),
                        0, 0)
        file.close()
        (out / 'bag').mkdir()
        run()
        assert said == [f'the night in {out} was interrupted after 1 observations: resuming at '
                        'step 2, stars']
        run(anew=True)
        assert not (out / STATE).exists() and (out / f'{STATE}.before').exists()
    assert begun == [('bag', False), ('bag_2', True), ('bag_2', True)]


@pytest.mark.parametrize('name', ['indi', 'alpaca'])
def test_a_simulated_server_is_a_program(name):
    program = ROOT / 'examples' / 'simulated_servers' / f'{name}_simulator.py'
    done = subprocess.run([sys.executable, program, '--help'], capture_output=True, text=True)
    assert done.returncode == 0 and '--kind' in done.stdout, done.stderr
