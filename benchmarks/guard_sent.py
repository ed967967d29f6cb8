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

"""Commands of the guard to an obedient mount, step by step: whole sessions with faults.

    python benchmarks/guard_sent.py [--sessions N]

Random mounts, horizons and Suns as in `guard.py`. A commander requests stars, satellites, nonsense
and invalid numbers; it hangs or withdraws. Encoders fall silent; a user pauses, aborts, resumes,
parks; the guard itself is suspended for some seconds. The mount follows the last command, and
stands at its end. Checked in steps of 0.05 s (`guard_drives.py`): the moving axes (never beyond the
limits, or never farther beyond if they started there), and each command: it continues the last one,
respects speed and acceleration, and ends at rest.
"""

import argparse
import time
from contextlib import suppress

import numpy as np
from guard import KINDS, places, setting, track_of
from guard_drives import Many, hermite

from msg_tools.units import DEG
from telescope_mount.guard.reasons_to_stop import GuardSettings
from telescope_mount.guard.supervisor import Supervisor
from telescope_mount.observing.axis_demand import Track

TICK, SECONDS = 0.05, 240.0
ROUNDING = 0.01 * DEG
#: of the limits, by which numbers are rounded
OVER = 1e-6


class Session:
    """A mount, its guard and a commander."""

    def __init__(self, rng, own, here):
        self.rng, self.own, self.here, self.rate = rng, own, here, np.zeros(2)
        self.time, self.start = 0.0, round(own.time * 1e9)
        self.supervisor = Supervisor(own.check.limits, own.over, GuardSettings(whole=False),
                             lambda: self.time)
        self.track, self.asked, self.path, self.wrong = None, None, [here], []
        self.hung = self.silent = self.dead = 0.0
        self.states = set()

    @property
    def now(self):
        """Current time, ns since 1970."""
        return self.start + round(self.time * 1e9)

    def happen(self, free):
        """A random event: request, hang, withdrawal, silence, service call."""
        rng, supervisor = self.rng, self.supervisor
        what = rng.choice(['ask', 'hang', 'withdraw', 'silent', 'pause', 'abort', 'park', 'dead'],
                          p=[0.65, 0.08, 0.04, 0.05, 0.06, 0.05, 0.03, 0.04])
        if what == 'ask':
            kind = KINDS[int(np.searchsorted((0.7, 0.85, 0.95, 1.0), rng.random()))]
            times, angles, rates = track_of(rng, self.own, kind, free[rng.integers(len(free))])
            self.asked = Track(self.now, times, angles, rates)
        elif what in ('hang', 'silent', 'dead'):
            setattr(self, {'hang': 'hung'}.get(what, what), self.time + rng.uniform(0.3, 5.0))
        elif what == 'withdraw':
            self.asked = None
            supervisor.withdraw(self.now)
        elif what == 'pause':
            self.call(supervisor.pause)
        elif what == 'abort':
            self.call(supervisor.abort)
        else:
            self.call(supervisor.park, free[rng.integers(len(free))])
        if rng.random() < 0.5:
            self.call(supervisor.resume)

    def call(self, what, *args):
        """Call a service of the guard; a refusal is no error."""
        with suppress(ValueError):
            what(self.now, *args)

    def step(self, number):
        """Advance by one tick: move the mount, feed the guard, check what it sends."""
        self.time += TICK
        before = self.here
        if self.track is not None:
            t = np.array([(self.now - self.track.start) * 1e-9])
            place, rate = hermite(*self.track[1:], t)
            self.here, self.rate = place[0], rate[0]
        self.path.append(self.here)
        if self.time < self.dead:
            return
        if self.time >= self.silent:
            try:
                self.supervisor.take_reading(self.now, self.here, (self.here - before) / TICK)
            except ValueError as err:
                self.wrong.append(f'reading: {err}')
        if self.asked is not None and self.time >= self.hung and number % 4 == 0:
            with suppress(ValueError):
                self.supervisor.take_request(self.asked, self.now, 'commander')
        for track in self.supervisor.step(self.now, number % 10 == 0):
            self.check(track)
            self.track = track
        self.states.add(self.supervisor.state)

    def check(self, track):
        """Check a command of the guard."""
        times, angles, rates = track[1:]
        if rates[-1].any():
            self.wrong.append('does not end at rest')
        t = np.arange(0.0, times[-1], 0.02)
        place, rate = hermite(times, angles, rates, t)
        top, most = self.own.rate * (1.0 + OVER), self.own.acceleration * (1.0 + 1e-3)
        if np.any(np.abs(rate) > top + 1e-9):
            self.wrong.append(f'{np.max(np.abs(rate) / top):.3f} of the speed')
        h = np.diff(times)[:, None]
        bend = np.abs(np.diff(rates, axis=0)) / h
        if np.any(bend > most + 1e-6):
            self.wrong.append(f'{np.max(bend / most):.3f} of the acceleration '
                              f'({self.supervisor.state}, {len(times)} knots)')
        at = np.array([(self.now - track.start) * 1e-9])
        jump = np.abs(hermite(times, angles, rates, at)[0][0] - self.here).max()
        if jump > 0.5 * TICK * np.max(self.own.rate):
            self.wrong.append(f'begins {jump / DEG:.3f} deg from where the mount is '
                              f'({self.supervisor.state})')

    def depth(self):
        """Largest violation of a limit by the moving mount, rad, negative; 0 if there is none."""
        path = np.array(self.path)
        seconds = TICK * np.arange(len(path))
        many = Many([self.own], np.zeros(len(path), int))
        sun = _each(many, path, seconds)
        inside = many.inside(path.T)
        moving = np.concatenate([[False], np.abs(np.diff(path, axis=0)).max(1) > 1e-9])
        worst = 0.0
        for depth in (inside, *sun):
            allowed = 0.0
            for k in np.flatnonzero((depth < 0.0) | np.roll(depth < 0.0, 1)):
                if not moving[k]:
                    allowed = min(0.0, depth[k])  # it stands there already, or the Sun has come
                else:
                    worst = min(worst, depth[k] - allowed)
        return worst


