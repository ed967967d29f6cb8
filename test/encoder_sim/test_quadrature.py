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

"""Interpolation errors of a grating, by its two signals."""

import numpy as np
import pytest

from encoder_sim.graduated_disc import SineSignals
from encoder_sim.incremental import Incremental, IncrementalEncoder
from encoder_sim.scenario_file import load_scenario
from msg_tools.units import ARCSEC, DEG

LINES = 47200
PHASE = 2.0 * np.pi * np.arange(4096) / 4096
PER_LINE = 1296000.0 / LINES / (2.0 * np.pi)  # arcsec a radian of phase


def error(rate=0.0, **params):
    """Of the interpolated angle over a line, in radians of its phase."""
    signals = SineSignals(Incremental(**params))
    angle = 2.0 + PHASE / LINES
    shown = signals.shown(angle, rate)
    return (shown - angle) * LINES, LINES * angle


def harmonics(values, phase):
    """Mean, then (cosine, sine) of one and two a line."""
    waves = [np.ones(len(phase)), np.cos(phase), np.sin(phase), np.cos(2 * phase),
             np.sin(2 * phase)]
    return np.array([2.0 * np.mean(values * wave) for wave in waves]) * [0.5, 1, 1, 1, 1]


@pytest.mark.parametrize('params, wanted', [
    ({'offset_cos': 0.01}, [0.0, 0.0, -0.01, 0.0, 0.0]),
    ({'offset_sin': 0.01}, [0.0, 0.01, 0.0, 0.0, 0.0]),
    ({'amplitude_mismatch': 0.02}, [0.0, 0.0, 0.0, 0.0, -0.01]),
    ({'quadrature_error': 0.02}, [0.01, 0.0, 0.0, 0.01, 0.0])])
def test_small_faults_err_once_and_twice_a_line_as_heydemann_has_it(params, wanted):
    seen, phase = error(**params)
    np.testing.assert_allclose(harmonics(seen, phase), wanted, atol=2e-4)


def test_a_large_offset_errs_as_the_arctangent_has_it():
    seen, phase = error(offset_cos=0.5)
    # arg(1 + a exp(-i p)): a^k / k with k a line
    waves = [np.abs(2.0 * np.mean(seen * np.exp(1j * k * phase))) for k in (1, 2, 3, 4)]
    np.testing.assert_allclose(waves, [0.5**k / k for k in (1, 2, 3, 4)], atol=1e-6)


def test_makers_limits_leave_half_an_arcsecond_and_ideal_signals_nothing():
    assert SineSignals(Incremental()).ideal
    seen, phase = error(offset_cos=0.13, offset_sin=0.13, amplitude_mismatch=0.22,
                        quadrature_error=10 * DEG)
    _, *waves = harmonics(seen, phase) * PER_LINE
    assert np.hypot(*waves[:2]) == pytest.approx(0.81, abs=0.02)
    assert np.hypot(*waves[2:]) == pytest.approx(0.57, abs=0.02)


def test_at_speed_the_signals_are_smaller_and_late():
    bandwidth = 1000.0
    rate = 2.0 * np.pi * bandwidth / LINES  # 3 dB down
    late, _ = error(rate, bandwidth=bandwidth)
    np.testing.assert_allclose(late, -np.pi / 4, atol=1e-5)
    np.testing.assert_allclose(error(-rate, bandwidth=bandwidth)[0], np.pi / 4, atol=1e-5)
    slow = error(0.01 * rate, bandwidth=bandwidth)[0].mean()
    assert slow == pytest.approx(-0.01, rel=1e-3)  # a latency of 1 / (2 pi bandwidth)
    ratio = [np.ptp(error(r, offset_cos=0.02, bandwidth=bandwidth)[0]) for r in (0.0, rate)]
    assert ratio[1] / ratio[0] == pytest.approx(np.sqrt(2.0), rel=1e-3)


def test_lines_are_lost_where_the_signals_no_longer_go_round_the_origin():
    params = {'offset_cos': 0.5, 'bandwidth': 100.0, 'mark_angle': 0.0}
    signals = SineSignals(Incremental(**params))
    limit = 2.0 * np.pi * 100.0 / LINES * np.sqrt(3.0)  # amplitude down to a half
    assert signals.counting(np.array([0.99, 1.01]) * limit).tolist() == [True, False]
    askew = SineSignals(Incremental(offset_cos=0.7, quadrature_error=45 * DEG))
    assert askew.counting(0.0) and not SineSignals(Incremental(
        offset_cos=0.75, quadrature_error=45 * DEG)).counting(0.0)
    for share, lost in ((0.9, 0.0), (1.5, 1.0)):
        when = np.arange(2001) * 10**6
        angle = -0.1 * DEG + share * limit * when * 1e-9
        device = IncrementalEncoder(Incremental(**params), 1, 'azimuth')
        reading = device.feed(when, angle, share * limit)
        passed = angle[-1] - angle[np.isfinite(reading)][0]
        short = (angle - reading)[-1] - (angle - reading)[np.isfinite(reading)][0]
        assert short / passed == pytest.approx(lost, abs=2e-3)
        single = IncrementalEncoder(Incremental(**params), 1, 'azimuth')
        one_by_one = [single.feed(*one, share * limit)[0] for one in zip(when, angle)]
        assert np.array_equal(one_by_one, reading, equal_nan=True)


def test_the_scenario_errs_by_more_than_a_star_shows():
    found = {}
    for name in ('default', 'mount_encoder_lissajous'):
        params = load_scenario(name).incremental.azimuth
        device = IncrementalEncoder(params, 1, 'azimuth', start=0.0)
        device.feed(np.arange(101) * 10**7, np.linspace(179, 181, 101) * DEG)
        angle = 3.3 + 3.0 * np.arange(6000) / 6000 * 2.0 * np.pi / LINES
        off = device.feed(10**10 + np.arange(6000) * 10**6, angle) - angle
        found[name] = np.abs([2.0 * np.mean(off * np.exp(-1j * k * LINES * angle)) for k in (1, 2)])
    np.testing.assert_allclose(found['mount_encoder_lissajous'] / ARCSEC, [1.6, 0.83], atol=0.08)
    np.testing.assert_allclose(found['default'] / ARCSEC, [0.05, 0.0], atol=0.02)
