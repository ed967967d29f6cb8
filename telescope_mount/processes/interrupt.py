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

"""Ctrl-C, SIGTERM and SIGHUP end a command in order, with one line, at any time."""

import contextlib
import os
import signal
import stat

from msg_tools.signals import ENDING

#: Python's default handlers
_OWN = dict.fromkeys(ENDING, signal.SIG_DFL) | {signal.SIGINT: signal.default_int_handler}
_received, _pending = [], []


def interrupt(number, _):
    """Signal handler outside of `noted`."""
    _let_go_of_terminal()
    _received.append(number)
    raise KeyboardInterrupt(number)


def _note(number, _):
    _let_go_of_terminal()
    _received.append(number)
    _pending.append(number)


def _let_go_of_terminal():
    """Redirect outputs of a closed terminal, where messages at the end would cause errors."""
    for output in (1, 2):
        with contextlib.suppress(OSError):
            if stat.S_ISCHR(os.fstat(output).st_mode) and not os.isatty(output):
                nobody = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nobody, output)
                os.close(nobody)


def check():
    """Raise again an interrupt that an import, or a library's ``except:``, has swallowed.

    For long work that needs no cleanup.

    Raises
    ------
    KeyboardInterrupt
    """
    if _received:
        raise KeyboardInterrupt(_received[-1])


@contextlib.contextmanager
def interrupted_in_order(program=False):
    """Within, signals without another handler raise KeyboardInterrupt with their number.

    An import turns this into another error, which is converted back.

    Parameters
    ----------
    program : bool
        The process ends afterwards, and no signal may disturb that.
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
        _received.clear()  # later work in this process was not interrupted


@contextlib.contextmanager
def noted():
    """Within, a signal raises only at calls of `raise_noted`, and at the end.

    For work that must end in order even if the signal is repeated. If the signal were raised in the
    middle of a message, rclpy would turn it into another error.

    Raises
    ------
    KeyboardInterrupt
        At the end, with the number of a signal that arrived since the last check.
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
    """Within `noted`: raise a signal that arrived since the last check.

    Raises
    ------
    KeyboardInterrupt
        With the number of the signal.
    """
    if _pending:
        number = _pending[-1]
        _pending.clear()
        raise KeyboardInterrupt(number)
