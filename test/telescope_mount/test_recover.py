import hashlib
import json
import struct

import pytest
from mcap.writer import Writer

from msg_tools.bag import BagReader, BagWriter
from telescope_mount.cli import main
from telescope_mount.commands.recover import recover_log

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


def test_command(damaged, tmp_path, capsys):
    assert main(['recover', str(damaged[0]), '--out', str(tmp_path / 'out')]) == 0
    out = capsys.readouterr().out
    assert 'not closed' in out and 'messages of 2 topics saved' in out
    assert main(['info', str(tmp_path / 'out'), '--json']) == 0
    info = json.loads(capsys.readouterr().out)
    assert info['complete'] and info['problems'] == []
    (tmp_path / 'none.mcap').write_bytes(b'')
    for name, words in (('absent', 'does not exist'), ('none.mcap', 'is empty')):
        assert main(['recover', str(tmp_path / name)]) == 2
        assert words in capsys.readouterr().err
