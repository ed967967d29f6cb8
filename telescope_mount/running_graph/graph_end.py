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

"""The end of a graph that moves a mount: the mount is at rest before its guard ends."""

import time
from collections import deque

import numpy as np

from msg_tools.units import DEG, wrap

#: the mount is at rest if over this interval (s) the axes move slower than this (rad/s; the sky
#: turns at 0.004 deg/s)
SPACING, STILL = 0.3, 0.03 * DEG
#: time allowed to stop, and to park, s
STOPPED, PARKED = 30.0, 600.0
#: longer waits are reported, s
NOTED = 1.0
#: encoders silent for this long are taken as stopped, s
SILENT = 3.0
#: time allowed for delivery of a message, s
DELIVERED = 1.0
#: time allowed for an answer of the guard, s
ANSWERED = 2.0
#: number of requests meanwhile
ATTEMPTS = 4
#: states of the guard in which it has not moved the mount, or has stopped it already
RESTING = ('idle', 'inactive')
#: states in which it accepts no request, either
LOCKED = ('aborted', 'parked')


class AtRest:
    """Whether the axes of a mount are at rest, from their readings alone.

    Attributes
    ----------
    at_rest : bool
        False until known.
    unknown : bool
        The last reading is not a number: the mount was not homed, and the guard did not move it.
    """

    def __init__(self):
        self._kept = deque()
        self.at_rest = self.unknown = False

    def take(self, at, angles):
        """Add a reading: time, s, and both angles, rad."""
        angles = np.array(angles, float)
        self.unknown = not np.isfinite(angles).all()
        # ten readings per interval are enough
        if self.unknown or (self._kept and at - self._kept[-1][0] < 0.1 * SPACING):
            return
        self._kept.append((at, angles))
        # keep one reading at least as old as the interval: an encoder may be slow
        while len(self._kept) > 2 and at - self._kept[1][0] >= SPACING:
            self._kept.popleft()
        moved = np.abs(wrap(angles - np.array([other for _, other in self._kept]))).max()
        span = at - self._kept[0][0]
        self.at_rest = bool(span >= SPACING and moved <= STILL * span)


def come_to_rest(watcher, plan, note):
    """Have the guard of a graph stop the mount, or finish parking it, and wait.

    Parameters
    ----------
    watcher : watcher.Watcher
        Watcher of the graph, whose nodes still run.
    plan : str
        State of the plan, see `msg_tools.status_rows.Progress`.
    note : callable
        Called with messages about waiting and its result.

    Raises
    ------
    KeyboardInterrupt
        The user does not want to wait.
    """
    from msg_tools import convert, topics

    def state():
        message = watcher.latest.get(topics.GUARD_STATUS.name)
        return '' if message is None else next(
            (row.value for row in message.values if row.key == 'state'), '')

    watcher.check = lambda: None  # ended nodes do not matter any more
    if not state():
        return  # it never published, and did not move the mount
    if plan == 'cancelled':  # by the guard itself, whose status may arrive a moment later
        watcher.spin_until(lambda: state() in (*LOCKED, *RESTING, 'parking'), DELIVERED)
    if state() == 'parking':
        note('waiting until the mount is parked; Ctrl-C ends at once, and the mount stops')
        if not watcher.spin_until(lambda: state() != 'parking', PARKED):
            note(f'not parked after {PARKED:g} s: the mount is stopped')
    if state() == 'parked':
        note('parked')
        return
    rest, last = AtRest(), [time.monotonic()]

    def take(message):
        last[0] = time.monotonic()
        try:
            stamp, angles, *_ = convert.read_joints(message)
        except ValueError:
            return
        rest.take(stamp * 1e-9, angles)

    led = state() not in RESTING
    moves = not (state() in LOCKED or (plan == 'done' and state() == 'idle'))
    subscription = watcher.node.create_subscription(
        topics.INCREMENTAL.message, topics.INCREMENTAL.name, take, topics.INCREMENTAL.qos)
    try:
        if moves and not _aborted(watcher):
            note('the guard does not answer: the mount stops by itself at the end of its last '
                 'command')
        if not led and not watcher.node.count_publishers(subscription.topic_name):
            return  # a mount without a driver, and nothing was requested
        last[0] = time.monotonic()

        def over():
            return rest.at_rest or rest.unknown or time.monotonic() - last[0] > SILENT

        if not watcher.spin_until(over, NOTED):
            note('waiting for the mount to stop; Ctrl-C ends at once')
            watcher.spin_until(over, STOPPED)
        if rest.unknown:
            note('positions of the axes unknown: a driver that is homing the mount goes on until '
                 'it is done; check the mount')
        elif not rest.at_rest:
            note('check the mount, it may still move: ' + (
                'no encoder readings' if over() else f'moving for {STOPPED:g} s already'))
    finally:
        watcher.node.destroy_subscription(subscription)


def _aborted(watcher):
    """Call `abort` of the guard; whether it answers."""
    from std_srvs.srv import Trigger
    client = watcher.client('abort')
    if not watcher.spin_until(client.service_is_ready, ANSWERED):
        return False
    futures = []
    for _ in range(ATTEMPTS):  # repetition is harmless, and a call may be lost
        futures.append(client.call_async(Trigger.Request()))
        if watcher.spin_until(lambda: any(one.done() for one in futures), ANSWERED / ATTEMPTS):
            return True
    return False
