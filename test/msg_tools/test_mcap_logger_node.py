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

import functools
import resource
import signal
import subprocess
import sys

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from msg_tools import convert, topics
from msg_tools.bag import BagReader
from msg_tools.mcap_logger_node import McapLogger

START = 1_768_482_000_000_000_000
JOINTS = '/mount/incremental/joint_states'
#: under which a file of a bag may not grow in the test of a full disk
DISK = 8_000_000


@functools.cache
def joints(i):
    """Bytes on the wire: the padding between fields is whatever the sender left there."""
    return serialize_message(
        convert.joint_state(START + i * 1000, [0.1 * i, -0.2 * i], frame='x' * (i % 5)))


def text(data):
    return serialize_message(String(data=data))


def of(bag, topic):
    return [message for message in bag.messages() if message.topic == topic]


def sent_and_logged(graph, logger, pubs, messages):
    """Publish (publisher index, bytes) and wait until the logger has written them all."""
    graph.connect()
    # diagnostics are logged too
    before = dict(received(logger))
    for i, message in messages:
        pubs[i].publish(message)
    graph.wait_for(lambda: sum(received(logger).values()) - sum(before.values()) == len(messages),
                   'all messages')


def received(logger):
    return {key: int(value) for key, value in logger.endpoints() if key.startswith('received')}


def test_every_byte_and_the_truth_apart(graph, tmp_path):
    folder = tmp_path / 'log'
    logger = graph.add(McapLogger, folder=str(folder))
    chosen = (topics.INCREMENTAL, topics.TRUTH_JOINTS, topics.MODEL)
    pubs = [graph.publisher(topic) for topic in chosen]
    # a text beyond ASCII, and one of no length
    texts = [text(data) for data in ('', 'é″' * 1000, '{"a": 1}')]
    messages = [(0, joints(i)) for i in range(50)] + [(1, joints(i)) for i in range(50, 80)]
    sent_and_logged(graph, logger, pubs, messages)
    for number, data in enumerate(texts):
        pubs[2].publish(data)
        graph.wait_for(lambda n=number: received(logger)['received /mount/model'] == n + 1)
    names = {logger.resolve_topic_name(topic.name): topic for topic in topics.ALL}
    graph.remove(logger)
    logger.finish()

    bag, truth = BagReader(folder), BagReader(tmp_path / 'log_truth')
    assert bag.complete and truth.complete and bag.problems == truth.problems == []
    assert [m.data for m in of(bag, JOINTS)] == [data for i, data in messages if i == 0]
    assert [m.data for m in of(bag, '/mount/model')] == texts
    assert not bag.has_truth and truth.has_truth
    assert {t.name for t in truth.topics} == {
        '/mount/truth/joint_states', '/mount/truth/incremental_zero', '/mount/truth/scenario'}
    assert [m.data for m in truth.messages()] == [
        data for i, data in messages if i == 1]
    stored = {t.name: t for t in bag.topics}
    assert stored[JOINTS].type == 'sensor_msgs/msg/JointState'
    assert stored['/mount/model'].qos[0]['durability'] == 'transient_local'
    # all of the graph but the frames, whether something came or not
    assert set(stored) == {
        name for name, topic in names.items()
        if not topic.name.startswith('truth/') and topic is not topics.ABSOLUTE_FRAME}


def test_log_time_is_simulated_time_and_nothing_is_lost_before_it(graph, tmp_path):
    logger = graph.add(McapLogger, folder=str(tmp_path / 'log'), use_sim_time=True)
    pubs = [graph.publisher(topics.INCREMENTAL), graph.publisher(topics.CLOCK)]
    sent_and_logged(graph, logger, pubs, [(0, joints(i)) for i in range(20)])
    first, second = START, START + 5_000_000_000
    for n, now in enumerate((first, second)):
        pubs[1].publish(Clock(clock=convert.to_stamp(now)))
        graph.wait_for(lambda now=now: logger.get_clock().now().nanoseconds == now)
        pubs[0].publish(joints(20 + n))
        graph.wait_for(lambda n=n: received(logger)[f'received {JOINTS}'] == 21 + n)
    graph.remove(logger)
    logger.finish()
    rows = of(BagReader(tmp_path / 'log'), JOINTS)
    assert [m.data for m in rows] == [joints(i) for i in range(22)]
    assert [m.log_time for m in rows] == [first] * 21 + [second]


def test_nothing_is_lost_when_no_clock_ever_came(graph, tmp_path):
    logger = graph.add(McapLogger, folder=str(tmp_path / 'log'), use_sim_time=True)
    pubs = [graph.publisher(topics.INCREMENTAL)]
    sent_and_logged(graph, logger, pubs, [(0, joints(i)) for i in range(20)])
    graph.remove(logger)
    logger.finish()
    rows = of(BagReader(tmp_path / 'log'), JOINTS)
    assert [m.data for m in rows] == [joints(i) for i in range(20)]


