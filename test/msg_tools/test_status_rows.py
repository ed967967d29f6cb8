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

from dataclasses import fields
from types import SimpleNamespace

import pytest

from msg_tools.status_rows import OBSERVATIONS, Progress, Taken, handover, handover_rows


def status(**rows):
    return SimpleNamespace(values=[
        SimpleNamespace(key=key, value=str(value)) for key, value in rows.items()])


def test_progress_goes_there_and_back():
    progress = Progress('observing', 'stars 30', 2, 7, 30, 51, 2, 1, 'home, stars 30')
    assert Progress.read(status(**progress.rows())) == progress
    # foreign rows do no harm
    assert Progress.read(status(colour='red', **progress.rows())) == progress
    assert Progress.read(None) == Progress()


@pytest.mark.parametrize('name', [field.name for field in fields(Progress)
                                  if field.name not in ('plan', 'refused', 'forgotten')])
def test_a_row_that_is_missing_is_told(name):
    rows = Progress().rows()
    del rows[name]
    with pytest.raises(ValueError, match=f'without the row {name}'):
        Progress.read(status(**rows))


def test_the_rows_that_others_read():
    # what is written in logs and read by those who watch: a change of these is one of the format
    assert list(Progress().rows()) == [
        'state', 'step', 'block', 'done', 'total', 'observations', 'run', 'lost', 'plan',
        'refused', 'forgotten']
    assert OBSERVATIONS == 'observations'


def test_what_the_calibration_has():
    taken = Taken(12, 10, 240, 10**18 + 1)
    assert Taken.read(status(**taken.rows(), verdict='none')) == taken
    assert Taken.read(status(observations=12)) == Taken(12)  # of an older log
    assert Taken.read(None) == Taken()
    with pytest.raises(ValueError, match='without the row observations'):
        Taken.read(status(taken=12))
    with pytest.raises(ValueError):
        Taken.read(status(observations='many'))


def test_with_a_new_power_on_it_has_less_and_has_not_the_newest_yet():
    before, after = Taken(20, 2, 40, 700), Taken(11, 2, 50, 800)
    assert before.has(20, 700) and not before.has(11, 800) and after.has(11, 800)
    assert not Taken(10, 2, 50, 800).has(11, 800)  # one in between is missing
    assert Taken(11).has(11, 800)  # of who does not tell it the number decides


@pytest.mark.parametrize('left', ['{"done": "x"}', '{"block": 1e999}', '[]', '[' * 100_000,
                                  '5' * 5000])
def test_a_plan_given_back_that_is_none_is_refused(left):
    rows = [SimpleNamespace(key=key, value=value) for key, value in
            {'given_back': '3', 'plan_left': left}.items()]
    with pytest.raises(ValueError):
        handover(SimpleNamespace(values=rows))
    sound = handover_rows(3, Progress('observing', 'stars 30', 2, 7, 30, 51, 2, 1, 'home'))
    assert handover(status(**sound))[1].done == 7
