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

"""Where observations are proposed."""

from types import SimpleNamespace

import numpy as np
import pytest
from simulated import FAST

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.next_observations import _grid, _members
from calibration.analysis.diagnosis.observation_places import BEYOND, on_turn, places_under
from msg_tools.units import ARCSEC, DEG
from pointing_model.context import Context
from pointing_model.mounts import ALTAZ, Mount, is_beyond
from pointing_model.runs.run import PointingRun
from pointing_model.sky.skyline import parse_horizon


@pytest.mark.parametrize('seen, inside, outside', [
    ((10.0, 60.0, 175.0), (6.0, 100.0, 179.0), (-58.0, 228.0, 255.0, 4.0, 181.0)),
    ((350.0, 20.0, 60.0), (346.0, 0.0, 64.0, -10.0), (90.0, 180.0, 340.0)),  # across zero
    ((0.0, 90.0, 180.0, 260.0), (45.0, 359.0), (300.0,)),
    ((40.0,), (36.0, 44.0), (220.0, 50.0))])
def test_an_axis_has_been_where_it_was_and_between(seen, inside, outside):
    seen = np.array(seen) * DEG
    assert on_turn(seen, np.array(inside) * DEG)[1].all()
    assert not on_turn(seen, np.array(outside) * DEG)[1].any()


def test_angles_lie_on_the_turn_of_the_rows():
    seen = np.array([3.7, 175.2]) * DEG
    angles, _ = on_turn(seen, np.array([-180.0, 180.0, -1.0, 90.0]) * DEG)
    np.testing.assert_allclose(angles / DEG, [180.0, 180.0, -1.0, 90.0])
    other, _ = on_turn(-seen, np.array([180.0, -90.0]) * DEG)
    np.testing.assert_allclose(other / DEG, [-180.0, -90.0])


def test_possible_places_are_on_the_turn_of_the_rows():
    mount = Mount.equatorial(31.0 * DEG, 'german')
    first, second = np.array([3.0, 60.0, 120.0, 177.0]) * DEG, np.array([40, 20, 150, 120]) * DEG
    context = Context(first, second, mount=mount)
    places = _grid(context).context.az
    # a straight line of the angle has no jump at half a turn, where the grid has directions
    assert places.min() > first.min() - 2.0 * BEYOND and places.max() < first.max() + 2.0 * BEYOND
    assert np.any(np.abs(places - np.pi) < 1e-9)


def test_where_the_axis_has_not_been_the_places_of_the_rows_are_left():
    mount = Mount.equatorial(31.0 * DEG, 'german')
    context = Context(np.full(3, 90.0) * DEG, np.array([20, 30, 40]) * DEG, mount=mount)
    az, el, side = places_under(context, 80.0 * DEG, 81.0 * DEG, [-1.0, 1.0])  # near the zenith
    np.testing.assert_array_equal(az, np.repeat(context.az, 2))
    np.testing.assert_array_equal(el, np.repeat(context.el, 2))
    np.testing.assert_array_equal(side, [-1.0, 1.0] * 3)


@pytest.mark.parametrize('mount', [Mount.equatorial(31.0 * DEG, 'german'),
                                   Mount.equatorial(31.0 * DEG, 'equatorial'), ALTAZ])
def test_nothing_is_proposed_behind_the_skyline(mount):
    rng = np.random.default_rng(2)
    sky = rng.uniform(0.0, 360.0, 200) * DEG, rng.uniform(20.0, 80.0, 200) * DEG
    first, second = mount.axes_of(*sky)
    run = PointingRun({'az': first, 'el': second, 'az_enc': first, 'el_enc': second},
                      {'mount': mount, 'skyline': parse_horizon(
                          '0 10, 90 10, 90 60, 180 60, 180 10')})
    places = {}
    for known in (False, True):
        if not known:
            run.meta['skyline'], kept = (), run.meta['skyline']
        else:
            run.meta['skyline'] = kept
        az, el = _grid(Context.from_run(run)).context.on_horizon()
        behind = (np.mod(az, 2.0 * np.pi) > 89.0 * DEG) & (
            np.mod(az, 2.0 * np.pi) < 181.0 * DEG) & (el < 60.0 * DEG)
        places[known] = len(az), int(behind.sum())
    assert places[False][1] > 0 == places[True][1] and places[True][0] > 0.5 * places[False][0]


def test_no_star_is_proposed_with_the_counterweight_up():
    mount = Mount.equatorial(31.0 * DEG, 'german')
    rng = np.random.default_rng(5)
    ha = rng.uniform(5.0, 175.0, 120) * DEG
    dec = rng.uniform(-10.0, 70.0, 120) * DEG
    beyond = np.arange(120) % 2 == 0
    first = ha  # the counterweight is down, on either side
    second = np.where(beyond, np.pi - dec, dec)
    high = mount.horizon_of(first, second)[1] > 20.0 * DEG
    first, second = first[high], second[high]
    # it grows with the hour angle, which noise does not tell from several others
    wave = 5.0 * ARCSEC * first
    noise = 1.5 * rng.normal(size=(2, len(first))) * ARCSEC
    run = PointingRun({
        'az': first, 'el': second, 'az_enc': first + wave + noise[0] / np.cos(second),
        'el_enc': second + noise[1]}, {'mount': mount, 'site': (31.0 * DEG, 0.0)})
    assert is_beyond(second).any() and not is_beyond(second).all()
    result = diagnose(run, **FAST)
    angles = np.array([one['ha_deg'] for one in result.next_observations])
    assert len(angles) >= 6
    assert (np.mod(angles + BEYOND / DEG, 360.0) < 180.0 + 2.0 * BEYOND / DEG).all()


def test_each_of_a_pair_has_what_its_own_model_has():
    def named(*names):
        return [SimpleNamespace(name=name) for name in names]

    def members(companions):
        best, rival, shared = _members(None, *named('a'), named('c', 'd'), *named('b'), companions)
        return [[e.name for e in part] for part in (best, rival, shared)]
    assert members(None) == [['a'], ['b'], ['c', 'd']]
    own = [SimpleNamespace(effect=lambda problem, e=e: e) for e in named('d', 'f')]
    assert members(own) == [['a', 'c'], ['b', 'f'], ['d']]