def test_chosen_topics_only(graph, tmp_path):
    logger = graph.add(McapLogger, folder=str(tmp_path / 'log'), compression='none',
                       topics=['offset', 'absolute/frame'])
    assert set(received(logger)) == {'received /mount/offset', 'received /mount/absolute/frame'}
    logger.finish()
    assert {t.name for t in BagReader(tmp_path / 'log').topics} == {
        '/mount/offset', '/mount/absolute/frame'}
    assert not (tmp_path / 'log_truth').exists()


@pytest.mark.parametrize('overrides, text', [
    ({'topics': ['ofset']}, 'ofset is not a topic of the graph; it has /clock, request'),
    ({'compression': 'gzip'}, 'use one of zstd, lz4, none'),
    ({'flush_period_s': 0.0}, 'must be 0.05 to 60.0'),
])
def test_bad_parameters_are_refused(graph, tmp_path, overrides, text):
    with pytest.raises(ValueError, match=text):
        graph.add(McapLogger, folder=str(tmp_path / 'log'), **overrides)
    assert not (tmp_path / 'log').exists()


def test_a_folder_in_use_is_refused_in_one_line(graph, tmp_path):
    (tmp_path / 'file').write_text('x')
    for folder, text in ((tmp_path, 'is not empty'), (tmp_path / 'file', 'is a file')):
        with pytest.raises((ValueError, OSError), match=text):
            graph.add(McapLogger, folder=str(folder))
    done = subprocess.run(
        [sys.executable, '-m', 'msg_tools.node_process', 'msg_tools.mcap_logger_node', '--ros-args',
         '-p', f'folder:={tmp_path / "file" / "log"}'], capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert done.stderr.startswith('error: ') and 'Not a directory' in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert (tmp_path / 'file').read_text() == 'x'


@pytest.mark.parametrize('names', [
    ['SIGINT'], ['SIGTERM'], ['SIGHUP'], ['SIGTERM', 'SIGTERM'], ['SIGINT', 'SIGTERM']])
def test_files_are_finished_on_a_signal(graph, process, tmp_path, names):
    folder = tmp_path / 'log'
    child = process('mcap_logger', folder=str(folder), flush_period_s=60.0)
    pub = graph.publisher(topics.INCREMENTAL)
    graph.connect()
    graph.report('mcap_logger', '', f'subscribes {JOINTS}', 1)
    for i in range(100):
        pub.publish(joints(i))
    graph.report('mcap_logger', '', f'received {JOINTS}', 100)
    for name in names:
        child.send_signal(getattr(signal, name))
    assert child.communicate(timeout=60)[1] == ''
    assert child.returncode == 0
    bag = BagReader(folder)
    assert bag.complete and bag.problems == []
    assert [m.data for m in of(bag, JOINTS)] == [joints(i) for i in range(100)]
    assert (folder / 'metadata.yaml').is_file()
    assert BagReader(tmp_path / 'log_truth').complete


def test_a_killed_logger_leaves_what_it_had_flushed(graph, process, tmp_path):
    folder = tmp_path / 'log'
    child = process('mcap_logger', folder=str(folder), flush_period_s=0.1)
    pub = graph.publisher(topics.INCREMENTAL)
    graph.connect()
    graph.report('mcap_logger', '', f'subscribes {JOINTS}', 1)
    for i in range(100):
        pub.publish(joints(i))

    def safe():
        return sum(t.count for t in BagReader(folder).topics if t.name == JOINTS) == 100
    graph.wait_for(safe, 'the flush')
    child.kill()
    child.wait(60)
    bag = BagReader(folder)
    assert not bag.complete
    assert [m.data for m in of(bag, JOINTS)] == [joints(i) for i in range(100)]


def _small_disk():
    resource.setrlimit(resource.RLIMIT_FSIZE, (DISK, DISK))


def test_a_full_disk_is_an_error_and_the_node_lives_on(graph, process, tmp_path):
    folder = tmp_path / 'log'
    child = process('mcap_logger', preexec_fn=_small_disk, folder=str(folder),
                    compression='none', flush_period_s=0.1, topics=['model'])
    pub = graph.publisher(topics.MODEL)
    graph.connect()
    graph.report('mcap_logger', '', 'subscribes /mount/model', 1)
    size = 1_000_000
    for n in range(12):
        pub.publish(text(str(n % 10) * size))
        graph.report('mcap_logger', '', 'received /mount/model', n + 1)
    status = graph.report('mcap_logger', 'recording stopped')
    assert status.level == DiagnosticStatus.ERROR
    assert child.poll() is None
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 1
    assert err.splitlines()[-1].startswith('error: log: recording stopped: File too large'), err
    rows = of(BagReader(folder), '/mount/model')
    assert 2 <= len(rows) < 12
    assert [m.data for m in rows] == [
        text(str(n) * size) for n in range(len(rows))]
