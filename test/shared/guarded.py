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

"""A mount of an INDI server behind the guard, for tests."""

import time
from contextlib import suppress

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.skyline import Horizon
from telescope_mount.bridges.indi.indi_driver import MountDriver
from telescope_mount.guard.goto import GotoSupervisor
from telescope_mount.guard.limits import Axis, Limits
from telescope_mount.guard.reasons_to_stop import GuardSettings
from telescope_mount.observing.axis_demand import Track


class Guarded:
    """A simulator behind the guard, as nodes are, in one thread; `travel` of both axes, deg."""

    def __init__(self, port, mount, travel, site=DEFAULT_SITE, **options):
        limits = Limits(mount, tuple(Axis(low * DEG, high * DEG, 6.0 * DEG, 60.0 * DEG)
                                     for low, high in travel), Horizon(10.0 * DEG), timing=0.8)
        self.supervisor = GotoSupervisor(limits, site, GuardSettings(
            whole=False, silence=3.0, commander=1.5), time.monotonic)
        self.driver = MountDriver('localhost', port, mount, site, period_ms=100, **options)
        self.asked, self.sent, self.here, self._due = None, 0, None, 0.0
        self._read = 0

    def __enter__(self):
        self.driver.start()
        return self

    def __exit__(self, *_):
        self.driver.close(0.0)

    def ask(self, first, second, rates=(15.041, 0.0)):
        """Ask for a place of the sky, by angles of the axes, deg; or another track, arcsec/s."""
        times = np.array([0.0, 60.0])
        rate = np.array(rates) * ARCSEC
        self.asked = Track(time.time_ns(), times, np.array([first, second]) * DEG
                           + times[:, None] * rate, np.tile(rate, (2, 1)))
        self.supervisor.take_request(self.asked, time.time_ns(), 'a test')

    def until(self, condition, seconds=60.0):
        """Go on until `condition` holds."""
        end = time.monotonic() + seconds
        while not condition():
            now = time.monotonic()
            assert now < end, (self.supervisor.state, self.supervisor.reason, self.driver.state())
            for stamp, angles in self.driver.readings():
                self.here, self._read = angles, stamp
                with suppress(ValueError):  # told its site, it jumps
                    self.supervisor.take_reading(stamp, angles, np.full(2, np.nan))
            if self.asked is not None:
                self.supervisor.take_request(self.asked, time.time_ns(), 'a test')
            due = now - self._due > 0.5
            self._due = now if due else self._due
            for track in self.supervisor.step(time.time_ns(), due):
                self.sent += 1
                if self.driver.ready:
                    self.driver.command(*track)
            if self.driver.ready:
                self.driver.step()
            time.sleep(0.02)

    def off(self):
        """Of the last reading from what is asked for then, arcsec."""
        want = [np.interp((self._read - self.asked.start) * 1e-9, self.asked.times, angle)
                for angle in self.asked.angles.T]
        return np.abs(wrap(self.here - want)).max() / ARCSEC
