from types import SimpleNamespace

import pytest

from msg_tools.steps import Refused, Steps, call


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


@pytest.mark.parametrize('error', [Refused('no'), ValueError('bad')])
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
    assert str(ends[0]) == 'fit: too few stars' and isinstance(ends[0], Refused)
