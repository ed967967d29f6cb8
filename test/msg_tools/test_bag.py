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

"""Logs: written once, read back by every reader there is, and after a crash."""

import shutil

import pytest
import yaml

from msg_tools.bag import BagReader, BagWriter, ros_schema
from msg_tools.bag.writer import plain_name


def test_every_message_comes_back_in_log_time_order(demo, tmp_path):
    demo.write_night(tmp_path / 'night', chunk_size=2000)
    reader = BagReader(tmp_path / 'night')
    rows = list(reader.messages())
    assert len(rows) == reader.message_count == 505
    times = [row.log_time for row in rows]
    assert times == sorted(times)
    pairs = [row for row in rows if row.topic == '/mount/pair']
    assert [row.data for row in pairs] == [demo.pair(i) for i in range(500)]
    assert all(row.log_time - row.publish_time == 77 for row in pairs)
    assert {row.type for row in pairs} == {demo.PAIR}
    assert reader.problems == [] and reader.complete
    assert (reader.start_time, reader.end_time) == (10**18, 10**18 + 499 * 10**6)


def test_topics_tell_type_count_qos_and_hash(demo, tmp_path):
    demo.write_night(tmp_path / 'night')
    topics = {topic.name: topic for topic in BagReader(tmp_path / 'night').topics}
    assert topics['/mount/pair'][:3] == ('/mount/pair', demo.PAIR, 500)
    assert topics['/mount/text'].count == 5
    assert topics['/mount/pair'].type_hash == demo.HASHES[demo.PAIR]
    first, second = topics['/mount/text'].qos
    assert (first['durability'], first['depth']) == ('transient_local', 1)
    assert second['reliability'] == 'best_effort'


def test_filters(demo, tmp_path):
    demo.write_night(tmp_path / 'night', chunk_size=1000)
    reader = BagReader(tmp_path / 'night')
    assert len(list(reader.messages('/mount/text'))) == 5
    assert len(list(reader.messages(['/mount/pair', '/none']))) == 500
    rows = list(reader.messages('/mount/pair', 10**18 + 10 * 10**6, 10**18 + 20 * 10**6))
    assert [row.data for row in rows] == [demo.pair(i) for i in range(10, 20)]


def test_equal_times_keep_the_order_of_the_file(demo, tmp_path):
    with BagWriter(tmp_path / 'b', chunk_size=200) as writer:
        writer.add_topic('/t', demo.TEXT)
        for i in range(100):
            writer.write('/t', demo.text(str(i)), 1000, 1000)
    rows = BagReader(tmp_path / 'b').messages()
    assert [row.data for row in rows] == [demo.text(str(i)) for i in range(100)]


def test_two_iterations_at_once(demo, tmp_path):
    demo.write_night(tmp_path / 'night', chunk_size=1000)
    reader = BagReader(tmp_path / 'night')
    both = list(zip(reader.messages(), reader.messages(), strict=True))
    assert len(both) == 505 and all(a == b for a, b in both)


def test_decode(demo, tmp_path):
    pytest.importorskip('mcap_ros2')
    demo.write_night(tmp_path / 'night')
    row = list(BagReader(tmp_path / 'night').messages('/mount/pair', decode=True))[7]
    assert row.data.first.value == 7.0
    assert row.data.more[0].value == 8.0
    assert row.data.name == 'ab'


