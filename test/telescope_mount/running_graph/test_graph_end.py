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

"""The end of a graph that moves a mount, on a guard and encoders of the test."""

from types import SimpleNamespace

import numpy as np
import pytest

from msg_tools.units import DEG
from telescope_mount.graph import night_graph, real_graph
from telescope_mount.nights.whole_night import _at_rest_after
from telescope_mount.running_graph import graph_end as ending
from telescope_mount.running_graph.graph_end import AtRest, come_to_rest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from msg_tools import convert, topics
from telescope_mount.running_graph.graph_client import GraphClient


def stands_at(times, rate, noise=0.0, seed=3):
    """When readings of an axis with a rate (deg/s, by time) are first said to stand; None: never"""
    rng, rest, angle, before = np.random.default_rng(seed), AtRest(), 359.9 * DEG, times[0]
    for at in times:
        angle += rate(at) * DEG * (at - before)
        before = at
        rest.take(at, np.angle(np.exp(1j * (angle + rng.normal(0.0, noise)))) * np.ones(2))
        if rest.at_rest:
            return at
    return None


@pytest.mark.parametrize('hertz, noise, late', [(1000, 5e-6, 0.4), (20, 5e-6, 0.4), (1, 0, 2.01)])
def test_axes_stand_when_their_readings_do(hertz, noise, late):
    times = 1e9 + np.arange(0.0, 8.0, 1.0 / hertz)
    braking = stands_at(times, lambda at: 9.6 * max(0.0, 1.0 - (at - 1e9) / 2.0), noise)
    assert 1e9 + 1.9 <= braking <= 1e9 + 2.0 + late
    assert stands_at(times, lambda at: 0.1, noise) is None
    assert stands_at(times, lambda at: 0.0042, noise) is not None  # with the sky


def test_readings_without_a_number_are_of_a_mount_that_is_led_nowhere():
    rest = AtRest()
    rest.take(1.0, (np.nan, np.nan))
    assert rest.unknown and not rest.at_rest


class Graph:
    """What `come_to_rest` sees of a graph: a guard and the encoders of an axis with a rate."""

    def __init__(self, monkeypatch, state, rate=9.6, answers=True):
        self.time, self.rate, self.called, self.answers = 1000.0, rate, [], answers
        self.latest, self.told, self.angle, self.hear = {}, [], 0.0, None
        self.brakes, self.speaks = True, True
        self.tell(state)
        self.node = SimpleNamespace(create_subscription=self.listen,
                                    destroy_subscription=lambda _: None,
                                    count_publishers=lambda _: int(self.speaks))
        monkeypatch.setattr(ending.time, 'monotonic', lambda: self.time)

    def tell(self, state):
        if state:
            self.latest[topics.GUARD_STATUS.name] = convert.status(b'\0', 'guard', '', state=state)

    def listen(self, message, name, take, qos):
        assert name == topics.INCREMENTAL.name
        self.hear = take
        return SimpleNamespace(topic_name=name)

    def client(self, service):
        def call(_):
            self.called.append(service)
            return SimpleNamespace(done=lambda: self.answers)
        return SimpleNamespace(service_is_ready=lambda: True, call_async=call)

    def spin_until(self, condition, timeout):
        return GraphClient.spin_until(self, condition, timeout)

    def spin(self, seconds):
        self.time += seconds
        if self.called and self.brakes:
            self.rate = max(0.0, self.rate - 12.0 * seconds)
        self.angle += self.rate * DEG * seconds
        if self.hear is not None and self.speaks:
            self.hear(convert.joint_state(round(self.time * 1e9), [self.angle, 0.0], [0.0, 0.0]))

    def end(self, plan='observing'):
        begin = self.time
        come_to_rest(self, plan, self.told.append)
        return self.time - begin


def test_a_slew_is_aborted_and_its_end_waited_for(monkeypatch):
    graph = Graph(monkeypatch, 'following')
    assert 1.0 < graph.end() < 1.4 and graph.called == ['abort'] and graph.rate == 0.0
    assert graph.told == ['waiting for the mount to stop; Ctrl-C ends at once']


