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

"""The connection to an INDI server, against one that says what a test wants."""

import calendar
import time

import pytest
from fake_server import DEVICE, TELESCOPE, FakeServer, number

from msg_tools.units import DEG
from pointing_model.sky.site import Site
from telescope_mount.bridges.indi.client import IndiClient, IndiError
from telescope_mount.bridges.indi.indi_telescope import TICK, IndiTelescope, Ticks, find_device

pytest.importorskip('indipyclient', reason='indipyclient is not installed (extra indi)')


@pytest.fixture
def server():
    with FakeServer() as served:
        yield served


def test_the_telescope_is_found_made_ready_and_never_synchronised(server):
    with IndiClient('localhost', server.port) as client:
        device = find_device(client)
        telescope = IndiTelescope(client, device)
        site = Site()
        telescope.prepare(site)
        assert device == DEVICE and telescope.has_axes and telescope.kind == ''
        assert telescope.site == pytest.approx((site.latitude, site.longitude, site.height))
        telescope.goto(90.0 * DEG, 20.0 * DEG)
        client.wait(lambda: telescope.slewing, 'no slew')
    sent = ' '.join(server.got)
    assert '<oneSwitch name="TRACK">On</oneSwitch>' in sent
    assert '<oneSwitch name="2x">On</oneSwitch>' in sent  # its fastest
    assert '<oneNumber name="RA">6.0</oneNumber>' in sent and 'SYNC">On' not in sent


def test_the_clock_is_set_at_a_whole_second(server, monkeypatch):
    server.properties += (
        f'<defTextVector device="{DEVICE}" name="TIME_UTC" state="Ok" perm="rw">'
        '<defText name="UTC"></defText><defText name="OFFSET"></defText></defTextVector>')
    with IndiClient('localhost', server.port) as client:
        telescope = IndiTelescope(client, find_device(client))
        telescope.connect()
        late, send = [], client.send

        def note(device, name, **values):
            if name != 'TIME_UTC':
                return send(device, name, **values)
            return late.append(time.time() - calendar.timegm(
                time.strptime(values['UTC'], '%Y-%m-%dT%H:%M:%S')))
        monkeypatch.setattr(client, 'send', note)
        telescope.set_site(Site())
    assert len(late) == 1 and abs(late[0]) < 0.3


def test_a_slew_is_refused_where_the_driver_would_synchronise(server):
    with IndiClient('localhost', server.port) as client:
        telescope = IndiTelescope(client, find_device(client))
        telescope.connect()
        with pytest.raises(IndiError, match='is set to SLEW and not to TRACK: no slew'):
            telescope.goto(0.0, 0.0)
    assert not any('newNumberVector' in text for text in server.got)


def test_readings_of_one_tick_are_paired(server):
    ticks = []
    pairs = Ticks(ticks.append)
    with IndiClient('localhost', server.port, update=pairs) as client:
        pairs.telescope = IndiTelescope(client, find_device(client))
        pairs.telescope.connect()
        server.say(number('MOUNT_AXES', {'PRIMARY': 50, 'SECONDARY': 31})
                   + number('EQUATORIAL_EOD_COORD', {'RA': 7, 'DEC': 29}))
        client.wait(lambda: any(tick.place is not None and tick.axes[0] > 49.0 * DEG
                                for tick in ticks), 'no tick')
        tick = ticks[-1]
        # one that stands says no more than how the sky goes by
        client.wait(lambda: server.say(number('EQUATORIAL_EOD_COORD', {'RA': 7.001, 'DEC': 29}))
                    or ticks[-1].stamp > tick.stamp + TICK, 'no tick')
    assert tick.axes / DEG == pytest.approx((50.0, 31.0))
    assert tick.place / DEG == pytest.approx((105.0, 29.0)) and tick.tracking
    assert ticks[-1].axes / DEG == pytest.approx((50.0, 31.0))
    assert ticks[-1].place / DEG == pytest.approx((105.015, 29.0))


def test_a_property_set_without_a_timeout_does_not_end_the_connection():
    ups = []
    with FakeServer(obeys=False) as server, IndiClient(
            'localhost', server.port, connection=ups.append) as client:
        device = find_device(client)
        client.property(device, 'EQUATORIAL_EOD_COORD')
        server.say(number('EQUATORIAL_EOD_COORD', {'RA': 7, 'DEC': 29}))
        client.wait(lambda: client.get(device, 'EQUATORIAL_EOD_COORD').values['RA'] == 7.0, 'set')
        client.send(device, 'EQUATORIAL_EOD_COORD', RA=8.0, DEC=20.0)
        # until the library has looked whether an answer is due, and given it up
        vector = client._client[device]['EQUATORIAL_EOD_COORD']
        end = time.monotonic() + 60.0
        while vector._timer and ups == [True]:
            assert time.monotonic() < end
            time.sleep(0.01)  # polls
        assert ups == [True]


def test_what_does_not_come_or_does_not_exist_ends_in_one_line(server):
    with IndiClient('localhost', server.port) as client:
        device = find_device(client)
        with pytest.raises(IndiError, match='Mount does not send its property GONE: not within'):
            client.property(device, 'GONE', 0.2)
        with pytest.raises(IndiError, match='MOUNT_AXES of Mount has no THIRD'):
            client.send(device, 'MOUNT_AXES', THIRD=1.0)


def test_several_telescopes_must_be_told_apart():
    other = TELESCOPE.replace(f'device="{DEVICE}"', 'device="Other"')
    with FakeServer(TELESCOPE + other) as server, IndiClient('localhost', server.port) as client:
        client.property('Other', 'MOUNT_AXES')
        with pytest.raises(IndiError, match='several telescopes on the server: Mount, Other'):
            find_device(client)
        assert find_device(client, 'Other') == 'Other'


def test_a_driver_that_does_not_obey_is_named():
    with FakeServer(obeys=False) as server, IndiClient('localhost', server.port) as client:
        telescope = IndiTelescope(client, find_device(client))
        with pytest.raises(IndiError, match='does not take ON_COORD_SET.TRACK: not within 0.2 s'):
            telescope.prepare(timeout=0.2)


def test_nobody_at_the_address_is_said():
    with FakeServer() as gone:
        port = gone.port  # of which nobody listens any more
    with IndiClient('localhost', port) as client, pytest.raises(
            IndiError, match=f'no INDI server answers at localhost:{port}'):
        find_device(client, timeout=0.2)


def test_a_connection_is_lost_and_found(server):
    states = []
    with IndiClient('localhost', server.port, connection=states.append) as client:
        find_device(client)
        server.drop()
        client.wait(lambda: states[-1:] == [False] and not client.connected, 'not noticed')
        with pytest.raises(IndiError, match='the connection to localhost:.* is lost'):
            client.send(DEVICE, 'MOUNT_AXES', PRIMARY=0.0)
        client.wait(lambda: client.get(DEVICE, 'MOUNT_AXES'), 'not found again', 20.0)
    assert states == [True, False, True] or states == [True, False, True, False]
