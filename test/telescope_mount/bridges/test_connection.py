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

"""What a server is needed for is tried again until it is there, and at once when it is woken."""

import threading

import pytest

from telescope_mount.bridges.connection import BridgeError, Reconnection, parse_address


@pytest.mark.parametrize('error', [BridgeError, ValueError, OSError])
def test_it_is_tried_again_and_says_why_it_failed(error):
    reasons, again = [], threading.Event()

    def attempt():
        if not reasons:
            raise error('nobody answers')
        again.set()

    reconnection = Reconnection(attempt, reasons.append, 0.01)
    reconnection.start()
    assert again.wait(10.0)
    reconnection.close()
    assert reasons == ['nobody answers']


def test_who_is_woken_does_not_wait_and_who_is_closed_tries_no_more():
    tries = threading.Semaphore(0)
    reconnection = Reconnection(tries.release, [].append, 1e6)
    reconnection.start()
    assert tries.acquire(timeout=10.0)
    reconnection.wake()
    assert tries.acquire(timeout=10.0)
    reconnection.close()
    assert not tries.acquire(timeout=0.1)


def test_an_address_is_read_and_another_text_refused():
    assert parse_address('indi:localhost:7624') == ('localhost', 7624)
    assert parse_address('indi:dome') == ('dome', 7624)
    for text in ('indi:', 'indi:host:port', 'german', 'indi:host:0'):
        with pytest.raises(ValueError, match='is no INDI server; write indi:HOST'):
            parse_address(text)
