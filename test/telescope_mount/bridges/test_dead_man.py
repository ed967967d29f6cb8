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

"""Who commands has died: the mount is stopped by a process of its own."""

import socket
import threading
import time

import pytest
from fake_server import FakeServer, switch

from telescope_mount.bridges import dead_man
from telescope_mount.bridges.dead_man import DeadMan


def stopped(server):
    """Whether the mount was told to stop, and to stand."""
    sent = ' '.join(server.got)
    return '"ABORT">On' in sent and '"TRACK_OFF">On' in sent


def until(condition, seconds=10.0):
    """Whether something holds in time."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)  # polls: another process's doing
    return condition()


@pytest.mark.parametrize('silent', [False, True])
def test_a_mount_is_stopped_when_its_commander_dies_or_hangs(silent):
    with FakeServer() as server:
        process = DeadMan('localhost', server.port, 'Mount', 0.3)
        assert process.signal(False) and process.signal(True)
        if not silent:
            process.close()
        assert until(lambda: stopped(server))
        process.close()


def test_one_that_was_left_safely_is_not_stopped(monkeypatch):
    calls = []
    monkeypatch.setattr(dead_man, 'stop', lambda *to: calls.append(to) or True)
    for last in (dead_man.ARMED, dead_man.SAFE):
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.sendall(dead_man.SAFE + dead_man.ARMED + last)
            ours.shutdown(socket.SHUT_WR)
            dead_man.watch(theirs.fileno(), 'indi', 'host', 1, 'Mount')
    assert calls == [('indi', 'host', 1, 'Mount')]


def test_one_that_takes_up_its_track_is_stopped_again_at_once(monkeypatch):
    monkeypatch.setattr(dead_man, 'AGAIN', 3.0)
    monkeypatch.setattr(dead_man, 'TIMES', 1)
    with FakeServer() as server:
        thread = threading.Thread(target=dead_man.stop, args=('indi', 'localhost', server.port,
                                                              'Mount'))
        thread.start()
        assert until(lambda: stopped(server))
        server.say(switch('TELESCOPE_TRACK_STATE', {'TRACK_ON': 'On', 'TRACK_OFF': 'Off'}))
        assert until(lambda: sum('"ABORT">On' in text for text in server.got) == 2)
        server.drop()
        thread.join()
