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

import numpy as np
import pytest

from encoder_reading.angle_output import LONGEST_GAP, Velocities

SECOND = 1_000_000_000


def test_two_good_readings_tell_a_velocity_and_the_shorter_way_round():
    velocities = Velocities()
    assert np.isnan(velocities(0, [6.2, 1.0])).all()
    first, second = velocities(SECOND // 10, [0.1, 0.9])
    assert first == pytest.approx((0.1 - 6.2 + 2.0 * np.pi) / 0.1)
    assert second == pytest.approx(-1.0)
    assert np.isnan(velocities(SECOND // 5, [np.nan, 0.8])).tolist() == [True, False]
    assert np.isnan(velocities(SECOND // 2, [0.1, 0.7])).tolist() == [True, False]


def test_none_over_a_long_gap_of_one_time_or_of_what_was_before():
    velocities = Velocities()
    longest = int(LONGEST_GAP * SECOND)
    velocities(0, [0.0, 0.0])
    assert np.isfinite(velocities(longest, [0.1, 0.1])).all()
    assert np.isnan(velocities(longest, [0.1, 0.1])).all()
    assert np.isnan(velocities(2 * longest + 1, [0.1, 0.1])).all()
    velocities.forget()
    assert np.isnan(velocities(2 * longest + 2, [0.1, 0.1])).all()
