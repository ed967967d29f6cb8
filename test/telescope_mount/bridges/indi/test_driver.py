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

"""The mount as the graph knows it, at a server that says what a test wants."""

import re
import time

import numpy as np
import pytest
from fake_server import TELESCOPE, FakeServer, number, switch

from msg_tools.units import DEG, wrap
from pointing_model.mounts import Mount
from pointing_model.sky.places import sidereal_time
from pointing_model.sky.site import DEFAULT_SITE
from telescope_mount.bridges import goto_mount
from telescope_mount.bridges.goto_mount import NO_AXES
from telescope_mount.bridges.indi.client import IndiError
from telescope_mount.bridges.indi.indi_driver import MountDriver

pytest.importorskip('indipyclient', reason='indipyclient is not installed (extra indi)')
GERMAN = Mount.equatorial(DEFAULT_SITE.latitude, 'german')


class Bench:
    """A driver at a server, as a context."""

    def __init__(self, properties=TELESCOPE, **options):
        there = DEFAULT_SITE.latitude / DEG, DEFAULT_SITE.longitude / DEG
        for name, value in zip(('LAT', 'LONG'), there):  # a site that is set takes a second
            properties = re.sub(rf'(name="{name}"[^>]*>)[^<]*', rf'\g<1>{value!r}', properties)
        self.server = FakeServer(properties)
        self.options = {'dead_man': False, 'retry': 0.1, 'fresh': 0.0, **options}

    def __enter__(self):
        self.server.__enter__()
        self.driver = MountDriver('localhost', self.server.port, GERMAN, DEFAULT_SITE,
                                  **self.options)
        self.driver.start()
        return self

    def __exit__(self, *_):
        self.driver.close(0.0)
        self.server.__exit__()

    def until(self, condition, seconds=60.0):
        """Go on until `condition` gives something true, and return that."""
        end = time.monotonic() + seconds
        while not (found := condition()):
            assert time.monotonic() < end, self.driver.state()
            self.driver.step()
            self.driver.client.wait(lambda: True, '')
            time.sleep(0.01)
        return found

    def gotos(self):
        """Right ascension, hours, and declination, deg, of the slews that were sent."""
        return [tuple(map(float, re.findall(r'>([-\d.e]+)<', text))) for text in self.server.got
                if 'name="EQUATORIAL_EOD_COORD"' in text]

    def rest(self, axes):
        """The mount has come to rest, in degrees of its axes."""
        self.server.say(number('MOUNT_AXES', dict(zip(('PRIMARY', 'SECONDARY'), axes)))
                        + number('EQUATORIAL_EOD_COORD', {'RA': 6, 'DEC': 30}))


def track(angles, now=None):
    """A track that stands on angles, deg."""
    angles = np.array([angles, angles]) * DEG
    return (time.time_ns() if now is None else now, np.array([0.0, 100.0]), angles,
            np.zeros((2, 2)))


def test_axes_that_stand_are_told_and_a_command_becomes_a_slew_to_its_place_of_date():
    with Bench() as bench:
        stamp, angles = bench.until(bench.driver.readings)[0]
        assert angles / DEG == pytest.approx((45.0, 30.0))
        assert abs(stamp - time.time_ns()) < 5e9
        bench.driver.command(*track((50.0, 20.0)))
        ra, dec = bench.until(bench.gotos)[0]
        lst = sidereal_time(time.time(), DEFAULT_SITE) / DEG / 15.0
        assert dec == pytest.approx(20.0)
        assert wrap((ra - lst) * 15.0 * DEG) / DEG == pytest.approx(-50.0, abs=0.15)


def test_axes_beside_their_demand_are_sent_on_by_as_much():
    with Bench() as bench:
        bench.until(lambda: bench.driver.ready)
        bench.driver.command(*track((50.0, 20.0)))
        bench.until(bench.gotos)
        # the mount says that it is under way, and comes to rest 0.2 deg beside
        bench.until(lambda: bench.driver.telescope.slewing)

        def again():
            bench.rest((50.2, 19.9))
            return len(bench.gotos()) > 1
        bench.until(again)
        (first, _), (second, dec) = bench.gotos()[:2]
        assert dec == pytest.approx(20.1, abs=1e-6)
        # back by the hour angle that it was ahead, and on with the time in between
        assert wrap((second - first) * 15.0 * DEG) / DEG == pytest.approx(0.2, abs=0.05)


