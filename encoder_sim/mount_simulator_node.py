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

"""The mount simulator: drives the axes, publishes their true angles, and is the clock."""

import json
import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from msg_tools import convert, topics
from msg_tools.node import Param
from msg_tools.node_lifecycle import AUTOSTART, ManagedNode
from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.site import DEFAULT_SITE

from .device_params import DEVICE_PARAMS, parse_utc
from .mount import HOME_ATTEMPTS, SimulatedMount
from .scenario_file import load_scenario, scenario_files

#: change of air temperature at which the thermometer publishes, degC
THERMOMETER_STEP = 0.05
#: s between checks of what is awaited, at the full speed of the graph
LOOK = 0.1
#: live: wall time without a command after which the mount counts as unused, and time to wait for
#: this, s: before homing, requests are withdrawn, and the guard's stop is still on its way
CALM, CALMS = 0.8, 2.0
#: smaller moves, as of a renewed track, do not change the direction from which an axis came, rad
HAIR = 0.05 * ARCSEC

PARAMS = (
    AUTOSTART, *DEVICE_PARAMS,
    Param('time_scale', 0.0, 'simulated seconds a second; 0: as fast as the graph answers',
          0.0, 1000.0, fixed=True),
    Param('sample_rate_hz', 2.0, 'true angles a second of simulated time; with time_scale 0 only '
          'around the exposures [Hz]', 0.1, 2000.0, fixed=True),
    Param('exposure_s', 1.0, 'with time_scale 0, time on target for each command [s]', 0.01,
          3600.0),
    Param('latitude_deg', DEFAULT_SITE.latitude / DEG, 'where the mount stands, if its scenario '
          'has none: the tilt of an equatorial one [deg]', -90.0, 90.0, fixed=True),
    Param('feedback_timeout_s', 2.0, 'wall time to wait for the encoder that the servo closes on '
          '[s]', 0.01, 60.0),
)


