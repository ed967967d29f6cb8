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

"""Runs independent calls in child processes, one per core."""

import ctypes
import multiprocessing
import os
import signal
import sys
import time
import warnings
from contextlib import suppress
from multiprocessing.connection import wait

#: least s of a call for which a child process is worthwhile; starting one costs some hundredths
WORTH = 0.2
_SET_DEATH_SIGNAL = 1  # Linux: prctl


def cores():
    """Number of processors that this process may use."""
    with suppress(AttributeError):  # not everywhere
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def forked(calls, jobs, done=None):
    """Results of calls, in the order of the calls.

    A child inherits the memory of this process, so nothing is sent to it. Random numbers that
    are drawn when a call is created, not within it, are the same for any number of jobs. Calls
    run here, one after the other, as long as they are short, and where there is no safe fork (on
    macOS the libraries do not survive one).

    Parameters
    ----------
    calls : iterable of callable
        Created one after the other, each when it is due.
    jobs : int
        Number of processes at a time.
    done : callable, optional
        Called after each call; it may raise, which ends everything.

    Returns
    -------
    list

    Raises
    ------
    Exception
        An exception that a call raised.
    """
    many = jobs > 1 and hasattr(os, 'fork') and sys.platform != 'darwin'
    out, running, worth = {}, {}, False

    def one_ends():
        for source in wait(list(running)):
            number, child = running.pop(source)
            out[number] = child.result()
            if done is not None:
                done()
    try:
        for number, call in enumerate(calls):
            if worth:
                child = _Child(call)
                running[child.source] = number, child
                while len(running) >= jobs:
                    one_ends()
                continue
            began = time.monotonic()
            out[number] = call()
            worth = many and time.monotonic() - began > WORTH
            if done is not None:
                done()
        while running:
            one_ends()
    finally:
        for _, child in running.values():
            child.end()
    return [out[number] for number in range(len(out))]


class _Child:
    """A call in its own process.

    Parameters
    ----------
    call : callable

    Attributes
    ----------
    source : multiprocessing.connection.Connection
        Readable when the call has returned.
    """

    def __init__(self, call):
        self._call = call
        context = multiprocessing.get_context('fork')
        self.source, target = context.Pipe(duplex=False)
        self._process = context.Process(target=_work, args=(call, target, os.getpid()))
        with warnings.catch_warnings(), target:
            # the warning is about threads that may hold a lock: the child uses none of their locks
            warnings.simplefilter('ignore', DeprecationWarning)
            self._process.start()

    def result(self):
        """Result of the call; if the child could not send it, the call is repeated here."""
        try:
            returned, value = self.source.recv()
        except (EOFError, OSError):  # killed, perhaps while sending
            returned, value = True, self._call()
        finally:
            self.source.close()
            self._process.join()
        if not returned:
            raise value
        return value

    def end(self):
        """Kill it."""
        self._process.kill()
        self._process.join()
        self.source.close()


def _work(call, target, parent):
    """Run the call in the child."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # sent to the group: the parent ends the child
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:  # the parent died before prctl
        return
    try:
        outcome = True, call()
    except Exception as error:
        outcome = False, error
    with suppress(Exception):  # the parent repeats a call whose result cannot be sent
        target.send(outcome)
