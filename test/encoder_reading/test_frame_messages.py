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

from encoder_reading.axis_reader import AxisReader
from encoder_reading.design import Design
from encoder_reading.frame_messages import frame_message, read_frame


def test_frames_there_and_back():
    rng = np.random.default_rng(1)
    axes = [AxisReader(Design(heads=2), 'azimuth'), AxisReader(Design(pixels=2048), 'elevation')]
    frames = [rng.integers(0, 256, (2, 1800), dtype=np.uint8),
              rng.integers(0, 256, (1, 2048), dtype=np.uint8)]
    message = frame_message(5_000_000_001, frames)
    assert (message.height, message.width, message.step) == (3, 2048, 2048)
    stamp, back = read_frame(message, axes)
    assert stamp == 5_000_000_001
    assert all(np.array_equal(*pair) for pair in zip(frames, back))
    assert not any(part.flags.owndata for part in back)