def test_message_that_does_not_fit_its_schema_is_counted(demo, tmp_path):
    with BagWriter(tmp_path / 'b') as writer:
        writer.add_topic('/t', demo.PAIR)
        writer.write('/t', demo.pair(0)[:14], 1, 1)
        writer.write('/t', demo.pair(5), 2, 2)
        writer.write('/t', b'', 3, 3)
    reader = BagReader(tmp_path / 'b')
    assert [row.data.first.value for row in reader.messages(decode=True)] == [5.0]
    assert any('does not fit its schema' in p and '(2 times)' in p for p in reader.problems)
    assert len(list(reader.messages())) == 3


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_other_readers_agree(demo, tmp_path, compression):
    mcap_reader = pytest.importorskip('mcap.reader')
    mcap_ros2 = pytest.importorskip('mcap_ros2.decoder')
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    highlevel = pytest.importorskip('rosbags.highlevel')
    folder = tmp_path / 'night'
    file = demo.write_night(folder, chunk_size=3000, compression=compression).file
    ours = [(m.topic, m.log_time, m.data) for m in BagReader(folder).messages()]
    assert len(ours) == 505

    with open(file, 'rb') as stream:
        reader = mcap_reader.make_reader(
            stream, validate_crcs=True, decoder_factories=[mcap_ros2.DecoderFactory()])
        header, summary = reader.get_header(), reader.get_summary()
        assert header.profile == 'ros2' and 'telescope_mount' in header.library
        assert summary.statistics.message_count == 505
        assert all(index.message_index_offsets for index in summary.chunk_indexes)
        assert [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()] == ours
        decoded = [d.decoded_message for d in reader.iter_decoded_messages('/mount/pair')]
        assert [d.first.value for d in decoded] == list(range(500))
        records = {record.name: record.metadata for record in reader.iter_metadata()}
    inner = yaml.safe_load(records['rosbag2']['serialized_metadata'])
    outer = yaml.safe_load((folder / 'metadata.yaml').read_text())
    assert inner == outer['rosbag2_bagfile_information']

    # a directory reader whose two QoS texts differ would give no message here
    for path in (folder, file):
        with rosbag2.Reader(path) as reader:
            theirs = [(c.topic, t, bytes(d)) for c, t, d in reader.messages()]
            assert sorted(theirs) == sorted(ours)
            assert reader.message_count == 505
    for path in (folder, file):
        with highlevel.AnyReader([path]) as reader:
            connections = [c for c in reader.connections if c.topic == '/mount/pair']
            values = [reader.deserialize(d, c.msgtype).more[0].value
                      for c, _, d in reader.messages(connections)]
            assert values == [i + 1.0 for i in range(500)]


def test_metadata_is_version_9(demo, tmp_path):
    demo.write_night(tmp_path / 'night', metadata={'seed': 3})
    document = yaml.safe_load((tmp_path / 'night' / 'metadata.yaml').read_text())
    info = document['rosbag2_bagfile_information']
    assert info['version'] == 9 and info['storage_identifier'] == 'mcap'
    assert info['relative_file_paths'] == ['night_0.mcap']
    assert info['duration']['nanoseconds'] == 499 * 10**6
    assert info['custom_data'] == {'seed': '3'}
    topic = info['topics_with_message_count'][0]
    assert topic['message_count'] == 500
    qos = topic['topic_metadata']['offered_qos_profiles']
    assert isinstance(qos, list) and qos[0]['history'] == 'keep_last' and qos[0]['depth'] == 50
    assert topic['topic_metadata']['type_description_hash'] == demo.HASHES[demo.PAIR]
    assert '&' not in (tmp_path / 'night' / 'metadata.yaml').read_text()
    assert not list((tmp_path / 'night').glob('.*'))


def test_definition_holds_every_dependency_once(demo):
    definition = ros_schema.message_definition(demo.PAIR)
    separator = '\n' + '=' * 80 + '\nMSG: demo_msgs/Inner\n'
    assert definition.count(separator) == 1
    assert definition.startswith('# Two of them') and 'other/Type\n' not in definition


@pytest.mark.parametrize('name, words', [
    ('absent_msgs/msg/Nothing', 'install or source the package absent_msgs'),
    ('demo_msgs/msg/Broken', 'absent_msgs'),
    ('Pair', 'package/msg/Type'),
    ('../etc/msg/passwd', 'package/msg/Type'),
])
def test_unknown_types(demo, tmp_path, name, words):
    with BagWriter(tmp_path / 'b') as writer, pytest.raises(ValueError, match=words) as error:
        writer.add_topic('/t', name)
    assert '\n' not in str(error.value)


