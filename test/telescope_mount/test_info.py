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

import sqlite3
import struct

import pytest

from msg_tools.bag import BagWriter
from msg_tools.bag.sqlite import SqliteReader, open_bag
from telescope_mount.cli import main
from telescope_mount.commands.info import info_parts, log_info

START = 1_768_482_000_000_000_000
DEFINITION = b'int32 data\n'


def number(value):
    return b'\0\1\0\0' + struct.pack('<i', value)


@pytest.fixture
def log(tmp_path):
    """100 Hz from two publishers, of which one lost two messages; and a silent topic."""
    with BagWriter(tmp_path / 'log', metadata={'package': 'telescope_mount 9'}) as writer:
        for name in ('/fast', '/silent', '/once'):
            writer.add_foreign_topic(name, 'std_msgs/msg/Int32', [], DEFINITION, '')
        for i in range(100):
            sequence = i // 2 + 1
            if not (i % 2 and 20 <= sequence <= 21):
                writer.write('/fast', number(i), START + i * 10**7, START, sequence)
        writer.write('/once', number(1), START, START)
        writer.add_attachment('model.json', 'application/json', b'{}')
    return tmp_path / 'log'


def test_counts_rates_and_losses(log):
    info = log_info(log)
    rows = {row['name']: row for row in info['topics']}
    fast = rows['/fast']
    assert (fast['count'], fast['lost'], fast['publishers']) == (98, 2, 2)
    assert fast['rate_hz'] == pytest.approx(97 / 0.99)
    assert rows['/silent']['count'] == 0 and rows['/silent']['rate_hz'] is None
    # without sequence numbers nothing can be said of losses
    assert rows['/once']['count'] == 1 and rows['/once']['lost'] is None
    assert info['messages'] == 99 and info['duration_s'] == pytest.approx(0.99)
    assert info['start'] == '2026-01-15T13:00:00.000Z'
    assert info['complete'] and info['problems'] == []
    assert info['attachments'] == [{'name': 'model.json', 'bytes': 2}]
    assert info['size_bytes'] == (log / 'log_0.mcap').stat().st_size


def test_one_series_of_numbers_over_all_topics_tells_no_loss(tmp_path):
    with BagWriter(tmp_path / 'log') as writer:
        for name in ('/a', '/b'):
            writer.add_foreign_topic(name, 'std_msgs/msg/Int32', [], DEFINITION, '')
        for i in range(1, 30):
            writer.write('/b' if i % 3 else '/a', number(i), START + i * 10**7, START, i)
    assert [row['lost'] for row in log_info(tmp_path / 'log')['topics']] == [None, None]


def test_quick_reads_no_message(log):
    file = log / 'log_0.mcap'
    data = bytearray(file.read_bytes())
    data[data.index(b'\x04\0\0\0zstd') + 20] ^= 1
    file.write_bytes(data)
    quick, full = log_info(log, quick=True), log_info(log)
    assert quick['messages'] == 99 and quick['problems'] == []
    assert quick['topics'][0]['count'] == 98 and quick['topics'][0]['lost'] is None
    assert ['left out: 99 messages from' in problem for problem in full['problems']] == [True]
    lines = [part for part in info_parts(full) if isinstance(part, str)]
    assert any('damaged' in line for line in lines)


def test_command(log, tmp_path, capsys):
    assert main(['info', str(log)]) == 0
    out = capsys.readouterr().out
    for words in ('/fast', '97.98', 'whole, every checksum is right', 'telescope_mount 9',
                  'model.json', '2026-01-15T13:00:00.000Z'):
        assert words in out
    assert main(['info', str(tmp_path / 'absent')]) == 2
    assert 'does not exist' in capsys.readouterr().err


def test_a_few_messages_of_another_day_are_named(tmp_path, capsys):
    """Neither too early nor too late for a time, but not of this night."""
    with BagWriter(tmp_path / 'log') as writer:
        writer.add_foreign_topic('/a', 'std_msgs/msg/Int32', [], DEFINITION, '')
        writer.add_foreign_topic('/b', 'std_msgs/msg/Int32', [], DEFINITION, '')
        writer.write('/b', number(1), START - 3 * 86400 * 10**9, START)
        for i in range(150):
            writer.write('/a', number(i), START + i * 10**7, START)
    info = log_info(tmp_path / 'log')
    assert info['problems'] == ['1 message from 2026-01-12T13:00:00.000Z to '
                                '2026-01-12T13:00:00.000Z, the other 150 on other days; topics: /b']
    assert main(['info', str(tmp_path / 'log')]) == 1 and 'whole' not in capsys.readouterr().out


# --- bags in SQLite ------------------------------------------------------------------------------


@pytest.fixture
def sqlite_bag(tmp_path):
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    typesys = pytest.importorskip('rosbags.typesys')
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    with rosbag2.Writer(tmp_path / 'bag', version=9,
                        storage_plugin=rosbag2.StoragePlugin.SQLITE3) as writer:
        topics = [writer.add_connection(name, 'std_msgs/msg/Int32', typestore=store)
                  for name in ('/a', '/b')]
        for i in range(50):
            writer.write(topics[i % 2], START + (i // 2) * 1000, number(i))
    return tmp_path / 'bag'


def test_sqlite_is_read_like_mcap(sqlite_bag):
    bag = open_bag(sqlite_bag)
    assert isinstance(bag, SqliteReader)
    assert [row.data for row in bag.messages()] == [number(i) for i in range(50)]
    assert [row.data.data for row in bag.messages('/b', decode=True)] == list(range(1, 50, 2))
    rows = list(bag.messages('/a', START + 2000, START + 4000))
    assert [row.data for row in rows] == [number(4), number(6)]
    assert [m.data for m in bag.last_before(['/a', '/b'], START + 2000)] == [number(2), number(3)]
    assert (bag.start_time, bag.end_time) == (START, START + 24_000)
    info = log_info(sqlite_bag)
    assert info['messages'] == 50 and info['problems'] == []


def test_what_is_no_sqlite_bag(sqlite_bag, tmp_path):
    (tmp_path / 'x.db3').write_bytes(b'SQLite format 3\0' + bytes(200))
    with pytest.raises(ValueError, match='x.db3'):
        open_bag(tmp_path / 'x.db3')
    # a view that never ends in the place of a table
    with sqlite3.connect(tmp_path / 'y.db3') as base:
        base.execute('CREATE TABLE topics(id INTEGER, name TEXT, type TEXT)')
        base.execute('CREATE VIEW messages AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL '
                     'SELECT x + 1 FROM c) SELECT x AS id, x AS topic_id, x AS timestamp, x AS '
                     'data FROM c')
    base.close()
    with pytest.raises(ValueError, match='no tables of a bag'):
        open_bag(tmp_path / 'y.db3')
    file = next(sqlite_bag.glob('*.db3'))
    with pytest.raises(ValueError, match='does not exist'):
        open_bag(tmp_path / 'absent.db3')
    data = file.read_bytes()
    for size in range(0, len(data), 3000):
        file.write_bytes(data[:size])
        try:
            bag = open_bag(file)
            assert len(list(bag.messages())) <= 50
        except ValueError as error:
            assert '\n' not in str(error)