def test_a_plan_that_is_done_needs_no_abort(monkeypatch):
    graph = Graph(monkeypatch, 'idle', rate=0.0)
    assert graph.end('done') < 0.5
    assert (graph.called, graph.told) == ([], [])
    asks_soon = Graph(monkeypatch, 'idle', rate=0.0)
    asks_soon.end()
    assert asks_soon.called == ['abort']


def test_a_mount_on_the_way_to_its_park_position_arrives(monkeypatch):
    graph = Graph(monkeypatch, 'parking')
    move = graph.spin

    def spin(seconds):
        move(seconds)
        if graph.time > 1040.0:
            graph.tell('parked')
    graph.spin = spin
    assert 40.0 < graph.end() < 41.0 and graph.called == []
    assert graph.told == [
        'waiting until the mount is parked; Ctrl-C ends at once, and the mount stops', 'parked']


def test_what_the_guard_does_after_it_cancelled_the_plan_may_be_heard_later(monkeypatch):
    graph = Graph(monkeypatch, 'following')
    move = graph.spin

    def spin(seconds):
        move(seconds)
        graph.tell('parked' if graph.time > 1010.0 else 'parking' if graph.time > 1000.2 else '')
    graph.spin = spin
    graph.end('cancelled')
    assert graph.called == [] and graph.told[-1] == 'parked'


def test_what_hinders_the_end_is_said_and_no_wait_is_for_ever(monkeypatch):
    monkeypatch.setattr(ending, 'PARKED', 60.0)
    monkeypatch.setattr(ending, 'STOPPED', 8.0)
    lost = Graph(monkeypatch, 'parking')
    assert 60.0 < lost.end() < 70.0 and lost.called == ['abort']
    assert lost.told[1] == 'not parked after 60 s: the mount is stopped'
    deaf = Graph(monkeypatch, 'following', answers=False)
    deaf.brakes = False
    assert 8.0 < deaf.end() < 13.0
    assert deaf.told[0].startswith('the guard does not answer')
    assert deaf.told[-1].endswith('may still move: moving for 8 s already')
    mute = Graph(monkeypatch, 'following')
    mute.speaks = False
    assert mute.end() < 5.0
    assert mute.told[-1] == 'check the mount, it may still move: no encoder readings'


def test_a_mount_without_drivers_is_not_waited_for(monkeypatch):
    graph = Graph(monkeypatch, 'idle', rate=0.0)
    graph.speaks = False
    assert graph.end() < 0.5
    assert (graph.called, graph.told) == (['abort'], [])


def test_a_guard_that_has_never_spoken_is_not_waited_for(monkeypatch):
    assert Graph(monkeypatch, '').end() == 0.0


@pytest.mark.parametrize('simulated', [True, False])
def test_a_night_that_fails_ends_at_rest_where_the_mount_is_not_simulated(monkeypatch, simulated):
    specs = night_graph(bag='') if simulated else real_graph(bag='')
    graph = Graph(monkeypatch, 'following')
    with pytest.raises(RuntimeError), _at_rest_after(graph, specs, graph.told.append):
        raise RuntimeError('a node has ended')
    assert (graph.called, graph.rate) == (([], 9.6) if simulated else (['abort'], 0.0))


def test_a_second_ctrl_c_ends_it_at_once(monkeypatch):
    graph = Graph(monkeypatch, 'parking')

    def spin(_):
        raise KeyboardInterrupt
    graph.spin = spin
    with pytest.raises(KeyboardInterrupt):
        graph.end()


def test_homing_is_said_to_go_on(monkeypatch):
    graph = Graph(monkeypatch, 'idle')
    graph.angle = float('nan')
    assert graph.end() < 0.5
    assert [text.split(':')[0] for text in graph.told] == ['positions of the axes unknown']
    assert 'a driver that is homing the mount goes on' in graph.told[0]
