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

"""Work of seconds or minutes in a thread: the node answers beside it, and it can be cancelled."""

import threading

from rclpy.task import Future

from .status_rows import Stage


class Cancelled(ValueError):
    """The work was given up because somebody asked for it; the text says so."""


class LongWork:
    """One piece of work at a time; messages that would change what it works on wait for its end.

    Parameters
    ----------
    node : MountNode

    Attributes
    ----------
    name : str
        Of the work under way, for people; '' without any.
    stage : Stage
        How far that is; empty where it does not report it.
    """

    def __init__(self, node):
        self._node, self.name, self.stage = node, '', Stage()
        self._stop, self._thread = threading.Event(), None
        self._later = []

    async def run(self, name, call):
        """Have it done, and give what it returns; what it raises passes, `Cancelled` too.

        Parameters
        ----------
        name : str
        call : callable
            ``call(progress)``, which calls ``progress(text, done, total)`` now and then: there it
            can be cancelled.
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
        """Have it end at its next step; (whether there was any, a sentence)."""
        if not self.name:
            return False, 'nothing long is under way'
        self._stop.set()
        return True, f'{self.name} ends with its next step'

    def waiting(self, call):
        """As `call(message)`, but after the work that is under way."""
        def take(message):
            if self.name or self._later:
                self._later.append((call, message))
            else:
                call(message)
        return take

    def caught_up(self, reject):
        """Take what has waited; ``reject(call, error)`` for a message that cannot be used."""
        while self._later:
            call, message = self._later.pop(0)
            try:
                call(message)
            except (ValueError, ArithmeticError, RecursionError) as err:
                reject(call, err)

    def close(self):
        """Give it up, at the end of the node."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(2.0)
