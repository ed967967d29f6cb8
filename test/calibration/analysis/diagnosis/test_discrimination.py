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

"""Causes told apart by stars that are asked for, on rules that are not the fitted columns."""

import json

import numpy as np
import pytest
from simulated import FAST, SITE, TRUTH, night

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.discriminating_star import SEPARATE, Points
from calibration.analysis.diagnosis.discrimination import Discrimination
from calibration.analysis.diagnosis.observations import observations
from calibration.report.wording import worded, wording
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model import geometry
from pointing_model.calibration_messages import ASKS, CANNOT, ONE_CAUSE
from pointing_model.effects import effect
from pointing_model.runs.run import PointingRun


class Mount:
    """A mount with an effect, observed star by star."""

    def __init__(self, effect, seed, n=20, low=30.0, high=60.0):
        self._effect, self._rng, self.rows = effect, np.random.default_rng(seed), []
        for _ in range(n):
            self.observe(self._rng.uniform(0.0, 360.0), self._rng.uniform(low, high))

    def observe(self, az_deg, el_deg, approach_az=0, approach_el=0, hours=0.0):
        before = self.rows[-1] if self.rows else {'az': 0.0, 'el': 0.0, 'time': 1.7e9}
        az, el = az_deg * DEG, el_deg * DEG
        sides = np.sign(wrap(az - before['az'])) or 1.0, np.sign(el - before['el']) or 1.0
        row = {'az': az, 'el': el, 'time': before['time'] + 80.0 + 3600.0 * hours,
               'approach_az': approach_az or sides[0], 'approach_el': approach_el or sides[1]}
        x, y = self._rng.normal(size=2) + self._effect(row)
        row['az_enc'], row['el_enc'] = geometry.sky_to_encoder(az, el, TRUTH)
        row['az_enc'] += x * ARCSEC / np.cos(el)
        row['el_enc'] += y * ARCSEC
        self.rows.append(row)

    def run(self):
        return PointingRun({k: np.array([r[k] for r in self.rows]) for k in self.rows[0]},
                           {'site': SITE})

    def told(self, apart, most=15):
        """Ask and observe until nothing is asked: the last judgement, and how many stars."""
        n = len(self.rows)
        while (judged := apart.compare(self.run(), most)).request:
            request = judged.request
            for one in filter(None, (request['before'], request)):
                self.observe(one['az_deg'] + self._rng.normal(), one['el_deg'],
                             one['approach_az'], one['approach_el'])
        return judged, len(self.rows) - n


def disc(row):
    """Of the azimuth encoder: the less of it on the sky the higher."""
    return np.array([4.0 * np.sin(4.0 * row['az'] + 1.0) * np.cos(row['el']), 0.0])


def line(row):
    """Of the line of sight: at every elevation the same."""
    return np.array([2.7 * np.sin(4.0 * row['az'] + 1.0), 0.0])


@pytest.mark.parametrize(('effect', 'cause', 'rival'), [
    (disc, 'azimuth_encoder_4', 'line_of_sight_4'), (line, 'line_of_sight_4', 'azimuth_encoder_4')])
def test_asked_stars_leave_the_cause_and_say_why_they_are_taken(effect, cause, rival):
    for seed in (5,):
        mount = Mount(effect, seed, low=35.0)
        first = diagnose(mount.run(), **FAST)
        assert first.verdict == 'ambiguous'
        apart = Discrimination(first, elevations=(20.0 * DEG, 85.0 * DEG))
        asked = apart.compare(mount.run())
        assert asked.state == ASKS and set(asked.request['separates']) == {cause, rival}
        assert asked.request['approach_az'] == 0 and asked.request['after_hours'] is None
        # where the two differ: beside the elevations of the first run
        assert not 35.0 < asked.request['el_deg'] < 60.0
        assert 'here they differ by' in wording(asked.request['why'])
        json.dumps(worded(asked.to_dict()))
        judged, taken = mount.told(apart)
        (question,) = judged.questions
        assert (judged.state, question.best) == (ONE_CAUSE, cause) and 1 <= taken <= 15
        assert question.out[rival] >= SEPARATE
        # of the rows alone, whatever was asked on the way
        assert apart.compare(mount.run()).to_dict() == judged.to_dict()