def test_qos_of_rclpy_and_of_old_numbers(demo):
    numbers = {'history': 1, 'depth': 7, 'reliability': 2, 'durability': 1, 'liveliness': 1}
    out = ros_schema.qos_dict(numbers)
    assert (out['reliability'], out['durability']) == ('best_effort', 'transient_local')
    with pytest.raises(ValueError, match='durability'):
        ros_schema.qos_dict({'durability': 'forever'})
    qos = pytest.importorskip('rclpy.qos')
    from rclpy.duration import Duration
    profile = qos.QoSProfile(
        depth=4, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL,
        reliability=qos.ReliabilityPolicy.BEST_EFFORT, deadline=Duration(nanoseconds=1500000000))
    out = ros_schema.qos_dict(profile)
    assert out['deadline'] == {'sec': 1, 'nsec': 500000000}
    assert (out['history'], out['depth']) == ('keep_last', 4)
    assert (out['reliability'], out['durability']) == ('best_effort', 'transient_local')


def test_real_messages(demo, tmp_path):
    serialization = pytest.importorskip('rclpy.serialization')
    from sensor_msgs.msg import JointState
    message = JointState(name=['azimuth', 'elevation'], position=[0.1, 0.2],
                         velocity=[0.0, 0.0], effort=[float('nan')] * 2)
    message.header.stamp.sec = 12
    data = serialization.serialize_message(message)
    with BagWriter(tmp_path / 'b') as writer:
        writer.add_topic('/j', 'sensor_msgs/msg/JointState')
        writer.write('/j', data, 5, 4)
    reader = BagReader(tmp_path / 'b')
    (row,) = reader.messages()
    assert row.data == data
    assert serialization.deserialize_message(row.data, JointState).header.stamp.sec == 12
    assert reader.topics[0].type_hash.startswith('RIHS01_')
    (row,) = reader.messages(decode=True)
    assert list(row.data.position) == [0.1, 0.2] and row.data.header.stamp.sec == 12


def test_folder_of_several_files(demo, tmp_path):
    demo.write_night(tmp_path / 'a', n=20)
    writer = BagWriter(tmp_path / 'b')
    writer.add_topic('/mount/pair', demo.PAIR)
    writer.write('/mount/pair', demo.pair(-1), 10**18 + 1, 0)
    writer.close()
    shutil.copy(writer.file, tmp_path / 'a' / 'a_10.mcap')
    (tmp_path / 'a' / 'a_2.mcap').write_bytes(b'')
    reader = BagReader(tmp_path / 'a')
    assert [file.name for file in reader.files] == ['a_0.mcap', 'a_10.mcap']
    assert [row.data for row in reader.messages()][1] == demo.pair(-1)
    assert reader.topics[0].count == 21
    assert any('a_2.mcap' in p for p in reader.problems)


def test_attachments(demo, tmp_path):
    with BagWriter(tmp_path / 'b') as writer:
        writer.add_topic('/t', demo.TEXT)
        writer.write('/t', demo.text('a'), 1, 1)
        writer.add_attachment('model.json', 'application/json', b'{"old": 1}')
        writer.add_attachment('model.json', 'application/json', b'{"new": 1}')
        writer.add_metadata('parameters', {'seed': 4})
        with pytest.raises(ValueError, match='plain'):
            writer.add_attachment('../model.json', 'application/json', b'')
    data = writer.file.read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(data[:-40])
    for path in (tmp_path / 'b', cut):
        reader = BagReader(path)
        assert [(a.name, a.media_type, a.size) for a in reader.attachments] \
            == [('model.json', 'application/json', 10)] * 2
        assert reader.read_attachment('model.json') == b'{"new": 1}'
        assert reader.metadata['parameters'] == {'seed': '4'}
    with pytest.raises(ValueError, match='model.json'):
        reader.read_attachment('other')


