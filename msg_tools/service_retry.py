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

"""Services whose answer may get lost: clients repeat the request, the server executes it once.

A request that was sent before the last answer cannot be a reaction to that answer: it is a repeat,
or was delayed by the network or the work. It gets the same answer. A request that arrives during
the work is answered together with the first. A repeat that crossed the answer is recognized by its
time and number: a `steps.ServiceCall` repeats after `AGAIN` s, and does not make another request
before `PASSED` s after such an answer. Any later request is a new one. `steps.call` is the client
side.
"""

import time

#: s after which a request is repeated: it or its answer was lost
AGAIN = 3.0
#: s for which an answer may still be on its way to a client that repeats its request
PASSED = 1.0
#: least s between a request and its repeat
EARLIEST = 0.9 * AGAIN
#: s; a request that appears older comes from a computer with a wrong clock, and is executed
OLDEST = 60.0


class Answers:
    """The last answer of a service, and the requests that the current work will answer.

    Parameters
    ----------
    wall : callable
        Clock that stamps requests, ns.
    """

    def __init__(self, wall=time.time_ns):
        self._wall = wall
        self._request = self._response = None
        self._given = 0
        self._last = None  # header of the last question that was answered
        self._waiting = None  # headers of the questions that the work under way answers

    def take(self, request, header):
        """Take a request; if it is to be executed, `given` or `failed` must follow.

        Parameters
        ----------
        request
            Request of the service.
        header
            With ``source_timestamp``, the time of sending, ns of the client's clock, and
            ``request_id.sequence_number``, counted by the client.

        Returns
        -------
        work : bool
        response
            Answer to be sent at once; None if there is none.
        """
        same = request == self._request
        if self._waiting is not None:
            if same:
                self._waiting.append(header)
                return False, None
            return True, None  # another request of the same service, concurrent
        sent = header.source_timestamp
        if same and (self._given - round(OLDEST * 1e9) < sent <= self._given
                     or self._passed(header)):
            self._last = header
            return False, self._response
        self._request, self._waiting = request, [header]
        return True, None

    def _passed(self, header):
        """Whether a request seems to repeat the last one, sent before its answer arrived."""
        if self._last is None:
            return False
        sent, before = header.source_timestamp, self._last.source_timestamp
        return (sent - self._given <= round(PASSED * 1e9) and sent - before >= round(EARLIEST * 1e9)
                and header.request_id.sequence_number
                == self._last.request_id.sequence_number + 1)

    def given(self, response, header):
        """The work for the request with `header` is done.

        Returns
        -------
        list
            Headers of the requests that `response` answers.
        """
        if self._waiting is None or header is not self._waiting[0]:
            return [header]
        waiting, self._waiting = self._waiting, None
        self._last = waiting[-1]
        self._response, self._given = response, self._wall()
        return waiting

    def failed(self):
        """The work ended without an answer."""
        self._waiting = None
