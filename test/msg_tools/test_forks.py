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

"""Calls in children of this process."""

import os
import signal
import sys

import numpy as np
import pytest

from msg_tools import forks
from msg_tools.forks import cores, forked

HERE = os.getpid()

pytestmark = pytest.mark.skipif(not hasattr(os, 'fork') or sys.platform == 'darwin',
                                reason='no fork that libraries survive')


@pytest.fixture(autouse=True)
def born(monkeypatch):
    """Process numbers of all children; that none is left is asked in the end."""
    pids, fork = [], os.fork

    def counted():
        pid = fork()
        pids.append(pid)
        return pid
    monkeypatch.setattr(forks, 'WORTH', -1.0)
    monkeypatch.setattr(os, 'fork', counted)
    yield pids
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def calls(count, rng=None, killed=()):
    """Each draws as it is made, and tells in which process it was carried out."""
    for number in range(count):
        drawn = None if rng is None else float(rng.random())

        def call(number=number, drawn=drawn):
            if number in killed and os.getpid() != HERE:
                os.kill(os.getpid(), signal.SIGKILL)
            return number, drawn, os.getpid()
        yield call


def test_the_same_comes_of_any_number_of_jobs(born):
    told = []
    found = {jobs: forked(calls(7, np.random.default_rng(1)), jobs, lambda: told.append(1))
             for jobs in (1, 3)}
    assert [one[:2] for one in found[1]] == [one[:2] for one in found[3]]
    assert [number for number, *_ in found[3]] == list(range(7)) and len(told) == 14
    assert {pid for *_, pid in found[1]} == {os.getpid()}
    # the first one tells whether children are worth it
    assert found[3][0][2] == os.getpid() and {pid for *_, pid in found[3][1:]} == set(born)
    assert forked((), 2) == [] and cores() >= 1


def test_short_calls_stay_here(monkeypatch):
    monkeypatch.setattr(forks, 'WORTH', 60.0)
    assert {pid for *_, pid in forked(calls(4), 2)} == {os.getpid()}


def test_what_a_call_raises_is_raised_and_a_killed_one_made_again():
    def fails():
        raise ValueError('no such fold')
    with pytest.raises(ValueError, match='no such fold'):
        forked([lambda: 1, fails, *calls(5)], 2)
    found = forked(calls(4, killed=(2,)), 2)
    assert [number for number, *_ in found] == [0, 1, 2, 3] and found[2][2] == os.getpid()
    # what cannot be sent is no answer either
    _, here = forked([lambda: 0, lambda: lambda: os.getpid()], 2)
    assert here() == os.getpid()


def test_who_is_told_may_end_it():
    told = []

    def done():
        told.append(1)
        if len(told) == 2:
            raise KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt):
        forked([lambda: 0, signal.pause, lambda: 1], 3, done)
    assert len(told) == 2


def test_a_large_answer_comes_through():
    found = forked([lambda: 0, lambda: np.arange(500_000), lambda: np.ones(300_000)], 2)
    assert found[1][-1] == 499_999 and found[2].sum() == 300_000
