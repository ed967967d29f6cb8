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

"""Files that are damaged or made with intent: a clear error or a counted skip, in bounds.

``benchmarks/log_fuzz.py`` gives each input 2 s of processor time and 500 MB, and judges it; here
it runs with smaller bombs and few random inputs.
"""

import signal
import subprocess
import sys

import pytest
import zstandard
from mcap.writer import Writer
from places import ROOT

from msg_tools.bag import BagReader, BagWriter
from msg_tools.bag import file as bag_file
from msg_tools.bag import reader as bag_reader
from msg_tools.bag.compression import decompress
from msg_tools.bag.metadata import listed_files
from msg_tools.bag.ros_schema import load_qos

FUZZ = ROOT / 'benchmarks' / 'log_fuzz.py'
LINE = '=' * 80 + '\n'


@pytest.mark.parametrize('what', [
    ('--crafted', '--scale', '200'), ('--inputs', '40', '--seed', '11')])
def test_nothing_escapes(what):
    done = subprocess.run([sys.executable, str(FUZZ), *what], capture_output=True, text=True,
                          timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    assert ' 0 failures' in done.stdout


def test_the_judge_can_find_something(tmp_path):
    """A reader that fails, hangs or writes elsewhere is caught."""
    code = f"""
import sys
from pathlib import Path
sys.path.insert(0, {str(FUZZ.parent)!r})
import log_fuzz
log_fuzz.CPU_SECONDS = 0.2
log_fuzz.limit()
def fails(path, scratch):
    yield lambda: 1 / 0
def hangs(path, scratch):
    yield lambda: [None for _ in iter(int, 1)]
def writes(path, scratch):
    yield lambda: (scratch.parent / 'evil').write_text('x')
def eats(path, scratch):
    yield lambda: bytearray(600_000_000)
def talks(path, scratch):
    def step():
        raise ValueError('two' + chr(10) + 'lines')
    yield step
for wrong in (fails, hangs, writes, eats, talks):
    assert log_fuzz.survives(Path('x'), wrong), wrong
"""
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


def _file(tmp_path, chunks, **options):
    file = tmp_path / 'x.mcap'
    with open(file, 'wb') as stream:
        writer = Writer(stream, **options)
        writer.start('ros2', 'test')
        schema = writer.register_schema('a/msg/B', 'ros2msg', b'')
        channel = writer.register_channel('/t', 'cdr', schema)
        for number, data in chunks:
            writer.add_message(channel, number, data, number)
        writer.finish()
    return file


def test_chunks_of_one_time_are_not_all_held(tmp_path, monkeypatch):
    """Chunks whose times overlap, each with a first message far back."""
    rows = [row for i in range(20) for row in ((0, bytes(5000)), (1000 + i, bytes(5000)))]
    file = _file(tmp_path, rows, chunk_size=9000)
    assert len(list(BagReader(file).messages())) == 40
    monkeypatch.setattr(bag_reader, 'MAX_HELD', 50_000)
    reader = BagReader(file)
    assert 5 < len(list(reader.messages())) < 40
    assert any('overlap in time' in problem for problem in reader.problems)


def test_files_that_grow_beyond_belief(tmp_path, monkeypatch):
    file = _file(tmp_path, [(i, bytes(20_000)) for i in range(50)], chunk_size=10_000)
    monkeypatch.setattr(bag_file, 'MIN_EXPANDED', 10_000)
    monkeypatch.setattr(bag_file, 'EXPANSION', 10)
    reader = BagReader(file)
    assert 0 < len(list(reader.messages())) < 50
    assert any('expands to more than' in problem for problem in reader.problems)


def test_crowds_of_records(tmp_path, monkeypatch):
    file = _file(tmp_path, [(i, b'') for i in range(5000)], chunk_size=50_000)
    file.write_bytes(file.read_bytes()[:-40])
    assert BagReader(file).message_count == 5000
    monkeypatch.setattr(bag_file, 'MIN_RECORDS', -file.stat().st_size + 2000)
    reader = BagReader(file)
    assert reader.message_count < 5000
    assert any('more records than' in problem for problem in reader.problems)


def test_window_of_a_frame_that_wants_gigabytes(tmp_path):
    with pytest.raises(ValueError, match='damaged'):
        decompress(b'\x28\xb5\x2f\xfd\x00\xa8\x09\0\0x', 'zstd', 2**20)
    sound = zstandard.ZstdCompressor().compress(b'x' * 100)
    assert decompress(sound, 'zstd', 100) == b'x' * 100


@pytest.mark.parametrize('text', [
    '[' * 50_000, '- ' * 30_000, '&a [*a]', '- 5', 'x: 1', '- {depth: {}}', '- {history: 99}',
    '\0', '- {deadline: 1e400}', 'y' * 70_000])
def test_qos_text(text):
    with pytest.raises(ValueError) as error:
        load_qos(text)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize('content', [
    b'[' * 10**6, b'- ' * 10**6, b'\xff\xfe', b'', b'a: [', b'5', b'x' * (5 * 2**20),
    b'rosbag2_bagfile_information: {relative_file_paths: {}}'])
def test_metadata_file(tmp_path, content):
    (tmp_path / 'metadata.yaml').write_bytes(content)
    names, problem = listed_files(tmp_path)
    assert names == {} and problem and '\n' not in problem


@pytest.mark.parametrize('definition', [
    'Inner[] x\n' + LINE + 'MSG: a/Inner\nuint8[16] bytes\n',
    'Inner[4000000000] x\n' + LINE + 'MSG: a/Inner\nOther o\n' + LINE
    + 'MSG: a/Other\nuint8[9] b\n',
    'Inner[] x' + LINE + 'MSG: a/Inner\nuint8[16] bytes\n',  # a line that ends in the middle
    'Inner[] x\n' + LINE + 'MSG: a/Inner\nuint8[0] bytes\n',
    'Inner[] x\n' + LINE + 'MSG: a/Inner\nuint8 A=1\n',
    'Inner[] x\n' + LINE + 'MSG: a/Inner\n',
    'B x\n', 'B[] x\n', 'string[] x\n', 'wstring x\n', 'float64[4000000000] x\n',
    'uint8[] x\n', 'string x\n', 'int32 x ' * 1000, 'int32 x\n' * 100_000,
])
def test_decoding_ends(tmp_path, definition):
    """Each would be decoded for ever, or beyond the message, if it were taken at its word."""
    pytest.importorskip('mcap_ros2')
    with BagWriter(tmp_path / 'b') as writer:
        writer.add_foreign_topic('/t', 'a/msg/B', [], definition.encode(), '')
        writer.write('/t', b'\0\1\0\0' + b'\xfe' * 2000, 1, 1)
    reader = BagReader(tmp_path / 'b')
    signal.setitimer(signal.ITIMER_PROF, 20.0)  # ends the session where decoding does not
    try:
        assert list(reader.messages(decode=True)) == []
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    assert len(reader.problems) >= 1


def test_a_message_that_is_whole_is_decoded(tmp_path):
    pytest.importorskip('mcap_ros2')
    with BagWriter(tmp_path / 'b') as writer:
        writer.add_foreign_topic(
            '/t', 'a/msg/B', [], ('Inner[] x\n' + LINE + 'MSG: a/Inner\nuint8[3] n\n').encode(),
            '')
        writer.write('/t', b'\0\1\0\0\2\0\0\0abcdef', 1, 1)
    (row,) = BagReader(tmp_path / 'b').messages(decode=True)
    assert [bytes(inner.n) for inner in row.data.x] == [b'abc', b'def']
