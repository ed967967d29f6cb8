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

"""The instruments as the observer knows them: their last values, and which are silent."""

import math
import time
from collections import deque

import numpy as np

from msg_tools.units import DEG, wrap

from .frame_choice import ENCODERS, Exposures
from .instrument_health import ABSOLUTE, CAMERA, MOUNT, InstrumentHealth
from .zero_jumps import ZeroJumps

#: an axis slower than this stands still, rad/s
STILL = 0.01 * DEG
#: an instrument is silent after so long, wall s, so many of its usual periods, and of its longest
QUIET, PERIODS, LONGEST = 0.5, 5.0, 2.0
#: between two looks, which are to be half a second apart, wall s
LATE = 0.9
#: s by which the clock of this machine leaves that which nobody can set, once it was set
CLOCK_STEP = 0.1
#: periods that must be known for that, and that are kept
LEAST_GAPS, KEPT_GAPS = 10, 200
#: gaps of which one that is slow is told
SLOW_GAPS = 3
#: wall seconds after which one that has never spoken is named; and one that has spoken for less
#: than the second, in which it and all others are still starting
NEVER, STARTING = 1.5, 3.0


class Instruments:
    """Mount, encoders and camera.

    Parameters
    ----------
    first_run : int
        Number of the first power-on.
    wall : callable
        Seconds of a clock that goes on while simulated time stands still.
    now : callable
        The graph's time, ns; 0 where it is not known.
    absolute : bool
        Whether there is an absolute encoder.
    live : bool
        Whether the time of the graph is that of the wall: instruments then speak on their own.
    axes : sequence of str
        What the axes are called.

    Attributes
    ----------
    exposures : Exposures
        Readings and frames since the last command.
    stamp : int
        Of the last reading of the incremental encoder, ns; 0 before the first.
    here, rate : ndarray, tuple
        Its angles, rad, and rates, rad/s, shape (2,); None before the first. A rate that it does
        not tell is that since the reading before.
    homed : bool
    run : int
        Number of the power-on: a new one with each that the encoder tells, or, where it tells
        none, each time that it has been homed.
    power_on, absolute_power_on : PowerOn or None
        What the incremental and the absolute encoder tell of it.
    began : int
        How often the clock of the graph began anew.
    names : tuple of str
        Of the instruments that there are.
    health : InstrumentHealth
        What the instruments say that cannot be.
    excused : bool
        Whether the last `watch` came late: nothing can be tested by it.
    look : callable
        Called at each exposure, so that `health` knows who publishes.
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
        self.power_on, self._numbered = None, 0  # since which stamp the run has its number
        self._axes, self._zero_jumps = axes, {}
        self._said = {}  # power-on of the last reading of each encoder
        self.absolute_power_on = None
        self._runs = {}  # when a power-on began -> its number
        self._wall = wall
        self._awaited_since, self._last_use = {}, {}
        self._first, self._last, self._stamped = {}, {}, {}
        self._gaps, self._steps, self._pauses = {}, {}, {}  # of the wall, by stamps, the lesser
        self._watched, self.excused = None, False
        self._awaited = None  # since when all are to speak, wall s
        self._ahead = None  # time of the graph less that of the wall, s

    def take_incremental(self, stamp, angle, rate, power_on=None):
        """Take a reading; True where the clock went back. ValueError for one out of order.

        `power_on` is the `PowerOn` of it, None where none is known.
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
        """Say of a zero that jumps within a power-on; another power-on has its own zero."""
        other = name not in self._zero_jumps or power_on != self._said.get(name)
        if other or not any(map(math.isfinite, angle)):
            self._said[name], self._zero_jumps[name] = power_on, ZeroJumps(name != MOUNT)
            self.health.zero(name)
        jumped = self._zero_jumps[name].take(stamp, angle, there)
        if jumped is not None:
            self.health.zero(name, self._axes[jumped[0]], jumped[1])

    def _by_incremental(self, stamp):
        """Where the incremental encoder has the axes at a stamp, rad; None where it has not."""
        try:
            return self.exposures.at('enc', stamp)[0]
        except ValueError:
            return None

    def _rate(self, stamp, angle, given):
        """As given, or else from the reading before; NaN where that is none."""
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
        """Number power-ons as the rows of the night so far do, and forget numbers of one's own.

        Parameters
        ----------
        runs : array_like, shape (n,)
            Column ``run``.
        starts : array_like, shape (n,)
            Column ``encoder_start``, UTC s; NaN where the encoder did not tell.
        """
        self._runs = {float(start): int(run) for run, start in zip(runs, starts)
                      if np.isfinite(start)}
        self._newest = int(max(runs))
        if self.power_on is not None and self.power_on.started in self._runs:
            self.run = self._runs[self.power_on.started]
        elif self.homed:
            # whether it is the power-on of the last rows nobody can tell: its own zero
            self.run = self._newest = self._newest + 1
            if self.power_on is not None:
                self._runs[self.power_on.started] = self.run

    def take_absolute(self, stamp, angle, power_on=None):
        """As `take_incremental`, of the absolute encoder."""
        self.count_message(ABSOLUTE, stamp)
        self._check_stamp(ABSOLUTE, stamp)
        back = self.exposures.add_reading('abs', stamp, angle)
        self._look_for_jump(ABSOLUTE, stamp, angle, power_on, self._by_incremental)
        self.absolute_power_on = power_on
        self.restart_silence(ABSOLUTE)
        return back

    def take_frame(self, stamp, x, y):
        """Take a measured miss distance, rad; ValueError for one that cannot be."""
        self.count_message(CAMERA, stamp)
        self.restart_silence(CAMERA)
        self._check_stamp(CAMERA, stamp)
        reason = self.health.frame(CAMERA, x, y)
        if reason:
            raise ValueError(reason)
        self.exposures.add_frame(stamp, x, y)

    def clock_back(self):
        """The clock of the graph began anew: stamps of before are those of a time to come."""
        self.exposures.forget()
        self.health.forget_stamps()
        self.stamp, self.began = 0, self.began + 1

    def _check_stamp(self, name, stamp):
        now = self._now()
        if now and not self.live:
            now = max(now, self.exposures.end)  # commanded for tomorrow it answers of tomorrow
        reason = self.health.stamp(name, stamp, now)
        if reason:
            raise ValueError(reason)

    def homed_since(self, stamp):
        """Whether a reading after `stamp` says so, with the axes at rest.

        Which reading comes in first must not decide what follows.
        """
        return (self.homed and self.stamp > stamp
                and bool(np.all(np.abs(self.rate) <= STILL)))

    def count_message(self, name, stamp=None):
        """Count a message, of use or not, and the time since the one before.

        A pause is one by its stamps (ns) too: where this process had no time, it is none.
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
        """Seconds between two of its messages; NaN where fewer than `least` such gaps are known.

        Messages that waited for this process come all at once: live, their stamps tell how often
        they were sent.
        """
        gaps, steps = (kept.get(name, ()) for kept in (self._gaps, self._steps))
        if len(gaps) < least:
            return np.nan
        return float(max(np.median(gaps), np.median(steps) if self.live and len(steps) else 0.0))

    def watch(self, answer):
        """Say who has fallen silent, who has never spoken, and who is slow.

        Where time is simulated instruments speak when they are asked, and nothing is reported.

        Parameters
        ----------
        answer : float
            What an answer may take, wall s.
        """
        now = self._wall()
        # a look that comes late has messages before it that nobody has taken yet
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
        """The wall's clock cannot be set: one that leaves it was, and all stamps with it."""
        before, now = self._wall(), self._now()
        if not now or self._wall() - before > 0.1 * CLOCK_STEP:  # no time between: no comparison
            return
        ahead = now * 1e-9 - before
        self._ahead, last = ahead, self._ahead
        if last is not None and abs(ahead - last) > CLOCK_STEP:
            self.health.clock(ahead - last, now)

    def restart_silence(self, name):
        """Count the silence of an instrument from now on."""
        self._last_use[name] = self._wall()

    def await_all(self):
        """All of them are to answer from now on, which is returned; wall s."""
        now = self._wall()
        self._awaited_since = dict.fromkeys(self.names, now)
        self._last_use = dict(self._awaited_since)
        return now

    def silent(self, seconds):
        """Names of those that have said nothing for so long."""
        now = self._wall()
        # a slow one is late, not silent
        return [name for name, last in self._last_use.items() if now - last > seconds
                and now - last > 3.0 * np.nan_to_num(self.usual(name, 1))]

    def mute(self, name, seconds):
        """Whether one has sent nothing for so long, of use or not, since `restart_silence`."""
        last = max(self._last.get(name, -np.inf), self._last_use.get(name, -np.inf))
        passed = self._wall() - last
        return passed > seconds and passed > 3.0 * np.nan_to_num(self.usual(name, 1))

    def unanswered(self, seconds):
        """Names of those without an answer since `await_all`, else of those silent for so long."""
        mute = [name for name, last in self._last_use.items()
                if last == self._awaited_since.get(name)]
        return mute or self.silent(seconds)
