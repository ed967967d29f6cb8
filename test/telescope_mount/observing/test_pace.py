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

"""A plan on a slow mount: nearer stars, that stay within the limits for longer."""

import numpy as np
import pytest
from bench import START, Bench

from msg_tools.units import DEG, wrap
from pointing_model.sky.places import observed_place
from pointing_model.sky.star_catalogue import load_catalogue
from telescope_mount.observing.star_order import observing_order, seconds_a_star, weight_of_slews

STARS = 20


def places(rate, moment):
    """Azimuth and elevation of the stars of a plan, as they were observed, `moment` s on."""
    bench = Bench(f'stars {STARS}', slew_rate_deg_s=rate)
    bench.calibrates()
    assert bench.run()[0] == 'done'
    stars = load_catalogue(hip=[int(row['star'][0]) for row in bench.rows])
    assert len(stars) == STARS
    return observed_place(stars, START * 1e-9 + moment)


@pytest.mark.parametrize('rate', [4.0, 1.0, 0.25])
def test_stars_stay_up_until_the_last_is_due(rate):
    for part in (0.0, 0.5, 1.0):
        _, el = places(rate, part * STARS * seconds_a_star(rate))
        assert el.min() >= 20.0 * DEG - 1e-3 and el.max() <= 85.0 * DEG + 1e-3


def test_what_a_slow_mount_is_given():
    assert [seconds_a_star(rate) for rate in (4.0, 1.0, 0.5)] == [40.0, 85.0, 145.0]
    assert [weight_of_slews(rate) for rate in (20.0, 4.0, 0.01)] == [1.0, 1.0, 3.0]
    assert 1.0 < weight_of_slews(1.0) < 3.0


def test_a_slow_mount_slews_less():
    slews = {rate: [] for rate in (4.0, 0.5)}
    for seed in range(4):
        rng = np.random.default_rng(seed)
        az, el = rng.uniform(0.0, 2.0 * np.pi, 30), np.arcsin(rng.uniform(0.34, 0.996, 30))
        for rate, lengths in slews.items():
            order = observing_order(az, el, np.random.default_rng(seed), (0.0, 0.5),
                                    slews=weight_of_slews(rate))
            lengths.append(np.maximum(np.abs(wrap(np.diff(az[order]))),
                                      np.abs(np.diff(el[order]))).mean())
    assert np.mean(slews[0.5]) < 0.9 * np.mean(slews[4.0])
