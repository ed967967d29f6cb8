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

"""Places visited again: noise of a visit, what moved between, and whether in a step."""

import numpy as np
import pytest

from calibration.estimation.revisits import SAME_PLACE, Revisits


def two_passes(seed, places=20, size=0.0, noise=1.0, place=0.0, curve=None, **more):
    """Visits of the same places in two passes, each in an order of its own."""
    rng = np.random.default_rng(seed)
    az = 2.0 * np.pi * np.arange(places) / places
    el = np.where(np.arange(places) % 2, 0.5, 0.9)
    order = np.concatenate([rng.permutation(places) for _ in range(2)])
    direction = np.array([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)])[:, order]
    n = 2 * places
    own = place * rng.normal(size=(2, places))[:, order]
    value = own + noise * rng.normal(size=(2, n))
    value[1] += size * (np.arange(n) >= places)
    if curve is not None:
        value[1] += curve(rng, n)
    return Revisits(direction, np.arange(n) * 60.0, value, SAME_PLACE, **more)


def test_the_noise_of_a_visit_has_nothing_of_the_places_in_it():
    visits = two_passes(1, places=40, place=50.0)
    assert visits.places == visits.differences == 40 and len(visits.rows) == 80
    assert visits.move is None and not visits.at_once
    assert np.allclose(visits.noise, 1.0, rtol=0.3)


def test_a_step_between_two_passes_is_found_and_is_one():
    visits = two_passes(2, size=5.0)
    move = visits.move
    assert move.axis == 1 and visits.at_once
    assert abs(move.amount - 5.0) < 4.0 * move.sigma < 2.0
    assert (move.before, move.after) == (19, 20) and move.both == 20 and move.chance < 0.02
    assert np.allclose(visits.noise, 1.0, rtol=0.5)


def test_a_step_is_found_beside_errors_of_the_places_and_wild_rows():
    def wild(rng, n):
        return np.where(np.arange(n) % 20 == 4, 300.0, 0.0)
    visits = two_passes(3, places=30, size=6.0, place=30.0, curve=wild)
    assert visits.move.axis == 1 and abs(visits.move.amount - 6.0) < 2.0


def test_all_rows_say_where_a_step_of_both_zeros_is():
    right = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        n, first = 96, int(rng.integers(24, 72))
        place = np.concatenate([rng.permutation(8) for _ in range(12)])
        az, el = np.pi / 4.0 * place, np.where(place % 2, 0.5, 0.9)
        design = np.array([np.cos(az), np.sin(az), np.sin(el), np.ones(n)])
        value = rng.normal(size=(2, n)) + 8.0 * (np.arange(n) >= first)
        value[0, rng.choice(n, 3, replace=False)] += 40.0
        for axis in (0, 1):  # the model has zeros that do not change
            value[axis] -= np.linalg.lstsq(design.T, value[axis], rcond=None)[0] @ design
        # pairs of rows may be one visit: some begin before the step and end after it
        same = np.arange(n) - (np.diff(place, prepend=-1) == 0)
        direction = np.array([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)])
        visits = Revisits(direction, np.arange(n) * 60.0, value, SAME_PLACE, (design, design),
                          group=same)
        move = visits.move
        assert move.after == move.before + 1 and move.both == 8
        assert abs(move.amount - 8.0) < 4.5 * move.sigma
        assert np.allclose(visits.noise, 1.0, atol=0.3)
        right += move.after == first
    assert right >= 18


def test_a_step_is_sought_beside_zeros_of_their_own():
    visits = two_passes(6, places=40, size=8.0, zero=np.repeat([0, 1], [20, 60]))
    assert visits.zeros == 2 and (visits.move.before, visits.move.after) == (39, 40)


def test_of_white_noise_little_moves():
    found = [two_passes(seed, places=8 + seed % 20).move for seed in range(100)]
    assert sum(one is not None for one in found) <= 2


@pytest.mark.parametrize('curve', [
    lambda rng, n: np.cumsum(rng.normal(0.0, 0.7, n)),
    lambda rng, n: 8.0 * np.arange(n) / n,
    lambda rng, n: 5.0 * np.sin(2.0 * np.pi * np.arange(n) / n)], ids=['walk', 'drift', 'wave'])
def test_a_zero_that_wanders_has_moved_but_in_no_step(curve):
    every = [two_passes(seed, curve=curve) for seed in range(25)]
    assert sum(visits.move is not None for visits in every) > 5
    assert sum(visits.at_once for visits in every) <= 1


def test_a_worm_on_a_tracked_star_is_no_step_between_visits():
    time = 10.0 * np.arange(720.0)
    az = 7.3e-5 * time
    direction = np.array([np.sin(az), np.cos(az), 0.5 + 0.0 * az])
    value = np.random.default_rng(1).normal(size=(2, 720)) + [12.0 * np.sin(180.0 * az), 0.0 * az]
    assert Revisits(direction / np.hypot(1.0, 0.5), time, value, SAME_PLACE).move is None


def test_exposures_of_one_visit_are_no_second_visit():
    direction = np.tile(np.array([[0.0], [0.6], [0.8]]), 24)
    value = np.random.default_rng(5).normal(size=(2, 24))
    one = Revisits(direction, np.arange(24.0), value, SAME_PLACE, group=np.arange(24) // 12)
    assert one.differences == 1 and [len(rows) for rows in one.rows] == [12, 12]
    # the other side of the pier is another place
    assert Revisits(direction, np.arange(24.0), value, SAME_PLACE,
                    side=np.arange(24) // 12).differences == 22
    every = Revisits(direction, np.arange(24.0), value, SAME_PLACE)
    assert one.move is None and every.differences == 23
