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

"""Work that waits for others: steps that continue whenever something has changed.

Such work is a generator of conditions. Nothing here uses ROS, threads or sleep: any code that
changes the input of a condition (a message, a timer, a service's answer) calls `Steps.advance`.
"""

import time

from .service_retry import AGAIN, EARLIEST, PASSED


class CallRefused(Exception):
    """A step cannot be done; the text gives the reason."""


class Steps:
    """Runs one piece of work at a time.

    Parameters
    ----------
    ended : callable
        Called with None when the work has finished, otherwise with the `CallRefused` or ValueError
        that ended it. Other exceptions of the work pass.
    """

    def __init__(self, ended):
        self._ended = ended
        self._work = None
        self._wait = None
        self._running = False

    @property
    def busy(self):
        """Whether some work has not ended yet."""
        return self._work is not None

    def start(self, work):
        """Set the next work, a generator of callables that return whether it may continue.

        It starts at the next `advance`; RuntimeError while other work is in progress.
        """
        if self.busy:
            raise RuntimeError('work is under way')
        self._work, self._wait = work, None

    def end(self, error):
        """Abort the work and call `ended` with `error`, a `CallRefused`."""
        work, self._work = self._work, None
        if work is not None:
            work.close()
            self._ended(error)

    def cancel(self):
        """Abort the work silently."""
        if self._work is not None:
            self._work.close()
        self._work = self._wait = None

    def advance(self):
        """Continue as far as the conditions allow."""
        if self._work is None or self._running:  # actions of a step may call again
            return
        self._running = True
        try:
            while self._wait is None or self._wait():
                self._wait = next(self._work)
        except StopIteration:
            self._work = None
            self._ended(None)
        except (CallRefused, ValueError) as err:
            self._work = None
            self._ended(err)
        finally:
            self._running = False


def until(condition, what=''):
    """The step that waits for `condition`; `what` describes it for people."""
    yield condition


#: s for which a server that has done its work may take to answer; asked only once in that time
PATIENCE = 20.0
#: wall seconds between checks of the server
_LOOK = 0.25
#: attribute of a client: time before which a new request could be taken for a repeat of its last
_TAKEN = 'questions_taken_for_the_last_until'


class ServiceCall:
    """A service request that is repeated until it is answered.

    Parameters
    ----------
    client, wake
        See `call`.
    effect : callable
        Whether the requested effect is observed.
    request
        Request message; empty by default.
    patient : bool
        Repeat only after the server was away: it may be slow, and could execute a repeat.
    wall : callable
        Steady clock, s.
    """

    def __init__(self, client, wake=lambda: None, effect=lambda: False, patient=False,
                 request=None, wall=time.monotonic):
        self._client, self._wake, self._effect = client, wake, effect
        self._request = client.srv_type.Request() if request is None else request
        self._patient, self._wall = patient, wall
        self._futures, self._away, self._looked, self._done_at = [], False, 0.0, None
        self._gone = None  # since when the server is gone
        self._lost = False  # whether its answer is; the effect is observed
        self._begin()

    def _begin(self):
        if self._wall() >= getattr(self._client, _TAKEN, 0.0):
            self._ask()

    def _ask(self):
        self._since, self._away = self._wall(), False
        future = self._client.call_async(self._request)
        self._futures.append(future)
        future.add_done_callback(self._answered)

    def _answered(self, _):
        now = self._wall()
        if now - self._since >= EARLIEST - PASSED:
            setattr(self._client, _TAKEN, now + PASSED)
        self._wake()

    @property
    def away(self):
        """Time since the server disappeared, s; 0 while it is there."""
        return self._looked - self._gone if self._gone is not None else 0.0

    @property
    def times(self):
        """Number of times the request was sent."""
        return len(self._futures)

    @property
    def answer(self):
        """The first answer, None before."""
        return next((future.result() for future in self._futures if future.done()), None)

    def over(self):
        """Whether it is answered or its effect observed; repeats the request when it is due."""
        if not self._futures:
            self._begin()
            return False
        if self._lost or any(future.done() for future in self._futures):
            return True
        now = self._wall()
        if now - self._looked < _LOOK:
            return False
        self._looked = now
        if not self._client.service_is_ready():
            self._since, self._away = now, True  # after its return latched messages come first
            self._gone = now if self._gone is None else self._gone
            return False
        self._gone = None
        if self._effect():
            self._done_at = self._done_at or now
            long = PATIENCE if self._patient and not self._away else AGAIN
            self._lost = now - self._done_at >= long
            return self._lost
        elif now - self._since >= AGAIN and (self._away or not self._patient):
            self._ask()
        return False


def call(verb, client, wake, wait=until, effect=lambda: False, patient=False, limit=0.0,
         wall=time.monotonic):
    """Steps of a service call.

    Parameters
    ----------
    verb : str
        Name of the request, for people.
    client : rclpy.client.Client
        Client of a service whose answer has ``success`` and ``message`` (std_srvs/Trigger).
    wake : callable
        Calls `Steps.advance`, since no message need follow the answer.
    wait : callable
        ``wait(condition, what)`` returns the steps that wait for something.
    effect, patient, wall
        See `ServiceCall`.
    limit : float
        s to wait while nobody offers the service; 0: forever.

    Returns
    -------
    str
        The answer, after `verb`.

    Raises
    ------
    CallRefused
        The answer is negative, or nobody offers the service.
    """
    begin = wall()
    yield from wait(lambda: client.service_is_ready() or 0.0 < limit < wall() - begin,
                    f'a server of {client.srv_name}')
    question = None
    if client.service_is_ready():
        question = ServiceCall(client, wake, effect, patient, wall=wall)
        yield from wait(lambda: question.over() or 0.0 < limit < question.away,
                        f'{client.srv_name} to answer')
    if question is None or not question.over():
        raise CallRefused(f'{verb}: nobody has offered {client.srv_name} for {limit:g} s')
    answer = question.answer
    if answer is None:
        return f'{verb}: done; its answer was lost on the way'
    if not answer.success:
        raise CallRefused(f'{verb}: {answer.message}')
    return f'{verb}: {answer.message}'
