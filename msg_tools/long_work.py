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

"""Runs work of seconds or minutes in a thread: the node stays responsive and can cancel it."""

import threading

from rclpy.task import Future

from .status_rows import Stage


class Cancelled(ValueError):
    """The work was cancelled by a user; the text says so."""


class LongWork:
    """Runs one task at a time; messages that would change its input wait until it ends.

    Parameters
    ----------
    node : MountNode

    Attributes
    ----------
    name : str
        Name of the running task, for people; '' if there is none.
    stage : Stage
        Progress of the task; empty if it reports none.
    """

    def __init__(self, node):
        self._node, self.name, self.stage = node, '', Stage()
        self._stop, self._thread = threading.Event(), None
        self._later = []

    async def run(self, name, call):
        """Run a call and return its result; its exceptions pass, including `Cancelled`.

        Parameters
        ----------
        name : str
        call : callable
            ``call(progress)``, which regularly calls ``progress(text, done, total)``: there it can
            be cancelled.
        """
        self.name, self.stage = name, Stage()
        self._stop.clear()
        future = Future()

        def work():
            try:
                future.set_result(call(self._progress))
            except BaseException as err:
                future.set_exception(err)
            executor = self._node.executor
            if executor is not None:
                executor.wake()
        self._thread = threading.Thread(target=work, daemon=True)
        self._thread.start()
        try:
            return await future
        finally:
            self.name = ''

    def _progress(self, text, done, total):
        if self._stop.is_set():
            raise Cancelled(f'{self.name} was cancelled')
        self.stage = Stage(text, int(done), int(total or 0))

    def cancel(self):
        """Cancel the task at its next step; return whether there was one, and a sentence."""
        if not self.name:
            return False, 'nothing long is under way'
        self._stop.set()
        return True, f'{self.name} ends with its next step'

    def waiting(self, call):
        """A callback that calls `call(message)`, but only after the running task has ended."""
        def take(message):
            if self.name or self._later:
                self._later.append((call, message))
            else:
                call(message)
        return take

    def caught_up(self, reject):
        """Process the waiting messages; ``reject(call, error)`` gets those that cannot be used."""
        while self._later:
            call, message = self._later.pop(0)
            try:
                call(message)
            except (ValueError, ArithmeticError, RecursionError) as err:
                reject(call, err)

    def close(self):
        """Cancel the task when the node ends."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(2.0)