def test_after_a_stop_it_is_sent_by_as_much_farther_at_once():
    with Bench() as bench:
        bench.until(lambda: bench.driver.ready)
        bench.driver.command(*track((50.0, 20.0)))
        bench.until(bench.gotos)

        def again():
            bench.rest((50.0, 19.9))
            return len(bench.gotos()) > 1
        bench.until(again)
        bench.driver.abort()
        bench.driver.command(*track((50.0, 20.0)))
        bench.until(lambda: len(bench.gotos()) > 2)
        assert bench.gotos()[-1][1] == pytest.approx(20.1, abs=1e-6)


def test_the_other_side_of_the_pier_is_said_and_not_chased():
    with Bench() as bench:
        bench.until(lambda: bench.driver.ready)
        bench.driver.command(*track((50.0, 20.0)))
        bench.until(bench.gotos)

        def said():
            bench.rest((230.0 - 360.0, 160.0))
            return 'side of the pier that was not commanded' in bench.driver.state()[0]
        bench.until(said)
        assert len(bench.gotos()) == 1


def test_a_track_that_nobody_renews_ends_with_a_stop():
    with Bench() as bench:
        bench.until(lambda: bench.driver.ready)
        bench.driver.command(*track((50.0, 20.0), time.time_ns() - 99 * 10**9))
        bench.until(lambda: any('TELESCOPE_ABORT_MOTION' in text for text in bench.server.got))
        assert 'TRACK_OFF">On' in ' '.join(bench.server.got)


def piece(first, rate=0.0, last=1.6, second=20.0):
    """A piece of a track as the guard sends it, deg and deg/s: from now on, and rest."""
    times = np.arange(0.0, last + 0.1, 0.25)
    angles = np.stack([first + rate * times, np.full(len(times), second)], axis=1) * DEG
    rates = np.tile([rate * DEG, 0.0], (len(times), 1))
    return time.time_ns(), times, angles, rates


def test_pieces_of_one_track_are_one_slew_and_a_rest_that_is_over_is_a_stop():
    with Bench() as bench:
        bench.until(lambda: bench.driver.ready)
        began, rate = time.time(), 0.004
        for _ in range(8):
            bench.driver.command(*piece(50.0 + rate * (time.time() - began), rate))
            bench.driver.step()
        bench.until(bench.gotos)
        assert len(bench.gotos()) == 1 and 'TRACK_ON">On' in ' '.join(bench.server.got)
        bench.driver.command(*piece(51.0, rate))  # another one
        bench.until(lambda: len(bench.gotos()) == 2)
        now = time.time_ns()
        bench.driver.command(now, np.array([0.0, 0.1]), np.full((2, 2), 0.7), np.zeros((2, 2)))
        bench.until(lambda: any('"ABORT">On' in text for text in bench.server.got))
        assert len(bench.gotos()) == 2  # and none to where it is to stand
        bench.until(lambda: bench.driver.telescope.get('TELESCOPE_TRACK_STATE').on == 'TRACK_OFF')


RATES = (switch('TELESCOPE_TRACK_MODE', {'TRACK_SIDEREAL': 'On', 'TRACK_CUSTOM': 'Off'}, 'def')
         + number('TELESCOPE_TRACK_RATE', {'TRACK_RATE_RA': 15.041, 'TRACK_RATE_DE': 0}, 'def'))


def test_what_goes_faster_than_stars_is_led_by_rates_and_a_star_is_tracked_again():
    def sent():
        return [tuple(map(float, re.findall(r'>([-\d.e]+)<', text))) for text in bench.server.got
                if 'name="TELESCOPE_TRACK_RATE"' in text]

    def led(rate, count):
        began, first = time.time(), len(sent())

        def turned():
            place = 50.0 + rate * (time.time() - began)
            bench.driver.command(*piece(place, rate))
            bench.rest((place, 20.0 - 1.0 / 3600.0))
            return len(sent()) >= first + count
        bench.until(turned)
        return sent()[first:]

    with Bench(TELESCOPE + RATES) as bench:
        bench.until(lambda: bench.driver.ready)
        rates = led(0.05, 3)
        assert 'TRACK_CUSTOM">On' in ' '.join(bench.server.got) and len(bench.gotos()) == 1
        # deg/s in arcsec, and the declination makes up for what it is off
        assert np.median(rates, axis=0) == pytest.approx((180.0, 1.0), abs=20.0)
        assert np.median(rates, axis=0)[1] == pytest.approx(1.0, abs=0.1)
        rates = np.array(led(-0.05, 4))[:, 0]  # the other way round, through rest
        assert np.any(rates == 0.0) and rates[-1] < 0.0
        bench.driver.command(*piece(70.0, 15.041 / 3600.0))
        bench.until(lambda: len(bench.gotos()) == 2)
        assert 'TRACK_SIDEREAL">On' in ' '.join(bench.server.got)


