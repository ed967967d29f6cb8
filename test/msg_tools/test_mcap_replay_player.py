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

"""The player: where it begins and ends, its services, and nothing lost when it is fast."""

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import Int32, String

from msg_tools import convert, topics
from msg_tools.bag import BagWriter
from msg_tools.mcap_replay_node import McapReplay
from msg_tools.node import MountNode
from msg_tools.topics import Topic

START = 1_768_482_000_000_000_000
NUMBERS = Topic('/lab/numbers', 'std_msgs/msg/Int32', QoSProfile(depth=2000))
STATE = Topic('/lab/state', 'std_msgs/msg/String', QoSProfile(
    depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))


@pytest.fixture(scope='module')
def log(tmp_path_factory):
    """100 numbers, 10 ms apart; a latched state at 0.005 s and at 0.505 s."""
    folder = tmp_path_factory.mktemp('player') / 'log'
    with BagWriter(folder) as bag:
        for topic in (NUMBERS, STATE):
            bag.add_topic(topic.name, topic.type, [topic.qos])
        for i in range(100):
            when = START + i * 10_000_000
            bag.write('/lab/numbers', serialize_message(Int32(data=i)), when, when)
            if i in (0, 50):
                bag.write('/lab/state', serialize_message(String(data=f'from {i}')),
                          when + 5_000_000, when)
    return folder


@pytest.fixture
def play(graph, log):
    """``play(**parameters)``: the node, and lists that fill with numbers and states."""
    def start(**parameters):
        name = parameters.pop('listen', '/lab/numbers')
        numbers = graph.listen(Topic(name, NUMBERS.type, NUMBERS.qos))
        states = graph.listen(STATE, depth=10)
        parameters = {'bag': str(log), 'rate': 0.0, 'exit_at_end': False,
                      'wait_for_topics': ['/lab/numbers']} | parameters
        return graph.add(McapReplay, **parameters), numbers, states
    return start


def values(messages):
    return [message.data for message in messages]


def call(graph, name):
    answer = graph.call(f'/mount/mcap_replay/{name}')
    return answer.success, answer.message


def test_offset_and_duration_with_what_was_latched_before(graph, play):
    node, numbers, states = play(start_offset_s=0.3, duration_s=0.25)
    graph.report('mcap_replay', '', 'state', 'done')
    graph.wait_for(lambda: len(numbers) == 25 and len(states) == 2)
    assert values(numbers) == list(range(30, 55))
    # the state in force at the beginning comes first
    assert values(states) == ['from 0', 'from 50']
    assert node._sent == 27


def test_remap_and_exclude(graph, play):
    node, numbers, states = play(
        remaps=['/lab/numbers:=/other/name'], listen='/other/name', exclude=['/lab/st.*'])
    graph.wait_for(lambda: len(numbers) == 100)
    assert list(node._replayed) == ['/lab/numbers'] and states == []


def test_loop(graph, play):
    node, numbers, _ = play(loop=True)
    graph.wait_for(lambda: len(numbers) >= 250, 'the third time')
    assert graph.set_parameter(node, loop=False)[0]
    graph.report('mcap_replay', '', 'state', 'done')
    graph.wait_for(lambda: len(numbers) == 100 * (node._loops + 1))
    assert values(numbers) == list(range(100)) * (node._loops + 1)


def test_step_by_step(graph, play):
    node, numbers, _ = play(start_paused=True, topics=['/lab/numbers'], burst_count=7, rate=1.0)
    graph.wait_for(lambda: node._state == 'playing')
    assert call(graph, 'is_paused') == (True, 'paused')
    assert call(graph, 'play_next') == (True, '1 messages published')
    assert call(graph, 'burst') == (True, '7 messages published')
    graph.wait_for(lambda: len(numbers) == 8)
    assert node._position == START + 70_000_000
    assert graph.set_parameter(node, seek_s=0.95)[0]
    assert call(graph, 'burst') == (True, '5 messages published; the log ends here')
    graph.wait_for(lambda: len(numbers) == 13)
    assert values(numbers) == [*range(8), *range(95, 100)]
    assert call(graph, 'play_next') == (False, '0 messages published; the log ends here')
    assert call(graph, 'toggle_paused') == (True, 'playing')
    graph.report('mcap_replay', '', 'state', 'done')
    assert call(graph, 'play_next')[0] is False
    # from the place that the parameter names, once more
    assert call(graph, 'seek')[0]
    graph.wait_for(lambda: len(numbers) == 18)


