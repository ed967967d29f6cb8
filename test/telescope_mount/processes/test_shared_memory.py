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

import os
import subprocess
import sys
from pathlib import Path

import pytest

from telescope_mount.processes import domain
from telescope_mount.processes.shared_memory import FOLDER, sweep

PARTICIPANT = """
import sys
import rclpy
from rclpy.context import Context
from rclpy.node import Node
context = Context()
rclpy.init(context=context, domain_id=int(sys.argv[1]))
node = Node(sys.argv[2], context=context)
print('up', flush=True)
sys.stdin.read()
node.destroy_node()
context.shutdown()
"""
NAMES = 'fastrtps_0123456789abcdef', 'fastrtps_0123456789abcdef_el', 'sem.fastrtps_port7411_mutex'


@pytest.fixture
def folder(tmp_path):
    """A folder of its own, as memory if it can be."""
    for name in NAMES:
        (tmp_path / name).write_bytes(b'left')
    return tmp_path


def test_what_nobody_has_open_is_removed_and_nothing_else(folder):
    others = 'fastrtps_0123', 'notes_0123456789abcdef', 'fastrtps_port7411_el.old'
    for name in others:
        (folder / name).write_text('of somebody')
    assert sweep(range(7400, 7650), folder, 10.0) == 3
    assert sorted(path.name for path in folder.iterdir()) == sorted(others)


def test_ports_of_another_domain_stay(folder):
    assert sweep(range(7650, 7900), folder, 10.0) == 2
    assert [path.name for path in folder.iterdir()] == [NAMES[2]]


@pytest.mark.parametrize('mode', ['rb', 'r+b'])
def test_what_another_process_has_open_stays(folder, mode):
    with subprocess.Popen(
            [sys.executable, '-c', 'import sys; f = open(*sys.argv[1:]); print("open", flush=True);'
             ' sys.stdin.read()', str(folder / NAMES[0]), mode],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == 'open\n'
        assert sweep((), folder, 10.0) == 1
        assert (folder / NAMES[0]).exists()
        other.communicate('')
    assert sweep((), folder, 10.0) == 1


def test_a_link_and_a_file_of_another_user_stay(folder, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp('elsewhere') / 'file'
    elsewhere.write_text('of somebody')
    (folder / NAMES[1]).unlink()
    (folder / NAMES[1]).symlink_to(elsewhere)
    if os.geteuid() == 0:
        os.chown(folder / NAMES[0], 65534, 65534)
    else:
        (folder / NAMES[0]).unlink()
    assert sweep((), folder, 10.0) == 0
    assert elsewhere.read_text() == 'of somebody'


def test_it_takes_no_longer_than_it_may_and_a_system_without_the_folder_has_nothing(folder):
    assert sweep((), folder, -1.0) == 0
    assert sweep((), folder / 'none') == 0


def ports(number):
    """Of a domain."""
    return range(7400 + 250 * number, 7650 + 250 * number)


def mapped(pid):
    """Files of shared memory that a process has."""
    lines = Path(f'/proc/{pid}/maps').read_text().splitlines()
    paths = {Path(line.split()[5]) for line in lines if f'{FOLDER}/' in line}
    return {path for path in paths if 'fastrtps_' in path.name}


@pytest.mark.usefixtures('ros_domain')  # sets what the processes shall have
@pytest.mark.skipif(not os.path.isdir(FOLDER), reason='no shared memory in files')
def test_a_process_that_was_killed_leaves_nothing_and_one_that_lives_keeps_all():
    def start(name, number):
        child = subprocess.Popen(
            [sys.executable, '-c', PARTICIPANT, str(number), name], text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert child.stdout.readline() == 'up\n'
        return child

    # in domains of their own: one that has met another process has its memory open, too
    locks = domain.claim(), domain.claim()
    numbers = [lock.number for lock in locks]
    dead, alive = map(start, ('dead', 'alive'), numbers)
    try:
        left, kept = mapped(dead.pid), mapped(alive.pid)
        own = {path for path in left if 'port' not in path.name}
        assert own and kept  # the test looks at something
        dead.kill()
        dead.communicate()
        assert all(path.exists() for path in own)
        # not world writable, whatever the umask
        assert not any(path.stat().st_mode & 0o022 for path in left | kept if path.exists())
        sweep({port for number in numbers for port in ports(number)}, budget=10.0)
        # from 7000 on ports are of all domains
        assert not [path.name for path in left if path.exists() and 'port70' not in path.name]
        assert all(path.exists() for path in kept)
        alive.communicate('')
        assert alive.returncode == 0
    finally:
        for child in (dead, alive):
            child.kill()
            child.communicate()
        for lock in locks:
            lock.release()
