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

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from msg_tools.convert import joint_state
from pointing_model.calibration_messages import joints_to_zero, zero_to_joints
from pointing_model.zero import PowerOnZero


def test_there_and_back_to_the_bit():
    rng = np.random.default_rng(1)
    for run in (-1, 1, 12_345_678):
        sigma = rng.uniform(1e-7, 1e-5, 2)
        zero = PowerOnZero(*rng.normal(size=2), np.diag(sigma**2), float(run))
        message = zero_to_joints(zero, 5)
        assert message.header.frame_id == f'power_on_{run}'
        stamp, back = joints_to_zero(message)
        assert stamp == 5 and back == zero and isinstance(back.run, int)
        np.testing.assert_array_equal(back.sigma, zero.sigma)


def test_a_zero_says_what_it_goes_with():
    zero = PowerOnZero(0.1, 0.2, run=2, started=1_768_482_000.5, model='3f2a90c1d5e7')
    message = zero_to_joints(zero, 5)
    assert message.header.frame_id == 'power_on_2@1768482000.500/3f2a90c1d5e7'
    _, back = joints_to_zero(message)
    assert (back.run, back.started, back.model) == (2, zero.started, zero.model)
    half = joints_to_zero(zero_to_joints(PowerOnZero(0.1, 0.2, run=2, model='none'), 5))[1]
    assert half.started is None and half.model == 'none'


def test_a_zero_says_that_it_was_got_by_other_stars_than_polaris():
    zero = PowerOnZero(0.1, 0.2, run=2, started=1_768_482_000.5, model='3f2a90c1d5e7',
                       by='stars (5)')
    message = zero_to_joints(zero, 5)
    assert message.header.frame_id == 'power_on_2@1768482000.500/3f2a90c1d5e7+stars'
    assert joints_to_zero(message)[1].by == 'stars'
    # by Polaris the message is as it always was
    by_polaris = zero_to_joints(replace(zero, by='Polaris'), 5)
    assert by_polaris.header.frame_id == 'power_on_2@1768482000.500/3f2a90c1d5e7'
    assert joints_to_zero(by_polaris)[1].by is None


def test_an_older_message_is_of_the_run_that_was_on():
    message = joint_state(7, (0.1, 0.2))
    _, zero = joints_to_zero(message, run=4.0)
    assert zero == PowerOnZero(0.1, 0.2, run=4.0) and zero.covariance is None
    assert joints_to_zero(message)[1].run is None
    # a message that tells its run is believed
    assert joints_to_zero(zero_to_joints(PowerOnZero(0.1, 0.2, run=2), 1), run=4)[1].run == 2


@pytest.mark.parametrize('message, words', [
    (joint_state(1, (np.nan, 0.0)), 'not a number'),
    (joint_state(1, (0.0, 0.0), frame='power_on_x'), 'power_on_x'),
    (joint_state(1, (0.0, 0.0), frame='power_on_2@'), 'power_on_2@')])
def test_what_is_no_zero(message, words):
    with pytest.raises(ValueError, match=words):
        joints_to_zero(message)
