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

"""A star observer under test, and instruments that answer it."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rosgraph_msgs.msg import Clock

from msg_tools import convert, topics
from msg_tools.units import ARCSEC
from pointing_model.runs.run_messages import cloud_to_run
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import load_catalogue
from telescope_mount.observing.star_observer_node import StarObserver

START = 1_768_482_000_000_000_000  # 2026-01-15T13:00:00
SECOND = 10**9
#: exposures are made on a knot of the commanded track, where every way to interpolate agrees
EXPOSURE = 20 * SECOND


def place(hip, ns):
    az, el = observed_place(load_catalogue(hip=[hip]), ns * 1e-9, DEFAULT_SITE, DEFAULT_WEATHER)
    return np.array([az[0], el[0]])


class Instruments:
    """Mount, encoders and camera of the test: they answer a command with an exposure.

    Parameters
    ----------
    miss : callable
        ``miss(number, stamp, reading)`` in rad, or None: the camera says nothing.
    guard : bool
        Whether they answer as a guard does, too.
    """

    def __init__(self, graph, miss=lambda number, *_: (1e-6 * ARCSEC * number, 0.0), homed=True,
                 absolute=True, error=(0.0, 0.0), guard=True):
        self.graph, self.miss, self.absolute = graph, miss, absolute
        self.error = np.array(error)
        self.now = START
        self.position = np.array([3.0, 0.8])
        self.commands = []
        self.readings = {}  # stamp of an exposure -> both encoders' reading
        self.pubs = {topic.name: graph.publisher(topic) for topic in (
            topics.INCREMENTAL, topics.ABSOLUTE, topics.MISS_DISTANCE, topics.CLOCK)}
        if guard:
            self.guard = graph.publisher(topics.GUARD_STATUS)
            self.guard.publish(convert.status(DiagnosticStatus.OK, '/mount/mount_guard',
                                              'no request', state='idle'))
        graph.listen(topics.REQUEST, call=self._on_command)
        self.ticks = graph.tester.create_timer(0.05, self._tick)
        self.homed = homed
        self.awake, self.frame = True, ''

    def _tick(self):
        self.pubs[topics.CLOCK.name].publish(Clock(clock=convert.to_stamp(self.now)))
        if self.homed and not self.commands:
            self.now += SECOND // 10
            self.read(self.now, self.position)

    def read(self, stamp, angles):
        self.pubs[topics.INCREMENTAL.name].publish(
            convert.joint_state(stamp, angles + self.error, [0.0, 0.0], frame=self.frame))
        if self.absolute:
            self.pubs[topics.ABSOLUTE.name].publish(convert.joint_state(stamp, angles, [0.0, 0.0]))

    def _on_command(self, message):
        stamp, times, track, _ = convert.read_trajectory(message)
        self.commands.append((stamp, track))
        if not self.awake:
            return
        at = stamp + EXPOSURE

        def demand(ns):
            return np.array([np.interp((ns - stamp) * 1e-9, times, track[:, i]) for i in (0, 1)])
        self.position = demand(at)
        self.readings[at] = self.position + self.error, self.position
        miss = self.miss(len(self.commands), at, self.position + self.error)
        self.read(at - SECOND // 2, demand(at - SECOND // 2))
        if miss is not None:
            self.pubs[topics.MISS_DISTANCE.name].publish(convert.sky_vector(at, *miss))
        self.read(at + SECOND // 2, demand(at + SECOND // 2))
        self.now = at + SECOND

    def stop(self):
        self.graph.tester.destroy_timer(self.ticks)


class Night:
    """A star observer under test and what it publishes."""

    def __init__(self, graph, plan, **overrides):
        self.graph = graph
        self.rows = graph.listen(topics.OBSERVATION)
        self.offsets = graph.listen(topics.OFFSET)
        self.tables = graph.listen(topics.OBSERVATIONS)
        self.status = graph.listen(topics.OBSERVER_STATUS)
        self.node = graph.add(StarObserver, plan=plan, **{
            'use_sim_time': True, 'magnitude_limit': 3.5, 'answer_timeout_s': 60.0,
            'renew_request_s': 0.0, **overrides})

    def value(self, key):
        return {row.key: row.value for row in self.status[-1].values}[key] if self.status else ''

    def until(self, state, text=''):
        """Wait for a state; its text."""
        self.graph.wait_for(
            lambda: self.value('state') == state and text in self.status[-1].message,
            lambda: f'{state} {text}; last: {self.status[-1:]}')
        return self.status[-1].message

    def run(self):
        """All rows of a finished plan."""
        self.until('done')
        self.graph.wait_for(lambda: len(self.rows) == int(self.value('observations')))
        return [cloud_to_run(message) for message in self.rows]
