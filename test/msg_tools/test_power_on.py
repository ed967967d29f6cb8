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

from msg_tools.power_on import PowerOn, read_frame, since


def test_there_and_back_to_the_bit():
    rng = np.random.default_rng(1)
    for ns in rng.integers(10**18, 2 * 10**18, 200):
        told = PowerOn(3, since(int(ns)))
        assert read_frame(told.frame) == told
        assert abs(told.started - ns * 1e-9) < 6e-4


@pytest.mark.parametrize('frame', ['', 'mount_enu', 'power_on_2', 'power_on_x@1.0', 'power_on_2@'])
def test_a_frame_that_tells_no_power_on(frame):
    assert read_frame(frame) is None
