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

"""Logs that are open, cut, damaged or none: what is whole is read, the rest is told."""

import random
import struct

import pytest
import yaml

from msg_tools import bag
from msg_tools.bag import BagReader


def test_folder_readable_before_it_is_closed(demo, tmp_path):
    writer = demo.write_night(tmp_path / 'night', close=False, metadata={'seed': 1})
    early = BagReader(tmp_path / 'night')
    assert not early.complete and early.metadata[bag.OWN_RECORD] == {'seed': '1'}
    writer.refresh()
    info = yaml.safe_load((tmp_path / 'night' / 'metadata.yaml').read_text())
    assert info['rosbag2_bagfile_information']['message_count'] == 505
    reader = BagReader(tmp_path / 'night')
    assert len(list(reader.messages())) == 505
    assert [p for p in reader.problems if 'not closed: 505 messages' in p]
    writer.close()
    assert BagReader(tmp_path / 'night').complete


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_cut_anywhere(demo, tmp_path, compression):
    file = demo.write_night(tmp_path / 'night', chunk_size=2000, compression=compression).file
    whole = file.read_bytes()
    all_rows = {(m.log_time, m.data) for m in BagReader(file).messages()}
    cut = tmp_path / 'cut.mcap'
    counts = []
    for size in [*range(1, 60), *range(61, len(whole), 701), len(whole) - 1]:
        cut.write_bytes(whole[:size])
        reader = BagReader(cut)
        rows = list(reader.messages())
        assert len(rows) == reader.message_count
        assert {(m.log_time, m.data) for m in rows} <= all_rows
        assert reader.problems and not reader.complete
        counts.append(len(rows))
    assert counts == sorted(counts)
    assert counts[-1] == 505 and len(set(counts)) > 10


