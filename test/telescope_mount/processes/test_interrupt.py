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

import contextlib
import signal

import pytest

from telescope_mount.processes.interrupt import (
    check,
    interrupt,
    interrupted_in_order,
    noted,
    raise_noted,
)

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.fixture(autouse=True)
def listens():
    """A suite in the background of a script ignores Ctrl-C."""
    before = {number: signal.signal(number, own) for number, own in zip(
        ENDING, (signal.default_int_handler, signal.SIG_DFL, signal.SIG_DFL))}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_a_signal_that_a_library_has_swallowed_is_raised_once_more():
    with pytest.raises(KeyboardInterrupt) as ended, interrupted_in_order():
        check()  # none has come
        with contextlib.suppress(KeyboardInterrupt):
            interrupt(signal.SIGTERM, None)
        check()
    assert ended.value.args == (signal.SIGTERM,)
    with interrupted_in_order():
        check()  # of the command before


def test_what_is_noted_is_raised_where_it_is_asked_for_and_at_the_end():
    with noted():
        raise_noted()  # none has come
        for number in ENDING:
            signal.raise_signal(number)
            with pytest.raises(KeyboardInterrupt) as ended:
                raise_noted()
            assert ended.value.args == (number,)
        raise_noted()  # each once
    with pytest.raises(KeyboardInterrupt) as ended, noted(), noted():
        signal.raise_signal(signal.SIGHUP)
    assert ended.value.args == (signal.SIGHUP,)
    assert [signal.getsignal(number) for number in ENDING] == [
        signal.default_int_handler, signal.SIG_DFL, signal.SIG_DFL]


@pytest.mark.parametrize('number', ENDING)
def test_what_is_ignored_stays_so(number):
    signal.signal(number, signal.SIG_IGN)
    with interrupted_in_order(), noted():
        signal.raise_signal(number)
        raise_noted()
    assert signal.getsignal(number) is signal.SIG_IGN


def test_a_program_that_ends_is_not_disturbed_any_more():
    with pytest.raises(KeyboardInterrupt), interrupted_in_order(program=True):
        signal.raise_signal(signal.SIGHUP)
    assert {signal.getsignal(number) for number in ENDING} == {signal.SIG_IGN}


def test_what_comes_after_an_interrupted_command_is_not_interrupted():
    for block in (interrupted_in_order, noted):
        with pytest.raises(KeyboardInterrupt), block():
            signal.raise_signal(signal.SIGTERM)
        check()
