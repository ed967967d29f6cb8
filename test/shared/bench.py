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

"""A plan on instruments and a clock of the test, without ROS."""

import logging
from types import SimpleNamespace

import numpy as np

from msg_tools.status_rows import Taken
from msg_tools.units import ARCSEC
from pointing_model.active_calibration import ActiveCalibration
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.zero import PowerOnZero
from telescope_mount.observing.instruments import ABSOLUTE, CAMERA, MOUNT, Instruments
from telescope_mount.observing.night_memory import NightMemory
from telescope_mount.observing.sequencer import Sequencer

START = 1_768_482_000_000_000_000  # 2026-01-15T13:00:00
SECOND = 10**9
#: of the exposure after its command: on a knot, where every way to interpolate agrees
EXPOSURE = 20 * SECOND
SETTINGS = {
    'magnitude_limit': 3.5, 'star_seed': 1, 'min_elevation_deg': 20.0, 'max_elevation_deg': 85.0,
    'recentre_arcsec': 60.0, 'on_target_arcsec': 30.0, 'slew_rate_deg_s': 4.0,
    'answer_timeout_s': 5.0, 'give_up_s': 600.0,
    'exposure_s': 0.0, 'inclinometer': False, 'smear_arcsec': 5.0, 'camera_late_s': 0.0,
    'clock_rate_arcsec_s': 30.0, 'renew_request_s': 0.0,
    'use_sim_time': True, 'satellite': '', 'satellite_interval_s': 90.0,
    'meridian_limit_deg': 5.0, 'hour_angle_limit_deg': 165.0}


class Service:
    """A service of the bench; it answers at once."""

    srv_type = SimpleNamespace(Request=lambda: None)

    def __init__(self, bench, verb):
        self.bench, self.verb, self.srv_name = bench, verb, f'/mount/{verb}'

    def service_is_ready(self):
        return self.verb in self.bench.services

    def call_async(self, request):
        self.bench.calls.append(self.verb)
        answer = self.bench.services[self.verb]()
        return SimpleNamespace(
            done=lambda: answer is not None,
            add_done_callback=lambda callback: answer and callback(None),
            result=lambda: SimpleNamespace(success=answer[0], message=answer[1]))


class Bench:
    """Mount, encoders, camera, clocks and the other side of every topic."""

    def __init__(self, plan='', homed=True, kind=ALTAZ, absolute=True, live=False,
                 memory=None, power_ons=0, **settings):
        self.kind = kind
        self.settings = SETTINGS | settings
        self.stamp, self.wall = START, 1000.0
        self.position = np.array([3.0, 0.8])
        self.error = np.zeros(2)  # of the encoder
        self.second = tuple  # what the absolute encoder makes of angles
        self.miss = lambda number: (1e-6 * ARCSEC * number, 0.0)  # rad, None: no frame
        self.answers = {MOUNT, ABSOLUTE, CAMERA} if absolute else {MOUNT, CAMERA}
        self.site, self.lacks = DEFAULT_SITE, []
        self.no = self.hold = ''  # of the guard
        self.guard, self.allowed, self.own_way = self, None, False
        self.services, self.calls = {}, []
        self.commands, self.rows, self.tables, self.checks = [], [], [], []
        self.statuses, self.refused, self.pending = [], [], None
        self.instruments = Instruments(1, wall=lambda: self.wall, absolute=absolute,
                                       live=live, now=lambda: self.stamp if live else 0)
        self.in_force, self.table = ActiveCalibration(mount=kind), NightMemory(kind, power_ons)
        self.plan = Sequencer(
            self, self.instruments, self.in_force, self.table, memory, looks=0.0)
        if homed:
            self.read(self.stamp, self.position)
        if plan:
            self.plan.start(plan)

    # what the sequencer asks for

    def value(self, name):
        return self.settings[name]

    def sky(self):
        return self.site, DEFAULT_WEATHER

    def mount(self):
        return self.kind

    def now(self):
        return self.stamp

    def waiting_for(self):
        return self.lacks

    def client(self, verb):
        return Service(self, verb)

    def get_logger(self):
        return logging.getLogger('bench')

    def refuse_frame(self, reason):
        self.refused.append(reason)

    def send_command(self, track):
        self.commands.append(track)
        self.pending = track

    def refusal(self, stamp):
        return self.no

    def sent(self, stamp):
        return None

    def held(self):
        return self.hold

    def send_row(self, run, stamp):
        self.rows.append(run)

    def send_table(self, run, stamp):
        self.tables.append(run)

    def send_checks(self, document):
        self.checks.append(list(document['checks']))

    def send_status(self, progress, text):
        self.statuses.append((progress, text))

    # the instruments

    def read(self, stamp, angles):
        self.stamp = stamp
        if MOUNT in self.answers:
            self.instruments.take_incremental(stamp, tuple(angles + self.error), (0.0, 0.0))
        if ABSOLUTE in self.answers:
            self.instruments.take_absolute(stamp, tuple(self.second(angles)))

    def tick(self):
        """What has been commanded is exposed, or a tenth of a second goes by."""
        track, self.pending = self.pending, None
        if track is None or self.no:
            self.wall += 0.1
        else:
            self.wall += 0.01
            at = track.start + EXPOSURE
            self.position = track.at(at)
            self.read(at - SECOND // 2, self.position)
            miss = self.miss(len(self.commands))
            if CAMERA in self.answers and miss is not None:
                self.instruments.take_frame(at, *miss)
            self.read(at + SECOND // 2, self.position)
        self.plan.advance()

    def until(self, condition, ticks=2000):
        for _ in range(ticks):
            if condition():
                return self
            self.tick()
        raise AssertionError(f'{self.plan.progress}, {self.plan.text}')

    def run(self):
        """To the end of the plan; the state then, and its text."""
        self.until(lambda: not self.plan.busy)
        return self.plan.progress.state, self.plan.text

    def waits(self, text):
        return self.until(lambda: (self.plan.progress.state, self.plan.text) == ('waiting', text))

    # the other nodes

    def offers(self, verb, effect=lambda: None, answer=(True, 'done')):
        def serve():
            effect()
            return answer
        self.services[verb] = serve

    def homes(self):
        """A service that homes the encoder."""
        def home():
            self.error = np.zeros(2)
            self.read(self.stamp + SECOND, self.position)
        self.offers('home', home)

    def calibrates(self):
        self.plan.calibration_has(Taken(len(self.rows)))

    def takes_model(self, stamp, zeros=()):
        self.in_force.update_model(PointingModel({'IA': 0.0}, provenance={
            'last_stamp_ns': stamp, 'zeros_in_force': list(zeros)}).to_json())
        self.plan.pointing_changed()

    def takes_zero(self, stamp, *angles):
        self.in_force.update_zero(stamp, PowerOnZero(*angles))
        self.plan.pointing_changed()


def offset(run):
    return np.array(run.offsets()).ravel() / ARCSEC
