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
"""Files that say other than ``metadata.yaml``, and several logs in one file."""

import shutil

import pytest

from msg_tools.bag import BagReader, BagWriter
from msg_tools.bag.log_copy import recover_log
from telescope_mount.commands.info import log_info
from telescope_mount.log_check.log_replay import _newer

DAY = 86_400 * 10**9


def write_log(folder, n=40, begin=10**18, topics=('/a', '/b')):
    with BagWriter(folder, chunk_size=500) as writer:
        for topic in topics:
            writer.add_foreign_topic(topic, 'std_msgs/msg/Int32', [], b'int32 data\n', '')
        for i in range(n):
            writer.write(topics[i % 2], b'\0\1\0\0' + i.to_bytes(4, 'little'), begin + i * 10**6,
                         begin + i, i + 1)
    return writer.file


@pytest.fixture
def log(tmp_path):
    return write_log(tmp_path / 'log').parent


def test_a_file_with_fewer_messages_than_listed(log, tmp_path):
    shutil.copy(write_log(tmp_path / 'half', 20), log / 'log_0.mcap')
    info = log_info(log)
    assert info['problems'] == [
        'log_0.mcap has 20 messages, metadata.yaml lists 40: 20 are missing']
    assert log_info(log, quick=True)['problems'] == info['problems']
    report = recover_log(log)
    assert not report['whole'] and report['messages_lost'] == 20


def test_a_copy_in_the_folder_and_a_file_of_another_night(log, tmp_path):
    shutil.copy(log / 'log_0.mcap', log / 'log_0 (copy).mcap')
    listed, twice = log_info(log)['problems']
    assert listed.startswith('log_0 (copy).mcap is not listed in metadata.yaml: 40 messages more')
    assert twice == '40 messages occur twice, as if a file was copied'
    assert len(list(BagReader(log).messages('/a'))) == 40
    (log / 'log_0 (copy).mcap').unlink()
    shutil.copy(write_log(tmp_path / 'other', 30, 10**18 + DAY // 2), log / 'log_1.mcap')
    (problem,) = log_info(log)['problems']
    assert problem.startswith('log_1.mcap is not listed in metadata.yaml: 30 messages more, from '
                              '2001-09-09T13:46:40')
    assert recover_log(log)['messages'] == 70


def test_logs_in_one_file_are_all_read(log, tmp_path):
    """Their channels have the same numbers and other topics."""
    first = (log / 'log_0.mcap').read_bytes()
    other = write_log(tmp_path / 'other', 30, 10**18 + DAY // 2, ('/c', '/a')).read_bytes()
    file = tmp_path / 'x.mcap'
    for data, count in ((first + other, 70), (other + first + other, 100)):
        file.write_bytes(data)
        reader = BagReader(file)
        topics = {topic.name: topic.count for topic in reader.topics}
        assert (reader.message_count, sum(topics.values())) == (count, count)
        assert topics['/b'] == 20 and topics['/c'] == 15 * (count - 40) // 30
        assert len(list(reader.messages())) == count and not reader.complete
        problem, *_ = reader.problems
        assert problem.startswith('x.mcap: another MCAP log of ') and problem.endswith(
            ': its messages are read, too')
        assert not any('damaged' in one for one in reader.problems)
        assert reader.files == [file]
        report = recover_log(file, tmp_path / f'new_{count}')
        assert report['whole'] and report['messages'] == count
    # the first one was cut off: its channels are not those of the other
    file.write_bytes(first[:len(first) // 2] + other)
    reader = BagReader(file)
    rows = list(reader.messages())
    assert sum(row.topic == '/c' for row in rows) == 15 and 30 < len(rows) < 70
    assert not any(row.topic == '/c' for row in rows if row.log_time < 10**18 + DAY // 4)
    assert [one for one in reader.problems if 'not closed' in one]


def test_what_follows_a_log_and_is_none_is_told(log):
    file = log / 'log_0.mcap'
    size = file.stat().st_size
    file.write_bytes(file.read_bytes() + b'x' * 100)
    problems = log_info(log)['problems']
    assert problems == [f'log_0.mcap: 100 bytes at byte {size} are damaged (they follow the end of '
                        'the log) and left out: an unknown number of messages']
    assert recover_log(log)['whole']  # metadata.yaml lists no more
    report = recover_log(file, log.parent / 'new')
    assert report['messages'] == 40 and not report['whole']
    # many that hold nothing are not read for ever
    empty = log / 'empty.mcap'
    empty.write_bytes(write_log(log.parent / 'none', 0).read_bytes() * 300)
    assert len(BagReader(empty).problems) == 51


def test_without_checksums_none_is_spoken_of(tmp_path, capsys):
    from mcap.writer import Writer

    from telescope_mount.cli import main
    for crcs in (True, False):
        with open(tmp_path / 'x.mcap', 'wb') as stream:
            writer = Writer(stream, enable_crcs=crcs)
            writer.start('ros2', 'test')
            schema = writer.register_schema('a/msg/B', 'ros2msg', b'')
            writer.add_message(writer.register_channel('/t', 'cdr', schema), 1, b'x', 1)
            writer.finish()
        assert main(['info', str(tmp_path / 'x.mcap')]) == 0
        assert ('every checksum is right' in capsys.readouterr().out) == crcs


def test_an_observation_that_is_there_twice_counts_once(tmp_path):
    definition = b'Header header\n' + b'=' * 80 + b'\nMSG: a/Header\nTime stamp\n' + b'=' * 80 + (
        b'\nMSG: a/Time\nint32 sec\nuint32 nanosec\n')
    with BagWriter(tmp_path / 'log') as writer:
        writer.add_foreign_topic('/o', 'a/msg/O', [], definition, '')
        for i, second in enumerate((1, 1, 2, 3, 2, 3, 4)):
            writer.write('/o', b'\0\1\0\0' + second.to_bytes(8, 'little'), i, i)
    assert _newer(BagReader(tmp_path / 'log'), '/o') == 4
