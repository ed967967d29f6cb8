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

"""Where received messages go, tried without a graph."""

import logging
import subprocess
import sys

import pytest

from msg_tools.bag import BagReader, BagWriter
from msg_tools.bag.bag_pair import BEFORE_CLOCK, BagPair

STATE, TEXT, TRUTH = '/mount/state', '/mount/text', '/mount/truth/text'


@pytest.fixture
def make(demo, tmp_path):
    def build(**options):
        made = BagPair(BagWriter, str(tmp_path / 'log'), str(tmp_path / 'log_truth'),
                       logging.getLogger('pair'), **options)
        for name in (TEXT, STATE):
            made.add_topic(name, demo.TEXT, [], 'RIHS01_wire')
        made.put = lambda word, when=10**18, name=TEXT, publish_time=7: made.take(
            name, demo.text(word), when, publish_time, 1, name == STATE)
        return made
    return build


@pytest.fixture
def told(demo, tmp_path):
    def read(folder='log'):
        log = BagReader(tmp_path / folder)
        assert log.complete and log.problems == []
        return [(m.topic, m.data[8:-1].decode(), m.log_time) for m in log.messages()]
    return read


def test_the_truth_has_a_bag_of_its_own_from_its_first_topic_on(make, told, demo, tmp_path):
    pair = make()
    pair.add_parameters('/mount/early', {'a': '1'})
    assert not (tmp_path / 'log_truth').exists()
    pair.add_topic(TRUTH, demo.TEXT, [], None)
    pair.add_parameters('/mount/late', {'b': '2', 'secret': '3'}, {'secret'})
    pair.put('seen')
    pair.put('true', name=TRUTH)
    pair.attach('reference_model.json', 'application/json', b'{}')
    pair.close(('model.json', 'application/json', b'[]'))
    assert told() == [(TEXT, 'seen', 10**18)]
    assert told('log_truth') == [(TRUTH, 'true', 10**18)]
    both = [BagReader(tmp_path / name) for name in ('log', 'log_truth')]
    for log in both:
        assert {'parameters /mount/early', 'parameters /mount/late'} <= set(log.metadata)
    assert [set(log.metadata['parameters /mount/late']) for log in both] == [
        {'b'}, {'b', 'secret'}]
    assert [a.name for a in both[0].attachments] == ['reference_model.json', 'model.json']
    assert both[1].attachments == [] and both[1].has_truth and not both[0].has_truth
    assert [t.type_hash for log in both for t in log.topics] == [
        'RIHS01_wire', 'RIHS01_wire', demo.HASHES[demo.TEXT]]


def test_what_came_before_the_clock_gets_its_time(make, told):
    pair = make()
    pair.put('early', when=0)
    assert pair.written == 0
    pair.put('late', when=5 * 10**9)
    pair.close()
    assert told() == [(TEXT, 'early', 5 * 10**9), (TEXT, 'late', 5 * 10**9)]


def test_without_a_clock_the_time_of_the_source_is_the_best_there_is(make, told, caplog):
    pair = make()
    pair.put('x' * BEFORE_CLOCK, when=0, publish_time=3)
    assert 'no /clock' in caplog.text and pair.written == 1
    pair.put('never', when=0, publish_time=-1)
    pair.close()
    assert [when for *_, when in told()] == [0, 3]


def test_a_pause_keeps_what_is_latched(make, told):
    pair = make()
    assert pair.pause() == (True, 'paused after 0 messages')
    assert pair.is_paused() == (True, 'paused') and pair.state == 'paused'
    for word in ('one', 'two'):
        pair.put(word)
        pair.put(word, name=STATE)
    assert pair.resume()[1].startswith('recording; 1 latched')
    assert pair.is_paused() == (False, 'recording') and pair.state == 'recording'
    assert 'log_1.mcap' in pair.split_bagfile()[1]
    pair.close()
    assert told() == [(STATE, 'two', 10**18)]


def test_without_a_memory_there_is_no_snapshot(make):
    assert make().snapshot()[0] is False


def test_the_newest_are_kept_for_a_snapshot(make, told):
    pair = make(snapshot_bytes=400)
    for number in range(10):
        pair.put(str(number))
    assert pair.state == 'snapshot' and pair.written == 0
    done, words = pair.snapshot()
    assert done and words == f'{pair.written} messages written' and 0 < pair.written < 5
    pair.put('too late')
    pair.close()
    assert [word for _, word, _ in told()] == [str(10 - i) for i in range(pair.written, 0, -1)]


def test_a_disk_that_refuses_ends_its_bag_with_a_reason_and_no_other(make, told, demo, monkeypatch,
                                                                     caplog):
    pair = make()
    pair.add_topic(TRUTH, demo.TEXT, [], 'RIHS01_wire')
    write = BagWriter.write

    def full(bag, *args):
        if bag is pair.bag:
            raise OSError(28, 'No space left on device')
        write(bag, *args)
    monkeypatch.setattr(BagWriter, 'write', full)
    pair.put('one')
    reason = 'log: recording stopped: No space left on device; free some, or write elsewhere'
    assert pair.error == reason and pair.state == 'stopped'
    assert 'what was written before is safe' in caplog.text
    pair.put('two')
    assert pair.written == 0
    pair.put('three', name=TRUTH)
    assert pair.written == 1
    assert pair.split_bagfile() == (False, reason)
    pair.flush()
    with pytest.raises(OSError, match='^log: recording stopped: No space left'):
        pair.close(('model.json', 'application/json', b''))
    assert [word for _, word, _ in told('log_truth')] == ['three']


def test_a_bag_that_cannot_be_closed_is_told(make, monkeypatch):
    pair = make()

    def full(bag):
        raise OSError(27, 'File too large')
    monkeypatch.setattr(BagWriter, 'close', full)
    with pytest.raises(OSError, match='^log: recording stopped: File too large'):
        pair.close()


def test_it_knows_no_ros():
    code = ('import sys; sys.modules["rclpy"] = None; import msg_tools.bag.bag_pair; '
            'import msg_tools.bag')
    assert subprocess.run([sys.executable, '-c', code], timeout=60).returncode == 0