def test_a_driver_that_takes_no_rates_is_said_to_follow_no_satellite():
    with Bench() as bench:
        bench.until(lambda: bench.driver.ready)
        began = time.time()

        def said():
            place = 50.0 + 0.05 * (time.time() - began)
            bench.driver.command(*piece(place, 0.05))
            bench.rest((place, 20.0))
            return 'accepts no axis rates' in bench.driver.state()[0]
        bench.until(said)


def test_one_that_takes_up_its_track_after_a_stop_is_stopped_again_at_once(monkeypatch):
    monkeypatch.setattr(goto_mount, 'STOP_AGAIN', 1e6)

    def stops():
        return sum('"ABORT">On' in text for text in bench.server.got)
    with Bench() as bench:
        bench.until(lambda: bench.driver.ready)
        bench.driver.command(*piece(50.0))
        bench.until(bench.gotos)
        bench.server.say(number('EQUATORIAL_EOD_COORD', {'RA': 6, 'DEC': 30}))
        bench.until(lambda: not bench.driver.telescope.slewing)
        bench.driver.abort()
        bench.until(lambda: bench.driver.telescope.tracks is False)
        assert stops() == 1
        bench.server.say(switch('TELESCOPE_TRACK_STATE', {'TRACK_ON': 'On', 'TRACK_OFF': 'Off'}))
        bench.until(lambda: stops() == 2 and bench.driver.telescope.tracks is False)


def test_what_cannot_be_done_is_one_line_and_home_unparks():
    park = switch('TELESCOPE_PARK', {'PARK': 'On', 'UNPARK': 'Off'}, 'def')
    with Bench(TELESCOPE + park) as bench:
        with pytest.raises(ValueError, match='no mount to command: '):
            bench.driver.command(*track((0.0, 0.0)))
        bench.until(lambda: bench.driver.ready)
        assert not bench.driver.telescope.parked
        bench.server.say(switch('TELESCOPE_PARK', {'PARK': 'On', 'UNPARK': 'Off'}))
        bench.until(lambda: bench.driver.telescope.parked)
        bench.driver.unpark()
        bench.until(lambda: not bench.driver.telescope.parked)
        bench.driver.abort()
    sent = ' '.join(bench.server.got)
    assert '"UNPARK">On' in sent and '"ABORT">On' in sent and 'SYNC">On' not in sent


def test_a_mount_of_another_kind_and_one_without_axes_are_said():
    kind = switch('MOUNT_TYPE', {'ALTAZ': 'On', 'EQ_FORK': 'Off', 'EQ_GEM': 'Off'}, 'def')
    with Bench(TELESCOPE + kind) as bench:
        bench.until(lambda: bench.driver.state()[0] == 'Mount is a mount of the kind altaz, and '
                    'the parameter mount says german')
    axes = TELESCOPE.index('<defNumberVector device="Mount" name="MOUNT_AXES"')
    with Bench(TELESCOPE[:axes]) as bench:
        stamp, angles = bench.until(bench.driver.readings)[0]
        assert bench.driver.state() == (NO_AXES, False)
        assert angles[1] / DEG == pytest.approx(30.0)
        lst = sidereal_time(stamp * 1e-9, DEFAULT_SITE)
        assert np.cos(angles[0]) == pytest.approx(np.cos(lst - 90.0 * DEG), abs=1e-6)


def test_a_driver_that_another_client_has_set_otherwise_is_made_ready_again():
    with Bench() as bench:
        bench.until(lambda: bench.driver.ready)
        other = {'TRACK': 'Off', 'SLEW': 'Off', 'SYNC': 'On'}
        bench.server.say(switch('ON_COORD_SET', other))
        bench.until(lambda: bench.driver.telescope.get('ON_COORD_SET').on == 'SYNC')
        bench.driver.command(*track((50.0, 20.0)))
        with pytest.raises(IndiError, match='is set to SYNC and not to TRACK: no slew'):
            bench.driver.step()
        bench.until(bench.gotos)
        assert bench.driver.telescope.get('ON_COORD_SET').on == 'TRACK'


def test_a_server_that_is_gone_is_said_and_found_again():
    with Bench() as bench:
        bench.until(lambda: bench.driver.ready)
        bench.server.drop()
        bench.until(lambda: 'is lost' in bench.driver.state()[0] and not bench.driver.readings())
        bench.until(lambda: bench.driver.ready)
        assert bench.until(bench.driver.readings)
