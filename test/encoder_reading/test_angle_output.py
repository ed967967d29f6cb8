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

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from encoder_reading.angle_output import Batch


def test_what_comes_at_once_is_done_together():
    done = []
    batch = Batch(done.append, lambda: 4)
    batch.finish()
    assert done == []
    for i in range(10):
        batch.add(i)
    assert done == []
    batch.finish()
    batch.finish()
    assert done == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9]]