@pytest.mark.parametrize('name', ['../up', '/abs', 'a\\b', '..', '', 'c:x', 'nul\0'])
def test_attachment_names_that_leave_the_folder(demo, tmp_path, name):
    from mcap.writer import Writer
    with open(tmp_path / 'x.mcap', 'wb') as stream:
        writer = Writer(stream)
        writer.start('ros2', 'test')
        writer.add_attachment(0, 0, name, 'text/plain', b'evil')
        writer.finish()
    reader = BagReader(tmp_path / 'x.mcap')
    assert reader.attachments[0].name == name
    with pytest.raises(ValueError, match='plain file name'):
        plain_name(reader.attachments[0].name)


def test_truth_is_flagged(demo, tmp_path):
    for number, (topic, expected) in enumerate((
            ('/mount/truth/joint_states', True), ('truth/x', True), ('/mount/untruth/x', False),
            ('/mount/truth', False))):
        with BagWriter(tmp_path / str(number)) as writer:
            writer.add_topic(topic, demo.TEXT)
            writer.write(topic, demo.text('a'), 1, 1)
        assert BagReader(tmp_path / str(number)).has_truth is expected


def test_writer_refuses(demo, tmp_path):
    writer = demo.write_night(tmp_path / 'night')
    before = writer.file.read_bytes()
    with pytest.raises(ValueError, match='not empty'):
        BagWriter(tmp_path / 'night')
    with pytest.raises(ValueError, match='is a file'):
        BagWriter(writer.file)
    assert writer.file.read_bytes() == before
    with pytest.raises(ValueError, match='closed'):
        writer.write('/mount/pair', demo.pair(0), 1, 1)
    writer.close()
    with pytest.raises(ValueError, match='compression'):
        BagWriter(tmp_path / 'other', compression='rar')
    assert not (tmp_path / 'other').exists()
    with BagWriter(tmp_path / 'other') as writer:
        writer.add_topic('/t', demo.TEXT)
        writer.add_topic('/t', 'demo_msgs/Text')
        with pytest.raises(ValueError, match='recorded as'):
            writer.add_topic('/t', demo.PAIR)
        with pytest.raises(ValueError, match='not added'):
            writer.write('/other', b'', 1, 1)
        with pytest.raises(ValueError, match='outside'):
            writer.write('/t', demo.text('a'), -1, 1)
        writer.write('/t', memoryview(demo.text('a')), 1, 1, sequence=2**40 + 3)
    assert [row.data for row in BagReader(tmp_path / 'other').messages()] == [demo.text('a')]


@pytest.mark.parametrize('room', [0, 10**6])
def test_full_disk_keeps_what_was_written(demo, tmp_path, room):
    """A part of a chunk goes to the disk, then none; later there is `room` for the index."""
    writer = demo.write_night(tmp_path / 'night', close=False, chunk_size=1000)
    writer.refresh()

    class Full:
        left = 30

        def __getattr__(self, name):
            return getattr(stream, name)

        def write(self, data):
            if not self.left:
                raise OSError(28, 'No space left on device')
            part = bytes(data[:self.left])
            self.left -= len(part)
            return stream.write(part)

    stream = writer._out._stream
    writer._out._stream = Full()
    with pytest.raises(OSError, match='No space'):
        for i in range(100):
            writer.write('/mount/pair', demo.pair(i), 2 * 10**18, 1)
    with pytest.raises(OSError, match='failed before'):
        writer.write('/mount/pair', demo.pair(1), 2 * 10**18, 1)
    writer._out._stream.left = room
    writer.close()
    assert stream.closed
    reader = BagReader(tmp_path / 'night')
    assert len(list(reader.messages())) == 505
    assert reader.complete is bool(room)
    assert any('recording stopped: [Errno 28]' in p for p in reader.problems) is bool(room)
