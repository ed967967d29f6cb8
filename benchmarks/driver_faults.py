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

"""Fourteen faults of drivers, in real time and through the guard.

    python benchmarks/driver_faults.py           # each once
    python benchmarks/driver_faults.py --full    # each ten times
    python benchmarks/driver_faults.py --faults 'mount deaf' --times 3

The observer and the guard are processes; the drivers are in this process. A fault begins with the
night, or at a random moment after the first star. Measured: time from the first message that shows
the fault until status, diagnostics and log name it; number of log lines about it; how the plan
ends, with `give_up_s` 6; and whether any command exceeded travel, speed or horizon or came too near
the Sun, by an independent integration of the commands.
"""

import argparse
import os
import re
import signal
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from live_mount import GUARD, Night

from msg_tools.units import ARCSEC, DEG
from telescope_mount.graph import NODES, NodeSpec

GIVE_UP = 6.0
HANGING = """import time, rclpy, pathlib
from rclpy.node import Node
from std_srvs.srv import Trigger
class Hangs(Node):
    def __init__(self):
        super().__init__('hangs')
        self.create_service(Trigger, 'home', self.home)
    def home(self, request, response):
        pathlib.Path({!r}).write_text(repr(time.time()))
        time.sleep(600)  # longer than anybody waits: it hangs
        return response
rclpy.init()
rclpy.spin(Hangs())
"""


@dataclass
class Fault:
    """A fault, and what must be reported.

    Parameters
    ----------
    words : str
        Regular expression: a sentence with them names it.
    begin : callable
        ``begin(night)`` makes it fail.
    ends : str
        States in which the plan ends or goes on.
    give_up : float
        Parameter of the observer, s.
    first : bool
        It is there from the beginning of the night.
    shown : callable
        ``shown(night, begun)`` gives when the messages show it, s; None as long as they do not.
    """

    words: str
    begin: object
    ends: str = 'failed'
    give_up: float = GIVE_UP
    first: bool = False
    shown: object = lambda night, begun: begun


def camera(factor):
    def begin(night):
        night.mount.miss = lambda stamp, x, y: (stamp, factor * x, factor * y)
    return begin


def readings(change):
    def begin(night):
        night.mount.reading = change
    return begin


def silent(name):
    def begin(night):
        setattr(night.mount, name, lambda *_: None)
    return begin


def flipped(night):
    """Shown by the first image after a centring in which a star is farther off than before."""
    seen = []

    def miss(stamp, x, y):
        if np.isfinite(x):
            seen.append(np.hypot(x, y))
            if night.shown is None and len(seen) > 1 and seen[-1] > max(
                    1.3 * seen[-2], 100.0 * ARCSEC):
                night.shown = time.time()
        return stamp, -x, -y
    night.mount.miss = miss


def deaf(night):
    night.mount.deaf, night.mount.sent_far = True, None


def slow(night):
    night.mount.images = 7.0


def names(night):
    night.mount.joints = 'az', 'alt'


def commander(night):
    os.kill(night.nodes.running['star_observer'].pid, signal.SIGSTOP)


def nothing(night):
    """The absolute encoder is not there anyway, and home is that of the script."""


def called(night, begun):
    path = night.folder / 'called'
    return float(path.read_text()) if path.exists() and path.read_text() else None


def star_seen(night, begun):
    """When the first image with a star came."""
    return night.mount.first_star


def spoken(night, begun):
    """When the observer said its first word."""
    return next((when for when, where, _ in night.heard if where == 'status'), None)


def homed(night, begun):
    """When the first reading with a number came."""
    return night.mount.first_number


def second_image(night, begun):
    """That the observer hears: of one alone nobody knows when the next is due."""
    hears = spoken(night, begun)
    after = [when for when in night.mount.images_at if hears is not None and when > hears]
    return after[1] if len(after) > 1 else None


UNITS = 'arcsec or degrees for radians'
FAULTS = {
    'camera in arcsec': Fault(UNITS, camera(1.0 / ARCSEC), first=True, shown=star_seen),
    'camera in degrees': Fault(UNITS, camera(1.0 / DEG), first=True, shown=star_seen),
    'encoders in degrees': Fault('degrees for radians', readings(
        lambda stamp, angles: (stamp, angles / DEG)), first=True, shown=homed),
    'stamps 0': Fault('stamps are 0', readings(lambda stamp, angles: (0, angles))),
    'stamps in the future': Fault("ahead of this machine's clock", readings(
        lambda stamp, angles: (stamp + 3600 * 10**9, angles))),
    'camera slow': Fault('slower than answer_timeout_s', slow, 'observing', 60.0, first=True,
                         shown=second_image),
    'camera sign flipped': Fault('contradicts the commanded motion', flipped, first=True,
                                 shown=lambda night, begun: night.shown),
    'encoder dead': Fault('silent|no reading of the encoders', silent('reading')),
    'mount deaf': Fault('no axis has moved|from where it was sent|from its demand', deaf,
                        'cancelled failed',
                        shown=lambda night, begun: night.mount.sent_far),
    'absolute encoder absent': Fault('the mount has none: absolute_encoder: false', nothing,
                                     'waiting', first=True, shown=spoken),
    'home hanging': Fault('home to answer: it homes', nothing, first=True, shown=called),
    'names wrong': Fault('joint names', names, first=True, shown=spoken),
    'commander stops': Fault('no longer renewed', commander, 'observing'),
    'camera silent': Fault('camera: silent', silent('miss')),
}


