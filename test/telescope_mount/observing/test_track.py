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

"""The step `track`: the stars that keep the expected error of a tracked model below a goal."""

import re

import numpy as np
import pytest
from bench import START, Bench

from calibration.analysis.tracking.tracked_night import TrackedNight
from msg_tools.units import ARCSEC, DEG
from pointing_model.active_calibration import tracked_sigma
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.zero import PowerOnZero
from telescope_mount.observing.plan import parse_plan
from telescope_mount.observing.tracking_star import SlewTime, next_star, until
from telescope_mount.observing.tracking_step import LONGEST_WAIT, RESERVE, TrackedModel

MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)),
                      np.eye(7) * (0.3 * ARCSEC)**2)


def tracked(stars=0):
    night = TrackedNight(MOUNT, PowerOnZero(0.0, 0.0, run=1.0), START, (ARCSEC, ARCSEC))
    return night, night.model(START)


def test_the_error_grows_until_a_star_is_due():
    model = TrackedModel(tracked()[1])
    az, el = np.linspace(0.0, 6.0, 12), np.full(12, 0.8)
    error = [np.sqrt(np.mean(model.expected(az, el, s).radial**2)) for s in (0.0, 600.0, 3600.0)]
    assert error[0] < error[1] < error[2]
    due = until(model, (az, el), RESERVE * 1.5 * ARCSEC, LONGEST_WAIT)
    at = np.sqrt(np.mean(model.expected(az, el, due).radial**2)) / ARCSEC
    assert at == pytest.approx(0.9 * 1.5, abs=0.01)
    assert until(model, (az, el), 100.0 * ARCSEC, LONGEST_WAIT) == 1800.0
    assert until(model, (az, el), 0.1 * ARCSEC, LONGEST_WAIT) == 0.0


def test_a_star_that_is_far_costs_its_slew():
    model = TrackedModel(tracked()[1])
    az, el = np.array([0.1, 3.0]), np.full(2, 45.0 * DEG)
    for here in (0.1, 3.0):
        chosen = next_star(model, az, el, (here, 45.0 * DEG), (az, el), 600.0, sigma=model.noise,
                           slew=SlewTime((1.0 * DEG, 1.0 * DEG)))
        assert az[chosen.row] == here and chosen.after < chosen.before


def test_demands_tell_what_has_drifted_since_the_last_star():
    model = tracked()[1]
    now, later = (tracked_sigma(model, START + s * 10**9, 1.0, 0.8) for s in (0, 3600))
    assert np.all(now == 0.0) and np.all(later > 0.5 * ARCSEC)
    walks = model.provenance['tracked']['walk_arcsec_per_root_hour']
    assert later[1] == pytest.approx(np.sqrt(
        walks['IE']**2 + (walks['AN'] * np.cos(1.0))**2 + (walks['AW'] * np.sin(1.0))**2
        + (walks['TF'] * np.cos(0.8))**2) * ARCSEC)
    assert np.all(tracked_sigma(MOUNT, START, 1.0, 0.8) == 0.0)
    model.provenance['tracked'] = {'walk_arcsec_per_root_hour': {}}
    with pytest.raises(ValueError, match='damaged'):
        tracked_sigma(model, START, 1.0, 0.8)
    with pytest.raises(ValueError, match='damaged'):
        TrackedModel(model)


def test_a_plan_may_hold_an_error():
    step, = parse_plan('track 1.5arcsec 90')
    assert (step.verb, step.count, step.exposures) == ('track', 90, 0)
    assert step.goal == 1.5 * ARCSEC and parse_plan(str(step)) == [step]
    assert parse_plan('track 2arcsec')[0].count == 60
    assert parse_plan('track 2arcsec 30min')[0].count == 30
    for bad in ('track', 'track 2', 'track 0arcsec 5', 'track 2arcsec 0', 'track 2arcsec 5 6',
                'track xarcsec', 'track nanarcsec'):
        with pytest.raises(ValueError, match='such as track 1.5arcsec 90'):
            parse_plan(bad)


def test_stars_are_taken_when_the_error_reaches_the_goal():
    bench = Bench('track 2arcsec 120')
    night, model = tracked()
    bench.in_force.update_model(model.to_json())
    bench.in_force.update_zero(START, PowerOnZero(0.0, 0.0, run=1.0))
    taken = 0
    while bench.plan.busy:
        bench.until(lambda taken=taken: len(bench.rows) > taken or not bench.plan.busy)
        for row in bench.rows[taken:]:
            night.take(row)
            taken += 1
        bench.in_force.update_model(night.model(bench.table.newest).to_json())
        bench.calibrates()
        bench.plan.pointing_changed()
    outcome = re.fullmatch(r'plan finished: (\d+) stars in 120 minutes; expected error at the end '
                           r'([\d.]+) arcsec, goal 2', bench.plan.text)
    assert int(outcome[1]) == len(bench.rows) and 0.5 < float(outcome[2]) < 2.0
    times = np.array([row['time'][0] for row in bench.rows])
    # the rates are not known at first; a mount that stands still needs few stars then
    assert 4 <= len(times) <= 60
    assert np.diff(times)[-1] > np.diff(times)[0] and times[-1] - times[0] < 7200.0
    told = {text for _, text in bench.statuses if 'reduces the expected error from' in text}
    assert len(told) == len(times)


def test_a_calibration_that_does_not_track_ends_the_step():
    bench = Bench('track 2arcsec 120')
    bench.calibrates()
    state, text = bench.run()
    assert state == 'failed' and 'set the calibration to mode track' in text
