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

"""An observer that is killed at any moment goes on where it stopped."""

import json
import logging

import numpy as np
import pytest
from bench import SECOND, Bench

from msg_tools.status_rows import Progress, Taken
from msg_tools.units import ARCSEC
from telescope_mount.observing.night_file import NightFile

PLAN = 'home, stars 4, fit, check 3'


def observer(path, plan=PLAN, after=None):
    """An observer with a state file, on the mount of one that was killed."""
    bench = Bench(homed=after is None, memory=NightFile(path, 'altaz'))
    if after is not None:
        bench.stamp, bench.position, bench.calls = after.stamp, after.position, after.calls
        bench.read(bench.stamp + SECOND, bench.position)
    bench.homes()
    bench.offers('fit', lambda: bench.takes_model(bench.table.newest))
    bench.miss = lambda number: np.array([3.0, 4.0 + 1e-6 * number]) * ARCSEC
    if not bench.plan.take_up_file(plan):
        bench.plan.start(plan)
    return bench


def go_on(bench, ticks=1000):
    """As far as `ticks`; the calibration takes what is published."""
    for _ in range(ticks):
        if not bench.plan.busy:
            break
        bench.tick()
        bench.plan.calibration_has(Taken(len(bench.table)))
    return bench


def of_plan(rows):
    """Stars of each step."""
    return {block: [row['star'] for row in rows if row['block'] == block] for block in (1, 3)}


@pytest.mark.parametrize('whole', [False, True], ids=['observer', 'whole graph'])
def test_killed_at_any_moment_no_pointing_is_doubled_and_at_most_one_lost(tmp_path, whole):
    ticks = 0
    for ticks in range(1, 60):
        path = tmp_path / f'{ticks}'
        first = go_on(observer(path), ticks)
        if not first.plan.busy:
            break
        seen = len(first.rows)
        again = observer(path, after=first)
        assert len(again.table) == seen
        if whole:
            again.plan.calibration_has(Taken(0))
            assert len(again.tables) == (seen > 0)
        go_on(again)
        assert again.plan.progress.state == 'done', again.plan.text
        stars = of_plan(again.table.rows)
        assert [len(set(numbers)) for numbers in stars.values()] == [4, 3]
        assert len(again.table) == 7 and len(again.rows) == 7 - seen
        (check,) = again.checks[-1]
        assert check['stars'] == 3 and check['rms_arcsec'] == pytest.approx(5.0)
        if whole and seen > 4:  # its model went with the calibration
            assert again.calls.count('fit') == 2
    assert ticks > 7


def test_a_row_of_which_nobody_was_told_counts(tmp_path):
    first = go_on(observer(tmp_path / 'f'), 4)
    lines = (tmp_path / 'f').read_bytes().splitlines(keepends=True)
    last = max(i for i, line in enumerate(lines) if b'"row"' in line)
    (tmp_path / 'f').write_bytes(b''.join(lines[:last + 1]) + b'{"plan": {"sta')
    again = go_on(observer(tmp_path / 'f', after=first))
    assert again.plan.progress.state == 'done' and len(again.table) == 7
    for line in (tmp_path / 'f').read_bytes().splitlines():
        json.loads(line)  # what was cut short is gone


def test_it_says_that_it_goes_on_and_where(tmp_path, caplog):
    first = go_on(observer(tmp_path / 'f'), 4)
    done = len(first.rows)
    with caplog.at_level(logging.INFO):
        go_on(observer(tmp_path / 'f', after=first), 2)
    assert f'the plan goes on at step 2 of 4, stars 4, of which {done} are done' in caplog.text


def test_a_plan_that_is_over_is_not_begun_again_by_itself(tmp_path):
    first = go_on(observer(tmp_path / 'f'))
    again = observer(tmp_path / 'f', after=first)
    assert not again.plan.busy and len(again.table) == 7
    assert again.statuses[-1][0].state == 'done'
    assert 'star_observer/anew, begins it anew' in again.statuses[-1][1]
    again.plan.calibration_has(Taken(0))  # started anew as well
    assert len(again.tables) == 1
    again.plan.start(PLAN)
    go_on(again)
    assert again.plan.progress.state == 'done' and len(again.table) == 14