class MountSimulator(ManagedNode):
    """Follows commanded tracks; simulated time advances as events require."""

    def __init__(self, **kwargs):
        super().__init__('mount_simulator', PARAMS, hardware_id='simulated mount', **kwargs)
        self._start = parse_utc(self.value('start_time'))
        scenario = load_scenario(self.value('scenario'))
        self._mount = SimulatedMount(scenario, self.value('seed'),
                                     self.value('latitude_deg') * DEG,
                                     HAIR if self.value('time_scale') else 0.0)
        self._names = scenario.mount.names.keys
        # without its own weather the scenario has that assumed by the observer
        self._air, self._warmth = scenario.weather, None
        self._live = self.value('time_scale') > 0.0
        self._time = 0.0
        self._settling = self._homing = self._calm = None
        self._commanded = -np.inf  # time of the last command, as `_awake`
        self._open_loop = 0
        self._truth_pub = self.publisher(topics.TRUTH_JOINTS)
        self._clock_pub = self.publisher(topics.CLOCK)
        self.publisher(topics.TRUTH_SCENARIO).publish(
            String(data=json.dumps(scenario_files(self.value('scenario')))))
        self._thermometer_pub = self.publisher(topics.AMBIENT)
        self._read_thermometer(0.0)
        self._feedback_sub = self.subscribe(topics.INCREMENTAL, self._on_feedback)
        self.subscribe(topics.COMMAND, self._on_command)
        self.serve('home', self._home, once=True)
        # wall time during which answers could be received: other nodes here may block the process
        self._awake, self._looked = 0.0, time.monotonic()
        if self._live:
            self._began = time.monotonic()
            self._sample = 0
            self._clock_sent = -1.0
            self._period = 1.0 / self.value('sample_rate_hz') / self.value('time_scale')
        else:
            self._period = LOOK
        self.every(self._period, self._tick if self._live else self._idle)

    # --- commands -----------------------------------------------------------------------------

    def _on_command(self, message):
        stamp, times, positions, velocities = self.read_command(message, self._names)
        if self._live and self._homing is not None:
            raise ValueError('homing is under way')
        self._commanded = self._awake
        at = (stamp - self._start) * 1e-9
        settled = self._mount.follow(max(at, self._time), at + times, positions, velocities)
        if not self._live:
            self._settle(settled)

    async def _home(self):
        """Pass the marks; repeat more slowly if one was not detected."""
        if not self.active:
            return False, self.inactive
        if self._live and not await self._until_calm():
            return False, ('not homed: commands move the mount; cancel the plan '
                           '(star_observer/cancel) or call pause of the guard first')
        if self._homing is not None:
            return False, 'homing is under way'
        for attempt in range(HOME_ATTEMPTS):
            try:
                first, last = self._mount.home(self._time, attempt)
            except ValueError as err:
                return False, str(err)
            reading = await self._pass_marks(first, last)
            if reading is None:
                return True, 'both axes have passed their reference marks; no encoder answered'
            reason = self._mount.home_failure(reading, attempt)
            if not reason:
                return True, 'both axes have met their reference marks'
            self.get_logger().warning(reason)
        return False, reason

    def _until_calm(self):
        """A future for whether commands have stopped."""
        if self._calm is not None:
            return self._calm[0]
        future = Future()
        self._calm = future, self._awake + CALMS
        self._look_for_calm()
        return future

    def _look_for_calm(self):
        future, until = self._calm
        calm = self._awake - self._commanded > CALM
        if calm or self._awake > until:
            self._calm = None
            future.set_result(calm)

    def _pass_marks(self, first, last):
        """A future for the first reading after the passage; None if there is none."""
        rest = last + 2.0
        future = Future()
        ahead = (rest - self._time) / self.value('time_scale') if self._live else 0.0
        self._homing = (self._start + round(rest * 1e9), future,
                        self._awake + ahead + self.value('feedback_timeout_s'))
        if not self._live:
            self._settling = None
            self._read_thermometer(first)
            self._publish(np.linspace(first, last, 5))
            self._publish(np.array([rest]))
            self._set_clock(rest)
        return future

    def _passed(self, reading):
        future, self._homing = self._homing[1], None
        future.set_result(reading)

    # --- as fast as the graph answers ---------------------------------------------------------

    def _settle(self, settled):
        """Publish one sample on target for the servo; the exposure starts after its reading."""
        # before the angles, so that the temperature is known when the exposure is answered
        self._read_thermometer(settled)
        stamp = self._publish(np.array([settled]))[0]
        self._settling = (stamp, settled, self._awake + self.value('feedback_timeout_s'))
        if self._feedback_sub.get_publisher_count() == 0:
            self._expose(closed=False)

    def _on_feedback(self, message):
        stamp, reading = convert.read_joints(message)[:2]
        if self._homing is not None and stamp >= self._homing[0]:
            self._passed(reading)
        if self._live:
            self._mount.feedback(stamp - self._start, reading, smooth=True)
        elif self._settling and stamp == self._settling[0]:
            self._mount.feedback(stamp - self._start, reading, smooth=False)
            self._expose(closed=bool(np.isfinite(reading).all()))

    def _expose(self, closed):
        settled = self._settling[1]
        self._settling = None
        if not closed:
            self._open_loop += 1
        span = self.value('exposure_s')
        rate = max(self.value('sample_rate_hz'), self._mount.sample_rate)
        samples = max(1, round(span * rate))
        # the servo has settled after the last reading before the shutter opens, and the gap is
        # longer than an exposure, so it does not count as one
        begin = settled + 1.5 * span
        self._publish(begin + np.linspace(0.0, span, samples + 1))
        self._set_clock(begin + span)

    def _look(self):
        now = time.monotonic()
        self._awake += min(now - self._looked, 2.0 * self._period)
        self._looked = now
        if self._calm is not None:
            self._look_for_calm()
        if self._homing is not None and self._awake > self._homing[2]:
            self._passed(None)

    def _idle(self):
        self._look()
        if self._settling and self._awake > self._settling[2]:
            self._expose(closed=False)
        elif not self._settling:
            # for nodes that were started late, and for those that wait for the first time stamp
            self._set_clock(self._time)

    # --- live ---------------------------------------------------------------------------------

    def _tick(self):
        self._look()
        now = (time.monotonic() - self._began) * self.value('time_scale')
        rate = self.value('sample_rate_hz')
        # samples are at fixed times: a late timer makes up for the missed ones
        due = int(now * rate)
        if due > self._sample:
            self._read_thermometer(now)
            self._publish(np.arange(self._sample + 1, due + 1) / rate)
            self._sample = due
        if now - self._clock_sent >= 0.01 * self.value('time_scale'):
            self._clock_sent = now
            self._set_clock(now)

    # --- out ----------------------------------------------------------------------------------

    def _read_thermometer(self, now):
        if self._air is None:
            return
        start = self._start * 1e-9
        warmth = float(self._air.temperature_at(start + now, start))
        if self._warmth is None or abs(warmth - self._warmth) > THERMOMETER_STEP:
            self._warmth = warmth
            self._thermometer_pub.publish(
                convert.temperature(self._start + round(now * 1e9), warmth))

    def _publish(self, times):
        angles, rates = self._mount.truth(times)
        sides = self._mount.approach(times)
        stamps = self._start + np.rint(times * 1e9).astype(np.int64)
        for stamp, *values in zip(stamps.tolist(), angles.tolist(), rates.tolist(),
                                  sides.tolist()):
            self._truth_pub.publish(convert.joint_state(stamp, *values, names=self._names))
        return stamps

    def _set_clock(self, now):
        self._time = max(self._time, now)
        self._clock_pub.publish(
            Clock(clock=convert.to_stamp(self._start + round(self._time * 1e9))))

    def deactivated(self):
        """Stop the axes where they are."""
        if self._live:
            now = (time.monotonic() - self._began) * self.value('time_scale')
            here = self._mount.truth(np.array([now]))[0]
            self._mount.follow(now, np.array([now]), here, np.zeros((1, 2)))

    def problems(self):
        """Number of pointings without an encoder for the servo."""
        if self._open_loop:
            return [(DiagnosticStatus.WARN, f'{self._open_loop} pointings with the servo open: no '
                     'reading of the incremental encoder')]
        return []
