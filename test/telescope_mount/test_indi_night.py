"""What a night asks of an INDI server before it starts a graph."""

import sys
from pathlib import Path

import pytest

from indi_bridge.server import SIMULATOR
from pointing_model.observing.plan import parse_plan
from telescope_mount.indi_night import ask_server, indi_plan

sys.path.append(str(Path(__file__).parents[1] / 'indi_bridge'))

from fake_server import TELESCOPE, FakeServer, switch

pytest.importorskip('indipyclient', reason='indipyclient is not installed (extra indi)')
INFO = '<defText name="DRIVER_INTERFACE">5</defText>'
SIMULATED = TELESCOPE.replace(INFO, f'{INFO}<defText name="DRIVER_EXEC">{SIMULATOR}</defText>')


def test_kind_and_site_are_the_drivers_unless_the_user_says():
    kind = switch('MOUNT_TYPE', {'ALTAZ': 'Off', 'EQ_FORK': 'Off', 'EQ_GEM': 'On'}, 'def')
    with FakeServer(SIMULATED + kind) as server:
        address = f'indi:localhost:{server.port}'
        where, told, sky, simulated = ask_server(address, {'height_m': 5.0})
        assert where == {'host': 'localhost', 'port': server.port, 'device': 'Mount'}
        assert told == 'german' and simulated
        assert sky == pytest.approx({'latitude_deg': 10.0, 'longitude_deg': -10.0, 'height_m': 5.0})
        assert ask_server(f'{address}:equatorial')[1] == 'equatorial'


def test_a_driver_that_does_not_tell_its_kind_asks_for_it():
    with FakeServer(SIMULATED) as server, pytest.raises(
            ValueError, match='does not say what kind of mount it is: write indi:localhost:'):
        ask_server(f'indi:localhost:{server.port}')


def test_a_real_mount_has_no_camera_here(refused, tmp_path):
    with FakeServer() as server:
        said = refused('night', '--mount', f'indi:localhost:{server.port}', '--out', tmp_path / 'x')
    assert 'Mount reports what it believes, not what is seen' in said
    assert not (tmp_path / 'x').exists()


def test_the_plan_is_one_power_on_with_blind_stars():
    verbs = [step.verb for step in parse_plan(indi_plan(16))]
    assert verbs == ['home', 'stars', 'fit', 'check', 'diagnose', 'check', 'judge']
