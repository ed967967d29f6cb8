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

"""Ctrl-C, SIGTERM and SIGHUP end a command in order, with one line, whatever it is at."""

import contextlib
import os
import signal
import stat

from msg_tools.signals import ENDING

#: handlers of Python's own
_OWN = dict.fromkeys(ENDING, signal.SIG_DFL) | {signal.SIGINT: signal.default_int_handler}
_received, _pending = [], []


def interrupt(number, _):
    """The handler of all, outside of `noted`."""
    _let_go_of_terminal()
    _received.append(number)
    raise KeyboardInterrupt(number)


def _note(number, _):
    _let_go_of_terminal()
    _received.append(number)
    _pending.append(number)


def _let_go_of_terminal():
    """Where the terminal is closed, what is reported while all ends would be an error."""
    for output in (1, 2):
        with contextlib.suppress(OSError):
            if stat.S_ISCHR(os.fstat(output).st_mode) and not os.isatty(output):
                nobody = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nobody, output)
                os.close(nobody)


def check():
    """Raise once more what an import, or a library's ``except:``, has swallowed.

    For long work that nothing has to end in order.

    Raises
    ------
    KeyboardInterrupt
    """
    if _received:
        raise KeyboardInterrupt(_received[-1])


@contextlib.contextmanager
def interrupted_in_order(program=False):
    """Within, all raise KeyboardInterrupt with their number, where nobody else handles them.

    An import makes another error of it: that is not what ended the command.

    Parameters
    ----------
    program : bool
        Nothing follows in this process: it ends, and no signal disturbs that.
    """
    ours = []
    with contextlib.suppress(ValueError):  # not in the main thread
        for number, own in _OWN.items():
            if signal.getsignal(number) == own:
                signal.signal(number, interrupt)
                ours.append(number)
    _received.clear()
    try:
        yield
    except Exception:
        if _received:
            raise KeyboardInterrupt(_received[-1]) from None
        raise
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_IGN if program else _OWN[number])
        _received.clear()  # what comes next in this process was not interrupted


@contextlib.contextmanager
def noted():
    """Within, a signal raises where `raise_noted` is called, and at the end, and nowhere else.

    For what has to be ended in order, also when it is told again meanwhile; raised in the middle of
    a message, rclpy makes another error of it.

    Raises
    ------
    KeyboardInterrupt
        At the end, with the number of a signal that came since the last look.
    """
    before = {}
    with contextlib.suppress(ValueError):  # not in the main thread
        for number, own in _OWN.items():
            handler = signal.getsignal(number)
            if handler in (own, interrupt):
                before[number] = handler
                signal.signal(number, _note)
    try:
        yield
        if before:
            raise_noted()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if before:
            _pending.clear()
        if before and interrupt not in before.values():
            _received.clear()


def raise_noted():
    """Within `noted`: raise what was told since the last time.

    Raises
    ------
    KeyboardInterrupt
        With the number of the signal.
    """
    if _pending:
        number = _pending[-1]
        _pending.clear()
        raise KeyboardInterrupt(number)
