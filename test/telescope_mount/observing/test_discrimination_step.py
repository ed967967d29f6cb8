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

"""The step `tell_apart`: stars that the calibration asks for."""

import json
import logging

import numpy as np
import pytest
from bench import START, Bench

from msg_tools.units import DEG, wrap
from pointing_model.calibration_messages import (
    ASKS,
    CANNOT,
    CAUSES_FORMAT,
    CAUSES_VERSION,
    ONE_CAUSE,
    StarRequest,
)
from pointing_model.sky.star_catalogue import load_catalogue
from telescope_mount.observing.plan import parse_plan
from telescope_mount.observing.star_choice import nearest_star


def document(stamp, state=ASKS, **request):
    """As the calibration publishes it."""
    return json.dumps({
        'format': CAUSES_FORMAT, 'version': CAUSES_VERSION, 'last_stamp_ns': stamp,
        'diagnosed_ns': START,
        'state': state, 'says': f'it is {state}', 'sets': [], 'request': {
            'az_deg': 90.0, 'el_deg': 45.0, 'approach_az': 0, 'approach_el': 0, 'before': None,
            'after_hours': None, 'magnitude': None, 'why': 'to tell one from the other',
            **request} if state == ASKS else None})


class Calibration:
    """Answers each row with the next of some requests, then says that one cause is left."""

    def __init__(self, bench, *requests, end=ONE_CAUSE):
        self.bench, self.requests, self.end, self.rows = bench, list(requests), end, 0
        bench.offers('diagnose', self.diagnose)

    def diagnose(self):
        self.tell()
        self.bench.takes_model(self.bench.table.newest or START)
        self.bench.takes_zero(START, 0.0, 0.0)

    def tell(self):
        stamp, request = self.bench.table.newest or 0, self.requests[:1]
        self.bench.plan.take_request(StarRequest.read(document(stamp, ASKS, **request[0]) if request
                                             else document(stamp, self.end)))

    def run(self):
        bench = self.bench
        bench.calibrates()
        while bench.plan.busy:
            bench.until(lambda: len(bench.rows) > self.rows or not bench.plan.busy)
            new, self.rows = len(bench.rows) > self.rows, len(bench.rows)
            if new:
                self.requests.pop(0)
                self.tell()
            bench.calibrates()
        return bench.plan.progress.state


def test_stars_are_taken_where_they_are_asked_for_until_nothing_is_asked(caplog):
    caplog.set_level(logging.INFO, 'bench')
    bench = Bench('stars 1, tell_apart 5', magnitude_limit=5.5)
    places = {'az_deg': 200.0, 'el_deg': 35.0}, {'az_deg': 20.0, 'el_deg': 60.0}
    calibration = Calibration(bench, {}, *places)
    assert calibration.run() == 'done'
    assert len(bench.rows) == 3 and bench.calls == ['diagnose']  # with all of them
    for row, place in zip(bench.rows[1:], places):
        off = np.hypot(wrap(row['az'][0] - place['az_deg'] * DEG) * np.cos(row['el'][0]),
                       row['el'][0] - place['el_deg'] * DEG)
        assert off < 5.0 * DEG
    told = [text for _, text in bench.statuses]
    assert sum('to tell one from the other' in text for text in dict.fromkeys(told)) == 2
    assert 'it is one cause' in caplog.messages


def test_an_axis_comes_from_the_side_that_is_asked_for():
    for side in (-1, 1):
        bench = Bench('tell_apart 1')
        Calibration(bench, {'approach_az': side, 'az_deg': 150.0}).run()
        assert bench.rows[0]['approach_az'][0] == side
    # a short move back on the star before, with nothing between
    bench = Bench('tell_apart 4')
    Calibration(bench, {
        'az_deg': 90.0, 'approach_az': 1, 'before': {
            'az_deg': 86.0, 'el_deg': 45.0, 'approach_az': -1, 'approach_el': 0}}, {}).run()
    first, second = (row['az'][0] for row in bench.rows[:2])
    assert [row['approach_az'][0] for row in bench.rows[:2]] == [-1, 1]
    assert 0.0 < wrap(second - first) < 40.0 * DEG


def test_the_step_ends_with_its_stars_or_its_time(caplog):
    caplog.set_level(logging.INFO, 'bench')
    bench = Bench('tell_apart 1')
    Calibration(bench, {}, {'az_deg': 10.0}).run()
    assert len(bench.rows) == 1 and bench.calls == ['diagnose', 'diagnose']
    assert 'it is asks; stopped after the planned 1 stars' in caplog.messages
    bench = Bench('tell_apart 5')
    Calibration(bench, {'after_hours': 2.0}).run()
    assert not bench.rows
    assert 'it is asks; needs a star 2 h later, but the plan waits 0 h' in caplog.messages
    bench = Bench('stars 1, tell_apart 5 2.5h')
    calibration = Calibration(bench, {}, {'after_hours': 2.0}, {'after_hours': 1.0}, end=CANNOT)
    calibration.run()
    times = [row['time'][0] for row in bench.rows]
    assert len(times) == 2 and 7200.0 <= times[1] - times[0] < 7300.0


def test_a_plan_says_how_many_and_how_long():
    step, = parse_plan('tell_apart 15 2h')
    assert (step.verb, step.count, step.hours, step.exposures) == ('tell_apart', 15, 2.0, 15)
    assert parse_plan(str(step)) == [step] and parse_plan('tell_apart 3')[0].hours == 0.0
    for bad in ('tell_apart', 'tell_apart 2h', 'tell_apart 3 2', 'tell_apart 0', 'tell_apart 3 xh'):
        with pytest.raises(ValueError, match='such as 2h'):
            parse_plan(bad)


def test_the_nearest_star_of_a_magnitude_and_a_side():
    stars = load_catalogue(mag_limit=6.0)
    place = 1.0, 0.8
    row, off = nearest_star(stars, START * 1e-9, *place, mag_limit=4.0)
    assert stars.mag[row] <= 4.0 and 0.0 < off < 15.0 * DEG
    faint, farther = nearest_star(stars, START * 1e-9, *place, mag_limit=4.0,
                                  exclude=[stars.hip[row]])
    assert faint != row and farther >= off
    bright, _ = nearest_star(stars, START * 1e-9, *place, mag_limit=4.0, magnitude=0.5)
    assert stars.mag[bright] <= 1.5
    with pytest.raises(ValueError, match='raise the magnitude limit'):
        nearest_star(stars, START * 1e-9, *place, mag_limit=-3.0)


def test_what_is_no_such_document_is_refused():
    assert StarRequest.read(document(5, CANNOT)).request is None
    for bad in ('x', '{}', '[]', json.dumps({**json.loads(document(5)), 'version': 9}),
                json.dumps({**json.loads(document(5)), 'request': {'az_deg': 'x'}})):
        with pytest.raises(ValueError, match='no document of causes'):
            StarRequest.read(bad)
