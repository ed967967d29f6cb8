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

"""Drivers that are told places: what they are sent, and what stops them."""

from contextlib import suppress

import numpy as np
import pytest
from obedient_mount import START, off
from obedient_mount import Mount as Renewed

from msg_tools.units import DEG
from pointing_model.mounts import Mount
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.skyline import Horizon
from telescope_mount.guard.axis_track import Cubic
from telescope_mount.guard.goto import LONGEST, STOP, GotoSupervisor
from telescope_mount.guard.limits import Axis, Limits
from telescope_mount.guard.reasons_to_stop import GuardSettings

GERMAN = Mount.equatorial(34.3 * DEG, 'german')


class Driver(Renewed):
    """Goes to the begin of the last command at 6 deg/s, each axis on its own, and tracks."""

    def __init__(self, here=(90.0, 90.0), timing=0.0, way=1.0, **settings):
        super().__init__(START, here)
        rates = 6.0 * DEG, 60.0 * DEG
        limits = Limits(GERMAN, (Axis(-10.0 * DEG, 190.0 * DEG, *rates),
                                 Axis(-90.0 * DEG, 270.0 * DEG, *rates)), Horizon(10.0 * DEG),
                        timing=timing)
        self.supervisor = GotoSupervisor(limits, DEFAULT_SITE,
                                 GuardSettings(**{'whole': False, **settings}),
                                 lambda: self.time)
        self.way = way
        self.legs = []

    def run(self, seconds):
        for _ in range(round(seconds / 0.05)):
            before = self.here
            if self.sent:
                track = self.sent[-1]
                t = (self.now - track.start) * 1e-9
                if t <= track.times[-1] and track.times[-1] > 2.0 * STOP:
                    cubic = Cubic(track.times, track.angles, track.rates)
                    step = np.array([cubic.at(t, i)[0] for i in (0, 1)]) - self.here
                    if np.abs(step).max() > 0.1 * DEG:
                        self.legs.append(np.abs(step).max())
                    step = np.clip(step, -6.0 * DEG * 0.05, 6.0 * DEG * 0.05)
                    self.here = self.here + self.way * step
            self.speed = (self.here - before) / 0.05
            sent, self.sent = self.sent, []  # the axes are those here
            try:
                super().run(0.05)
            finally:
                self.sent = sent + self.sent
        return self


def test_a_place_is_sent_at_once_and_the_same_track_again_and_again():
    driver = Driver().run(0.2).ask(60.0, 40.0).run(0.2)
    first = driver.sent[0]
    assert np.abs(first.angles[0] / DEG - (60.0, 40.0)).max() < 1e-3
    driver.run(20.0)
    assert driver.state == 'following' and off(driver) < 1.0
    for before, after in zip(driver.sent, driver.sent[1:]):
        t = (after.start - before.start) * 1e-9
        assert t < 0.6
        # where one goes on, the other is
        at = [np.interp(t, before.times, angle) for angle in before.angles.T]
        assert np.abs(after.angles[0] - at).max() < 1e-3 * DEG


def test_a_stop_is_a_rest_that_is_over_at_once():
    driver = Driver().run(0.2).ask(20.0, 60.0).run(1.0)
    driver.asked = None
    driver.run(0.6)
    stop = driver.sent[-1]
    assert driver.state == 'stopped' and stop.times[-1] == STOP and not stop.rates.any()
    here = driver.here
    assert np.all(driver.run(1.0).here == here)


def test_a_driver_that_hears_no_more_stands_at_the_end_of_the_piece():
    driver = Driver().run(0.2).ask(20.0, 60.0).run(1.0)
    driver.supervisor.step = lambda *_: []
    driver.asked = None
    driver.run(1.7)
    here = driver.here
    assert np.all(driver.run(1.0).here == here)


def test_half_a_turn_is_gone_in_parts_that_are_judged():
    driver = Driver(here=(130.0, 195.0), timing=0.8).run(0.2).ask(50.0, 20.0).run(90.0)
    assert driver.state == 'following' and off(driver) < 1.0
    assert max(driver.legs) <= LONGEST
    directions = GERMAN.horizon_of(*np.array(driver.path).T)[1]
    assert directions.min() > 10.0 * DEG


def test_no_part_of_a_way_ends_near_the_pole():
    driver = Driver(here=(130.0, 178.0), timing=0.8).run(0.2).ask(50.0, 8.0).run(90.0)
    assert driver.state == 'following' and off(driver) < 1.0
    ends = np.array([track.angles[0] for track in driver.sent if not track.rates.any()])
    assert len(ends) and np.abs(ends[:, 1] / DEG - 90.0).min() > 5.9


def test_a_driver_that_goes_another_way_is_stopped():
    driver = Driver(way=-1.0).run(0.2)
    with pytest.raises(ValueError, match='aborted: call resume'):
        driver.ask(60.0, 40.0).run(3.0)
    assert driver.state == 'aborted' and 'outside the checked path' in (
        driver.supervisor.reason)
    assert np.abs(driver.here / DEG - 90.0).max() < 4.0


def test_below_the_horizon_is_refused_and_nothing_is_sent():
    driver = Driver().run(0.2)
    with pytest.raises(ValueError, match='elevation'):
        driver.ask(150.0, 10.0)
    assert not driver.supervisor.step(driver.now)


def test_it_parks_and_pauses():
    driver = Driver().run(0.2).ask(60.0, 40.0).run(1.0)
    driver.supervisor.pause(driver.now)
    here = driver.run(1.0).here
    assert driver.state == 'paused' and np.all(driver.run(1.0).here == here)
    driver.supervisor.resume(driver.now)
    driver.run(20.0)
    assert driver.state == 'following'
    driver.asked = None
    driver.supervisor.park(driver.now, (90.0 * DEG, 90.0 * DEG))
    driver.run(30.0)
    assert driver.state == 'parked' and np.abs(driver.here / DEG - 90.0).max() < 0.2
    assert driver.sent[-1].start < driver.now - 10**10


def test_a_mount_that_is_found_again_elsewhere_is_judged_from_there():
    """A server that was restarted: its axes are where they are parked, and that is a jump."""
    driver = Driver().run(0.2).ask(60.0, 40.0).run(20.0)
    driver.reads = False
    driver.run(2.0)
    assert driver.state == 'stopped' and driver.supervisor.level == 2
    driver.reads, sent = True, len(driver.sent)
    driver.here = np.array([90.0, 90.0]) * DEG
    for _ in range(4):
        with suppress(ValueError):
            driver.run(0.05)
        assert driver.state != 'following' and len(driver.sent) == sent
    with suppress(ValueError):
        driver.run(0.05)
    assert driver.run(20.0).state == 'following' and off(driver) < 1.0