def test_pause_holds_the_clock_and_a_new_rate_counts(graph, play):
    node, numbers, _ = play(rate=0.001)
    graph.wait_for(lambda: len(numbers) == 1)
    assert call(graph, 'get_rate') == (True, '0.001')
    assert call(graph, 'pause') == (True, 'paused')
    assert graph.set_parameter(node, rate=1000.0)[0]
    graph.report('mcap_replay', '', 'paused', True)
    assert len(numbers) == 1
    assert call(graph, 'resume')[0]
    graph.wait_for(lambda: len(numbers) == 100)
    assert values(numbers) == list(range(100))


def test_stop(graph, play):
    _, numbers, _ = play(rate=0.001)
    graph.wait_for(lambda: numbers)
    assert call(graph, 'stop') == (True, 'stopped after 1 messages')
    graph.report('mcap_replay', '', 'state', 'done')
    assert call(graph, 'stop')[0] is False


def test_clock_between_messages(graph, play):
    clock = graph.listen(topics.CLOCK, depth=5000)
    play(rate=1.0, clock_hz=200.0)
    # the last message is at 990 ms; what says that it is done may overtake the clock's last words
    graph.wait_for(lambda: clock and convert.from_stamp(clock[-1].clock) - START > 980_000_000,
                   'the clock to come to its end')
    graph.report('mcap_replay', '', 'state', 'done')
    times = [convert.from_stamp(message.clock) - START for message in clock]
    assert times == sorted(times)
    # not of the messages alone
    assert sum(ns % 5_000_000 != 0 for ns in times) > 20


class Slow(MountNode):
    """Takes what comes on a topic with a queue of 100."""

    def __init__(self, **kwargs):
        super().__init__('slow', **kwargs)
        self.got = []
        self.subscribe(topics.OFFSET, lambda message: self.got.append(message.vector.x))


def test_as_fast_as_possible_loses_nothing_in_a_short_queue(graph, tmp_path):
    with BagWriter(tmp_path / 'log') as bag:
        bag.add_topic('/mount/offset', topics.OFFSET.type, [topics.OFFSET.qos])
        for i in range(700):
            bag.write('/mount/offset', serialize_message(convert.vector(i, i, 0)), i, i)
    slow = graph.add(Slow)
    graph.add(McapReplay, bag=str(tmp_path / 'log'), rate=0.0, exit_at_end=False,
              wait_for_topics=['/mount/offset'])
    graph.report('mcap_replay', '', 'state', 'done')
    graph.wait_for(lambda: len(slow.got) >= 700, lambda: f'{len(slow.got)} of 700')
    assert slow.got == list(range(700))


@pytest.mark.parametrize('storage', ['MCAP', 'SQLITE3'])
def test_bags_of_other_writers(graph, tmp_path, storage):
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    typesys = pytest.importorskip('rosbags.typesys')
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    with rosbag2.Writer(tmp_path / 'bag', version=9,
                        storage_plugin=rosbag2.StoragePlugin[storage]) as writer:
        connection = writer.add_connection('/lab/numbers', 'std_msgs/msg/Int32', typestore=store)
        for i in range(20):
            writer.write(connection, START + i, serialize_message(Int32(data=i)))
    numbers = graph.listen(NUMBERS)
    graph.add(McapReplay, bag=str(tmp_path / 'bag'), rate=0.0, exit_at_end=False,
              wait_for_topics=['/lab/numbers'])
    graph.wait_for(lambda: len(numbers) == 20)
    assert values(numbers) == list(range(20))


@pytest.mark.parametrize('overrides, words', [
    ({'remaps': ['/lab/numbers=/x']}, 'write /old/name:=/new/name'),
    ({'remaps': ['/lab/numbers:=x y']}, 'write /old/name:=/new/name'),
    ({'exclude': ['(']}, 'no regular expression'),
    ({'start_offset_s': -1.0}, 'must be 0.0 to'),
])
def test_bad_parameters(graph, log, overrides, words):
    with pytest.raises(ValueError, match=words):
        graph.add(McapReplay, bag=str(log), **overrides)


def test_types_that_are_not_installed(graph, tmp_path):
    with BagWriter(tmp_path / 'log') as bag:
        bag.add_foreign_topic('/odd', 'absent_msgs/msg/X', [], b'int32 data\n', '')
        bag.write('/odd', b'\0\1\0\0\1\0\0\0', 1, 1)
    node = graph.add(McapReplay, bag=str(tmp_path / 'log'))
    assert list(node._replayed) == []
    with pytest.raises(ValueError, match='absent_msgs/msg/X is not installed'):
        graph.add(McapReplay, bag=str(tmp_path / 'log'), topics=['/odd'])
