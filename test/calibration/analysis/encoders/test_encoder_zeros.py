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

from calibration.analysis.encoders.cross_check_rows import (
    ABSOLUTE,
    ALIKE,
    BOTH,
    INCREMENTAL,
    NOTHING,
)
from calibration.analysis.encoders.encoder_zeros import (
    cause_probabilities,
    inflation,
)

NAMES = (NOTHING, INCREMENTAL, ABSOLUTE, BOTH, ALIKE)
#: noise of the two differences and what is usual of an encoder, arcsec
DIFFERENCE, SECOND, QUIET, SIZE = 0.06, 0.4, 0.5, 20.0
SIGMA, GAP = np.hypot(SECOND, QUIET), np.hypot(DIFFERENCE, QUIET * np.sqrt(2.0))


def named(jumps, rng, n=1500):
    """How often each cause is named, where (incremental, absolute, mount) jump so far."""
    inc, second, mount = (value + usual * rng.normal(size=n)
                          for value, usual in zip(jumps, (QUIET, QUIET, 0.0)))
    difference = inc - second + DIFFERENCE * rng.normal(size=n)
    against = second + mount + SECOND * rng.normal(size=n)
    found = [cause_probabilities(a, DIFFERENCE**2, b, SECOND**2, SIZE, QUIET)
             for a, b in zip(difference, against)]
    said = [max(one, key=one.get) for one in found]
    return {name: said.count(name) / n for name in NAMES}


@pytest.mark.parametrize('cause, jumps', [
    (NOTHING, (0, 0, 0)), (INCREMENTAL, (5 * SIGMA, 0, 0)), (ABSOLUTE, (0, -5 * SIGMA, 0)),
    (BOTH, (5 * SIGMA, -5 * SIGMA, 0)), (BOTH, (5 * SIGMA + 5 * GAP, 5 * SIGMA, 0)),
    (ALIKE, (0, 0, 5 * SIGMA)), (ALIKE, (5 * SIGMA, 5 * SIGMA, 0))])
def test_a_jump_of_five_sigma_is_named(cause, jumps):
    assert named(jumps, np.random.default_rng(1))[cause] > 0.95


def test_the_sky_is_the_weaker_one():
    # a jump that Polaris cannot see, although the encoders do: whose it is stays open
    found = cause_probabilities(1.0, DIFFERENCE**2, 0.0, 4.0**2, SIZE, 0.0)
    assert found[INCREMENTAL] < 0.8 and found[ABSOLUTE] > 0.2
    assert found[NOTHING] + found[ALIKE] < 1e-6


def test_probabilities_of_all_causes():
    found = cause_probabilities(3.0, 0.1, -2.0, 0.2, SIZE, QUIET)
    assert sum(found.values()) == pytest.approx(1.0) and set(found) == set(NAMES)


def test_how_big_a_jump_may_be_does_not_matter():
    for size in (10.0, 20.0, 40.0):
        found = cause_probabilities(9.0, DIFFERENCE**2, 0.1, SECOND**2, size, QUIET)
        assert found[INCREMENTAL] > 0.8


def test_the_mean_of_correlated_exposures_is_worse_than_their_scatter_says():
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(20000, 16))
    for k in range(1, 16):
        rows[:, k] = 0.6 * rows[:, k - 1] + 0.8 * rows[:, k]
    measured = np.mean(rows.var(axis=1, ddof=1)) / 16
    assert inflation(0.6, 16) == pytest.approx(np.var(rows.mean(axis=1)) / measured, rel=0.05)
    assert inflation(0.0, 16) == inflation(0.6, 1) == 1.0
