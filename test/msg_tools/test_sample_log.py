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

"""The log in test/data, which a person can try with their own tools, is read by all of ours."""

import json

import pytest
import yaml
from places import LOG

from msg_tools.bag import BagReader

SAMPLE = LOG
FILE = SAMPLE / 'bag_0.mcap'


@pytest.fixture(scope='module')
def ours():
    return sorted((m.topic, m.log_time, m.data) for m in BagReader(SAMPLE).messages())


def test_ours(ours):
    bag = BagReader(SAMPLE)
    assert bag.complete and bag.problems == [] and not bag.has_truth
    assert len(ours) == bag.message_count > 400
    assert len(list(bag.messages(decode=True))) == len(ours) and bag.problems == []
    assert sum(file.stat().st_size for file in SAMPLE.iterdir()) < 200_000
    assert json.loads(bag.read_attachment('model.json'))['format'].startswith('telescope_mount')


def test_it_is_verified():
    from telescope_mount.log_check.log_check import verify_log
    result = verify_log(SAMPLE)
    assert set(result['checked']) >= {'offset', 'zero', 'report', 'model'}
    # the last bit may be another on another processor; what is there may not
    assert not any('only in one' in line for line in result['differences'])
    assert result['unchecked'] == []


def test_metadata_in_the_order_of_rosbag2():
    info = yaml.safe_load((SAMPLE / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert list(info) == [
        'version', 'storage_identifier', 'duration', 'starting_time', 'message_count',
        'topics_with_message_count', 'compression_format', 'compression_mode',
        'relative_file_paths', 'files', 'custom_data', 'ros_distro']
    topic = info['topics_with_message_count'][0]['topic_metadata']
    assert list(topic) == ['name', 'type', 'serialization_format', 'offered_qos_profiles',
                           'type_description_hash']
    assert list(topic['offered_qos_profiles'][0]) == [
        'history', 'depth', 'reliability', 'durability', 'deadline', 'lifespan', 'liveliness',
        'liveliness_lease_duration', 'avoid_ros_namespace_conventions']
    # on the channel the same, as text
    bag = BagReader(SAMPLE)
    for topic in info['topics_with_message_count']:
        stored = next(t for t in bag.topics if t.name == topic['topic_metadata']['name'])
        assert stored.qos == topic['topic_metadata']['offered_qos_profiles']
        assert stored.type_hash == topic['topic_metadata']['type_description_hash']
        assert stored.count == topic['message_count']


@pytest.mark.parametrize('path', [SAMPLE, FILE], ids=['folder', 'file'])
def test_rosbags(ours, path):
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    highlevel = pytest.importorskip('rosbags.highlevel')
    with rosbag2.Reader(path) as reader:
        theirs = sorted((c.topic, when, bytes(data)) for c, when, data in reader.messages())
    assert theirs == ours
    with highlevel.AnyReader([path]) as reader:
        decoded = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()]
    assert len(decoded) == len(ours)


def test_mcap_and_its_ros2_decoder(ours):
    reader_of = pytest.importorskip('mcap.reader')
    decoder = pytest.importorskip('mcap_ros2.decoder')
    with open(FILE, 'rb') as stream:
        reader = reader_of.make_reader(
            stream, validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
        rows = list(reader.iter_decoded_messages())
        summary = reader.get_summary()
        assert sorted((r.channel.topic, r.message.log_time, r.message.data) for r in rows) == ours
        assert summary.statistics.message_count == len(ours)
        assert sum(summary.statistics.channel_message_counts.values()) == len(ours)
        assert [a.name for a in reader.iter_attachments()] == ['model.json']
        names = {record.name for record in reader.iter_metadata()}
    assert {'rosbag2', 'telescope_mount', 'parameters /mount/calibration'} <= names
    # without seeking, as from a pipe: nothing but the records in their order
    with open(FILE, 'rb') as stream:
        plain = reader_of.NonSeekingReader(stream, validate_crcs=True)
        assert sorted((c.topic, m.log_time, m.data) for _, c, m in plain.iter_messages()) == ours