def test_a_rival_is_judged_with_companions_of_its_own():
    mount = Mount(disc, 5, low=35.0)
    first = diagnose(mount.run(), **FAST)
    for az, el in zip(range(0, 360, 17), (20.0, 80.0) * 11):
        mount.observe(az, el)
    (question,) = Discrimination(first).compare(mount.run(), most=0).questions
    behind = question.out['line_of_sight_4']
    assert question.best == 'azimuth_encoder_4' and behind >= SEPARATE
    # what explains the rows beside it costs it two coefficients, and no more
    (found,) = [e for e in first.effects if e.other_causes]
    found.beside = {'line_of_sight_4': [effect('encoder', axis='az', order=4)]}
    (question,) = Discrimination(first).compare(mount.run(), most=0).questions
    assert question.stays['line_of_sight_4'] < min(SEPARATE, behind)


def test_a_play_is_looked_for_from_either_side():
    mount = Mount(lambda row: np.array([2.0 * row['approach_az'], 0.0]), 3)
    first = diagnose(mount.run(), **FAST)
    assert first.verdict == 'ambiguous'
    asked = Discrimination(first).compare(mount.run())
    assert asked.request['approach_az'] in (-1, 1) and asked.request['approach_el'] == 0
    spent = Discrimination(first).compare(mount.run(), most=0)
    assert spent.request is None and spent.state == CANNOT


def test_what_no_star_can_tell_is_said_with_what_could():
    def drift(c):
        c['temperature'] = 12.0 - 4.0 * np.linspace(0.0, 1.0, len(c['az']))**0.98
        return 0.0, -3.0 * ARCSEC * c['temperature']
    run = night(11, effect=drift)
    judged = Discrimination(diagnose(run, **FAST)).compare(run)
    assert judged.state == CANNOT and judged.request is None
    (question,) = judged.questions
    assert {question.best, *question.stays} >= {
        'elevation_zero_with_temperature', 'elevation_zero_with_time'}
    assert ' K ' in wording(question.needed[next(iter(question.needed))])
    assert 'cannot be distinguished here' in wording(judged.finding())


def test_what_makes_no_difference_is_not_asked_for():
    run = night(4)
    run['time'][:] -= 8.0 * 3600.0  # it stays dark for some hours
    obs = observations(run)
    nothing = Points(obs, {'azimuth'}, hours=2.0)
    assert set(nothing.later) == {0.1} and not nothing.short.any()
    row = nothing.request(100)
    assert (row['approach_az'], row['approach_el'], row['after_hours'], row['before'],
            row['magnitude'], row['last_move_deg']) == (0, 0, None, None, None, None)
    points = Points(obs, {'time', 'approach_az', 'before_az', 'travel_az', 'magnitude'}, 2.0)
    assert set(points.later) == {0.1, 0.5, 1.0, 2.0}
    time = obs.context.get('time').max()
    assert set(np.round((points.context.get('time') - time) / 3600.0, 6)) == set(points.later)
    j = int(np.flatnonzero(points.short & (points.later == 2.0)
                           & (points.context.columns['approach_az'] == -1.0))[0])
    row = points.request(j)
    assert (row['approach_az'], row['approach_el'], row['after_hours']) == (-1, 0, 2.0)
    # the one before lies where the axis comes from, and was come to from the other side
    assert row['before']['approach_az'] == 1 and row['last_move_deg'] == 2.0
    assert 1.9 < wrap((row['before']['az_deg'] - row['az_deg']) * DEG) / DEG < 30.0
    low = Points(obs, {'magnitude'}, low_deg=10.0, any_magnitude=True)
    assert low.context.get('elevation').min() == pytest.approx(10.0 * DEG)
    assert set(low.context.columns['magnitude']) == {0.0, 9.0}


def test_a_diagnosis_that_leaves_nothing_open_asks_nothing():
    with pytest.raises(ValueError, match='nothing to distinguish'):
        Discrimination(diagnose(night(1), **FAST))
