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

"""Mounts of an Alpaca server: at one that a test writes, and at the simulators of the package."""

import importlib.util
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from alpaca_server import AlpacaServer
from alpaca_simulator import SimulatedTelescope
from two_axes import TwoAxes

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.sky.places import sidereal_time
from pointing_model.sky.site import DEFAULT_SITE
from telescope_mount.bridges import goto_mount
from telescope_mount.bridges.alpaca.alpaca_driver import AlpacaDriver
from telescope_mount.bridges.alpaca.alpaca_sources import AlpacaStars
from telescope_mount.bridges.alpaca.alpaca_telescope import AlpacaError, AlpacaTelescope
from telescope_mount.bridges.axes_and_places import axes_at
from telescope_mount.bridges.dead_man import ALPACA, DeadMan
from telescope_mount.bridges.goto_mount import NO_AXES

pytest.importorskip('alpaca', reason='alpyca is not installed (extra alpaca)')
FORK = Mount.equatorial(DEFAULT_SITE.latitude)
GERMAN = Mount.equatorial(DEFAULT_SITE.latitude, 'german')
SITE = {'SiteLatitude': DEFAULT_SITE.latitude / DEG, 'SiteLongitude': DEFAULT_SITE.longitude / DEG}


class Server(AlpacaServer):
    """A telescope as a test wants it; `got` is what clients have set."""

    def __init__(self, port=0, **state):
        super().__init__(port)
        self.state = {
            'Connected': False, 'AlignmentMode': 1, 'EquatorialSystem': 1, 'CanSlewAsync': True,
            'SiteElevation': 0.0, 'RightAscension': 5.0, 'Declination': 60.0, 'Slewing': False,
            'Tracking': False, 'SideOfPier': 0, 'AtPark': True, **SITE, **state}
        self.got = []
        self._named = {name.lower(): name for name in self.state}

    def value(self, name):
        """As it was told last."""
        return self.state[self._named[name]]

    def obey(self, order, told):
        """The mount is there at once."""
        self.got.append((order, told))
        name = self._named.get(order)
        if name is not None:
            value = told[name]
            self.state[name] = (value == 'True' if value in ('True', 'False') else float(value))
        elif order == 'slewtocoordinatesasync':
            self.state |= {'RightAscension': float(told['RightAscension']),
                           'Declination': float(told['Declination'])}
        elif order == 'unpark':
            self.state['AtPark'] = False

    def orders(self, name):
        """What was told of one kind."""
        return [told for order, told in list(self.got) if order == name]


class Bench:
    """A driver at a port, as a context."""

    def __init__(self, port, mount=FORK, **options):
        self.driver = AlpacaDriver('127.0.0.1', port, mount, DEFAULT_SITE, **{
            'dead_man': False, 'retry': 0.1, 'period': 0.05, **options})
        self.last = None

    def __enter__(self):
        self.driver.start()
        return self

    def __exit__(self, *_):
        self.driver.close(0.0)

    def until(self, condition, seconds=15.0):
        """Go on until `condition` gives something true, and return that."""
        end = time.monotonic() + seconds
        while not (found := condition()):
            assert time.monotonic() < end, self.driver.state()
            for stamp, angles in self.driver.readings():
                self.last = stamp, angles
            if self.driver.ready:
                self.driver.step()
            time.sleep(0.01)  # polls: another process's doing
        return found


def track(first, second, seconds=100.0):
    """A track of a star, from angles of now, deg."""
    times = np.array([0.0, seconds])
    rates = np.tile([15.041067 * ARCSEC, 0.0], (2, 1))
    return time.time_ns(), times, np.array([first, second]) * DEG + times[:, None] * rates, rates


