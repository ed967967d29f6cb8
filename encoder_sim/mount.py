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

"""The drives of the simulated mount: axes, the servo that closes on the encoder, and homing."""

import math
from collections import OrderedDict

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.sky.site import DEFAULT_SITE

from .axis_motion import MountAxes, Trajectory
from .drives import Drives
from .wind_gusts import WindLoad

#: least distance before the reference marks at which homing starts, and s for passing them
HOME_RUN_UP, HOME_SPAN = 0.5 * DEG, 4.0
#: a mark that was not detected is passed again, slower by this factor, in so many attempts
HOME_SLOWER, HOME_ATTEMPTS = 4.0, 3
#: time constant with which the servo corrects an encoder error, s
SERVO_TIME = 0.2
#: most samples whose readings may still be awaited
SENT = 10000
#: for low rates: least number of samples kept, and age up to which they are kept, ns
SENT_SLOWLY, SENT_NS = 200, 60_000_000_000
STILL = [[0.0, 0.0]]
#: period of the servo, s, which settles at a cycle (rounding down by up to 10 us)
CYCLE = 0.1
#: true angles per second that an exposure needs if an axis does not move smoothly, Hz
RESTLESS_RATE = 10.0


def on_cycle(seconds):
    """The next cycle of the servo, the same for slews that differ by a microsecond."""
    return math.ceil(seconds / CYCLE - 1e-4) * CYCLE


class SimulatedMount:
    """The drives of a mount, whose servo makes the incremental encoder read the demand.

    The encoder measures what the servo does not correct: lag, sticking and wind.

    Times are seconds since the start of the night, when the axes are at rest, a little before
    their reference marks.

    Parameters
    ----------
    scenario : scenario.Scenario
    seed : int
        Seed of gusts and slips.
    latitude : float
        Latitude if the scenario has none, rad.
    hair : float
        Shorter moves do not change the direction from which an axis came, rad.
    """

    def __init__(self, scenario, seed=0, latitude=DEFAULT_SITE.latitude, hair=0.0):
        encoders = scenario.incremental.azimuth, scenario.incremental.elevation
        self._marks = np.array([encoder.mark_angle for encoder in encoders])
        self._home_rate = np.array([encoder.home_rate for encoder in encoders])
        self._home_side = np.array(
            [1.0 if encoder.home_side == 'below' else -1.0 for encoder in encoders])
        self._axes = MountAxes(scenario.axes.azimuth, scenario.axes.elevation, 0.0,
                               self._marks - 2.0 * DEG, scenario.mount.names.axes, hair)
        self._words = scenario.mount.names.axes
        self._drives = Drives(scenario.drives, seed)
        self._wind = WindLoad(scenario.wind, seed, scenario.mount.at(
            latitude if scenario.site is None else scenario.site.latitude))
        # error of the encoder (reading - angle), by which the servo turns the axes back
        self.servo = np.zeros(2)
        self._servo_time = None
        # true angles by time in ns, kept until their readings arrive
        self._sent = OrderedDict()

    def follow(self, start, times, positions, velocities):
        """Execute a track of encoder demands from `start` on.

        Returns
        -------
        float
            Time at which both axes have settled on it, at a cycle of the servo.

        Raises
        ------
        ValueError
            Outside the travel, or too fast for an axis.
        """
        return on_cycle(self._axes.follow(max(start, self._axes.leg.start),
                                         Trajectory(times, positions, velocities)))

    def truth(self, times):
        """True axis angles (n, 2) in rad and rates (n, 2) in rad/s at `times` (n,)."""
        angles, rates = self._axes.state(times)
        angles = (angles - self.servo - self._drives.lag(times, self._axes.state)
                  + self._wind.turn(times, angles))
        self._sent.update(zip(
            np.rint(np.asarray(times) * 1e9).astype(np.int64).tolist(), angles))
        while len(self._sent) > SENT or (len(self._sent) > SENT_SLOWLY and (
                next(iter(self._sent)) < next(reversed(self._sent)) - SENT_NS)):
            self._sent.popitem(last=False)
        return angles, rates

    @property
    def sample_rate(self):
        """Samples per second needed to show the motion in an exposure, Hz; 0: any."""
        return RESTLESS_RATE if self._drives.stick or self._wind.turns else 0.0

    def approach(self, times):
        """Direction from which each axis came, shape (n, 2): -1, 0, 1."""
        return self._axes.approach(times)

    def feedback(self, stamp, reading, smooth):
        """Pass an encoder reading to the servo.

        Parameters
        ----------
        stamp : int
            Stamp of the reading, ns: exactly one of the times of `truth`; seconds as floats are not
            precise enough after some weeks.
        reading : array_like, shape (2,)
            rad; NaN (not homed) does not change the servo.
        smooth : bool
            Correct the error gradually, like a servo in motion, or at once.
        """
        reading = np.asarray(reading, dtype=float)
        sent = self._sent.get(stamp)
        # compare with the angle at the time of the reading: with the present one, a late reading
        # would make the servo oscillate
        if sent is None or not np.isfinite(reading).all():
            return
        error = wrap(reading - sent) - self.servo
        share = 1.0
        time = stamp * 1e-9
        if smooth:
            passed = 0.0 if self._servo_time is None else max(0.0, time - self._servo_time)
            share = 1.0 - np.exp(-passed / SERVO_TIME)
        self._servo_time = time
        self.servo = self.servo + share * error

    def home(self, start, attempt=0):
        """Pass both reference marks from the scenario's side, and stop behind them.

        Parameters
        ----------
        start : float
            Current time, s.
        attempt : int
            0, 1, ... below `HOME_ATTEMPTS`: each is slower by `HOME_SLOWER`.

        Returns
        -------
        first, last : float
            Times between which the marks are passed at a constant rate; after `last` the axes
            brake, and a second later they are at rest or return.

        Raises
        ------
        ValueError
            An axis cannot move so fast, or its travel ends there.
        """
        start = max(start, self._axes.leg.start)
        self.servo = np.zeros(2)
        rate = self._home_side * self._home_rate / HOME_SLOWER**attempt
        span = max(HOME_SPAN, 2.0 * HOME_RUN_UP / np.abs(rate).min())
        before, behind = self._marks - 0.5 * span * rate, self._marks + 0.5 * span * rate
        first = start
        # the slower axis determines when the crossing can begin
        for _ in range(3):
            settled = self._axes.arrival(
                start, Trajectory([first, first + span], [before, behind], [rate, rate]))
            if settled <= first:
                break
            first = on_cycle(settled) + 1.0
        self._axes.follow(start, Trajectory([first, first + span], [before, behind], [rate, rate]))
        last = first + span
        self._axes.follow(last, Trajectory([last + 1.0], [behind], STILL))
        return first, last

    def home_failure(self, reading, attempt=0):
        """Why homing failed.

        Parameters
        ----------
        reading : array_like, shape (2,)
            Readings of the incremental encoders after `home`, rad; NaN if a mark was not detected.
        attempt : int
            The last attempt.

        Returns
        -------
        str
            One line, or '' if both axes are homed.
        """
        rates = self._home_rate / HOME_SLOWER**attempt / DEG
        unmet = [f'{axis} (at {rate:.3g} deg/s)'
                 for axis, angle, rate in zip(self._words, reading, rates)
                 if not np.isfinite(angle)]
        if not unmet:
            return ''
        passages = 'a passage' if attempt == 0 else f'{attempt + 1} passages, each slower'
        return f'no reference mark met in {passages}: {", ".join(unmet)}; check head and mark'
