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

"""What the benchmark's instruments say when they lie, and what counts as a falsehood."""


import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from faults import FAULTS, Result, night

from msg_tools import convert, topics

NOW = 1_768_482_000 * 10**9


def said(name, count=3):
    """What an instrument passes on: (seconds from now, values) for each of `count` messages."""
    liar = FAULTS[name]()
    out = []
    for i in range(count):
        values, stamp = np.array([1.0 + 0.1 * i, 0.5]), NOW + i * 10**9
        camera = liar.topic is topics.MISS_DISTANCE
        message = liar.change(convert.sky_vector(stamp, *values) if camera else
                              convert.joint_state(stamp, values, frame='power_on_1@1.0'),
                              liar.memory)
        got = (convert.read_sky_vector(message) if camera else
               convert.read_joints(message)[1])
        out.append((round((convert.from_stamp(message.header.stamp) - NOW) * 1e-9, 3),
                    round(got[0], 4), got[1]))
    return out


@pytest.mark.parametrize('name, wanted', [
    ('camera says zero', [(0, 0, 0), (1, 0, 0), (2, 0, 0)]),
    ('camera frozen', [(0, 1.0, 0.5), (1, 1.0, 0.5), (2, 1.0, 0.5)]),
    ('camera mirrored', [(0, -1.0, -0.5), (1, -1.1, -0.5), (2, -1.2, -0.5)]),
    ('encoder frozen', [(0, 1.0, 0.5), (1, 1.0, 0.5), (2, 1.0, 0.5)]),
    ('encoder stamps stand', [(0, 1.0, 0.5), (0, 1.1, 0.5), (0, 1.2, 0.5)]),
    ('encoder stamps jump', [(3600, 1.0, 0.5), (3601, 1.1, 0.5), (3602, 1.2, 0.5)]),
    ('encoder stamps run back', [(0, 1.0, 0.5), (-1, 1.1, 0.5), (-2, 1.2, 0.5)]),
])
def test_a_liar_says_what_its_name_says(name, wanted):
    assert said(name) == wanted


def test_ten_kinds_and_what_is_a_falsehood():
    assert len(FAULTS) == 10
    assert Result(off_sigma=4.1).false and not Result(off_sigma=3.9).false
    assert not Result(off_sigma=40.0, words=['refused']).false and not Result().false


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('node', ['star_observer', 'mount_guard'])
def test_a_simulated_night_goes_on_when_a_node_is_killed_and_teaches_nothing_false(tmp_path, node):
    result = night(tmp_path, seed=1, moment=20, node=node)
    assert result.completed, result.ended
    assert result.off_sigma < 4.0 and result.off_arcsec < 2.0 and result.words == []
