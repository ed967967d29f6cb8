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

"""What instruments give away of themselves, message by message."""

import numpy as np
import pytest

from calibration.analysis.camera_faults import SAME_FRAMES, frozen_rows
from msg_tools.units import ARCSEC
from telescope_mount.observing.instrument_health import (
    RECOVERED,
    InstrumentHealth,
)

SECOND = 10**9
NOW = 1_768_482_000 * SECOND


def told(health):
    return '; '.join(health.sentences.values())


@pytest.mark.parametrize('stamp, now, words', [
    (NOW, NOW, 'not after the one before'),
    (NOW - SECOND // 2, NOW, 'not after the one before'),
    (NOW - 50 * SECOND, NOW, 'stamps went back by 50 s'),
    (NOW + 3600 * SECOND, NOW, '3600 s ahead'),
])
def test_stamps_that_cannot_be_are_refused_until_they_can(stamp, now, words):
    health = InstrumentHealth()
    assert health.stamp('encoder', NOW, NOW) == '' and not health.suspect
    assert words in health.stamp('encoder', stamp, now)
    assert words in told(health) and health.suspect
    for i in range(RECOVERED):
        assert told(health).startswith('instrument encoder: ')
        assert health.stamp('encoder', NOW + (i + 1) * SECOND, NOW) == ''
    assert not health.sentences.values() and not health.suspect


def test_a_simulation_that_begins_anew_is_no_fault():
    health = InstrumentHealth()
    assert health.stamp('encoder', NOW + 9000 * SECOND, NOW + 9000 * SECOND) == ''
    assert health.stamp('encoder', NOW, NOW) == '' and not health.sentences.values()
    # without the time of the graph nobody knows
    assert health.stamp('camera', NOW, 0) == health.stamp('camera', NOW - 50 * SECOND, 0) == ''


def test_a_frozen_camera_is_told_from_one_that_sees_nothing():
    health = InstrumentHealth()
    for _ in range(SAME_FRAMES + 2):
        assert health.frame('camera', np.nan, np.nan) == ''
    for _ in range(SAME_FRAMES - 1):
        assert health.frame('camera', 0.0, 0.0) == ''
    assert 'it measures nothing' in health.frame('camera', 0.0, 0.0)
    assert 'the same miss distance in 7' in health.frame('camera', 0.0, 0.0)
    assert health.frame('camera', 1e-9, 0.0) == '' and not health.sentences.values()


def test_a_second_encoder_that_stands_still_is_not_used():
    health = InstrumentHealth()
    assert health.second('absolute', [1.0, 0.5], [1.0, 0.5])
    assert health.second('absolute', [1.0, 0.5], [1.0, 0.5])  # neither has moved
    assert not health.second('absolute', [1.0, 0.5], [1.2, 0.5])
    assert 'the same reading as at the star before' in told(health)
    assert health.second('absolute', [1.3, 0.5], [1.3, 0.5]) and not health.sentences.values()


def test_no_number_from_a_homed_encoder_is_told():
    health = InstrumentHealth()
    health.number('encoder', False)
    assert 'no number, although it was homed' in told(health)
    for _ in range(RECOVERED):
        health.number('encoder', True)
    assert not health.sentences.values()


def test_a_node_that_is_listed_twice_after_a_restart_is_one():
    health = InstrumentHealth()
    health.publishers('camera', ['/mount/camera', '/mount/camera'])
    assert not health.blocked and not health.suspect
    health.publishers('camera', ['/mount/camera'], unnamed=True)
    assert not health.blocked and not health.sentences.values() and health.suspect
    health.publishers('camera', ['/mount/camera', '/mount/other'])
    assert 'end all but one' in health.blocked and health.suspect


# --- rows -----------------------------------------------------------------------------------------


def test_a_camera_with_noise_has_no_frozen_rows():
    rng = np.random.default_rng(1)
    for noise in (0.05, 1.0):
        x, y = rng.normal(size=(2, 20000)) * noise * ARCSEC
        assert not frozen_rows(x, y).any()
    assert not frozen_rows(np.full(9, np.nan), np.full(9, np.nan)).any()


@pytest.mark.parametrize('spread', [0.0, 0.001])
def test_too_little_scatter_is_found_where_it_is(spread):
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(2, 30)) * ARCSEC
    x[8:20] = 40.0 * ARCSEC + rng.uniform(0, spread, 12) * ARCSEC
    y[8:20] = rng.uniform(0, spread, 12) * ARCSEC
    np.testing.assert_array_equal(np.flatnonzero(frozen_rows(x, y)), np.arange(8, 20))
    assert not frozen_rows(x[:11], y[:11]).any()  # three of them may be chance