def run(name, seed):
    """One night with a fault.

    Returns
    -------
    dict
        Seconds until each of status, diagnostics and log; lines of the log, state, what was
        commanded beyond the limits, commands.
    """
    fault, rng = FAULTS[name], np.random.default_rng(seed)
    absolute = name.startswith('absolute')
    specs = [
        NodeSpec('mount_guard', NODES['mount_guard'], dict(GUARD)),
        NodeSpec('star_observer', NODES['star_observer'], {
            'plan': 'home, stars 200', 'absolute_encoder': absolute, 'give_up_s': fault.give_up,
            'slew_rate_deg_s': 16.0, 'star_seed': seed, 'field_deg': 1.0, 'wait_for_nodes': [''],
            'recentre_arcsec': 60.0})]
    with tempfile.TemporaryDirectory() as folder, Night(folder, specs, seed) as night:
        night.shown = None
        if name == 'home hanging':
            script = Path(folder) / 'hangs.py'
            script.write_text(HANGING.format(str(Path(folder) / 'called')))
            night.nodes.start_script(script)
        else:
            night.mount.offer_home()
        if fault.first:
            fault.begin(night)
        begun = time.time()
        night.start()
        night.until(lambda: night.text(), 20.0)
        if not fault.first:
            night.until(lambda: night.progress().observations > 0, 60.0)
            night.lasts(rng.uniform(0.0, 5.0))
            fault.begin(night)
            begun = time.time()
        found = {}
        night.until(lambda: fault.shown(night, begun) is not None, 60.0)
        at = fault.shown(night, begun)
        if at is None:
            return {'shown': False, 'state': night.progress().state, 'beyond': night.mount.beyond,
                    'commands': night.mount.commands, 'text': night.text(), 'lines': 0}

        def all_named():
            for when, where, text in night.heard:
                if when > begun and re.search(fault.words, text):
                    found.setdefault(where, when - at)
            return {'status', 'diagnostics'} <= set(found)
        night.until(all_named, 6.0)
        night.lasts(max(0.0, at + GIVE_UP + 5.0 - time.time()))
        lines = [(when, text) for node in ('star_observer', 'mount_guard')
                 for when, text in night.log(node)
                 if when > begun - 0.1 and re.search(fault.words, text)
                 and not re.search('over: |given up|message refused', text)]
        if lines:
            found['log'] = min(when for when, _ in lines) - at
        state = night.progress().state
        if name == 'commander stops':
            os.kill(night.nodes.running['star_observer'].pid, signal.SIGCONT)
        return {'shown': True, **found, 'lines': len(lines), 'state': state, 'text': night.text(),
                'beyond': night.mount.beyond, 'commands': night.mount.commands,
                'said': [text for _, text in lines], 'longest': night.mount.longest}


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--times', type=int, default=1)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--faults', default=','.join(FAULTS))
    parser.add_argument('--verbose', action='store_true')
    args = parser.parse_args()
    times = 10 if args.full else args.times
    print(f'{"fault":25} nights  named within, s: status  diagnostics    log   lines  '
          'ends                commands  beyond limits')
    total = Counter()
    for name in args.faults.split(','):
        out = [run(name, args.seed + i) for i in range(times)]
        if args.verbose:
            for one in out:
                print('   ', one)
        worst = [max(one.get(where, np.inf) for one in out) for where in (
            'status', 'diagnostics', 'log')]
        states = Counter(one['state'] for one in out)
        beyond = sum(len(one['beyond']) for one in out)
        commands = sum(one['commands'] for one in out)
        lines = [one['lines'] for one in out]
        print(f'{name:25} {len(out):6} {worst[0]:24.2f} {worst[1]:12.2f} {worst[2]:6.2f} '
              f'{min(lines):3}..{max(lines):<3} '
              + f'{", ".join(f"{v} {k}" for k, v in states.items()):20}'
              + f' {commands:7} {beyond:10}', flush=True)
        total['named'] += sum(all(one.get(where, np.inf) <= 2.0 for where in (
            'status', 'diagnostics', 'log')) for one in out)
        total['ended'] += sum(one['state'] in FAULTS[name].ends.split() for one in out)
        total['nights'] += len(out)
        total['commands'] += commands
        total['beyond'] += beyond
    print(f'named within 2 s in all three: {total["named"]} of {total["nights"]}; ended or went on '
          f'as stated: {total["ended"]}; beyond the limits: {total["beyond"]} of '
          f'{total["commands"]} commands')


if __name__ == '__main__':
    main()
