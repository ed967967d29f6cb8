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

"""The offset of the camera's clock from the encoder's, from a star past which the axes drift."""

import logging

import numpy as np
import pytest
from bench import SECOND
from live_bench import Live

from msg_tools.units import ARCSEC
from telescope_mount.observing import camera_delay
from telescope_mount.observing.instruments import CAMERA

#: the camera of the bench sees the axes of now and the star of then, s
OWN = -0.25


def exposures(count=24, late=0.2, seed=1, noise=1.0, **beside):
    """Rows of a star that is centred but for `noise`, with what else acts."""
    rng = np.random.default_rng(seed)
    rates = camera_delay.legs(count, 30.0 * ARCSEC)
    place = np.vstack([np.zeros(2), np.cumsum(1.7 * rates, axis=0)[:-1]])
    error = rng.normal(0.0, noise * ARCSEC, (count, 2))
    miss = error - place - 0.8 * rates
    sense = np.sign(np.array([12.0, -9.0]) * ARCSEC + rates)
    out = (error + late * rates + np.array([3.0, -5.0]) * ARCSEC
           + beside.get('scale', 0.0) * miss + beside.get('turn', 0.0) * miss[:, ::-1]
           + beside.get('backlash', 0.0) * ARCSEC * sense
           + beside.get('drift', 0.0) * ARCSEC * np.arange(count)[:, np.newaxis])
    return [camera_delay.row_of(i * 1_700_000_000, *row) for i, row in enumerate(
        zip(rates, sense, miss, out))]


@pytest.mark.parametrize('beside', [
    {}, {'scale': 0.03}, {'turn': 0.02}, {'backlash': 3.0}, {'drift': 0.1}],
    ids=['alone', 'scale', 'rotation', 'backlash', 'drift'])
@pytest.mark.parametrize('late', [-0.5, 0.0, 0.05, 0.2])
def test_the_offset_and_nothing_else(late, beside):
    found = camera_delay.offset_of(exposures(late=late, noise=1e-6, **beside))
    assert found['offset_s'] == pytest.approx(late, abs=1e-5)


def test_its_error_is_the_scatter_of_many():
    found = [camera_delay.offset_of(exposures(seed=seed)) for seed in range(300)]
    offsets = np.array([one['offset_s'] for one in found]) - 0.2
    sigmas = np.array([one['sigma_s'] for one in found])
    assert np.std(offsets / sigmas) == pytest.approx(1.0, abs=0.12)
    assert np.mean(sigmas) < 0.012 and abs(np.mean(offsets)) < 3.0 * 0.012 / np.sqrt(300)


def test_an_exposure_that_is_none_of_the_star_is_left_out():
    rows = exposures()
    rows[7][-1] += 30.0 * ARCSEC
    found = camera_delay.offset_of(rows)
    assert found['exposures'] == 23
    assert abs(found['offset_s'] - 0.2) < 4.0 * found['sigma_s']


def test_too_few_exposures_tell_nothing():
    assert camera_delay.offset_of(exposures()[:8]) is None
    assert camera_delay.offset_of([]) is None
    # of one rate alone no time is told from backlash
    fast = [row for row in exposures(96) if abs(row[1]) > 20.0 * ARCSEC]
    assert camera_delay.offset_of(fast) is None
    assert 'too few' in camera_delay.sentence(None)


def test_legs_stay_near_the_star():
    rates = camera_delay.legs(64, 30.0 * ARCSEC)
    assert np.abs(np.cumsum(2.0 * rates, axis=0)).max() < camera_delay.FARTHEST
    assert camera_delay.rate_for(10.0, 30.0) == pytest.approx(3.0 * ARCSEC)
    assert camera_delay.rate_for(0.0, 30.0) == pytest.approx(30.0 * ARCSEC)


@pytest.mark.parametrize('late, corrected', [(0.0, 0.0), (0.2, 0.0), (0.2, 0.2)])
def test_a_plan_measures_it_and_says_what_to_do(caplog, late, corrected):
    """`corrected`: what the observer takes off the stamps."""
    bench = Live('stars 1, clocks 24, check 1', camera_late_s=corrected)
    bench.stamps = {CAMERA: lambda stamp: stamp + round((late - corrected - OWN) * SECOND)}
    texts = []
    bench.send_checks = texts.append
    with caplog.at_level(logging.INFO):
        bench.until(lambda: not bench.plan.busy, 60000)
    assert bench.plan.progress.state == 'done' and len(bench.rows) == 2
    found = texts[0]['clocks']['found']
    assert abs(found['offset_s'] - (late - corrected)) < 4.0 * found['sigma_s'] < 0.06
    assert found == camera_delay.offset_of(texts[0]['clocks']['exposures'])
    assert texts[-1]['clocks'] == texts[0]['clocks'] and len(texts[-1]['checks']) == 1
    told, off = bench.plan.night.clocks_sentence, bench.plan.night.clocks_are_off
    assert told in caplog.text and off is (late != corrected)
    if off:
        assert f'set camera_late_s of star_observer to {found["offset_s"]:.3f}' in told
        bench.plan.night.clocks = {}
        assert bench.plan.night.clocks_sentence == '' and not bench.plan.night.clocks_are_off


def test_without_a_star_nothing_is_measured_and_the_plan_goes_on(caplog):
    bench = Live('stars 1, clocks 12, stars 1')
    bench.until(lambda: len(bench.rows) == 1, 5000)
    bench.frame = lambda miss: (np.nan, np.nan)
    bench.until(lambda: bench.plan.progress.block == 2, 60000)
    assert 'the offset of the clocks is not measured' in caplog.text
