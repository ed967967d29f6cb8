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

"""Shared by the tests: logs with messages of a package of their own, which need no ROS."""

import json
import os
import struct
from types import SimpleNamespace

import pytest

from msg_tools.bag import BagWriter

PAIR = 'demo_msgs/msg/Pair'
TEXT = 'demo_msgs/msg/Text'
HASHES = {  # computed by rosbags, which checks them when it opens a folder
    PAIR: 'RIHS01_a5c211e741a45004ee663428c5fa0de3d27ffc3978e1fc5d16fa11c4724ab8ec',
    TEXT: 'RIHS01_177da1b91cd2babed7aff7af78f01216f6965effb348d8888fcab6f2a639552d',
}
LATCHED = {'history': 'keep_last', 'depth': 1, 'durability': 'transient_local'}


@pytest.fixture(autouse=True)
def no_sync(monkeypatch):
    """Tests make hundreds of logs; waiting for the disk shows nothing."""
    monkeypatch.setattr(os, 'fsync', lambda number: None)


@pytest.fixture
def demo(tmp_path_factory, monkeypatch):
    """Message types `PAIR` and `TEXT`, their bytes, and ``write_night(folder, ...)``."""
    prefix = tmp_path_factory.getbasetemp() / 'demo_prefix'
    folder = prefix / 'share' / 'demo_msgs' / 'msg'
    if not folder.exists():
        folder.mkdir(parents=True)
        (folder / 'Inner.msg').write_text('uint8 ONE=1\nfloat64 value  # rad\n')
        (folder / 'Pair.msg').write_text(
            '# Two of them, other/Type in a comment\nInner first\ndemo_msgs/Inner[] more\n'
            'string<=8 name\n')
        (folder / 'Text.msg').write_text('string data\n')
        (folder / 'Broken.msg').write_text('absent_msgs/Nothing x\n')
        for name in ('Pair', 'Text'):
            (folder / f'{name}.json').write_text(json.dumps({'type_hashes': [
                {'type_name': 'other/msg/Dep', 'hash_string': 'RIHS01_00'},
                {'type_name': f'demo_msgs/msg/{name}',
                 'hash_string': HASHES[f'demo_msgs/msg/{name}']}]}))
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    return SimpleNamespace(PAIR=PAIR, TEXT=TEXT, HASHES=HASHES, LATCHED=LATCHED, pair=pair,
                           text=text, write_night=write_night)


def pair(value):
    """CDR of a Pair: first = value, more = [value + 1], name = 'ab'."""
    return b'\0\1\0\0' + struct.pack('<dI4xdI', value, 1, value + 1.0, 3) + b'ab\0'


def text(data):
    return b'\0\1\0\0' + struct.pack('<I', len(data) + 1) + data.encode() + b'\0'


def write_night(folder, n=500, close=True, **options):
    """Two topics, `n` pairs 1 ms apart and 5 texts whose log time runs backwards."""
    writer = BagWriter(folder, **options)
    writer.add_topic('/mount/pair', PAIR, [{'depth': 50}])
    writer.add_topic('/mount/text', TEXT, [LATCHED, {'reliability': 'best_effort'}])
    for i in range(n):
        writer.write('/mount/pair', pair(i), 10**18 + i * 10**6, 10**18 + i * 10**6 - 77, i)
        if i % 100 == 50:
            writer.write('/mount/text', text(f't{i}'), 10**18 + (n - i) * 10**6 + 5, 10**18)
    if close:
        writer.close()
    return writer
