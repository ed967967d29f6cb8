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

from msg_tools.service_retry import AGAIN, OLDEST, PASSED, Answers

SECOND = 10**9


class Service:
    """`Answers` on a clock of the test."""

    def __init__(self):
        self.now, self.done, self.asked = 1000 * SECOND, 0, 0
        self.answers = Answers(lambda: self.now)

    def ask(self, ago=0.0, request='home'):
        """A question that was sent so long ago, s: header, and what `take` says."""
        self.asked += 1
        header = SimpleNamespace(source_timestamp=self.now - round(ago * SECOND),
                                 request_id=SimpleNamespace(sequence_number=self.asked))
        return header, *self.answers.take(request, header)

    def work(self, ago=0.0):
        """A question that is worked on for 10 s."""
        header, work, _ = self.ask(ago)
        assert work
        self.now += 10 * SECOND
        self.done += 1
        return self.answers.given(self.done, header)


def test_a_question_that_waited_behind_the_work_has_the_answer_of_that_work():
    service = Service()
    service.work()
    assert service.ask(ago=3.0)[1:] == (False, 1)
    assert service.ask(ago=0.0)[1:] == (False, 1)  # as the answer was given


def test_a_question_after_the_answer_is_a_new_one():
    service = Service()
    service.work()
    service.now += round(PASSED * SECOND) + 1
    assert len(service.work()) == 1 and service.done == 2


def test_a_question_asked_again_that_passed_the_answer_on_its_way_has_that_answer():
    service = Service()
    service.work()
    service.now += SECOND // 10
    assert service.ask()[1:] == (False, 1)  # 10.1 s after it was asked
    service.now += SECOND // 10
    work = service.ask()[1]  # asked 0.1 s after another is not again
    assert work


def test_a_question_of_another_asker_is_a_new_one():
    service = Service()
    service.work()
    service.asked += 5
    service.now += SECOND // 10
    assert service.ask()[1]


@pytest.mark.parametrize('again', [AGAIN / 2.0, AGAIN])
def test_a_short_work_that_is_asked_for_at_once_is_done_at_once(again):
    service = Service()
    header, *_ = service.ask()
    service.answers.given('done', header)
    service.now += round(again * SECOND)
    assert service.ask()[1]


def test_questions_join_the_work_that_is_under_way():
    service = Service()
    first, work, _ = service.ask()
    second, *told = service.ask()
    assert work and told == [False, None]
    assert service.answers.given('done', first) == [first, second]
    service.now += 1  # ns
    assert service.ask()[1:] == (True, None)


def test_work_that_failed_is_done_anew():
    service = Service()
    service.ask()
    service.answers.failed()
    assert service.ask()[1:] == (True, None)


def test_another_request_is_another_question():
    service = Service()
    first, *_ = service.ask()
    other, work, _ = service.ask(request='split')
    assert work and service.answers.given('split', other) == [other]
    assert service.answers.given('home', first) == [first]
    assert service.ask(ago=0.0, request='split')[1:] == (True, None)


@pytest.mark.parametrize('ago', [OLDEST + 1.0, 3600.0])
def test_an_asker_with_a_clock_that_is_off_is_not_told_of_long_ago(ago):
    service = Service()
    service.work()
    assert service.ask(ago=ago)[1:] == (True, None)
