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

from msg_tools.convert import joint_state, values_message
from pointing_model.calibration_messages import (
    ZeroPairs,
    joints_to_zero,
    zero_identity,
    zero_to_joints,
)
from pointing_model.zero import PowerOnZero

FULL = PowerOnZero(0.1, 0.2, run=2, started=1_768_482_000.5, model='3f2a90c1d5e7', by='stars')


def messages(zero, ns=5):
    return [zero_to_joints(zero, ns), zero_identity(zero, ns)]


@pytest.mark.parametrize('order', [slice(None), slice(None, None, -1)])
def test_there_and_back_to_the_bit_in_whatever_order(order):
    rng, pairs = np.random.default_rng(1), ZeroPairs()
    for run in (-1, 1, 12_345_678):
        sigma = rng.uniform(1e-7, 1e-5, 2)
        zero = PowerOnZero(*rng.normal(size=2), np.diag(sigma**2), float(run))
        first, second = messages(zero)[order]
        assert pairs.take(first) is None
        stamp, back = pairs.take(second)
        assert stamp == 5 and back == zero and isinstance(back.run, int)
        np.testing.assert_array_equal(back.sigma, zero.sigma)
        assert pairs.take(messages(zero)[1]) is None  # it is known


@pytest.mark.parametrize('zero, by', [
    (FULL, 'stars'), (PowerOnZero(0.1, 0.2, run=2, model='none'), None),
    (PowerOnZero(0.1, 0.2, run=2, started=1.5, model='none', by='Polaris'), None),
    (PowerOnZero(0.1, 0.2, run=2, by='stars (5)'), 'stars'), (PowerOnZero(0.1, 0.2), None)])
def test_a_zero_says_what_it_goes_with(zero, by):
    pairs = ZeroPairs()
    pairs.take(zero_identity(zero, 5))
    _, back = pairs.take(zero_to_joints(zero, 5))
    assert (back.run, back.started, back.model, back.by) == (zero.run, zero.started, zero.model, by)


def test_halves_of_two_zeros_are_never_put_together():
    pairs = ZeroPairs()
    assert pairs.take(zero_identity(FULL, 5)) is None
    assert pairs.take(zero_to_joints(FULL, 6)) is None
    assert pairs.take(zero_to_joints(PowerOnZero(0.1, 0.3), 5)) is None
    assert pairs.take(zero_to_joints(FULL, 5)) == (5, FULL)


@pytest.mark.parametrize('frame, told', [
    ('', (4.0, None, None, None)), ('power_on_2', (2, None, None, None)),
    ('power_on_2@1768482000.500', (2, FULL.started, None, None)),
    ('power_on_2@1768482000.500/3f2a90c1d5e7', (2, FULL.started, FULL.model, None)),
    ('power_on_2@1768482000.500/3f2a90c1d5e7+stars', (2, FULL.started, FULL.model, 'stars'))])
def test_an_older_zero_says_it_in_its_frame(frame, told):
    stamp, zero = ZeroPairs().take(joint_state(7, (0.1, 0.2), frame=frame), run=4.0)
    assert stamp == 7 and (zero.run, zero.started, zero.model, zero.by) == told
    assert zero.angles.tolist() == [0.1, 0.2] and zero.covariance is None


@pytest.mark.parametrize('message, words', [
    (joint_state(1, (np.nan, 0.0)), 'not a number'),
    (joint_state(1, (0.0, 0.0), frame='power_on_x'), 'power_on_x'),
    (joint_state(1, (0.0, 0.0), frame='power_on_2@'), 'power_on_2@')])
def test_what_is_no_zero(message, words):
    with pytest.raises(ValueError, match=words):
        joints_to_zero(message)


@pytest.mark.parametrize('values, words', [
    ({'version': 2}, "version '2': 1 is known"), ({'version': 1}, 'stamp_ns'),
    ({'version': 1, 'stamp_ns': 5, 'first_rad': 'x', 'second_rad': 0.2}, 'no identity')])
def test_what_is_no_identity(values, words):
    pairs = ZeroPairs()
    pairs.take(zero_to_joints(FULL, 5))
    with pytest.raises(ValueError, match=words):
        pairs.take(values_message(5, {'zero': values}))
