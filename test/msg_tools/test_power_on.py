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

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from msg_tools.convert import header, values_message
from msg_tools.older_frames import power_on_in
from msg_tools.power_on import (
    PowerOn,
    PowerOns,
    power_on_message,
    read_power_on,
    since,
)


def test_there_and_back_to_the_bit():
    rng = np.random.default_rng(1)
    for ns in rng.integers(10**18, 2 * 10**18, 200):
        told = PowerOn(3, since(int(ns)))
        assert read_power_on(power_on_message(told, int(ns))) == told
        assert abs(told.started - ns * 1e-9) < 6e-4


def test_a_reading_is_of_the_power_on_that_had_begun():
    power_ons = PowerOns()
    assert power_ons.of(header(5 * 10**9, 'mount_enu')) is None
    for number, started in ((1, 10.0), (2, 20.0)):
        power_ons.take(power_on_message(PowerOn(number, started), int(started * 1e9)))
    at = [power_ons.of(header(ns, 'mount_enu')) for ns in (
        9_000_000_000, 10_000_000_001, 19_999_000_000, 20_000_000_000)]
    assert at == [None, (1, 10.0), (1, 10.0), (2, 20.0)]
    # a driver of before says it in each frame; a clock that went back begins anew
    assert power_ons.of(header(1, 'power_on_3@1.500')) == (3, 1.5)
    power_ons.take(power_on_message(PowerOn(1, 5.0), 5 * 10**9))
    assert power_ons.of(header(30 * 10**9, 'mount_enu')) == (1, 5.0)


@pytest.mark.parametrize('values', [{}, {'version': 1}, {'version': 2, 'number': 1, 'started_s': 1},
                                    {'version': 1, 'number': 'x', 'started_s': 1}])
def test_what_is_no_power_on(values):
    with pytest.raises(ValueError, match='power.on'):
        read_power_on(values_message(1, {'power_on': values}))


@pytest.mark.parametrize('frame', ['', 'mount_enu', 'power_on_2', 'power_on_x@1.0', 'power_on_2@'])
def test_a_frame_that_tells_no_power_on(frame):
    assert power_on_in(frame) is None