def test_it_is_unparked_tells_its_position_is_pointed_and_stopped():
    with Server() as server, Bench(server.port) as bench:
        bench.until(lambda: bench.last)
        assert bench.driver.state() == (NO_AXES, False) and server.orders('unpark')
        stamp, axes = bench.last
        lst = sidereal_time(stamp * 1e-9, DEFAULT_SITE)
        assert np.cos(axes[0] - (lst - 75.0 * DEG)) == pytest.approx(1.0, abs=1e-9)
        assert axes[1] / DEG == pytest.approx(60.0)
        star = track(30.0, 20.0)
        for _ in range(3):
            bench.driver.command(*star)
            bench.driver.step()
        told = bench.until(lambda: server.orders('slewtocoordinatesasync'))[0]
        assert len(server.orders('slewtocoordinatesasync')) == 1
        assert float(told['Declination']) == pytest.approx(20.0)
        assert server.state['Tracking'] is True
        hour_angle = (sidereal_time(time.time(), DEFAULT_SITE)
                      - float(told['RightAscension']) * 15.0 * DEG)
        assert wrap(hour_angle) / DEG == pytest.approx(30.0, abs=0.1)
        bench.driver.command(time.time_ns(), np.array([0.0, 0.1]), np.zeros((2, 2)),
                             np.zeros((2, 2)))
        bench.until(lambda: server.orders('abortslew') and server.state['Tracking'] is False)
        assert not any(order == 'sync' for order, _ in server.got)


def test_a_german_mount_is_read_by_its_side_of_the_pier():
    with Server(AlignmentMode=2, SideOfPier=1, EquatorialSystem=0) as server, (
            Bench(server.port, GERMAN)) as bench:
        bench.until(lambda: bench.last)
        assert bench.driver.state()[0].startswith('the driver does not say the equinox')
        assert bench.last[1][1] / DEG == pytest.approx(120.0)
        assert bench.driver.details()[2] == ('side of the pier', 'pierWest')
    with Server(AlignmentMode=2, SideOfPier=-1) as server, Bench(server.port, GERMAN) as bench:
        bench.until(lambda: 'does not report its side of the pier' in bench.driver.state()[0])


@pytest.mark.parametrize('state, words', [
    ({'AlignmentMode': 0}, 'is a mount of the kind altaz, and the parameter mount says'),
    ({'EquatorialSystem': 2}, 'uses another equinox'),
    ({'CanSlewAsync': False}, 'cannot slew'),
    ({'SiderealTime': sidereal_time(time.time(), DEFAULT_SITE) / DEG / 15.0 % 24.0 + 1.0},
     'its sidereal time is +'),
])
def test_what_cannot_be_done_is_one_line(state, words):
    with Server(**state) as server, Bench(server.port) as bench:
        bench.until(lambda: words in bench.driver.state()[0])
        with pytest.raises(ValueError, match='no mount to command: '):
            bench.driver.command(*track(0.0, 0.0))


def test_a_mount_that_goes_on_after_a_stop_is_named(monkeypatch):
    monkeypatch.setattr(goto_mount, 'GOES_ON', 0.5)
    with Server(Tracking=True) as server, Bench(server.port) as bench:
        bench.until(lambda: bench.driver.ready)
        server.obey = lambda order, told: server.got.append((order, told))
        bench.driver.command(*track(30.0, 20.0))
        server.state['Tracking'] = True
        bench.driver.abort()
        bench.until(lambda: 'the stop command: stop it by its own' in bench.driver.state()[0])
        assert bench.driver.state()[1] and len(server.orders('abortslew')) > 2
        server.state['Tracking'] = False
        bench.until(lambda: bench.driver.state() == (NO_AXES, False))


def test_a_site_that_differs_is_told_unless_that_is_not_allowed():
    with Server(SiteLatitude=10.0) as server:
        with Bench(server.port) as bench:
            bench.until(lambda: bench.driver.ready)
            assert server.state['SiteLatitude'] == pytest.approx(DEFAULT_SITE.latitude / DEG)
        server.state['SiteLatitude'] = 10.0
        with Bench(server.port, set_site=False) as bench:
            bench.until(lambda: 'has another site than the parameters' in bench.driver.state()[0])