def _each(many, path, seconds):
    first, second = path.T
    place = np.array(many.sky(np.sin(first), np.cos(first), np.sin(second), np.cos(second)))
    above = np.arcsin(np.clip(np.sum(many._up * place, 0), -1.0, 1.0)) - many.lowest(
        np.arange(len(first)), place)
    angle = 7.292115e-5 * seconds
    a, b, c = np.moveaxis(many.path, -1, 0)
    sun = (a + b * np.cos(angle)[:, None] + c * np.sin(angle)[:, None]).T
    apart = np.arccos(np.clip(np.sum(sun * place, 0), -1.0, 1.0)) - many.sun
    return above, np.where(many.sun > 0.0, apart, np.inf)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--sessions', type=int, default=20)
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    violations, wrong, sent, spent, states = [], [], 0, [], set()
    for number in range(args.sessions):
        rng = np.random.default_rng([args.seed, number])
        own = free = None
        while free is None:
            own = setting(rng, number)
            free = places(rng, own, 60, 2.0 * DEG)
        session = Session(rng, own, free[-1])
        next_at = 1.0
        for tick in range(int(SECONDS / TICK)):
            if session.time > next_at:
                session.happen(free[:-1])
                next_at = session.time + rng.uniform(1.0, 40.0)
            before = session.track
            begin = time.thread_time()
            session.step(tick)
            spent.append(time.thread_time() - begin)
            sent += session.track is not before
        worst = session.depth()
        states |= session.states
        if worst < -ROUNDING:
            violations.append(worst / DEG)
            print(f'violation {number} {own.kind} {worst / DEG:.3f} deg', flush=True)
        if session.wrong:
            wrong.append(number)
            print(f'wrong {number} {own.kind} {sorted(set(session.wrong))[:3]}', flush=True)
    spent = 1e3 * np.array(spent)
    for what, figure, target in (
            ('sessions of 240 s, commands sent', f'{args.sessions}, {sent}', ''),
            ('states seen', ' '.join(sorted(states)), ''),
            ('sessions beyond a limit', f'{len(violations)}', '0'),
            ('sessions with something sent that cannot be followed', f'{len(wrong)}', '0'),
            ('a step of 0.05 s, processor time: median, p99, worst',
             f'{np.median(spent):.3f}, {np.percentile(spent, 99):.2f}, {spent.max():.0f} ms', '')):
        print(f'{what:56} {figure:40} {target}')
    return bool(violations or wrong)


if __name__ == '__main__':
    raise SystemExit(main())
