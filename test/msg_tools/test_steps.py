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

from types import SimpleNamespace

import pytest

from msg_tools.service_retry import AGAIN, PASSED
from msg_tools.steps import PATIENCE, CallRefused, ServiceCall, Steps, call


class Client:
    """A service of the test; it answers when told to."""

    srv_name = '/mount/fit'
    srv_type = SimpleNamespace(Request=lambda: 'request')

    def __init__(self):
        self.there, self.answer, self.called, self.told = False, None, [], []

    def service_is_ready(self):
        return self.there

    def call_async(self, request):
        self.called.append(request)
        return self

    def add_done_callback(self, callback):
        self.told.append(callback)
        if self.answer is not None:
            callback(self)

    def done(self):
        return self.answer is not None

    def result(self):
        return SimpleNamespace(success=self.answer[0], message=self.answer[1])

    def say(self, *answer):
        self.answer = answer
        for callback in self.told:
            callback(self)


@pytest.fixture
def ends():
    return []


def test_work_goes_on_as_far_as_its_conditions_allow(ends):
    open_, done = set(), []

    def work():
        for name in 'abc':
            yield lambda name=name: name in open_
            done.append(name)
    steps = Steps(ends.append)
    assert not steps.busy
    steps.advance()
    steps.start(work())
    assert steps.busy and done == []
    open_ |= {'b'}
    steps.advance()
    assert done == []
    open_ |= {'a'}
    steps.advance()
    assert done == ['a', 'b'] and steps.busy and ends == []
    with pytest.raises(RuntimeError, match='under way'):
        steps.start(work())
    open_ |= {'c'}
    steps.advance()
    assert done == ['a', 'b', 'c'] and not steps.busy and ends == [None]
    steps.advance()
    assert ends == [None]


@pytest.mark.parametrize('error', [CallRefused('no'), ValueError('bad')])
def test_an_error_ends_the_work_and_other_work_can_begin(ends, error):
    def fails():
        yield lambda: True
        raise error
    steps = Steps(ends.append)
    steps.start(fails())
    steps.advance()
    assert ends == [error] and not steps.busy
    steps.start(iter([lambda: True]))
    steps.advance()
    assert ends == [error, None]


def test_a_step_may_set_off_what_advances_again(ends):
    steps = Steps(ends.append)
    went = []

    def work():
        steps.advance()  # as the answer of a service that is there at once does
        yield lambda: steps.advance() is None
        went.append(True)
    steps.start(work())
    steps.advance()
    assert went == [True] and ends == [None]


def test_a_service_is_awaited_called_once_and_its_answer_wakes(ends):
    client, said = Client(), []
    steps = Steps(ends.append)

    def wait(condition, what):
        said.append(what)
        yield condition

    def work():
        said.append((yield from call('fit', client, steps.advance, wait)))
    steps.start(work())
    steps.advance()
    assert client.called == [] and said == ['a server of /mount/fit']
    client.there = True
    steps.advance()
    steps.advance()
    assert client.called == ['request'] and said[1:] == ['/mount/fit to answer']
    client.say(True, '30 stars')
    assert said[2:] == ['fit: 30 stars'] and ends == [None]


def test_an_answer_that_is_there_at_once(ends):
    client = Client()
    client.there, client.answer = True, (True, 'done')
    steps = Steps(ends.append)
    steps.start(call('fit', client, steps.advance))
    steps.advance()
    assert ends == [None]


def test_a_service_that_refuses(ends):
    client = Client()
    client.there = True
    steps = Steps(ends.append)
    steps.start(call('fit', client, steps.advance))
    steps.advance()
    client.say(False, 'too few stars')
    assert str(ends[0]) == 'fit: too few stars' and isinstance(ends[0], CallRefused)


class Lossy(Client):
    """Each question has an answer of its own, which may never come."""

    def __init__(self):
        super().__init__()
        self.there, self.asked = True, []

    def call_async(self, request):
        self.asked.append(Client())
        return self.asked[-1]


class Asking:
    """A question on a clock of the test, and whether what it asks for is seen to be done."""

    def __init__(self, patient=False):
        self.client, self.now, self.done = Lossy(), 100.0, False
        self.question = ServiceCall(self.client, lambda: None, lambda: self.done, patient,
                                 wall=lambda: self.now)

    def after(self, seconds):
        """Looked at all the time for so long: whether it is over."""
        end = self.now + seconds
        while self.now < end and not self.question.over():
            self.now += 0.05
        return self.question.over()


def test_a_question_that_is_not_answered_is_asked_again_within_seconds_and_any_answer_counts():
    asking = Asking()
    assert not asking.after(AGAIN - 0.5) and len(asking.client.asked) == 1
    assert not asking.after(1.0) and len(asking.client.asked) == 2
    assert not asking.after(AGAIN) and len(asking.client.asked) == 3
    asking.client.asked[0].say(True, 'late')
    assert asking.question.over() and asking.question.answer.message == 'late'


@pytest.mark.parametrize(('took', 'waits'), [(AGAIN - 0.1, True), (1.0, False)])
def test_after_a_long_work_a_question_waits_until_it_is_none_that_is_asked_again(took, waits):
    asking = Asking()
    asking.after(took)
    asking.client.asked[0].say(True, 'done')
    assert asking.question.over()
    asking.question = ServiceCall(asking.client, wall=lambda: asking.now)
    assert len(asking.client.asked) == 2 - waits
    assert not asking.after(PASSED + 0.1) and len(asking.client.asked) == 2


def test_what_is_seen_to_be_done_is_not_asked_for_again_and_its_answer_may_still_come():
    asking = Asking()
    asking.done = True
    assert not asking.after(AGAIN - 0.5) and asking.after(1.0)
    assert asking.question.answer is None and len(asking.client.asked) == 1


def test_a_server_that_was_away_is_asked_when_it_has_told_what_it_knows():
    asking = Asking(patient=True)
    assert not asking.after(60.0) and len(asking.client.asked) == 1  # it may be at it
    asking.client.there = False
    assert not asking.after(20.0)
    asking.client.there = True
    assert not asking.after(AGAIN - 0.5) and len(asking.client.asked) == 1
    assert not asking.after(60.0) and len(asking.client.asked) == 2


def test_a_driver_has_longer_to_answer_for_what_is_seen_to_be_done():
    asking = Asking(patient=True)
    asking.done = True
    assert not asking.after(PATIENCE - 1.0) and asking.after(2.0)
    assert len(asking.client.asked) == 1


def test_work_goes_on_without_the_answer(ends):
    client, said, now = Lossy(), [], [100.0]
    steps = Steps(ends.append)

    def work():
        said.append((yield from call('home', client, steps.advance, effect=lambda: True,
                                     wall=lambda: now[0])))
    steps.start(work())
    for _ in range(round(AGAIN) + 2):
        steps.advance()
        now[0] += 1.0
    assert said == ['home: done; its answer was lost on the way'] and ends == [None]
    assert len(client.asked) == 1


@pytest.mark.parametrize('asked', [False, True])
def test_a_service_that_nobody_offers_for_long_is_given_up(ends, asked):
    client, now = Lossy(), [100.0]
    client.there = asked
    steps = Steps(ends.append)
    steps.start(call('fit', client, steps.advance, limit=60.0, wall=lambda: now[0]))
    steps.advance()
    assert len(client.asked) == asked
    client.there = False
    for _ in range(600):
        now[0] += 0.1
        steps.advance()
    assert steps.busy
    for _ in range(10):
        now[0] += 0.1
        steps.advance()
    assert str(ends[0]) == 'fit: nobody has offered /mount/fit for 60 s'
