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

"""Services of the graph whose answer was lost: the question comes once more, before the answer."""

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from std_srvs.srv import Trigger

from encoder_sim.absolute_encoder_node import AbsoluteEncoders
from encoder_sim.incremental_encoder_node import IncrementalEncoders
from encoder_sim.mount_simulator_node import MountSimulator
from msg_tools import topics
from msg_tools.mcap_logger_node import McapLogger
from msg_tools.node import MountNode


def twice(graph, name, count=2):
    """What a question and the same once more, sent before the first is answered, are told."""
    client = graph.tester.create_client(Trigger, name)
    graph.wait_for(client.service_is_ready, f'service {name}')
    futures = [client.call_async(Trigger.Request()) for _ in range(count)]
    graph.wait_for(lambda: all(future.done() for future in futures), f'{name} to answer')
    return [(future.result().success, future.result().message) for future in futures]


class Worker(MountNode):
    """Counts what it does."""

    def __init__(self, **kwargs):
        super().__init__('worker', (), **kwargs)
        self.done = 0
        self.serve('once', self._work, once=True)
        self.serve('stop', self._work)

    def _work(self):
        self.done += 1
        return True, f'done {self.done} times'


def test_it_is_done_once_and_a_later_question_is_another_one(graph):
    worker = graph.add(Worker)
    assert twice(graph, 'once', 5) == [(True, 'done 1 times')] * 5
    assert graph.call('once').message == 'done 2 times' and worker.done == 2


def test_what_stops_something_is_done_each_time(graph):
    graph.add(Worker)
    assert twice(graph, 'stop') == [(True, 'done 1 times'), (True, 'done 2 times')]


@pytest.mark.parametrize('live', [0.0, 20.0])
def test_home_joins_the_homing_that_is_under_way(graph, live):
    graph.add(MountSimulator, scenario='ideal', time_scale=live)
    graph.add(IncrementalEncoders, scenario='ideal')
    homing, truth = graph.listen(topics.HOMING), graph.listen(topics.TRUTH_JOINTS)
    graph.connect()
    done = True, 'both axes have met their reference marks'
    assert twice(graph, 'home') == [done, done]
    if not live:
        graph.wait_for(lambda: len(truth) >= 6)
        assert len(truth) == 6  # one passage: five samples and the one at rest
    assert graph.call('home').success
    graph.wait_for(lambda: homing[-1].width, 'the marks')


@pytest.mark.parametrize('make, name, text', [
    (IncrementalEncoders, 'power_cycle', 'power-on 2; home before measuring'),
    (AbsoluteEncoders, 'absolute/power_cycle', 'absolute encoder: power-on 2')])
def test_the_power_is_cycled_once(graph, make, name, text):
    graph.add(make, scenario='ideal')
    assert twice(graph, name) == [(True, text)] * 2
    assert graph.call(name).message == text.replace('2', '3')


def test_a_log_is_split_once(graph, tmp_path):
    graph.add(McapLogger, folder=str(tmp_path / 'log'))
    first, second = twice(graph, 'mcap_logger/split_bagfile')
    assert first == second and first[0]
    assert len(list((tmp_path / 'log').glob('*.mcap'))) == 2
