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

import hashlib
import json
import struct
import subprocess
import sys

import pytest
from mcap.writer import Writer
from places import ROOT

from msg_tools.bag import BagReader, BagWriter
from msg_tools.bag.log_copy import recover_log
from telescope_mount.cli import main

FUZZ = ROOT / 'benchmarks' / 'recover_truth.py'
TEXT = 'std_msgs/msg/String'
DEFINITION = b'string data\n'


def text(data):
    return b'\0\1\0\0' + struct.pack('<I', len(data) + 1) + data.encode() + b'\0'


@pytest.fixture
def damaged(tmp_path):
    """A log cut in the middle, of a type that need not be installed; (folder, bytes)."""
    folder = tmp_path / 'night'
    with BagWriter(folder, chunk_size=2000, metadata={'seed': 4}) as writer:
        writer.add_foreign_topic('/a', 'odd_msgs/msg/Odd', [], DEFINITION, 'RIHS01_ff')
        writer.add_foreign_topic('/b', TEXT, [], DEFINITION, '')
        writer.add_metadata('parameters /mount/x', {'n': 1})
        writer.add_attachment('first.json', 'application/json', b'{}')
        for i in range(300):
            writer.write('/' + 'ab'[i % 2], text(str(i)), 1000 + i, 900 + i, i // 2 + 1)
    file = writer.file
    file.write_bytes(file.read_bytes()[:9000])
    return folder, file.read_bytes()


def test_what_can_be_read_becomes_a_whole_log(damaged, tmp_path):
    folder, before = damaged
    report = recover_log(folder)
    old, new = BagReader(folder), BagReader(report['out'])
    assert report['out'] == tmp_path / 'night_recovered'
    assert new.complete and new.problems == [] and not old.complete
    rows = list(new.messages())
    assert rows == list(old.messages()) and report['messages'] == len(rows) > 50
    assert [t[:3] for t in new.topics] == [t[:3] for t in old.topics]
    assert new.topics[0].type_hash == 'RIHS01_ff'
    assert new.metadata['telescope_mount'] == {'seed': '4'}
    assert new.metadata['parameters /mount/x'] == {'n': '1'}
    assert new.read_attachment('first.json') == b'{}'
    assert report['lost'] and report['lost_bytes'] > 0
    # the input is as it was
    assert next(folder.glob('*.mcap')).read_bytes() == before


def test_recovered_log_is_read_by_others(damaged):
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    report = recover_log(damaged[0])
    with rosbag2.Reader(report['out']) as reader:
        assert len(list(reader.messages())) == report['messages'] == reader.message_count


def test_never_over_the_input_or_into_it(damaged, tmp_path):
    folder, _ = damaged
    (tmp_path / 'used').mkdir()
    (tmp_path / 'used' / 'file').write_text('x')
    for out, words in ((folder, 'lies in the log'), (folder / 'sub', 'lies in the log'),
                       (tmp_path / 'used', 'not empty'),
                       (tmp_path / 'used' / 'file', 'is a file')):
        with pytest.raises(ValueError, match=words):
            recover_log(folder, out)
    state = hashlib.sha256(next(folder.glob('*.mcap')).read_bytes()).hexdigest()
    with pytest.raises(ValueError, match='not empty'):
        recover_log(next(folder.glob('*.mcap')), folder)
    assert hashlib.sha256(next(folder.glob('*.mcap')).read_bytes()).hexdigest() == state
    assert [p.name for p in folder.iterdir() if p.suffix == '.mcap'] == ['night_0.mcap']


def test_a_whole_log_comes_out_the_same(tmp_path):
    with BagWriter(tmp_path / 'b', max_seconds=1e-7) as writer:
        writer.add_foreign_topic('/t', TEXT, [
            {'history': 'keep_last', 'depth': 1, 'reliability': 'reliable',
             'durability': 'transient_local'}], DEFINITION, '')
        for i in range(300):
            writer.write('/t', text(str(i)), 1000 + i, i)
    report = recover_log(tmp_path / 'b', tmp_path / 'new')
    assert report['messages'] == 300 and report['lost'] == [] and report['lost_bytes'] == 0
    assert [row.data for row in BagReader(tmp_path / 'new').messages()] == [
        text(str(i)) for i in range(300)]


def test_what_is_no_ros_and_names_that_lead_out_are_told(tmp_path):
    file = tmp_path / 'odd.mcap'
    with open(file, 'wb') as stream:
        writer = Writer(stream)
        writer.start('', 'test')
        for name, encoding in (('/json', 'json'), ('/ros', 'cdr')):
            schema = writer.register_schema(TEXT, 'ros2msg', DEFINITION)
            channel = writer.register_channel(name, encoding, schema)
            writer.add_message(channel, 5, text('x'), 5)
        writer.add_attachment(0, 0, '../../evil', 'text/plain', b'evil')
        writer.finish()
    report = recover_log(file)
    assert report['messages'] == 1 and report['attachments'] == []
    assert any('/json' in line for line in report['lost'])
    assert any('../../evil' in line for line in report['lost'])
    assert sorted(p.name for p in tmp_path.iterdir()) == ['odd.mcap', 'odd_recovered']


START = 1_768_482_000 * 10**9


def numbered(folder, compression):
    """600 messages of two topics in some ten chunks, 10 ms apart; the file, places of chunks."""
    with BagWriter(folder, compression=compression, chunk_size=3000) as writer:
        for name in ('/a', '/b'):
            writer.add_foreign_topic(name, TEXT, [], DEFINITION, '')
        for i in range(600):
            writer.write('/' + 'aab'[i % 3], text(f'{i:04d}'), START + i * 10**7, START + i)
    data = writer.file.read_bytes()
    segments = sorted(BagReader(folder)._files[0].segments)
    return writer.file, data, [(s.offset, s.offset + s.length, s.start, s.end) for s in segments]


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
@pytest.mark.parametrize('index', ['index', 'no index', 'no index, no metadata'])
def test_so_many_of_so_many_messages_are_lost(tmp_path, compression, index, capsys):
    file, data, chunks = numbered(tmp_path / 'log', compression)
    data, gone = bytearray(data), []
    for _, end, start, stop in (chunks[3], chunks[6]):
        data[end - 20] ^= 4
        gone += range((start - START) // 10**7, (stop - START) // 10**7 + 1)
    file.write_bytes(data if index == 'index' else data[:-20])
    if index == 'no index, no metadata':
        (file.parent / 'metadata.yaml').unlink()
    assert main(['recover', str(file.parent), '--json', str(tmp_path / 'report.json')]) == 1
    out, report = capsys.readouterr().out, json.loads((tmp_path / 'report.json').read_text())
    b = sum(i % 3 == 2 for i in gone)
    assert (report['messages'], report['messages_lost']) == (600 - len(gone), len(gone))
    assert report['missing'] == {'/a': len(gone) - b, '/b': b} and report['all_known']
    assert report['recorded'] == {'/a': 400, '/b': 200}
    assert [(part['start_ns'], part['end_ns']) for part in report['parts']] == [
        chunks[3][2:], chunks[6][2:]]
    assert f'/b: {b} of 200 messages' in out and f'{len(gone)} of 600 messages are lost' in out
    left = [row.data for row in BagReader(report['out']).messages()]
    assert left == [text(f'{i:04d}') for i in range(600) if i not in gone]


def test_nothing_is_lost_where_indexes_and_heads_alone_are_damaged(tmp_path):
    for number, at in enumerate(('opcode', 'length', 'size', 'message index', 'summary')):
        file, data, chunks = numbered(tmp_path / str(number), 'zstd')
        data, (begin, end, *_) = bytearray(data), chunks[4]
        place = {'opcode': begin - 9, 'length': begin - 8, 'size': begin + 16,
                 'message index': end, 'summary': len(data) - 60}[at]
        data[place] ^= 1
        file.write_bytes(data if at == 'summary' else data[:-20])
        report = recover_log(file.parent)
        assert report['whole'] and report['messages'] == 600, (at, report)
        assert report['lost'], at


def test_a_file_that_is_missing_is_counted(tmp_path):
    with BagWriter(tmp_path / 'log', max_seconds=1.0) as writer:
        writer.add_foreign_topic('/a', TEXT, [], DEFINITION, '')
        for i in range(300):
            writer.write('/a', text(str(i)), START + i * 10**7, START + i)
    (tmp_path / 'log' / 'log_1.mcap').unlink()
    report = recover_log(tmp_path / 'log')
    assert (report['messages'], report['messages_lost'], report['all_known']) == (200, 100, True)
    assert 'with 100 messages from 2026-01-15T13:00:01.000Z to' in ' '.join(report['lost'])


def test_what_comes_after_a_crash_is_not_known(tmp_path):
    file, data, chunks = numbered(tmp_path / 'log', 'zstd')
    (file.parent / 'metadata.yaml').unlink()
    file.write_bytes(data[:chunks[8][0] - 9])
    report = recover_log(file)
    assert not report['whole'] and not report['all_known'] and report['messages_lost'] == 0


def test_damaged_logs_at_random_beside_what_is_gone_in_truth():
    done = subprocess.run([sys.executable, str(FUZZ), '--logs', '36', '--seed', '5'],
                          capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]


def test_command(damaged, tmp_path, capsys):
    assert main(['recover', str(damaged[0]), '--out', str(tmp_path / 'out')]) == 1
    out = capsys.readouterr().out
    assert 'not closed' in out and 'messages of 2 topics saved' in out
    assert main(['info', str(tmp_path / 'out'), '--json']) == 0
    info = json.loads(capsys.readouterr().out)
    assert info['complete'] and info['problems'] == []
    (tmp_path / 'none.mcap').write_bytes(b'')
    for name, words in (('absent', 'does not exist'), ('none.mcap', 'is empty')):
        assert main(['recover', str(tmp_path / name)]) == 2
        assert words in capsys.readouterr().err