def test_messages_of_a_cut_uncompressed_chunk_are_saved(demo, tmp_path):
    writer = demo.write_night(tmp_path / 'night', compression='none', chunk_size=10**6)
    data = writer.file.read_bytes()
    writer.file.write_bytes(data[:len(data) // 2])
    assert 150 < len(list(BagReader(writer.file).messages())) < 500


def test_flipped_bytes_never_escape(demo, tmp_path):
    file = demo.write_night(tmp_path / 'night', n=60, chunk_size=1500).file
    whole = bytearray(file.read_bytes())
    rng = random.Random(5)
    damaged = tmp_path / 'damaged.mcap'
    complaints = 0
    for _ in range(240):
        data = whole.copy()
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        damaged.write_bytes(data)
        try:
            reader = BagReader(damaged)
            for row in reader.messages():
                assert isinstance(row.data, bytes)
            list(reader.messages(decode=True))
            complaints += bool(reader.problems)
        except ValueError as error:
            assert '\n' not in str(error)
            complaints += 1
    assert complaints > 60


def test_damaged_chunk_is_left_out_and_told(demo, tmp_path):
    file = demo.write_night(tmp_path / 'night', chunk_size=2000, compression='none').file
    data = bytearray(file.read_bytes())
    data[data.index(demo.pair(250)) + 8] ^= 1
    file.write_bytes(data)
    reader = BagReader(file)
    rows = [row.data for row in reader.messages('/mount/pair')]
    assert 400 < len(rows) < 500 and set(rows) < {demo.pair(i) for i in range(500)}
    assert any('checksum' in p for p in reader.problems)


def test_bomb_is_refused(demo, tmp_path):
    from mcap.writer import Writer
    file = tmp_path / 'bomb.mcap'
    with open(file, 'wb') as stream:
        writer = Writer(stream, chunk_size=2**62)
        writer.start('ros2', 'test')
        channel = writer.register_channel('/t', 'cdr', writer.register_schema('a', 'ros2msg', b''))
        writer.add_message(channel, 1, b'\0' * 1000, 1)
        writer.finish()
    data = bytearray(file.read_bytes())
    # the chunk is said to hold 2**60 bytes
    place = data.index(b'\x04\0\0\0zstd') - 12
    data[place:place + 8] = struct.pack('<Q', 2**60)
    file.write_bytes(data)
    for content, words in ((data, 'index says'), (data[:-40], 'claims')):  # without the index
        file.write_bytes(content)
        reader = BagReader(file)  # by its checksum it is read all the same
        assert [row.data for row in reader.messages()] == [b'\0' * 1000]
        assert any(words in p for p in reader.problems), reader.problems
    data[place + 8] ^= 1  # the checksum
    for content in (data, data[:-40]):
        file.write_bytes(content)
        assert list(BagReader(file).messages()) == []


def test_file_without_chunks_or_index(demo, tmp_path):
    from mcap.writer import IndexType, Writer
    for number, options in enumerate((
            {'use_chunking': False}, {'index_types': IndexType.NONE, 'use_statistics': False})):
        file = tmp_path / f'{number}.mcap'
        with open(file, 'wb') as stream:
            writer = Writer(stream, **options)
            writer.start('ros2', 'test')
            schema = writer.register_schema('a/msg/B', 'ros2msg', b'')
            channel = writer.register_channel('/t', 'cdr', schema)
            for i in (3, 1, 2):
                writer.add_message(channel, i, b'x' * i, i)
            writer.finish()
        reader = BagReader(file)
        assert [row.log_time for row in reader.messages()] == [1, 2, 3]
        assert reader.message_count == 3 and reader.complete and reader.problems == []


def test_what_is_no_log(demo, tmp_path):
    (tmp_path / 'empty.mcap').write_bytes(b'')
    (tmp_path / 'random.mcap').write_bytes(random.Random(1).randbytes(5000))
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'bad').mkdir()
    (tmp_path / 'bad' / 'bad_0.mcap').write_bytes(b'')
    for name, words in (('empty.mcap', 'empty'), ('random.mcap', 'not an MCAP'),
                        ('folder', 'no .mcap'), ('missing', 'does not exist'), ('bad', 'empty')):
        with pytest.raises(ValueError, match=words) as error:
            BagReader(tmp_path / name)
        assert '\n' not in str(error.value)


def test_damaged_metadata_does_not_matter(demo, tmp_path):
    folder = demo.write_night(tmp_path / 'night').folder
    for content in ('{', '- 1', 'rosbag2_bagfile_information: {relative_file_paths: [gone.mcap]}',
                    'rosbag2_bagfile_information: {relative_file_paths: [../../x.mcap]}'):
        (folder / 'metadata.yaml').write_text(content)
        reader = BagReader(folder)
        assert reader.message_count == 505 and reader.problems
    (folder / 'metadata.yaml').unlink()
    assert BagReader(folder).message_count == 505


def test_an_attachment_is_held_by_its_checksum(demo, tmp_path):
    with demo.write_night(tmp_path / 'night', close=False) as writer:
        writer.add_attachment('model.json', 'application/json', b'{"IA": 12.5}')
    assert BagReader(writer.file).read_attachment('model.json') == b'{"IA": 12.5}'
    writer.file.write_bytes(writer.file.read_bytes().replace(b'12.5}', b'17.5}'))
    with pytest.raises(ValueError, match='model.json is damaged'):
        BagReader(writer.file).read_attachment('model.json')


def test_times_that_cannot_be_are_told(tmp_path):
    """A simulated clock may begin with 0; one stamp of 0 beside others of today may not."""
    today = 1_768_482_000 * 10**9
    for number, (times, words) in enumerate((
            ((5, 6), None), ((today, today + 5), None), ((0, today), 'from 1970-01-01'),
            ((today, 2**63 - 1), 'to 2262-04-11'))):
        with bag.BagWriter(tmp_path / str(number)) as writer:
            writer.add_foreign_topic('/t', 'a/msg/B', [], b'', '')
            for time in times:
                writer.write('/t', b'x', time, time)
        problems = BagReader(tmp_path / str(number)).problems
        assert problems == [] if words is None else words in problems[0], problems
