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

"""The skyline, held against the polygon of its corners by code of the benchmark's own."""


import numpy as np
import pytest
import skylines

from msg_tools.units import DEG
from pointing_model.sky.skyline import Horizon, parse_horizon

#: 50 deg high up to a wall at azimuth 45
WALL = '0 50, 45 50, 45 10, 180 10'


def over(text, az):
    return Horizon(0.0, parse_horizon(text)).at(np.array(az) * DEG) / DEG


def test_a_wall_stays_a_wall_and_its_higher_side_counts():
    assert over(WALL, [30.0, 44.9, 45.0, 45.1, 100.0]) == pytest.approx(
        [50.0, 50.0, 50.0, 10.0, 10.0], abs=1e-6)


@pytest.mark.parametrize('text', [
    '180 10, 45 10, 45 50, 0 50', '360 50, 45 50, 45 10, 180 10', '45 10, 180 10, 0 50, 45 50',
    '45 50, 45 10, 180 10, 360 50, 45 50', '-315 50, -315 10, -180 10, 0 50', f'{WALL}, 360 50',
    '0 50, 45 50, 45 30, 45 10, 180 10'])
def test_a_skyline_is_one_in_whichever_way_it_is_written(text):
    az = np.append(np.linspace(-400.0, 400.0, 801), 45.0)
    assert over(text, az) == pytest.approx(over(WALL, az), abs=1e-6)


@pytest.mark.parametrize(('text', 'az', 'heights'), [
    ('350 10, 350 40, 10 40, 10 10', [340.0, 355.0, 5.0, 20.0], [10.0, 40.0, 40.0, 10.0]),
    ('200 5, 30 20, 100 20', [210.0, 65.0], [5.0 + 15.0 / 19.0, 20.0]),
    ('350 10, 10 20, 200 5', [0.0, 105.0], [15.0, 12.5]),
    ('-10 40, 10 40, 10 5, 350 5', [0.0, 9.9, 10.1, 180.0, 349.9], [40.0, 40.0, 5.0, 5.0, 5.0]),
    ('0 10, 90 10, 90 60, 90 10', [89.9, 90.0, 90.1], [10.0, 60.0, 10.0]),
    ('0 10, 360 20', [0.0, 90.0, 359.999], [20.0, 12.5, 20.0]),
    ('70 15', [0.0, 70.0], [15.0, 15.0]), ('0 10, 0 20', [0.0, 180.0], [20.0, 15.0])])
def test_special_shapes_of_a_skyline_are_what_they_say(text, az, heights):
    assert over(text, az) == pytest.approx(heights, abs=1e-3)


@pytest.mark.parametrize('text', [
    '0 12, 90 20, 45 30, 180 8', '10 5, 100 20, 50 10, 200 20, 300 5', '0 12, 90 20, 45 30',
    '-20 10, 100 20, 350 30', '200 5, 100 5, 0 5, 260 5, 190 5', '350 30, 100 20, -20 10',
    '100 50, 140 50, 140 10, 100 10', '100 50, 200 50, 200 10, 100 10'])
def test_a_skyline_that_goes_back_and_forth_is_refused_in_one_line(text):
    with pytest.raises(ValueError, match='^corner .* of the horizon: azimuths go back') as caught:
        parse_horizon(text)
    assert '\n' not in str(caught.value)


def test_no_target_beside_random_skylines_is_judged_wrong():
    rng, wrong, buildings = np.random.default_rng(7), {}, 0
    for _ in range(12):
        corners = skylines.drawn(rng)
        found, _, building = skylines.judged(rng, corners, skylines.written(rng, corners), 40)
        wrong = {name: wrong.get(name, 0) + count for name, count in found.items()}
        buildings += building
    assert buildings > 100
    assert not any(wrong.values()), wrong


def test_the_highest_of_a_skyline_between_two_azimuths_is_exact():
    rng = np.random.default_rng(4)
    for _ in range(20):
        horizon = Horizon(0.1, skylines.drawn(rng) * DEG)
        first, span = rng.uniform(-10.0, 10.0), rng.uniform(0.0, 7.0)
        dense = horizon.at(np.linspace(first, first + span, 2000)).max()
        ends = np.array([az for az, _ in horizon.points])
        for turn in range(-4, 5):
            at = ends + 2.0 * np.pi * turn
            at = at[(first <= at) & (at <= first + span)]
            dense = max(dense, horizon.at(at).max(initial=0.1))
        assert horizon.highest_between(first, first + span) == pytest.approx(dense, abs=1e-9)
        both = horizon.highest(np.array([first + span / 2.0]), np.array([span / 2.0]))
        assert both[0] == pytest.approx(dense, abs=1e-9)
    assert Horizon(0.3).highest_between(0.0, 1.0) == 0.3
