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

import subprocess
import sys

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from rclpy.qos import DurabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from msg_tools import convert, topics
from msg_tools.bag import BagWriter
from msg_tools.mcap_replay_node import BATCH, McapReplay
from msg_tools.node import MountNode

START = 1_768_482_000_000_000_000
STEP = 1_000_000
ROWS = 2 * BATCH + 17
INCREMENTAL, ABSOLUTE = '/mount/incremental/joint_states', '/mount/absolute/joint_states'


@pytest.fixture(scope='module')
def log(tmp_path_factory):
    """Readings of two encoders, a model, and clocks; (folder, messages in order)."""
    folder = tmp_path_factory.mktemp('replay') / 'log'
    rows = []
    with BagWriter(folder) as bag:
        for topic in (topics.INCREMENTAL, topics.ABSOLUTE, topics.MODEL, topics.CLOCK,
                      topics.ZERO, topics.DIAGNOSTICS, topics.COMMAND):
            bag.add_topic(topic.name if topic.name[0] == '/' else f'/mount/{topic.name}',
                          topic.type, [topic.qos])
        for i in range(ROWS):
            name = ABSOLUTE if i % 3 == 1 else INCREMENTAL
            rows.append((name, serialize_message(convert.joint_state(i, [i, -i])),
                         START + i * STEP))
        rows[10] = ('/clock', serialize_message(Clock(clock=convert.to_stamp(7))), rows[10][2])
        rows[11] = ('/mount/model', serialize_message(String(data='old')), rows[11][2])
        rows[12] = ('/mount/zero', serialize_message(convert.joint_state(1, [0, 0])), rows[12][2])
        for name, data, when in rows:
            bag.write(name, data, when, when)
    return folder, rows


def test_the_same_bytes_in_the_same_order(graph, log):
    folder, rows = log
    node = graph.add(McapReplay, bag=str(folder), rate=0.0, exit_at_end=False,
                     wait_for_topics=[INCREMENTAL, ABSOLUTE])
    got = {INCREMENTAL: graph.listen(topics.INCREMENTAL, raw=True),
           ABSOLUTE: graph.listen(topics.ABSOLUTE, raw=True)}
    clock = graph.listen(topics.CLOCK, depth=5000)
    expected = {name: [data for n, data, _ in rows if n == name] for name in got}
    graph.report('mcap_replay', '', 'state', 'done')
    graph.wait_for(lambda: all(len(got[n]) >= len(expected[n]) for n in got))
    assert got == expected
    # the clock shows the order over all topics; a short queue may skip, and 7 ns was recorded
    sent = [when for name, _, when in rows if name in got]
    graph.wait_for(lambda: clock and convert.from_stamp(clock[-1].clock) == sent[-1])
    times = [convert.from_stamp(message.clock) for message in clock]
    assert times == sorted(times) and set(times) <= set(sent)
    assert node.details()[1] == ('messages published', str(len(sent)))


