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

"""Files that are written whole or not at all."""

import ast
import os
import resource
import signal
from pathlib import Path

import pytest
from places import ROOT

from msg_tools.whole_files import beside, reason, tried, write_text

PARTS = ('encoder_sim', 'encoder_reading', 'pointing_model', 'calibration', 'msg_tools',
         'telescope_mount.bridges.indi', 'telescope_mount.bridges.alpaca', 'telescope_mount')
#: what else writes files: none of them an output that a command is asked for, or one that grows
OTHERS = {
    'msg_tools/bag/chunks.py': 'a log grows; cut short it is readable',
    'telescope_mount/observing/night_file.py': 'grows by lines',
    'telescope_mount/input_files/image_folder.py': 'grows by lines',
    'telescope_mount/processes/node_processes.py': 'parameters of nodes, made for each night',
    'telescope_mount/cli.py': 'nobody',
    'telescope_mount/commands/options.py': 'nobody, and the standard output',
    'telescope_mount/commands/console.py': 'the standard output',
    'telescope_mount/processes/domain.py': 'a lock, which stays empty',
    'telescope_mount/processes/fork_server.py': 'its own outputs, which are a log',
    'pointing_model/runs/plate_solves/solvers.py': 'for the solver, in a folder of its own',
    'telescope_mount/bridges/indi/indi_camera.py': 'an image for the solver, in its folder',
}


def writes(node):
    """Whether a call may write a file that is not a `part` of `beside`."""
    name = getattr(node.func, 'attr', getattr(node.func, 'id', ''))
    owner = getattr(node.func, 'value', None)
    first = owner if isinstance(node.func, ast.Attribute) else node.args[0] if node.args else None
    words = [arg.value for arg in node.args if isinstance(arg, ast.Constant)
             and isinstance(arg.value, str)]
    if name in ('write_table', 'ParquetWriter', 'savefig'):
        return not any(getattr(arg, 'id', '') == 'part' for arg in node.args) and getattr(
            owner, 'id', '') != 'writer'
    if name in ('open', 'fdopen') and set(''.join(words[-1:])) & set('wax+'):
        return getattr(first, 'id', '') != 'part'
    return name in ('write_text', 'write_bytes') and isinstance(
        node.func, ast.Attribute) and getattr(first, 'id', '') != 'part'


def test_every_output_is_written_beside_and_put_in_place():
    found = {str(path.relative_to(ROOT)) for part in PARTS for path in (ROOT / part).rglob('*.py')
             if any(isinstance(node, ast.Call) and writes(node)
                    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))))}
    assert found == set(OTHERS)


@pytest.fixture
def small_disk():
    """Within the test no file grows beyond 100 bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


def test_what_was_there_stays_where_the_disk_is_full(tmp_path, small_disk):
    path = tmp_path / 'model.json'
    write_text(path, 'before')
    with pytest.raises(OSError, match='File too large') as refused:
        write_text(path, 'x' * 101)
    assert refused.value.filename == str(path)
    incomplete = []
    tried(incomplete, path, lambda path: write_text(path, 'x' * 101))
    tried(incomplete, tmp_path / 'page', lambda path: write_text(path, 'whole'))
    assert incomplete == [f'{path}: {reason(refused.value)}']
    assert 'ulimit -f' in incomplete[0]
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {
        'model.json': 'before', 'page': 'whole'}


def test_a_disk_that_refuses_at_the_end_is_heard(tmp_path, monkeypatch):
    """As of one over a network."""
    def full(file):
        raise OSError(28, 'No space left on device')
    monkeypatch.setattr(os, 'fsync', full)
    with pytest.raises(OSError, match='No space left'):
        write_text(tmp_path / 'page', 'x')
    assert list(tmp_path.iterdir()) == []


def test_rights_links_and_what_is_no_file_stay(tmp_path):
    path, link = tmp_path / 'model.json', tmp_path / 'link'
    path.write_text('before')
    path.chmod(0o640)
    link.symlink_to(path)
    write_text(link, 'after')
    assert link.is_symlink() and path.read_text() == 'after'
    assert path.stat().st_mode & 0o777 == 0o640
    with beside(os.devnull) as part:
        assert part == Path(os.devnull)
    with pytest.raises(FileNotFoundError) as refused:
        write_text(tmp_path / 'no' / 'page', 'x')
    assert refused.value.filename == str(tmp_path / 'no' / 'page')
