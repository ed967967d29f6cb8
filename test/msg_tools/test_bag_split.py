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

"""Logs of several files: where they are divided, and what each of them starts with."""

import pytest
import yaml

from msg_tools.bag import BagReader, BagWriter
from msg_tools.bag.writer import REPEATED_RECORD

START = 10**18


def write_split(demo, folder, n=400, latched_at=(5, 190), **options):
    """Pairs 10 ms apart, and a latched text now and then; the texts' bytes."""
    texts = []
    with BagWriter(folder, **options) as writer:
        writer.add_topic('/pair', demo.PAIR, [{'depth': 50}])
        writer.add_topic('/text', demo.TEXT, [demo.LATCHED])
        writer.add_metadata('parameters', {'seed': 3})
        for i in range(n):
            when = START + i * 10**7
            writer.write('/pair', demo.pair(i), when, when, i + 1)
            if i in latched_at:
                texts.append(demo.text(f'from {i}'))
                writer.write('/text', texts[-1], when, when - 5, len(texts))
    return texts


def test_split_by_log_time(demo, tmp_path):
    texts = write_split(demo, tmp_path / 'b', max_seconds=1.0)
    reader = BagReader(tmp_path / 'b')
    assert [f.name for f in reader.files] == [f'b_{i}.mcap' for i in range(4)]
    for number, file in enumerate(reader.files):
        rows = list(BagReader(file).messages('/pair'))
        assert [row.data for row in rows] == [demo.pair(100 * number + i) for i in range(100)]
    # as one log nothing comes twice
    assert [row.data for row in reader.messages('/pair')] == [demo.pair(i) for i in range(400)]
    assert [row.data for row in reader.messages('/text')] == texts
    assert reader.message_count == 402 and reader.complete and reader.problems == []
    assert (reader.start_time, reader.end_time) == (START, START + 399 * 10**7)


def test_each_file_starts_with_what_is_latched(demo, tmp_path):
    texts = write_split(demo, tmp_path / 'b', max_seconds=1.0)
    expected = [texts[:1], texts, texts[1:], texts[1:]]
    for number, file in enumerate(sorted((tmp_path / 'b').glob('*.mcap'))):
        reader = BagReader(file)
        rows = list(reader.messages())
        of_text = [row for row in rows if row.topic == '/text']
        assert [row.data for row in of_text] == expected[number]
        assert (REPEATED_RECORD in reader.metadata) is (number > 0)
        assert reader.metadata['parameters'] == {'seed': '3'}
        if number:
            # first in the file, at the time of the split, with the time of its source
            assert rows[0].topic == '/text'
            assert rows[0].log_time == rows[1].log_time == START + number * 10**9
            assert (rows[0].publish_time - START) % 10**7 == 10**7 - 5


@pytest.mark.parametrize('gone', [0, 1])
def test_what_a_missing_file_had_is_taken_from_the_next(demo, tmp_path, gone):
    texts = write_split(demo, tmp_path / 'b', max_seconds=1.0)
    (tmp_path / 'b' / f'b_{gone}.mcap').unlink()
    reader = BagReader(tmp_path / 'b')
    assert [row.data for row in reader.messages('/text')] == texts
    assert any(f'b_{gone}.mcap' in problem for problem in reader.problems)


def test_split_by_size(demo, tmp_path):
    write_split(demo, tmp_path / 'b', max_bytes=12_000, chunk_size=1000, compression='none')
    reader = BagReader(tmp_path / 'b')
    assert len(reader.files) > 3
    # all but the index
    for file in reader.files:
        assert file.stat().st_size < 12_000 + 8_000
    assert [row.data for row in reader.messages('/pair')] == [demo.pair(i) for i in range(400)]


def test_first_limit_that_is_met_decides(demo, tmp_path):
    write_split(demo, tmp_path / 'time', max_seconds=0.5, max_bytes=10**9)
    write_split(demo, tmp_path / 'size', max_seconds=500, max_bytes=12_000, compression='none')
    assert len(BagReader(tmp_path / 'time').files) == 8
    assert len(BagReader(tmp_path / 'size').files) == 3


def test_split_by_hand_and_a_message_larger_than_a_file(demo, tmp_path):
    with BagWriter(tmp_path / 'b', max_bytes=1000) as writer:
        writer.add_topic('/t', demo.TEXT)
        for i in range(3):
            writer.write('/t', demo.text(str(i) * 5000), i, i)
        writer.split()
        writer.write('/t', demo.text('end'), 9, 9)
    reader = BagReader(tmp_path / 'b')
    assert [BagReader(f).message_count for f in reader.files] == [1, 1, 1, 1]
    assert len(list(reader.messages())) == 4


def test_metadata_and_other_readers_agree_on_all_files(demo, tmp_path):
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    mcap_reader = pytest.importorskip('mcap.reader')
    write_split(demo, tmp_path / 'b', max_seconds=1.0)
    info = yaml.safe_load((tmp_path / 'b' / 'metadata.yaml').read_text())[
        'rosbag2_bagfile_information']
    assert info['relative_file_paths'] == [f['path'] for f in info['files']]
    assert [f['message_count'] for f in info['files']] == [101, 102, 101, 101]
    assert info['message_count'] == 405 == sum(
        t['message_count'] for t in info['topics_with_message_count'])
    assert info['starting_time']['nanoseconds_since_epoch'] == START
    assert info['duration']['nanoseconds'] == 399 * 10**7
    assert info['files'][1]['starting_time']['nanoseconds_since_epoch'] == START + 10**9
    with rosbag2.Reader(tmp_path / 'b') as reader:
        assert len(list(reader.messages())) == reader.message_count == 405
    for file in info['relative_file_paths']:
        with open(tmp_path / 'b' / file, 'rb') as stream:
            reader = mcap_reader.make_reader(stream, validate_crcs=True)
            assert reader.get_summary().statistics.message_count == len(
                list(reader.iter_messages()))


def test_a_folder_whose_last_file_is_not_closed(demo, tmp_path):
    writer = BagWriter(tmp_path / 'b', max_seconds=1.0)
    writer.add_topic('/text', demo.TEXT, [demo.LATCHED])
    for i in range(5):
        writer.write('/text', demo.text(str(i)), START + i * 6 * 10**8, 0)
    writer.refresh()
    reader = BagReader(tmp_path / 'b')
    assert [row.data for row in reader.messages()] == [demo.text(str(i)) for i in range(5)]
    assert reader.message_count == 5 == writer.message_count
    assert not reader.complete
    writer.close()
