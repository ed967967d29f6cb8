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

import dataclasses

import numpy as np
import pytest

from encoder_reading.axis_reader import AxisReader, read_frames
from encoder_reading.design import Design
from encoder_reading.frame_readings import CORRECTED, EXACT, REJECTED, FrameReadings
from encoder_sim.absolute import Absolute, AbsoluteEncoder
from msg_tools.convert import LOWEST_READING
from msg_tools.units import ARCSEC, DEG, wrap

ANGLES = np.random.default_rng(4).uniform(0.0, 2.0 * np.pi, 400)
STAMPS = 10**6 * np.arange(400)


def encoder(axis='azimuth', **params):
    return AbsoluteEncoder(Absolute(noise=2.0, **params), 1, axis)


def readings(angle, quality, sigma):
    return FrameReadings(np.array(angle), np.array(quality, dtype=np.int8), np.array(sigma))


def test_two_heads_and_the_way_round():
    # 0.2" and 0.4" apart from opposite places, about the turn
    angles = np.array([1.0, 2e-6, 1.0 + np.pi + 4e-6, np.pi - 4e-6])
    rows = readings(angles, [EXACT, EXACT, CORRECTED, EXACT], [3e-6, 0.0, 4e-6, 2e-6])
    two = AxisReader(Design(heads=2), 'azimuth').join(rows)
    assert two.angle == pytest.approx([1.0 + 2e-6, 2 * np.pi - 1e-6])
    assert two.quality.tolist() == [CORRECTED, EXACT]
    assert two.sigma == pytest.approx([2.5e-6, 1e-6])
    rejected = readings([1.0, np.nan], [EXACT, REJECTED], [1e-6, np.nan])
    two = AxisReader(Design(heads=2), 'elevation').join(rejected)
    assert two.quality.tolist() == [REJECTED] and np.isnan([*two.angle, *two.sigma]).all()


@pytest.mark.parametrize('axis, shown, expected', [
    ('azimuth', [0.1, 6.2, 0.0], [2 * np.pi - 0.1, 2 * np.pi - 6.2, 0.0]),
    ('elevation', [0.1, 6.2, 0.0], [-0.1, 2 * np.pi - 6.2, 0.0])])
def test_a_disc_that_turns_against_its_axis(axis, shown, expected):
    rows = readings(shown, [EXACT] * 3, [1e-6] * 3)
    joined = AxisReader(Design(sense='against'), axis).join(rows)
    assert joined.angle == pytest.approx(expected)
    assert joined.sigma.tolist() == [1e-6] * 3


@pytest.mark.parametrize('kind, lowest', [('german', -90.0), ('equatorial', -180.0)])
def test_readings_of_an_equatorial_mount_do_not_jump_on_its_travel(kind, lowest):
    angles = (lowest + np.array([0.5, 70.0, 250.0, 359.5])) * DEG
    rows = readings(angles % (2 * np.pi), [EXACT] * 4, [1e-6] * 4)
    joined = AxisReader(Design(), 'declination', LOWEST_READING.get(kind)).join(rows)
    assert joined.angle == pytest.approx(angles)


def test_sigma_is_that_of_the_errors():
    device, pair = encoder(), encoder(heads=2)
    for each, bound in ((device, 0.337), (pair, 0.337 / np.sqrt(2.0))):
        got = each.read(STAMPS, ANGLES)
        error = wrap(got.angle - ANGLES)
        assert np.sqrt(np.mean(got.sigma**2)) / ARCSEC == pytest.approx(bound, rel=0.1)
        assert np.sqrt(np.mean((error / got.sigma) ** 2)) == pytest.approx(1.0, abs=0.25)
    buried = encoder(ccd_dust=30).read(STAMPS[:3], ANGLES[:3])
    assert np.isnan(buried.sigma).all()
    assert np.isnan(encoder(method='paper').read(STAMPS[:3], ANGLES[:3]).sigma).all()


def test_the_papers_method_on_a_ccd_the_other_way_round():
    design = dataclasses.replace(Design(), method='paper', mounting='reversed')
    frames = encoder(method='paper').frames(STAMPS[:20], ANGLES[:20])
    forward = read_frames([encoder(method='paper').reader], [frames])
    back = read_frames([AxisReader(design, 'azimuth')], [frames[..., ::-1]])
    assert back.angle == pytest.approx(forward.angle, nan_ok=True, abs=1e-12)
    assert np.isfinite(back.angle).mean() > 0.9


@pytest.mark.parametrize('method', ['template', 'paper'])
def test_read_alone_or_together(method):
    devices = [encoder(method=method), encoder('elevation', method=method, heads=2)]
    readers = [device.reader for device in devices]
    frames = [device.frames(STAMPS[:21], 0.2 * ANGLES[:21]) for device in devices]
    together = read_frames(readers, frames)
    assert together.angle.shape == together.sigma.shape == together.quality.shape == (21, 2)
    for i in (0, 7, 20):
        alone = read_frames(readers, [part[:, i : i + 1] for part in frames])
        for name in ('angle', 'quality', 'sigma'):
            assert np.array_equal(getattr(alone, name)[0], getattr(together, name)[i],
                                  equal_nan=True)
    none = read_frames(readers, [part[:, :0] for part in frames])
    assert none.angle.shape == (0, 2)
