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

from encoder_sim.keyed_noise import bits, normal, uniform


def test_order_and_grouping_do_not_matter():
    keys = 1_768_000_000_000_000_000 + np.arange(50) * 1_000_000
    together = normal(3, 'camera', 'star', keys, 2)
    shuffled = np.random.default_rng(1).permutation(50)
    assert np.array_equal(normal(3, 'camera', 'star', keys[shuffled], 2), together[shuffled])
    for i in (49, 0, 17):
        assert np.array_equal(normal(3, 'camera', 'star', int(keys[i]), 2), together[i])


@pytest.mark.parametrize(
    'other', [(4, 'camera', 'star'), (3, 'absolute', 'star'), (3, 'camera', 'pixels')]
)
def test_seed_device_and_purpose_give_other_numbers(other):
    keys = np.arange(4000)
    first, second = normal(3, 'camera', 'star', keys), normal(*other, keys)
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.05
    assert not np.any(first == second)


def test_normal_distribution():
    from scipy import stats

    for numbers in (normal(1, 'a', 'b', np.arange(20000)), normal(1, 'a', 'c', 5, 20001)):
        assert stats.kstest(numbers, 'norm').pvalue > 0.01
    grid = normal(1, 'a', 'd', np.arange(3000), 4)
    assert np.allclose(np.corrcoef(grid.T), np.eye(4), atol=0.06)
    # neighbouring keys are independent too
    assert abs(np.corrcoef(grid[:-1, 0], grid[1:, 0])[0, 1]) < 0.05


def test_uniform_is_within_and_flat():
    numbers = uniform(1, 'a', 'b', np.arange(-10000, 10000))
    assert numbers.min() > 0.0 and numbers.max() < 1.0
    assert np.allclose(np.histogram(numbers, 10, (0, 1))[0], 2000, atol=200)


def test_shapes():
    assert normal(1, 'a', 'b', 7).shape == ()
    assert normal(1, 'a', 'b', np.zeros((2, 3), int)).shape == (2, 3)
    assert normal(1, 'a', 'b', 7, 5).shape == (5,)
    assert normal(1, 'a', 'b', [1, 2], 1800).shape == (2, 1800)


def test_bits():
    keys = 1_768_000_000_000_000_000 + np.arange(400) * 1_000_000
    words = bits(3, 'a', 'b', keys, 30)
    assert words.dtype == np.uint64 and words.shape == (400, 30)
    assert np.array_equal(bits(3, 'a', 'b', keys[7], 30)[0], words[7])
    # few numbers of one key are made in another way
    for some in (keys[7], -keys[7], np.int64(-1), 0):
        assert np.array_equal(bits(3, 'a', 'b', some, 3), bits(3, 'a', 'b', some, 30)[:, :3])
    each = words[..., np.newaxis] >> np.arange(64, dtype=np.uint64) & np.uint64(1)
    assert np.abs(each.mean(axis=(0, 1)) - 0.5).max() < 0.02
    # the numbers of `uniform` are their upper 53 bits
    assert uniform(3, 'a', 'b', keys) == pytest.approx(words[:, 0] / 2.0**64, abs=1e-15)
