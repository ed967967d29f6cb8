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

"""Recomputes the observations of a log from readings, exposures and tracks."""

import struct
from bisect import bisect_left, bisect_right
from collections import deque
from itertools import islice

import numpy as np

from msg_tools.convert import read_joints, read_trajectory
from pointing_model.mounts import centred, centred_second, is_beyond
from telescope_mount.observing.axis_demand import Track
from telescope_mount.observing.frame_choice import (
    CLOCK_JUMP,
    RATE_OVER,
    half_of,
    interpolate,
    mean_over,
)

#: number of encoder readings kept until the observation of their time arrives
READINGS = 50_000
#: ns that an observation waits for later readings when the buffer is full
PATIENCE = 60 * 10**9
#: encoder topics -> names in the columns of a run
RAW = {'incremental/joint_states': 'enc', 'absolute/joint_states': 'abs'}


def at_time(stamp):
    """A stamp (ns) in words."""
    return f'{stamp // 10**9}.{stamp % 10**9:09d} s'


def began_anew(log):
    """Where the time of a log went back.

    Parameters
    ----------
    log : BagReader

    Returns
    -------
    list of (int, int)
        Times before and after each backward jump of ``/clock``, in the order of publication, ns.
    """
    clock = sorted((message.publish_time, stamp) for message in log.messages('/clock')
                   if (stamp := _stamp_in(message)) is not None)
    stamps = np.array([stamp for _, stamp in clock], np.int64)
    back = np.flatnonzero(np.diff(stamps) <= -CLOCK_JUMP)
    return [(int(stamps[i]), int(stamps[i + 1])) for i in back]


class Pairing:
    """Computes observations from readings and exposures, like the observer.

    Parameters
    ----------
    log : BagReader
    prefix : str
        Prefix of its topics.
    check : object
        An object with ``compare(kind, logged, computed, where)`` and the list ``unchecked``.
    """

    def __init__(self, log, prefix, check):
        self._log, self._prefix, self._check = log, prefix, check
        self._tracks = None  # stamp -> request that began then, read when first needed
        self._readings = {encoder: deque(maxlen=READINGS) for encoder in RAW.values()}
        self.frames = {}
        self._waiting = deque()
        self.offsets = {}

    def reading(self, encoder, message):
        """Keep a reading; it is decoded only if an observation needs it."""
        stamp = _stamp_in(message)
        readings = self._readings[encoder]
        if stamp is None or (readings and 0 <= readings[-1][0] - stamp < CLOCK_JUMP):
            return  # refused by the observer, too: two encoders on one topic
        readings.append((stamp, message))
        if self._waiting:
            self._go_on()

    def observation(self, stamp, run):
        """Compare as soon as readings on both sides are available."""
        self._waiting.append((stamp, run))
        self._go_on()

    def _go_on(self, end=False):
        while self._waiting:
            stamp, run = self._waiting[0]
            readings = [r for encoder, r in self._readings.items() if f'az_{encoder}' in run]
            newest = [r[-1][0] if r else 0 for r in readings]
            ready = (stamp + _late(run) in self.frames
                     and min(newest) > stamp and min(newest) >= stamp + _half(run))
            # nodes receive messages in another order than the log: on a busy machine those of one
            # node come in a burst, minutes of a simulated night at once
            full = any(len(r) == READINGS for r in readings)
            if not (ready or end or (full and max(newest) >= stamp + PATIENCE)):
                return
            self._waiting.popleft()
            self._compare(stamp, run)

    def finish(self, observations):
        """Compare the waiting observations, and the offsets of all `observations`."""
        self._go_on(end=True)
        for stamp, run in observations.items():
            if stamp in self.offsets:
                x, y = run.offsets()
                self._check.compare('offset', self.offsets[stamp], [x[0], y[0]], at_time(stamp))

    def _compare(self, stamp, run):
        miss, half = self.frames.get(stamp + _late(run)), _half(run)
        track = self._track(stamp - half) if half else None
        found = {}
        beyond = not run.mount.vertical and bool(is_beyond(run['el'][0]))
        for encoder, readings in self._readings.items():
            angles = self._around(readings, stamp, half)
            if miss is None or angles is None or (half and track is None):
                continue
            stamps, readings = angles
            angles = stamps, [run.mount.on_travel(*reading) for reading in readings]
            angle, rate = interpolate(*angles, stamp, RATE_OVER)
            if half:
                angle = mean_over(*angles, track, stamp, half)
            if encoder == 'enc':
                read, found[encoder] = angle, np.array(centred(*angle, *miss, beyond))
                # older logs have the rate between two readings, not over a second
                rates = rate, interpolate(*angles, stamp)[1]
            elif 'enc' in found:
                found[encoder] = centred_second(angle, read, miss, beyond)
        if 'enc' not in found:
            self._check.unchecked.append(
                f'observation of {at_time(stamp)}: its exposure, its '
                f'{"track " if half else ""}or its readings are not in the log')
            return
        for encoder, angle in found.items():
            if f'az_{encoder}' in run:
                logged = [run[f'{axis}_{encoder}'][0] for axis in ('az', 'el')]
                self._check.compare(f'{encoder} of observation', logged, angle, at_time(stamp))
        if 'az_rate' in run:
            logged = [run['az_rate'][0], run['el_rate'][0]]
            rate = rates[1] if np.array_equal(logged, rates[1]) else rates[0]
            self._check.compare('rate of observation', logged, rate, at_time(stamp))

    def _track(self, begin):
        """The track of an exposure that began at `begin` (ns), or None."""
        if self._tracks is None:
            found = {}  # requests are repeated; one without points is a withdrawal
            for message in self._log.messages(self._prefix + 'request'):
                stamp = _stamp_in(message)
                if stamp is None or stamp in found:
                    continue
                data = self._log.decode(message)
                if data is not None and data.points:
                    found[stamp] = read_trajectory(data)
            self._tracks = sorted(found.items())
        place = bisect_right(self._tracks, begin, key=lambda pair: pair[0])
        if not place:
            return None
        return Track(*self._tracks[place - 1][1])

    def _around(self, readings, stamp, half):
        """Stamps and angles of the readings around an exposure, or None.

        From a second before its middle, or from before its begin, to the first one after its end.
        """
        def number(of):
            return bisect_left(readings, of, key=lambda reading: reading[0])

        first, last = number(min(stamp - RATE_OVER, stamp - half)) - 1, number(stamp + half)
        if last == len(readings) or not readings[0][0] < stamp:
            return None
        around = list(islice(readings, max(first, 0), last + 1))
        decoded = [self._log.decode(message) for _, message in around]
        if None in decoded:
            return None
        return [when for when, _ in around], [read_joints(data)[1] for data in decoded]


def _stamp_in(message):
    """Header stamp of an undecoded message, ns; None if it is too short."""
    order = '<' if message.data[1:2] == b'\1' else '>'
    if len(message.data) < 12:
        return None
    sec, nanosec = struct.unpack_from(f'{order}iI', message.data, 4)
    return sec * 1_000_000_000 + nanosec


def _half(run):
    """Half the exposure of a row, ns; 0 if only mid-exposure was checked."""
    return half_of(float(run['exposure'][0])) if 'exposure' in run else 0


def _late(run):
    """Correction that was subtracted from the camera's stamp, ns."""
    return round(1e9 * float(run['camera_late'][0])) if 'camera_late' in run else 0