def test_what_is_computed_or_moves_a_mount_is_left_out_unless_asked_for(graph, log, tmp_path):
    folder, rows = log
    node = graph.add(McapReplay, bag=str(folder), wait_for_topics=['/mount/never'])
    assert list(node._replayed) == [INCREMENTAL, ABSOLUTE]
    # not beside its own, and not the recorded one under the same name
    assert graph.tester.count_publishers('/clock') == 1
    assert graph.tester.count_publishers('/mount/zero') == 0
    graph.remove(node)
    # of all that the graph has, and of a log that was recorded in another namespace
    for prefix in ('/mount/', '/dome/', '/'):
        with BagWriter(tmp_path / prefix.strip('/') / 'log') as bag:
            for topic in vars(topics).values():
                if isinstance(topic, topics.Topic):
                    bag.add_topic(topic.name if topic.name[0] == '/' else prefix + topic.name,
                                  topic.type, [topic.qos])
        node = graph.add(McapReplay, bag=str(bag.folder), wait_for_topics=['/mount/never'])
        left = {prefix + topic.name for topic in topics.ALL if topic not in topics.NOT_REPLAYED}
        assert set(node._replayed) == left and f'{prefix}observation' in left
        graph.remove(node)
    graph.add(McapReplay, bag=str(folder), rate=0.0, exit_at_end=False,
              topics=['/mount/model'])
    # latched as it was recorded: a late subscriber has it
    graph.report('mcap_replay', '', 'state', 'done')
    model = graph.listen(topics.MODEL, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    graph.wait_for(lambda: model)
    assert model[0].data == 'old'


def test_a_log_without_qos_is_offered_as_the_graph_has_it(graph, tmp_path):
    """As rosbags writes it; who asks for more of a topic of another holds nothing up."""
    other = topics.Topic('other', 'std_msgs/msg/String', topics.LATCHED)
    names = '/mount/model', '/mount/other'
    with BagWriter(tmp_path / 'log') as bag:
        for name in names:
            bag.add_topic(name, other.type)
        for i in range(2 * BATCH + 2):
            bag.write(names[i % 2], serialize_message(String(data=str(i))), START + i, START + i)

    class Hears(MountNode):
        def __init__(self, **kwargs):
            super().__init__('hears', **kwargs)
            self.subscribe(other, print)
    graph.add(Hears)
    model = graph.listen(topics.MODEL)
    graph.add(McapReplay, bag=str(tmp_path / 'log'), rate=0.0, exit_at_end=False,
              topics=list(names))
    graph.report('mcap_replay', '', 'state', 'done')
    graph.wait_for(lambda: model and model[-1].data == str(2 * BATCH))


def test_it_waits_for_subscribers(graph, log):
    graph.add(McapReplay, bag=str(log[0]), rate=0.0, exit_at_end=False,
              wait_for_topics=[INCREMENTAL])
    graph.report('mcap_replay', f'waiting for a subscriber of {INCREMENTAL}', 'state', 'waiting')
    got = graph.listen(topics.INCREMENTAL)
    graph.wait_for(lambda: len(got) == sum(name == INCREMENTAL for name, _, _ in log[1]))


def test_recorded_pace_keeps_order_and_count(graph, log):
    folder, rows = log
    graph.add(McapReplay, bag=str(folder), rate=10.0, exit_at_end=False,
              wait_for_topics=[INCREMENTAL])
    got = graph.listen(topics.INCREMENTAL, raw=True)
    graph.report('mcap_replay', '', 'state', 'done')
    expected = [data for name, data, _ in rows if name == INCREMENTAL]
    graph.wait_for(lambda: len(got) >= len(expected))
    assert got == expected


@pytest.mark.parametrize('overrides, text', [
    ({}, 'parameter bag is empty'),
    ({'bag': 'absent'}, 'absent does not exist'),
    ({'bag': 'log', 'topics': ['/mount/ofset']}, '/mount/ofset is not in .*; it has /mount/incr'),
    ({'bag': 'log', 'rate': -1.0}, 'must be 0.0 to 1000.0'),
])
def test_bad_input_is_refused(graph, log, overrides, text):
    if overrides.get('bag') == 'log':
        overrides = {**overrides, 'bag': str(log[0])}
    with pytest.raises(ValueError, match=text):
        graph.add(McapReplay, **overrides)


def test_a_process_ends_with_the_log_and_a_missing_log_is_one_line(graph, process, log, tmp_path):
    child = process('mcap_replay', bag=str(log[0]), rate=0.0,
                    wait_for_topics=[INCREMENTAL])
    got = graph.listen(topics.INCREMENTAL)
    expected = sum(name == INCREMENTAL for name, _, _ in log[1])
    graph.wait_for(lambda: len(got) == expected)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 0, err
    assert 'Traceback' not in err
    done = subprocess.run(
        [sys.executable, '-m', 'msg_tools.node_process', 'msg_tools.mcap_replay_node', '--ros-args',
         '-p', f'bag:={tmp_path}/absent'], capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert done.stderr == (
        f'error: {tmp_path}/absent does not exist; give the folder of a log, or of its night\n')