def test_a_server_that_is_gone_is_said_and_found_again():
    with Server() as server, Bench(server.port) as bench:
        bench.until(lambda: bench.last)
        server.__exit__()
        server.state.clear()  # who is connected still is answered nonsense
        bench.until(lambda: 'is lost: a mount whose driver still runs' in bench.driver.state()[0]
                    or 'no answer' in bench.driver.state()[0])
        assert not bench.driver.readings() and not bench.driver.ready
        with pytest.raises(AlpacaError, match='no answer'):
            AlpacaTelescope('127.0.0.1', server.port).poll()
        with Server(port=server.port):
            bench.until(lambda: bench.driver.ready)


def test_a_mount_is_stopped_when_its_commander_dies():
    with Server() as server:
        process = DeadMan('127.0.0.1', server.port, '0', kind=ALPACA)
        assert process.signal(True)
        process.close()
        end = time.monotonic() + 10.0
        while not (server.orders('abortslew') and server.orders('tracking')):
            assert time.monotonic() < end
            time.sleep(0.01)  # polls: another process's doing


class Field:
    """Notes where it is looked at."""

    def miss(self, stamp, place, second):
        """Place and second axis, as they came."""
        return np.array([*place, second])


def test_a_simulated_altazimuth_telescope_tells_its_axes_and_where_it_looks():
    telescope = TwoAxes(ALTAZ, DEFAULT_SITE, {'IA': 300.0 * ARCSEC})
    with SimulatedTelescope(telescope) as server, Bench(server.port, ALTAZ) as bench:
        bench.until(lambda: bench.last)
        assert np.cos(bench.last[1][0]) == pytest.approx(1.0)
        assert bench.last[1][1] / DEG == pytest.approx(80.0, abs=0.02)
        source = AlpacaStars('127.0.0.1', server.port, 0, Field(), 20.0)
        source.start()
        bench.until(lambda: len(source.exposures) > 1)
        stamp, (ra, dec, second) = source.exposures[-1]
        source.close()
    az, el = axes_at(ALTAZ, ra, dec, stamp * 1e-9, DEFAULT_SITE, False)
    assert wrap(az) / ARCSEC == pytest.approx(-300.0, abs=60.0)  # the question takes its time
    assert (el / DEG, second / DEG) == pytest.approx((80.0, 80.0), abs=0.02)


def test_a_real_telescope_does_not_know_where_it_looks():
    with Server() as server:
        source = AlpacaStars('127.0.0.1', server.port, 0, Field())
        source.start()
        end = time.monotonic() + 10.0
        while 'reports a computed, not a measured position' not in source.why:
            assert time.monotonic() < end, source.why
            time.sleep(0.01)  # polls: another thread's doing
        assert not source.exposures
        source.close()


class Simulators:
    """The server of the package alpaca-simulators, as a context."""

    def __init__(self):
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            self.port = probe.getsockname()[1]

    def __enter__(self):
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'alpaca_simulators.run_simulator', '--host', '127.0.0.1',
             '--port', str(self.port)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL)
        end = time.monotonic() + 30.0
        while True:
            try:
                socket.create_connection(('127.0.0.1', self.port), 1.0).close()
                return self
            except OSError:
                assert self._process.poll() is None and time.monotonic() < end
                time.sleep(0.05)  # polls: another process's port gives no event to wait for

    def __exit__(self, *_):
        self._process.terminate()
        self._process.wait(10.0)


@pytest.mark.skipif(importlib.util.find_spec('alpaca_simulators') is None,
                    reason='the package alpaca-simulators is not installed')
def test_the_simulators_telescope_follows_and_stands():
    with Simulators() as server, Bench(server.port, period=0.1) as bench:
        bench.until(lambda: bench.last)
        start, times, angles, rates = track(40.0, 30.0)
        bench.driver.command(start, times, angles, rates)

        def off():
            stamp, axes = bench.last
            want = [np.interp((stamp - start) * 1e-9, times, axis) for axis in angles.T]
            return np.abs(axes - want).max() / ARCSEC
        bench.until(lambda: bench.driver.telescope.tracks and not bench.driver.telescope.slewing
                    and off() < 1.5)
        bench.driver.abort()
        bench.until(lambda: bench.driver.telescope.tracks is False)
