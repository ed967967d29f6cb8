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
"""A night in SQLite, as ``ros2 bag record -s sqlite3`` leaves it, in every command that reads."""

import json
import shutil
import sqlite3
from collections import Counter
from contextlib import closing

import pytest
import yaml
import zstandard
from places import ROOT

from msg_tools.bag import BagReader
from msg_tools.bag import log as log_reader
from telescope_mount.cli import main
from telescope_mount.commands.info import log_info
from telescope_mount.input_files.run_loader import load_run
from telescope_mount.log_check.log_replay import _newer

NIGHT = ROOT / 'examples' / 'night' / 'bag'


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """That night in SQLite."""
    folder, log = tmp_path_factory.mktemp('sqlite') / 'sq', BagReader(NIGHT)
    folder.mkdir()
    with closing(sqlite3.connect(folder / 'sq.db3')) as base:
        base.executescript(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
            'serialization_format TEXT, offered_qos_profiles TEXT, type_description_hash TEXT);'
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
            'data BLOB);'
            'CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding '
            'TEXT, encoded_message_definition TEXT, type_description_hash TEXT);')
        numbers = {topic.name: number for number, topic in enumerate(log.topics)}
        for topic in log.topics:
            base.execute('INSERT INTO topics VALUES(?, ?, ?, "cdr", ?, ?)', (
                numbers[topic.name], topic.name, topic.type, yaml.safe_dump(topic.qos),
                topic.type_hash))
            schema = log.schema_of(topic.name, topic.type)[0]
            base.execute('INSERT INTO message_definitions VALUES(NULL, ?, "ros2msg", ?, "")', (
                topic.type, schema.data.decode()))
        base.executemany('INSERT INTO messages VALUES(NULL, ?, ?, ?)', (
            (numbers[m.topic], m.log_time, m.data) for m in log.messages()))
        base.commit()
    (folder / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': {
        'version': 4, 'storage_identifier': 'sqlite3', 'relative_file_paths': ['sq.db3'],
        'duration': {'nanoseconds': log.end_time - log.start_time},
        'starting_time': {'nanoseconds_since_epoch': log.start_time},
        'message_count': log.message_count}}))
    return folder


@pytest.fixture
def bag(made, tmp_path):
    return shutil.copytree(made, tmp_path / 'sq')


def test_its_dashboard_is_that_of_the_log(bag, tmp_path, capsys):
    states = []
    for number, log in enumerate((NIGHT, bag, bag / 'sq.db3')):
        path = tmp_path / f'{number}.json'
        assert main(['watch', str(log), '--json', str(path)]) == 0, capsys.readouterr().err
        states.append(json.loads(path.read_text()))
        states[-1].pop('source')
    assert states[0] == states[1] == states[2]


def test_it_is_fitted_verified_and_recovered_as_the_log(bag, tmp_path, capsys):
    run, same = load_run(NIGHT), load_run(bag / 'sq.db3')
    assert all((run[name] == same[name]).all() for name in ('az', 'el', 'az_enc', 'el_enc'))
    assert main(['export', str(bag), str(tmp_path / 'run.csv')]) == 0
    assert main(['verify', str(bag), '--seed', '1']) == 0
    assert main(['recover', str(bag), '--out', str(tmp_path / 'mcap')]) == 0
    assert 'nothing is lost' in capsys.readouterr().out
    new, old = BagReader(tmp_path / 'mcap'), BagReader(NIGHT)
    assert Counter((m.topic, m.log_time, m.data) for m in new.messages()) == Counter(
        (m.topic, m.log_time, m.data) for m in old.messages())
    assert _newer(new, '/mount/observation') == len(list(new.messages('/mount/observation')))


def test_it_has_no_checksums_and_tells_what_is_missing(bag, tmp_path, capsys):
    count = log_info(NIGHT)['messages']
    assert main(['info', str(bag)]) == 0
    out = capsys.readouterr().out
    assert 'whole' in out and 'checksum is right' not in out
    with closing(sqlite3.connect(bag / 'sq.db3')) as base:
        base.execute('DELETE FROM messages WHERE id > 1000')
        base.commit()
    assert main(['info', str(bag)]) == 1
    out = ' '.join(capsys.readouterr().out.split())
    assert f'sq.db3 has 1000 messages, metadata.yaml lists {count}: {count - 1000} are missing' \
        in out and 'sq.db3-wal, where the newest may be, is not there' in out
    assert main(['recover', str(bag), '--out', str(tmp_path / 'mcap')]) == 1
    assert f'{count - 1000} of {count} messages are lost' in capsys.readouterr().out


def test_what_a_killed_recorder_had_not_put_into_the_file_is_read(bag, tmp_path, capsys):
    file, kept = bag / 'sq.db3', tmp_path / 'killed'
    kept.mkdir()
    with closing(sqlite3.connect(file)) as base:
        newest = base.execute('SELECT * FROM messages WHERE id > 1000').fetchall()
        base.execute('DELETE FROM messages WHERE id > 1000')
        base.commit()
        base.execute('PRAGMA journal_mode = WAL').fetchall()
        base.execute('PRAGMA wal_checkpoint(TRUNCATE)').fetchall()
        base.executemany('INSERT INTO messages VALUES(?, ?, ?, ?)', newest)
        base.commit()
        for one in bag.glob('sq.db3*'):  # as a kill leaves them, or without what is shared
            shutil.copy(one, kept)
        shutil.copy(bag / 'metadata.yaml', kept)
    (kept / 'sq.db3-shm').unlink()
    before = {one.name: one.read_bytes() for one in kept.iterdir()}
    assert main(['info', str(kept)]) == 1
    assert 'sq.db3-wal is read with it: the recorder' in ' '.join(capsys.readouterr().out.split())
    assert main(['recover', str(kept), '--out', str(tmp_path / 'mcap')]) == 0
    assert BagReader(tmp_path / 'mcap').message_count == log_info(NIGHT)['messages']
    assert {one.name: one.read_bytes() for one in kept.iterdir()} == before


def test_messages_and_files_that_were_packed(bag, tmp_path, capsys, monkeypatch):
    same = load_run(bag)
    with closing(sqlite3.connect(bag / 'sq.db3')) as base:
        base.create_function('pack', 1, zstandard.ZstdCompressor().compress)
        base.execute('UPDATE messages SET data = pack(data)')
        base.commit()
    assert (load_run(bag)['az_enc'] == same['az_enc']).all()
    assert main(['watch', str(bag), '--json', str(tmp_path / 'state.json')]) == 0
    assert main(['recover', str(bag), '--out', str(tmp_path / 'mcap')]) == 0
    new, old = BagReader(tmp_path / 'mcap'), BagReader(NIGHT)
    assert Counter((m.topic, m.data) for m in new.messages()) == Counter(
        (m.topic, m.data) for m in old.messages())
    monkeypatch.setattr(log_reader, 'MIN_EXPANDED', 0)  # as little as a bomb may fill
    monkeypatch.setattr(log_reader, 'EXPANSION', 0)
    assert main(['recover', str(bag), '--out', str(tmp_path / 'bomb')]) == 1
    monkeypatch.undo()
    (bag / 'sq.db3').rename(bag / 'sq.db3.zstd')
    for log in (bag, bag / 'sq.db3.zstd'):
        assert main(['info', str(log)]) == 2
        assert 'first: zstd -d' in ' '.join(capsys.readouterr().err.split())
    (bag / 'sq.db3.zstd').rename(bag / 'sq.db3')
    meta = bag / 'metadata.yaml'
    meta.write_text(meta.read_text().replace('sq.db3', 'sq.db3.zstd'))
    assert log_info(bag)['problems'] == []
