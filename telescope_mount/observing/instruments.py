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

"""The instruments seen by the observer: their last values, and which are silent."""

import math
import time
from collections import deque

import numpy as np

from msg_tools.units import DEG, wrap

from .frame_choice import ENCODERS, Exposures
from .instrument_health import ABSOLUTE, CAMERA, MOUNT, InstrumentHealth
from .zero_jumps import ZeroJumps

#: an axis slower than this is at rest, rad/s
STILL = 0.01 * DEG
#: limits for silence: wall s, multiple of the usual period, and multiple of the longest pause
QUIET, PERIODS, LONGEST = 0.5, 5.0, 2.0
#: interval between two calls of `watch` above which one is late (usually half a second), wall s
LATE = 0.9
#: change of this machine's clock relative to the monotonic clock that shows it was set, s
CLOCK_STEP = 0.1
#: least number of known periods for a usual period, and number kept
LEAST_GAPS, KEPT_GAPS = 10, 200
#: number of gaps after which a slow instrument is reported
SLOW_GAPS = 3
#: wall seconds after which an instrument that never published is reported; and start-up time during
#: which this longer limit also holds after its first message
NEVER, STARTING = 1.5, 3.0


class Instruments:
    """Mount, encoders and camera.

    Parameters
    ----------
    first_run : int
        Number of the first power-on.
    wall : callable
        A monotonic clock that runs while simulated time stands still, s.
    now : callable
        Graph time, ns; 0 if unknown.
    absolute : bool
        Whether there is an absolute encoder.
    live : bool
        Whether graph time is wall time: instruments then publish on their own.
    axes : sequence of str
        Names of the axes.

    Attributes
    ----------
    exposures : Exposures
        Readings and frames since the last command.
    stamp : int
        Stamp of the last reading of the incremental encoder, ns; 0 before the first.
    here, rate : ndarray, tuple
        Its angles, rad, and rates, rad/s, shape (2,); None before the first. A missing rate is
        computed from the previous reading.
    homed : bool
    run : int
        Number of the power-on: it increases with each one that the encoder reports, or, if none
        are reported, with each homing.
    power_on, absolute_power_on : PowerOn or None
        Power-ons reported by the incremental and the absolute encoder.
    began : int
        Number of restarts of the graph clock.
    names : tuple of str
        Names of the existing instruments.
    health : InstrumentHealth
        Faults of the instruments.
    excused : bool
        Whether the last `watch` was late: it is not a valid test.
    look : callable
        Called at each exposure to update the publishers in `health`.
    """

    def __init__(self, first_run=1, wall=time.monotonic, now=lambda: 0, absolute=True,
                 live=False, axes=('azimuth', 'elevation')):
        self.health, self.look, self._now = InstrumentHealth(live), lambda: None, now
        self.live = live
        self.names = (MOUNT, ABSOLUTE, CAMERA) if absolute else (MOUNT, CAMERA)
        self.exposures = Exposures(ENCODERS if absolute else ENCODERS[:1])
        self.stamp, self.here, self.rate = 0, None, None
        self.homed, self.began = False, 0
        self.run = self._newest = first_run - 1
        self.power_on, self._numbered = None, 0  # stamp since which the run has its number
        self._axes, self._zero_jumps = axes, {}
        self._said = {}  # power-on of the last reading of each encoder
        self.absolute_power_on = None
        self._runs = {}  # begin of a power-on -> its number
        self._wall = wall
        self._awaited_since, self._last_use = {}, {}
        self._first, self._last, self._stamped = {}, {}, {}
        self._gaps, self._steps, self._pauses = {}, {}, {}  # wall time, stamps, lesser
        self._watched, self.excused = None, False
        self._awaited = None  # since when messages of all are expected, wall s
        self._ahead = None  # graph time minus wall time, s

    def take_incremental(self, stamp, angle, rate, power_on=None):
        """Take a reading; True if the clock went back. ValueError for one out of order.

        `power_on` is its `PowerOn`, None if unknown.
        """
        self.count_message(MOUNT, stamp)
        self._check_stamp(MOUNT, stamp)
        back = self.exposures.add_reading('enc', stamp, angle)
        self.rate = self._rate(stamp, angle, rate)
        self.stamp, self.here = stamp, np.array(angle)
        self._look_for_jump(MOUNT, stamp, angle, power_on, self.exposures.demand)
        homed = bool(np.isfinite(angle).all())
        known = self.power_on is not None and self.homed
        if homed or (known and power_on in (None, self.power_on)):
            self.health.number(MOUNT, homed)
        if homed:
            self._number_run(stamp, power_on)
        self.homed = homed
        self.restart_silence(MOUNT)
        return back

    def _look_for_jump(self, name, stamp, angle, power_on, there):
        """Report jumps of the zero within a power-on; each power-on has its own zero."""
        other = name not in self._zero_jumps or power_on != self._said.get(name)
        if other or not any(map(math.isfinite, angle)):
            self._said[name], self._zero_jumps[name] = power_on, ZeroJumps(name != MOUNT)
            self.health.zero(name)
        jumped = self._zero_jumps[name].take(stamp, angle, there)
        if jumped is not None:
            self.health.zero(name, self._axes[jumped[0]], jumped[1])

    def _by_incremental(self, stamp):
        """Axis angles of the incremental encoder at a stamp, rad; None if unknown."""
        try:
            return self.exposures.at('enc', stamp)[0]
        except ValueError:
            return None

    def _rate(self, stamp, angle, given):
        """The given rate, or one from the previous reading; NaN if there is none."""
        rate = np.array(given, dtype=float)
        unknown = np.isnan(rate)
        if self.here is not None and stamp > self.stamp:
            own = wrap(np.array(angle) - self.here) / ((stamp - self.stamp) * 1e-9)
            rate[unknown] = own[unknown]
        return rate

    def _number_run(self, stamp, power_on):
        if self.homed and power_on == self.power_on:
            return
        if (self.homed and self.power_on is None and power_on.started not in self._runs
                and power_on.started <= self._numbered * 1e-9):
            self._runs[power_on.started] = self.run  # published after its first readings
            self.power_on = power_on
            return
        self._numbered = stamp
        if power_on is None and (not self.homed or self.power_on is not None):
            self.run = self._newest = self._newest + 1
        elif power_on is not None and power_on != self.power_on:
            self.run = self._runs.setdefault(power_on.started, self._newest + 1)
            self._newest = max(self._newest, self.run)
        self.power_on = power_on

    def remember_runs(self, runs, starts):
        """Number power-ons like the rows of the night so far, replacing our own numbers.

        Parameters
        ----------
        runs : array_like, shape (n,)
            Column ``run``.
        starts : array_like, shape (n,)
            Column ``encoder_start``, UTC s; NaN if the encoder did not report it.
        """
        self._runs = {float(start): int(run) for run, start in zip(runs, starts)
                      if np.isfinite(start)}
        self._newest = int(max(runs))
        if self.power_on is not None and self.power_on.started in self._runs:
            self.run = self._runs[self.power_on.started]
        elif self.homed:
            # it may be another power-on than that of the last rows: use a separate zero
            self.run = self._newest = self._newest + 1
            if self.power_on is not None:
                self._runs[self.power_on.started] = self.run

    def take_absolute(self, stamp, angle, power_on=None):
        """The same as `take_incremental`, for the absolute encoder."""
        self.count_message(ABSOLUTE, stamp)
        self._check_stamp(ABSOLUTE, stamp)
        back = self.exposures.add_reading('abs', stamp, angle)
        self._look_for_jump(ABSOLUTE, stamp, angle, power_on, self._by_incremental)
        self.absolute_power_on = power_on
        self.restart_silence(ABSOLUTE)
        return back

    def take_frame(self, stamp, x, y):
        """Take a measured miss distance, rad; ValueError for an impossible one."""
        self.count_message(CAMERA, stamp)
        self.restart_silence(CAMERA)
        self._check_stamp(CAMERA, stamp)
        reason = self.health.frame(CAMERA, x, y)
        if reason:
            raise ValueError(reason)
        self.exposures.add_frame(stamp, x, y)

    def clock_back(self):
        """The graph clock was restarted: earlier stamps would lie in the future."""
        self.exposures.forget()
        self.health.forget_stamps()
        self.stamp, self.began = 0, self.began + 1

    def _check_stamp(self, name, stamp):
        now = self._now()
        if now and not self.live:
            now = max(now, self.exposures.end)  # stamps may be as late as the commanded track
        reason = self.health.stamp(name, stamp, now)
        if reason:
            raise ValueError(reason)

    def homed_since(self, stamp):
        """Whether a reading after `stamp` is homed, with the axes at rest.

        The result must not depend on which reading arrives first.
        """
        return (self.homed and self.stamp > stamp
                and bool(np.all(np.abs(self.rate) <= STILL)))

    def count_message(self, name, stamp=None):
        """Count a message, usable or not, and the time since the previous one.

        A pause must also show in the stamps (ns): otherwise only this process was delayed.
        """
        now, last = self._wall(), self._last.get(name)
        self._first.setdefault(name, now)
        self._last[name] = now
        before, self._stamped[name] = self._stamped.get(name), stamp
        if last is not None and not self.health.is_silent(name):
            gap = now - last
            self._gaps.setdefault(name, deque(maxlen=KEPT_GAPS)).append(gap)
            if stamp is not None and before is not None and stamp > before:
                step = (stamp - before) * 1e-9
                self._steps.setdefault(name, deque(maxlen=KEPT_GAPS)).append(step)
                gap = min(gap, step)
            self._pauses.setdefault(name, deque(maxlen=KEPT_GAPS)).append(gap)
        self.health.message_came(name)

    def usual(self, name, least=LEAST_GAPS):
        """Usual seconds between its messages; NaN if fewer than `least` gaps are known.

        Messages that waited for this process arrive together: on wall time their stamps show how
        often they were sent.
        """
        gaps, steps = (kept.get(name, ()) for kept in (self._gaps, self._steps))
        if len(gaps) < least:
            return np.nan
        return float(max(np.median(gaps), np.median(steps) if self.live and len(steps) else 0.0))

    def watch(self, answer):
        """Report instruments that have fallen silent, have never published, or are slow.

        In simulated time instruments publish on request, and nothing is reported.

        Parameters
        ----------
        answer : float
            Time allowed for an answer, wall s.
        """
        now = self._wall()
        # before a late call there may be messages that were not processed yet
        late = self._watched is not None and now - self._watched > LATE
        self._watched, self.excused = now, late and not self.excused
        if self.excused or not self.live:
            return
        self._look_for_step()
        if self._awaited is None:
            self._awaited = now
        for name in self.names:
            last, usual = self._last.get(name), self.usual(name)
            if last is None:
                if now - self._awaited > NEVER:
                    self.health.silent(name, np.nan)
            elif np.isfinite(usual) and now - last > max(
                    QUIET if last - self._first[name] > STARTING else NEVER, PERIODS * usual,
                    LONGEST * max(self._pauses[name])):
                self.health.silent(name, usual)
            self.health.slow(name, self.usual(name, SLOW_GAPS), answer)

    def _look_for_step(self):
        """Detect a step of the clock by comparison with the monotonic clock."""
        before, now = self._wall(), self._now()
        if not now or self._wall() - before > 0.1 * CLOCK_STEP:  # delayed in between: skip
            return
        ahead = now * 1e-9 - before
        self._ahead, last = ahead, self._ahead
        if last is not None and abs(ahead - last) > CLOCK_STEP:
            self.health.clock(ahead - last, now)

    def restart_silence(self, name):
        """Restart the silence timer of an instrument."""
        self._last_use[name] = self._wall()

    def await_all(self):
        """Expect answers of all from now on; returns the time, wall s."""
        now = self._wall()
        self._awaited_since = dict.fromkeys(self.names, now)
        self._last_use = dict(self._awaited_since)
        return now

    def silent(self, seconds):
        """Names of instruments silent for this long."""
        now = self._wall()
        # a slow instrument is late, not silent
        return [name for name, last in self._last_use.items() if now - last > seconds
                and now - last > 3.0 * np.nan_to_num(self.usual(name, 1))]

    def mute(self, name, seconds):
        """Whether an instrument has sent nothing at all for this long since `restart_silence`."""
        last = max(self._last.get(name, -np.inf), self._last_use.get(name, -np.inf))
        passed = self._wall() - last
        return passed > seconds and passed > 3.0 * np.nan_to_num(self.usual(name, 1))

    def unanswered(self, seconds):
        """Names of those without an answer since `await_all`; if none, of silent ones."""
        mute = [name for name, last in self._last_use.items()
                if last == self._awaited_since.get(name)]
        return mute or self.silent(seconds)
