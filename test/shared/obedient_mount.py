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

"""A mount that does what it is told, with a guard before it."""

import numpy as np

from msg_tools.units import DEG
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.skyline import Horizon
from telescope_mount.guard.axis_track import Cubic
from telescope_mount.guard.limits import Axis, Limits
from telescope_mount.guard.reasons_to_stop import GuardSettings
from telescope_mount.guard.supervisor import Supervisor
from telescope_mount.observing.axis_demand import Track

START = 1_768_482_000 * 10**9  # 2026-01-15T13:00:00, night at the default site
AXIS = 4.0 * DEG, 2.0 * DEG


class Mount:
    """Axes that are where the last command says, and a guard before them."""

    def __init__(self, start=START, here=(20.0, 50.0), limits=None, **settings):
        limits = limits or Limits(axes=(Axis(-270.0 * DEG, 270.0 * DEG, *AXIS),
                              Axis(-5.0 * DEG, 95.0 * DEG, *AXIS)), horizon=Horizon(10.0 * DEG))
        self.time, self.start = 0.0, start
        self.supervisor = Supervisor(limits, DEFAULT_SITE, GuardSettings(
            **{'whole': False, **settings}), lambda: self.time)
        self.here, self.speed = np.array(here) * DEG, np.zeros(2)
        self.sent, self.asked, self.reads = [], None, True
        self.path = []

    @property
    def now(self):
        return self.start + round(self.time * 1e9)

    def ask(self, az, el, rate=0.004):
        """Ask for a star, again and again."""
        times = np.arange(0.0, 601.0, 20.0)
        rates = np.full((len(times), 2), rate * DEG)
        self.asked = Track(self.now, times, np.array([az, el]) * DEG + times[:, None] * rates,
                           rates)
        self.supervisor.take_request(self.asked, self.now, 'observer')
        return self

    def run(self, seconds):
        for _ in range(round(seconds / 0.05)):
            self.time += 0.05
            if self.sent:
                track = self.sent[-1]
                t = (self.now - track.start) * 1e-9
                before = self.here
                cubic = Cubic(track.times, track.angles, track.rates)
                self.here = np.array([cubic.at(t, i)[0] for i in (0, 1)])
                self.speed = (self.here - before) / 0.05
            self.path.append(self.here)
            if self.reads:
                self.supervisor.take_reading(self.now, self.here, self.speed)
            if self.asked is not None and round(self.time / 0.05) % 4 == 0:
                self.supervisor.take_request(self.asked, self.now, 'observer')
            tracks = self.supervisor.step(self.now, round(self.time / 0.05) % 10 == 0)
            assert all(not track.rates[-1].any() for track in tracks)  # at rest, whatever comes
            self.sent += tracks
        return self

    @property
    def state(self):
        return self.supervisor.state


def off(mount):
    """Of the axes from what is asked for now, arcsec."""
    t = (mount.now - mount.asked.start) * 1e-9
    want = [np.interp(t, mount.asked.times, angle) for angle in mount.asked.angles.T]
    return np.abs(mount.here - want).max() / DEG * 3600.0
