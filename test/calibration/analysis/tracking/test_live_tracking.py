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

"""Rows of a night to a tracker: what counts, power-ons, and the same numbers after a restart."""

import numpy as np
import pytest
from drifting_rows import MOUNT, START, rows

from calibration.analysis.tracking.tracked_night import (
    KEY,
    TrackedNight,
    difference_of,
)
from calibration.calibration_state import CalibrationState
from calibration.report.calibration_wording import tracking_problems
from calibration.report.wording import worded
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.zero import PowerOnZero


def feed(state, run):
    for i in range(len(run)):
        one = run.select([i])
        state.add(one, int(np.rint(one['time'][0] * 1e9)))


def pair(state):
    return state.tracked.pair(state.last_stamp)


def off(model, zero):
    return (model.terms['IA'] / ARCSEC + zero.az / ARCSEC - 310.0,
            model.terms['IE'] / ARCSEC + zero.el / ARCSEC + 170.0)


def test_a_night_is_tracked_from_an_earlier_model_and_goes_on_to_the_bit():
    state = CalibrationState(MOUNT, mode='track')
    first = rows(20, drift=1.0, zero=(140.0, -90.0))
    second = rows(12, 1, run=2.0, zero=(-60.0, 30.0), begin=20)
    feed(state, first)
    found = off(*pair(state))
    assert found == (pytest.approx(159.0, abs=3.0), pytest.approx(-90.0, abs=2.5))
    feed(state, second)
    model, zero = pair(state)
    assert off(model, zero) == (pytest.approx(-60.0, abs=3.0), pytest.approx(30.0, abs=2.5))
    assert zero.run == 2.0 and np.all(zero.sigma == 0.0)
    assert model.provenance[KEY]['stars'] == 32
    again = CalibrationState(MOUNT, mode='track')
    again.add_table(state.observations(), state.last_stamp)
    again.take_up(PointingModel.from_json(model.to_json()))
    assert pair(again)[0].to_json() == model.to_json()
    third = rows(3, 2, run=2.0, zero=(-60.0, 30.0), begin=32)
    for one in (state, again):
        feed(one, third)
    assert pair(again)[0].to_json() == pair(state)[0].to_json()


def test_it_begins_anew_from_a_fit():
    state = CalibrationState(mode='track')
    assert 'needs a model' in tracking_problems(state.tracked)[0]
    feed(state, rows(24, second=0.0))
    state.fit()
    assert state.tracked.stars == 0
    assert difference_of(state.observations())['sigma'] == pytest.approx(
        [0.3 * ARCSEC] * 2, rel=0.6)
    # the incremental encoder loses counts: the absolute one sees it at the first star
    lost = rows(3, 3, zero=(80.0, 0.0), begin=24, second=np.array([[-80.0], [0.0]]))
    lost.columns['az_abs'][1] += 2.0 * np.pi  # it has gone around
    called = []
    for i in range(3):
        feed(state, lost.select([i]))
        called += [text for one in state.tracked.updates for text in worded(one.events)]
    assert len(called) == 1 and called[0].startswith('incremental encoder')
    assert off(*pair(state))[0] == pytest.approx(80.0, abs=4.0)


@pytest.mark.parametrize('given', [2.0, 20.0])
def test_a_row_with_sigmas_counts_by_them_and_by_what_the_fit_found(given):
    both = {f'sigma_{axis}': np.full(24, 0.1 * ARCSEC) for axis in 'xy'}
    state = CalibrationState(mode='track')
    feed(state, rows(24, **both))
    state.fit()
    ratios = state.model.provenance['sigma_ratios']
    assert ratios == pytest.approx([10.0, 10.0], rel=0.5)
    one = rows(1, 3, begin=24, **{name: np.array([given * ARCSEC]) for name in both})
    feed(state, one)
    noise = state.tracked.updates[0].row[2]
    assert noise == pytest.approx(np.multiply(given * ARCSEC, ratios))


def test_rows_to_judge_by_satellites_and_a_frozen_camera_are_left_out():
    night = TrackedNight(MOUNT, PowerOnZero(0.0, 0.0, run=1.0), START)
    assert night.take(rows(3, check=np.ones(3))) == []
    assert night.take(rows(3, begin=3, star=np.full(3, -25544.0))) == []
    frozen = rows(8, begin=6, miss_x=np.full(8, ARCSEC), miss_y=np.full(8, ARCSEC))
    assert len(night.take(frozen)) == 3  # until it is seen that nothing moves
    assert night.take(frozen) == []  # they are known
    with pytest.raises(ValueError, match='without column time'):
        night.take(PointingRun({k: v for k, v in rows(1).columns.items() if k != 'time'}))
    with pytest.raises(ValueError, match='not tracked'):
        TrackedNight.from_model(MOUNT)
    damaged = night.model(START)
    del damaged.provenance[KEY]['evening']['noise']
    with pytest.raises(ValueError, match='evening of a tracked model is damaged'):
        TrackedNight.from_model(damaged)


def test_a_pier_that_leans_is_told_from_a_tube_by_the_inclinometer():
    state = CalibrationState(mode='track')

    def leaning(n, seed, north, **more):
        rng = np.random.default_rng(seed)
        run = rows(n, seed, lean_north=ARCSEC * (7.0 + north + 0.3 * rng.standard_normal(n)),
                   lean_west=ARCSEC * 0.3 * rng.standard_normal(n), **more)
        # AN
        run.columns['az_enc'] = run['az_enc'] + north * ARCSEC * np.sin(run['az']) * np.tan(
            run['el'])
        run.columns['el_enc'] = run['el_enc'] + north * ARCSEC * np.cos(run['az'])
        return run
    feed(state, leaning(24, 21, 0.0))
    state.fit()
    assert state.tracked._tracker.sensors == ('inclinometer',)
    before = pair(state)[0].terms['AN'] / ARCSEC
    called, later = [], leaning(5, 22, 25.0, begin=24)
    for i in range(5):
        feed(state, later.select([i]))
        called += [text for one in state.tracked.updates for text in worded(one.events)]
    assert any(text.startswith('pier, north or south') for text in called)
    model = pair(state)[0]
    assert model.terms['AN'] / ARCSEC - before == pytest.approx(25.0, abs=4.0)
    state.take_up(PointingModel.from_json(model.to_json()))
    assert pair(state)[0].to_json() == model.to_json()
