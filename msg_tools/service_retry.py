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

"""Services whose answer may be lost on its way: the question is asked again, and done once.

A question that was sent before the last answer was given cannot follow from that answer: it is the
same question once more, or one that waited in the network or behind the work. It gets the same
answer. One that comes while the work is under way joins it. One that passed the answer on its way
is known by its time and number: a `steps.ServiceCall` is asked again after `AGAIN` s, and another
is not begun before `PASSED` s after such an answer. Any later one is a new question. What a client
does in its place is in `steps.call`.
"""

import time

#: s after which a question is asked again: that or its answer was lost
AGAIN = 3.0
#: s in which an answer may not have come to who asks again
PASSED = 1.0
#: s that may have gone since the last time where one is asked again
EARLIEST = 0.9 * AGAIN
#: s; a question that seems older than this is of a computer whose clock is off, and is done
OLDEST = 60.0


class Answers:
    """What a service has answered last, and who waits for what it does now.

    Parameters
    ----------
    wall : callable
        ns of the clock that stamps questions.
    """

    def __init__(self, wall=time.time_ns):
        self._wall = wall
        self._request = self._response = None
        self._given = 0
        self._last = None  # header of the last question that was answered
        self._waiting = None  # headers of the questions that the work under way answers

    def take(self, request, header):
        """A question: is it to be worked on? `given` or `failed` follows then.

        Parameters
        ----------
        request
            Of the service.
        header
            With ``source_timestamp``, when it was sent, ns of the asker's clock, and
            ``request_id.sequence_number`` of its asker.

        Returns
        -------
        work : bool
        response
            What is to be answered at once; None for nothing.
        """
        same = request == self._request
        if self._waiting is not None:
            if same:
                self._waiting.append(header)
                return False, None
            return True, None  # other work of the same service, beside this one
        sent = header.source_timestamp
        if same and (self._given - round(OLDEST * 1e9) < sent <= self._given
                     or self._passed(header)):
            self._last = header
            return False, self._response
        self._request, self._waiting = request, [header]
        return True, None

    def _passed(self, header):
        """Whether a question seems to be the last one again, sent before its answer came."""
        if self._last is None:
            return False
        sent, before = header.source_timestamp, self._last.source_timestamp
        return (sent - self._given <= round(PASSED * 1e9) and sent - before >= round(EARLIEST * 1e9)
                and header.request_id.sequence_number
                == self._last.request_id.sequence_number + 1)

    def given(self, response, header):
        """The work on the question with `header` is done.

        Returns
        -------
        list
            Headers of the questions that `response` answers.
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
