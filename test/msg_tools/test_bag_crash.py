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

"""What a crash costs: never more than the last second, and never what lies before."""

import os
import struct
from types import SimpleNamespace

import pytest

from msg_tools.bag import BagReader, BagWriter, chunks
from msg_tools.bag import writer as writer_module

PERIOD = 0.5  # s, the logger's default
STEP = 0.01  # s between messages


@pytest.fixture
def recording(demo, tmp_path, monkeypatch):
    """12 s of messages on a clock of our own; (file, [(time, bytes written, bytes synced)])."""
    now, synced, states = [1000.0], [0], []
    fake = SimpleNamespace(monotonic=lambda: now[0])
    monkeypatch.setattr(writer_module, 'time', fake)
    fsync = os.fsync

    def sync(number):
        synced[0] = max(synced[0], os.fstat(number).st_size) if number == file() else synced[0]
        fsync(number)

    def file():
        return open_log[0]._out._stream.fileno() if open_log else -1
    monkeypatch.setattr(chunks.os, 'fsync', sync)
    open_log = []
    open_log.append(BagWriter(tmp_path / 'b', chunk_seconds=PERIOD, chunk_size=2000))
    open_log[0].refresh()
    open_log[0].add_topic('/t', demo.PAIR)
    flushed = now[0]
    for i in range(1200):
        open_log[0].write('/t', demo.pair(i), i, i)
        if now[0] - flushed >= PERIOD:
            flushed = now[0]
            open_log[0].refresh()
        states.append((now[0], os.path.getsize(open_log[0].file), synced[0]))
        now[0] += STEP
    yield open_log[0].file, states
    monkeypatch.undo()
    open_log[0].close()


@pytest.mark.parametrize('what', ['killed', 'power cut'])
def test_at_most_the_last_second_is_lost(demo, recording, tmp_path, what):
    file, states = recording
    whole = file.read_bytes()
    cut = tmp_path / 'cut.mcap'
    for number in range(0, len(states), 37):
        size = states[number][1 if what == 'killed' else 2]
        cut.write_bytes(whole[:size])
        rows = [row.log_time for row in BagReader(cut).messages()]
        assert rows == list(range(len(rows)))
        assert len(rows) >= number + 1 - 1.0 / STEP
    assert size > len(whole) / 2


def chunk_ends(data):
    """[end, messages, start] of every chunk of an MCAP file, and the ends of all its records."""
    pos, chunks, ends = 8, [], [8]
    while pos + 9 <= len(data):
        opcode, length = struct.unpack_from('<BQ', data, pos)
        if opcode == 7:  # a message index: 16 bytes for each message
            chunks[-1][1] += (length - 6) // 16
        pos += 9 + length
        if opcode == 6:
            chunks.append([pos, 0, pos - 9 - length])
        ends.append(pos)
    return chunks, ends


@pytest.mark.parametrize('compression', ['zstd', 'none'])
def test_every_whole_chunk_survives_a_cut(demo, tmp_path, compression):
    file = demo.write_night(
        tmp_path / 'night', n=600, chunk_size=1500, compression=compression).file
    whole = file.read_bytes()
    chunks, ends = chunk_ends(whole)
    assert len(chunks) > 20 and sum(n for _, n, _ in chunks) == 606
    cut = tmp_path / 'cut.mcap'
    for size in sorted({*ends, *range(1000, len(whole), 1000), *(e - 1 for e in ends[::7])}):
        cut.write_bytes(whole[:size])
        reader = BagReader(cut)
        found = len(list(reader.messages()))
        safe = sum(n for end, n, _ in chunks if end <= size)
        assert found == reader.message_count
        if compression == 'none':
            assert found >= safe
        else:
            following = [n for end, n, _ in chunks if end > size][:1]
            assert safe <= found <= safe + sum(following)
        assert reader.complete is (size == len(whole))


def test_damage_in_the_middle_costs_one_chunk(demo, tmp_path):
    """A record whose length is nonsense would hide all that follows it."""
    for compression in ('zstd', 'lz4', 'none'):
        folder = tmp_path / compression
        file = demo.write_night(folder, n=600, chunk_size=2000, compression=compression).file
        data = bytearray(file.read_bytes())
        chunks, _ = chunk_ends(data)
        victim = chunks[5][2]
        struct.pack_into('<Q', data, victim + 1, 2**62)
        file.write_bytes(data[:-50])  # nor is there an index
        reader = BagReader(file)  # its checksum is still right
        assert len(list(reader.messages())) == 606 and not reader.lost
        assert any('damaged head' in problem for problem in reader.problems)
        data[chunks[5][0] - 30] ^= 255
        file.write_bytes(data[:-50])
        reader = BagReader(file)
        lost = 606 - len(list(reader.messages()))
        assert 0 < lost <= max(n for _, n, _ in chunks)
        assert any('damaged' in problem for problem in reader.problems)
        (_, part), = reader.lost
        assert part.offset == victim and sum(part.counts.values()) == lost


def test_first_chunk_destroyed_does_not_take_the_types_along(demo, tmp_path):
    file = demo.write_night(tmp_path / 'night', chunk_size=2000).file
    data = bytearray(file.read_bytes())
    first = data.index(b'\x04\0\0\0zstd')
    data[first:first + 60] = bytes(60)
    file.write_bytes(data[:-50])
    reader = BagReader(file)
    assert {topic.name for topic in reader.topics} == {'/mount/pair', '/mount/text'}
    assert len(list(reader.messages(decode=True))) > 400


def test_refresh_in_the_background(demo, tmp_path):
    writer = BagWriter(tmp_path / 'b')
    writer.add_topic('/t', demo.PAIR)
    for i in range(50):
        writer.write('/t', demo.pair(i), i, i)
        writer.refresh(wait=False)
        assert BagReader(writer.file).message_count == i + 1
    writer.split()
    writer.write('/t', demo.pair(50), 50, 50)
    writer.close()
    assert [row.data for row in BagReader(tmp_path / 'b').messages()] == [
        demo.pair(i) for i in range(51)]


def test_a_sync_that_fails_is_told(demo, tmp_path, monkeypatch):
    writer = BagWriter(tmp_path / 'b')
    writer.add_topic('/t', demo.PAIR)

    def fail(number):
        raise OSError(5, 'Input/output error')
    monkeypatch.setattr(chunks.os, 'fsync', fail)
    writer.write('/t', demo.pair(0), 0, 0)
    with pytest.raises(OSError, match='Input/output'):
        for _ in range(1000):
            writer.refresh(wait=False)
            writer._syncing.exception()
    monkeypatch.undo()
    writer.close()
    assert BagReader(tmp_path / 'b').message_count == 1
