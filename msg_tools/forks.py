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

"""Calls that need nothing of each other, each in a child of this process: one a core."""

import ctypes
import multiprocessing
import os
import signal
import sys
import time
import warnings
from contextlib import suppress
from multiprocessing.connection import wait

#: s of a call from which a child, which costs some hundredths, is worth it
WORTH = 0.2
_SET_DEATH_SIGNAL = 1  # Linux: prctl


def cores():
    """How many processors this process may use."""
    with suppress(AttributeError):  # not everywhere
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def forked(calls, jobs, done=None):
    """What calls return, in their order.

    A child begins with all that this process knows, so nothing is sent to it. Random numbers that
    are drawn where a call is made, and not in it, are the same for any number of jobs. As long as
    calls are short, and where there is no fork (on macOS its libraries do not survive one), they
    are carried out here, one after the other.

    Parameters
    ----------
    calls : iterable of callable
        Made one after the other, each as it is due.
    jobs : int
        Processes at a time.
    done : callable, optional
        Called after each; it may raise, which ends all.

    Returns
    -------
    list

    Raises
    ------
    Exception
        What a call raised.
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
        It can be read from when the call has returned.
    """

    def __init__(self, call):
        self._call = call
        context = multiprocessing.get_context('fork')
        self.source, target = context.Pipe(duplex=False)
        self._process = context.Process(target=_work, args=(call, target, os.getpid()))
        with warnings.catch_warnings(), target:
            # of threads that may hold a lock: the child takes none of theirs
            warnings.simplefilter('ignore', DeprecationWarning)
            self._process.start()

    def result(self):
        """What the call returned; made once more here, where the child did not get to say it."""
        try:
            returned, value = self.source.recv()
        except (EOFError, OSError):  # it was killed, perhaps while it said it
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
    """In the child."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the whole group: the parent ends it
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:  # it died before that
        return
    try:
        outcome = True, call()
    except Exception as error:
        outcome = False, error
    with suppress(Exception):  # what cannot be sent is made once more by the parent
        target.send(outcome)