def test_another_plan_begins_at_its_start(tmp_path):
    first = go_on(observer(tmp_path / 'f'), 4)
    other = go_on(observer(tmp_path / 'f', 'stars 2', after=first))
    assert other.plan.progress.state == 'done' and len(other.table) == 2
    assert (tmp_path / 'f.before').exists()


def test_numbers_are_kept_to_the_bit(tmp_path):
    rows = [{'stamp': 1_768_482_000_123_456_789, 'az': 0.1 + 0.2, 'el': float('nan'),
             'az_rate': np.float64(1e-9) / 3.0}]
    file = NightFile(tmp_path / 'f', 'altaz')
    file.row(rows[0])
    file.plan_state(Progress(state='waiting', plan='stars 1', done=1), 5, 0)
    file.plan_state(Progress(state='observing', plan='stars 1', done=1), 5, 0)  # the same place
    file.close()
    kept = NightFile(tmp_path / 'f', 'altaz').kept
    np.testing.assert_equal(kept.rows, rows)
    assert (kept.left.done, kept.evening, kept.before) == (1, 5, 0)
    assert len((tmp_path / 'f').read_text().splitlines()) == 3


@pytest.mark.parametrize('text, words', [
    ('[]\n', 'line 1: '), ('{"format": "x", "version": 1, "mount": "altaz"}\n',
                           'not the state of a plan'),
    ('{"format": "telescope_mount plan state", "version": 1, "mount": "german"}\n',
     'of a mount german, and this one is altaz')])
def test_a_file_that_is_none_is_refused(tmp_path, text, words):
    (tmp_path / 'f').write_text(text)
    with pytest.raises(ValueError, match=words):
        NightFile(tmp_path / 'f', 'altaz')


# --- given up, and begun again by hand ------------------------------------------------------------


def test_a_plan_that_was_given_up_goes_on_where_it_stopped_unless_asked():
    bench = Bench('stars 4')
    bench.until(lambda: len(bench.rows) == 2)
    bench.plan.cancel('by hand')
    assert bench.plan.stopped_at('stars 4') == 'step 1, stars 4'
    assert bench.plan.stopped_at('stars 5') == ''
    bench.plan.start('stars 4')
    assert bench.run() == ('done', 'plan finished')
    assert len(bench.rows) == 4 and len({row['star'][0] for row in bench.rows}) == 4
    assert bench.plan.stopped_at('stars 4') == ''


def test_anew_if_asked():
    bench = Bench('stars 4')
    bench.until(lambda: len(bench.rows) == 2)
    bench.plan.cancel('by hand')
    bench.plan.start('stars 4', anew=True)
    assert bench.run() == ('done', 'plan finished') and len(bench.rows) == 6


def test_stars_that_clouds_have_taken_are_tried_again():
    bench = Bench('stars 4', give_up_s=20.0)
    bench.until(lambda: len(bench.rows) == 1)
    bench.miss = lambda number: (np.nan, np.nan)
    bench.until(lambda: bench.plan.progress.lost == 1)
    bench.plan.cancel('clouds')
    bench.miss = lambda number: (1e-6 * ARCSEC * number, 0.0)
    bench.plan.start('stars 4')
    assert bench.run() == ('done', 'plan finished') and len(bench.rows) == 4


def test_a_disk_that_is_full_ends_no_night_and_what_waits_is_written_when_there_is_room(
        tmp_path, monkeypatch):
    import os
    path = tmp_path / 'state'
    kept = NightFile(path, 'altaz')
    kept.row({'star': 1})

    def full(file):
        raise OSError(28, 'No space left on device')
    with monkeypatch.context() as patch:
        patch.setattr(os, 'fsync', full)
        kept.row({'star': 2})
        kept.row({'star': 3})
        assert str(path) in kept.error and 'No space left' in kept.error
    kept.row({'star': 4})
    assert kept.error == ''
    assert [row['star'] for row in NightFile(path, 'altaz').kept.rows] == [1, 2, 3, 4]
