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

from calibration.estimation.revisits import Revisits

RADIUS = np.radians(3.0)


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
    return Revisits(direction, np.arange(n) * 60.0, value, RADIUS, **more)


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
    assert 19 * 60.0 < move.position < 20 * 60.0 and move.chance < 0.02
    assert np.allclose(visits.noise, 1.0, rtol=0.5)


def test_a_step_is_found_beside_errors_of_the_places_and_wild_rows():
    def wild(rng, n):
        return np.where(np.arange(n) % 20 == 4, 300.0, 0.0)
    visits = two_passes(3, places=30, size=6.0, place=30.0, curve=wild)
    assert visits.move.axis == 1 and abs(visits.move.amount - 6.0) < 2.0


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


def test_exposures_of_one_visit_are_no_second_visit():
    direction = np.tile(np.array([[0.0], [0.6], [0.8]]), 24)
    value = np.random.default_rng(5).normal(size=(2, 24))
    one = Revisits(direction, np.arange(24.0), value, RADIUS, group=np.arange(24) // 12)
    assert one.differences == 1 and [len(rows) for rows in one.rows] == [12, 12]
    # the other side of the pier is another place
    assert Revisits(direction, np.arange(24.0), value, RADIUS,
                    side=np.arange(24) // 12).differences == 22
    every = Revisits(direction, np.arange(24.0), value, RADIUS)
    assert one.move is None and every.differences == 23
