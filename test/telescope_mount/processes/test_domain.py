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

import socket
import subprocess
import sys
from functools import partial

import pytest

from telescope_mount.processes import domain
from telescope_mount.processes.shared_memory import left_ports, sweep


def test_a_claimed_domain_is_taken_until_it_is_released():
    lock = domain.claim()
    assert 10 <= lock.number <= 99
    with pytest.raises(ValueError, match=f'domain {lock.number} is in use on this machine'):
        domain.claim(lock.number)
    lock.release()
    domain.claim(lock.number).release()


def test_two_never_get_the_same():
    locks = [domain.claim() for _ in range(5)]
    assert len({lock.number for lock in locks}) == 5
    for lock in locks:
        lock.release()


def test_another_process_is_kept_out_and_its_end_lets_go():
    program = ('from telescope_mount.processes import domain; lock = domain.claim(); '
               'print(lock.number, flush=True); input()')
    child = subprocess.Popen([sys.executable, '-c', program], stdin=subprocess.PIPE,
                             stdout=subprocess.PIPE, text=True)
    try:
        number = int(child.stdout.readline())
        with pytest.raises(ValueError, match='in use'):
            domain.claim(number)
    finally:
        child.kill()
        child.communicate()
    domain.claim(number).release()


def test_a_participant_that_holds_no_lock_is_seen():
    lock = domain.claim()
    number = lock.number
    lock.release()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(('0.0.0.0', 7400 + 250 * number + 10))
        with pytest.raises(ValueError, match='in use'):
            domain.claim(number)


@pytest.mark.parametrize('number', [-1, 102, 1000])
def test_numbers_outside_the_ports_are_refused(number):
    with pytest.raises(ValueError, match=f'domain {number}: must be 0 to 101'):
        domain.claim(number)


def test_a_lock_file_of_another_user_blocks_no_domain(tmp_path, monkeypatch):
    monkeypatch.setattr(domain.tempfile, 'gettempdir', lambda: str(tmp_path))
    number = domain.claim().number
    path = domain._lock_file(number)
    path.unlink()
    path.symlink_to(tmp_path / 'theirs')  # as little to be opened as what one may not write
    lock = domain.claim(number)
    with pytest.raises(ValueError, match='in use'):
        domain.claim(number)
    lock.release()
    assert not (tmp_path / 'theirs').exists()


def test_none_free_is_said(monkeypatch):
    monkeypatch.setattr(domain, '_lock', lambda number: None)
    with pytest.raises(ValueError, match='no ROS domain from 10 to 99 is free'):
        domain.claim()


def test_what_a_dead_graph_left_in_a_domain_that_none_has_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(domain.tempfile, 'gettempdir', lambda: str(tmp_path))
    folder = tmp_path / 'shm'
    folder.mkdir()
    monkeypatch.setattr(domain, 'left_ports', partial(left_ports, folder))
    monkeypatch.setattr(domain, 'sweep', lambda ports: sweep(ports, folder, 10.0))
    dead, used, foreign = (7400 + 250 * number for number in (97, 98, 99))
    for port in (dead, used, foreign):
        (folder / f'fastrtps_port{port}').touch()
    domain._lock_file(97).touch()
    with domain._lock(98):
        lock = domain.claim(96)
        assert {path.name for path in folder.iterdir()} == {
            f'fastrtps_port{used}', f'fastrtps_port{foreign}'}
        lock.release()
    domain.claim(97).release()  # nothing of it is held
