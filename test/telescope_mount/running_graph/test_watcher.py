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

import os
import signal

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from telescope_mount.processes.interrupt import noted
from telescope_mount.running_graph.watcher import Watcher


@pytest.fixture(autouse=True)
def listens():
    """A suite in the background of a script ignores Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@pytest.fixture
def watcher(ros_domain):
    with noted():
        watcher = Watcher('watcher', ros_domain, {}, lambda: None)
        yield watcher
        watcher.close()


def test_ctrl_c_waits_for_the_end_of_a_message_and_so_does_the_next(watcher):
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        ended = []

        def answer(ended=ended, number=number):
            os.kill(os.getpid(), number)
            ended.append(True)
        timer = watcher.node.create_timer(0.01, answer)
        with pytest.raises(KeyboardInterrupt) as end:
            watcher.spin_until(lambda: False, 30.0)
        assert ended == [True] and end.value.args == (number,)
        timer.cancel()
    watcher.spin(0.01)  # each is told once


def test_the_environment_of_its_graph_is_not_left_behind(ros_domain):
    before = dict(os.environ)
    one = Watcher('watcher', ros_domain, {'ROS_DOMAIN_ID': '77', 'FASTDDS_STATISTICS': ''},
                  lambda: None)
    one.close()
    assert dict(os.environ) == before


def test_a_log_is_whole_when_it_knows_the_parameters_of_all_nodes(watcher):
    from types import SimpleNamespace

    from msg_tools.readiness import parse
    logger, looks = '/mount/mcap_logger', []

    def report():
        """As its diagnostics come: for some time the answers of two nodes are missing."""
        looks.append(watcher.reports.get(logger))
        watcher.reports[logger] = parse(SimpleNamespace(level=b'\0', values=[
            SimpleNamespace(key='awaited', value=str(max(5 - len(looks), 0)))]))
    timer = watcher.node.create_timer(0.01, report)
    assert watcher.wait_for_log([logger], 30.0) == {}
    timer.cancel()
    assert looks[-1]['awaited'] == 1 and watcher.reports[logger]['awaited'] == 0


def test_results_are_heard_when_they_are_asked_for(watcher):
    from msg_tools import topics
    topic = topics.MODEL
    pub = watcher.node.create_publisher(topic.message, topic.name, topic.qos)
    pub.publish(topic.message(data='first'))
    pub.publish(topic.message(data='second'))
    assert watcher.node.count_subscribers(pub.topic_name) == 0
    watcher.keep_results()
    assert watcher.spin_until(lambda: topic.name in watcher.latest, 30.0)
    assert watcher.latest[topic.name].data == 'second'
